//! The binary tree.
//!
//! Parallel, and the same tree from any number of threads: every split is a function of the primitives of
//! its node in their order, and sums over them are of integers, or minima and maxima.
//!
//! Depth is bounded: below [`SPLIT_DEPTH`] nodes are halved by count, which also serves where no split
//! plane separates anything (coincident centroids).

use rayon::prelude::*;

use super::{
    BuildMethod,
    bins::{BINS, Bins, Box4, Mapping, centroid},
};

/// Triangles tested at once.
pub(super) const PACK: usize = 8;
/// Most triangles in a leaf.
const LEAF_TRIANGLES: usize = 4 * PACK;
/// Most other primitives in a leaf.
pub(super) const LEAF_ITEMS: usize = 4;
/// What a node of the binary tree costs, in units of a pack. Less than a node of the wide tree would: most
/// of them disappear in it. A smaller value makes smaller leaves, more of them, and a larger tree.
const STEP: f32 = 0.75;
/// Below this depth nodes are halved by count.
const SPLIT_DEPTH: usize = 64;
/// No tree is deeper: `SPLIT_DEPTH`, then halving of less than 2^32 primitives, then kinds told apart.
pub(super) const MAX_DEPTH: usize = SPLIT_DEPTH + 36;
/// Nodes with fewer primitives are one thread's work.
const PARALLEL: usize = 8192;
/// Nodes with more are binned by several threads, this many primitives each.
const CHUNK: usize = 1 << 15;

/// What a reference stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Kind {
    /// Goes into packs.
    Triangle,
    /// Anything else.
    Item,
}

/// A primitive to the builder: its box; its number and kind sit in the lanes that boxes do not use.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Ref(Box4);

const ITEM: u32 = 1 << 31;

impl Ref {
    /// `id` is below 2^31; the box is finite.
    pub fn new(bounds: &super::super::Bounds, id: u32, kind: Kind) -> Self {
        let tag = f32::from_bits(id & !ITEM);
        let flag = f32::from_bits(if kind == Kind::Item { ITEM } else { 0 });
        let (lo, hi) = (bounds.lo, bounds.hi);
        Self(Box4 { lo: [lo.x, lo.y, lo.z, tag], hi: [hi.x, hi.y, hi.z, flag] })
    }

    pub fn id(&self) -> u32 {
        self.0.lo[3].to_bits()
    }

    pub fn kind(&self) -> Kind {
        if self.0.hi[3].to_bits() & ITEM == 0 { Kind::Triangle } else { Kind::Item }
    }

    #[inline(always)]
    pub(super) fn bounds(&self) -> &Box4 {
        &self.0
    }
}

/// A node of the binary tree. An inner node's left child follows it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node2 {
    pub bounds: Box4,
    /// Inner: how much further than itself the right child is. Leaf: 0.
    pub right: u32,
    /// Leaf: its references, by place in the list.
    pub first: u32,
    pub count: u32,
}

impl Node2 {
    pub fn is_leaf(&self) -> bool {
        self.right == 0
    }
}

/// Sort the references into leaves and return the tree over them; empty for no references.
pub(super) fn build(refs: &mut [Ref], method: BuildMethod) -> Vec<Node2> {
    if refs.is_empty() {
        return Vec::new();
    }
    let (bounds, centroids) = measure(refs);
    let extent = (0..3).map(|i| bounds.hi[i] - bounds.lo[i]).fold(0.0, f32::max);
    let scale = if extent > 0.0 && (1.0 / extent).is_finite() { 1.0 / extent } else { 1.0 };
    let mixed = refs.iter().any(|r| r.kind() == Kind::Item);
    Builder { method, scale, mixed }.node(refs, 0, bounds, centroids, 0)
}

