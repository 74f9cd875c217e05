//! Facets: a triangle, or two that make a flat quadrilateral, held against rays in `f32`.
//!
//! A facet is a plane and two coordinates in it, linear in the point. Rays are rejected, and hits taken for sure, only
//! beyond a bound of all rounding there is: that of the facet's numbers, of these few operations, and of the exact
//! test's own moving and shearing of corners. With M the largest coordinate of facets and origin, d the largest one of
//! the direction and c its product with the plane's normal (which is 1 along its largest axis), each of these moves
//! the point where the ray meets the plane by less than 60 roundings of M d / c, which is 30 of [`f32::EPSILON`];
//! [`BOUND`] is four times that.

use super::{Few, LANES, Rays};
use crate::lanes::{Flag, Lane, NO, WIDTH, block as block_of, block_mut, covering};
use crate::math::select;

/// Error of the ray's parameter, in units of M / c.
const BOUND: f32 = 128.0 * f32::EPSILON;
/// Beyond this a bound might overflow, or not be one.
const LARGEST: f32 = 1e12;
/// Below this a product might lose its last places.
const SMALLEST: f32 = 1e-12;

/// A plane with coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Facet {
    /// The plane: x_w + normal . (x_u, x_v) = offset, w the axis of the facet and u, v those after it.
    normal: [f32; 2],
    offset: f32,
    /// Two coordinates, each linear in (x_u, x_v), 0 in the middle of the quadrilateral or of the longest side's, +-1/2
    /// at its corners.
    beta: [f32; 3],
    gamma: [f32; 3],
    /// Where both coordinates are within `outer`, the ray may hit; within `inner`, it does.
    outer: f32,
    inner: f32,
    /// Above 0 in the first triangle.
    side: [f32; 3],
    /// Change of a coordinate with the point, at most.
    slope: f32,
    /// Its triangles: their bits.
    bits: [[u32; 2]; 2],
}

/// What may be hit, by lane.
#[derive(Debug)]
pub(super) struct Masks {
    /// A bit for each triangle.
    pub triangles: [Lane<u32>; 2],
    /// A bit for each sphere or disk.
    pub others: Lane<u32>,
    /// Whether some triangle is surely hit.
    pub sure: Lane<Flag>,
}

impl Masks {
    pub const NONE: Self = Self { triangles: [[0; WIDTH]; 2], others: [0; WIDTH], sure: [NO; WIDTH] };
}

/// A sphere that holds a primitive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Round {
    center: [f32; 3],
    radius2: f32,
    /// The largest number of these.
    size: f32,
}

impl Round {
    /// Around `x`, `y`, `z`.
    pub fn new([x, y, z, radius]: [f32; 4]) -> Self {
        let size = [x, y, z, radius].into_iter().fold(0.0f32, |most, x| most.max(x.abs()));
        Self { center: [x, y, z], radius2: radius * radius, size }
    }
}

/// The facets of triangles: those of two, if there are to be any, then those of one, each by axis.
pub(super) fn of(triangles: &[[[f32; 3]; 3]], extent: f32, quads: bool) -> [[Vec<Facet>; 3]; 2] {
    let mut facets: [[Vec<Facet>; 3]; 2] = Default::default();
    let mut k = 0;
    while k < triangles.len() {
        let pair = triangles.get(k + 1).filter(|_| quads).and_then(|next| Facet::quad(&triangles[k], next, k, extent));
        let taken = if pair.is_some() { 2 } else { 1 };
        let (axis, facet) = pair.unwrap_or_else(|| Facet::triangle(&triangles[k], k));
        facets[2 - taken][axis].push(facet);
        k += taken;
    }
    facets
}

fn bits(triangle: usize) -> [u32; 2] {
    if triangle < 32 { [1 << triangle, 0] } else { [0, 1 << (triangle - 32)] }
}

