//! The tree that rays walk: eight children a node, triangles in packs of eight.

use rayon::prelude::*;

use super::{
    super::{
        Bounds, pages,
        simd::Row,
        triangle::{ID_BITS, Pack},
    },
    BuildMethod,
    build::{self, Kind, MAX_DEPTH, Node2, PACK, Ref},
};

/// Children of a node.
const WIDTH: usize = 8;
/// Marks a child that is a leaf.
pub(super) const LEAF: u32 = 1 << 31;
/// Marks a leaf of items rather than packs.
pub(super) const ITEMS: u32 = 1 << 30;
/// Where a leaf's count of packs or items is, and its mask.
pub(super) const COUNT_SHIFT: u32 = 27;
pub(super) const COUNT_MASK: u32 = 7;
/// The place of a leaf's first pack or item.
pub(super) const FIRST_MASK: u32 = (1 << COUNT_SHIFT) - 1;
/// More primitives than this in one tree are not taken: places in a leaf have 27 bits, and a leaf may
/// hold one triangle; so have their numbers in packs.
pub(in super::super) const MAX_PRIMITIVES: usize = 1 << COUNT_SHIFT;
const _: () = assert!(COUNT_SHIFT == ID_BITS);

/// A node. Rows 0 to 2 are the children's smallest coordinates, 3 to 5 the largest; a child that is not
/// there has a box that no ray meets.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Node {
    pub rows: [Row; 6],
    pub children: [u32; WIDTH],
}

/// A tree over triangles and items. Items are named by their number alone.
#[derive(Clone, Debug, Default)]
pub(in super::super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) packs: Vec<Pack>,
    /// Numbers of the items, in leaf order.
    pub(super) items: Vec<u32>,
    pub bounds: Option<Bounds>,
    pub depth: usize,
}

/// A wide node before it is filled: its children in the binary tree.
struct Plan {
    children: [u32; WIDTH],
    count: usize,
    /// Inner children become consecutive nodes from here.
    base: u32,
}

impl Tree {
    /// `corners` gives a triangle's corners by its number.
    pub fn build(mut refs: Vec<Ref>, method: BuildMethod, corners: impl Fn(u32) -> [[f32; 3]; 3] + Sync) -> Self {
        debug_assert!(refs.len() <= MAX_PRIMITIVES);
        let binary = build::build(&mut refs, method);
        if binary.is_empty() {
            return Self::default();
        }
        let (plans, depth) = collapse(&binary);

        // Leaves in the order of the nodes that hold them.
        let mut packs: Vec<(u32, u32)> = Vec::with_capacity(refs.len() / 4 + 1);
        let mut items = Vec::new();
        let mut leaves = vec![0u32; binary.len()];
        for plan in &plans {
            for &child in &plan.children[..plan.count] {
                let leaf = &binary[child as usize];
                if !leaf.is_leaf() {
                    continue;
                }
                let members = &refs[leaf.first as usize..(leaf.first + leaf.count) as usize];
                let code = if members[0].kind() == Kind::Item {
                    let at = items.len() as u32;
                    items.extend(members.iter().map(Ref::id));
                    ITEMS | (members.len() as u32) << COUNT_SHIFT | at
                } else {
                    let at = packs.len() as u32;
                    packs.extend(
                        (0..leaf.count).step_by(PACK).map(|k| (leaf.first + k, (leaf.count - k).min(PACK as u32))),
                    );
                    leaf.count.div_ceil(PACK as u32) << COUNT_SHIFT | at
                };
                leaves[child as usize] = LEAF | code;
            }
        }
        let nodes = pages::collect(plans.par_iter().map(|plan| fill(plan, &binary, &leaves)));
        let packs =
            packs.par_iter().map(|&(first, count)| pack(&refs[first as usize..(first + count) as usize], &corners));
        let packs = pages::collect(packs);
        let all = &binary[0].bounds;
        let bounds = Bounds { lo: glam::Vec3::from_slice(&all.lo), hi: glam::Vec3::from_slice(&all.hi) };
        Self { nodes, packs, items, bounds: Some(bounds), depth }
    }

