//! Layered surfaces: a diffuse base under a dielectric coat, and glTF's metallic-roughness model.

use common::method::Fresnel;

use super::{
    BsdfSample, Eval,
    coat::{SchlickCoat, Transmittance},
    conductor::{facets_evaluate, facets_sample},
    reflect,
};
use crate::{
    fresnel::{self, schlick_rgb},
    math::{INV_PI, Rgb, Vec2, Vec3, cosine_hemisphere},
    microfacet::Ggx,
};

/// The coat of a plastic: constant over the surface.
#[derive(Debug, Clone, Copy)]
pub struct PlasticCoat {
    /// Index of refraction.
    pub eta: f32,
    /// How facets split light.
    pub fresnel: Fresnel,
    /// Facets; `None` is smooth.
    pub ggx: Option<Ggx>,
    /// What it lets through.
    pub transmittance: Transmittance,
    /// Share of the base's diffuse light that the coat sends back down.
    pub internal: f32,
}

impl PlasticCoat {
    /// A coat of this index and these alphas.
    #[must_use]
    pub fn new(eta: f32, alphas: [f32; 2], fresnel: Fresnel) -> Self {
        let ggx = Ggx::new(alphas[0], alphas[1]);
        let transmittance = Transmittance::new(ggx.as_ref(), |cos| fresnel::split(fresnel, cos, eta).reflected);
        // Light in equilibrium on both sides: n1^2 (1 - F12) = n2^2 (1 - F21).
        let internal = 1.0 - (transmittance.mean() / (eta * eta)).min(1.0);
        Self { eta, fresnel, ggx, transmittance, internal }
    }
}

/// A diffuse base under a dielectric coat. Light that the coat throws back onto the base is scattered
/// again, to all orders; the coat's own facets scatter once.
#[derive(Debug, Clone, Copy)]
pub struct Plastic {
    /// Reflectance of the base, 0 to 1.
    pub reflectance: Rgb,
    /// The coat.
    pub coat: PlasticCoat,
}

impl Plastic {
    #[inline]
    fn layers(&self) -> Layers<impl Fn(f32) -> f32, impl Fn(f32) -> Rgb> {
        let PlasticCoat { eta, fresnel, ggx, internal, .. } = self.coat;
        let transmittance = &self.coat.transmittance;
        // rho (1 - F) (1 + rho F + ...), over the mean transmittance by which the last passage is shared out.
        let rho = self.reflectance;
        let mean = transmittance.mean();
        let base = if mean > 0.0 {
            rho * (1.0 - internal) / (Rgb::ONE - rho * internal).max(Rgb::splat(1e-6)) / mean
        } else {
            Rgb::ZERO
        };
        Layers {
            ggx,
            base,
            base_share: rho.max_element(),
            specular_share: 0.0,
            transmittance: move |cos| transmittance.at(cos),
            specular: move |cos| Rgb::splat(fresnel::split(fresnel, cos, eta).reflected),
        }
    }

    #[inline]
    pub(super) fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        self.layers().evaluate(wo, wi)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        self.layers().sample(wo, u_lobe, u)
    }

    /// Share of light from everywhere that comes back.
    pub(super) fn albedo(&self) -> Rgb {
        let (rho, PlasticCoat { internal, transmittance, .. }) = (self.reflectance, &self.coat);
        let base = rho * (1.0 - internal) / (Rgb::ONE - rho * *internal).max(Rgb::splat(1e-6));
        (Rgb::splat(1.0 - transmittance.mean()) + base * transmittance.mean()).clamp(Rgb::ZERO, Rgb::ONE)
    }

    /// Whether nothing but a mirror-like coat is left.
    pub(super) fn is_delta(&self) -> bool {
        self.coat.ggx.is_none() && self.reflectance == Rgb::ZERO
    }
}

