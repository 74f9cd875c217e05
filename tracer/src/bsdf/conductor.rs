//! Metals: smooth and rough.

use super::{BsdfSample, Eval, reflect};
use crate::{
    fresnel::{ComplexIndex, schlick_rgb},
    math::{Rgb, Vec2, Vec3},
    microfacet::{Ggx, half_vector_if_any},
};

/// How much light a metal reflects at an angle.
#[derive(Debug, Clone, Copy)]
pub enum Reflectivity {
    /// The same at every angle.
    Constant,
    /// By Fresnel's equations.
    Exact(ComplexIndex),
    /// By Schlick's approximation, from the reflectance at normal incidence.
    Schlick(Rgb),
}

/// A metal's reflectance, with a tint.
#[derive(Debug, Clone, Copy)]
pub struct Metal {
    /// Reflectance by angle.
    pub reflectivity: Reflectivity,
    /// Multiplies it, 0 to 1.
    pub tint: Rgb,
}

impl Metal {
    /// Share of light reflected by a facet that light meets at cosine `cos`.
    #[inline]
    pub(crate) fn reflectance(&self, cos: f32) -> Rgb {
        match &self.reflectivity {
            Reflectivity::Constant => self.tint,
            Reflectivity::Exact(index) => self.tint * index.reflectance(cos),
            Reflectivity::Schlick(f0) => self.tint * schlick_rgb(*f0, cos),
        }
    }
}

/// A smooth metal.
#[derive(Debug, Clone, Copy)]
pub struct SmoothConductor {
    /// What it reflects.
    pub metal: Metal,
}

impl SmoothConductor {
    #[inline]
    pub(super) fn sample(&self, wo: Vec3) -> BsdfSample {
        BsdfSample::specular(reflect(wo), self.metal.reflectance(wo.z))
    }
}

/// A rough metal: GGX, single scattering.
#[derive(Debug, Clone, Copy)]
pub struct RoughConductor {
    /// What its facets reflect.
    pub metal: Metal,
    /// Its facets.
    pub ggx: Ggx,
}

impl RoughConductor {
    #[inline]
    pub(super) fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        facets_evaluate(&self.ggx, wo, wi, |cos| self.metal.reflectance(cos))
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        facets_sample(&self.ggx, wo, u, |cos| self.metal.reflectance(cos))
    }
}

/// Reflection by GGX facets, each with reflectance `f` of its own cosine.
#[inline]
pub(super) fn facets_evaluate(ggx: &Ggx, wo: Vec3, wi: Vec3, f: impl Fn(f32) -> Rgb) -> Eval {
    let facets = Facets::between(ggx, wo, wi);
    if !facets.some {
        return Eval::ZERO;
    }
    Eval { f_cos: f(facets.cos) * facets.value, pdf: facets.pdf }
}

/// Draw a reflection by visible GGX facets.
#[inline]
pub(super) fn facets_sample(ggx: &Ggx, wo: Vec3, u: Vec2, f: impl Fn(f32) -> Rgb) -> Option<BsdfSample> {
    let (wi, facets) = Facets::drawn(ggx, wo, u);
    facets.some.then(|| BsdfSample::reflection(wi, f(facets.cos) * facets.value, facets.pdf))
}

/// The GGX facets that reflect one direction into another: all but how much light they reflect. Without branches, so that
/// loops over it become vector code.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facets {
    /// Cosine at which they meet the light, at most 1.
    pub cos: f32,
    /// Times their reflectance: f |cos wi|, or of a direction drawn by them the weight.
    pub value: f32,
    /// Density over solid angle of the direction.
    pub pdf: f32,
    /// Whether there are any.
    pub some: bool,
}

impl Facets {
    /// Between `wo` and `wi`, both above the surface.
    #[inline(always)]
    pub fn between(ggx: &Ggx, wo: Vec3, wi: Vec3) -> Self {
        let (m, cos, some) = half_vector_if_any(wo, wi);
        let value = ggx.d(m) * ggx.visibility(wo, wi);
        Self { cos: cos.min(1.0), value, pdf: 0.25 * ggx.visible_density(wo, m), some }
    }

    /// Of those visible from `wo`, above the surface, the one that `u` draws, and the direction that it reflects `wo` to.
    #[inline(always)]
    pub fn drawn(ggx: &Ggx, wo: Vec3, u: Vec2) -> (Vec3, Self) {
        let m = ggx.sample_visible(wo, u);
        let cos = wo.dot(m).min(1.0);
        let wi = m * (2.0 * cos) - wo;
        // Also false for a NaN.
        let some = (cos > 0.0) & (wi.z > 0.0);
        (wi, Self { cos, value: ggx.shadowing(wo, wi), pdf: 0.25 * ggx.visible_density(wo, m), some })
    }
}
