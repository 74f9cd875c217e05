//! One pixel of a unit: its samples, batch by batch, become moments.

use common::{
    film::{Features, Moments},
    luminance,
};

use crate::{
    geometry::Counters,
    integrator::{End, Integrator, Probe, Sample, Vertex},
    math::{Rgb, Vec3},
    sampler::Sampler,
};

/// A pixel in the making.
pub(super) struct Pixel<'a> {
    integrator: &'a Integrator<'a>,
    sampler: &'a Sampler,
    pixel: [u32; 2],
    counters: &'a mut Counters,
    moments: Moments,
    features: Option<FeatureSums>,
    rejected: u32,
    first_rejected: Option<u32>,
}

/// A finished pixel.
pub(super) struct Done {
    pub moments: Moments,
    pub features: Features,
    pub rejected: u32,
    pub first_rejected: Option<u32>,
}

/// Sums over one batch.
#[derive(Default)]
struct Batch {
    sum: [f64; 3],
    finite: u32,
    /// What the first sample was, while all others were the same and known.
    known: Option<Rgb>,
}

impl<'a> Pixel<'a> {
    pub fn new(
        integrator: &'a Integrator<'a>,
        sampler: &'a Sampler,
        pixel: [u32; 2],
        features: bool,
        counters: &'a mut Counters,
    ) -> Self {
        Self {
            integrator,
            sampler,
            pixel,
            counters,
            moments: Moments::default(),
            features: features.then(FeatureSums::default),
            rejected: 0,
            first_rejected: None,
        }
    }

    /// Samples `first` to `first + samples`, in the sampler's batches.
    pub fn range(&mut self, first: u32, samples: u32) {
        let (mut next, end) = (first, first.saturating_add(samples));
        while next < end {
            let size = (self.sampler.batch() - next % self.sampler.batch()).min(end - next);
            self.batch(next, size, |_| {});
            next += size;
        }
    }

    /// Samples from 0 on in batches of `batch`, until 1.96 sqrt(variance / n) <= `tolerance` x mean of the
    /// samples' luminance: the textbook rule, kept with its faults (see `common::adaptive`). Only its
    /// variance is computed without cancellation (Welford 1962).
    pub fn textbook(&mut self, batch: u32, tolerance: f64, max_samples: u32) {
        let (mut n, mut mean, mut m2) = (0u32, 0.0, 0.0);
        while n < max_samples {
            let size = batch.max(1).min(max_samples - n);
            let mut seen = n;
            self.batch(n, size, |x| {
                seen += 1;
                let delta = x - mean;
                mean += delta / f64::from(seen);
                m2 += delta * (x - mean);
            });
            n += size;
            if n >= 2 {
                let variance = m2 / f64::from(n - 1);
                if 1.96 * (variance / f64::from(n)).sqrt() <= tolerance * mean {
                    break;
                }
            }
        }
    }

    /// One batch of `size` samples from `first` on; `each` is told every sample's luminance.
    fn batch(&mut self, first: u32, size: u32, mut each: impl FnMut(f64)) {
        let mut batch = Batch::default();
        for number in first..first + size {
            let sample = self.sample(number);
            if sample.radiance.is_finite() {
                batch.add(&sample);
                each(luminance(sample.radiance.as_dvec3().to_array()));
            } else {
                self.rejected += 1;
                self.first_rejected = self.first_rejected.or(Some(number));
                batch.known = None;
                each(batch.mean_luminance());
            }
        }
        let known = batch.known.is_some() && batch.finite == size;
        // Samples left out are stood for by the rest of their batch, so that counts stay what was asked for.
        let moments = Moments { known, ..Moments::batch(size, batch.mean()) };
        self.moments = self.moments.merge(moments);
    }

    #[inline]
    fn sample(&mut self, number: u32) -> Sample {
        let [x, y] = self.pixel;
        let stream = self.sampler.stream(x, y, number);
        match &mut self.features {
            None => self.integrator.sample(x, y, &stream, self.counters),
            Some(features) => {
                features.samples += 1;
                self.integrator.probed(x, y, &stream, self.counters, features)
            }
        }
    }

    pub fn finish(self) -> Done {
        Done {
            moments: self.moments,
            features: self.features.map(|sums| sums.mean()).unwrap_or_default(),
            rejected: self.rejected,
            first_rejected: self.first_rejected,
        }
    }
}

impl Batch {
    #[inline]
    fn add(&mut self, sample: &Sample) {
        for (sum, value) in self.sum.iter_mut().zip(sample.radiance.to_array()) {
            *sum += f64::from(value);
        }
        if self.finite == 0 {
            self.known = sample.known.then_some(sample.radiance);
        } else if self.known != Some(sample.radiance) || !sample.known {
            self.known = None;
        }
        self.finite += 1;
    }

    fn mean(&self) -> [f64; 3] {
        if self.finite == 0 { [0.0; 3] } else { self.sum.map(|sum| sum / f64::from(self.finite)) }
    }

    fn mean_luminance(&self) -> f64 {
        luminance(self.mean())
    }
}

/// First hits, summed.
#[derive(Debug, Default)]
struct FeatureSums {
    samples: u32,
    hits: u32,
    albedo: [f64; 3],
    normal: [f64; 3],
    depth: f64,
}

impl Probe for FeatureSums {
    fn vertex(&mut self, vertex: &Vertex) {
        if vertex.depth > 0 {
            return;
        }
        let add = |sum: &mut [f64; 3], v: Vec3| {
            if v.is_finite() {
                sum.iter_mut().zip(v.to_array()).for_each(|(s, c)| *s += f64::from(c));
            }
        };
        add(&mut self.albedo, vertex.albedo);
        add(&mut self.normal, vertex.ns);
        if vertex.camera_depth.is_finite() {
            self.depth += f64::from(vertex.camera_depth);
            self.hits += 1;
        }
    }

    fn end(&mut self, _: End, _: Rgb) {}
}

impl FeatureSums {
    fn mean(&self) -> Features {
        let over = |sum: f64, n: u32| if n == 0 { 0.0 } else { (sum / f64::from(n)) as f32 };
        Features {
            albedo: self.albedo.map(|sum| over(sum, self.samples)),
            normal: self.normal.map(|sum| over(sum, self.samples)),
            depth: over(self.depth, self.hits),
        }
    }
}
