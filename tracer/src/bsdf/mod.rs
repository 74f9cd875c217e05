//! Scattering at a point of a surface: evaluation, density and sampling of one BSDF.
//!
//! Directions are unit vectors in the local frame, z along the shading normal, and point away from the
//! surface: `wo` to where the path comes from, `wi` to where it goes on. Radiance travels from `wi` to
//! `wo`. The module knows nothing of textures, geometry or lights.

mod coat;
mod conductor;
mod dielectric;
mod diffuse;
mod phong;
mod plastic;
mod rough_dielectric;

pub use coat::{ByCosine, SchlickCoat, SplitSum, Transmittance};
pub(crate) use conductor::Facets;
pub use conductor::{Metal, Reflectivity, RoughConductor, SmoothConductor};
pub use dielectric::SmoothDielectric;
pub use diffuse::{Diffuse, Mirror};
pub use phong::{BlinnFacets, BlinnMicrofacet, BlinnPhong, GREATEST_EXPONENT, Phong};
pub use plastic::{MetallicRoughness, Plastic, PlasticCoat};
pub use rough_dielectric::RoughDielectric;

use crate::math::{Rgb, Vec2, Vec3};

/// A direction drawn from a BSDF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BsdfSample {
    /// The direction.
    pub wi: Vec3,
    /// f |cos wi| / pdf; on refraction radiance carries 1 / eta^2.
    pub weight: Rgb,
    /// Density over solid angle, that of [`Bsdf::pdf`]; 0 for a delta.
    pub pdf: f32,
    /// Whether the direction came from a delta distribution.
    pub delta: bool,
    /// Whether the direction lies on the other side of the surface.
    pub transmission: bool,
    /// Index of refraction on the side of `wi` over that on the side of `wo`; 1 without transmission.
    pub eta: f32,
}

impl BsdfSample {
    /// A direction on the side of `wo`.
    #[inline]
    fn reflection(wi: Vec3, weight: Rgb, pdf: f32) -> Self {
        Self { wi, weight, pdf, delta: false, transmission: false, eta: 1.0 }
    }

    /// The one direction of a specular lobe on the side of `wo`.
    #[inline]
    fn specular(wi: Vec3, weight: Rgb) -> Self {
        Self { wi, weight, pdf: 0.0, delta: true, transmission: false, eta: 1.0 }
    }
}

/// f |cos wi| and the density with which `sample` draws `wi`, together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eval {
    /// f |cos wi|; deltas left out.
    pub f_cos: Rgb,
    /// Density over solid angle; deltas left out.
    pub pdf: f32,
}

impl Eval {
    /// Nothing is scattered there, and nothing is sampled there.
    pub const ZERO: Eval = Eval { f_cos: Rgb::ZERO, pdf: 0.0 };
}

/// The mirror image of `w` about the normal.
#[inline]
fn reflect(w: Vec3) -> Vec3 {
    Vec3::new(-w.x, -w.y, w.z)
}

/// The scattering of one point: its parameters are already looked up.
#[derive(Debug, Clone, Copy)]
pub struct Bsdf {
    lobes: Lobes,
    /// Whether an opaque surface scatters on its back as on its front.
    two_sided: bool,
}

/// What a BSDF is made of. Every opaque one is written for `wo.z > 0` alone.
#[derive(Debug, Clone, Copy)]
pub enum Lobes {
    /// Lambert's law.
    Diffuse(Diffuse),
    /// Perfect specular reflection.
    Mirror(Mirror),
    /// A smooth boundary between two transparent media.
    SmoothDielectric(SmoothDielectric),
    /// A rough one.
    RoughDielectric(RoughDielectric),
    /// A smooth metal.
    SmoothConductor(SmoothConductor),
    /// A rough metal.
    RoughConductor(RoughConductor),
    /// A diffuse base under a dielectric coat.
    Plastic(Plastic),
    /// Phong's lobe.
    Phong(Phong),
    /// Blinn and Phong's lobe.
    BlinnPhong(BlinnPhong),
    /// Blinn's distribution of facets.
    BlinnMicrofacet(BlinnMicrofacet),
    /// glTF's model.
    MetallicRoughness(MetallicRoughness),
}

impl Bsdf {
    /// Join lobes with what happens on the back; transparent ones have no back.
    #[must_use]
    pub fn new(lobes: Lobes, two_sided: bool) -> Self {
        Self { lobes, two_sided }
    }

    /// Both directions as an opaque surface sees them, `wo` above; `None` where it scatters nothing.
    #[inline]
    fn above(&self, wo: Vec3, wi: Vec3) -> Option<(Vec3, Vec3)> {
        if wo.z > 0.0 && wi.z > 0.0 {
            Some((wo, wi))
        } else if self.two_sided && wo.z < 0.0 && wi.z < 0.0 {
            Some((Vec3::new(wo.x, wo.y, -wo.z), Vec3::new(wi.x, wi.y, -wi.z)))
        } else {
            None
        }
    }

