//! PNG: 8-bit sRGB.

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::{BadPicture, Raster};

/// The image; what is not rendered yet is transparent black.
pub(super) fn image(raster: &Raster) -> Result<Vec<u8>, BadPicture> {
    let mut bytes = Vec::with_capacity(raster.moments.len() * 4);
    for moments in &raster.moments {
        bytes.extend(moments.mean.map(srgb));
        bytes.push(if moments.samples > 0 { 255 } else { 0 });
    }
    encode(&bytes, raster.region.w, raster.region.h, ExtendedColorType::Rgba8)
}

/// A PNG made no wider than `width` pixels, by averaging.
pub(super) fn smaller(picture: &[u8], width: u32) -> Result<Vec<u8>, BadPicture> {
    let whole = image::load_from_memory_with_format(picture, image::ImageFormat::Png)?.into_rgba8();
    let (w, h) = whole.dimensions();
    if w <= width {
        return Ok(picture.to_vec());
    }
    let height = (u64::from(h) * u64::from(width) / u64::from(w)).max(1) as u32;
    let small = image::imageops::thumbnail(&whole, width, height);
    encode(small.as_raw(), small.width(), small.height(), ExtendedColorType::Rgba8)
}

pub(super) fn encode(bytes: &[u8], w: u32, h: u32, colour: ExtendedColorType) -> Result<Vec<u8>, BadPicture> {
    let mut file = Vec::new();
    PngEncoder::new(&mut file).write_image(bytes, w, h, colour)?;
    Ok(file)
}

/// Linear light to an sRGB byte (IEC 61966-2-1).
fn srgb(linear: f64) -> u8 {
    let clipped = linear.clamp(0.0, 1.0);
    let encoded = if clipped <= 0.003_130_8 { 12.92 * clipped } else { 1.055 * libm::pow(clipped, 1.0 / 2.4) - 0.055 };
    (encoded * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::srgb;

    #[test]
    fn the_transfer_curve_is_the_standard_one() {
        // 21.586% linear light is encoded as 128 / 255.
        for (linear, byte) in [(0.0, 0), (0.001, 3), (0.215_861, 128), (1.0, 255), (7.0, 255), (-1.0, 0)] {
            assert_eq!(srgb(linear), byte, "{linear}");
        }
    }
}
