//! Walking a tree along a ray. One body, compiled for each instruction set and each kind of question.
//!
//! Boxes are tested conservatively, so that a box never hides a triangle that the triangle test accepts:
//! - A direction component of zero makes infinities, and 0 times infinity makes NaN when the origin lies on
//!   the slab's plane. The NaN is always the first operand of a minimum or maximum that takes its second
//!   when either is NaN: the slab then says nothing.
//! - The far side is widened for the rounding of three operations here, and of those that move and shear
//!   a triangle's corners. Corners ahead of the origin shift by a few parts in 2^24 of the distance at which
//!   they are met; a box that reaches behind the origin can hold triangles whose corners shift by
//!   parts of how far behind, and is widened by that as well.
//! - A box is culled only where it begins after the nearest hit, never where it begins at it: an equal
//!   parameter may belong to a lower number.

use std::mem::MaybeUninit;

#[cfg(target_arch = "x86_64")]
use super::super::simd::{Avx2, Avx512, Sse2};
use super::{
    super::{
        Counters, Ray,
        simd::{Boxes, Isa, Lanes, Portable, Row},
        textbook,
        triangle::{Pack, RayFrame, WideFrame},
    },
    build::MAX_DEPTH,
    wide::{Body, COUNT_MASK, COUNT_SHIFT, FIRST_MASK, ITEMS, LEAF, Node, Tree, Wide},
};

/// A node leaves at most seven of its children for later.
const STACK: usize = 7 * (MAX_DEPTH + 1) + 8;
/// Relative widening, in units of the last place of 1: 2 gamma(3) for the slabs, 2 gamma(5) for the
/// corners, and as much again.
pub(in super::super) const WIDEN: f32 = 16.0 * f32::EPSILON;

/// The rows of a node that a ray meets first and last, on each of its permuted axes.
struct Sides {
    near: [u8; 3],
    far: [u8; 3],
}

/// By the axis that is z and the signs of the direction's components: a table is read sooner than computed.
static SIDES: [Sides; 24] = {
    let mut all = [const { Sides { near: [0; 3], far: [0; 3] } }; 24];
    let mut k = 0;
    while k < 24 {
        let mut i = 0;
        while i < 3 {
            // x follows z, y follows x.
            let axis = (k / 8 + 1 + i) % 3;
            let negative = k >> axis & 1;
            all[k].near[i] = (axis + 3 * negative) as u8;
            all[k].far[i] = (axis + 3 * (1 - negative)) as u8;
            i += 1;
        }
        k += 1;
    }
    all
};

/// So that a row on the stack lies in one cache line.
#[repr(align(32))]
struct Aligned<T>(T);

/// The signs of a ray's direction, a bit for each axis.
#[inline(always)]
fn signs(ray: &Ray) -> usize {
    let bit = |x: f32| (x.to_bits() >> 31) as usize;
    bit(ray.direction.x) | bit(ray.direction.y) << 1 | bit(ray.direction.z) << 2
}

/// The nearest hit so far. Ordered by parameter, then instance, then primitive.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Nearest {
    pub t: f32,
    /// 0 for the world itself, one more than the instance's number otherwise.
    pub rank: u32,
    /// Number of the primitive within its tree.
    pub id: u32,
    pub b1: f32,
    pub b2: f32,
    pub found: bool,
}

impl Nearest {
    /// No hit yet; none at `t_max` or beyond will be taken.
    pub fn none(t_max: f32) -> Self {
        Self { t: t_max, rank: 0, id: 0, b1: 0.0, b2: 0.0, found: false }
    }

    /// Take a hit if it comes first. Whether it did.
    #[inline(always)]
    pub fn offer(&mut self, rank: u32, id: u32, t: f32, b1: f32, b2: f32) -> bool {
        let first = t < self.t || t == self.t && self.found && (rank, id) < (self.rank, self.id);
        if first {
            *self = Self { t, rank, id, b1, b2, found: true };
        }
        first
    }
}

/// What a tree's items are.
pub(in super::super) trait Items {
    /// Test an item and offer its hit. Whether it was the nearest.
    fn intersect<I: Traverse, const ANY: bool>(
        &self,
        isa: I,
        item: u32,
        ray: &Ray,
        nearest: &mut Nearest,
        counters: &mut Counters,
    ) -> bool;
}

/// An instruction set that the traversal is compiled for.
pub(in super::super) trait Traverse: Boxes<8> + Boxes<4> {
    /// Find the nearest hit in a tree, or with `ANY` some hit. Whether `nearest` changed; with `ANY` that is
    /// all that is told. `TEXTBOOK` tests triangles as textbooks do.
    fn trace<const ANY: bool, const TEXTBOOK: bool>(
        self,
        tree: &Tree,
        rank: u32,
        items: &impl Items,
        ray: &Ray,
        nearest: &mut Nearest,
        counters: &mut Counters,
    ) -> bool;
}

