//! The binary tree, with what the collapse needs to know of it.
//!
//! Parallel, and the same tree from any number of threads: every split is a function of the primitives of
//! its node in their order, and sums over them are of integers, or minima and maxima.
//!
//! Depth is bounded: below [`SPLIT_DEPTH`] nodes are halved by count, which also serves where no split
//! plane separates anything (coincident centroids).

use rayon::prelude::*;

use super::{
    super::{pages, simd::Proof},
    BuildMethod,
    bins::{self, Bins, Box8, Halves, Mapping, Measure, Split, centroid, partition},
    collapse::{Shares, Table},
};
use crate::lanes::Proven;

/// Triangles tested at once.
pub(super) const PACK: usize = 8;
/// Most triangles in a leaf.
const LEAF_TRIANGLES: usize = 4 * PACK;
/// Most other primitives in a leaf.
pub(super) const LEAF_ITEMS: usize = 4;
/// What fits into a pack is split further where its box reaches so many times its share of the whole: large
/// triangles are worth packs of their own.
const LARGE: f32 = 50.0;
/// What a pack's memory is worth, as a part of the whole's share.
const MEMORY: f32 = 1.0;
/// Below this depth nodes are halved by count.
const SPLIT_DEPTH: usize = 64;
/// No tree is deeper: `SPLIT_DEPTH`, then halving of less than 2^32 primitives, then kinds told apart.
pub(super) const MAX_DEPTH: usize = SPLIT_DEPTH + 36;
/// Nodes with fewer primitives are one thread's work.
const PARALLEL: usize = 8192;
/// Nodes with more than twice as many are split by several threads, this many primitives each.
const CHUNK: usize = 1 << 14;

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
pub(in super::super) struct Ref(Box8);

/// Makes ordinary numbers of the bits in those lanes: with others processors can be slow.
const TAG: u32 = 1 << 30;

impl Ref {
    /// `id` is below 2^29; the box is finite.
    pub fn new(bounds: &super::super::Bounds, id: u32, kind: Kind) -> Self {
        let tag = |bits: u32| f32::from_bits(TAG | bits);
        let (lo, hi) = (bounds.lo, -bounds.hi);
        Self(Box8([lo.x, lo.y, lo.z, tag(id & (TAG - 1)), hi.x, hi.y, hi.z, tag(u32::from(kind == Kind::Item))]))
    }

    /// Stands where there is nothing to hit.
    pub const NONE: Self = Self(Box8([f32::INFINITY; 8]));

    pub fn is_some(&self) -> bool {
        self.0.0[0] < f32::INFINITY
    }

    pub fn id(&self) -> u32 {
        self.0.0[3].to_bits() ^ TAG
    }

    pub fn kind(&self) -> Kind {
        if self.0.0[7].to_bits() == TAG { Kind::Triangle } else { Kind::Item }
    }

    #[inline(always)]
    pub(super) fn bounds(&self) -> &Box8 {
        &self.0
    }
}

/// A node of the binary tree. An inner node's left child follows it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node2 {
    pub lo: [f32; 3],
    pub hi: [f32; 3],
    /// How much further than itself the right child is; 0 for a leaf.
    pub right: u32,
    /// Its references, by place in the list.
    pub first: u32,
    pub count: u32,
    /// How it is shared out among children of wide nodes.
    pub shares: Shares,
}

impl Node2 {
    pub fn is_leaf(&self) -> bool {
        self.right == 0
    }
}

/// Sort the references into leaves and return the tree over them, for nodes of `W` children; empty for no references.
pub(super) fn build<const W: usize>(refs: &mut [Ref], method: BuildMethod, proof: Proof) -> Vec<Node2> {
    if refs.is_empty() {
        return Vec::new();
    }
    let [bounds, centroids] = measure(refs);
    let extent = (0..3).map(|i| -bounds.0[i + 4] - bounds.0[i]).fold(0.0, f32::max);
    let scale = if extent > 0.0 && (1.0 / extent).is_finite() { 1.0 / extent } else { 1.0 };
    let mixed = refs.par_iter().any(|r| r.kind() == Kind::Item);
    let mut measure = Measure { scale, memory: 0.0 };
    let share = bounds.reach(&measure) / refs.len().div_ceil(PACK) as f32;
    measure.memory = MEMORY * share;
    let proven = Proven::detect();
    let builder = Builder::<W> { method, measure, mixed, share, proof, proven };
    let mut parts = Vec::new();
    builder.node(&mut parts, refs, 0, [bounds, centroids], 0);
    let mut nodes = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    pages::advise(&mut nodes);
    for part in parts {
        nodes.extend_from_slice(&part);
    }
    nodes
}