impl Facet {
    /// The facet with corner `origin` and sides to `a` and `b`, with its axis; coordinates 0 to 1. None where they span
    /// no plane that `f32` could tell.
    fn plane(origin: [f32; 3], a: [f32; 3], b: [f32; 3]) -> Option<(usize, Facet)> {
        let [o, a, b] = [origin, a, b].map(|p| p.map(f64::from));
        let minus = |p: [f64; 3]| [p[0] - o[0], p[1] - o[1], p[2] - o[2]];
        let (a, b) = (minus(a), minus(b));
        let n = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let w = (0..3).max_by(|&i, &j| n[i].abs().total_cmp(&n[j].abs()))?;
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        let longest = a.iter().chain(&b).fold(0.0f64, |most, x| most.max(x.abs()));
        // A sliver's plane is not known well enough.
        if n[w].abs() <= 1e-6 * longest * longest {
            return None;
        }
        // Cramer's rule: coordinates of a point of the plane from its u and v.
        let beta = [b[v] / n[w], -b[u] / n[w]];
        let gamma = [-a[v] / n[w], a[u] / n[w]];
        let linear = |c: [f64; 2]| [c[0] as f32, c[1] as f32, (-c[0] * o[u] - c[1] * o[v]) as f32];
        let normal = [n[u] / n[w], n[v] / n[w]];
        let slope = |c: [f64; 2]| c[0].abs() + c[1].abs();
        let facet = Facet {
            normal: normal.map(|x| x as f32),
            offset: (o[w] + normal[0] * o[u] + normal[1] * o[v]) as f32,
            beta: linear(beta),
            gamma: linear(gamma),
            outer: 0.0,
            inner: 0.0,
            side: [0.0; 3],
            slope: slope(beta).max(slope(gamma)) as f32,
            bits: [[0; 2]; 2],
        };
        Some((w, facet))
    }

    /// One that every ray may hit, and none surely does.
    fn anything() -> Facet {
        let numbers = [f32::NAN; 3];
        Facet {
            normal: [0.0; 2],
            offset: f32::NAN,
            beta: numbers,
            gamma: numbers,
            outer: 0.0,
            inner: 0.0,
            side: numbers,
            slope: 1.0,
            bits: [[0; 2]; 2],
        }
    }

    /// Move coordinates' zero to the middle.
    fn centred(mut self) -> Self {
        self.beta[2] -= 0.5;
        self.gamma[2] -= 0.5;
        self
    }

    fn triangle(corners: &[[f32; 3]; 3], index: usize) -> (usize, Facet) {
        let [o, a, b] = *corners;
        let (axis, facet) = Self::plane(o, a, b).map_or((2, Self::anything()), |(axis, facet)| (axis, facet.centred()));
        // Inside, both coordinates from 0 to 1 have a sum of at most 1.
        let side = [-1.0, -1.0, 0.0];
        (axis, Facet { outer: 0.5, inner: 0.5, side, bits: [bits(index), [0; 2]], ..facet })
    }

