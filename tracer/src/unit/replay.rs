//! One sample again, alone, with its path written down.

use std::fmt;

use super::regions::Layout;
use crate::{
    geometry::Counters,
    integrator::{End, Integrator, Probe, Together, Vertex},
    math::Rgb,
    sampler::Sampler,
};

/// A sample and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// Its radiance, the same bits as in the image.
    pub radiance: Rgb,
    /// The path; where pixels share paths, that of this pixel alone.
    pub vertices: Vec<Vertex>,
    /// Why it ended.
    pub end: End,
}

impl Replay {
    pub(super) fn of(
        integrator: &Integrator,
        sampler: &Sampler,
        resolution: [u32; 2],
        [x, y]: [u32; 2],
        sample: u32,
    ) -> Self {
        let mut log = Replay { radiance: Rgb::ZERO, vertices: Vec::new(), end: End::Escaped };
        let mut counters = Counters::default();
        let layout = Layout::of(sampler, resolution, [x, y], sample);
        let group = layout.groups().find(|group| integrator.shares() && group.contains(&[x, y]));
        if let Some(group) = group {
            let members: Vec<[u32; 3]> = group.iter().map(|[x, y]| [*x, *y, sample]).collect();
            let whom = members.iter().position(|member| *member == [x, y, sample]).unwrap_or(0);
            let mut room = Together::default();
            integrator.together(&mut room, sampler, &members, Some((whom, &mut log)), &mut counters);
            log.radiance = room.traced(whom).sample.radiance;
        } else {
            let stream = sampler.stream(x, y, sample);
            log.radiance = integrator.probed(x, y, &stream, &mut counters, &mut log).radiance;
        }
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
