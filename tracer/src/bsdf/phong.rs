//! The older models: Phong's lobe, Blinn and Phong's, and Blinn's distribution in a microfacet model.
//!
//! Defined as scenes that name them expect (the UCSD CSE 168 course's renderer): each gives f |cos wi|
//! itself. Exponents are used up to [`GREATEST_EXPONENT`], about GGX's alpha of 1e-3.

use super::{
    BsdfSample, Eval,
    coat::{ByCosine, direction, grid},
    reflect,
};
use crate::{
    fresnel::schlick_rgb,
    math::{Frame, Rgb, TAU, Vec2, Vec3, exp, sin_cos_turns},
    microfacet::half_vector,
};

/// Exponents above this are used as this one: f32 directions cannot resolve a narrower lobe.
pub const GREATEST_EXPONENT: f32 = 2e6;

/// cos^n of a small angle, from the square of its sine: near 1 the cosine itself has too few digits.
#[inline]
fn power(sin2: f32, cos: f32, n: f32) -> f32 {
    if n == 0.0 {
        1.0
    } else if sin2 < 0.5 {
        exp(0.5 * n * libm::log1pf(-sin2))
    } else if cos > 0.0 {
        exp(n * libm::logf(cos))
    } else {
        0.0
    }
}

/// A direction about +z with density (n + 1)/(2 pi) cos^n.
#[inline]
fn sample_power(n: f32, u: Vec2) -> Vec3 {
    // cos = (1 - u)^(1 / (n + 1)), and 1 - cos^2 without cancelling.
    let ln_cos = libm::log1pf(-u.y) / (n + 1.0);
    let sin = (-libm::expm1f(2.0 * ln_cos)).max(0.0).sqrt();
    let (s, c) = sin_cos_turns(u.x);
    Vec3::new(sin * c, sin * s, exp(ln_cos).max(1e-12))
}

/// Phong's lobe about the mirror direction r: f cos = reflectance (n + 1)/(2 pi) (r . wi)^n. Not
/// reciprocal; what it sends below the horizon is lost.
#[derive(Debug, Clone, Copy)]
pub struct Phong {
    /// Share of light reflected, 0 to 1.
    pub reflectance: Rgb,
    /// Exponent, at least 0.
    pub exponent: f32,
}

impl Phong {
    #[inline]
    pub(super) fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        let r = reflect(wo);
        let cos = r.dot(wi);
        if cos.is_nan() || cos <= 0.0 {
            return Eval::ZERO;
        }
        let sin2 = r.cross(wi).length_squared();
        let pdf = (self.exponent + 1.0) / TAU * power(sin2, cos, self.exponent);
        Eval { f_cos: self.reflectance * pdf, pdf }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let wi = Frame::from_normal(reflect(wo)).to_world(sample_power(self.exponent, u));
        if wi.z.is_nan() || wi.z <= 0.0 {
            return None;
        }
        let pdf = self.evaluate(wo, wi).pdf;
        (pdf > 0.0).then(|| BsdfSample::reflection(wi, self.reflectance, pdf))
    }
}

/// Blinn and Phong's lobe about the half vector h, with Schlick's term:
/// f cos = F (n + 2)/(4 pi (2 - 2^(-n/2))) (h . n)^n. It is f cos that is symmetric, not f.
#[derive(Debug, Clone, Copy)]
pub struct BlinnPhong {
    /// Reflectance at normal incidence, 0 to 1.
    pub reflectance: Rgb,
    /// Exponent, at least 0.
    pub exponent: f32,
    /// (n + 2)/(4 pi (2 - 2^(-n/2))).
    scale: f32,
}

impl BlinnPhong {
    /// A lobe of this exponent.
    #[inline]
    #[must_use]
    pub fn new(reflectance: Rgb, exponent: f32) -> Self {
        let scale = (exponent + 2.0) / (2.0 * TAU * (2.0 - exp(-0.5 * std::f32::consts::LN_2 * exponent)));
        Self { reflectance, exponent, scale }
    }

    #[inline]
    pub(super) fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        let Some((h, cos)) = half_vector(wo, wi) else { return Eval::ZERO };
        let lobe = power(h.x * h.x + h.y * h.y, h.z, self.exponent);
        let f_cos = schlick_rgb(self.reflectance, cos) * (self.scale * lobe);
        Eval { f_cos, pdf: (self.exponent + 1.0) / (4.0 * TAU * cos) * lobe }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let (wi, cos) = mirrored(wo, sample_power(self.exponent, u))?;
        let weight = schlick_rgb(self.reflectance, cos) * (self.scale * 4.0 * TAU * cos / (self.exponent + 1.0));
        let pdf = self.evaluate(wo, wi).pdf;
        (pdf > 0.0).then(|| BsdfSample::reflection(wi, weight, pdf))
    }
}

