//! Lambert's law, and the perfect mirror.

use super::{BsdfSample, Eval, reflect};
use crate::math::{INV_PI, Rgb, Vec2, Vec3, cosine_hemisphere};

/// Lambertian reflection.
#[derive(Debug, Clone, Copy)]
pub struct Diffuse {
    /// Share of light reflected, 0 to 1.
    pub reflectance: Rgb,
}

impl Diffuse {
    #[inline]
    pub(super) fn evaluate(&self, wi: Vec3) -> Eval {
        let pdf = wi.z * INV_PI;
        Eval { f_cos: self.reflectance * pdf, pdf }
    }

    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> BsdfSample {
        let wi = cosine_hemisphere(u);
        BsdfSample::reflection(wi, self.reflectance, wi.z * INV_PI)
    }
}

/// Perfect specular reflection.
#[derive(Debug, Clone, Copy)]
pub struct Mirror {
    /// Share of light reflected, 0 to 1, at every angle.
    pub reflectance: Rgb,
}

impl Mirror {
    #[inline]
    pub(super) fn sample(&self, wo: Vec3) -> BsdfSample {
        BsdfSample::specular(reflect(wo), self.reflectance)
    }
}
