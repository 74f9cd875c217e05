//! Images as they lie on disk: a layer of an EXR, or a PNG made linear.

use std::{io::Cursor, path::Path};

use common::job::check_resolution;
use exr::prelude::{FlatSamples, MetaData, ReadChannels, ReadLayers, read};

use crate::error::Failure;

/// Channels of one image, linear.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Names of the channels.
    pub names: Vec<String>,
    /// Their values, row by row.
    pub channels: Vec<Vec<f32>>,
}

/// Channels that make a colour, and those that make a vector.
const COLOUR: [&str; 3] = ["R", "G", "B"];
const VECTOR: [&str; 3] = ["X", "Y", "Z"];

const EXR_MAGIC: &[u8] = &[0x76, 0x2f, 0x31, 0x01];
const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";

impl Picture {
    /// Read an EXR or a PNG. `layer` names a channel of an EXR (`samples.Y`), or what stands before the dot of
    /// several (`albedo`); without it, colours are read, or the one channel there is. Alpha is left out.
    ///
    /// # Errors
    /// A file that cannot be read, is neither, or has no such layer.
    pub fn read(path: &Path, layer: Option<&str>) -> Result<Self, Failure> {
        let bytes = std::fs::read(path).map_err(|error| Failure::file(path, &error))?;
        let wrong = |what: String| Failure::Input(format!("{}: {what}", path.display()));
        if bytes.starts_with(EXR_MAGIC) {
            Self::of_exr(&bytes, layer).map_err(wrong)
        } else if bytes.starts_with(PNG_MAGIC) {
            match layer {
                Some(layer) => Err(wrong(format!("--layer {layer}: a PNG has no layers; give an EXR"))),
                None => Self::of_png(&bytes).map_err(wrong),
            }
        } else {
            Err(wrong("neither an EXR nor a PNG".into()))
        }
    }

    /// The pixels, where they are colours.
    #[must_use]
    pub fn colours(&self) -> Option<Vec<[f32; 3]>> {
        let [r, g, b] = self.channels.as_slice() else { return None };
        let last = |name: &str| name.rsplit('.').next().unwrap_or_default().to_owned();
        let are = self.names.iter().map(|name| last(name)).eq(COLOUR);
        are.then(|| r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]).collect())
    }

    fn of_exr(bytes: &[u8], layer: Option<&str>) -> Result<Self, String> {
        let broken = |error: exr::error::Error| format!("not a sound EXR: {error}");
        // Sizes are looked at before room is made for them.
        let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
        for header in &meta.headers {
            let [w, h] = [header.layer_size.x(), header.layer_size.y()];
            let edge = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
            check_resolution("size", edge(w), edge(h)).map_err(|error| error.to_string())?;
        }
        let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
        let image = image.non_parallel().from_buffered(Cursor::new(bytes)).map_err(broken)?;
        let mut all = Vec::new();
        for (part, content) in image.layer_data.iter().enumerate() {
            let prefix = content.attributes.layer_name.as_ref().map(|name| format!("{name}."));
            for (i, channel) in content.channel_data.list.iter().enumerate() {
                let own = channel.name.to_string();
                let full = format!("{}{own}", prefix.as_deref().unwrap_or_default());
                all.push(Channel { full, own, place: (part, i) });
            }
        }
        let chosen = choose(&all, layer)?;
        let part = &image.layer_data[chosen[0].place.0];
        let size = [part.size.x(), part.size.y()];
        let values = |(part, i): (usize, usize)| match &image.layer_data[part].channel_data.list[i].sample_data {
            FlatSamples::F16(values) => values.iter().map(|v| v.to_f32()).collect(),
            FlatSamples::F32(values) => values.clone(),
            FlatSamples::U32(values) => values.iter().map(|v| *v as f32).collect::<Vec<f32>>(),
        };
        let names = chosen.iter().map(|channel| channel.full.clone()).collect();
        let channels: Vec<Vec<f32>> = chosen.iter().map(|channel| values(channel.place)).collect();
        if channels.iter().any(|channel| channel.len() != size[0] * size[1]) {
            return Err("its channels differ in resolution".into());
        }
        Ok(Self { size, names, channels })
    }

    fn of_png(bytes: &[u8]) -> Result<Self, String> {
        let mut reader = image::ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Png);
        reader.limits({
            let mut limits = image::Limits::default();
            limits.max_alloc = Some(1 << 31);
            limits
        });
        let image = reader.decode().map_err(|error| format!("not a sound PNG: {error}"))?.into_rgb32f();
        let channel = |c: usize| image.pixels().map(|pixel| linear(pixel.0[c])).collect();
        Ok(Self {
            size: [image.width() as usize, image.height() as usize],
            names: COLOUR.map(String::from).into(),
            channels: vec![channel(0), channel(1), channel(2)],
        })
    }
}