/// Bounds of the primitives, and of their centroids.
fn measure(refs: &[Ref]) -> [Box8; 2] {
    let some = |refs: &[Ref]| {
        let mut all = [Box8::EMPTY; 2];
        for r in refs {
            all[0].join(r.bounds());
            all[1].join(&centroid(r));
        }
        all
    };
    if refs.len() <= CHUNK {
        return some(refs);
    }
    refs.par_chunks(CHUNK).map(some).reduce(
        || [Box8::EMPTY; 2],
        |mut a, b| {
            a[0].join(&b[0]);
            a[1].join(&b[1]);
            a
        },
    )
}

#[derive(Clone, Copy)]
struct Builder<const W: usize> {
    method: BuildMethod,
    measure: Measure,
    mixed: bool,
    /// Reach of the whole, for each pack that is needed at least.
    share: f32,
    proof: Proof,
    proven: Proven,
}

impl<const W: usize> Builder<W> {
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

    /// The tree over some references, as a list of its parts; `boxes` are the bounds of them and of their centroids.
    fn node(
        &self,
        parts: &mut Vec<Vec<Node2>>,
        refs: &mut [Ref],
        first: u32,
        boxes: [Box8; 2],
        depth: usize,
    ) -> Table<W> {
        if refs.len() < PARALLEL {
            let mut nodes = Vec::with_capacity(refs.len() / 2 + 1);
            let table = self.small(&mut nodes, refs, first, boxes, depth);
            parts.push(nodes);
            return table;
        }
        let count = refs.len() as u32;
        let (mid, [left, right]) = self.split(refs, &boxes, depth).unwrap_or_else(|| halve(refs));
        let (a, b) = refs.split_at_mut(mid);
        let at = first + mid as u32;
        let me = parts.len();
        parts.push(Vec::new());
        let mut others = Vec::new();
        let (l, r) = rayon::join(
            || self.node(parts, a, first, left, depth + 1),
            || self.node(&mut others, b, at, right, depth + 1),
        );
        let left_nodes: usize = parts[me + 1..].iter().map(Vec::len).sum();
        let (table, shares) = Table::of(&l, &r, boxes[0].reach(&self.measure), None);
        let (lo, hi) = (boxes[0].lo(), boxes[0].hi());
        parts[me] = vec![Node2 { lo, hi, right: 1 + left_nodes as u32, first, count, shares }];
        parts.append(&mut others);
        table
    }

    /// As `node`, on one thread, into a list.
    fn small(&self, nodes: &mut Vec<Node2>, refs: &mut [Ref], first: u32, boxes: [Box8; 2], depth: usize) -> Table<W> {
        let me = nodes.len();
        let count = refs.len() as u32;
        let (lo, hi) = (boxes[0].lo(), boxes[0].hi());
        nodes.push(Node2 { lo, hi, right: 0, first, count, shares: Shares::LEAF });
        let reach = boxes[0].reach(&self.measure);
        let (may_be_leaf, by_kind) = self.leaf(refs);
        let cost = may_be_leaf.then(|| self.measure.packs(reach, count));
        let whole = refs.len() <= PACK && (refs.len() < 2 || reach <= LARGE * self.share);
        if let Some(cost) = cost
            && whole
        {
            return Table::leaf(cost);
        }
        let (mid, [left, right]) = if by_kind {
            tell_kinds_apart(refs)
        } else {
            match (self.split(refs, &boxes, depth), cost) {
                (Some(split), _) => split,
                (None, Some(cost)) => return Table::leaf(cost),
                (None, None) => halve(refs),
            }
        };
        let (a, b) = refs.split_at_mut(mid);
        let l = self.small(nodes, a, first, left, depth + 1);
        let offset = (nodes.len() - me) as u32;
        let r = self.small(nodes, b, first + mid as u32, right, depth + 1);
        let (table, shares) = Table::of(&l, &r, reach, cost);
        (nodes[me].right, nodes[me].shares) = (offset, shares);
        table
    }

