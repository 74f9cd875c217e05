//! Choosing one of many lights for a place: a walk down a tree of bounds.
//!
//! After Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting" (2018),
//! without the splitting. At every node one of the two children is taken with probability in proportion to
//! how much it may matter: its intensity, over the square of its distance, times cosines at both ends, each
//! at its largest within the child's bounds. Sampling and evaluating walk the same way with the same
//! function, so both find the same probability to the bit.
//!
//! Distances are clamped to the radius of the bounds; both are lengths and enter squared, so the unit that
//! a scene is measured in cancels. (A clamp that compares a square with a length, as is often written,
//! makes the choice depend on that unit: `textbook::mixed_importance`.)

use super::cone::Cone;
use crate::math::{DVec3, Vec3, safe_sqrt};

/// Bins a range of centroids is sorted into, each axis.
const BINS: usize = 12;
/// From this depth on nodes are halved, which bounds the depth by this and the bits of a count.
const DEEPEST_CHOICE: u32 = 32;

/// What the tree knows of a light.
#[derive(Debug, Clone, Copy)]
pub(super) struct LightBounds {
    /// Corners of the box that holds it.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    /// Where its surface faces.
    pub(super) cone: Cone,
    /// Whether the back shines too.
    pub(super) two_sided: bool,
    /// Radiant intensity in the direction of most, any unit. The paper has power, which ranks a point
    /// light four times above a surface that is as bright.
    pub(super) intensity: f64,
}

impl LightBounds {
    fn union(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            cone: self.cone.union(other.cone),
            two_sided: self.two_sided || other.two_sided,
            intensity: self.intensity + other.intensity,
        }
    }

    fn center(&self) -> Vec3 {
        self.low * 0.5 + self.high * 0.5
    }

    /// Intensity x orientation x area: what it costs to keep these lights together (equation 2).
    fn cost(&self) -> f64 {
        let size = (self.high - self.low).as_dvec3();
        let area = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        // A bundle of lights on a line has no area; its length still tells short from long.
        self.intensity * f64::from(self.cone.measure()) * (area + 1e-6 * size.length_squared())
    }
}

/// A tree over lights at finite distance.
#[derive(Debug, Clone)]
pub(super) struct LightTree {
    nodes: Vec<Node>,
    /// For every light the turns from the root to it, first turn in the lowest bit: 1 is right.
    trails: Vec<u64>,
    /// Lengths are multiplied by this power of 2, so that the tree is about 1 long.
    scale: f32,
}

/// 48 bytes. A left child follows its parent.
#[derive(Debug, Clone, Copy)]
struct Node {
    center: Vec3,
    radius2: f32,
    axis: Vec3,
    cos_spread: f32,
    sin_spread: f32,
    /// Share of the intensity of all.
    intensity: f32,
    two_sided: bool,
    is_leaf: bool,
    /// The light of a leaf; else the right child.
    index: u32,
}

impl LightTree {
    /// A tree over these lights; `None` where there are none.
    pub(super) fn new(lights: &[LightBounds]) -> Option<Self> {
        let whole = lights.iter().copied().reduce(LightBounds::union)?;
        let size = (whole.high - whole.low).max_element();
        // A power of 2 rounds nothing, so scenes scaled by one are sampled alike to the bit.
        let scale = if size > 0.0 && size.is_finite() { power_of_two_below(1.0 / size) } else { 1.0 };
        let mut builder = Builder {
            lights,
            total: whole.intensity.max(f64::MIN_POSITIVE),
            tree: Self { nodes: Vec::with_capacity(2 * lights.len() - 1), trails: vec![0; lights.len()], scale },
        };
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        builder.build(&mut order, 0, 0);
        Some(builder.tree)
    }

    /// The light that `u` chooses for the reference point `p` with normal `n` (0 for none), and its
    /// probability; `None` where no light matters.
    #[inline]
    pub(super) fn sample(&self, p: Vec3, n: Vec3, mut u: f64) -> Option<(u32, f32)> {
        let p = p * self.scale;
        let (mut at, mut probability) = (0, 1.0);
        loop {
            let node = &self.nodes[at];
            if node.is_leaf {
                return Some((node.index, probability));
            }
            let (left, right) = (at + 1, node.index as usize);
            let left_share = share(self.nodes[left].importance(p, n), self.nodes[right].importance(p, n))?;
            let edge = f64::from(left_share);
            if u < edge {
                u /= edge;
                probability *= left_share;
                at = left;
            } else {
                u = (u - edge) / (1.0 - edge);
                probability *= 1.0 - left_share;
                at = right;
            }
            u = u.min(1.0 - f64::EPSILON);
        }
    }

