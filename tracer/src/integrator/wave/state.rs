//! What is known of the paths of a wave.

use super::{FirstHit, Traced, stages};
use crate::{
    geometry::{FewRays, Found, Ray},
    integrator::{Arrival, Sample, dimension},
    lanes::{Compiled, Flag, Lane, Lane3, NO, Proven, WIDTH, YES, lanes_of, mask_of},
    light::{LightSample, Reference},
    math::{Frame, Rgb},
    sampler::{Sampler, Stream},
    scene::{NO_EMITTER, Record},
};

/// Whether a path is one that only the way it came finds light, or has also had light sampled for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Came {
    Only,
    Sampled,
    Counted,
}

/// How a lane's surface scatters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Scatters {
    /// Lambert's law with a constant colour: stages do it.
    Diffuse,
    /// Anything else: asked one path at a time.
    Other,
    /// Deltas alone.
    Delta,
}

/// The state of the paths, by quantity. Reused from wave to wave: nothing is allocated while rendering.
#[derive(Debug)]
pub struct Wave {
    pub(super) proven: Proven,
    /// Lanes in use.
    pub(super) n: usize,
    /// A bit for each of them that has no path.
    pub(super) idle: u64,
    /// Which sample a lane is.
    pub(super) slot: Lane<u32>,
    pub(super) key: Lane<u64>,
    pub(super) index: Lane<u32>,
    pub(super) alive: Lane<Flag>,
    /// Scatterings so far.
    pub(super) depth: Lane<u32>,
    /// Paths about to begin.
    pub(super) fresh: Fresh,
    // The ray, and what light along it counts for.
    pub(super) origin: Lane3,
    pub(super) direction: Lane3,
    pub(super) t_max: Lane<f32>,
    pub(super) throughput: Lane3,
    pub(super) radiance: Lane3,
    pub(super) eta2: Lane<f32>,
    pub(super) came: Lane<Came>,
    pub(super) pdf: Lane<f32>,
    pub(super) from: Lane3,
    pub(super) from_n: Lane3,
    // The hit and its surface.
    pub(super) corners: [Lane3; 3],
    pub(super) b1: Lane<f32>,
    pub(super) b2: Lane<f32>,
    pub(super) material: Lane<u32>,
    pub(super) emitter: Lane<u32>,
    pub(super) surface: Lane<u32>,
    pub(super) p: Lane3,
    pub(super) p_error: Lane3,
    pub(super) ng: Lane3,
    pub(super) tangent: Lane3,
    pub(super) bitangent: Lane3,
    pub(super) wo: Lane3,
    pub(super) front: Lane<Flag>,
    pub(super) n_reflecting: Lane3,
    pub(super) scatters: Lane<Scatters>,
    pub(super) two_sided: Lane<Flag>,
    pub(super) transmissive: Lane<Flag>,
    pub(super) reflectance: Lane3,
    /// A bit for each lane whose surface is an emitter.
    pub(super) emitters: u64,
    /// A bit for each lane whose material stages do not know.
    pub(super) others: u64,
    /// Whether light is gathered here.
    pub(super) gathers: Lane<Flag>,
    /// Whether a stage has ended the path.
    pub(super) ended: Lane<Flag>,
    // Random numbers.
    pub(super) u: [Lane<f32>; 2],
    // A light sample and what it brings, shadows left out.
    pub(super) lit: Lane<Flag>,
    pub(super) wi: Lane3,
    pub(super) light: Lane3,
    pub(super) light_error: Lane3,
    pub(super) light_ng: Lane3,
    pub(super) light_radiance: Lane3,
    pub(super) light_pdf: Lane<f32>,
    pub(super) infinite: Lane<Flag>,
    pub(super) brings: Lane3,
    pub(super) shadow_origin: Lane3,
    pub(super) shadow_direction: Lane3,
    pub(super) shadow_t_max: Lane<f32>,
    pub(super) occluded: Lane<Flag>,
    pub(super) few: FewRays,
    pub(super) found: Found,
    /// Of each request, its sample; and its first hit, where that is wanted.
    pub(super) samples: Vec<Sample>,
    pub(super) firsts: Vec<Option<FirstHit>>,
}

/// Paths about to begin, in the first lanes.
#[derive(Debug)]
pub(super) struct Fresh {
    pub x: Lane<f32>,
    pub y: Lane<f32>,
    pub key: Lane<u64>,
    pub index: Lane<u32>,
    pub origin: Lane3,
    pub direction: Lane3,
    pub t_max: Lane<f32>,
}

impl Wave {
    /// Room for a wave, run with the fastest instructions there are.
    #[must_use]
    pub fn new() -> Box<Self> {
        Self::compiled_for(Compiled::detect()).unwrap_or_else(|| unreachable!("what was detected is available"))
    }

