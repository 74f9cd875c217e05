//! Options that all commands share which hold methods against a reference.

use std::path::PathBuf;

use clap::value_parser;
use etcetera::BaseStrategy;

use crate::{error::Failure, services};

/// Where references are kept, with how many threads pictures are rendered, and how the answer is printed.
#[derive(Debug, Clone, clap::Args)]
pub struct Bench {
    /// Keep references here, so that they are rendered once [default: tessera in the user's cache folder]
    #[arg(long, value_name = "DIR", env = "TESSERA_CACHE")]
    pub cache: Option<PathBuf>,
    /// Threads to render with [default: all cores]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

impl Bench {
    /// How many threads render.
    pub fn threads(&self) -> usize {
        services::threads(self.threads)
    }

    /// Where references are kept.
    ///
    /// # Errors
    /// None is named, and no home folder is known.
    pub fn cache(&self) -> Result<PathBuf, Failure> {
        match &self.cache {
            Some(folder) => Ok(folder.clone()),
            None => {
                etcetera::choose_base_strategy().map(|strategy| strategy.cache_dir().join("tessera")).map_err(|_| {
                    Failure::Input("--cache: give a folder to keep references in; no home folder is known".into())
                })
            }
        }
    }
}
