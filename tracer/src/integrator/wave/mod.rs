//! Many paths at once, a stage at a time: all rays are traced, then all hits shaded, then all lights
//! sampled, and so on, vertex by vertex.
//!
//! What [`super::Integrator::path`] does for one path is done here for [`WIDTH`] of them, with the same
//! operations in the same order, so every sample has the same bits. Stages that are the same for all
//! materials, and those of Lambert's law and of a lone rectangular lamp, are loops that compile to vector
//! code; other materials and lights take part one path at a time. It serves scenes without attributes
//! and opacity masks; there is no probe.

mod stages;
mod state;
#[cfg(test)]
mod tests;

pub use crate::lanes::{Compiled, WIDTH};
pub use state::Wave;

use crate::lanes::{Flag, Lane, NO, YES};
use state::{Came, Scatters};

use super::{Integrator, Kernel, Sample, Strategy, dimension, power_heuristic};
use crate::{
    geometry::{Counters, Hit, Ray, Rays, SurfacePoint, spawn},
    light::{Reference, Stratum},
    material::Material,
    math::{Rgb, Vec2, Vec3},
    sampler::Sampler,
    scene::{NO_EMITTER, Point},
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

impl Traced {
    const NOTHING: Self = Self { sample: Sample { radiance: Rgb::ZERO, known: false }, first: None };
}

impl Integrator<'_> {
    /// Whether [`Integrator::wave`] renders this scene and method.
    #[must_use]
    pub fn has_wave(&self) -> bool {
        self.kernel == Kernel::Plain
            && self.direct != Strategy::Hemisphere
            && self.light_samples == 1
            && self.scene.lights().has_one_sample()
    }

    /// Samples `requests`, each (column, row, sample), at most [`WIDTH`] of them: the same as
    /// [`Integrator::sample`] for each. Asks for [`Integrator::has_wave`].
    pub fn wave(&self, wave: &mut Wave, sampler: &Sampler, requests: &[[u32; 3]], counters: &mut Counters) {
        let requests = &requests[..requests.len().min(WIDTH)];
        self.wave_camera(wave, sampler, requests);
        let mut depth = 0;
        loop {
            let others = self.wave_trace(wave, depth, counters);
            if wave.n == 0 {
                return;
            }
            self.wave_surface(wave, others);
            self.wave_found(wave, depth);
            if depth == 0 {
                self.wave_features(wave);
            }
            if depth >= self.max_depth {
                (0..wave.n).for_each(|i| wave.end(i, depth == 0));
                return;
            }
            if self.counts(depth + 1) && !self.scene.lights().is_dark() {
                self.wave_direct(wave, sampler, depth, counters);
            }
            if !self.wave_scatter(wave, sampler, depth) {
                return;
            }
            depth += 1;
        }
    }

    fn wave_camera(&self, wave: &mut Wave, sampler: &Sampler, requests: &[[u32; 3]]) {
        let camera = self.scene.camera();
        wave.n = requests.len();
        for (i, &[x, y, sample]) in requests.iter().enumerate() {
            wave.slot[i] = i as u32;
            (wave.key[i], wave.index[i]) = sampler.stream(x, y, sample).parts();
            wave.alive[i] = YES;
            wave.radiance.set(i, Rgb::ZERO);
            wave.throughput.set(i, Rgb::ONE);
            wave.eta2[i] = 1.0;
            wave.came[i] = Came::Only;
            wave.traced[i] = Traced::NOTHING;
        }
        wave.draw_two(sampler, dimension::FILM);
        for (i, &[x, y, _]) in requests.iter().enumerate() {
            let u_lens = if camera.has_lens() { wave.stream(sampler, i).two(dimension::LENS) } else { Vec2::ZERO };
            let ray = camera.ray(x, y, Vec2::new(wave.u[0][i], wave.u[1][i]), u_lens);
            wave.origin.set(i, ray.origin);
            wave.direction.set(i, ray.direction);
            wave.t_max[i] = ray.t_max;
        }
    }

    /// Trace the rays of those alive, which move to the first lanes; those that leave the scene end. Points
    /// on anything but triangles are returned, by lane.
    fn wave_trace(&self, wave: &mut Wave, depth: u32, counters: &mut Counters) -> Others {
        let mut others = Others { n: 0, lanes: [0; WIDTH], points: [Others::NOWHERE; WIDTH] };
        let accel = self.scene.accel();
        let rays = Rays {
            n: wave.n,
            active: &wave.alive,
            origin: &wave.origin,
            direction: &wave.direction,
            t_max: &wave.t_max,
        };
        let small = accel.closest_of(&mut wave.few, &rays, &mut wave.found, counters);
        let mut kept = 0;
        for i in 0..wave.n {
            if wave.alive[i] == NO {
                continue;
            }
            let ray = wave.ray(i);
            let hit = if small { accel.found(&wave.found, i) } else { accel.closest(&ray, counters) };
            let Some(hit) = hit else {
                if self.counts(depth) && self.scene.facts().environment {
                    let wi = ray.direction.normalize();
                    let lights = self.scene.lights();
                    let weight = self.weight(&wave.arrival(i), |from| lights.environment_pdf(from, wi));
                    let light = wave.throughput.at(i) * (lights.environment(wi) * weight);
                    wave.radiance.set(i, wave.radiance.at(i) + light);
                }
                wave.end(i, depth == 0);
                continue;
            };
            wave.shift(i, kept);
            self.wave_hit(wave, kept, &ray, &hit, &mut others);
            kept += 1;
        }
        wave.alive[..kept].fill(YES);
        wave.alive[kept..].fill(NO);
        wave.n = kept;
        others
    }

    #[inline(always)]
    fn wave_hit(&self, wave: &mut Wave, i: usize, ray: &Ray, hit: &Hit, others: &mut Others) {
        (wave.material[i], wave.emitter[i]) = self.scene.surface_of(hit);
        wave.surface[i] = hit.shape;
        match self.scene.accel().world_triangle(hit) {
            Some(corners) => {
                (0..3).for_each(|k| wave.corners[k].set(i, corners[k]));
                (wave.b1[i], wave.b2[i]) = (hit.b1, hit.b2);
            }
            None => {
                others.lanes[others.n] = i as u32;
                others.points[others.n] = self.scene.accel().surface(ray, hit);
                others.n += 1;
            }
        }
        let flat = self.scene.flat(wave.material[i]);
        wave.scatters[i] = match (flat.diffuse, flat.delta) {
            (Some(_), _) => Scatters::Diffuse,
            (None, true) => Scatters::Delta,
            (None, false) => Scatters::Other,
        };
        wave.reflectance.set(i, flat.diffuse.unwrap_or(Rgb::ZERO));
        wave.two_sided[i] = Flag::from(flat.two_sided);
        wave.transmissive[i] = Flag::from(flat.transmissive);
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
    fn wave_found(&self, wave: &mut Wave, depth: u32) {
        if !self.counts(depth) {
            return;
        }
        for i in 0..wave.n {
            if wave.emitter[i] != NO_EMITTER {
                let found = self.found(&self.wave_point(wave, i), &wave.ray(i), &wave.arrival(i));
                wave.radiance.set(i, wave.radiance.at(i) + wave.throughput.at(i) * found);
            }
        }
    }

    fn wave_features(&self, wave: &mut Wave) {
        for i in 0..wave.n {
            let albedo = match wave.scatters[i] {
                Scatters::Diffuse => wave.reflectance.at(i),
                _ => self.wave_material(wave, i).bsdf(Vec2::ZERO).albedo(),
            };
            let camera_depth = self.scene.camera().depth(wave.p.at(i));
            wave.traced[wave.slot[i] as usize].first = Some(FirstHit { albedo, ns: wave.ng.at(i), camera_depth });
        }
    }

    /// Direct light: one sample of one light for each path.
    fn wave_direct(&self, wave: &mut Wave, sampler: &Sampler, depth: u32, counters: &mut Counters) {
        wave.draw_two(sampler, dimension::at(depth, dimension::LIGHT));
        let lights = self.scene.lights();
        let (mut diffuse_only, first) = (true, wave.n);
        for i in 0..first {
            diffuse_only &= wave.scatters[i] == Scatters::Diffuse;
        }
        if let Some(lamp) = lights.lone_rectangle() {
            stages::rectangle_light(wave.proven, wave, &lamp);
            for i in 0..wave.n {
                // The solid angle could not be told: by area, as one path would.
                if wave.infinite[i] == YES {
                    self.wave_one_light_sample(wave, sampler, depth, i);
                }
            }
        } else {
            for i in 0..wave.n {
                if wave.scatters[i] != Scatters::Delta {
                    self.wave_one_light_sample(wave, sampler, depth, i);
                }
            }
        }
        stages::direct_diffuse(wave.proven, wave, self.direct == Strategy::Mis);
        if !diffuse_only {
            for i in 0..wave.n {
                match wave.scatters[i] {
                    Scatters::Diffuse => {}
                    Scatters::Delta => wave.lit[i] = NO,
                    Scatters::Other => self.wave_direct_other(wave, i),
                }
            }
        }
        stages::shadow_rays(wave.proven, wave);
        for i in 0..wave.n {
            if wave.lit[i] == YES && wave.infinite[i] == YES {
                let ray = spawn(wave.p.at(i), wave.p_error.at(i), wave.ng.at(i), wave.wi.at(i));
                wave.shadow_origin.set(i, ray.origin);
                wave.shadow_direction.set(i, ray.direction);
                wave.shadow_t_max[i] = ray.t_max;
            }
        }
        let rays = Rays {
            n: wave.n,
            active: &wave.lit,
            origin: &wave.shadow_origin,
            direction: &wave.shadow_direction,
            t_max: &wave.shadow_t_max,
        };
        let accel = self.scene.accel();
        if !accel.occluded_of(&mut wave.few, &rays, &mut wave.occluded, counters) {
            for i in (0..rays.n).filter(|&i| rays.active[i] == YES) {
                wave.occluded[i] = Flag::from(accel.occluded(&rays.at(i), counters));
            }
        }
        for i in 0..wave.n {
            if wave.lit[i] == YES && wave.occluded[i] == NO {
                wave.radiance.set(i, wave.radiance.at(i) + wave.throughput.at(i) * wave.brings.at(i));
            }
        }
    }

    /// A light sample by the code for one path.
    fn wave_one_light_sample(&self, wave: &mut Wave, sampler: &Sampler, depth: u32, i: usize) {
        let choice =
            if self.choice { wave.stream(sampler, i).one(dimension::at(depth, dimension::LIGHT_CHOICE)) } else { 0.5 };
        let u = Vec2::new(wave.u[0][i], wave.u[1][i]);
        let reference = Reference { p: wave.p.at(i), n: wave.n_reflecting.at(i) };
        wave.lit[i] = NO;
        self.scene.lights().for_each(&reference, Stratum::ONLY, || (choice, u), |light| wave.set_light(i, &light));
    }

    /// What a light sample brings by way of a material that the stages do not know.
    fn wave_direct_other(&self, wave: &mut Wave, i: usize) {
        if wave.lit[i] == NO {
            return;
        }
        wave.lit[i] = NO;
        let (light_wi, wo) = (wave.wi.at(i), wave.wo.at(i));
        let wi = wave.frame(i).to_local(light_wi);
        let transmission = (wi.z > 0.0) != (wo.z > 0.0);
        let passes = (light_wi.dot(wave.ng.at(i)) > 0.0) != (wave.front[i] == YES);
        if transmission != passes {
            return;
        }
        let bsdf = self.wave_material(wave, i).bsdf(Vec2::ZERO);
        if bsdf.is_delta() {
            return;
        }
        let eval = bsdf.evaluate(wo, wi);
        if eval.f_cos == Rgb::ZERO {
            return;
        }
        let delta = wave.light_pdf[i] < 0.0;
        let pdf = wave.light_pdf[i].abs();
        let weight = if self.direct == Strategy::Mis && !delta { power_heuristic(pdf, eval.pdf) } else { 1.0 };
        let brings = eval.f_cos * wave.light_radiance.at(i) * (weight / pdf);
        wave.lit[i] = Flag::from(brings != Rgb::ZERO);
        wave.brings.set(i, brings);
    }

    /// Go on along sampled directions. Whether any path does.
    fn wave_scatter(&self, wave: &mut Wave, sampler: &Sampler, depth: u32) -> bool {
        let next = depth + 1;
        let delta_only = next == self.max_depth && self.direct != Strategy::Mis;
        if delta_only && !self.scene.facts().delta {
            (0..wave.n).for_each(|i| wave.end(i, false));
            return false;
        }
        wave.draw_two(sampler, dimension::at(depth, dimension::DIRECTION));
        stages::scatter_diffuse(wave.proven, wave);
        for i in 0..wave.n {
            if wave.scatters[i] != Scatters::Diffuse {
                self.wave_scatter_other(wave, sampler, depth, i);
            } else if wave.alive[i] == NO {
                let wo_z = wave.wo.at(i).z;
                let scatters = wo_z > 0.0 || wo_z < 0.0 && wave.two_sided[i] == YES;
                wave.end(i, !scatters && depth == 0 && wave.reflectance.at(i) == Rgb::ZERO);
            } else if delta_only && wave.throughput.at(i) != Rgb::ZERO {
                wave.end(i, false);
            }
            if wave.alive[i] == YES && wave.throughput.at(i) == Rgb::ZERO {
                let known = depth == 0 && self.wave_material(wave, i).bsdf(Vec2::ZERO).albedo() == Rgb::ZERO;
                wave.end(i, known);
            }
        }
        self.wave_roulette(wave, sampler, depth);
        let counted = self.direct != Strategy::Mis;
        for i in 0..wave.n {
            if wave.came[i] == Came::Sampled && counted {
                wave.came[i] = Came::Counted;
            }
        }
        stages::spawn_rays(wave.proven, wave);
        (0..wave.n).any(|i| wave.alive[i] == YES)
    }

    /// A direction of a material that the stages do not know.
    fn wave_scatter_other(&self, wave: &mut Wave, sampler: &Sampler, depth: u32, i: usize) {
        let bsdf = self.wave_material(wave, i).bsdf(Vec2::ZERO);
        let u_lobe = wave.stream(sampler, i).one(dimension::at(depth, dimension::LOBE));
        let u = Vec2::new(wave.u[0][i], wave.u[1][i]);
        let Some(sample) = bsdf.sample(wave.wo.at(i), u_lobe, u) else {
            return wave.end(i, depth == 0 && bsdf.albedo() == Rgb::ZERO);
        };
        let wi = wave.frame(i).to_world(sample.wi);
        let leaves_front = (wi.dot(wave.ng.at(i)) > 0.0) != sample.transmission;
        if leaves_front != (wave.front[i] == YES) {
            return wave.end(i, false);
        }
        wave.wi.set(i, wi);
        let throughput = wave.throughput.at(i) * sample.weight;
        wave.throughput.set(i, throughput);
        wave.eta2[i] *= sample.eta * sample.eta;
        wave.alive[i] = YES;
        let last = depth + 1 == self.max_depth && self.direct != Strategy::Mis;
        if last && !sample.delta && throughput != Rgb::ZERO {
            return wave.end(i, false);
        }
        wave.came[i] = if sample.delta { Came::Only } else { Came::Sampled };
        wave.pdf[i] = sample.pdf;
    }

    fn wave_roulette(&self, wave: &mut Wave, sampler: &Sampler, depth: u32) {
        for i in 0..wave.n {
            let throughput = wave.throughput.at(i);
            if wave.alive[i] == NO {
                continue;
            }
            if let Some(q) = super::survival(self.roulette, depth + 1, throughput * wave.eta2[i]) {
                if wave.stream(sampler, i).one(dimension::at(depth, dimension::ROULETTE)) >= q {
                    wave.end(i, false);
                } else {
                    wave.throughput.set(i, throughput / q);
                }
            }
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
    const NOWHERE: SurfacePoint = SurfacePoint { p: Vec3::ZERO, p_error: Vec3::ZERO, ng: Vec3::ZERO };
}
