//! Films to pictures: what a frame looks like, how many samples each pixel got, how far it may be off.
//!
//! Pure: pixels in, files out as bytes, the same bytes on every machine. It knows nothing of jobs or stores.

mod colour;
mod exr;
mod font;
mod legend;
mod png;

use common::{
    adaptive::{self, Verdict},
    film::{Features, Film, Moments},
    tile::Rect,
};

use crate::plan::Field;

/// A frame's pixels.
#[derive(Debug, Clone)]
pub struct Raster {
    /// Width and height of the whole frame.
    pub resolution: [u32; 2],
    /// The part that is rendered, in frame coordinates.
    pub region: Rect,
    /// What the intervals are shown by.
    pub rule: adaptive::Rule,
    /// Moments of the region's pixels, in row order; no samples where nothing is rendered yet.
    pub moments: Vec<Moments>,
    /// Features of the region's pixels, in row order.
    pub features: Vec<Features>,
}

/// Which picture, in which format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Picture {
    /// The image, sRGB; what is not rendered is transparent.
    ImagePng,
    /// All layers, linear f32.
    ImageExr,
    /// Samples of each pixel in colours, with a legend.
    SamplesPng,
    /// Samples of each pixel, one channel `Y`.
    SamplesExr,
    /// Standard error of each pixel's luminance in colours, with a legend.
    ErrorPng,
    /// Standard error of each pixel's luminance, one channel `Y`.
    ErrorExr,
}

impl Picture {
    /// All of them.
    pub const ALL: [Picture; 6] = [
        Picture::ImagePng,
        Picture::ImageExr,
        Picture::SamplesPng,
        Picture::SamplesExr,
        Picture::ErrorPng,
        Picture::ErrorExr,
    ];

    /// Its file name in the API.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Picture::ImagePng => "image.png",
            Picture::ImageExr => "image.exr",
            Picture::SamplesPng => "samples.png",
            Picture::SamplesExr => "samples.exr",
            Picture::ErrorPng => "error.png",
            Picture::ErrorExr => "error.exr",
        }
    }

    /// Its media type.
    #[must_use]
    pub fn media_type(self) -> &'static str {
        if self.name().ends_with(".png") { "image/png" } else { "image/x-exr" }
    }
}

/// Why a picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum BadPicture {
    /// The PNG encoder failed.
    #[error(transparent)]
    Png(#[from] ::image::ImageError),
    /// The EXR encoder failed.
    #[error(transparent)]
    Exr(#[from] ::exr::error::Error),
}

impl Raster {
    /// Copy a tile into its place.
    pub fn place(&mut self, rect: Rect, film: &Film) {
        for (i, (x, y)) in rect.pixels().enumerate() {
            let at = (y - self.region.y) as usize * self.region.w as usize + (x - self.region.x) as usize;
            if let (Some(to), Some(from)) = (self.moments.get_mut(at), film.moments.get(i)) {
                *to = *from;
            }
            if let (Some(to), Some(from)) = (self.features.get_mut(at), film.features.get(i)) {
                *to = *from;
            }
        }
    }
}

/// Make a picture.
///
/// # Errors
/// The encoder failed.
pub fn make(raster: &Raster, picture: Picture) -> Result<Vec<u8>, BadPicture> {
    match picture {
        Picture::ImagePng => png::image(raster),
        Picture::ImageExr => exr::layers(raster),
        Picture::SamplesPng => legend::samples(raster),
        Picture::SamplesExr => exr::single(raster, samples(raster)),
        Picture::ErrorPng => legend::errors(raster),
        Picture::ErrorExr => exr::single(raster, standard_errors(&verdicts(raster))),
    }
}

/// A PNG of signed differences, row by row, `size` being width and height: black where there is none, orange above
/// 0, blue below, and a legend that begins with `of`. The scale ends where all but one pixel in a thousand keep to;
/// what is not finite is grey.
///
/// # Errors
/// The encoder failed.
pub fn differences(size: [u32; 2], values: &[f32], of: &str) -> Result<Vec<u8>, BadPicture> {
    legend::differences(size, values, of)
}

/// A PNG made no wider than `width` pixels.
///
/// # Errors
/// It is no PNG, or the encoder failed.
pub fn smaller(picture: &[u8], width: u32) -> Result<Vec<u8>, BadPicture> {
    png::smaller(picture, width)
}

fn samples(raster: &Raster) -> Vec<f32> {
    raster.moments.iter().map(|m| m.samples as f32).collect()
}

/// What the stopping rule says of each pixel as it stands.
fn verdicts(raster: &Raster) -> Vec<Verdict> {
    let field = Field::new(raster.region, &raster.moments);
    field.judge(&raster.rule, raster.region).map(|(_, verdict)| verdict).collect()
}

/// Standard error of each pixel's luminance; infinite where it is not known.
fn standard_errors(verdicts: &[Verdict]) -> Vec<f32> {
    verdicts.iter().map(|verdict| verdict.standard_error as f32).collect()
}
