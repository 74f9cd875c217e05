//! `tessera render --pixel X,Y --sample N`: one sample again, alone, with the path it took.

use std::path::Path;

use crate::{args::RenderArgs, bundle::Bundle, error::Failure, print, request};

/// Render one sample and print its path. Its radiance has the bits that it has in the image of the same
/// options.
///
/// # Errors
/// Bad input, or a pixel outside the frame.
pub fn replay(args: &RenderArgs, scene: &Path, pixel: [u32; 2], sample: u32) -> Result<(), Failure> {
    let mut bundle = Bundle::read(scene)?;
    let request = request::of(&args.job, &bundle)?;
    let settings = request::settings(&request, &bundle)?;
    let ([x, y], [w, h]) = (pixel, settings.resolution);
    if x >= w || y >= h {
        return Err(Failure::Input(format!("--pixel: {x},{y} is not inside the {w}x{h} frame")));
    }
    let prepared = bundle.load(&request)?.build();
    print::lines([prepared.sample(&settings, pixel, sample).to_string()])
}
