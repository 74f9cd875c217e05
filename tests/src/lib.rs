//! What the tests of the whole share: the makers of what scenes/ keeps, and the tracer without the farm.

pub mod cornell;
pub mod direct;
pub mod meshes;
