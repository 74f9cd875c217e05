//! The GGX distribution of microfacet normals (Walter et al. 2007), with Smith's masking and visible
//! normals.
//!
//! Directions are in the local frame, z along the macroscopic normal and upwards. Every quantity is
//! written so that nothing cancels or overflows for small alpha and at grazing angles: the distribution
//! by slopes instead of 1 - cos^2, masking together with the cosines it is divided by.

use crate::math::{Vec2, Vec3, safe_sqrt, select, sin_cos_turns};

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

    /// Roughness along x and y, each at least [`SMOOTH_ALPHA`].
    pub(crate) fn alphas(&self) -> [f32; 2] {
        [self.alpha_x, self.alpha_y]
    }

    /// The surface that has these [`Ggx::alphas`].
    #[inline(always)]
    pub(crate) fn with_alphas([alpha_x, alpha_y]: [f32; 2]) -> Self {
        Self { alpha_x, alpha_y }
    }

    /// The greater alpha.
    #[must_use]
    pub fn roughest(&self) -> f32 {
        self.alpha_x.max(self.alpha_y)
    }

    /// Density of microfacet normals per solid angle and macroscopic area; `m.z > 0`.
    #[inline(always)]
    #[must_use]
    pub fn d(&self, m: Vec3) -> f32 {
        let (x, y) = (m.x / self.alpha_x, m.y / self.alpha_y);
        let e = x * x + y * y + m.z * m.z;
        1.0 / (std::f32::consts::PI * self.alpha_x * self.alpha_y * e * e)
    }

    /// |w| after stretching by alpha: cos (1 + 2 Lambda).
    #[inline(always)]
    fn stretched(&self, w: Vec3) -> f32 {
        let (x, y) = (self.alpha_x * w.x, self.alpha_y * w.y);
        (x * x + y * y + w.z * w.z).sqrt()
    }

    /// G2 / (4 |cos_o|), height-correlated (Heitz 2014, equation 99): f |cos_i| is this times F D.
    #[inline(always)]
    #[must_use]
    pub fn visibility(&self, wo: Vec3, wi: Vec3) -> f32 {
        0.5 / (self.stretched(wo) + self.stretched(wi) * (wo.z / wi.z).abs())
    }

    /// G2 / G1(wo): the weight of a visible normal, 0 to 1.
    #[inline(always)]
    #[must_use]
    pub fn shadowing(&self, wo: Vec3, wi: Vec3) -> f32 {
        let lo = self.stretched(wo);
        (wo.z.abs() + lo) / (lo + self.stretched(wi) * (wo.z / wi.z).abs())
    }

    /// Density of visible normals over wo . m: G1(wo) D(m) / |cos_o|.
    #[inline(always)]
    #[must_use]
    pub fn visible_density(&self, wo: Vec3, m: Vec3) -> f32 {
        2.0 * self.d(m) / (wo.z.abs() + self.stretched(wo))
    }

    /// A normal visible from `wo`, `wo.z > 0` (Dupuy and Benyoub 2023, spherical caps).
    #[inline(always)]
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
    let (h, cos, some) = half_vector_if_any(wo, wi);
    some.then_some((h, cos))
}

/// The same, and whether there is one. Without branches, so that loops over it become vector code.
#[inline(always)]
pub(crate) fn half_vector_if_any(wo: Vec3, wi: Vec3) -> (Vec3, f32, bool) {
    let sum = wo + wi;
    let across = Vec2::new(wo.x - wi.x, wo.y - wi.y);
    let across2 = across.x * across.x + across.y * across.y;
    let exact = (wi.z - wo.z) * (wi.z + wo.z);
    let correction = (exact - (sum.x * across.x + sum.y * across.y)) / across2;
    let grazing = across2 > 1.0;
    let sum = Vec3::new(
        select(grazing, sum.x + across.x * correction, sum.x),
        select(grazing, sum.y + across.y * correction, sum.y),
        sum.z,
    );
    let length = sum.length();
    // Also false for a NaN.
    (sum / length, 0.5 * length, length > 1e-15)
}

