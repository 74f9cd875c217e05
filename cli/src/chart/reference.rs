//! What methods are held against: a reference whose own noise is known and taken out.
//!
//! A reference is two halves that are independent of each other. What an image differs by from one half and what
//! it differs by from the other then share the image's error and nothing else, so the mean of their product is the
//! image's squared error alone. Halves are kept as EXRs between runs.

use std::path::{Path, PathBuf};

use common::{film::Features, hash::AssetHash, luminance};
use coordinator::{
    assemble::{self, Picture as Image, Raster},
    plan,
};
use serde_json::json;

use super::stage::Stage;
use crate::{
    compare::{
        EPSILON, Picture,
        flip::{PIXELS_PER_DEGREE, flip},
    },
    error::Failure,
    output,
};

/// Colours of a picture, linear, row by row.
pub type Pixels = Vec<[f32; 3]>;

/// Seeds of the halves: far from those that methods are tried with.
const SEEDS: [u64; 2] = [u64::MAX, u64::MAX - 1];
/// Samples of a pixel from one sign of progress to the next.
const STRIDE: u32 = 64;

/// A reference.
#[derive(Debug)]
pub struct Reference {
    /// Two independent halves, or one picture.
    halves: Vec<Pixels>,
    /// Their mean.
    mean: Pixels,
    width: usize,
    /// relMSE of the mean itself, where it is known.
    pub relmse: Option<f64>,
    /// Standard error of its mean luminance, relative to it, where that is known.
    pub mean_error: Option<f64>,
    /// Samples of a pixel, both halves together, where it was rendered here.
    pub samples: Option<u64>,
    /// Where it lies.
    pub files: Vec<PathBuf>,
}

/// How far one picture is from a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// Mean squared error relative to the squared reference + 0.01, the reference's own noise taken out.
    pub relmse: f64,
    /// The same with that noise in it.
    pub relmse_plain: f64,
    /// Square root of the mean squared error, the reference's noise taken out; 0 where that leaves nothing.
    pub rmse: f64,
    /// Mean difference relative to the reference's mean.
    pub bias: f64,
    /// Mean FLIP.
    pub flip: f64,
}

impl Reference {
    /// Read a reference: one picture, or two that are independent of each other.
    ///
    /// # Errors
    /// A file that cannot be read, has another size, or has no colours.
    pub fn read(files: &[PathBuf], size: [usize; 2]) -> Result<Self, Failure> {
        let mut halves = Vec::new();
        let mut errors = Vec::new();
        for path in files {
            let wrong = |what: String| Failure::Input(format!("--reference {}: {what}", path.display()));
            let picture = Picture::read(path, None)?;
            if picture.size != size {
                let ([w, h], [rw, rh]) = (size, picture.size);
                return Err(wrong(format!("is {rw}x{rh} pixels, and the chart is of {w}x{h}; see --resolution")));
            }
            let pixels = picture.colours().ok_or_else(|| wrong("has no colours".into()))?;
            if pixels.iter().flatten().any(|value| !value.is_finite()) {
                return Err(wrong("holds values that are not finite".into()));
            }
            halves.push(pixels);
            // Only our own files tell their errors.
            let layer = Picture::read(path, Some("stderr.Y")).ok().map(|picture| picture.channels.concat());
            errors.push(layer.filter(|errors| errors.iter().all(|error| error.is_finite())));
        }
        Ok(Self::of(halves, &errors, size[0], files.to_vec()))
    }