    /// f |cos wi| and the density of `wi`, together.
    #[inline]
    #[must_use]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        if let Lobes::RoughDielectric(lobe) = &self.lobes {
            return lobe.evaluate(wo, wi);
        }
        let Some((wo, wi)) = self.above(wo, wi) else { return Eval::ZERO };
        match &self.lobes {
            Lobes::Diffuse(lobe) => lobe.evaluate(wi),
            Lobes::RoughConductor(lobe) => lobe.evaluate(wo, wi),
            Lobes::Plastic(lobe) => lobe.evaluate(wo, wi),
            Lobes::Phong(lobe) => lobe.evaluate(wo, wi),
            Lobes::BlinnPhong(lobe) => lobe.evaluate(wo, wi),
            Lobes::BlinnMicrofacet(lobe) => lobe.evaluate(wo, wi),
            Lobes::MetallicRoughness(lobe) => lobe.evaluate(wo, wi),
            Lobes::Mirror(_) | Lobes::SmoothConductor(_) => Eval::ZERO,
            // Transparent: no side is above.
            Lobes::SmoothDielectric(_) | Lobes::RoughDielectric(_) => Eval::ZERO,
        }
    }

    /// f |cos wi|, deltas left out.
    #[inline]
    #[must_use]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.evaluate(wo, wi).f_cos
    }

    /// Density over solid angle with which [`Bsdf::sample`] draws `wi`, deltas left out.
    #[inline]
    #[must_use]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.evaluate(wo, wi).pdf
    }

    /// Draw a direction: `u_lobe` chooses between lobes, `u` within one, all in [0, 1). `None`: the path
    /// ends here.
    #[inline]
    #[must_use]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        match &self.lobes {
            Lobes::SmoothDielectric(lobe) => return lobe.sample(wo, u_lobe),
            Lobes::RoughDielectric(lobe) => return lobe.sample(wo, u_lobe, u),
            _ => {}
        }
        let back = wo.z < 0.0;
        // Also false for a NaN.
        if !(wo.z > 0.0 || (back && self.two_sided)) {
            return None;
        }
        let above = Vec3::new(wo.x, wo.y, wo.z.abs());
        let mut sample = match &self.lobes {
            Lobes::Diffuse(lobe) => lobe.sample(u),
            Lobes::Mirror(lobe) => lobe.sample(above),
            Lobes::SmoothConductor(lobe) => lobe.sample(above),
            Lobes::RoughConductor(lobe) => lobe.sample(above, u)?,
            Lobes::Plastic(lobe) => lobe.sample(above, u_lobe, u)?,
            Lobes::Phong(lobe) => lobe.sample(above, u)?,
            Lobes::BlinnPhong(lobe) => lobe.sample(above, u)?,
            Lobes::BlinnMicrofacet(lobe) => lobe.sample(above, u)?,
            Lobes::MetallicRoughness(lobe) => lobe.sample(above, u_lobe, u)?,
            Lobes::SmoothDielectric(_) | Lobes::RoughDielectric(_) => return None,
        };
        if back {
            sample.wi.z = -sample.wi.z;
        }
        Some(sample)
    }

    /// Whether every lobe is a delta: then light is found by sampling the BSDF alone.
    #[inline]
    #[must_use]
    pub fn is_delta(&self) -> bool {
        match &self.lobes {
            Lobes::Mirror(_) | Lobes::SmoothDielectric(_) | Lobes::SmoothConductor(_) => true,
            Lobes::Plastic(lobe) => lobe.is_delta(),
            Lobes::MetallicRoughness(lobe) => lobe.is_delta(),
            _ => false,
        }
    }

    /// The reflectance, where towards `wo` light leaves by Lambert's law alone.
    #[inline]
    #[must_use]
    pub fn reflects_diffusely(&self, wo: Vec3) -> Option<Rgb> {
        let Lobes::Diffuse(lobe) = &self.lobes else { return None };
        (wo.z > 0.0 || wo.z < 0.0 && self.two_sided).then_some(lobe.reflectance)
    }

    /// Colour of the surface as a denoiser wants it, 0 to 1: about its albedo under light from everywhere,
    /// the tint of glass. Black only where nothing is scattered.
    #[must_use]
    pub fn albedo(&self) -> Rgb {
        // Schlick's term averaged over the hemisphere.
        let facets = |f0: Rgb| (f0 * 20.0 + Rgb::ONE) / 21.0;
        match &self.lobes {
            Lobes::Diffuse(lobe) => lobe.reflectance,
            Lobes::Mirror(lobe) => lobe.reflectance,
            Lobes::SmoothDielectric(lobe) => lobe.reflectance.max(lobe.transmittance),
            Lobes::RoughDielectric(lobe) => lobe.reflectance.max(lobe.transmittance),
            Lobes::SmoothConductor(lobe) => lobe.metal.reflectance(1.0),
            Lobes::RoughConductor(lobe) => lobe.metal.reflectance(1.0),
            Lobes::Plastic(lobe) => lobe.albedo(),
            Lobes::Phong(lobe) => lobe.reflectance,
            Lobes::BlinnPhong(lobe) => facets(lobe.reflectance),
            Lobes::BlinnMicrofacet(lobe) => facets(lobe.reflectance),
            Lobes::MetallicRoughness(lobe) => {
                (facets(lobe.f0) + lobe.diffuse * lobe.coat.mean()).clamp(Rgb::ZERO, Rgb::ONE)
            }
        }
    }
}

#[cfg(test)]
mod tests;
