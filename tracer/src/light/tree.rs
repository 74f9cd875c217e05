//! Choosing one of many lights for a place: a walk down a tree of bounds.
//!
//! After Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting" (2018),
//! without the splitting. At every node one of four children is taken with probability in proportion to how
//! much it may matter: its intensity, over the square of its distance, times cosines at both ends, each at
//! its largest within the child's bounds. Sampling and evaluating walk the same way with the same function,
//! so both find the same probability to the bit. The tree is built with two children a node and every other
//! level is then left out; four children lie side by side in memory and are weighed at once. Four lights or fewer are the
//! children of one node.
//!
//! Distances are clamped to the radius of the bounds; both are lengths and enter squared, so the unit that
//! a scene is measured in cancels. (A clamp that compares a square with a length, as is often written,
//! makes the choice depend on that unit: `textbook::mixed_importance`.)

use super::{cone::Cone, of_child};
use crate::{
    geometry::prefetch,
    lanes::{self, stage},
    math::{DVec3, Vec3, select},
};

/// Bins a range of centroids is sorted into, each axis.
const BINS: usize = 12;
/// From this depth on nodes are halved, which bounds the depth by this and the bits of a count.
const DEEPEST_CHOICE: u32 = 32;

/// Keeps a light at the very point finite; a tree is about 1 long.
const LEAST_DISTANCE2: f32 = 1e-24;

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
    /// For every light the turns from the root to it, two bits each, the first lowest.
    trails: Vec<u64>,
    /// Lengths are multiplied by this power of 2, so that the tree is about 1 long.
    scale: f32,
}

/// A walk down the tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Walk {
    p: Vec3,
    n: Vec3,
    u: f64,
    at: u32,
    probability: f32,
    done: bool,
    /// At its end: the light and its probability, where one matters.
    pub(super) found: Option<(u32, f32)>,
}

impl Walk {
    /// For the reference point `p` with normal `n` (0 for none), by the number `u`.
    #[inline(always)]
    pub(super) fn new(p: Vec3, n: Vec3, u: f64) -> Self {
        Self { p, n, u, at: 0, probability: 1.0, done: false, found: None }
    }

    /// To the child of `node` that the number chooses, by how much each matters. Whether that was the end.
    #[inline(always)]
    fn go(&mut self, node: &Node, importance: &[f32; WIDTH]) -> bool {
        self.done = true;
        let Some(shares) = shares(importance) else { return true };
        let share = shares.map(f64::from);
        let edges = [0.0, share[0], share[0] + share[1], share[0] + share[1] + share[2]];
        let mut chosen = edges[1..].iter().map(|&edge| usize::from(self.u >= edge)).sum::<usize>();
        if shares[chosen] == 0.0 {
            // The shares add up to 1 but for rounding, which is the last one's.
            match shares.iter().rposition(|&share| share > 0.0) {
                Some(last) => chosen = last,
                None => return true,
            }
        }
        self.probability *= shares[chosen];
        self.u = ((self.u - edges[chosen]) / share[chosen]).min(1.0 - f64::EPSILON);
        self.at = node.index[chosen];
        self.done = self.at & LEAF != 0;
        if self.done {
            self.found = Some((self.at & !LEAF, self.probability));
        }
        self.done
    }

    /// One that goes nowhere.
    pub(super) const NONE: Self =
        Self { p: Vec3::ZERO, n: Vec3::ZERO, u: 0.0, at: 0, probability: 0.0, done: true, found: None };
}

