//! Light that arrives at a vertex after its last scattering there, as far as it is estimated at the vertex.

use super::{Integrator, Shading, Strategy, dimension, power_heuristic};
use crate::{
    geometry::{Counters, Ray, spawn, spawn_to},
    light::{LightSample, Stratum},
    math::{Frame, Rgb, UNIFORM_HEMISPHERE_PDF, UNIFORM_SPHERE_PDF, uniform_hemisphere, uniform_sphere},
    sampler::Stream,
    scene::NO_EMITTER,
};

impl Integrator<'_> {
    /// Estimate at the vertex after `depth` scatterings, from where the path goes on in `splits` ways.
    #[inline]
    pub(super) fn direct(
        &self,
        shading: &Shading,
        depth: u32,
        splits: u32,
        stream: &Stream,
        counters: &mut Counters,
    ) -> Rgb {
        if !self.counts(depth + 1) || shading.bsdf.is_delta() || self.scene.lights().is_dark() {
            return Rgb::ZERO;
        }
        match self.direct {
            Strategy::Bsdf => Rgb::ZERO,
            Strategy::Hemisphere => self.by_hemisphere(shading, depth, stream, counters),
            Strategy::Light | Strategy::Mis => self.by_light(shading, depth, splits, stream, counters),
        }
    }

    /// Next-event estimation: points on lights.
    #[inline]
    fn by_light(&self, shading: &Shading, depth: u32, splits: u32, stream: &Stream, counters: &mut Counters) -> Rgb {
        let count = self.light_samples;
        let mut sum = Rgb::ZERO;
        let mut drawn = 0;
        for index in 0..count {
            let draw = || {
                // Further samples of one decision come from point sets of their own.
                let stream = if drawn == 0 { *stream } else { stream.split(drawn) };
                drawn += 1;
                let choice = stream.one(dimension::at(depth, dimension::LIGHT_CHOICE));
                (choice, stream.two(dimension::at(depth, dimension::LIGHT)))
            };
            self.scene.lights().for_each(&shading.reference, Stratum { index, count }, draw, |sample| {
                sum += self.one_light(shading, &sample, splits, counters);
            });
        }
        counters.light_samples += u64::from(drawn);
        if count == 1 { sum } else { sum / count as f32 }
    }

    /// What one light sample brings.
    #[inline]
    fn one_light(&self, shading: &Shading, light: &LightSample, splits: u32, counters: &mut Counters) -> Rgb {
        let wi = shading.frame.to_local(light.wi);
        // The sides by the shading and by the geometric normal must agree, or light leaks.
        let transmission = (wi.z > 0.0) != (shading.wo.z > 0.0);
        let passes = (light.wi.dot(shading.point.ng) > 0.0) != shading.front;
        if transmission != passes {
            return Rgb::ZERO;
        }
        let eval = shading.bsdf.evaluate(shading.wo, wi);
        if eval.f_cos == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let weight = if self.direct == Strategy::Mis && !light.delta {
            let pdf = shading.cones.as_ref().map_or(eval.pdf, |cones| cones.density(light.wi, eval.pdf));
            power_heuristic(self.light_samples as f32 * light.pdf, splits as f32 * pdf)
        } else {
            1.0
        };
        let radiance = self.scene.sampled_radiance(light);
        let brings = eval.f_cos * radiance * (weight / light.pdf);
        if brings == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let point = &shading.point;
        let ray = if light.distance.is_finite() {
            spawn_to(point.p, point.p_error, point.ng, light.point, light.point_error, light.ng)
        } else {
            spawn(point.p, point.p_error, point.ng, light.wi)
        };
        if self.masks {
            return brings * self.transmittance(ray, counters);
        }
        if self.scene.occluded(&ray, counters) { Rgb::ZERO } else { brings }
    }

    /// Share of light that passes the masks along `ray`.
    #[inline(never)]
    fn transmittance(&self, mut ray: Ray, counters: &mut Counters) -> f32 {
        let mut share = 1.0;
        while let Some(hit) = self.scene.closest(&ray, counters) {
            let point = self.scene.point(&ray, &hit);
            share *= 1.0 - self.scene.material(&point).opacity(point.uv);
            let t_max = ray.t_max - hit.t;
            if share <= 0.0 || t_max <= 0.0 {
                return share.max(0.0);
            }
            ray = Ray { t_max, ..spawn(point.p, point.p_error, point.ng, ray.direction) };
        }
        share
    }

    /// Uniform directions over the hemisphere (the sphere, where the surface transmits): light is met by
    /// chance.
    fn by_hemisphere(&self, shading: &Shading, depth: u32, stream: &Stream, counters: &mut Counters) -> Rgb {
        let count = self.light_samples;
        let n = shading.reference.n;
        let reflects_only = n != crate::math::Vec3::ZERO;
        let pdf = if reflects_only { UNIFORM_HEMISPHERE_PDF } else { UNIFORM_SPHERE_PDF };
        let mut sum = Rgb::ZERO;
        for index in 0..count {
            let stream = if index == 0 { *stream } else { stream.split(index) };
            let u = stream.two(dimension::at(depth, dimension::LIGHT));
            let wi =
                if reflects_only { Frame::from_normal(n).to_world(uniform_hemisphere(u)) } else { uniform_sphere(u) };
            let local = shading.frame.to_local(wi);
            let transmission = (local.z > 0.0) != (shading.wo.z > 0.0);
            if transmission != ((wi.dot(shading.point.ng) > 0.0) != shading.front) {
                continue;
            }
            let f_cos = shading.bsdf.eval(shading.wo, local);
            if f_cos == Rgb::ZERO {
                continue;
            }
            let mut ray = spawn(shading.point.p, shading.point.p_error, shading.point.ng, wi);
            let opacity = dimension::at(depth, dimension::HEMISPHERE_OPACITY);
            let emitted = match self.visible(&mut ray, &stream, opacity, counters) {
                None => self.scene.lights().environment(wi),
                Some(hit) => {
                    let point = self.scene.point(&ray, &hit);
                    if point.emitter == NO_EMITTER {
                        Rgb::ZERO
                    } else {
                        self.scene.emitted(&point, wi.dot(point.ng) < 0.0)
                    }
                }
            };
            sum += f_cos * emitted;
        }
        sum / (pdf * count as f32)
    }
}