    /// The probability with which [`LightTree::sample`] chooses `light`.
    #[inline]
    pub(super) fn probability(&self, p: Vec3, n: Vec3, light: u32) -> f32 {
        let p = p * self.scale;
        let mut trail = self.trails[light as usize];
        let (mut at, mut probability) = (0, 1.0);
        while !self.nodes[at].is_leaf {
            let (left, right) = (at + 1, self.nodes[at].index as usize);
            let left_share = share(self.nodes[left].importance(p, n), self.nodes[right].importance(p, n));
            let Some(left_share) = left_share else { return 0.0 };
            if trail & 1 == 0 {
                probability *= left_share;
                at = left;
            } else {
                probability *= 1.0 - left_share;
                at = right;
            }
            trail >>= 1;
        }
        probability
    }
}

/// Probability of the left of two children; `None` where neither matters. Neither of two that matter gets
/// none.
#[inline]
fn share(left: f32, right: f32) -> Option<f32> {
    const LEAST: f32 = f32::EPSILON;
    match (left > 0.0, right > 0.0) {
        (true, true) => Some((left / (left + right)).clamp(LEAST, 1.0 - LEAST)),
        (true, false) => Some(1.0),
        (false, true) => Some(0.0),
        (false, false) => None,
    }
}

/// What a group of lights of this intensity may matter, orientations left out: the squared distance is
/// clamped by the squared radius of the group's bounds, so the unit of length cancels between groups.
#[inline]
#[must_use]
pub fn group_importance(intensity: f32, distance2: f32, radius2: f32) -> f32 {
    // The last clamp keeps a light at the very point finite; a tree is about 1 long.
    intensity / distance2.max(radius2).max(1e-24)
}

impl Node {
    /// How much the lights below may matter at `p`: section 4.2 and equation 3. Not below 0, and finite.
    #[inline]
    fn importance(&self, p: Vec3, n: Vec3) -> f32 {
        let to = self.center - p;
        let distance2 = to.length_squared();
        let importance = group_importance(self.intensity, distance2, self.radius2);
        if distance2 <= self.radius2 {
            // Inside the bounding sphere light may come from anywhere.
            return importance;
        }
        let wi = to / distance2.sqrt();
        // Half angle of the cone around the bounding sphere.
        let sin2_bounds = self.radius2 / distance2;
        let (sin_bounds, cos_bounds) = (sin2_bounds.sqrt(), (1.0 - sin2_bounds).sqrt());
        let cos_axis = -wi.dot(self.axis);
        let cos_axis = if self.two_sided { cos_axis.abs() } else { cos_axis };
        let (sin, cos) = shrink(safe_sqrt(1.0 - cos_axis * cos_axis), cos_axis, self.sin_spread, self.cos_spread);
        let (_, cos_light) = shrink(sin, cos, sin_bounds, cos_bounds);
        let mut importance = importance * cos_light.max(0.0);
        if n != Vec3::ZERO {
            let cos_surface = wi.dot(n);
            let (_, cos) = shrink(safe_sqrt(1.0 - cos_surface * cos_surface), cos_surface, sin_bounds, cos_bounds);
            importance *= cos.max(0.0);
        }
        importance
    }
}

/// Sine and cosine of max(0, a - b), both angles within 0 to pi.
#[inline]
fn shrink(sin_a: f32, cos_a: f32, sin_b: f32, cos_b: f32) -> (f32, f32) {
    if cos_a >= cos_b {
        return (0.0, 1.0);
    }
    (sin_a * cos_b - cos_a * sin_b, cos_a * cos_b + sin_a * sin_b)
}

struct Builder<'a> {
    lights: &'a [LightBounds],
    total: f64,
    tree: LightTree,
}

