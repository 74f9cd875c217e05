//! A worker: takes leases from a coordinator, renders them, hands the results in.
//!
//! Layout, from the network inwards: [`endpoint`] speaks HTTP, [`link`] repeats what may succeed later,
//! `assets` and `scenes` turn a lease's scene into one that is ready to render, `pool` renders rows on a
//! fixed set of threads, and [`Worker`] ties them together.
//!
//! It knows nothing of stores or of scheduling, and computes no radiance itself.

mod assets;
pub mod clock;
pub mod endpoint;
mod lease;
pub mod link;
pub mod picture;
mod pool;
mod scenes;
mod service;

pub use endpoint::{CallError, Endpoint};
pub use scenes::decode_files;
pub use service::{Config, Worker, WorkerError};