/// Bounds of the primitives, and of their centroids.
fn measure(refs: &[Ref]) -> (Box4, Box4) {
    let some = |refs: &[Ref]| {
        refs.iter().fold((Box4::EMPTY, Box4::EMPTY), |(mut b, mut c), r| {
            b.join(r.bounds());
            c.include(centroid(r));
            (b, c)
        })
    };
    if refs.len() <= CHUNK {
        return some(refs);
    }
    refs.par_chunks(CHUNK).map(some).reduce(
        || (Box4::EMPTY, Box4::EMPTY),
        |mut a, b| {
            a.0.join(&b.0);
            a.1.join(&b.1);
            a
        },
    )
}

#[derive(Clone, Copy)]
struct Builder {
    method: BuildMethod,
    /// Makes the extent of the whole 1.
    scale: f32,
    mixed: bool,
}

impl Builder {
    fn packs(n: u32) -> f32 {
        n.div_ceil(PACK as u32) as f32
    }

    /// Whether these may stay together, and whether they must be told apart by kind first.
    fn leaf(&self, refs: &[Ref]) -> (bool, bool) {
        if refs.len() > LEAF_TRIANGLES {
            return (false, false);
        }
        let items = if self.mixed { refs.iter().filter(|r| r.kind() == Kind::Item).count() } else { 0 };
        match items {
            0 => (true, false),
            n if n == refs.len() => (n <= LEAF_ITEMS, false),
            _ => (false, refs.len() <= PACK),
        }
    }

    fn node(&self, refs: &mut [Ref], first: u32, bounds: Box4, centroids: Box4, depth: usize) -> Vec<Node2> {
        let mut nodes = Vec::new();
        if refs.len() >= PARALLEL {
            let (mid, left, right) = self.split(refs, &bounds, &centroids, depth).unwrap_or_else(|| halve(refs));
            let (a, b) = refs.split_at_mut(mid);
            let at = first + mid as u32;
            let (l, r) = rayon::join(
                || self.node(a, first, left.0, left.1, depth + 1),
                || self.node(b, at, right.0, right.1, depth + 1),
            );
            nodes.reserve_exact(1 + l.len() + r.len());
            nodes.push(Node2 { bounds, right: 1 + l.len() as u32, first, count: 0 });
            nodes.extend_from_slice(&l);
            nodes.extend_from_slice(&r);
        } else {
            nodes.reserve(refs.len() / 2 + 1);
            self.small(&mut nodes, refs, first, bounds, centroids, depth);
        }
        nodes
    }

    /// As `node`, on one thread, into a list.
    fn small(&self, nodes: &mut Vec<Node2>, refs: &mut [Ref], first: u32, bounds: Box4, centroids: Box4, depth: usize) {
        let me = nodes.len();
        nodes.push(Node2 { bounds, right: 0, first, count: refs.len() as u32 });
        let (may_be_leaf, by_kind) = self.leaf(refs);
        if may_be_leaf && refs.len() <= PACK {
            return;
        }
        let (mid, left, right) = if by_kind {
            tell_kinds_apart(refs)
        } else {
            match self.split(refs, &bounds, &centroids, depth) {
                Some(split) => split,
                None if may_be_leaf => return,
                None => halve(refs),
            }
        };
        let (a, b) = refs.split_at_mut(mid);
        self.small(nodes, a, first, left.0, left.1, depth + 1);
        nodes[me].right = (nodes.len() - me) as u32;
        nodes[me].count = 0;
        self.small(nodes, b, first + mid as u32, right.0, right.1, depth + 1);
    }

    /// Partition by the method's plane. None where there is none, or where a leaf is cheaper.
    fn split(&self, refs: &mut [Ref], bounds: &Box4, centroids: &Box4, depth: usize) -> Option<Parts> {
        if depth >= SPLIT_DEPTH {
            return None;
        }
        match self.method {
            BuildMethod::Sah => self.split_sah(refs, bounds, centroids),
            BuildMethod::MeanCentroid => split_mean(refs, bounds),
            BuildMethod::Midpoint => self.split_midpoint(refs, bounds),
        }
    }