/// A channel of a file.
#[derive(Debug, Clone)]
struct Channel {
    /// Its name, that of its part before it.
    full: String,
    /// Its name alone.
    own: String,
    /// Number of the part, and of the channel in it.
    place: (usize, usize),
}

/// The channels that are meant, in the order of their axes.
fn choose<'a>(all: &'a [Channel], layer: Option<&str>) -> Result<Vec<&'a Channel>, String> {
    let exactly = |name: &str| all.iter().find(|channel| channel.full == name || channel.own == name);
    let triple = |prefix: &str, axes: [&str; 3]| -> Option<Vec<&Channel>> {
        axes.iter().map(|axis| exactly(&format!("{prefix}{axis}"))).collect()
    };
    let chosen = match layer {
        None => {
            let grey = exactly("Y").or(all.first().filter(|_| all.len() == 1));
            triple("", COLOUR).or(grey.map(|channel| vec![channel]))
        }
        Some(name) => {
            let prefix = format!("{name}.");
            let mut inside = all.iter().filter(|c| c.full.starts_with(&prefix) || c.own.starts_with(&prefix));
            let alone = inside.next().filter(|_| inside.next().is_none());
            let one = exactly(name).or(alone).map(|channel| vec![channel]);
            one.or_else(|| triple(&prefix, COLOUR)).or_else(|| triple(&prefix, VECTOR))
        }
    };
    chosen.ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|channel| channel.full.as_str()).collect();
        let wanted = match layer {
            None => "has no colours; name a layer by --layer".into(),
            Some(name) => format!("--layer {name}: there is no such layer"),
        };
        format!("{wanted}; its channels are {}", names.join(", "))
    })
}

/// Linear light of an sRGB value from 0 to 1 (IEC 61966-2-1).
#[must_use]
pub fn linear(encoded: f32) -> f32 {
    let v = f64::from(encoded);
    (if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channels(names: &[&str]) -> Vec<Channel> {
        let channel =
            |(i, name): (usize, &&str)| Channel { full: name.to_string(), own: name.to_string(), place: (0, i) };
        names.iter().enumerate().map(channel).collect()
    }

    #[test]
    fn a_layer_is_a_channel_or_what_stands_before_the_dot() {
        let ours = channels(&[
            "A",
            "B",
            "G",
            "R",
            "albedo.B",
            "albedo.G",
            "albedo.R",
            "normal.X",
            "normal.Y",
            "normal.Z",
            "samples.Y",
        ]);
        let chosen =
            |layer| choose(&ours, layer).map(|chosen| chosen.into_iter().map(|c| c.full.as_str()).collect::<Vec<_>>());
        for (layer, expected) in [
            (None, vec!["R", "G", "B"]),
            (Some("samples.Y"), vec!["samples.Y"]),
            (Some("samples"), vec!["samples.Y"]),
            (Some("albedo"), vec!["albedo.R", "albedo.G", "albedo.B"]),
            (Some("normal"), vec!["normal.X", "normal.Y", "normal.Z"]),
            (Some("A"), vec!["A"]),
        ] {
            assert_eq!(chosen(layer).unwrap(), expected);
        }
        let error = chosen(Some("sample")).unwrap_err();
        assert!(error.contains("--layer sample: there is no such layer") && error.contains("samples.Y"), "{error}");
        assert_eq!(choose(&channels(&["Y"]), None).unwrap()[0].own, "Y");
        assert_eq!(choose(&channels(&["depth.Z"]), None).unwrap()[0].own, "depth.Z");
        assert!(choose(&channels(&["a", "b"]), None).is_err());
    }

    #[test]
    fn the_transfer_curve_is_the_inverse_of_the_standard_one() {
        for (byte, expected) in [(0u8, 0.0), (10, 0.003_035), (128, 0.215_861), (255, 1.0)] {
            assert!((linear(f32::from(byte) / 255.0) - expected).abs() < 1e-6, "{byte}");
        }
    }
}
