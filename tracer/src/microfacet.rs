//! The GGX distribution of microfacet normals (Walter et al. 2007), with Smith's masking and visible
//! normals.
//!
//! Directions are in the local frame, z along the macroscopic normal and upwards. Every quantity is
//! written so that nothing cancels or overflows for small alpha and at grazing angles: the distribution
//! by slopes instead of 1 - cos^2, masking together with the cosines it is divided by.

use crate::math::{Vec2, Vec3, safe_sqrt, sin_cos_turns};

/// Below this alpha in both directions a surface counts as smooth: f32 directions cannot resolve its lobe.
pub const SMOOTH_ALPHA: f32 = 1e-3;

/// A GGX surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ggx {
    /// Roughness along x.
    alpha_x: f32,
    /// Roughness along y.
    alpha_y: f32,
}

impl Ggx {
    /// A surface with these alphas, or `None` where it counts as smooth. An alpha that alone is below
    /// [`SMOOTH_ALPHA`] is raised to it.
    #[inline]
    #[must_use]
    pub fn new(alpha_x: f32, alpha_y: f32) -> Option<Self> {
        // Also false for a NaN, which then counts as smooth.
        (alpha_x >= SMOOTH_ALPHA || alpha_y >= SMOOTH_ALPHA)
            .then(|| Self { alpha_x: alpha_x.max(SMOOTH_ALPHA), alpha_y: alpha_y.max(SMOOTH_ALPHA) })
    }

    /// The greater alpha.
    #[must_use]
    pub fn roughest(&self) -> f32 {
        self.alpha_x.max(self.alpha_y)
    }

    /// Density of microfacet normals per solid angle and macroscopic area; `m.z > 0`.
    #[inline]
    #[must_use]
    pub fn d(&self, m: Vec3) -> f32 {
        let (x, y) = (m.x / self.alpha_x, m.y / self.alpha_y);
        let e = x * x + y * y + m.z * m.z;
        1.0 / (std::f32::consts::PI * self.alpha_x * self.alpha_y * e * e)
    }

    /// |w| after stretching by alpha: cos (1 + 2 Lambda).
    #[inline]
    fn stretched(&self, w: Vec3) -> f32 {
        let (x, y) = (self.alpha_x * w.x, self.alpha_y * w.y);
        (x * x + y * y + w.z * w.z).sqrt()
    }

    /// G2 / (4 |cos_o cos_i|), height-correlated (Heitz 2014, equation 99).
    #[inline]
    #[must_use]
    pub fn visibility(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (zo, zi) = (wo.z.abs(), wi.z.abs());
        0.5 / (zi * self.stretched(wo) + zo * self.stretched(wi))
    }

    /// G2 / G1(wo): the weight of a visible normal, 0 to 1.
    #[inline]
    #[must_use]
    pub fn shadowing(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (zo, zi) = (wo.z.abs(), wi.z.abs());
        let lo = self.stretched(wo);
        zi * (zo + lo) / (zi * lo + zo * self.stretched(wi))
    }

    /// Density of visible normals over wo . m: G1(wo) D(m) / |cos_o|.
    #[inline]
    #[must_use]
    pub fn visible_density(&self, wo: Vec3, m: Vec3) -> f32 {
        2.0 * self.d(m) / (wo.z.abs() + self.stretched(wo))
    }

    /// A normal visible from `wo`, `wo.z > 0` (Dupuy and Benyoub 2023, spherical caps).
    #[inline]
    #[must_use]
    pub fn sample_visible(&self, wo: Vec3, u: Vec2) -> Vec3 {
        let w = Vec3::new(self.alpha_x * wo.x, self.alpha_y * wo.y, wo.z);
        let w = w / w.length();
        let (sin, cos) = sin_cos_turns(u.x);
        // The cap's z and w's add up to a product: written so, nothing cancels.
        let hz = (1.0 - u.y) * (1.0 + w.z);
        let z = hz - w.z;
        let r = safe_sqrt((1.0 - z) * (1.0 + z));
        let h = Vec3::new(r * cos + w.x, r * sin + w.y, hz);
        let m = Vec3::new(self.alpha_x * h.x, self.alpha_y * h.y, h.z.max(1e-12));
        m / m.length()
    }
}

/// The unit vector half-way between two directions above the surface, and its cosine with either;
/// `None` where they oppose each other.
///
/// At grazing angles x and y of the two nearly cancel, and rounding of coordinates near 1 would swamp the
/// half vector. There its component along their difference follows from z alone: for unit vectors
/// (o + i) . (o - i) = 0, so in the plane it is z_i^2 - z_o^2.
#[inline]
#[must_use]
pub fn half_vector(wo: Vec3, wi: Vec3) -> Option<(Vec3, f32)> {
    let mut sum = wo + wi;
    let across = Vec2::new(wo.x - wi.x, wo.y - wi.y);
    let across2 = across.length_squared();
    if across2 > 1.0 {
        let exact = (wi.z - wo.z) * (wi.z + wo.z);
        let correction = (exact - (sum.x * across.x + sum.y * across.y)) / across2;
        sum.x += across.x * correction;
        sum.y += across.y * correction;
    }
    let length = sum.length();
    // Also false for a NaN.
    (length > 1e-15).then(|| (sum / length, 0.5 * length))
}