/// glTF 2.0's metallic-roughness model (appendix B): GGX with Schlick's term, over a diffuse base where
/// it is not metal.
///
/// The specification's mix by the half vector's Fresnel term reflects more light than arrives at grazing
/// angles; the base here gets what the coat's directional albedo leaves, as for plastic, and is otherwise
/// the same.
#[derive(Debug, Clone, Copy)]
pub struct MetallicRoughness {
    /// Reflectance of the facets at normal incidence.
    pub f0: Rgb,
    /// Reflectance of the base: base colour times (1 - metallic).
    pub diffuse: Rgb,
    /// Facets; `None` is smooth.
    pub ggx: Option<Ggx>,
    /// What the dielectric's coat lets through.
    pub coat: SchlickCoat,
}

impl MetallicRoughness {
    #[inline]
    fn layers(&self) -> Layers<impl Fn(f32) -> f32, impl Fn(f32) -> Rgb> {
        let (f0, coat) = (self.f0, self.coat);
        Layers {
            ggx: self.ggx,
            base: self.diffuse / coat.mean().max(1e-3),
            base_share: self.diffuse.max_element(),
            specular_share: f0.max_element(),
            transmittance: move |cos| coat.at(cos),
            specular: move |cos| schlick_rgb(f0, cos),
        }
    }

    #[inline]
    pub(super) fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        self.layers().evaluate(wo, wi)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        self.layers().sample(wo, u_lobe, u)
    }

    /// Whether nothing but a mirror-like reflection is left.
    pub(super) fn is_delta(&self) -> bool {
        self.ggx.is_none() && self.diffuse == Rgb::ZERO
    }
}

/// A specular layer over a base of T(wo) T(wi) `base` / pi.
struct Layers<T, F> {
    ggx: Option<Ggx>,
    base: Rgb,
    /// For choosing a layer: how much the base reflects of what reaches it.
    base_share: f32,
    /// For choosing a layer: how much the facets reflect at least.
    specular_share: f32,
    transmittance: T,
    specular: F,
}

impl<T: Fn(f32) -> f32, F: Fn(f32) -> Rgb> Layers<T, F> {
    /// Chance of following the specular layer from `wo`.
    #[inline]
    fn specular_chance(&self, through: f32) -> f32 {
        // Dielectrics reflect what they do not let through; metals at least their reflectance.
        let specular = (1.0 - through).max(self.specular_share);
        let base = through * self.base_share;
        if base <= 0.0 { 1.0 } else { specular / (specular + base) }
    }

    #[inline]
    fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        let through = (self.transmittance)(wo.z);
        let chance = self.specular_chance(through);
        let base = self.base * (through * (self.transmittance)(wi.z) * INV_PI * wi.z);
        let mut eval = Eval { f_cos: base, pdf: (1.0 - chance) * wi.z * INV_PI };
        if let Some(ggx) = &self.ggx {
            let facets = facets_evaluate(ggx, wo, wi, &self.specular);
            eval.f_cos += facets.f_cos;
            eval.pdf += chance * facets.pdf;
        }
        eval
    }

    #[inline]
    fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let through = (self.transmittance)(wo.z);
        let chance = self.specular_chance(through);
        let specular = u_lobe < chance;
        let wi = match (&self.ggx, specular) {
            (None, true) => return Some(BsdfSample::specular(reflect(wo), (self.specular)(wo.z) / chance)),
            (None, false) => {
                // The other lobe is a delta: the weight is this lobe's alone, and nothing cancels.
                let wi = cosine_hemisphere(u);
                let weight = self.base * (through * (self.transmittance)(wi.z) / (1.0 - chance));
                return Some(BsdfSample::reflection(wi, weight, (1.0 - chance) * wi.z * INV_PI));
            }
            (Some(ggx), true) => facets_sample(ggx, wo, u, &self.specular)?.wi,
            (Some(_), false) => cosine_hemisphere(u),
        };
        let eval = self.evaluate(wo, wi);
        (eval.pdf > 0.0).then(|| BsdfSample::reflection(wi, eval.f_cos / eval.pdf, eval.pdf))
    }
}
