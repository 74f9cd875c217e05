//! One pixel of a unit: its samples, batch by batch, become moments.

use common::{
    film::{Features, Moments},
    luminance,
};

use crate::{
    geometry::Counters,
    integrator::{End, FirstHit, Integrator, Probe, Sample, Traced, Vertex},
    math::{Rgb, Vec3},
    sampler::Sampler,
};

/// A pixel in the making: takes samples in order, batch by batch.
pub(super) struct Pixel {
    moments: Moments,
    batch: Batch,
    /// Samples that the batch in the making is to have, and has.
    size: u32,
    taken: u32,
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
    /// Of the samples' luminance: running mean, and sum of squared deviations from it.
    luminance: (f64, f64),
    /// What the first sample was, while all others were the same and known.
    known: Option<Rgb>,
}

/// Where samples come from, one at a time.
pub(super) struct Source<'a> {
    pub integrator: &'a Integrator<'a>,
    pub sampler: &'a Sampler,
    pub pixel: [u32; 2],
    pub counters: &'a mut Counters,
}

/// Samples `first` to `first + samples` as the sampler's batches: (number of the first, size) of each.
pub(super) fn batches(sampler: &Sampler, first: u32, samples: u32) -> impl Iterator<Item = (u32, u32)> {
    let (size, end) = (sampler.batch(), first.saturating_add(samples));
    let mut next = first;
    std::iter::from_fn(move || {
        (next < end).then(|| {
            let batch = (next, (size - next % size).min(end - next));
            next += batch.1;
            batch
        })
    })
}

impl Pixel {
    pub fn new(features: bool) -> Self {
        Self {
            moments: Moments::default(),
            batch: Batch::default(),
            size: 0,
            taken: 0,
            features: features.then(FeatureSums::default),
            rejected: 0,
            first_rejected: None,
        }
    }

    /// Samples `first` to `first + samples`, in the sampler's batches.
    pub fn range(&mut self, source: &mut Source, first: u32, samples: u32) {
        for (next, size) in batches(source.sampler, first, samples) {
            self.run(source, next, size, |_| {});
        }
    }

    /// Samples from 0 on in batches of `batch`, until 1.96 sqrt(variance / n) <= `tolerance` x mean of the
    /// samples' luminance: the textbook rule, kept with its faults (see `common::adaptive`). Only its
    /// variance is computed without cancellation (Welford 1962).
    pub fn textbook(&mut self, source: &mut Source, batch: u32, tolerance: f64, max_samples: u32) {
        let (mut n, mut mean, mut m2) = (0u32, 0.0, 0.0);
        while n < max_samples {
            let size = batch.max(1).min(max_samples - n);
            let mut seen = n;
            self.run(source, n, size, |x| {
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
    fn run(&mut self, source: &mut Source, first: u32, size: u32, mut each: impl FnMut(f64)) {
        self.begin(size);
        for number in first..first + size {
            let sample = self.trace(source, number);
            each(self.take(number, &sample));
        }
    }

    fn trace(&mut self, source: &mut Source, number: u32) -> Sample {
        let [x, y] = source.pixel;
        let stream = source.sampler.stream(x, y, number);
        match &mut self.features {
            None => source.integrator.sample(x, y, &stream, source.counters),
            Some(features) => {
                features.samples += 1;
                source.integrator.probed(x, y, &stream, source.counters, features)
            }
        }
    }

    /// Begin a batch of `size` samples.
    pub fn begin(&mut self, size: u32) {
        (self.batch, self.size, self.taken) = (Batch::default(), size, 0);
    }

    /// Take in a sample with what is known of its first hit.
    pub fn take_traced(&mut self, number: u32, traced: &Traced) {
        if let Some(features) = &mut self.features {
            features.samples += 1;
            if let Some(first) = &traced.first {
                features.add(first);
            }
        }
        self.take(number, &traced.sample);
    }

    /// Take in the batch's next sample, and merge the batch when it is full. The sample's luminance, or
    /// what stands for it.
    fn take(&mut self, number: u32, sample: &Sample) -> f64 {
        let luminance = if sample.radiance.is_finite() {
            let luminance = luminance(sample.radiance.as_dvec3().to_array());
            self.batch.add(sample, luminance);
            luminance
        } else {
            self.rejected += 1;
            self.first_rejected = self.first_rejected.or(Some(number));
            self.batch.known = None;
            self.batch.mean_luminance()
        };
        self.taken += 1;
        if self.taken == self.size {
            let known = self.batch.known.is_some() && self.batch.finite == self.size;
            // Samples left out are stood for by the rest of their batch, so that counts stay what was asked for.
            let within = self.batch.luminance.1;
            let moments = Moments { known, within, ..Moments::batch(self.size, self.batch.mean()) };
            self.moments = self.moments.merge(moments);
        }
        luminance
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
    fn add(&mut self, sample: &Sample, luminance: f64) {
        for (sum, value) in self.sum.iter_mut().zip(sample.radiance.to_array()) {
            *sum += f64::from(value);
        }
        if self.finite == 0 {
            self.known = sample.known.then_some(sample.radiance);
        } else if self.known != Some(sample.radiance) || !sample.known {
            self.known = None;
        }
        self.finite += 1;
        // Welford 1962.
        let delta = luminance - self.luminance.0;
        self.luminance.0 += delta / f64::from(self.finite);
        self.luminance.1 += delta * (luminance - self.luminance.0);
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
        if vertex.depth == 0 {
            let Vertex { albedo, ns, camera_depth, .. } = *vertex;
            self.add(&FirstHit { albedo, ns, camera_depth });
        }
    }

    fn end(&mut self, _: End, _: Rgb) {}
}

impl FeatureSums {
    fn add(&mut self, first: &FirstHit) {
        let add = |sum: &mut [f64; 3], v: Vec3| {
            if v.is_finite() {
                sum.iter_mut().zip(v.to_array()).for_each(|(s, c)| *s += f64::from(c));
            }
        };
        add(&mut self.albedo, first.albedo);
        add(&mut self.normal, first.ns);
        if first.camera_depth.is_finite() {
            self.depth += f64::from(first.camera_depth);
            self.hits += 1;
        }
    }

    fn mean(&self) -> Features {
        let over = |sum: f64, n: u32| if n == 0 { 0.0 } else { (sum / f64::from(n)) as f32 };
        Features {
            albedo: self.albedo.map(|sum| over(sum, self.samples)),
            normal: self.normal.map(|sum| over(sum, self.samples)),
            depth: over(self.depth, self.hits),
        }
    }
}
