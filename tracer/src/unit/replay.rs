//! One sample again, alone, with its path written down.

use std::fmt;

use crate::{
    geometry::Counters,
    integrator::{End, Integrator, Probe, Vertex},
    math::Rgb,
    sampler::Sampler,
};

/// A sample and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// Its radiance, the same bits as in the image.
    pub radiance: Rgb,
    /// The path.
    pub vertices: Vec<Vertex>,
    /// Why it ended.
    pub end: End,
}

impl Replay {
    pub(super) fn of(integrator: &Integrator, sampler: &Sampler, [x, y]: [u32; 2], sample: u32) -> Self {
        let mut log = Replay { radiance: Rgb::ZERO, vertices: Vec::new(), end: End::Escaped };
        let stream = sampler.stream(x, y, sample);
        log.radiance = integrator.probed(x, y, &stream, &mut Counters::default(), &mut log).radiance;
        log
    }
}

impl Probe for Replay {
    fn vertex(&mut self, vertex: &Vertex) {
        self.vertices.push(*vertex);
    }

    fn end(&mut self, end: End, _: Rgb) {
        self.end = end;
    }
}

impl fmt::Display for Replay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for vertex in &self.vertices {
            writeln!(f, "{vertex}")?;
        }
        write!(f, "the path {}; radiance {}", self.end, self.radiance)
    }
}
