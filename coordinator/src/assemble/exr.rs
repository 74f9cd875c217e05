//! OpenEXR: one part, linear 32-bit float, dotted channel names, bytes that depend on nothing but pixels.

use std::io::Cursor;

use exr::{
    image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, write::WritableImage},
    math::Vec2,
    meta::{
        attribute::{IntegerBounds, Text},
        header::{ImageAttributes, LayerAttributes},
    },
};

use super::{BadPicture, Raster, samples, standard_errors, verdicts};

/// Image, samples, errors and features.
pub(super) fn layers(raster: &Raster) -> Result<Vec<u8>, BadPicture> {
    let moments = &raster.moments;
    let features = &raster.features;
    let mean = |channel: usize| moments.iter().map(|m| m.mean[channel] as f32).collect();
    let verdicts = verdicts(raster);
    let mut channels: Vec<(&str, Vec<f32>)> = vec![
        ("R", mean(0)),
        ("G", mean(1)),
        ("B", mean(2)),
        ("A", moments.iter().map(|m| if m.samples > 0 { 1.0 } else { 0.0 }).collect()),
        ("samples.Y", samples(raster)),
        ("stderr.Y", standard_errors(&verdicts)),
        ("interval.Y", verdicts.iter().map(|verdict| verdict.half_width as f32).collect()),
        ("depth.Z", features.iter().map(|f| f.depth).collect()),
    ];
    for (i, name) in ["albedo.R", "albedo.G", "albedo.B"].into_iter().enumerate() {
        channels.push((name, features.iter().map(|f| f.albedo[i]).collect()));
    }
    for (i, name) in ["normal.X", "normal.Y", "normal.Z"].into_iter().enumerate() {
        channels.push((name, features.iter().map(|f| f.normal[i]).collect()));
    }
    write(raster, channels)
}

/// One channel, `Y`.
pub(super) fn single(raster: &Raster, values: Vec<f32>) -> Result<Vec<u8>, BadPicture> {
    write(raster, vec![("Y", values)])
}

fn write(raster: &Raster, channels: Vec<(&str, Vec<f32>)>) -> Result<Vec<u8>, BadPicture> {
    let list = channels.into_iter().map(|(name, values)| AnyChannel::new(text(name), FlatSamples::F32(values)));
    let region = raster.region;
    let attributes =
        LayerAttributes { layer_position: Vec2(region.x as i32, region.y as i32), ..LayerAttributes::default() };
    let size = Vec2(region.w as usize, region.h as usize);
    let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(list.collect()));
    let [w, h] = raster.resolution;
    let frame = IntegerBounds::from_dimensions(Vec2(w as usize, h as usize));
    let image = Image::empty(ImageAttributes::new(frame)).with_layer(layer);
    let mut file = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut file)?;
    Ok(file.into_inner())
}

fn text(name: &str) -> Text {
    Text::new_or_none(name).unwrap_or_default()
}