    /// Render both halves with `samples` of a pixel each, or take them from `cache`; `scene` names the scene. `tick`
    /// is told of samples as they are taken.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn render(
        stage: &Stage,
        scene: AssetHash,
        samples: u32,
        cache: &Path,
        tick: &mut dyn FnMut(u64),
    ) -> Result<Self, Failure> {
        let region = stage.region();
        let settings = stage.settings();
        let named = json!({
            "scene": scene, "frame": settings.frame, "resolution": settings.resolution, "region": region,
            "method": settings.method, "samples": samples, "version": env!("CARGO_PKG_VERSION"),
        });
        let name = AssetHash::of(named.to_string().as_bytes()).to_string();
        let size = [region.w as usize, region.h as usize];
        let files: Vec<PathBuf> = [1, 2].map(|half| cache.join(format!("reference-{}-{half}.exr", &name[..20]))).into();
        if let Ok(found) = Self::read(&files, size) {
            return Ok(Self { samples: Some(2 * u64::from(samples)), ..found });
        }
        output::folder(cache)?;
        for (path, seed) in files.iter().zip(SEEDS) {
            let moments = stage.long(samples, STRIDE, seed, tick);
            let rule = plan::Rule::shown(&common::job::Quality::Samples { samples });
            let features = vec![Features::default(); moments.len()];
            let raster = Raster { resolution: settings.resolution, region, rule, moments, features };
            let file = assemble::make(&raster, Image::ImageExr);
            let file = file.map_err(|error| Failure::Work(format!("the reference cannot be kept: {error}")))?;
            output::write(path, &file)?;
        }
        Ok(Self { samples: Some(2 * u64::from(samples)), ..Self::read(&files, size)? })
    }

    fn of(halves: Vec<Pixels>, errors: &[Option<Vec<f32>>], width: usize, files: Vec<PathBuf>) -> Self {
        let n = halves.len() as f64;
        let mean: Pixels = (0..halves[0].len())
            .map(|i| [0, 1, 2].map(|c| (halves.iter().map(|half| f64::from(half[i][c])).sum::<f64>() / n) as f32))
            .collect();
        let light = |pixel: &[f32; 3]| luminance(pixel.map(f64::from));
        // Standard errors of independent halves: their squares add up.
        let squared: Option<Vec<f64>> = errors.iter().cloned().collect::<Option<Vec<_>>>().map(|errors| {
            let of = |i: usize| errors.iter().map(|half| f64::from(half[i]).powi(2)).sum::<f64>() / (n * n);
            (0..mean.len()).map(of).collect()
        });
        let level: f64 = mean.iter().map(light).sum();
        let mean_error = squared.as_ref().filter(|_| level > 0.0).map(|s| s.iter().sum::<f64>().sqrt() / level);
        let relmse = match halves.as_slice() {
            [a, b] => {
                let half = |i: usize, c: usize| (f64::from(a[i][c]) - f64::from(b[i][c])) / 2.0;
                Some(over(&mean, |i, c| half(i, c).powi(2)))
            }
            _ => squared.map(|squared| {
                let of = |i: usize| squared[i] / (light(&mean[i]).powi(2) + EPSILON);
                (0..mean.len()).map(of).sum::<f64>() / mean.len() as f64
            }),
        };
        Self { halves, mean, width, relmse, mean_error, samples: None, files }
    }

    /// Whether its own noise is taken out of what is measured.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.halves.len() == 2
    }

    /// Squared reference + 0.01, by which squared errors are divided.
    fn weight(&self, i: usize, c: usize) -> f64 {
        f64::from(self.mean[i][c]).powi(2) + EPSILON
    }

    /// How far `image` is from it.
    #[must_use]
    pub fn distance(&self, image: &Pixels) -> Distance {
        let from = |half: &Pixels, i: usize, c: usize| f64::from(image[i][c]) - f64::from(half[i][c]);
        let (a, b) = (&self.halves[0], &self.halves[self.halves.len() - 1]);
        let (mut squares, mut signed, mut level) = (0.0, 0.0, 0.0);
        for i in 0..image.len() {
            for c in 0..3 {
                squares += from(a, i, c) * from(b, i, c);
                signed += from(&self.mean, i, c);
                level += f64::from(self.mean[i][c]);
            }
        }
        let seen = flip(self.width, image, &self.mean, PIXELS_PER_DEGREE);
        Distance {
            relmse: over(&self.mean, |i, c| from(a, i, c) * from(b, i, c)),
            relmse_plain: over(&self.mean, |i, c| from(&self.mean, i, c).powi(2)),
            rmse: (squares / (3 * image.len()) as f64).max(0.0).sqrt(),
            bias: if level == 0.0 { 0.0 } else { signed / level },
            flip: seen.iter().sum::<f64>() / seen.len().max(1) as f64,
        }
    }
}

/// Mean over pixels and channels of `squared`, relative to the squared reference + 0.01.
fn over(mean: &Pixels, squared: impl Fn(usize, usize) -> f64) -> f64 {
    let of = |i: usize| (0..3).map(|c| squared(i, c) / (f64::from(mean[i][c]).powi(2) + EPSILON)).sum::<f64>();
    (0..mean.len()).map(of).sum::<f64>() / (3 * mean.len()).max(1) as f64
}

