//! Many paths at once, a stage at a time: all rays are traced, then all hits shaded, then all lights
//! sampled, and so on, vertex by vertex. A lane whose path has ended takes up the next request, so that nearly all
//! lanes have work until requests run out.
//!
//! What [`super::Integrator::path`] does for one path is done here for [`WIDTH`] of them, with the same
//! operations in the same order, so every sample has the same bits. Stages that are the same for all
//! materials, and those of Lambert's law and of a lone rectangular lamp, are loops that compile to vector
//! code; other materials and lights take part one path at a time. It serves scenes without attributes
//! and opacity masks; there is no probe.

mod aims;
mod direct;
mod forks;
mod reuse;
mod scatter;
mod stages;
mod state;
#[cfg(test)]
mod tests;

pub use crate::lanes::{Compiled, WIDTH};
pub use state::Wave;

use state::{Came, Scatters};

use super::{Integrator, Sample, Strategy, dimension, reuse::MEMBERS, roulette::weight_window};
use crate::{
    geometry::{Counters, NO_ROUND, Rays, SurfacePoint},
    lanes::{Lane, NO, YES, lanes_of},
    material::Material,
    math::{Rgb, Vec2, Vec3},
    sampler::{Batches, Sampler},
    scene::Point,
    special::Special,
};

/// A sample, with the features of its first hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Traced {
    /// What it found.
    pub sample: Sample,
    /// The first hit; `None` where there was none.
    pub first: Option<FirstHit>,
}

/// What is told of a first hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstHit {
    /// Colour of the surface.
    pub albedo: Rgb,
    /// Unit shading normal.
    pub ns: Vec3,
    /// Depth along the camera's axis.
    pub camera_depth: f32,
}

/// Where numbers come from.
struct Samplers<'a> {
    /// Of whole paths, and of forked ones.
    whole: &'a Sampler,
    forked: &'a Sampler,
    batches: Batches,
}

/// As many requests at once keep nearly all lanes busy to the end, and what comes of them in the nearest cache.
pub const REQUESTS: usize = 2048;