    /// Bytes of nodes, packs and items.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.packs) + size_of_val(&*self.items)
    }

    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Everything that decides a hit, as bits: equal for equal trees.
    #[cfg(test)]
    pub fn bits(&self) -> Vec<u32> {
        let rows = |rows: &[Row]| rows.iter().flat_map(|r| r.0.map(f32::to_bits)).collect::<Vec<_>>();
        let mut all = Vec::new();
        for n in &self.nodes {
            all.extend(rows(&n.rows));
            all.extend(n.children);
        }
        for p in &self.packs {
            all.extend(p.bits());
        }
        all.extend(&self.items);
        all
    }
}

/// Decide which nodes of the binary tree become children of which wide node, and the depth of that tree.
/// Node 0 is the root; a leaf alone still gets a node above it.
fn collapse(binary: &[Node2]) -> (Vec<Plan>, usize) {
    let mut plans = vec![Plan { children: [0; WIDTH], count: 0, base: 0 }];
    let mut todo = vec![(0u32, 0usize, 1usize)];
    let mut deepest = 0;
    while let Some((root, at, depth)) = todo.pop() {
        deepest = deepest.max(depth);
        let mut children = [0; WIDTH];
        let mut areas = [0.0f32; WIDTH];
        // Area by which a child is opened; leaves cannot be.
        let opens = |child: u32| {
            let node = &binary[child as usize];
            if node.is_leaf() { -1.0 } else { node.bounds.half_area(1.0) }
        };
        (children[0], areas[0]) = (root, opens(root));
        let mut count = 1;
        while count < WIDTH {
            let k = (1..count).fold(0, |k, i| if areas[i] > areas[k] { i } else { k });
            if areas[k] < 0.0 {
                break;
            }
            let (left, right) = (children[k] + 1, children[k] + binary[children[k] as usize].right);
            (children[k], areas[k]) = (left, opens(left));
            (children[count], areas[count]) = (right, opens(right));
            count += 1;
        }
        let base = plans.len() as u32;
        plans[at] = Plan { children, count, base };
        let inner = children[..count].iter().filter(|&&c| !binary[c as usize].is_leaf());
        let inner: Vec<u32> = inner.copied().collect();
        for _ in &inner {
            plans.push(Plan { children: [0; WIDTH], count: 0, base: 0 });
        }
        for (i, &child) in inner.iter().enumerate().rev() {
            todo.push((child, base as usize + i, depth + 1));
        }
    }
    debug_assert!(deepest <= MAX_DEPTH + 1);
    (plans, deepest)
}

fn fill(plan: &Plan, binary: &[Node2], leaves: &[u32]) -> Node {
    let mut rows = [Row([f32::INFINITY; 8]); 6];
    rows[3..].fill(Row([f32::NEG_INFINITY; 8]));
    let mut children = [0; WIDTH];
    let mut next = plan.base;
    for (k, &child) in plan.children[..plan.count].iter().enumerate() {
        let node = &binary[child as usize];
        for axis in 0..3 {
            rows[axis].0[k] = node.bounds.lo[axis];
            rows[3 + axis].0[k] = node.bounds.hi[axis];
        }
        children[k] = if node.is_leaf() {
            leaves[child as usize]
        } else {
            next += 1;
            next - 1
        };
    }
    Node { rows, children }
}

fn pack(members: &[Ref], corners: &impl Fn(u32) -> [[f32; 3]; 3]) -> Pack {
    let mut rows = [Row([0.0; 8]); 9];
    for lane in 0..PACK {
        let id = members.get(lane).unwrap_or(&members[0]).id();
        for (corner, p) in corners(id).iter().enumerate() {
            for (axis, &x) in p.iter().enumerate() {
                rows[3 * corner + axis].0[lane] = x;
            }
        }
    }
    Pack::new(rows, members.iter().map(Ref::id))
}