/// The part of a method's error that more samples would not take away: sums over independent pictures of one
/// method, from which the noise of each is taken out.
#[derive(Debug, Clone, Default)]
pub struct Lasting {
    pictures: f64,
    /// Of each value: sums of differences from the one half and the other, and of their products.
    sums: Vec<[f64; 3]>,
}

impl Lasting {
    /// Take in a picture.
    pub fn add(&mut self, reference: &Reference, image: &Pixels) {
        let (a, b) = (&reference.halves[0], &reference.halves[reference.halves.len() - 1]);
        self.sums.resize(3 * image.len(), [0.0; 3]);
        self.pictures += 1.0;
        for (k, sum) in self.sums.iter_mut().enumerate() {
            let (i, c) = (k / 3, k % 3);
            let x = f64::from(image[i][c]);
            let (from_a, from_b) = (x - f64::from(a[i][c]), x - f64::from(b[i][c]));
            *sum = [sum[0] + from_a, sum[1] + from_b, sum[2] + from_a * from_b];
        }
    }

    /// Mean squared bias of a pixel relative to its squared reference + 0.01, and its standard error, from what
    /// pixels differ by. Products of different pictures' differences share the bias and no noise.
    #[must_use]
    pub fn relmse(&self, reference: &Reference) -> (f64, f64) {
        let pairs = self.pictures * (self.pictures - 1.0);
        let pixel = |i: usize| {
            let of = |c: usize| {
                let [a, b, products] = self.sums[3 * i + c];
                (a * b - products) / pairs / reference.weight(i, c)
            };
            (of(0) + of(1) + of(2)) / 3.0
        };
        let n = (self.sums.len() / 3) as f64;
        let (sum, squares) = (0..self.sums.len() / 3).map(pixel).fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
        let mean = sum / n;
        (mean, ((squares / n - mean * mean).max(0.0) / n).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::random::Random;

    const PIXELS: usize = 4000;

    fn noisy(random: &mut Random, level: f64, noise: f64) -> Pixels {
        (0..PIXELS).map(|_| [0; 3].map(|_: i32| (level + noise * random.normal()) as f32)).collect()
    }

    /// The noise of two halves does not show in what is measured against them; that of one picture does.
    #[test]
    fn the_references_own_noise_is_taken_out() {
        let mut random = Random::new(3);
        let halves = vec![noisy(&mut random, 1.0, 0.05), noisy(&mut random, 1.0, 0.05)];
        let single = Reference::of(vec![halves[0].clone()], &[None], 80, vec![]);
        let two = Reference::of(halves, &[None, None], 80, vec![]);
        let image = noisy(&mut random, 1.0, 0.05);
        // Variance .0025 each, over 1.01; the mean of the halves has half of it.
        let found = two.distance(&image);
        let near =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 0.08, "{found}, not {expected}");
        near(found.relmse, 0.0025 / 1.01);
        near(found.rmse, 0.05);
        near(found.relmse_plain, 0.003_75 / 1.01);
        near(two.relmse.unwrap_or_default(), 0.001_25 / 1.01);
        near(single.distance(&image).relmse, 0.005 / 1.01);
        assert!(single.relmse.is_none() && !single.is_clean() && two.is_clean());
    }

    #[test]
    fn what_lasts_is_the_bias_without_the_noise() {
        let mut random = Random::new(5);
        let halves = vec![noisy(&mut random, 1.0, 0.05), noisy(&mut random, 1.0, 0.05)];
        let reference = Reference::of(halves, &[None, None], 80, vec![]);
        for (level, expected) in [(1.0, 0.0), (1.1, 0.01 / 1.01)] {
            let mut lasting = Lasting::default();
            for _ in 0..4 {
                lasting.add(&reference, &noisy(&mut random, level, 0.2));
            }
            let (found, error) = lasting.relmse(&reference);
            assert!(error > 0.0 && error < 1e-3, "{error}");
            assert!((found - expected).abs() < 4.0 * error, "{found} +- {error}, not {expected}");
        }
    }

    #[test]
    fn standard_errors_of_the_halves_give_that_of_the_mean() {
        let halves = vec![vec![[2.0; 3]; 100]; 2];
        let errors = [Some(vec![0.3; 100]), Some(vec![0.4; 100])];
        let reference = Reference::of(halves, &errors, 10, vec![]);
        // sqrt(100 (.09 + .16) / 4) / 200.
        assert!((reference.mean_error.unwrap() - 2.5 / 200.0).abs() < 1e-6);
    }
}