impl Integrator<'_> {
    /// Whether [`Integrator::wave`] renders this scene and method.
    #[must_use]
    pub fn has_wave(&self) -> bool {
        self.plain && self.direct != Strategy::Hemisphere && !self.without.leaves(Special::Waves)
    }

    /// The code that fits the scene, in words: what was left out is what these do not name.
    #[must_use]
    pub fn kernel_in_words(&self) -> Vec<String> {
        let mut words =
            vec![if self.has_wave() { format!("{WIDTH} paths at a time") } else { "one path at a time".into() }];
        if !self.plain {
            words.push("with attributes of surfaces".into());
        }
        if self.has_wave() && self.scene.accel().is_small() {
            words.push("few primitives, no tree".into());
        }
        if self.has_wave() && self.lamp.is_some() {
            words.push("one rectangular lamp".into());
        }
        words
    }

    /// The specialisations that this scene and method use, with what else must be left out to see what each saves: some
    /// serve only where others are not used.
    #[must_use]
    pub fn specialised(&self, sampler: &Sampler) -> Vec<(Special, Vec<Special>)> {
        let (facts, waves) = (self.scene.facts(), self.has_wave());
        let points = waves && sampler.is_plain();
        let few = waves && self.scene.accel().is_small();
        let pinhole = self.scene.camera().is_plain();
        let balls = self.direct.samples_lights() && self.scene.lights().has_balls();
        let shards = self.direct.samples_lights() && self.scene.lights().has_shards();
        let lambert = waves && self.scene.has_lambert();
        let ends_early = !facts.delta && self.direct == Strategy::Light;
        let compiled = Compiled::detect();
        let alone = |special| (special, Vec::new());
        let all = [
            (waves, alone(Special::Waves)),
            (!facts.opacity, (Special::Opacity, if waves { vec![Special::Waves] } else { Vec::new() })),
            (few, alone(Special::Few)),
            (few, alone(Special::Quads)),
            (few, alone(Special::Planes)),
            (waves && self.lamp.is_some(), alone(Special::Lamp)),
            (lambert, alone(Special::Lambert)),
            (waves && self.scene.has_facets(), alone(Special::Facets)),
            (waves && balls, alone(Special::Balls)),
            (waves && shards, alone(Special::Shards)),
            (pinhole, alone(Special::Pinhole)),
            (points, alone(Special::Points)),
            (points && weight_window(self.roulette).is_some(), alone(Special::Roulette)),
            (ends_early, alone(Special::NoDeltas)),
            (compiled == Compiled::Avx512, alone(Special::Avx512)),
            (compiled != Compiled::Baseline, (Special::Avx2, vec![Special::Avx512])),
        ];
        all.into_iter().filter(|(used, _)| *used).map(|(_, special)| special).collect()
    }

    /// Samples `requests`, each (column, row, sample): the same as [`Integrator::sample`] for each, found by
    /// [`Wave::traced`]. Where paths share, `groups` tells up to which request each group reaches, as [`Integrator::together`]
    /// would render them. With `features`, so are first hits. Asks for [`Integrator::has_wave`].
    pub fn wave(
        &self,
        wave: &mut Wave,
        sampler: &Sampler,
        requests: &[[u32; 3]],
        groups: &[u32],
        features: bool,
        counters: &mut Counters,
    ) {
        wave.begin(requests.len(), self.splits, self.reuse, features);
        let ways = if self.reuse { self.splits * MEMBERS as u32 } else { self.splits };
        let forked = sampler.forked(ways);
        let samplers = Samplers { whole: sampler, forked: &forked, batches: Batches::new(sampler, ways) };
        wave.set_members(sampler, requests, if self.reuse { groups } else { &[] });
        wave.plain_points = sampler.is_plain() && !self.without.leaves(Special::Points);
        wave.run_without(self.without);
        wave.aims = self.aims.is_some();
        let mut next = 0;
        loop {
            if wave.forks.is_empty() {
                next = self.wave_camera(wave, &samplers, requests, next);
                if wave.active() == 0 {
                    wave.join(self.splits);
                    if self.reuse {
                        self.wave_join_all(wave, groups, counters);
                    }
                    return;
                }
            }
            let others = self.wave_trace(wave, counters);
            self.wave_surface(wave, others);
            self.wave_found(wave);
            if features {
                self.wave_features(wave);
            }
            for i in lanes_of(wave.active()) {
                if wave.depth[i] >= self.max_depth {
                    wave.end(i, wave.depth[i] == 0);
                }
            }
            if self.reuse {
                self.wave_arrive(wave);
            }
            counters.vertices += u64::from(wave.active().count_ones());
            self.wave_aim(wave, wave.active());
            if self.direct.samples_lights() && !self.scene.lights().is_dark() {
                self.wave_direct(wave, &samplers, counters);
            }
            if self.splits > 1 {
                let placed = wave.fork(self.splits);
                self.wave_aim(wave, placed);
            }
            if self.reuse {
                self.wave_start(wave);
            }
            self.wave_scatter(wave, &samplers);
        }
    }

    /// Give idle lanes to the requests from `next` on. The first request that found none.
    fn wave_camera(&self, wave: &mut Wave, samplers: &Samplers, requests: &[[u32; 3]], next: usize) -> usize {
        let n = (wave.idle.count_ones() as usize).min(requests.len() - next);
        if n == 0 {
            return next;
        }
        let (requests, sampler) = (&requests[next..next + n], samplers.whole);
        // Samples of a set share a key.
        let mut before: Option<([u32; 3], u64, u32)> = None;
        for (i, &[x, y, sample]) in requests.iter().enumerate() {
            let follows = |&([px, py, previous], _, index): &([u32; 3], u64, u32)| {
                [px, py, previous + 1] == [x, y, sample] && index + 1 < sampler.set()
            };
            let (key, index) = match before.filter(follows) {
                Some((_, key, index)) => (key, index + 1),
                None => sampler.stream(x, y, sample).parts(),
            };
            before = Some(([x, y, sample], key, index));
            let fresh = &mut wave.fresh;
            (fresh.x[i], fresh.y[i], fresh.key[i], fresh.index[i]) = (x as f32, y as f32, key, index);
        }
        let camera = self.scene.camera();
        if camera.is_plain() && wave.plain_points && !self.without.leaves(Special::Pinhole) {
            stages::camera_rays(wave.proven, &mut wave.fresh, n, camera, samplers.batches);
        } else {
            for (i, &[x, y, _]) in requests.iter().enumerate() {
                let stream = sampler.resume(wave.fresh.key[i], wave.fresh.index[i]);
                let lens = camera.has_lens() || self.without.leaves(Special::Pinhole);
                let u_lens = if lens { stream.two(dimension::LENS) } else { Vec2::ZERO };
                let ray = camera.ray(x, y, stream.two(dimension::FILM), u_lens);
                wave.fresh.origin.set(i, ray.origin);
                wave.fresh.direction.set(i, ray.direction);
                wave.fresh.t_max[i] = ray.t_max;
            }
        }
        for (from, i) in lanes_of(wave.idle).take(n).enumerate() {
            wave.idle &= !(1 << i);
            wave.alive[i] = YES;
            wave.slot[i] = (next + from) as u32;
            (wave.key[i], wave.index[i]) = (wave.fresh.key[from], wave.fresh.index[from]);
            wave.origin.set(i, wave.fresh.origin.at(from));
            wave.direction.set(i, wave.fresh.direction.at(from));
            wave.t_max[i] = wave.fresh.t_max[from];
            wave.radiance.set(i, Rgb::ZERO);
            wave.throughput.set(i, Rgb::ONE);
            (wave.spared[0][i], wave.spared[1][i]) = (0, 0);
            wave.eta2[i] = 1.0;
            (wave.forked[i], wave.ways[i]) = (NO, self.splits as f32);
            wave.came[i] = Came::Only;
            wave.depth[i] = 0;
        }
        next + n
    }

    /// Trace the rays of all paths; those that leave the scene end. Points on anything but triangles are
    /// returned, by lane.
    fn wave_trace(&self, wave: &mut Wave, counters: &mut Counters) -> Others {
        let mut others = Others { n: 0, lanes: [0; WIDTH], points: [Others::NOWHERE; WIDTH] };
        let accel = self.scene.accel();
        let rays = Rays {
            n: wave.n,
            active: &wave.alive,
            origin: &wave.origin,
            direction: &wave.direction,
            t_max: &wave.t_max,
            spared: &wave.spared,
            ended: NO_ROUND,
        };
        let planes = !self.without.leaves(Special::Planes);
        let small = accel.closest_of(&mut wave.few, &rays, &mut wave.found, counters);
        (wave.emitters, wave.others) = (0, 0);
        for i in lanes_of(wave.active()) {
            if small {
                let Some(primitive) = wave.found.primitive(i) else {
                    self.wave_miss(wave, i);
                    continue;
                };
                let record = self.scene.record(primitive);
                match &record.corners {
                    Some(corners) => {
                        (0..3).for_each(|k| wave.corners[k].set(i, corners[k]));
                        (wave.b1[i], wave.b2[i]) = (wave.found.b1[i], wave.found.b2[i]);
                        wave.set_own(i, if planes { accel.spared(primitive) } else { [0; 2] });
                    }
                    None => {
                        wave.set_own(i, [0; 2]);
                        if let Some(hit) = accel.found(&wave.found, i) {
                            others.add(i, accel.surface(&wave.ray(i), &hit));
                        }
                    }
                }
                wave.set_surface(i, record);
            } else {
                let ray = wave.ray(i);
                let Some(hit) = accel.closest(&ray, counters) else {
                    self.wave_miss(wave, i);
                    continue;
                };
                let corners = accel.world_triangle(&hit);
                match &corners {
                    Some(corners) => {
                        (0..3).for_each(|k| wave.corners[k].set(i, corners[k]));
                        (wave.b1[i], wave.b2[i]) = (hit.b1, hit.b2);
                    }
                    None => others.add(i, accel.surface(&ray, &hit)),
                }
                wave.set_surface(i, &self.scene.record_of(&hit, corners));
            }
        }
        others
    }

    /// The ray of lane `i` left the scene.
    fn wave_miss(&self, wave: &mut Wave, i: usize) {
        if self.counts(wave.depth[i]) && self.scene.facts().environment {
            let wi = wave.direction.at(i).normalize();
            let lights = self.scene.lights();
            let weight = self.weight(&wave.arrival(i), |from| lights.environment_pdf(from, wi));
            let light = wave.throughput.at(i) * (lights.environment(wi) * weight);
            wave.radiance.set(i, wave.radiance.at(i) + light);
        }
        wave.end(i, wave.depth[i] == 0);
    }

    fn wave_surface(&self, wave: &mut Wave, others: Others) {
        stages::triangle_points(wave.proven, wave);
        for (&lane, point) in others.lanes.iter().zip(&others.points).take(others.n) {
            let i = lane as usize;
            wave.p.set(i, point.p);
            wave.p_error.set(i, point.p_error);
            wave.ng.set(i, point.ng);
        }
        stages::frames(wave.proven, wave);
    }

    /// Emission at the hits.
    fn wave_found(&self, wave: &mut Wave) {
        for i in lanes_of(wave.emitters) {
            if self.counts(wave.depth[i]) {
                let found = self.found(&self.wave_point(wave, i), &wave.ray(i), &wave.arrival(i));
                wave.radiance.set(i, wave.radiance.at(i) + wave.throughput.at(i) * found);
            }
        }
    }

    fn wave_features(&self, wave: &mut Wave) {
        for i in lanes_of(wave.active()) {
            if wave.depth[i] > 0 {
                continue;
            }
            let albedo = match wave.scatters[i] {
                Scatters::Diffuse => wave.reflectance.at(i),
                _ => self.wave_material(wave, i).bsdf(Vec2::ZERO).albedo(),
            };
            let camera_depth = self.scene.camera().depth(wave.p.at(i));
            wave.firsts[wave.slot[i] as usize] = Some(FirstHit { albedo, ns: wave.ng.at(i), camera_depth });
        }
    }

    fn wave_material(&self, wave: &Wave, i: usize) -> &Material {
        self.scene.material_at(wave.material[i])
    }

    /// The lane's surface point as the code for one path wants it.
    fn wave_point(&self, wave: &Wave, i: usize) -> Point {
        Point::plain(
            wave.p.at(i),
            wave.p_error.at(i),
            wave.ng.at(i),
            wave.material[i],
            wave.emitter[i],
            wave.surface[i],
        )
    }
}

/// Hits on spheres and disks.
struct Others {
    n: usize,
    lanes: Lane<u32>,
    points: [SurfacePoint; WIDTH],
}

impl Others {
    #[inline(always)]
    fn add(&mut self, lane: usize, point: SurfacePoint) {
        self.lanes[self.n % WIDTH] = lane as u32;
        self.points[self.n % WIDTH] = point;
        self.n += 1;
    }

    const NOWHERE: SurfacePoint = SurfacePoint { p: Vec3::ZERO, p_error: Vec3::ZERO, ng: Vec3::ZERO };
}
