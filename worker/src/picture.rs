//! Picture files into memory: PNG, JPEG and OpenEXR.

use std::io::Cursor;

use common::mesh::{Encoding, Picture};

/// Largest edge of a texture or environment, pixels.
const MAX_EDGE: u32 = 32_768;
/// Most pixels: 4 GiB in memory.
const MAX_PIXELS: u64 = 1 << 28;

/// Extensions of the files that [`decode`] reads, lower case.
pub const EXTENSIONS: &[&str] = &["png", "jpg", "jpeg", "exr"];

/// Whether `path` ends like a picture.
#[must_use]
pub fn is_picture(path: &str) -> bool {
    extension(path).is_some_and(|extension| EXTENSIONS.contains(&extension.as_str()))
}

fn extension(path: &str) -> Option<String> {
    path.rsplit_once('.').map(|(_, extension)| extension.to_ascii_lowercase())
}

/// Decode a picture; what it is, its extension says.
///
/// # Errors
/// A file that is not what its name says, is cut short, or is larger than a picture may be.
pub fn decode(path: &str, bytes: &[u8]) -> Result<Picture, String> {
    match extension(path).as_deref() {
        Some("png") => decode_plain(bytes, image::ImageFormat::Png),
        Some("jpg" | "jpeg") => decode_plain(bytes, image::ImageFormat::Jpeg),
        Some("exr") => decode_exr(bytes),
        _ => Err(format!("is not a picture format that is known, which are .{}", EXTENSIONS.join(", ."))),
    }
    .map_err(|message| format!("{path}: {message}"))
}

fn check_size(width: u32, height: u32) -> Result<(), String> {
    if width == 0 || height == 0 {
        return Err("has no pixels".into());
    }
    if width > MAX_EDGE || height > MAX_EDGE || u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!("{width}x{height} pixels are more than {MAX_EDGE} an edge or {MAX_PIXELS} in all"));
    }
    Ok(())
}

fn decode_plain(bytes: &[u8], format: image::ImageFormat) -> Result<Picture, String> {
    let reader = || {
        let mut reader = image::ImageReader::with_format(Cursor::new(bytes), format);
        let mut limits = image::Limits::default();
        limits.max_image_width = Some(MAX_EDGE);
        limits.max_image_height = Some(MAX_EDGE);
        limits.max_alloc = Some(16 * MAX_PIXELS);
        reader.limits(limits);
        reader
    };
    let (width, height) = reader().into_dimensions().map_err(|error| error.to_string())?;
    check_size(width, height)?;
    let decoded = reader().decode().map_err(|error| error.to_string())?;
    let pixels = match &decoded {
        // Eight bits stay exact: n / 255 is the value the file means.
        image::DynamicImage::ImageRgb16(_)
        | image::DynamicImage::ImageRgba16(_)
        | image::DynamicImage::ImageLuma16(_)
        | image::DynamicImage::ImageLumaA16(_) => {
            decoded.to_rgba16().pixels().map(|p| p.0.map(|c| f32::from(c) / 65_535.0)).collect()
        }
        _ => decoded.to_rgba8().pixels().map(|p| p.0.map(|c| f32::from(c) / 255.0)).collect(),
    };
    Ok(Picture { width, height, pixels, encoding: Encoding::Srgb })
}

fn decode_exr(bytes: &[u8]) -> Result<Picture, String> {
    use exr::prelude::{MetaData, ReadChannels, ReadLayers, read};
    // The header first: pixels are allocated from what it says.
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), true).map_err(|error| error.to_string())?;
    for header in &meta.headers {
        let size = |n: usize| u32::try_from(n).map_err(|_| "is too large".to_string());
        check_size(size(header.layer_size.width())?, size(header.layer_size.height())?)?;
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, _| Picture {
                width: size.width() as u32,
                height: size.height() as u32,
                pixels: vec![[0.0; 4]; size.area()],
                encoding: Encoding::Linear,
            },
            |picture, at, (r, g, b, a): (f32, f32, f32, f32)| {
                picture.pixels[at.y() * picture.width as usize + at.x()] = [r, g, b, a];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| error.to_string())?;
    let picture = image.layer_data.channel_data.pixels;
    if picture.pixels.iter().flatten().all(|value| value.is_finite()) {
        Ok(picture)
    } else {
        Err("holds a value that is not finite".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png() -> Vec<u8> {
        let image = image::RgbaImage::from_fn(3, 2, |x, y| image::Rgba([x as u8 * 100, y as u8 * 255, 7, 128]));
        let mut bytes = Vec::new();
        image.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
        bytes
    }

    fn exr(value: f32) -> Vec<u8> {
        use exr::prelude::*;
        let mut bytes = Vec::new();
        let channels = SpecificChannels::rgb(move |at: Vec2<usize>| (at.x() as f32, at.y() as f32, value));
        Image::from_channels((3, 2), channels).write().to_buffered(Cursor::new(&mut bytes)).unwrap();
        bytes
    }

    #[test]
    fn rows_come_from_the_top_with_the_values_of_the_file() {
        let picture = decode("wood.PNG", &png()).unwrap();
        assert_eq!((picture.width, picture.height, picture.encoding), (3, 2, Encoding::Srgb));
        assert_eq!(picture.pixels[2], [200.0 / 255.0, 0.0, 7.0 / 255.0, 128.0 / 255.0]);
        assert_eq!(picture.pixels[3][1], 1.0);

        let picture = decode("sky.exr", &exr(1e6)).unwrap();
        assert_eq!((picture.width, picture.height, picture.encoding), (3, 2, Encoding::Linear));
        assert_eq!(picture.pixels[5], [2.0, 1.0, 1e6, 1.0]);
    }

    #[test]
    fn damaged_files_are_errors_that_name_the_file() {
        for (name, bytes) in [("a.png", png()), ("a.exr", exr(1.0)), ("a.jpg", png())] {
            let error = decode(name, &bytes[..bytes.len() / 2]).unwrap_err();
            assert!(error.starts_with(&format!("{name}: ")), "{error}");
        }
        assert!(decode("a.exr", &exr(f32::NAN)).unwrap_err().contains("not finite"));
        assert!(decode("a.tiff", &[]).unwrap_err().contains(".png"));
    }
}
