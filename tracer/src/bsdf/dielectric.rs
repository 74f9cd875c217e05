//! Boundaries between transparent media.

use common::method::Fresnel;

use super::{BsdfSample, reflect};
use crate::{
    fresnel,
    math::{Rgb, Vec3},
};

/// A smooth boundary: two deltas.
#[derive(Debug, Clone, Copy)]
pub struct SmoothDielectric {
    /// Index on the side the normal points away from, over the index on the normal's side.
    pub eta: f32,
    /// Tint of reflected light, 0 to 1.
    pub reflectance: Rgb,
    /// Tint of refracted light, 0 to 1.
    pub transmittance: Rgb,
    /// How light is split.
    pub fresnel: Fresnel,
}

impl SmoothDielectric {
    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32) -> Option<BsdfSample> {
        let outside = wo.z > 0.0;
        if !(outside || wo.z < 0.0) {
            return None;
        }
        let eta = if outside { self.eta } else { 1.0 / self.eta };
        let split = fresnel::split(self.fresnel, wo.z.abs(), eta);
        let chance = reflection_chance(split.reflected, self.reflectance, self.transmittance)?;
        if u_lobe < chance {
            let weight = self.reflectance * (split.reflected / chance);
            return Some(BsdfSample::specular(reflect(wo), weight));
        }
        let z = if outside { -split.cos_t } else { split.cos_t };
        let wi = Vec3::new(-wo.x / eta, -wo.y / eta, z);
        // Radiance is squeezed into, or spread over, the solid angle on the other side.
        let weight = self.transmittance * ((1.0 - split.reflected) / (1.0 - chance) / (eta * eta));
        Some(BsdfSample { wi, weight, pdf: 0.0, delta: true, transmission: true, eta })
    }
}

/// Chance of following the reflection: by energy, tints included. `None` where both are black.
#[inline]
pub(super) fn reflection_chance(reflected: f32, reflectance: Rgb, transmittance: Rgb) -> Option<f32> {
    if reflectance == transmittance {
        // Then the weights are exactly the tint.
        return Some(reflected);
    }
    let r = reflected * reflectance.max_element();
    let t = (1.0 - reflected) * transmittance.max_element();
    (r + t > 0.0).then(|| r / (r + t))
}