impl Builder<'_> {
    /// Build the node over the lights in `order`, `depth` turns down the trail `trail`.
    fn build(&mut self, order: &mut [u32], depth: u32, trail: u64) -> LightBounds {
        let at = self.tree.nodes.len();
        if let [light] = *order {
            let bounds = self.lights[light as usize];
            self.tree.nodes.push(self.node(&bounds, true, light));
            self.tree.trails[light as usize] = trail;
            return bounds;
        }
        let middle = if depth < DEEPEST_CHOICE { self.split(order) } else { None }.unwrap_or_else(|| {
            order.sort_unstable();
            order.len() / 2
        });
        // Its place comes before its children's; what it says comes after theirs is known.
        self.tree.nodes.push(self.node(&self.lights[order[0] as usize], false, 0));
        let (left, right) = order.split_at_mut(middle);
        let left = self.build(left, depth + 1, trail);
        let right_at = self.tree.nodes.len() as u32;
        let right = self.build(right, depth + 1, trail | 1 << depth);
        let bounds = left.union(right);
        self.tree.nodes[at] = self.node(&bounds, false, right_at);
        bounds
    }

    fn node(&self, bounds: &LightBounds, is_leaf: bool, index: u32) -> Node {
        let scale = f64::from(self.tree.scale);
        let half: DVec3 = (bounds.high.as_dvec3() - bounds.low.as_dvec3()) * (0.5 * scale);
        let spread = f64::from(bounds.cone.spread);
        Node {
            center: bounds.center() * self.tree.scale,
            // A little more: the centre is rounded.
            radius2: (half.length_squared() * (1.0 + 1e-6)) as f32,
            axis: bounds.cone.axis,
            cos_spread: libm::cos(spread) as f32,
            sin_spread: libm::sin(spread) as f32,
            intensity: (bounds.intensity / self.total) as f32,
            two_sided: bounds.two_sided,
            is_leaf,
            index,
        }
    }

    /// Sort `order` into the two parts that cost least together, and give the size of the first; `None`
    /// where all lights are in one place.
    fn split(&self, order: &mut [u32]) -> Option<usize> {
        let center = |light: u32| self.lights[light as usize].center();
        let (low, high) = order.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &light| {
            (low.min(center(light)), high.max(center(light)))
        });
        let size = high - low;
        let bin = |light: u32, axis: usize| {
            ((((center(light)[axis] - low[axis]) / size[axis]) * BINS as f32) as usize).min(BINS - 1)
        };
        let mut best: Option<(f64, usize, usize)> = None;
        for axis in (0..3).filter(|&axis| size[axis] > 0.0 && size[axis].is_finite()) {
            let mut bins: [Option<LightBounds>; BINS] = [None; BINS];
            for &light in order.iter() {
                let slot = &mut bins[bin(light, axis)];
                let bounds = self.lights[light as usize];
                *slot = Some(slot.map_or(bounds, |b| b.union(bounds)));
            }
            // Cost of the bins from each on, from the right; then from the left beside it. Cuts after an
            // empty bin repeat the one before.
            let mut after = [0.0; BINS];
            let mut right: Option<LightBounds> = None;
            for i in (1..BINS).rev() {
                if let Some(bounds) = bins[i] {
                    let joined = right.map_or(bounds, |r| r.union(bounds));
                    right = Some(joined);
                    after[i] = joined.cost();
                } else {
                    after[i] = after.get(i + 1).copied().unwrap_or(0.0);
                }
            }
            // Thin bounds are cut across (section 4.4).
            let stretch = f64::from(size.max_element() / size[axis]);
            let mut left: Option<LightBounds> = None;
            for i in 0..BINS - 1 {
                let Some(bounds) = bins[i] else { continue };
                let joined = left.map_or(bounds, |l| l.union(bounds));
                left = Some(joined);
                if bins[i + 1..].iter().all(Option::is_none) {
                    break;
                }
                let cost = stretch * (joined.cost() + after[i + 1]);
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, axis, i));
                }
            }
        }
        let (_, axis, last) = best?;
        // Within the parts the order stays as it was: the same tree in every run.
        order.sort_by_key(|&light| bin(light, axis) > last);
        let first = order.partition_point(|&light| bin(light, axis) <= last);
        (first > 0 && first < order.len()).then_some(first)
    }
}

/// The largest power of 2 at or below a positive normal number.
fn power_of_two_below(x: f32) -> f32 {
    let exponent = x.to_bits() & 0x7f80_0000;
    if (0x0080_0000..0x7f80_0000).contains(&exponent) { f32::from_bits(exponent) } else { 1.0 }
}
