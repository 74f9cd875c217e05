//! Direct light of a wave: light samples, what they bring, and whether something is in between.

use super::{Samplers, Scatters, Wave, stages};
use crate::{
    bsdf::Eval,
    geometry::{Counters, Rays, spawn},
    integrator::{Integrator, Strategy, dimension, power_heuristic},
    lanes::{Flag, Lane, Lane3, NO, WIDTH, YES, lanes_of, mask_of},
    light::{AtOnce, Drawn, Reference},
    math::{Rgb, Vec2, Vec3},
    special::Special,
};

impl Integrator<'_> {
    /// Direct light: one sample of one light for each path, or as many as are asked for, a round each.
    pub(super) fn wave_direct(&self, wave: &mut Wave, samplers: &Samplers, counters: &mut Counters) {
        stages::gather(wave.proven, wave, self.counted.0, self.counted.1);
        let gathers = mask_of(&wave.gathers);
        if gathers == 0 {
            return;
        }
        let rounds = self.light_samples * self.scene.lights().samples_at_once();
        let deltas = lanes_of(gathers & wave.others).filter(|&i| wave.scatters[i] == Scatters::Delta).count();
        counters.light_samples += u64::from(rounds) * (u64::from(gathers.count_ones()) - deltas as u64);
        if rounds == 1 {
            self.wave_direct_round(wave, samplers, 0, gathers, counters);
            stages::add_light(wave.proven, wave);
            return;
        }
        let keys = wave.key;
        wave.sum = Lane3::ZERO;
        for round in 0..rounds {
            if round > 0 {
                // As one path would: further samples of one decision come from point sets of their own.
                stages::split_keys(wave.proven, wave, &keys, round);
            }
            self.wave_direct_round(wave, samplers, round, gathers, counters);
            stages::sum_light(wave.proven, wave);
        }
        wave.key = keys;
        stages::add_sum(wave.proven, wave, self.light_samples as f32);
    }

    /// Light sample number `round` of the paths in `gathers`: what it brings, and whether something is in between.
    fn wave_direct_round(
        &self,
        wave: &mut Wave,
        samplers: &Samplers,
        round: u32,
        gathers: u64,
        counters: &mut Counters,
    ) {
        wave.draw_two(samplers, dimension::LIGHT);
        if let Some(lamp) = &self.lamp {
            stages::rectangle_light(wave.proven, wave, lamp);
            let imprecise = gathers & mask_of(&wave.infinite);
            if imprecise != 0 {
                // The solid angle could not be told: by area, as one path would.
                self.wave_light_samples(wave, samplers, round, imprecise, AtOnce::default());
            }
        } else {
            let at_once =
                AtOnce { balls: !self.without.leaves(Special::Balls), shards: !self.without.leaves(Special::Shards) };
            self.wave_light_samples(wave, samplers, round, gathers, at_once);
        }
        stages::direct_diffuse(wave.proven, wave, self.direct == Strategy::Mis, self.light_samples as f32);
        if wave.any_facets() {
            stages::direct_facets(wave.proven, wave);
        }
        for i in lanes_of(gathers & wave.others) {
            match wave.scatters[i] {
                Scatters::Diffuse => {}
                Scatters::Delta => wave.lit[i] = NO,
                Scatters::Facets => self.wave_direct_facets(wave, i),
                Scatters::Other => self.wave_direct_other(wave, i),
            }
        }
        let (lamp, size2) = self.lamp_spared;
        stages::shadow_rays(wave.proven, wave, lamp, size2);
        for i in lanes_of(mask_of(&wave.lit) & mask_of(&wave.infinite)) {
            let ray = spawn(wave.p.at(i), wave.p_error.at(i), wave.ng.at(i), wave.wi.at(i));
            wave.shadow_origin.set(i, ray.origin);
            wave.shadow_direction.set(i, ray.direction);
            wave.shadow_t_max[i] = ray.t_max;
            (wave.shadow_spared[0][i], wave.shadow_spared[1][i], wave.shadow_ended[i]) = (0, 0, 0);
        }
        let (n, ended) = (wave.n, wave.shadow_ended);
        self.wave_shadows(wave, n, &ended, counters);
    }

    /// Whether anything is in the way of the shadow rays of the first `n` lanes that are lit; they are not held against what
    /// they have `ended` before.
    pub(super) fn wave_shadows(&self, wave: &mut Wave, n: usize, ended: &Lane<u32>, counters: &mut Counters) {
        let rays = Rays {
            n,
            active: &wave.lit,
            origin: &wave.shadow_origin,
            direction: &wave.shadow_direction,
            t_max: &wave.shadow_t_max,
            spared: &wave.shadow_spared,
            ended,
        };
        let accel = self.scene.accel();
        if !accel.occluded_of(&mut wave.few, &rays, &mut wave.occluded, counters) {
            for i in lanes_of(mask_of(&wave.lit)) {
                wave.occluded[i] = Flag::from(accel.occluded(&rays.at(i), counters));
            }
        }
    }

    /// Light samples of any kind, for the lanes in `gathers` whose material is no delta.
    fn wave_light_samples(&self, wave: &mut Wave, samplers: &Samplers, round: u32, gathers: u64, at_once: AtOnce) {
        let lights = self.scene.lights();
        if let Some(Drawn::Ball(ball)) = lights.same_for_all(round, at_once) {
            stages::same_ball_light(wave.proven, wave, &ball, self.round(ball.emitter));
            return self.wave_imprecise(wave, samplers, round, gathers & mask_of(&wave.infinite));
        }
        if let Some(few) = lights.few_balls(at_once) {
            wave.draw_one(samplers, dimension::LIGHT_CHOICE);
            stages::choose_ball(wave.proven, wave, &few, few.emitters().map(|emitter| self.round(emitter)));
            stages::ball_light(wave.proven, wave);
            return self.wave_imprecise(wave, samplers, round, mask_of(&wave.ball) & mask_of(&wave.infinite));
        }
        let (mut lanes, mut picks, mut n) = ([0usize; WIDTH], [0.5; WIDTH], 0);
        wave.draw_one(samplers, dimension::LIGHT_CHOICE);
        (wave.ball, wave.shard) = ([NO; WIDTH], [NO; WIDTH]);
        for i in lanes_of(gathers) {
            (wave.lit[i], wave.ball_round[i]) = (NO, 0);
            if wave.scatters[i] != Scatters::Delta {
                picks[n] = wave.u_one[i];
                lanes[n] = i;
                n += 1;
            }
        }
        let mut references = [(Reference { p: Vec3::ZERO, n: Vec3::ZERO }, Vec2::ZERO); WIDTH];
        for (reference, &i) in references.iter_mut().zip(&lanes).take(n) {
            let u = Vec2::new(wave.u[0][i], wave.u[1][i]);
            *reference = (Reference { p: wave.p.at(i), n: wave.n_reflecting.at(i) }, u);
        }
        let query = |k: usize| (references[k].0, picks[k], references[k].1);
        lights.for_all(wave.proven, n, (round, self.light_samples), at_once, query, |k, drawn| match drawn {
            Drawn::Nothing => {}
            Drawn::Sample(light) => wave.set_light(lanes[k], &light),
            Drawn::Ball(ball) => wave.set_ball(lanes[k], &ball, self.round(ball.emitter)),
            Drawn::Shard(shard) => wave.set_shard(lanes[k], &shard),
        });
        if mask_of(&wave.shard) != 0 {
            stages::shard_light(wave.proven, wave);
        }
        if mask_of(&wave.ball) != 0 {
            stages::ball_light(wave.proven, wave);
            self.wave_imprecise(wave, samplers, round, mask_of(&wave.ball) & mask_of(&wave.infinite));
        }
    }

    /// Samples of spheres from inside, as one path would.
    fn wave_imprecise(&self, wave: &mut Wave, samplers: &Samplers, round: u32, lanes: u64) {
        if lanes != 0 {
            self.wave_light_samples(wave, samplers, round, lanes, AtOnce::default());
        }
    }

    /// The bit of an emitter that is a sphere for rays that end before it.
    fn round(&self, emitter: u32) -> u32 {
        if self.without.leaves(Special::Planes) { 0 } else { self.scene.round(emitter) }
    }

    /// What a light sample brings by way of a rough metal, once its facets are known.
    fn wave_direct_facets(&self, wave: &mut Wave, i: usize) {
        if wave.lit[i] == NO {
            return;
        }
        let f_cos = self.wave_material(wave, i).facet_reflectance(wave.facet_cos[i]) * wave.facet_value[i];
        self.wave_brings(wave, i, Eval { f_cos, pdf: wave.facet_pdf[i] });
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
        let mut eval = bsdf.evaluate(wo, wi);
        if wave.aims {
            eval.pdf = wave.aim.cones(i).density(light_wi, eval.pdf);
        }
        self.wave_brings(wave, i, eval);
    }

    /// What a light sample brings by way of a BSDF with these values.
    #[inline(always)]
    fn wave_brings(&self, wave: &mut Wave, i: usize, eval: Eval) {
        wave.lit[i] = NO;
        if eval.f_cos == Rgb::ZERO {
            return;
        }
        let delta = wave.light_pdf[i] < 0.0;
        let pdf = wave.light_pdf[i].abs();
        let weight = if self.direct == Strategy::Mis && !delta {
            power_heuristic(self.light_samples as f32 * pdf, wave.ways[i] * eval.pdf)
        } else {
            1.0
        };
        let brings = eval.f_cos * wave.light_radiance.at(i) * (weight / pdf);
        wave.lit[i] = Flag::from(brings != Rgb::ZERO);
        wave.brings.set(i, brings);
    }
}
