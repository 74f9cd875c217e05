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
use super::super::simd::{Avx2, Sse2};
use super::{
    super::{
        Counters, Ray,
        simd::{Isa, Lanes, Portable, Row},
        textbook,
        triangle::{Pack, RayFrame, WideFrame},
    },
    build::MAX_DEPTH,
    wide::{COUNT_MASK, COUNT_SHIFT, FIRST_MASK, ITEMS, LEAF, Node, Tree},
};

/// A node leaves at most seven of its children for later.
const STACK: usize = 7 * (MAX_DEPTH + 1) + 8;
/// Relative widening, in units of the last place of 1: 2 gamma(3) for the slabs, 2 gamma(5) for the
/// corners, and as much again.
pub(in super::super) const WIDEN: f32 = 16.0 * f32::EPSILON;

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
pub(in super::super) trait Traverse: Isa {
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
                fn compiled<const ANY: bool, const TEXTBOOK: bool>(
                    isa: $isa,
                    tree: &Tree,
                    rank: u32,
                    items: &impl Items,
                    ray: &Ray,
                    nearest: &mut Nearest,
                    counters: &mut Counters,
                ) -> bool {
                    trace::<$isa, ANY, TEXTBOOK>(isa, tree, rank, items, ray, nearest, counters)
                }
                #[allow(unused_unsafe, reason = "only where there are features to promise")]
                // SAFETY: the value `self` exists only where the processor has what the attribute names.
                unsafe {
                    compiled::<ANY, TEXTBOOK>(self, tree, rank, items, ray, nearest, counters)
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
traverse!(Avx2, #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]);
#[cfg(target_arch = "x86_64")]
traverse!(Sse2,);
traverse!(Portable,);

#[inline(always)]
fn trace<I: Traverse, const ANY: bool, const TEXTBOOK: bool>(
    isa: I,
    tree: &Tree,
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
    // Rows of the near and far side of each permuted axis.
    let near_row: [usize; 3] = std::array::from_fn(|i| {
        let negative = frame.direction[i].is_sign_negative();
        frame.axes[i] + if negative { 3 } else { 0 }
    });
    let far_row: [usize; 3] = std::array::from_fn(|i| 2 * frame.axes[i] + 3 - near_row[i]);
    let o = [isa.splat(frame.origin[0]), isa.splat(frame.origin[1]), isa.splat(frame.origin[2])];
    let r = [isa.splat(frame.reciprocal[0]), isa.splat(frame.reciprocal[1]), isa.splat(frame.reciprocal[2])];
    let zero = isa.splat(0.0);
    let behind = isa.splat(2.0 * WIDEN);
    let grow = isa.splat(1.0 + WIDEN);
    // Everything that compares with the nearest hit does so with this margin.
    let mut t_far = nearest.t * (1.0 + WIDEN);
    let mut t_far_wide = isa.splat(t_far);
    let mut changed = false;
    let (mut node_tests, mut primitive_tests) = (0u64, 0u64);

    // Entries: the near parameter's bits above, the child below. The bits of numbers that are not negative
    // are ordered as the numbers are; negative ones come before all of them, which is all that is needed.
    let mut stack = [const { MaybeUninit::<i64>::uninit() }; STACK];
    let stack = stack.as_mut_ptr().cast::<i64>();
    let mut top = 0usize;
    let mut current = 0u32;
    let mut near_store = Row([0.0; 8]);
    let mut moved = [Row([0.0; 8]); 9];

    'next: loop {
        'pop: {
            if current & LEAF == 0 {
                debug_assert!((current as usize) < tree.nodes.len());
                // SAFETY: inner children are places of nodes; `wide::Tree::build` wrote them.
                let node: &Node = unsafe { tree.nodes.get_unchecked(current as usize) };
                node_tests += 1;
                let slab = |row: usize, axis: usize| {
                    // SAFETY: near and far rows are an axis, or an axis and 3.
                    isa.load(unsafe { node.rows.get_unchecked(row) }).sub(o[axis]).mul(r[axis])
                };
                let z = slab(near_row[2], 2);
                let near = slab(near_row[0], 0).max(slab(near_row[1], 1).max(z.max(zero)));
                let near = near.add(z.min(zero).mul(behind));
                let far = slab(far_row[0], 0).min(slab(far_row[1], 1).min(slab(far_row[2], 2).min(t_far_wide)));
                let mut mask = near.le(far.mul(grow));
                if mask == 0 {
                    break 'pop;
                }
                let take = |mask: &mut u32| {
                    let i = mask.trailing_zeros() as usize;
                    *mask &= *mask - 1;
                    i
                };
                // SAFETY: a bit of the mask is below 8.
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
                near.store(&mut near_store);
                let key = |i: usize| {
                    let child = child(i);
                    tree.prefetch(isa, child);
                    i64::from(near_store.0[i & 7].to_bits() as i32) << 32 | i64::from(child)
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
                    t_far_wide = isa.splat(t_far);
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
                    wide.candidates(isa, &frame, pack, t_far_wide, ANY, &mut moved)
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
                        let three = |k: usize| [moved[k], moved[k + 1], moved[k + 2]].map(|row| row.0[lane & 7]);
                        frame.decide(three(0), three(3), three(6), || pack.corners(lane))
                    };
                    let Some(hit) = hit else { continue };
                    if nearest.offer(rank, pack.ids[lane & 7], hit.t, hit.b1, hit.b2) {
                        changed = true;
                        if ANY {
                            break 'next;
                        }
                        t_far = nearest.t * (1.0 + WIDEN);
                        t_far_wide = isa.splat(t_far);
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
            if ANY || f32::from_bits((entry >> 32) as u32) <= t_far {
                break;
            }
        }
    }
    counters.node_tests += node_tests;
    counters.primitive_tests += primitive_tests;
    changed
}

impl Tree {
    #[inline(always)]
    fn prefetch<I: Isa>(&self, isa: I, child: u32) {
        if child & LEAF == 0 {
            let node = self.nodes.as_ptr().wrapping_add(child as usize);
            isa.prefetch(node.cast(), size_of::<Node>().div_ceil(64));
        } else {
            // For items this is an address of no meaning, which a prefetch may be given.
            let pack = self.packs.as_ptr().wrapping_add((child & FIRST_MASK) as usize);
            isa.prefetch(pack.cast(), 4);
        }
    }
}
