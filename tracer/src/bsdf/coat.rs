//! What a coat lets through to the base below it, by angle: tables of directional albedo.
//!
//! A base under a coat of directional albedo E scatters T(wo) T(wi), T = 1 - E, times a constant: that is
//! reciprocal, and with the right constant base and coat together reflect all light where the base does
//! (Kelemen and Szirmay-Kalos 2001). The tables are made by quadrature at a fixed grid, the same on every
//! machine.

use std::sync::OnceLock;

use crate::{
    fresnel::schlick_weight,
    math::{Vec2, Vec3},
    microfacet::Ggx,
};

/// Nodes along the cosine; the i-th is at (i / (NODES - 1))^2, dense at grazing angles.
const NODES: usize = 24;
/// Rows along roughness (the root of alpha).
const ROWS: usize = 24;

/// The cosine of a node.
fn cosine(node: usize) -> f32 {
    let t = node as f32 / (NODES - 1) as f32;
    t * t
}

/// The node at or below a cosine, and the way to the next, 0 to 1.
#[inline]
fn place(cos: f32) -> (usize, f32) {
    let t = cos.clamp(0.0, 1.0).sqrt() * (NODES - 1) as f32;
    let node = (t as usize).min(NODES - 2);
    let (low, high) = (node as f32, (node + 1) as f32);
    (node, ((t * t - low * low) / (high * high - low * low)).clamp(0.0, 1.0))
}

/// 2 times the integral over the cosine of cos times the interpolated nodes.
fn mean(nodes: &[f32; NODES]) -> f32 {
    let mut sum = 0.0;
    for i in 0..NODES - 1 {
        let (a, b) = (f64::from(cosine(i)), f64::from(cosine(i + 1)));
        let (fa, fb) = (f64::from(nodes[i]), f64::from(nodes[i + 1]));
        // Simpson's rule is exact for cos times a straight line.
        let middle = 0.5 * (a + b) * 0.5 * (fa + fb);
        sum += (b - a) / 6.0 * (a * fa + 4.0 * middle + b * fb);
    }
    (2.0 * sum) as f32
}

/// A function of a cosine, between its values at nodes that are dense at grazing angles.
#[derive(Debug, Clone, Copy)]
pub struct ByCosine {
    nodes: [f32; NODES],
}

impl ByCosine {
    /// Of the values of `f`.
    #[must_use]
    pub fn new(f: impl Fn(f32) -> f32) -> Self {
        Self { nodes: std::array::from_fn(|i| f(cosine(i))) }
    }

    /// The value at a cosine.
    #[inline]
    #[must_use]
    pub fn at(&self, cos: f32) -> f32 {
        let (i, t) = place(cos);
        self.nodes[i] + (self.nodes[i + 1] - self.nodes[i]) * t
    }
}

/// Centres of a fixed grid over the unit square.
pub(super) fn grid() -> impl Iterator<Item = Vec2> {
    (0..GRID * GRID).map(|i| Vec2::new((i % GRID) as f32 + 0.5, (i / GRID) as f32 + 0.5) / GRID as f32)
}

/// Points of [`grid`] along each side.
const GRID: usize = 32;

/// Directional albedo of GGX facets with reflectance `f` of the facet's cosine, at `wo`.
fn albedo<const N: usize>(ggx: &Ggx, wo: Vec3, f: impl Fn(f32) -> [f32; N]) -> [f32; N] {
    let mut sum = [0.0f64; N];
    for u in grid() {
        let m = ggx.sample_visible(wo, u);
        let cos = wo.dot(m).clamp(0.0, 1.0);
        let wi = m * (2.0 * cos) - wo;
        if wi.z > 0.0 {
            let g = f64::from(ggx.shadowing(wo, wi));
            for (sum, f) in sum.iter_mut().zip(f(cos)) {
                *sum += g * f64::from(f);
            }
        }
    }
    sum.map(|s| (s / (GRID * GRID) as f64) as f32)
}

/// A direction at this cosine; the smallest stands for 0.
pub(super) fn direction(cos: f32, azimuth: [f32; 2]) -> Vec3 {
    let z = cos.max(1e-4);
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * azimuth[0], r * azimuth[1], z)
}

/// T by cosine, for one coat.
#[derive(Debug, Clone, Copy)]
pub struct Transmittance {
    by_cosine: ByCosine,
    mean: f32,
}