stage! {
    /// [`LightTree::sample`] for up to 64 at once, a level at a time and [`TOGETHER`] in one vector: one walk waits for
    /// memory and for its own arithmetic at every node, many fill each other's gaps.
    pub(super) fn sample_all(tree: &LightTree, walks: &mut [Walk]) {
        let (mut going, mut n) = ([0usize; lanes::WIDTH], 0);
        for (i, _) in walks.iter().enumerate().filter(|(_, walk)| !walk.done).take(lanes::WIDTH) {
            going[n] = i;
            n += 1;
        }
        while n > 0 {
            let mut left = 0;
            for from in (0..n).step_by(TOGETHER) {
                // The last few repeat one of them.
                let ids: [usize; TOGETHER] = std::array::from_fn(|k| going[(from + k).min(n - 1)]);
                let at = ids.map(|i| (&tree.nodes[walks[i].at as usize], walks[i].p * tree.scale, walks[i].n));
                let mut importance = [[0.0; WIDTH]; TOGETHER];
                importances(&at, &mut importance);
                for k in 0..TOGETHER.min(n - from) {
                    let walk = &mut walks[ids[k]];
                    if !walk.go(at[k].0, &importance[k]) {
                        going[left] = ids[k];
                        left += 1;
                        // There by the time that this walk has its next turn.
                        prefetch(&tree.nodes[walk.at as usize]);
                    }
                }
            }
            n = left;
        }
    }
}

/// Walks whose nodes are weighed at once: sixteen children.
const TOGETHER: usize = 4;

/// Children of a node.
const WIDTH: usize = 4;
/// Marks the index of a child that is a light.
const LEAF: u32 = 1 << 31;

/// Four children, a lane each. Those that are missing have no intensity. Three cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Node {
    center: [[f32; WIDTH]; 3],
    radius2: [f32; WIDTH],
    axis: [[f32; WIDTH]; 3],
    cos_spread: [f32; WIDTH],
    sin_spread: [f32; WIDTH],
    /// Share of the intensity of all.
    intensity: [f32; WIDTH],
    /// Bits of a cosine to keep: without its sign where both sides shine.
    sides: [u32; WIDTH],
    /// A node, or with [`LEAF`] a light.
    index: [u32; WIDTH],
}

impl LightTree {
    /// A tree over these lights, fewer than 2^31 of them; `None` where there are none.
    pub(super) fn new(lights: &[LightBounds]) -> Option<Self> {
        let whole = lights.iter().copied().reduce(LightBounds::union)?;
        let size = (whole.high - whole.low).max_element();
        // A power of 2 rounds nothing, so scenes scaled by one are sampled alike to the bit.
        let scale = if size > 0.0 && size.is_finite() { power_of_two_below(1.0 / size) } else { 1.0 };
        let mut builder = Builder {
            lights,
            total: whole.intensity.max(f64::MIN_POSITIVE),
            tree: Self { nodes: Vec::new(), trails: vec![0; lights.len()], scale },
        };
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        builder.build(&mut order, 0, 0);
        Some(builder.tree)
    }

    /// The light that `u` chooses for the reference point `p` with normal `n` (0 for none), and its
    /// probability; `None` where no light matters.
    #[inline]
    pub(super) fn sample(&self, p: Vec3, n: Vec3, u: f64) -> Option<(u32, f32)> {
        let mut walk = Walk::new(p, n, u);
        loop {
            let node = &self.nodes[walk.at as usize];
            if walk.go(node, &node.importance(p * self.scale, n)) {
                return walk.found;
            }
        }
    }

    /// The root and the light of each of its children, where those are all; that of a missing child is any.
    pub(super) fn root(&self) -> Option<(Root, [u32; WIDTH])> {
        let [node] = &self.nodes[..] else { return None };
        let children = [node.child(0), node.child(1), node.child(2), node.child(3)];
        Some((Root { children, scale: self.scale }, node.index.map(|index| index & !LEAF)))
    }

    /// The probability with which [`LightTree::sample`] chooses `light`.
    #[inline]
    pub(super) fn probability(&self, p: Vec3, n: Vec3, light: u32) -> f32 {
        let p = p * self.scale;
        let mut trail = self.trails[light as usize];
        let (mut at, mut probability) = (0, 1.0);
        loop {
            let node = &self.nodes[at];
            let Some(shares) = shares(&node.importance(p, n)) else { return 0.0 };
            let lane = (trail & 3) as usize;
            trail >>= 2;
            probability *= shares[lane];
            let index = node.index[lane];
            if index & LEAF != 0 || probability == 0.0 {
                return probability;
            }
            at = index as usize;
        }
    }
}