/// The facets of [`BlinnMicrofacet`].
#[derive(Debug, Clone, Copy)]
pub struct BlinnFacets {
    /// Exponent, at least 0.
    pub exponent: f32,
    /// Directional albedo of facets that reflect everything where it is above 1, else 1.
    excess: ByCosine,
}

impl BlinnFacets {
    /// Facets of this exponent.
    #[must_use]
    pub fn new(exponent: f32) -> Self {
        let bare = Self { exponent, excess: ByCosine::new(|_| 1.0) };
        let excess = |cos: f32| {
            let wo = direction(cos, [1.0, 0.0]);
            let weight = |u: Vec2| {
                let h = sample_power(exponent + 1.0, u);
                mirrored(wo, h)
                    .map_or(0.0, |(wi, cos)| f64::from(bare.masking(wo) * bare.masking(wi) * wi.z * cos / h.z))
            };
            let (sum, n) = grid().fold((0.0, 0.0), |(sum, n), u| (sum + weight(u), n + 1.0));
            // With a margin for the grid and for the straight lines between nodes.
            (1.005 * sum / n).max(1.0) as f32
        };
        // Above this exponent there is none.
        if exponent < 32.0 { Self { exponent, excess: ByCosine::new(excess) } } else { bare }
    }

    /// G1(w) / cos w, finite at grazing angles.
    #[inline]
    fn masking(&self, w: Vec3) -> f32 {
        let sin = (w.x * w.x + w.y * w.y).sqrt();
        // a = scale cos / sin.
        let scale = (0.5 * self.exponent + 1.0).sqrt();
        if scale * w.z >= 1.6 * sin {
            return 1.0 / w.z;
        }
        let a = scale * w.z / sin;
        (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a)) * (scale / sin)
    }

    /// G cos wi / (cos wo cos wi), with the excess taken out on both sides.
    #[inline]
    fn geometry(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.masking(wo) * self.masking(wi) * wi.z / (self.excess.at(wo.z) * self.excess.at(wi.z))
    }
}

/// Blinn's distribution D = (n + 2)/(2 pi) (h . n)^n in a microfacet model, with Schlick's term and
/// Smith's G in the rational form of Walter et al. 2007: f cos = F D G / (4 cos wo).
///
/// That form was fitted to Beckmann's distribution. With Blinn's it reflects more than arrives at grazing
/// angles where the exponent is below about 16 (up to 1.34 times, at exponent 0); there f is divided by
/// the excess at `wo` and at `wi`, and so stays reciprocal.
#[derive(Debug, Clone, Copy)]
pub struct BlinnMicrofacet {
    /// Reflectance at normal incidence, 0 to 1.
    pub reflectance: Rgb,
    /// Facets.
    pub facets: BlinnFacets,
}

impl BlinnMicrofacet {
    #[inline]
    pub(super) fn evaluate(&self, wo: Vec3, wi: Vec3) -> Eval {
        let Some((h, cos)) = half_vector(wo, wi) else { return Eval::ZERO };
        let n = self.facets.exponent;
        let d = (n + 2.0) / TAU * power(h.x * h.x + h.y * h.y, h.z, n);
        let f_cos = schlick_rgb(self.reflectance, cos) * (0.25 * d * self.facets.geometry(wo, wi));
        Eval { f_cos, pdf: 0.25 * d * h.z / cos }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        // D cos h is the density of normals per macroscopic area.
        let h = sample_power(self.facets.exponent + 1.0, u);
        let (wi, cos) = mirrored(wo, h)?;
        let pdf = self.evaluate(wo, wi).pdf;
        (pdf > 0.0).then(|| {
            let weight = schlick_rgb(self.reflectance, cos) * (self.facets.geometry(wo, wi) * cos / h.z);
            BsdfSample::reflection(wi, weight, pdf)
        })
    }
}

/// The reflection of `wo` in a facet, and the cosine at it; `None` below the horizon.
#[inline]
fn mirrored(wo: Vec3, h: Vec3) -> Option<(Vec3, f32)> {
    let cos = wo.dot(h).min(1.0);
    let wi = h * (2.0 * cos) - wo;
    (cos > 0.0 && wi.z > 0.0).then_some((wi, cos))
}
