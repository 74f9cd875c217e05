//! From the binary tree to the wide one: which subtrees become children of one node.
//!
//! Of all ways to make wide nodes and leaves of a binary tree's subtrees, the cheapest by the surface area heuristic,
//! found from the leaves upwards: Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through
//! Compressed Wide BVHs" (HPG 2017), section 3.1.

use super::build::Node2;

/// What a node costs, in units of a pack.
const NODE: f32 = 1.0;

/// What the primitives of a subtree cost as at most 1, 2, ... children of a node of `W`: reach times packs and nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Table<const W: usize>([f32; W]);

/// How a subtree is best shared out: for 2 to `W` children how many of them the left half gets, 3 bits each, 0 where one
/// child less does as well; the highest bit says that the subtree as one child is a leaf.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shares(u32);

const IS_LEAF: u32 = 1 << 31;

impl Shares {
    /// One leaf, however many children there could be.
    pub const LEAF: Self = Self(IS_LEAF);

    fn left(self, children: usize) -> usize {
        (self.0 >> (3 * children) & 7) as usize
    }

    /// Whether as one child it is a leaf.
    pub fn is_leaf(self) -> bool {
        self.0 & IS_LEAF != 0
    }
}

impl<const W: usize> Table<W> {
    /// Of a leaf.
    pub fn leaf(cost: f32) -> Self {
        Self([cost; W])
    }

    /// Of a node with two halves. `leaf` is what it costs as a leaf, if it can be one.
    #[inline(always)]
    pub fn of(left: &Self, right: &Self, reach: f32, leaf: Option<f32>) -> (Self, Shares) {
        let mut cost = [0.0; W];
        let mut shares = 0;
        for children in 2..=W {
            // The last bits of the cost make room for the left half's share, so that one minimum finds both.
            let key = |l: usize| (left.0[l - 1] + right.0[children - l - 1]).to_bits() & !7 | l as u32;
            let least = (1..children).map(key).fold(u32::MAX, |a, b| if b < a { b } else { a });
            cost[children - 1] = f32::from_bits(least & !7);
            shares |= (least & 7) << (3 * children);
        }
        let node = cost[W - 1] + NODE * reach;
        cost[0] = node;
        if let Some(leaf) = leaf
            && leaf <= node
        {
            cost[0] = leaf;
            shares |= IS_LEAF;
        }
        for children in 2..W {
            if cost[children - 1] >= cost[children - 2] {
                cost[children - 1] = cost[children - 2];
                shares &= !(7 << (3 * children));
            }
        }
        (Self(cost), Shares(shares))
    }
}

/// The children of a wide node, those with the most primitives last: rays that any hit will do for walk them from the last,
/// and find one soonest where there are many.
pub(super) struct Children<const W: usize> {
    pub nodes: [u32; W],
    pub count: usize,
}

impl<const W: usize> Children<W> {
    /// Of the node that stands for the subtree `root`.
    pub fn of(binary: &[Node2], root: u32) -> Self {
        let mut all = Self { nodes: [0; W], count: 0 };
        if binary[root as usize].is_leaf() {
            all.push(root);
        } else {
            all.share(binary, root, W);
            all.nodes[..all.count].sort_by_key(|&node| binary[node as usize].count);
        }
        all
    }

    fn push(&mut self, node: u32) {
        self.nodes[self.count] = node;
        self.count += 1;
    }

    fn share(&mut self, binary: &[Node2], at: u32, mut children: usize) {
        let node = &binary[at as usize];
        while children > 1 && !node.is_leaf() {
            let left = node.shares.left(children);
            if left > 0 {
                self.share(binary, at + 1, left);
                self.share(binary, at + node.right, children - left);
                return;
            }
            children -= 1;
        }
        self.push(at);
    }
}

#[cfg(test)]
mod tests {
    use super::{super::super::tests::Random, *};

    /// A random binary tree of leaves that hold `first..first + count`, in order.
    fn grow<const W: usize>(nodes: &mut Vec<Node2>, random: &mut Random, first: u32, count: u32) -> Table<W> {
        let me = nodes.len();
        let reach = count as f32 * (0.5 + random.unit() as f32);
        let (lo, hi) = ([reach; 3], [reach; 3]);
        nodes.push(Node2 { lo, hi, right: 0, first, count, shares: Shares::LEAF });
        if count == 1 {
            return Table::leaf(reach);
        }
        let left = 1 + random.bits() as u32 % (count - 1);
        let l = grow(nodes, random, first, left);
        let right = (nodes.len() - me) as u32;
        let r = grow(nodes, random, first + left, count - left);
        let (table, shares) = Table::of(&l, &r, reach, (count <= 4).then_some(2.0 * reach));
        (nodes[me].right, nodes[me].shares) = (right, shares);
        table
    }

    /// Cost of the wide tree that is made, and what its leaves hold.
    fn walk<const W: usize>(nodes: &[Node2], root: u32, leaves: &mut Vec<u32>) -> f32 {
        let children = Children::<W>::of(nodes, root);
        assert!(children.nodes[..children.count].is_sorted_by_key(|&child| nodes[child as usize].count));
        let mut cost = NODE * nodes[root as usize].lo[0];
        for &child in &children.nodes[..children.count] {
            let node = &nodes[child as usize];
            if node.shares.is_leaf() {
                leaves.extend(node.first..node.first + node.count);
                cost += if node.count == 1 { 1.0 } else { 2.0 } * node.lo[0];
            } else {
                cost += walk::<W>(nodes, child, leaves);
            }
        }
        cost
    }

    /// The least cost of a subtree as at most so many children, by trying everything.
    fn least<const W: usize>(nodes: &[Node2], at: u32, children: usize) -> f32 {
        let node = &nodes[at as usize];
        let reach = node.lo[0];
        if node.is_leaf() {
            return reach;
        }
        let (l, r) = (at + 1, at + node.right);
        let split = |n: usize| {
            (1..n).map(|k| least::<W>(nodes, l, k) + least::<W>(nodes, r, n - k)).fold(f32::INFINITY, f32::min)
        };
        if children > 1 {
            return split(children).min(least::<W>(nodes, at, children - 1));
        }
        let leaf = if node.count <= 4 { 2.0 * reach } else { f32::INFINITY };
        leaf.min(split(W) + NODE * reach)
    }

    fn check<const W: usize>(count: u32, random: &mut Random) {
        let mut nodes = Vec::new();
        let Table::<W>(table) = grow(&mut nodes, random, 0, count);
        let mut leaves = Vec::new();
        let cost = walk::<W>(&nodes, 0, &mut leaves);
        leaves.sort_unstable();
        assert_eq!(leaves, (0..count).collect::<Vec<_>>());
        let root = NODE * nodes[0].lo[0];
        let promised = table[W - 1] + root;
        assert!((cost - promised).abs() < 1e-4 * cost, "{cost} is not {promised}");
        let best = least::<W>(&nodes, 0, W) + root;
        assert!((cost - best).abs() < 1e-4 * cost, "{cost}, but {best} can be had");
    }

    #[test]
    fn the_cheapest_wide_tree_is_found_and_made() {
        let mut random = Random(11);
        for count in [2, 3, 5, 9, 12] {
            for _ in 0..4 {
                check::<4>(count, &mut random);
                check::<8>(count, &mut random);
            }
        }
    }
}