/// What a group of lights of this intensity may matter, orientations left out: the squared distance is
/// clamped by the squared radius of the group's bounds, so the unit of length cancels between groups.
#[inline]
#[must_use]
pub fn group_importance(intensity: f32, distance2: f32, radius2: f32) -> f32 {
    intensity / distance2.max(radius2).max(LEAST_DISTANCE2)
}

impl Node {
    const EMPTY: Self = Self {
        center: [[0.0; WIDTH]; 3],
        radius2: [0.0; WIDTH],
        axis: [[0.0; WIDTH]; 3],
        cos_spread: [0.0; WIDTH],
        sin_spread: [0.0; WIDTH],
        intensity: [0.0; WIDTH],
        sides: [u32::MAX; WIDTH],
        index: [LEAF; WIDTH],
    };

    #[inline(always)]
    fn child(&self, lane: usize) -> Child {
        Child {
            center: Vec3::new(self.center[0][lane], self.center[1][lane], self.center[2][lane]),
            radius2: self.radius2[lane],
            axis: Vec3::new(self.axis[0][lane], self.axis[1][lane], self.axis[2][lane]),
            spread: (self.sin_spread[lane], self.cos_spread[lane]),
            intensity: self.intensity[lane],
            sides: self.sides[lane],
        }
    }

    /// How much the lights below each child may matter at `p`.
    #[inline(always)]
    fn importance(&self, p: Vec3, n: Vec3) -> [f32; WIDTH] {
        let mut importance = [0.0; WIDTH];
        for (lane, importance) in importance.iter_mut().enumerate() {
            *importance = self.child(lane).importance(p, n);
        }
        importance
    }
}

/// [`Node::importance`] of several nodes, each at its own place: one loop over all their children, so that it becomes
/// code of vectors as long as there are.
#[inline(always)]
fn importances(at: &[(&Node, Vec3, Vec3); TOGETHER], importance: &mut [[f32; WIDTH]; TOGETHER]) {
    // Row by row first: a loop that looked into the nodes would stay scalar.
    let mut rows = [[[0.0; WIDTH]; TOGETHER]; 16];
    let mut sides = [[0; WIDTH]; TOGETHER];
    for (k, (node, p, n)) in at.iter().enumerate() {
        let columns = [
            node.center[0],
            node.center[1],
            node.center[2],
            node.radius2,
            node.axis[0],
            node.axis[1],
            node.axis[2],
            node.sin_spread,
            node.cos_spread,
            node.intensity,
            [p.x; WIDTH],
            [p.y; WIDTH],
            [p.z; WIDTH],
            [n.x; WIDTH],
            [n.y; WIDTH],
            [n.z; WIDTH],
        ];
        for (row, column) in rows.iter_mut().zip(columns) {
            row[k] = column;
        }
        sides[k] = node.sides;
    }
    let sides = sides.as_flattened();
    let row = |r: usize, i: usize| rows[r].as_flattened()[i];
    for (i, importance) in importance.as_flattened_mut().iter_mut().enumerate() {
        let child = Child {
            center: Vec3::new(row(0, i), row(1, i), row(2, i)),
            radius2: row(3, i),
            axis: Vec3::new(row(4, i), row(5, i), row(6, i)),
            spread: (row(7, i), row(8, i)),
            intensity: row(9, i),
            sides: sides[i],
        };
        *importance = child
            .importance(Vec3::new(row(10, i), row(11, i), row(12, i)), Vec3::new(row(13, i), row(14, i), row(15, i)));
    }
}

/// Probabilities of a node's children; `None` where none of them matters. None that matters gets none.
#[inline(always)]
fn shares(importance: &[f32; WIDTH]) -> Option<[f32; WIDTH]> {
    let (shares, some) = shares_if_any(importance);
    some.then_some(shares)
}

