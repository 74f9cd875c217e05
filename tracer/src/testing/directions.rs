//! The sphere of directions as a unit square, drawn so that a narrow lobe fills it.

use crate::math::{DVec3, Vec3};

/// How often a part of the square is halved at most.
const DEPTH: u32 = 10;

/// A smooth map of the unit square onto all directions, or onto those of a half space.
///
/// Row coordinate u goes out from the middle of the lobe, column coordinate v around it in turns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Directions {
    around: Around,
    width: f64,
}

#[derive(Debug, Clone, Copy)]
enum Around {
    Axis { axis: DVec3, tangent: DVec3, bitangent: DVec3 },
    Reflection { wo: DVec3 },
}

impl Directions {
    /// About `axis` (any length), for lobes about `width` radians wide. Use 1 where nothing is narrow.
    ///
    /// The angle from the axis follows tan(angle / 2) = width u / (1 - u): half of the square lies within
    /// an angle of about 2 `width`.
    pub(crate) fn about(axis: Vec3, width: f64) -> Self {
        let axis = axis.as_dvec3().normalize();
        let (tangent, bitangent) = axis.any_orthonormal_pair();
        Self { around: Around::Axis { axis, tangent, bitangent }, width }
    }

    /// The directions into which `wo` is mirrored by facets about +z whose slopes are about `width`: for
    /// lobes that are narrow, and at grazing angles far narrower in azimuth than in height. Covers z > 0.
    pub(crate) fn reflections(wo: Vec3, width: f64) -> Self {
        Self { around: Around::Reflection { wo: exact(wo) }, width }
    }

    /// The direction at (u, v), and solid angle per area of the square there.
    pub(crate) fn at(&self, u: f64, v: f64) -> (Vec3, f64) {
        let r = self.width * u / (1.0 - u);
        let dr = std::f64::consts::TAU * self.width / ((1.0 - u) * (1.0 - u));
        let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
        match self.around {
            Around::Axis { axis, tangent, bitangent } => {
                let scale = 1.0 / (1.0 + r * r);
                let d = (tangent * cos + bitangent * sin) * (2.0 * r * scale) + axis * ((1.0 - r * r) * scale);
                (d.as_vec3(), 4.0 * r * scale * scale * dr)
            }
            Around::Reflection { wo } => {
                let scale = 1.0 / (1.0 + r * r).sqrt();
                let m = DVec3::new(r * cos, r * sin, 1.0) * scale;
                let dot = wo.dot(m);
                if dot <= 0.0 {
                    return (Vec3::NEG_Z, 0.0);
                }
                ((m * (2.0 * dot) - wo).as_vec3(), 4.0 * dot * r * scale * scale * scale * dr)
            }
        }
    }

    /// The (u, v) of a direction.
    pub(crate) fn coordinates(&self, d: Vec3) -> (f64, f64) {
        let (x, y, r) = match self.around {
            Around::Axis { axis, tangent, bitangent } => {
                let d = d.as_dvec3().normalize();
                let (x, y, z) = (d.dot(tangent), d.dot(bitangent), d.dot(axis));
                // tan(angle / 2), by whichever form does not cancel.
                let sin = x.hypot(y);
                (x, y, if z > 0.0 { sin / (1.0 + z) } else { (1.0 - z) / sin.max(1e-300) })
            }
            Around::Reflection { wo } => {
                let m = wo + exact(d);
                (m.x, m.y, m.x.hypot(m.y) / m.z.max(1e-300))
            }
        };
        let u = r / (self.width + r);
        let v = y.atan2(x) / std::f64::consts::TAU;
        (u.min(1.0 - 1e-12), if v < 0.0 { v + 1.0 } else { v })
    }

    /// Integrate `f` over the part of the square from `low` to `high`, to about `tolerance` absolute.
    pub(crate) fn integrate_part(
        &self,
        low: [f64; 2],
        high: [f64; 2],
        tolerance: f64,
        f: &mut dyn FnMut(Vec3) -> f64,
    ) -> f64 {
        let whole = self.gauss(low, high, f);
        self.refine(low, high, whole, tolerance, DEPTH, f)
    }

    /// Integrate `f` over all directions, to about `tolerance` absolute.
    pub(crate) fn integrate(&self, tolerance: f64, mut f: impl FnMut(Vec3) -> f64) -> f64 {
        const N: usize = 8;
        let mut sum = 0.0;
        for row in 0..N {
            for column in 0..N {
                let low = [row as f64 / N as f64, column as f64 / N as f64];
                let high = [(row + 1) as f64 / N as f64, (column + 1) as f64 / N as f64];
                sum += self.integrate_part(low, high, tolerance / (N * N) as f64, &mut f);
            }
        }
        sum
    }