    /// The facet of triangles `index` and `index + 1`, if they make a flat, convex quadrilateral that is nearly a
    /// parallelogram.
    fn quad(first: &[[f32; 3]; 3], second: &[[f32; 3]; 3], index: usize, extent: f32) -> Option<(usize, Facet)> {
        // first = (.., shared, shared, lone) in some rotation, and so second.
        let lone = |t: &[[f32; 3]; 3], other: &[[f32; 3]; 3]| {
            let mut alone = t.iter().enumerate().filter(|(_, p)| !other.contains(p)).map(|(i, _)| i);
            let i = alone.next()?;
            alone.next().is_none().then_some(i)
        };
        let (i, j) = (lone(first, second)?, lone(second, first)?);
        let (a, b) = (first[i], second[j]);
        let (o, opposite) = (first[(i + 1) % 3], first[(i + 2) % 3]);
        let (axis, facet) = Self::plane(o, a, b)?;
        let at = |p: [f32; 3], c: [f32; 3]| {
            let (u, v) = (p[(axis + 1) % 3], p[(axis + 2) % 3]);
            f64::from(c[0]) * f64::from(u) + f64::from(c[1]) * f64::from(v) + f64::from(c[2])
        };
        let height = f64::from(opposite[axis]) + at(opposite, [facet.normal[0], facet.normal[1], -facet.offset]);
        let (p, q) = (at(opposite, facet.beta), at(opposite, facet.gamma));
        // A few roundings are nothing beside `BOUND`.
        let is_flat = height.abs() <= f64::from(4.0 * f32::EPSILON * extent);
        if !is_flat || !(0.8..1.25).contains(&p) || !(0.8..1.25).contains(&q) {
            return None;
        }
        let (outer, inner) = (p.max(q).max(1.0) - 0.5, p.min(q).min(1.0) - 0.5);
        // Towards `a` of the diagonal from `o`: beta q - gamma p, with the middle at zero.
        let side = [q as f32, -p as f32, (0.5 * (q - p)) as f32];
        let facet = facet.centred();
        let bits = [bits(index), bits(index + 1)];
        Some((axis, Facet { outer: outer as f32, inner: inner as f32, side, bits, ..facet }))
    }
}

/// Share of the largest coordinate below which a triangle's least height is too small for [`spared`].
const LEAST_HEIGHT: f64 = 0.01;

/// For each triangle the bits of its facet's: what a ray that leaves from well within the triangle, at no flat angle, need
/// not be held against.
///
/// The exact test would refuse them. The ray begins on the side that it leaves to, by the bounds that
/// [`super::super::offset`] moves it by, so it met the plane at a parameter of at most 0, no further from its origin than a
/// few roundings of the largest coordinate M over the cosine: 2e-5 M for a cosine of 1/16. A 64th of a height of M / 100 is
/// 1.6e-4 M, and that much inside its own triangle the ray's line passes clear of the other one, and has corners of its own
/// both before and behind it, for which the test knows the sign of the parameter.
pub(super) fn spared(triangles: &[[[f32; 3]; 3]], facets: &[[Vec<Facet>; 3]; 2], extent: f32) -> Vec<[u32; 2]> {
    let mut spared = vec![[0; 2]; triangles.len()];
    for facet in facets.iter().flatten().flatten() {
        let [first, second] = facet.bits;
        let both = [first[0] | second[0], first[1] | second[1]];
        for (k, (spared, triangle)) in spared.iter_mut().zip(triangles).enumerate() {
            let [low, high] = bits(k);
            if (both[0] & low | both[1] & high) != 0 && least_height(triangle) > LEAST_HEIGHT * f64::from(extent) {
                *spared = both;
            }
        }
    }
    spared
}

/// Twice the area over the longest side.
fn least_height(triangle: &[[f32; 3]; 3]) -> f64 {
    let [a, b, c] = triangle.map(|p| crate::math::DVec3::from(p.map(f64::from)));
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    (b - a).cross(c - a).length() / longest
}

/// What facets say of a block of rays: where rays may meet the first and the second triangle at the soonest; NaN where
/// they do not.
#[derive(Debug)]
#[repr(align(64))]
pub(super) struct Kept([[[f32; LANES]; 2]; super::MOST_TRIANGLES]);

impl Kept {
    pub const NONE: Self = Self([[[0.0; LANES]; 2]; super::MOST_TRIANGLES]);
}

/// A block of rays.
struct Block {
    origin: [[f32; LANES]; 3],
    direction: [[f32; LANES]; 3],
    /// Errors, times the reciprocal of c: of the parameter, and of the point.
    error: [f32; LANES],
    reach: [f32; LANES],
    /// The end of the ray, or where it surely hits something.
    best: [f32; LANES],
    sure: [Flag; LANES],
}

