//! What is known of the paths of a wave.

use super::{Traced, stages};
use crate::{
    geometry::{FewRays, Found, Ray},
    integrator::{Arrival, Sample},
    lanes::{Compiled, Flag, Lane, Lane3, NO, Proven, WIDTH, YES},
    light::{LightSample, Reference},
    math::Frame,
    sampler::{Sampler, Stream},
    scene::NO_EMITTER,
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
    /// Paths that go on, in the first lanes.
    pub(super) n: usize,
    /// Which sample a lane is.
    pub(super) slot: Lane<u32>,
    pub(super) key: Lane<u64>,
    pub(super) index: Lane<u32>,
    pub(super) alive: Lane<Flag>,
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
    pub(super) traced: [Traced; WIDTH],
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
            slot: [0; WIDTH],
            key: [0; WIDTH],
            index: [0; WIDTH],
            alive: [NO; WIDTH],
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
            traced: [Traced::NOTHING; WIDTH],
        }))
    }

    /// Of the wave just run, sample `i`.
    #[inline]
    #[must_use]
    pub fn traced(&self, i: usize) -> &Traced {
        &self.traced[i]
    }

    #[inline(always)]
    pub(super) fn stream(&self, sampler: &Sampler, i: usize) -> Stream {
        sampler.resume(self.key[i], self.index[i])
    }

    /// Keep lane `from` in lane `to`: what outlives a vertex.
    #[inline(always)]
    pub(super) fn shift(&mut self, from: usize, to: usize) {
        if from == to {
            return;
        }
        self.slot[to] = self.slot[from];
        self.key[to] = self.key[from];
        self.index[to] = self.index[from];
        self.origin.shift(from, to);
        self.direction.shift(from, to);
        self.t_max[to] = self.t_max[from];
        self.throughput.shift(from, to);
        self.radiance.shift(from, to);
        self.eta2[to] = self.eta2[from];
        self.came[to] = self.came[from];
        self.pdf[to] = self.pdf[from];
        self.from.shift(from, to);
        self.from_n.shift(from, to);
    }

    /// The path of lane `i` is done.
    #[inline(always)]
    pub(super) fn end(&mut self, i: usize, known: bool) {
        self.alive[i] = NO;
        self.traced[self.slot[i] as usize].sample = Sample { radiance: self.radiance.at(i), known };
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

    /// A pair of numbers for each path, into `u`.
    pub(super) fn draw_two(&mut self, sampler: &Sampler, dimension: u32) {
        if sampler.is_default() {
            stages::draw_two(self.proven, self, dimension);
        } else {
            for i in 0..self.n {
                let u = self.stream(sampler, i).two(dimension);
                (self.u[0][i], self.u[1][i]) = (u.x, u.y);
            }
        }
    }
}