/// Implements [`Traverse`] by a copy of [`trace`], compiled with the attribute given.
macro_rules! traverse {
    ($isa:ty, $(#[$attribute:meta])*) => {
        impl Traverse for $isa {
            #[inline(always)]
            fn trace<const ANY: bool, const TEXTBOOK: bool>(
                self,
                tree: &Tree,
                rank: u32,
                items: &impl Items,
                ray: &Ray,
                nearest: &mut Nearest,
                counters: &mut Counters,
            ) -> bool {
                $(#[$attribute])*
                #[inline(never)]
                fn compiled<const W: usize, const ANY: bool, const TEXTBOOK: bool>(
                    isa: $isa,
                    tree: &Wide<W>,
                    rank: u32,
                    items: &impl Items,
                    ray: &Ray,
                    nearest: &mut Nearest,
                    counters: &mut Counters,
                ) -> bool
                where
                    $isa: Boxes<W>,
                {
                    trace::<$isa, W, ANY, TEXTBOOK>(isa, tree, rank, items, ray, nearest, counters)
                }
                #[allow(unused_unsafe, reason = "only where there are features to promise")]
                // SAFETY: the value `self` exists only where the processor has what the attribute names.
                unsafe {
                    match &tree.body {
                        Body::Eight(wide) => {
                            compiled::<8, ANY, TEXTBOOK>(self, wide, rank, items, ray, nearest, counters)
                        }
                        Body::Four(wide) => {
                            compiled::<4, ANY, TEXTBOOK>(self, wide, rank, items, ray, nearest, counters)
                        }
                    }
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
traverse!(Avx512, #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]);
#[cfg(target_arch = "x86_64")]
traverse!(Avx2, #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]);
#[cfg(target_arch = "x86_64")]
traverse!(Sse2,);
traverse!(Portable,);

#[inline(always)]
fn trace<I: Traverse + Boxes<W>, const W: usize, const ANY: bool, const TEXTBOOK: bool>(
    isa: I,
    tree: &Wide<W>,
    rank: u32,
    items: &impl Items,
    ray: &Ray,
    nearest: &mut Nearest,
    counters: &mut Counters,
) -> bool {
    if tree.nodes.is_empty() {
        return false;
    }
    let Some(frame) = RayFrame::new(ray) else { return false };
    let wide = WideFrame::new(isa, &frame);
    let rows = &SIDES[frame.axes[2] << 3 | signs(ray)];
    let (near_row, far_row) = (rows.near.map(usize::from), rows.far.map(usize::from));
    let boxes = Boxes::<W>::boxes(isa);
    let splat3 = |v: [f32; 3]| [boxes.splat(v[0]), boxes.splat(v[1]), boxes.splat(v[2])];
    let (o, r) = (splat3(frame.origin), splat3(frame.reciprocal));
    let grow = boxes.splat(1.0 + WIDEN);
    let r_far = [r[0].mul(grow), r[1].mul(grow), r[2].mul(grow)];
    let zero = boxes.splat(0.0);
    let behind = boxes.splat(2.0 * WIDEN);
    // Everything that compares with the nearest hit does so with this margin.
    let mut t_far = nearest.t * (1.0 + WIDEN);
    let mut t_far_boxes = boxes.splat(t_far);
    let mut t_far_pack = isa.splat(t_far);
    let mut changed = false;
    let (mut node_tests, mut primitive_tests) = (0u64, 0u64);

    // Entries: the near parameter's bits above, the child below. The bits of numbers that are not negative
    // are ordered as the numbers are; negative ones come before all of them, which is all that is needed.
    let mut stack = [const { MaybeUninit::<i64>::uninit() }; STACK];
    let stack = stack.as_mut_ptr().cast::<i64>();
    let mut top = 0usize;
    let mut current = 0u32;
    let mut near_store = Aligned(Row([0.0; W]));
    let mut moved = [isa.splat(0.0); 9];

    'next: loop {
        'pop: {
            if current & LEAF == 0 {
                debug_assert!((current as usize) < tree.nodes.len());
                // SAFETY: inner children are places of nodes; `wide::Tree::build` wrote them.
                let node: &Node<W> = unsafe { tree.nodes.get_unchecked(current as usize) };
                node_tests += 1;
                // SAFETY: near and far rows are an axis, or an axis and 3.
                let from = |row: usize, axis: usize| boxes.load(unsafe { node.rows.get_unchecked(row) }).sub(o[axis]);
                let near = |axis: usize| from(near_row[axis], axis).mul(r[axis]);
                let far = |axis: usize| from(far_row[axis], axis).mul(r_far[axis]);
                let z = near(2);
                let far = far(0).min(far(1)).min(far(2).min(t_far_boxes));
                let near = near(0).max(near(1)).max(z.max(zero)).add(z.min(zero).mul(behind));
                let mut mask = near.le(far);
                if mask == 0 {
                    break 'pop;
                }
                let take = |mask: &mut u32| {
                    let i = mask.trailing_zeros() as usize;
                    *mask &= *mask - 1;
                    i
                };
                // SAFETY: a bit of the mask is below W.
                let child = |i: usize| unsafe { *node.children.get_unchecked(i) };
                let first = take(&mut mask);
                if mask == 0 {
                    current = child(first);
                    continue 'next;
                }
                if ANY {
                    let mut last = child(first);
                    while mask != 0 {
                        tree.prefetch(isa, last);
                        debug_assert!(top < STACK);
                        // SAFETY: the tree is at most MAX_DEPTH + 1 nodes deep and each leaves at most seven.
                        unsafe { *stack.add(top) = i64::from(last) };
                        top += 1;
                        last = child(take(&mut mask));
                    }
                    current = last;
                    continue 'next;
                }
                near.store(&mut near_store.0);
                let key = |i: usize| {
                    let child = child(i);
                    tree.prefetch(isa, child);
                    i64::from(near_store.0.0[i % W].to_bits() as i32) << 32 | i64::from(child)
                };
                let (k0, k1) = (key(first), key(take(&mut mask)));
                debug_assert!(top + 8 <= STACK);
                // SAFETY: as above, for each of these writes; the eighth child is taken off again at once.
                unsafe {
                    if mask == 0 {
                        *stack.add(top) = k0.max(k1);
                        top += 1;
                        current = k0.min(k1) as u32;
                        continue 'next;
                    }
                    let k2 = key(take(&mut mask));
                    let (x, y) = (k0.max(k1), k0.min(k1));
                    let (a, z) = (x.max(k2), x.min(k2));
                    let (b, c) = (y.max(z), y.min(z));
                    *stack.add(top) = a;
                    *stack.add(top + 1) = b;
                    if mask == 0 {
                        top += 2;
                        current = c as u32;
                        continue 'next;
                    }
                    let base = top;
                    *stack.add(top + 2) = c;
                    top += 3;
                    while mask != 0 {
                        let k = key(take(&mut mask));
                        let mut j = top;
                        while j > base && *stack.add(j - 1) < k {
                            *stack.add(j) = *stack.add(j - 1);
                            j -= 1;
                        }
                        *stack.add(j) = k;
                        top += 1;
                    }
                    top -= 1;
                    current = *stack.add(top) as u32;
                    continue 'next;
                }
            }

            let count = (current >> COUNT_SHIFT & COUNT_MASK) as usize;
            let at = (current & FIRST_MASK) as usize;
            if current & ITEMS != 0 {
                primitive_tests += count as u64;
                for &item in &tree.items[at..at + count] {
                    if items.intersect::<I, ANY>(isa, item, ray, nearest, counters) {
                        changed = true;
                    }
                }
                if changed {
                    if ANY {
                        break 'next;
                    }
                    t_far = nearest.t * (1.0 + WIDEN);
                    t_far_boxes = boxes.splat(t_far);
                    t_far_pack = isa.splat(t_far);
                }
                break 'pop;
            }
            debug_assert!(at + count <= tree.packs.len());
            for k in at..at + count {
                // SAFETY: a leaf's packs are in the list; `wide::Tree::build` wrote their places.
                let pack: &Pack = unsafe { tree.packs.get_unchecked(k) };
                primitive_tests += 8;
                let (mut lanes, sure) = if TEXTBOOK {
                    (textbook::moeller_trumbore_lanes(isa, ray.origin.into(), ray.direction.into(), pack), 0)
                } else {
                    wide.candidates(isa, &frame, pack, t_far_pack, ANY, &mut moved)
                };
                if ANY && sure != 0 {
                    changed = true;
                    break 'next;
                }
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize;
                    lanes &= lanes - 1;
                    let hit = if TEXTBOOK {
                        textbook::moeller_trumbore(ray.origin.into(), ray.direction.into(), pack.corners(lane))
                    } else {
                        let three = |k: usize| [moved[k].lane(lane), moved[k + 1].lane(lane), moved[k + 2].lane(lane)];
                        frame.decide(three(0), three(3), three(6), || pack.corners(lane))
                    };
                    let Some(hit) = hit else { continue };
                    if nearest.offer(rank, pack.id(lane), hit.t, hit.b1, hit.b2) {
                        changed = true;
                        if ANY {
                            break 'next;
                        }
                        t_far = nearest.t * (1.0 + WIDEN);
                        t_far_boxes = boxes.splat(t_far);
                        t_far_pack = isa.splat(t_far);
                    }
                }
            }
        }
        loop {
            if top == 0 {
                break 'next;
            }
            top -= 1;
            // SAFETY: below the top all entries have been written.
            let entry = unsafe { *stack.add(top) };
            current = entry as u32;
            // As whole numbers: sooner known, and in the same order.
            if ANY || (entry >> 32) as i32 <= t_far.to_bits() as i32 {
                break;
            }
        }
    }
    counters.node_tests += node_tests;
    counters.primitive_tests += primitive_tests;
    changed
}

impl<const W: usize> Wide<W> {
    #[inline(always)]
    fn prefetch(&self, isa: impl Isa, child: u32) {
        // Chosen without a branch: leaves and nodes come in no order that could be foretold. For items this is an
        // address of no meaning, which a prefetch may be given.
        let leaf = child & LEAF != 0;
        let base = if leaf { self.packs.as_ptr().cast::<u8>() } else { self.nodes.as_ptr().cast() };
        let size = if leaf { size_of::<Pack>() } else { size_of::<Node<W>>() };
        isa.prefetch(base.wrapping_add((child & FIRST_MASK) as usize * size), 4);
    }
}