/// The distribution as textbooks write it, alpha^2 / (pi (cos^2 (alpha^2 - 1) + 1)^2): kept for the
/// comparison. In f32 it is wrong below an alpha of 1e-3 and infinite below 1.5e-4.
#[must_use]
pub fn textbook_d(alpha: f32, cos: f32) -> f32 {
    let a2 = alpha * alpha;
    let e = cos * cos * (a2 - 1.0) + 1.0;
    a2 / (std::f32::consts::PI * e * e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Directions, Rng};

    const ALPHAS: [[f32; 2]; 6] = [[1e-3, 1e-3], [0.01, 0.01], [0.1, 0.1], [1.0, 1.0], [0.05, 0.5], [0.01, 1.0]];

    fn at(z: f32, turns: f32) -> Vec3 {
        let (sin, cos) = sin_cos_turns(turns);
        let r = safe_sqrt(1.0 - z * z);
        Vec3::new(r * cos, r * sin, z)
    }

    #[test]
    fn facets_cover_the_surface_once_and_are_seen_once() {
        for [x, y] in ALPHAS {
            let ggx = Ggx::new(x, y).unwrap();
            let around = Directions::about(Vec3::Z, f64::from((x * y).sqrt()));
            let area = around.integrate(1e-4, |m| if m.z > 0.0 { f64::from(ggx.d(m) * m.z) } else { 0.0 });
            assert!((area - 1.0).abs() < 2e-3, "{x} {y}: area {area}");
            for (z, turns) in [(1.0, 0.0), (0.5, 0.1), (0.02, 0.2), (1.745e-4, 0.0)] {
                let wo = at(z, turns);
                let visible = |m: Vec3| f64::from(ggx.visible_density(wo, m) * wo.dot(m).max(0.0));
                let share = around.integrate(1e-4, |m| if m.z > 0.0 { visible(m) } else { 0.0 });
                assert!((share - 1.0).abs() < 5e-3, "{x} {y} {z}: visible {share}");
            }
        }
    }

    #[test]
    fn a_visible_normal_faces_the_viewer() {
        let mut rng = Rng::new(1);
        for [x, y] in ALPHAS {
            let ggx = Ggx::new(x, y).unwrap();
            for _ in 0..20_000 {
                let wo = at(rng.next().max(1e-5) * if rng.next() < 0.5 { 1e-3 } else { 1.0 }, rng.next());
                let m = ggx.sample_visible(wo, rng.next_2d());
                assert!((m.length() - 1.0).abs() < 1e-5 && m.z > 0.0, "{x} {y} {wo}: {m}");
                assert!(wo.dot(m) > -1e-6, "{x} {y} {wo}: {m}");
                let g = ggx.shadowing(wo, at(rng.next(), rng.next()));
                assert!((0.0..=1.000_001).contains(&g), "{g}");
            }
        }
    }

    #[test]
    fn the_distribution_stands_where_the_textbook_form_falls() {
        for alpha in [1.0f32, 0.1, 0.01, 1e-3] {
            let ggx = Ggx::new(alpha, alpha).unwrap();
            for slope in [0.0f32, 0.5, 1.0, 3.0, 20.0] {
                let tan = f64::from(slope) * f64::from(alpha);
                let cos2 = 1.0 / (1.0 + tan * tan);
                let a2 = f64::from(alpha) * f64::from(alpha);
                let e = 1.0 + f64::from(slope) * f64::from(slope);
                let expected = 1.0 / (std::f64::consts::PI * a2 * cos2 * cos2 * e * e);
                let m = Vec3::new((tan * cos2.sqrt()) as f32, 0.0, cos2.sqrt() as f32);
                assert!((f64::from(ggx.d(m)) / expected - 1.0).abs() < 1e-5, "{alpha} {slope}");
            }
        }
        // At the peak, where D = 1 / (pi alpha^2).
        let ratio = |alpha: f32| textbook_d(alpha, 1.0) * std::f32::consts::PI * alpha * alpha;
        assert!((ratio(0.1) - 1.0).abs() < 1e-5);
        assert!((ratio(2e-4) - 0.45).abs() < 0.01, "{}", ratio(2e-4));
        assert!(ratio(1.5e-4).is_infinite());
    }

    #[test]
    fn half_vectors_keep_their_digits_at_grazing_angles() {
        // Both directions within 0.02 degrees of the horizon, half vector known in f64.
        let mut rng = Rng::new(2);
        let (mut naive_worst, mut worst) = (0.0f64, 0.0f64);
        for _ in 0..10_000 {
            let (zo, zi) = (1e-4 + 2e-4 * f64::from(rng.next()), 1e-4 + 2e-4 * f64::from(rng.next()));
            let (xo, xi) = ((1.0 - zo * zo).sqrt(), -(1.0 - zi * zi).sqrt());
            let wo = Vec3::new(xo as f32, 0.0, zo as f32);
            let wi = Vec3::new(xi as f32, 0.0, zi as f32);
            let exact = (zi - zo) * (zi + zo) / (xo - xi) / (zo + zi);
            let (h, cos) = half_vector(wo, wi).unwrap();
            assert!((cos - wo.dot(h)).abs() < 1e-6);
            worst = worst.max((f64::from(h.x / h.z) - exact).abs());
            let naive = (wo + wi).normalize();
            naive_worst = naive_worst.max((f64::from(naive.x / naive.z) - exact).abs());
        }
        assert!(worst < 1e-7, "{worst}");
        assert!(naive_worst > 1e-4, "{naive_worst}: then the correction is not needed");
        assert!(half_vector(Vec3::Z, Vec3::NEG_Z).is_none());
        assert!(half_vector(Vec3::Z, Vec3::splat(f32::NAN)).is_none());
    }

    #[test]
    fn smooth_begins_below_a_thousandth() {
        assert!(Ggx::new(9.99e-4, 0.0).is_none() && Ggx::new(f32::NAN, 0.0).is_none());
        assert_eq!(Ggx::new(0.0, 0.5), Ggx::new(SMOOTH_ALPHA, 0.5));
    }
}