/// The same, and whether any matters. Without branches, so that loops over it become vector code.
#[inline(always)]
fn shares_if_any(importance: &[f32; WIDTH]) -> ([f32; WIDTH], bool) {
    let total = |of: &[f32; WIDTH]| (of[0] + of[1]) + (of[2] + of[3]);
    let sum = total(importance);
    // No share is so small that the walk's arithmetic could lose it.
    let floor = sum * f32::EPSILON;
    let kept = importance.map(|i| select(0.0 >= i, 0.0, larger(i, floor)));
    let scale = 1.0 / total(&kept);
    (kept.map(|kept| kept * scale), (sum > 0.0) & (sum < f32::INFINITY))
}

/// A node that is all of a tree: of at most four lights.
#[derive(Debug, Clone, Copy)]
pub(super) struct Root {
    children: [Child; WIDTH],
    scale: f32,
}

impl Root {
    /// [`LightTree::sample`], but it gives the child that it takes, and whether there is one. Without branches, so that
    /// loops over it become vector code.
    #[inline(always)]
    pub(super) fn sample(&self, p: Vec3, n: Vec3, u: f64) -> (u32, f32, bool) {
        let p = p * self.scale;
        let importance = [
            self.children[0].importance(p, n),
            self.children[1].importance(p, n),
            self.children[2].importance(p, n),
            self.children[3].importance(p, n),
        ];
        let (shares, some) = shares_if_any(&importance);
        let share = [f64::from(shares[0]), f64::from(shares[1]), f64::from(shares[2])];
        let edges = [share[0], share[0] + share[1], share[0] + share[1] + share[2]];
        let chosen = u32::from(u >= edges[0]) + u32::from(u >= edges[1]) + u32::from(u >= edges[2]);
        // As [`Walk::go`].
        let (mut last, mut lane) = (0, 0);
        for share in shares {
            let mask = u32::from(share > 0.0).wrapping_neg();
            last = lane & mask | last & !mask;
            lane += 1;
        }
        let missed = u32::from(of_child(shares, chosen) == 0.0).wrapping_neg();
        let chosen = last & missed | chosen & !missed;
        (chosen, of_child(shares, chosen), some)
    }
}

/// Some lights below a node.
#[derive(Debug, Clone, Copy)]
struct Child {
    center: Vec3,
    radius2: f32,
    axis: Vec3,
    /// Sine and cosine.
    spread: (f32, f32),
    intensity: f32,
    sides: u32,
}

impl Child {
    /// How much they may matter at `p`: section 4.2 and equation 3. Not below 0. Without branches.
    #[inline(always)]
    fn importance(&self, p: Vec3, n: Vec3) -> f32 {
        let (x, y, z) = (self.center.x - p.x, self.center.y - p.y, self.center.z - p.z);
        let distance2 = x * x + y * y + z * z;
        let least = larger(self.radius2, LEAST_DISTANCE2);
        let inverse2 = 1.0 / larger(distance2, least);
        let inverse = inverse2.sqrt();
        // Half angle of the cone around the bounding sphere.
        let sin2_bounds = self.radius2 * inverse2;
        let bounds = (sin2_bounds.sqrt(), sine(sin2_bounds));
        let cos_axis = -(x * self.axis.x + y * self.axis.y + z * self.axis.z) * inverse;
        let cos_axis = f32::from_bits(cos_axis.to_bits() & self.sides);
        let facing = shrink((sine(cos_axis * cos_axis), cos_axis), self.spread);
        let emitted = larger(shrink(facing, bounds).1, 0.0);
        let cos = (x * n.x + y * n.y + z * n.z) * inverse;
        let received = emitted * larger(shrink((sine(cos * cos), cos), bounds).1, 0.0);
        let anyhow = (n.x == 0.0) & (n.y == 0.0) & (n.z == 0.0);
        let cosines = select(anyhow, emitted, received);
        // Inside the bounding sphere light may come from anywhere.
        let cosines = select(least >= distance2, 1.0, cosines);
        self.intensity * inverse2 * cosines
    }
}

