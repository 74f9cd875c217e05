//! `tessera compare`: how far an image is from a reference.

mod errors;
pub mod flip;
mod picture;

pub use errors::{EPSILON, Errors};
pub use picture::Picture;

use std::path::{Path, PathBuf};

use common::luminance;
use coordinator::assemble;
use serde_json::json;

use crate::{error::Failure, output, print};

/// Options of `compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// The image that is judged: an EXR or a PNG
    pub image: PathBuf,
    /// The reference that it is held against, of the same size. Relative errors and the bias are relative to it
    pub reference: PathBuf,
    /// A layer of both EXRs instead of their colours, such as samples.Y, stderr.Y, albedo or depth
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// A picture of the difference, with a legend: image minus reference, orange where the image is brighter
    #[arg(short, long, value_name = "FILE.png")]
    pub output: Option<PathBuf>,
}

/// Runs `tessera compare`.
///
/// # Errors
/// A file that cannot be read or written, or images that cannot be held against each other.
pub fn command(args: &CompareArgs) -> Result<(), Failure> {
    if let Some(path) = &args.output
        && path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png"))
    {
        return Err(Failure::Input(format!("--output {}: expected a name that ends in .png", path.display())));
    }
    let layer = args.layer.as_deref();
    let (image, reference) = (Picture::read(&args.image, layer)?, Picture::read(&args.reference, layer)?);
    comparable((&args.image, &image), (&args.reference, &reference))?;
    let errors = Errors::of(&image, &reference);
    if let Some(path) = &args.output {
        output::write(path, &difference(&image, &reference)?)?;
    }
    let names = image.names.join(" ");
    let [w, h] = image.size;
    if args.json {
        let head = json!({
            "image": args.image.display().to_string(), "reference": args.reference.display().to_string(),
            "channels": image.names, "resolution": [w, h],
        });
        let numbers = serde_json::to_value(errors).map_err(|error| Failure::Work(error.to_string()))?;
        let all: serde_json::Map<_, _> = [head, numbers].into_iter().filter_map(object).flatten().collect();
        return print::json(&all);
    }
    print::lines([format!(
        "{} against the reference {}: {names}, {w}x{h}",
        args.image.display(),
        args.reference.display()
    )])?;
    let told = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.6}"));
    let rows = [
        ("rmse", format!("{:.6}", errors.rmse), "square root of the mean squared difference"),
        ("mae", format!("{:.6}", errors.mae), "mean absolute difference"),
        ("relmse", format!("{:.6e}", errors.relmse), "mean of (x - r)^2 / (r^2 + 0.01), r the reference"),
        ("bias", told(errors.bias), "mean difference relative to the reference's mean"),
        ("flip", told(errors.flip), "mean LDR-FLIP at 67 pixels per degree, 0 alike to 1"),
        ("max", format!("{:.6}", errors.max), "largest absolute difference"),
    ];
    print::table(&["measure", "value", ""], rows.into_iter().map(|(a, b, c)| vec![a.into(), b, c.into()]))?;
    if errors.not_finite > 0 {
        eprintln!("note: {} values are not finite and were left out", errors.not_finite);
    }
    Ok(())
}

fn object(value: serde_json::Value) -> Option<serde_json::Map<String, serde_json::Value>> {
    if let serde_json::Value::Object(map) = value { Some(map) } else { None }
}

/// Check that two images show the same part of a frame, with as many channels.
fn comparable((a, image): (&Path, &Picture), (b, reference): (&Path, &Picture)) -> Result<(), Failure> {
    let (a, b) = (a.display(), b.display());
    let ([w, h], [rw, rh]) = (image.size, reference.size);
    if image.size != reference.size {
        let message = format!("{a} is {w}x{h} pixels and {b} is {rw}x{rh}: images must have one size");
        return Err(Failure::Input(message));
    }
    let (n, m) = (image.channels.len(), reference.channels.len());
    if n != m {
        let (these, those) = (image.names.join(" "), reference.names.join(" "));
        return Err(Failure::Input(format!("{a} has {these} and {b} has {those}: name a layer of both by --layer")));
    }
    Ok(())
}

/// Image minus reference as a PNG: the luminance of colours, else the mean of the channels.
fn difference(image: &Picture, reference: &Picture) -> Result<Vec<u8>, Failure> {
    let colours = image.colours().is_some();
    let value = |picture: &Picture, i: usize| {
        let of: Vec<f64> = picture.channels.iter().map(|channel| f64::from(channel[i])).collect();
        match of.as_slice() {
            &[r, g, b] if colours => luminance([r, g, b]),
            of => of.iter().sum::<f64>() / of.len() as f64,
        }
    };
    let pixels = image.size[0] * image.size[1];
    let values: Vec<f32> = (0..pixels).map(|i| (value(image, i) - value(reference, i)) as f32).collect();
    let what = if colours { "image minus reference, luminance" } else { "image minus reference" };
    // Pictures are read only where both edges fit.
    let size = image.size.map(|edge| edge as u32);
    let made = assemble::differences(size, &values, what);
    made.map_err(|error| Failure::Work(format!("the difference cannot be drawn: {error}")))
}