    fn refine(
        &self,
        low: [f64; 2],
        high: [f64; 2],
        whole: f64,
        tolerance: f64,
        depth: u32,
        f: &mut dyn FnMut(Vec3) -> f64,
    ) -> f64 {
        let middle = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        let corners = [
            (low, middle),
            ([middle[0], low[1]], [high[0], middle[1]]),
            ([low[0], middle[1]], [middle[0], high[1]]),
            (middle, high),
        ];
        let parts = corners.map(|(low, high)| self.gauss(low, high, f));
        let sum: f64 = parts.iter().sum();
        // The first looks may all miss what a horizon leaves of a cell.
        if depth == 0 || (depth <= DEPTH - 2 && (sum - whole).abs() <= tolerance) {
            return sum;
        }
        let refined = |(i, (low, high)): (usize, &([f64; 2], [f64; 2]))| {
            // An edge cuts half as many cells at each level, each half as wide: the error allowed falls by 2.
            self.refine(*low, *high, parts[i], 0.5 * tolerance, depth - 1, f)
        };
        corners.iter().enumerate().map(refined).sum()
    }

    /// The 3 x 3 point rule of Gauss.
    fn gauss(&self, low: [f64; 2], high: [f64; 2], f: &mut dyn FnMut(Vec3) -> f64) -> f64 {
        const NODES: [(f64, f64); 3] =
            [(-0.774_596_669_241_483_4, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.774_596_669_241_483_4, 5.0 / 18.0)];
        let at = |i: usize, x: f64| 0.5 * (low[i] + high[i]) + 0.5 * (high[i] - low[i]) * x;
        let mut sum = 0.0;
        for (x, wx) in NODES {
            for (y, wy) in NODES {
                let (d, jacobian) = self.at(at(0, x), at(1, y));
                sum += wx * wy * jacobian * f(d);
            }
        }
        sum * (high[0] - low[0]) * (high[1] - low[1])
    }
}

/// A unit vector to more than f32's digits: near the horizon those of z tell the length of x and y.
fn exact(w: Vec3) -> DVec3 {
    let w = w.as_dvec3();
    if w.z.abs() > 0.5 {
        return w.normalize();
    }
    let scale = ((1.0 - w.z * w.z) / (w.x * w.x + w.y * w.y)).sqrt();
    DVec3::new(w.x * scale, w.y * scale, w.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_square_covers_the_sphere_once() {
        for width in [1.0, 0.05, 1e-3] {
            let map = Directions::about(Vec3::new(0.3, -0.2, 0.9), width);
            let area = map.integrate(1e-4, |_| 1.0);
            assert!((area - 4.0 * std::f64::consts::PI).abs() < 1e-2, "{width}: {area}");
            for (u, v) in [(0.1, 0.2), (0.5, 0.9), (0.8, 0.5)] {
                let (u2, v2) = map.coordinates(map.at(u, v).0);
                assert!((u2 - u).abs() < 1e-3 && (v2 - v).abs() < 1e-3, "{width}: {u} {v} {u2} {v2}");
            }
        }
    }

    #[test]
    fn reflections_cover_what_lies_above() {
        for z in [1.0f32, 0.5, 1e-3] {
            let map = Directions::reflections(Vec3::new((1.0 - z * z).sqrt(), 0.0, z), 0.3);
            let area = map.integrate(1e-4, |d| if d.z > 0.0 { 1.0 } else { 0.0 });
            assert!((area - std::f64::consts::TAU).abs() < 2e-2, "{z}: {area}");
            for (u, v) in [(0.1, 0.2), (0.5, 0.9), (0.6, 0.1)] {
                let (d, _) = map.at(u, v);
                if d.z > 0.0 {
                    let (u2, v2) = map.coordinates(d);
                    assert!((u2 - u).abs() < 1e-3 && (v2 - v).abs() < 1e-3, "{z}: {u} {v} {u2} {v2}");
                }
            }
        }
    }

    #[test]
    fn edges_and_spikes_are_integrated() {
        let map = Directions::about(Vec3::Z, 0.1);
        let half = map.integrate(1e-4, |d| if d.x > 0.0 { f64::from(d.z.max(0.0)) } else { 0.0 });
        assert!((half / std::f64::consts::FRAC_PI_2 - 1.0).abs() < 1e-3, "{half}");
    }
}