    /// The same with the instructions given; `None` where the processor lacks them.
    #[must_use]
    pub fn compiled_for(compiled: Compiled) -> Option<Box<Self>> {
        let proven = Proven::new(compiled)?;
        let (zero, zeros) = ([0.0; WIDTH], Lane3::ZERO);
        Some(Box::new(Self {
            proven,
            n: 0,
            idle: u64::MAX,
            slot: [0; WIDTH],
            key: [0; WIDTH],
            index: [0; WIDTH],
            alive: [NO; WIDTH],
            depth: [0; WIDTH],
            fresh: Fresh {
                x: zero,
                y: zero,
                key: [0; WIDTH],
                index: [0; WIDTH],
                origin: zeros,
                direction: zeros,
                t_max: zero,
            },
            origin: zeros,
            direction: zeros,
            t_max: zero,
            throughput: zeros,
            radiance: zeros,
            eta2: zero,
            came: [Came::Only; WIDTH],
            pdf: zero,
            from: zeros,
            from_n: zeros,
            corners: [zeros; 3],
            b1: zero,
            b2: zero,
            material: [0; WIDTH],
            emitter: [NO_EMITTER; WIDTH],
            surface: [0; WIDTH],
            p: zeros,
            p_error: zeros,
            ng: zeros,
            tangent: zeros,
            bitangent: zeros,
            wo: zeros,
            front: [NO; WIDTH],
            n_reflecting: zeros,
            scatters: [Scatters::Other; WIDTH],
            two_sided: [NO; WIDTH],
            transmissive: [NO; WIDTH],
            reflectance: zeros,
            emitters: 0,
            others: 0,
            gathers: [NO; WIDTH],
            ended: [NO; WIDTH],
            u: [zero; 2],
            lit: [NO; WIDTH],
            wi: zeros,
            light: zeros,
            light_error: zeros,
            light_ng: zeros,
            light_radiance: zeros,
            light_pdf: zero,
            infinite: [NO; WIDTH],
            brings: zeros,
            shadow_origin: zeros,
            shadow_direction: zeros,
            shadow_t_max: zero,
            occluded: [NO; WIDTH],
            few: FewRays::new(proven),
            found: Found::NOTHING,
            samples: Vec::new(),
            firsts: Vec::new(),
        }))
    }

    /// Of the requests just served, what came of number `i`.
    #[inline]
    #[must_use]
    pub fn traced(&self, i: usize) -> Traced {
        Traced { sample: self.samples[i], first: self.firsts.get(i).copied().flatten() }
    }

    /// Make room for what comes of `requests` paths.
    pub(super) fn begin(&mut self, requests: usize, features: bool) {
        self.samples.clear();
        self.samples.resize(requests, Sample { radiance: Rgb::ZERO, known: false });
        self.firsts.clear();
        self.firsts.resize(if features { requests } else { 0 }, None);
        self.n = requests.min(WIDTH);
        // Stages look at as many lanes as there are paths: what the wave before left in the others must not be seen.
        (self.alive, self.ended, self.gathers, self.lit) = ([NO; WIDTH], [NO; WIDTH], [NO; WIDTH], [NO; WIDTH]);
        self.idle = if self.n == WIDTH { u64::MAX } else { (1 << self.n) - 1 };
    }

    /// A bit for each lane that has a path.
    #[inline(always)]
    pub(super) fn active(&self) -> u64 {
        mask_of(&self.alive)
    }

    #[inline(always)]
    pub(super) fn stream(&self, sampler: &Sampler, i: usize) -> Stream {
        sampler.resume(self.key[i], self.index[i])
    }

    /// The path of lane `i` is done.
    #[inline(always)]
    pub(super) fn end(&mut self, i: usize, known: bool) {
        self.alive[i] = NO;
        self.idle |= 1 << i;
        self.samples[self.slot[i] as usize] = Sample { radiance: self.radiance.at(i), known };
    }

    pub(super) fn ray(&self, i: usize) -> Ray {
        Ray { origin: self.origin.at(i), direction: self.direction.at(i), t_max: self.t_max[i] }
    }

    pub(super) fn frame(&self, i: usize) -> Frame {
        Frame { t: self.tangent.at(i), b: self.bitangent.at(i), n: self.ng.at(i) }
    }

    pub(super) fn arrival(&self, i: usize) -> Arrival {
        match self.came[i] {
            Came::Only => Arrival::Only,
            Came::Counted => Arrival::Counted,
            Came::Sampled => {
                Arrival::Sampled { pdf: self.pdf[i], from: Reference { p: self.from.at(i), n: self.from_n.at(i) } }
            }
        }
    }
}

impl Wave {
    /// What is known of the surface that lane `i` hit.
    #[inline(always)]
    pub(super) fn set_surface(&mut self, i: usize, record: &Record) {
        self.material[i] = record.material;
        self.emitter[i] = record.emitter;
        self.surface[i] = record.surface;
        self.emitters |= u64::from(record.emitter != NO_EMITTER) << i;
        self.others |= u64::from(record.diffuse.is_none()) << i;
        self.scatters[i] = match (record.diffuse, record.delta) {
            (Some(_), _) => Scatters::Diffuse,
            (None, true) => Scatters::Delta,
            (None, false) => Scatters::Other,
        };
        self.reflectance.set(i, record.diffuse.unwrap_or(Rgb::ZERO));
        self.two_sided[i] = Flag::from(record.two_sided);
        self.transmissive[i] = Flag::from(record.transmissive);
    }

    #[inline(always)]
    pub(super) fn set_light(&mut self, i: usize, light: &LightSample) {
        self.lit[i] = YES;
        self.wi.set(i, light.wi);
        self.light.set(i, light.point);
        self.light_error.set(i, light.point_error);
        self.light_ng.set(i, light.ng);
        self.light_radiance.set(i, light.radiance);
        // A lamp that no ray can hit is told by the sign.
        self.light_pdf[i] = if light.delta { -light.pdf } else { light.pdf };
        self.infinite[i] = Flag::from(!light.distance.is_finite());
    }

    /// A pair of numbers for each path, into `u`: those of decision `which` at its vertex.
    pub(super) fn draw_two(&mut self, sampler: &Sampler, which: u32) {
        if sampler.is_plain() {
            stages::draw_two(self.proven, self, which, sampler.batch());
        } else {
            for i in lanes_of(self.active()) {
                let u = self.stream(sampler, i).two(dimension::at(self.depth[i], which));
                (self.u[0][i], self.u[1][i]) = (u.x, u.y);
            }
        }
    }
}
