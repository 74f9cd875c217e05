//! .

pub mod stability;
