//! Farms of real processes: what they make, and what they survive.

mod interrupt;
mod json;
mod kills;
mod processes;
mod rest;
mod targets;