/// The triangles, spheres and disks that rays may hit. With `ANY`, also whether a ray surely hits a triangle before its
/// end; else only what may be nearest is told.
// Loops over lanes of many arrays at once.
#[allow(clippy::needless_range_loop)]
#[inline(always)]
pub(super) fn held<const ANY: bool>(few: &Few, rays: &Rays, kept: &mut Kept, masks: &mut Masks) {
    for k in 0..covering(rays.n) / LANES {
        let mut block = Block::new(few, rays, k);
        let (mut n, mut found) = (0, [[0u32; LANES]; 2]);
        for (axis, facets) in few.facets[0].iter().enumerate() {
            n = against::<ANY, true>(axis, facets, &mut block, kept, n, &mut found);
        }
        for (axis, facets) in few.facets[1].iter().enumerate() {
            n = against::<ANY, false>(axis, facets, &mut block, kept, n, &mut found);
        }
        if ANY {
            for l in 0..LANES {
                let open = (block.sure[l] ^ 1).wrapping_neg();
                found[0][l] &= open;
                found[1][l] &= open;
            }
        } else {
            for (f, [first, second]) in few.facets.iter().flatten().flatten().zip(&kept.0) {
                let [[a0, a1], [b0, b1]] = f.bits;
                for l in 0..LANES {
                    // What begins after a sure hit is not nearest.
                    let first = u32::from(first[l] <= block.best[l]).wrapping_neg();
                    let second = u32::from(second[l] <= block.best[l]).wrapping_neg();
                    found[0][l] |= first & a0 | second & b0;
                    found[1][l] |= first & a1 | second & b1;
                }
            }
        }
        for (word, found) in found.iter_mut().enumerate() {
            let spared: [u32; LANES] = block_of(&rays.spared[word], k);
            for l in 0..LANES {
                found[l] &= !spared[l];
            }
            *block_mut(&mut masks.triangles[word], k) = *found;
        }
        *block_mut(&mut masks.sure, k) = block.sure;
        *block_mut(&mut masks.others, k) = around(few, &block);
    }
    for i in 0..covering(rays.n) {
        masks.others[i] &= !rays.ended[i];
    }
}

impl Block {
    // Loops over lanes of many arrays at once.
    #[allow(clippy::needless_range_loop)]
    #[inline(always)]
    fn new(few: &Few, rays: &Rays, k: usize) -> Self {
        let (origin, direction) = (rays.origin.block::<LANES>(k), rays.direction.block::<LANES>(k));
        let (mut error, mut reach, mut best) = ([0.0; LANES], [0.0; LANES], block_of(rays.t_max, k));
        for l in 0..LANES {
            let most = |a: f32, b: f32| select(a > b, a, b);
            let size = most(most(origin[0][l].abs(), origin[1][l].abs()), most(origin[2][l].abs(), few.extent));
            let speed = most(most(direction[0][l].abs(), direction[1][l].abs()), direction[2][l].abs());
            // A NaN fails the comparison.
            let safe = (size < LARGEST) & (speed < LARGEST) & (speed > SMALLEST);
            error[l] = select(safe, BOUND * size, f32::INFINITY);
            reach[l] = select(safe, BOUND * size * speed, f32::INFINITY);
            best[l] *= 1.0 + super::WIDEN;
        }
        Self { origin, direction, error, reach, best, sure: [NO; LANES] }
    }
}

