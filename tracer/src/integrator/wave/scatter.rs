//! How the paths of a wave go on: directions, and roulette.

use super::{Came, Samplers, Scatters, Wave, stages};
use crate::{
    integrator::{
        Drawn, Integrator, Strategy, dimension, draw,
        roulette::{FIRST, survival, weight_window},
    },
    lanes::{YES, lanes_of, mask_of},
    math::{Rgb, Vec2},
    special::Special,
};

impl Integrator<'_> {
    /// Go on along sampled directions.
    pub(super) fn wave_scatter(&self, wave: &mut Wave, samplers: &Samplers) {
        let delta_only = !self.direct.rays_find_light();
        let came = match self.direct {
            Strategy::Mis => Came::Sampled,
            Strategy::Bsdf => Came::Only,
            Strategy::Light | Strategy::Hemisphere => Came::Counted,
        };
        // Of Lambert's law nothing is looked for after so many scatterings.
        let last = if delta_only { self.max_depth } else { u32::MAX };
        wave.draw_two(samplers, dimension::DIRECTION);
        stages::scatter_diffuse(wave.proven, wave, came, last);
        for i in lanes_of(mask_of(&wave.ended)) {
            let wo_z = wave.wo.at(i).z;
            let scatters = wo_z > 0.0 || wo_z < 0.0 && wave.two_sided[i] == YES;
            let absorbed = !scatters || wave.throughput.at(i) == Rgb::ZERO;
            let black = wave.depth[i] == 0 && wave.reflectance.at(i) == Rgb::ZERO;
            let unasked = wave.depth[i] + 1 == last && !self.deltas;
            wave.end(i, absorbed && black && !unasked);
        }
        if wave.any_facets() {
            stages::scatter_facets(wave.proven, wave);
        }
        let mut drawn = false;
        for i in lanes_of(wave.others & wave.active()) {
            if wave.scatters[i] == Scatters::Facets {
                self.wave_scatter_facets(wave, came, i);
                continue;
            }
            if !drawn {
                wave.draw_one(samplers, dimension::LOBE);
                drawn = true;
            }
            self.wave_scatter_other(wave, came, i);
        }
        let plain = wave.plain_points && !self.without.leaves(Special::Roulette);
        if let (Some(weight), true) = (weight_window(self.roulette), plain) {
            stages::roulette(wave.proven, wave, FIRST, weight, samplers.batches);
            for i in lanes_of(mask_of(&wave.ended)) {
                wave.end(i, false);
            }
        } else {
            self.wave_roulette(wave, samplers);
        }
        stages::spawn_rays(wave.proven, wave);
    }

    /// A direction of a material that the stages do not know.
    fn wave_scatter_other(&self, wave: &mut Wave, came: Came, i: usize) {
        let depth = wave.depth[i];
        let last = depth + 1 == self.max_depth && !self.direct.rays_find_light();
        if last && !self.deltas {
            return wave.end(i, false);
        }
        let bsdf = self.wave_material(wave, i).bsdf(Vec2::ZERO);
        let u_lobe = wave.u_one[i];
        let u = Vec2::new(wave.u[0][i], wave.u[1][i]);
        let cones = (wave.aims && !bsdf.is_delta()).then(|| wave.aim.cones(i));
        let drawn = draw(&bsdf, wave.wo.at(i), &wave.frame(i), cones.as_ref(), u_lobe, u);
        let Some(Drawn { sample, wi, denser }) = drawn else {
            return wave.end(i, depth == 0 && bsdf.albedo() == Rgb::ZERO);
        };
        let leaves_front = (wi.dot(wave.ng.at(i)) > 0.0) != sample.transmission;
        if leaves_front != (wave.front[i] == YES) {
            return wave.end(i, false);
        }
        wave.wi.set(i, wi);
        let throughput = wave.throughput.at(i) * sample.weight;
        wave.throughput.set(i, throughput);
        wave.eta2[i] *= sample.eta * sample.eta * denser;
        if throughput == Rgb::ZERO {
            return wave.end(i, depth == 0 && bsdf.albedo() == Rgb::ZERO);
        }
        if last && !sample.delta {
            return wave.end(i, false);
        }
        wave.came[i] = if sample.delta { Came::Only } else { came };
        wave.pdf[i] = wave.ways[i] * sample.pdf;
    }

    /// A direction of a rough metal, once its facet is known.
    fn wave_scatter_facets(&self, wave: &mut Wave, came: Came, i: usize) {
        let depth = wave.depth[i];
        let last = depth + 1 == self.max_depth && !self.direct.rays_find_light();
        if last && !self.deltas {
            return wave.end(i, false);
        }
        let material = self.wave_material(wave, i);
        let black = || depth == 0 && material.facet_reflectance(1.0) == Rgb::ZERO;
        if wave.facet_pdf[i] < 0.0 {
            let black = black();
            return wave.end(i, black);
        }
        if (wave.wi.at(i).dot(wave.ng.at(i)) > 0.0) != (wave.front[i] == YES) {
            return wave.end(i, false);
        }
        let weight = material.facet_reflectance(wave.facet_cos[i]) * wave.facet_value[i];
        let throughput = wave.throughput.at(i) * weight;
        wave.throughput.set(i, throughput);
        if throughput == Rgb::ZERO || last {
            let black = throughput == Rgb::ZERO && black();
            return wave.end(i, black);
        }
        wave.came[i] = came;
        wave.pdf[i] = wave.ways[i] * wave.facet_pdf[i];
    }

    fn wave_roulette(&self, wave: &mut Wave, samplers: &Samplers) {
        for i in lanes_of(wave.active()) {
            let (depth, throughput) = (wave.depth[i], wave.throughput.at(i));
            if let Some(q) = survival(self.roulette, depth + 1, throughput * wave.eta2[i]) {
                if wave.stream(samplers, i).one(dimension::at(depth, dimension::ROULETTE)) >= q {
                    wave.end(i, false);
                } else {
                    wave.throughput.set(i, throughput / q);
                }
            }
        }
    }
}