    fn split_sah(&self, refs: &mut [Ref], bounds: &Box4, centroids: &Box4) -> Option<Parts> {
        let mapping = Mapping::new(centroids);
        if !(0..3).any(|axis| mapping.splits(axis)) {
            return None;
        }
        let bins = if refs.len() > 2 * CHUNK {
            refs.par_chunks(CHUNK)
                .map(|refs| {
                    let mut bins = Bins::EMPTY;
                    bins.fill(refs, &mapping);
                    bins
                })
                .reduce(|| Bins::EMPTY, |a, b| a.merge(&b))
        } else {
            let mut bins = Bins::EMPTY;
            bins.fill(refs, &mapping);
            bins
        };
        let best = bins.best(&mapping, self.scale, Self::packs)?;
        let area = bounds.half_area(self.scale);
        if self.leaf(refs).0 && best.cost + STEP * area >= area * Self::packs(refs.len() as u32) {
            return None;
        }
        let (mut left, mut right) = (Box4::EMPTY, Box4::EMPTY);
        for k in 0..BINS {
            let side = if k < best.bin { &mut left } else { &mut right };
            side.join(&bins.bounds[best.axis][k]);
        }
        let (mid, cl, cr) = partition(refs, |r| mapping.bins(r)[best.axis] < best.bin);
        Some((mid, (left, cl), (right, cr)))
    }

    fn split_midpoint(&self, refs: &mut [Ref], bounds: &Box4) -> Option<Parts> {
        let mut best: Option<(f32, usize, f32)> = None;
        for axis in 0..3 {
            // Centroids are doubled as well.
            let middle = bounds.lo[axis] + bounds.hi[axis];
            let (mut l, mut r, mut n) = (Box4::EMPTY, Box4::EMPTY, 0usize);
            for x in refs.iter() {
                if centroid(x)[axis] < middle {
                    l.join(x.bounds());
                    n += 1;
                } else {
                    r.join(x.bounds());
                }
            }
            if n == 0 || n == refs.len() {
                continue;
            }
            let cost = l.half_area(self.scale) * n as f32 + r.half_area(self.scale) * (refs.len() - n) as f32;
            if best.is_none_or(|b| cost < b.0) {
                best = Some((cost, axis, middle));
            }
        }
        let (_, axis, middle) = best?;
        split_at(refs, axis, middle)
    }
}

/// The place of the first reference of the right side; bounds and centroid bounds of either side.
type Parts = (usize, (Box4, Box4), (Box4, Box4));

fn split_mean(refs: &mut [Ref], bounds: &Box4) -> Option<Parts> {
    let extent = |i: usize| bounds.hi[i] - bounds.lo[i];
    let axis = (1..3).fold(0, |a, i| if extent(i) > extent(a) { i } else { a });
    let sum: f64 = refs.iter().map(|r| f64::from(centroid(r)[axis])).sum();
    split_at(refs, axis, (sum / refs.len() as f64) as f32)
}

fn split_at(refs: &mut [Ref], axis: usize, plane: f32) -> Option<Parts> {
    let (mid, _, _) = partition(refs, |r| centroid(r)[axis] < plane);
    (mid > 0 && mid < refs.len()).then(|| measured(refs, mid))
}

fn halve(refs: &mut [Ref]) -> Parts {
    measured(refs, refs.len() / 2)
}

fn tell_kinds_apart(refs: &mut [Ref]) -> Parts {
    let (mid, _, _) = partition(refs, |r| r.kind() == Kind::Triangle);
    measured(refs, mid)
}

fn measured(refs: &[Ref], mid: usize) -> Parts {
    (mid, measure(&refs[..mid]), measure(&refs[mid..]))
}

/// Those that satisfy `left` first. Returns how many, and the centroid bounds of either side.
#[inline(always)]
fn partition(refs: &mut [Ref], left: impl Fn(&Ref) -> bool) -> (usize, Box4, Box4) {
    let (mut i, mut k) = (0, refs.len());
    let (mut cl, mut cr) = (Box4::EMPTY, Box4::EMPTY);
    while i < k {
        if left(&refs[i]) {
            cl.include(centroid(&refs[i]));
            i += 1;
        } else {
            cr.include(centroid(&refs[i]));
            k -= 1;
            refs.swap(i, k);
        }
    }
    (i, cl, cr)
}