    /// Partition by the method's plane. None where there is none.
    fn split(&self, refs: &mut [Ref], boxes: &[Box8; 2], depth: usize) -> Option<Parts> {
        if depth >= SPLIT_DEPTH {
            return None;
        }
        match self.method {
            BuildMethod::Sah => self.split_sah(refs, &boxes[1]),
            BuildMethod::MeanCentroid => split_mean(refs, &boxes[0]),
            BuildMethod::Midpoint => self.split_midpoint(refs, &boxes[0]),
        }
    }

    fn split_sah(&self, refs: &mut [Ref], centroids: &Box8) -> Option<Parts> {
        let mapping = Mapping::new(centroids, refs.len());
        if !(0..3).any(|axis| mapping.splits(axis)) {
            return None;
        }
        let fill = |refs: &[Ref]| {
            let mut bins = Bins::EMPTY;
            bins::fill(self.proof, &mut bins, refs, &mapping);
            bins
        };
        let bins = if refs.len() > 2 * CHUNK {
            refs.par_chunks(CHUNK).map(fill).reduce_with(|a, b| a.merge(&b))?
        } else {
            fill(refs)
        };
        let mut split: Option<Split> = None;
        bins::best(self.proven, &bins, &mapping, &self.measure, &mut split);
        let Split { axis, bin, sides: [left, right], .. } = split?;
        let partition = |refs: &mut [Ref]| {
            let mut halves = (0, [Box8::EMPTY; 2]);
            bins::partition_by_bin(self.proven, refs, &mapping, axis, bin, &mut halves);
            halves
        };
        let (mid, [cl, cr]) = if refs.len() > 2 * CHUNK {
            let parts: Vec<Halves> = refs.par_chunks_mut(CHUNK).map(partition).collect();
            bins::gather(refs, CHUNK, &parts)
        } else {
            partition(refs)
        };
        Some((mid, [[left, cl], [right, cr]]))
    }

    fn split_midpoint(&self, refs: &mut [Ref], bounds: &Box8) -> Option<Parts> {
        let mut best: Option<(f32, usize, f32)> = None;
        for axis in 0..3 {
            // Centroids are doubled as well.
            let middle = bounds.0[axis] - bounds.0[axis + 4];
            let mut sides = [Box8::EMPTY; 2];
            let mut n = 0;
            for r in refs.iter() {
                let left = centroid(r).0[axis] < middle;
                sides[usize::from(!left)].join(r.bounds());
                n += usize::from(left);
            }
            if n == 0 || n == refs.len() {
                continue;
            }
            let [l, r] = sides.map(|side| side.reach(&self.measure));
            let cost = l * n as f32 + r * (refs.len() - n) as f32;
            if best.is_none_or(|b| cost < b.0) {
                best = Some((cost, axis, middle));
            }
        }
        let (_, axis, middle) = best?;
        split_at(refs, axis, middle)
    }
}

/// The place of the first reference of the right side; bounds and centroid bounds of either side.
type Parts = (usize, [[Box8; 2]; 2]);

fn split_mean(refs: &mut [Ref], bounds: &Box8) -> Option<Parts> {
    let extent = |i: usize| -bounds.0[i + 4] - bounds.0[i];
    let axis = (1..3).fold(0, |a, i| if extent(i) > extent(a) { i } else { a });
    let sum: f64 = refs.iter().map(|r| f64::from(centroid(r).0[axis])).sum();
    split_at(refs, axis, (sum / refs.len() as f64) as f32)
}

fn split_at(refs: &mut [Ref], axis: usize, plane: f32) -> Option<Parts> {
    let (mid, _) = partition(refs, |r| centroid(r).0[axis] < plane);
    (mid > 0 && mid < refs.len()).then(|| measured(refs, mid))
}

fn halve(refs: &mut [Ref]) -> Parts {
    measured(refs, refs.len() / 2)
}

fn tell_kinds_apart(refs: &mut [Ref]) -> Parts {
    let (mid, _) = partition(refs, |r| r.kind() == Kind::Triangle);
    measured(refs, mid)
}

fn measured(refs: &[Ref], mid: usize) -> Parts {
    (mid, [measure(&refs[..mid]), measure(&refs[mid..])])
}
