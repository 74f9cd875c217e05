//! What is known of the paths of a wave.

use super::{FirstHit, Samplers, Traced, aims::AimLanes, forks::Fork, reuse::Group, stages};
use crate::{
    geometry::{FewRays, Found, Ray, Spared},
    integrator::{Arrival, Sample, dimension, reuse::Share},
    lanes::{Compiled, Flag, Lane, Lane3, NO, Proven, WIDTH, YES, lanes_of, mask_of},
    light::{Ball, LightSample, Reference, Shard},
    math::{Frame, Rgb},
    sampler::Stream,
    scene::{NO_EMITTER, Record},
    special::{Special, Without},
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
    /// Rough metal of one tint: stages do it, but for how much light its facets reflect.
    Facets,
    /// Anything else: asked one path at a time.
    Other,
    /// Deltas alone.
    Delta,
}

/// The state of the paths, by quantity. Reused from wave to wave: nothing is allocated while rendering.
#[derive(Debug)]
pub struct Wave {
    pub(super) proven: Proven,
    /// The instructions that it was made for.
    made_for: Proven,
    /// Whether numbers of all lanes are drawn at once.
    pub(super) plain_points: bool,
    /// Lanes in use.
    pub(super) n: usize,
    /// A bit for each of them that has no path.
    pub(super) idle: u64,
    /// Which sample a lane is.
    pub(super) slot: Lane<u32>,
    /// Which of all ways a forked path is.
    pub(super) way: Lane<u32>,
    pub(super) key: Lane<u64>,
    pub(super) index: Lane<u32>,
    pub(super) alive: Lane<Flag>,
    /// Scatterings so far.
    pub(super) depth: Lane<u32>,
    /// Whether the path is one way of several, and in how many ways it goes on from this vertex if that is no delta.
    pub(super) forked: Lane<Flag>,
    pub(super) ways: Lane<f32>,
    /// Paths about to begin.
    pub(super) fresh: Fresh,
    /// Vertices from which paths are still to go on.
    pub(super) forks: Vec<Fork>,
    // The ray, and what light along it counts for.
    pub(super) origin: Lane3,
    pub(super) direction: Lane3,
    pub(super) t_max: Lane<f32>,
    pub(super) spared: [Lane<u32>; 2],
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
    /// What rays from there need not be held against, if they leave at no flat angle.
    pub(super) own: [Lane<u32>; 2],
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
    /// Of rough metal, the roughness of its facets.
    pub(super) alphas: [Lane<f32>; 2],
    /// Of rough metal, the [`Facets`](crate::bsdf::Facets) of a direction; a density below 0 where there are none.
    pub(super) facet_cos: Lane<f32>,
    pub(super) facet_value: Lane<f32>,
    pub(super) facet_pdf: Lane<f32>,
    /// A bit for each lane whose surface is an emitter.
    pub(super) emitters: u64,
    /// A bit for each lane whose material is not Lambert's law.
    pub(super) others: u64,
    /// Whether light is gathered here.
    pub(super) gathers: Lane<Flag>,
    /// Whether a stage has ended the path.
    pub(super) ended: Lane<Flag>,
    // Random numbers.
    pub(super) u: [Lane<f32>; 2],
    pub(super) u_one: Lane<f32>,
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
    // Of spheres and triangles that are to be sampled: which lanes have one, and what it is.
    pub(super) ball: Lane<Flag>,
    pub(super) ball_center: Lane3,
    pub(super) ball_radius: Lane<f32>,
    /// And its bit for rays that [end before it](crate::geometry::Rays); 0 for lanes that have none.
    pub(super) ball_round: Lane<u32>,
    pub(super) shard: Lane<Flag>,
    pub(super) shard_corners: [Lane3; 3],
    pub(super) lamp_two_sided: Lane<Flag>,
    pub(super) lamp_chosen: Lane<f32>,
    /// Of several light samples, what arrived.
    pub(super) sum: Lane3,
    pub(super) shadow_origin: Lane3,
    pub(super) shadow_direction: Lane3,
    pub(super) shadow_t_max: Lane<f32>,
    pub(super) shadow_spared: [Lane<u32>; 2],
    pub(super) shadow_ended: Lane<u32>,
    pub(super) occluded: Lane<Flag>,
    pub(super) few: FewRays,
    pub(super) found: Found,
    /// Of each request, its sample; and its first hit, where that is wanted.
    pub(super) samples: Vec<Sample>,
    pub(super) firsts: Vec<Option<FirstHit>>,
    /// Whether its path was forked; and what came of each way.
    pub(super) splits: Vec<bool>,
    // Of paths that share: whether a path is on the way from its start to its end, or beyond that;
    // of each way of each request, what it shares; of each request, key and index of its rest.
    pub(super) started: Lane<Flag>,
    pub(super) beyond: Lane<Flag>,
    pub(super) shares: Vec<Share>,
    pub(super) members: Vec<(u64, u32)>,
    pub(super) group: Group,
    pub(super) density: Lane<f32>,
    pub(super) branches: Vec<Sample>,
    /// What is aimed at, where that is asked for.
    pub(super) aims: bool,
    pub(super) aim: AimLanes,
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
            made_for: proven,
            plain_points: false,
            n: 0,
            idle: u64::MAX,
            slot: [0; WIDTH],
            way: [0; WIDTH],
            key: [0; WIDTH],
            index: [0; WIDTH],
            alive: [NO; WIDTH],
            depth: [0; WIDTH],
            forked: [NO; WIDTH],
            ways: zero,
            fresh: Fresh {
                x: zero,
                y: zero,
                key: [0; WIDTH],
                index: [0; WIDTH],
                origin: zeros,
                direction: zeros,
                t_max: zero,
            },
            forks: Vec::with_capacity(WIDTH),
            origin: zeros,
            direction: zeros,
            t_max: zero,
            spared: [[0; WIDTH]; 2],
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
            own: [[0; WIDTH]; 2],
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
            alphas: [zero; 2],
            facet_cos: zero,
            facet_value: zero,
            facet_pdf: zero,
            emitters: 0,
            others: 0,
            gathers: [NO; WIDTH],
            ended: [NO; WIDTH],
            u: [zero; 2],
            u_one: zero,
            lit: [NO; WIDTH],
            wi: zeros,
            light: zeros,
            light_error: zeros,
            light_ng: zeros,
            light_radiance: zeros,
            light_pdf: zero,
            infinite: [NO; WIDTH],
            brings: zeros,
            ball: [NO; WIDTH],
            ball_center: zeros,
            ball_radius: zero,
            ball_round: [0; WIDTH],
            shard: [NO; WIDTH],
            shard_corners: [zeros; 3],
            lamp_two_sided: [NO; WIDTH],
            lamp_chosen: zero,
            sum: zeros,
            shadow_origin: zeros,
            shadow_direction: zeros,
            shadow_t_max: zero,
            shadow_spared: [[0; WIDTH]; 2],
            shadow_ended: [0; WIDTH],
            occluded: [NO; WIDTH],
            few: FewRays::new(proven),
            found: Found::NOTHING,
            samples: Vec::new(),
            firsts: Vec::new(),
            splits: Vec::new(),
            started: [NO; WIDTH],
            beyond: [NO; WIDTH],
            shares: Vec::new(),
            members: Vec::new(),
            group: Group::EMPTY,
            density: zero,
            branches: Vec::new(),
            aims: false,
            aim: AimLanes::NONE,
        }))
    }

    /// Of the requests just served, what came of number `i`.
    #[inline]
    #[must_use]
    pub fn traced(&self, i: usize) -> Traced {
        Traced { sample: self.samples[i], first: self.firsts.get(i).copied().flatten() }
    }

    /// The ways in which number `i` of the requests just served went on; its sample holds their mean.
    #[must_use]
    pub fn ways(&self, i: usize) -> &[Sample] {
        if !self.splits.get(i).is_some_and(|splits| *splits) {
            return &[];
        }
        let n = self.branches.len() / self.samples.len();
        &self.branches[i * n..(i + 1) * n]
    }

    /// Make room for what comes of `requests` paths, which are forked `splits` ways.
    pub(super) fn begin(&mut self, requests: usize, splits: u32, reuse: bool, features: bool) {
        let nothing = Sample { radiance: Rgb::ZERO, known: false };
        self.samples.clear();
        self.samples.resize(requests, nothing);
        let ways = if splits > 1 { splits as usize } else { 0 };
        self.splits.clear();
        self.splits.resize(if ways > 0 { requests } else { 0 }, false);
        self.branches.resize(requests * ways, nothing);
        self.forks.clear();
        self.shares.clear();
        self.shares.resize(if reuse { requests * ways.max(1) } else { 0 }, Share::NOTHING);
        (self.started, self.beyond) = ([NO; WIDTH], [NO; WIDTH]);
        self.firsts.clear();
        self.firsts.resize(if features { requests } else { 0 }, None);
        self.n = requests.saturating_mul(splits as usize).min(WIDTH);
        // Stages look at as many lanes as there are paths: what the wave before left in the others must not be seen.
        (self.alive, self.ended, self.gathers, self.lit) = ([NO; WIDTH], [NO; WIDTH], [NO; WIDTH], [NO; WIDTH]);
        self.ball_round = [0; WIDTH];
        self.idle = if self.n == WIDTH { u64::MAX } else { (1 << self.n) - 1 };
    }

    /// Use the instructions that it was made for, but for those that are left out.
    pub(super) fn run_without(&mut self, without: Without) {
        let fewer = match (without.leaves(Special::Avx512), without.leaves(Special::Avx2), self.made_for.compiled()) {
            (_, true, _) => Proven::new(Compiled::Baseline),
            (true, false, Compiled::Avx512) => Proven::new(Compiled::Avx2),
            _ => None,
        };
        self.proven = fewer.unwrap_or(self.made_for);
        self.few.run_with(self.proven);
    }

    /// A bit for each lane that has a path.
    #[inline(always)]
    pub(super) fn active(&self) -> u64 {
        mask_of(&self.alive)
    }

    #[inline(always)]
    pub(super) fn stream(&self, samplers: &Samplers, i: usize) -> Stream {
        let sampler = if self.forked[i] == YES { samplers.forked } else { samplers.whole };
        sampler.resume(self.key[i], self.index[i])
    }

    /// The path of lane `i` is done.
    #[inline(always)]
    pub(super) fn end(&mut self, i: usize, known: bool) {
        self.alive[i] = NO;
        self.idle |= 1 << i;
        let sample = Sample { radiance: self.close(i), known };
        if self.forked[i] == YES && !self.branches.is_empty() {
            self.branches[self.way[i] as usize] = sample;
        } else {
            self.samples[self.slot[i] as usize] = sample;
        }
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
    /// Where rays from well within the triangle that lane `i` hit may spare themselves others.
    #[inline(always)]
    pub(super) fn set_own(&mut self, i: usize, spared: Spared) {
        const WITHIN: f32 = 1.0 / 64.0;
        let (b1, b2) = (self.b1[i], self.b2[i]);
        let within = (b1 > WITHIN) & (b2 > WITHIN) & (b1 + b2 < 1.0 - WITHIN);
        let mask = u32::from(within).wrapping_neg();
        (self.own[0][i], self.own[1][i]) = (spared[0] & mask, spared[1] & mask);
    }

    /// What is known of the surface that lane `i` hit.
    #[inline(always)]
    pub(super) fn set_surface(&mut self, i: usize, record: &Record) {
        self.material[i] = record.material;
        self.emitter[i] = record.emitter;
        self.surface[i] = record.surface;
        self.emitters |= u64::from(record.emitter != NO_EMITTER) << i;
        self.others |= u64::from(record.diffuse.is_none()) << i;
        // The stages of rough metal know nothing of aims.
        let facets = record.facets.filter(|_| !self.aims);
        self.scatters[i] = match (record.diffuse, facets, record.delta) {
            (Some(_), ..) => Scatters::Diffuse,
            (None, Some(_), _) => Scatters::Facets,
            (None, None, true) => Scatters::Delta,
            (None, None, false) => Scatters::Other,
        };
        if let Some(facets) = record.facets {
            [self.alphas[0][i], self.alphas[1][i]] = facets.alphas();
        }
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

    #[inline(always)]
    pub(super) fn set_ball(&mut self, i: usize, ball: &Ball, round: u32) {
        self.ball[i] = YES;
        self.ball_round[i] = round;
        self.ball_center.set(i, ball.center);
        self.ball_radius[i] = ball.radius;
        self.lamp_two_sided[i] = Flag::from(ball.two_sided);
        self.lamp_chosen[i] = ball.chosen;
        self.light_radiance.set(i, ball.radiance);
    }

    #[inline(always)]
    pub(super) fn set_shard(&mut self, i: usize, shard: &Shard) {
        self.shard[i] = YES;
        (0..3).for_each(|k| self.shard_corners[k].set(i, shard.p[k]));
        self.lamp_two_sided[i] = Flag::from(shard.two_sided);
        self.lamp_chosen[i] = shard.chosen;
        self.light_radiance.set(i, shard.radiance);
    }

    /// Whether any path is on rough metal that stages know.
    #[inline(always)]
    pub(super) fn any_facets(&self) -> bool {
        self.others != 0 && lanes_of(self.others & self.active()).any(|i| self.scatters[i] == Scatters::Facets)
    }

    /// A number for each path, into `u_one`: that of decision `which` at its vertex.
    pub(super) fn draw_one(&mut self, samplers: &Samplers, which: u32) {
        if self.plain_points {
            stages::draw_one(self.proven, self, which, samplers.batches);
        } else {
            for i in lanes_of(self.active()) {
                self.u_one[i] = self.stream(samplers, i).one(dimension::at(self.depth[i], which));
            }
        }
    }

    /// A pair of numbers for each path, into `u`: those of decision `which` at its vertex.
    pub(super) fn draw_two(&mut self, samplers: &Samplers, which: u32) {
        if self.plain_points {
            stages::draw_two(self.proven, self, which, samplers.batches);
        } else {
            for i in lanes_of(self.active()) {
                let u = self.stream(samplers, i).two(dimension::at(self.depth[i], which));
                (self.u[0][i], self.u[1][i]) = (u.x, u.y);
            }
        }
    }
}