/// Hold facets of one axis against a block of rays. With `ANY`, the bits of what may be hit go to `found`; else what is
/// kept goes to `kept` from `n` on. `QUAD`: they have two triangles.
// Loops over lanes of many arrays at once.
#[allow(clippy::needless_range_loop)]
#[inline(always)]
fn against<const ANY: bool, const QUAD: bool>(
    axis: usize,
    facets: &[Facet],
    block: &mut Block,
    kept: &mut Kept,
    mut n: usize,
    found: &mut [[u32; LANES]; 2],
) -> usize {
    let pick = |v: &[[f32; LANES]; 3]| [v[(axis + 1) % 3], v[(axis + 2) % 3], v[axis]];
    let ([ou, ov, ow], [du, dv, dw]) = (pick(&block.origin), pick(&block.direction));
    let (error, reach) = (block.error, block.reach);
    for f in facets {
        let [kept_first, kept_second] = &mut kept.0[n % super::MOST_TRIANGLES];
        n += 1;
        let [[a0, a1], [b0, b1]] = f.bits;
        for l in 0..LANES {
            let c = f.normal[0] * du[l] + f.normal[1] * dv[l] + dw[l];
            let height = f.offset - (f.normal[0] * ou[l] + f.normal[1] * ov[l] + ow[l]);
            let r = 1.0 / c;
            let t = height * r;
            let (u, v) = (ou[l] + t * du[l], ov[l] + t * dv[l]);
            let beta = f.beta[0] * u + f.beta[1] * v + f.beta[2];
            let gamma = f.gamma[0] * u + f.gamma[1] * v + f.gamma[2];
            let size = r.abs();
            let e = reach[l] * size * f.slope;
            let te = error[l] * size;
            let (soonest, latest) = (t - te, t + te);
            let side = f.side[0] * beta + f.side[1] * gamma + f.side[2];
            let (b, g) = (beta.abs(), gamma.abs());
            // A NaN is never out and never sure.
            let out = (b > f.outer + e) | (g > f.outer + e) | (latest < 0.0) | (soonest > block.best[l]);
            let within = f.inner - e;
            let mut sure = (b < within) & (g < within) & (soonest > 1e-30);
            let es = 3.0 * e;
            let (not_first, not_second) = (side < -es, side > es);
            if !QUAD {
                sure &= side > es;
            }
            if ANY {
                let first = u32::from(!(out | not_first)).wrapping_neg();
                let second = u32::from(QUAD & !(out | not_second)).wrapping_neg();
                found[0][l] |= first & a0 | second & b0;
                found[1][l] |= first & a1 | second & b1;
                block.sure[l] |= Flag::from(sure & (latest < block.best[l] * (1.0 - 64.0 * f32::EPSILON)));
            } else {
                let soonest = select(soonest > -f32::MAX, soonest, -f32::MAX);
                kept_first[l] = select(!(out | not_first), soonest, f32::NAN);
                kept_second[l] = select(QUAD & !(out | not_second), soonest, f32::NAN);
                block.best[l] = select(sure & (latest < block.best[l]), latest, block.best[l]);
            }
        }
    }
    n
}

/// The spheres and disks that a block of rays may hit.
#[allow(clippy::needless_range_loop)]
#[inline(always)]
fn around(few: &Few, block: &Block) -> [u32; LANES] {
    let (mut found, mut length) = ([0u32; LANES], [0.0; LANES]);
    for l in 0..LANES {
        let d = [block.direction[0][l], block.direction[1][l], block.direction[2][l]];
        length[l] = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    }
    for (k, (_, round)) in few.others.iter().enumerate() {
        for l in 0..LANES {
            let o: [f32; 3] = [
                block.origin[0][l] - round.center[0],
                block.origin[1][l] - round.center[1],
                block.origin[2][l] - round.center[2],
            ];
            let d = [block.direction[0][l], block.direction[1][l], block.direction[2][l]];
            let a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let b = o[0] * d[0] + o[1] * d[1] + o[2] * d[2];
            let o2 = o[0] * o[0] + o[1] * o[1] + o[2] * o[2];
            let c = o2 - round.radius2;
            // Differences are off by a rounding of what they were made of, and everything by a dozen of its own size.
            let size = block.origin[0][l].abs() + block.origin[1][l].abs() + block.origin[2][l].abs() + round.size;
            let e = 32.0 * f32::EPSILON * size * size;
            let safe = (a > 1e-20) & (a < 1e20) & (size < 1e10) & (size > 1e-10);
            let clear = (b * b - a * c < -4.0 * a * e) | (c > e) & (b > 16.0 * f32::EPSILON * size * length[l]);
            found[l] |= u32::from(!(clear & safe)) << k;
        }
    }
    found
}
