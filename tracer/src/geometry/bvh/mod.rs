//! The bounding volume hierarchy: a binary tree by the surface area heuristic ([`build`]), the best way to make nodes
//! of eight children of it, or of four ([`collapse`]), those nodes ([`wide`]), and their traversal ([`traverse`]).
//!
//! It knows boxes and numbers; only the traversal knows what they stand for.

mod bins;
mod build;
mod collapse;
pub(super) mod traverse;
mod wide;

use super::simd::Proof;
pub(super) use build::{Kind, Ref};
pub(super) use wide::{MAX_PRIMITIVES, Tree};

/// How to build a tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recipe {
    pub method: BuildMethod,
    pub width: Width,
    /// The instructions to build it with; it is the same tree with any.
    pub proof: Proof,
}

/// How the tree is split.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BuildMethod {
    /// Surface area heuristic over 16 bins on each axis (Wald 2007).
    #[default]
    Sah,
    /// At the mean of the centroids along the longest axis: the textbook's.
    MeanCentroid,
    /// In the middle of the box, on the axis where count times area is least: the textbook's other one.
    Midpoint,
}

/// How many children a node has. It changes the speed and the memory and nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Width {
    /// Eight, whose boxes fill a vector of 256 bits: the faster ones.
    #[default]
    Eight,
    /// Four, in vectors of 128 bits: to be measured beside.
    Four,
}