/// The greater; `b` where `a` is not a number.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    select(a > b, a, b)
}

/// Sine from the square of the cosine, or the other way round.
#[inline(always)]
fn sine(cos2: f32) -> f32 {
    larger(1.0 - cos2, 0.0).sqrt()
}

/// Sine and cosine of max(0, a - b), both angles within 0 to pi.
#[inline(always)]
fn shrink((sin_a, cos_a): (f32, f32), (sin_b, cos_b): (f32, f32)) -> (f32, f32) {
    let (sin, cos) = (sin_a * cos_b - cos_a * sin_b, cos_a * cos_b + sin_a * sin_b);
    (select(cos_a >= cos_b, 0.0, sin), select(cos_a >= cos_b, 1.0, cos))
}

struct Builder<'a> {
    lights: &'a [LightBounds],
    total: f64,
    tree: LightTree,
}

impl Builder<'_> {
    /// Build the node over the lights in `order`, `depth` turns of the trail down, and give its number.
    fn build(&mut self, order: &mut [u32], depth: u32, trail: u64) -> u32 {
        let at = self.tree.nodes.len();
        // Its place comes before its children's; what it says comes after theirs is known.
        self.tree.nodes.push(Node::EMPTY);
        let mut node = Node::EMPTY;
        let parts: [&mut [u32]; WIDTH] = if order.len() <= WIDTH {
            // Each light by itself tells more than two of them together.
            let mut lights = order.chunks_mut(1);
            std::array::from_fn(|_| lights.next().unwrap_or_default())
        } else {
            let (left, right) = self.halves(order, 2 * depth);
            let ((a, b), (c, d)) = (self.halves(left, 2 * depth + 1), self.halves(right, 2 * depth + 1));
            [a, b, c, d]
        };
        for (lane, part) in parts.into_iter().filter(|part| !part.is_empty()).enumerate() {
            let trail = trail | (lane as u64) << (2 * depth);
            let index = if let [light] = *part {
                self.tree.trails[light as usize] = trail;
                LEAF | light
            } else {
                self.build(part, depth + 1, trail)
            };
            self.fill(&mut node, lane, part, index);
        }
        self.tree.nodes[at] = node;
        at as u32
    }

    /// The two halves of a node with two children, `depth` such nodes down; of a single light, it alone.
    fn halves<'o>(&self, order: &'o mut [u32], depth: u32) -> (&'o mut [u32], &'o mut [u32]) {
        if order.len() <= 1 {
            return (order, &mut []);
        }
        let middle = if depth < DEEPEST_CHOICE { self.split(order) } else { None }.unwrap_or_else(|| {
            order.sort_unstable();
            order.len() / 2
        });
        order.split_at_mut(middle)
    }

    /// Write the bounds of the lights in `part` to a lane.
    fn fill(&self, node: &mut Node, lane: usize, part: &[u32], index: u32) {
        let all = part.iter().map(|&light| self.lights[light as usize]).reduce(LightBounds::union);
        let Some(bounds) = all else { return };
        let scale = f64::from(self.tree.scale);
        let half: DVec3 = (bounds.high.as_dvec3() - bounds.low.as_dvec3()) * (0.5 * scale);
        let spread = f64::from(bounds.cone.spread);
        let center = bounds.center() * self.tree.scale;
        for axis in 0..3 {
            node.center[axis][lane] = center[axis];
            node.axis[axis][lane] = bounds.cone.axis[axis];
        }
        // A little more: the centre is rounded.
        node.radius2[lane] = (half.length_squared() * (1.0 + 1e-6)) as f32;
        node.cos_spread[lane] = libm::cos(spread) as f32;
        node.sin_spread[lane] = libm::sin(spread) as f32;
        node.intensity[lane] = (bounds.intensity / self.total) as f32;
        node.sides[lane] = if bounds.two_sided { !(1 << 31) } else { u32::MAX };
        node.index[lane] = index;
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
