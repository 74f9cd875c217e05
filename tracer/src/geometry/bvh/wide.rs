//! The tree that rays walk: eight children a node, or four, and triangles in packs of eight.

use rayon::prelude::*;

use super::{
    super::{
        Bounds, pages,
        simd::Row,
        triangle::{ID_BITS, Pack},
    },
    Recipe, Width,
    build::{self, Kind, MAX_DEPTH, Node2, PACK, Ref},
    collapse::Children,
};

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
#[repr(C, align(32))]
pub(super) struct Node<const W: usize> {
    pub rows: [Row<W>; 6],
    pub children: [u32; W],
}

/// Nodes, the first one the root, and what their leaves hold. Items are named by their number alone.
#[derive(Clone, Debug)]
pub(super) struct Wide<const W: usize> {
    pub nodes: Vec<Node<W>>,
    pub packs: Vec<Pack>,
    /// Numbers of the items, in leaf order.
    pub items: Vec<u32>,
}

/// Of either width.
#[derive(Clone, Debug)]
pub(super) enum Body {
    Eight(Wide<8>),
    Four(Wide<4>),
}

/// A tree over triangles and items.
#[derive(Clone, Debug)]
pub(in super::super) struct Tree {
    pub(super) body: Body,
    /// None where it holds nothing.
    pub bounds: Option<Bounds>,
    pub depth: usize,
}

/// A wide node before it is filled.
struct Plan<const W: usize> {
    children: Children<W>,
    codes: [u32; W],
}

impl Tree {
    /// `corners` gives a triangle's corners by its number.
    pub fn build(refs: Vec<Ref>, recipe: Recipe, corners: impl Fn(u32) -> [[f32; 3]; 3] + Sync) -> Self {
        match recipe.width {
            Width::Eight => Self::of(refs, recipe, corners, Body::Eight),
            Width::Four => Self::of(refs, recipe, corners, Body::Four),
        }
    }

    fn of<const W: usize>(
        mut refs: Vec<Ref>,
        recipe: Recipe,
        corners: impl Fn(u32) -> [[f32; 3]; 3] + Sync,
        body: fn(Wide<W>) -> Body,
    ) -> Self {
        debug_assert!(refs.len() <= MAX_PRIMITIVES);
        let binary = build::build::<W>(&mut refs, recipe.method, recipe.proof);
        let Some(root) = binary.first() else {
            let none = Wide { nodes: Vec::new(), packs: Vec::new(), items: Vec::new() };
            return Self { body: body(none), bounds: None, depth: 0 };
        };
        let Plans { plans, packs, items, depth } = Plans::<W>::of(&binary, &refs);
        let nodes = pages::collect(plans.par_iter().map(|plan| fill(plan, &binary)));
        let packs =
            packs.par_iter().map(|&(first, count)| pack(&refs[first as usize..(first + count) as usize], &corners));
        let packs = pages::collect(packs);
        let bounds = Bounds { lo: root.lo.into(), hi: root.hi.into() };
        Self { body: body(Wide { nodes, packs, items }), bounds: Some(bounds), depth }
    }

    /// Bytes of nodes, packs and items.
    pub fn bytes(&self) -> usize {
        match &self.body {
            Body::Eight(wide) => wide.bytes(),
            Body::Four(wide) => wide.bytes(),
        }
    }

    pub fn node_count(&self) -> usize {
        match &self.body {
            Body::Eight(wide) => wide.nodes.len(),
            Body::Four(wide) => wide.nodes.len(),
        }
    }

    /// Everything that decides a hit, as bits: equal for equal trees.
    #[cfg(test)]
    pub fn bits(&self) -> Vec<u32> {
        match &self.body {
            Body::Eight(wide) => wide.bits(),
            Body::Four(wide) => wide.bits(),
        }
    }
}

impl<const W: usize> Wide<W> {
    fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.packs) + size_of_val(&*self.items)
    }

    #[cfg(test)]
    fn bits(&self) -> Vec<u32> {
        let mut all = Vec::new();
        for n in &self.nodes {
            all.extend(n.rows.iter().flat_map(|row| row.0.map(f32::to_bits)));
            all.extend(n.children);
        }
        for p in &self.packs {
            all.extend(p.bits());
        }
        all.extend(&self.items);
        all
    }
}

/// Wide nodes, the first one the root, and what their leaves hold.
struct Plans<const W: usize> {
    plans: Vec<Plan<W>>,
    /// Places of the packs' first references, and how many there are.
    packs: Vec<(u32, u32)>,
    items: Vec<u32>,
    depth: usize,
}

impl<const W: usize> Plans<W> {
    /// Inner children of a node become consecutive nodes; leaves come in the order in which nodes are planned.
    fn of(binary: &[Node2], refs: &[Ref]) -> Self {
        let none = || Plan { children: Children { nodes: [0; W], count: 0 }, codes: [0; W] };
        let mut all = Self {
            plans: Vec::with_capacity(refs.len() / 24 + 1),
            packs: Vec::with_capacity(refs.len() / 6 + 1),
            items: Vec::new(),
            depth: 0,
        };
        all.plans.push(none());
        let mut todo = vec![(0u32, 0usize, 1usize)];
        while let Some((root, at, depth)) = todo.pop() {
            all.depth = all.depth.max(depth);
            let children = Children::of(binary, root);
            let mut codes = [0; W];
            for (code, &child) in codes.iter_mut().zip(&children.nodes[..children.count]) {
                let node = &binary[child as usize];
                *code = if node.shares.is_leaf() {
                    all.leaf(node, refs)
                } else {
                    all.plans.push(none());
                    all.plans.len() as u32 - 1
                };
            }
            for (&code, &child) in codes.iter().zip(&children.nodes[..children.count]).rev() {
                if code & LEAF == 0 {
                    todo.push((child, code as usize, depth + 1));
                }
            }
            all.plans[at] = Plan { children, codes };
        }
        debug_assert!(all.depth <= MAX_DEPTH + 1);
        all
    }

    fn leaf(&mut self, node: &Node2, refs: &[Ref]) -> u32 {
        let members = &refs[node.first as usize..(node.first + node.count) as usize];
        if members[0].kind() == Kind::Item {
            let at = self.items.len() as u32;
            self.items.extend(members.iter().map(Ref::id));
            return LEAF | ITEMS | node.count << COUNT_SHIFT | at;
        }
        let at = self.packs.len() as u32;
        let pack = |k: u32| (node.first + k, (node.count - k).min(PACK as u32));
        self.packs.extend((0..node.count).step_by(PACK).map(pack));
        LEAF | node.count.div_ceil(PACK as u32) << COUNT_SHIFT | at
    }
}

fn fill<const W: usize>(plan: &Plan<W>, binary: &[Node2]) -> Node<W> {
    let mut rows = [Row([f32::INFINITY; W]); 6];
    rows[3..].fill(Row([f32::NEG_INFINITY; W]));
    for (k, &child) in plan.children.nodes[..plan.children.count].iter().enumerate() {
        let node = &binary[child as usize];
        for axis in 0..3 {
            rows[axis].0[k] = node.lo[axis];
            rows[3 + axis].0[k] = node.hi[axis];
        }
    }
    Node { rows, children: plan.codes }
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
