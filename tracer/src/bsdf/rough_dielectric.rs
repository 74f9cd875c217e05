//! A rough boundary between transparent media (Walter et al. 2007): GGX, single scattering.

use common::method::Fresnel;

use super::{BsdfSample, Eval, dielectric::reflection_chance};
use crate::{
    fresnel,
    math::{Rgb, Vec2, Vec3},
    microfacet::{Ggx, half_vector},
};

/// Where alpha |eta - 1| is below this, refraction spreads light too little for f32 directions to tell
/// the facets apart, and the boundary counts as smooth.
const LEAST_SPREAD: f32 = 1e-4;

/// A rough boundary.
#[derive(Debug, Clone, Copy)]
pub struct RoughDielectric {
    /// Index on the side the normal points away from, over the index on the normal's side.
    pub eta: f32,
    /// Tint of reflected light, 0 to 1.
    pub reflectance: Rgb,
    /// Tint of refracted light, 0 to 1.
    pub transmittance: Rgb,
    /// How each facet splits light.
    pub fresnel: Fresnel,
    /// Its facets.
    pub ggx: Ggx,
}

impl RoughDielectric {
    /// The facets of a boundary with these alphas and this relative index, or `None` where it counts as
    /// smooth.
    #[must_use]
    pub fn facets(alphas: [f32; 2], eta: f32) -> Option<Ggx> {
        Ggx::new(alphas[0], alphas[1]).filter(|ggx| ggx.roughest() * (eta - 1.0).abs() >= LEAST_SPREAD)
    }

    /// The relative index for light that comes back along `wo`, and `wo` and `wi` turned so that `wo`
    /// lies above.
    #[inline]
    fn upright(&self, wo: Vec3, wi: Vec3) -> (f32, Vec3, Vec3) {
        if wo.z > 0.0 {
            (self.eta, wo, wi)
        } else {
            (1.0 / self.eta, Vec3::new(wo.x, wo.y, -wo.z), Vec3::new(wi.x, wi.y, -wi.z))
        }
    }

    #[inline]
    pub(super) fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        if wo.z == 0.0 || wi.z == 0.0 || (wo.z * wi.z).is_nan() {
            return Eval::ZERO;
        }
        let (eta, wo, wi) = self.upright(wo, wi);
        if wi.z > 0.0 {
            let Some((m, cos)) = half_vector(wo, wi) else { return Eval::ZERO };
            let split = fresnel::split(self.fresnel, cos.min(1.0), eta);
            let Some(chance) = reflection_chance(split.reflected, self.reflectance, self.transmittance) else {
                return Eval::ZERO;
            };
            let f_cos = self.reflectance * (split.reflected * self.ggx.d(m) * self.ggx.visibility(wo, wi));
            return Eval { f_cos, pdf: 0.25 * chance * self.ggx.visible_density(wo, m) };
        }
        let sum = wo + wi * eta;
        let length = sum.length();
        if length.is_nan() || length <= 1e-15 {
            return Eval::ZERO;
        }
        // The facet's normal lies on the rarer side.
        let m = if sum.z > 0.0 { sum / length } else { -sum / length };
        let (cos_o, cos_i) = (wo.dot(m), wi.dot(m));
        if !(cos_o > 0.0 && cos_i < 0.0 && m.z > 0.0) {
            return Eval::ZERO;
        }
        let split = fresnel::split(self.fresnel, cos_o.min(1.0), eta);
        let Some(chance) = reflection_chance(split.reflected, self.reflectance, self.transmittance) else {
            return Eval::ZERO;
        };
        // (wo . m + eta wi . m)^2 is the squared length of the sum that m was made from.
        let spread = -cos_i / (length * length);
        let transmitted = (1.0 - split.reflected) * 4.0 * self.ggx.d(m) * self.ggx.visibility(wo, wi) * cos_o * spread;
        // Density of m to density of wi brings eta^2; radiance on the other side takes it away again.
        let f_cos = self.transmittance * transmitted;
        Eval { f_cos, pdf: (1.0 - chance) * self.ggx.visible_density(wo, m) * cos_o * eta * eta * spread }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 || wo.z.is_nan() {
            return None;
        }
        let below = wo.z < 0.0;
        let (eta, wo, _) = self.upright(wo, wo);
        let m = self.ggx.sample_visible(wo, u);
        let cos_o = wo.dot(m).min(1.0);
        if cos_o.is_nan() || cos_o <= 0.0 {
            return None;
        }
        let split = fresnel::split(self.fresnel, cos_o, eta);
        let chance = reflection_chance(split.reflected, self.reflectance, self.transmittance)?;
        let density = self.ggx.visible_density(wo, m);
        let mut sample = if u_lobe < chance {
            let wi = m * (2.0 * cos_o) - wo;
            if wi.z <= 0.0 {
                return None;
            }
            let weight = self.reflectance * (split.reflected / chance * self.ggx.shadowing(wo, wi));
            BsdfSample::reflection(wi, weight, 0.25 * chance * density)
        } else {
            let wi = m * (cos_o / eta - split.cos_t) - wo / eta;
            if wi.z >= 0.0 {
                return None;
            }
            let share = (1.0 - split.reflected) / (1.0 - chance);
            let weight = self.transmittance * (share * self.ggx.shadowing(wo, wi) / (eta * eta));
            let length = (cos_o - eta * split.cos_t).abs();
            let pdf = (1.0 - chance) * density * cos_o * eta * eta * split.cos_t / (length * length);
            BsdfSample { wi, weight, pdf, delta: false, transmission: true, eta }
        };
        if below {
            sample.wi.z = -sample.wi.z;
        }
        // At the edge of total reflection and of the horizon the density under- or overflows.
        (sample.pdf > 0.0 && sample.pdf.is_finite()).then_some(sample)
    }
}
