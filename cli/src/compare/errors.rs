//! How far an image is from a reference, in numbers.

use serde::Serialize;

use super::{
    flip::{PIXELS_PER_DEGREE, flip},
    picture::Picture,
};

/// What is added to the squared reference under a relative squared error: black pixels would divide by 0.
pub const EPSILON: f64 = 0.01;

/// Errors over all channels of all pixels, of linear values: x is the image, r the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Errors {
    /// Square root of the mean of (x - r)^2.
    pub rmse: f64,
    /// Mean of |x - r|.
    pub mae: f64,
    /// Mean of (x - r)^2 / (r^2 + 0.01).
    pub relmse: f64,
    /// Mean of x - r, relative to the mean of r; absent where that is 0.
    pub bias: Option<f64>,
    /// Mean FLIP, of colours alone.
    pub flip: Option<f64>,
    /// Largest |x - r|.
    pub max: f64,
    /// Values that are not finite in the image or the reference: FLIP apart, nothing above counts them.
    pub not_finite: usize,
}

impl Errors {
    /// The errors of `image` against `reference`, which have one size and as many channels.
    #[must_use]
    pub fn of(image: &Picture, reference: &Picture) -> Self {
        let pairs = image.channels.iter().flatten().zip(reference.channels.iter().flatten());
        let (mut n, mut not_finite) = (0usize, 0);
        let (mut squares, mut absolute, mut relative, mut signed, mut level, mut max) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (&x, &r) in pairs {
            if !x.is_finite() || !r.is_finite() {
                not_finite += 1;
                continue;
            }
            let (d, r) = (f64::from(x) - f64::from(r), f64::from(r));
            n += 1;
            squares += d * d;
            absolute += d.abs();
            relative += d * d / (r * r + EPSILON);
            signed += d;
            level += r;
            max = f64::max(max, d.abs());
        }
        let mean = |sum: f64| if n == 0 { 0.0 } else { sum / n as f64 };
        let flip = image.colours().zip(reference.colours()).map(|(image_rgb, reference_rgb)| {
            let each = flip(image.size[0], &image_rgb, &reference_rgb, PIXELS_PER_DEGREE);
            each.iter().sum::<f64>() / each.len() as f64
        });
        Self {
            rmse: mean(squares).sqrt(),
            mae: mean(absolute),
            relmse: mean(relative),
            bias: (level != 0.0).then(|| signed / level),
            flip,
            max,
            not_finite,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(names: &[&str], channels: &[&[f32]]) -> Picture {
        Picture {
            size: [channels[0].len(), 1],
            names: names.iter().map(ToString::to_string).collect(),
            channels: channels.iter().map(|values| values.to_vec()).collect(),
        }
    }

    #[test]
    fn a_pair_worked_by_hand() {
        // Differences: R .5 and 0, G 0 and -.25, B 0 and 0; reference: R .5 1, G 0 .5, B 0 0.
        let image = picture(&["R", "G", "B"], &[&[1.0, 1.0], &[0.0, 0.25], &[0.0, 0.0]]);
        let reference = picture(&["R", "G", "B"], &[&[0.5, 1.0], &[0.0, 0.5], &[0.0, 0.0]]);
        let errors = Errors::of(&image, &reference);
        let is = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
        // (.25 + .0625) / 6.
        is(errors.rmse, (0.3125f64 / 6.0).sqrt());
        is(errors.mae, 0.75 / 6.0);
        // .25 / (.25 + .01) and .0625 / (.25 + .01).
        is(errors.relmse, 0.3125 / 0.26 / 6.0);
        // (.5 - .25) / 2.
        is(errors.bias.unwrap(), 0.125);
        is(errors.max, 0.5);
        assert!(errors.flip.is_some_and(|flip| flip > 0.1));
        // The other way round the reference is another: what is relative changes.
        let back = Errors::of(&reference, &image);
        is(back.relmse, (0.25 / 1.01 + 0.0625 / 0.0725) / 6.0);
        is(back.bias.unwrap(), -0.25 / 2.25);
        is(back.rmse, errors.rmse);
    }

    #[test]
    fn what_is_not_finite_is_counted_and_left_out() {
        let image = picture(&["Y"], &[&[f32::INFINITY, 2.0, f32::NAN]]);
        let reference = picture(&["Y"], &[&[1.0, 1.0, 1.0]]);
        let errors = Errors::of(&image, &reference);
        assert_eq!((errors.not_finite, errors.mae, errors.max, errors.flip), (2, 1.0, 1.0, None));
        let black = picture(&["Y"], &[&[0.0]]);
        assert_eq!(Errors::of(&black, &black).bias, None);
    }
}
