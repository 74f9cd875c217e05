//! What the tests of the whole share: the makers of what scenes/ keeps.

pub mod cornell;
pub mod meshes;