impl Transmittance {
    /// Of a coat whose facets reflect `f` of their cosine. Where it is rougher one way than the other,
    /// the azimuth that reflects most counts, so that no energy is made.
    #[must_use]
    pub fn new(ggx: Option<&Ggx>, f: impl Fn(f32) -> f32) -> Self {
        const AZIMUTHS: [[f32; 2]; 3] =
            [[1.0, 0.0], [0.0, 1.0], [std::f32::consts::FRAC_1_SQRT_2, std::f32::consts::FRAC_1_SQRT_2]];
        let by_cosine = ByCosine::new(|cos| {
            let e = match ggx {
                None => f(cos),
                Some(ggx) => AZIMUTHS
                    .iter()
                    .map(|&azimuth| albedo(ggx, direction(cos, azimuth), |cos| [f(cos)])[0])
                    .fold(0.0, f32::max),
            };
            (1.0 - e).clamp(0.0, 1.0)
        });
        Self { by_cosine, mean: mean(&by_cosine.nodes) }
    }

    /// T at a cosine.
    #[inline]
    #[must_use]
    pub fn at(&self, cos: f32) -> f32 {
        self.by_cosine.at(cos)
    }

    /// 2 times the integral of T cos over the cosine: the share of diffuse light that passes.
    #[inline]
    #[must_use]
    pub fn mean(&self) -> f32 {
        self.mean
    }
}

/// Directional albedos of GGX with Schlick's Fresnel term, for every roughness.
///
/// The albedo is linear in the reflectance at normal incidence: E = F0 (A - B) + B, with A the albedo of
/// facets that reflect everything and B that of facets that reflect (1 - cos)^5.
#[derive(Debug)]
pub struct SplitSum {
    /// A and B by row and node.
    rows: Vec<[[f32; NODES]; 2]>,
    /// Their means over the cosine.
    means: Vec<[f32; 2]>,
}

impl SplitSum {
    /// The tables, made when first asked for.
    pub fn get() -> &'static SplitSum {
        static TABLES: OnceLock<SplitSum> = OnceLock::new();
        TABLES.get_or_init(|| {
            let row = |row: usize| {
                let roughness = row as f32 / (ROWS - 1) as f32;
                let ggx = Ggx::new(roughness * roughness, roughness * roughness);
                let pair = |cos: f32| [1.0, schlick_weight(cos)];
                let pairs: [[f32; 2]; NODES] = std::array::from_fn(|i| match &ggx {
                    None => pair(cosine(i)),
                    Some(ggx) => albedo(ggx, direction(cosine(i), [1.0, 0.0]), pair),
                });
                [0, 1].map(|j| pairs.map(|pair| pair[j]))
            };
            let rows: Vec<_> = (0..ROWS).map(row).collect();
            let means = rows.iter().map(|[a, b]| [mean(a), mean(b)]).collect();
            SplitSum { rows, means }
        })
    }

    /// The coat of this roughness (the root of alpha) and reflectance at normal incidence.
    #[inline]
    #[must_use]
    pub fn coat(&'static self, roughness: f32, f0: f32) -> SchlickCoat {
        let r = roughness.clamp(0.0, 1.0) * (ROWS - 1) as f32;
        let row = (r as usize).min(ROWS - 2);
        SchlickCoat { tables: self, row, t: r - row as f32, f0 }
    }
}

/// One coat out of [`SplitSum`].
#[derive(Debug, Clone, Copy)]
pub struct SchlickCoat {
    tables: &'static SplitSum,
    row: usize,
    t: f32,
    f0: f32,
}

impl SchlickCoat {
    #[inline]
    fn combine(&self, low: [f32; 2], high: [f32; 2]) -> f32 {
        let [a, b] = [0, 1].map(|i| low[i] + (high[i] - low[i]) * self.t);
        (1.0 - (self.f0 * (a - b) + b)).clamp(0.0, 1.0)
    }

    /// T at a cosine.
    #[inline]
    #[must_use]
    pub fn at(&self, cos: f32) -> f32 {
        let (i, t) = place(cos);
        let row = |nodes: &[[f32; NODES]; 2]| [0, 1].map(|j| nodes[j][i] + (nodes[j][i + 1] - nodes[j][i]) * t);
        self.combine(row(&self.tables.rows[self.row]), row(&self.tables.rows[self.row + 1]))
    }

    /// 2 times the integral of T cos over the cosine.
    #[inline]
    #[must_use]
    pub fn mean(&self) -> f32 {
        self.combine(self.tables.means[self.row], self.tables.means[self.row + 1])
    }
}
