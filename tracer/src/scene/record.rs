//! What a path must know of a primitive that it hit, in one place.

use super::Parts;
use crate::{
    geometry::{Accel, Hit},
    math::{Rgb, Vec3},
    microfacet::Ggx,
};

/// A primitive of a world that needs no tree.
#[derive(Debug, Clone, Copy)]
pub struct Record {
    /// Of a triangle, its corners.
    pub corners: Option<[Vec3; 3]>,
    /// Number of its surface.
    pub surface: u32,
    /// Its material.
    pub material: u32,
    /// The emitter that it is, or [`super::NO_EMITTER`].
    pub emitter: u32,
    /// Of Lambert's law with one colour, that colour.
    pub diffuse: Option<Rgb>,
    /// Of a rough metal of one tint, its facets.
    pub facets: Option<Ggx>,
    /// Whether deltas are all that its material has.
    pub delta: bool,
    /// Whether an opaque surface scatters on its back as on its front.
    pub two_sided: bool,
    /// Whether light passes through.
    pub transmissive: bool,
}

impl Record {
    /// Of a hit that is on no instance; `corners` are those of the triangle that was hit.
    #[inline]
    pub(super) fn new(parts: &Parts, shape: u32, primitive: u32, corners: Option<[Vec3; 3]>) -> Self {
        let surface = &parts.surfaces[shape as usize];
        let flat = &parts.flats[surface.material as usize];
        Self {
            corners,
            surface: shape,
            material: surface.material,
            emitter: surface.emitter(primitive),
            diffuse: flat.diffuse,
            facets: flat.facets,
            delta: flat.delta,
            two_sided: flat.two_sided,
            transmissive: flat.transmissive,
        }
    }
}

/// Of every emitter that is a sphere or disk of a small world, its [`Accel::round`].
pub(super) fn rounds(accel: &Accel, records: &[Record]) -> Vec<u32> {
    let mut rounds = Vec::new();
    for (id, record) in records.iter().enumerate() {
        let (bit, emitter) = (accel.round(id), record.emitter as usize);
        if bit != 0 && record.emitter != super::NO_EMITTER {
            rounds.resize(rounds.len().max(emitter + 1), 0);
            rounds[emitter] = bit;
        }
    }
    rounds
}

/// Of every primitive's number in a small world.
pub(super) fn of(accel: &Accel, parts: &Parts) -> Vec<Record> {
    let record = |&(shape, primitive): &(u32, u32)| {
        let hit = Hit { t: 0.0, instance: Hit::NO_INSTANCE, shape, primitive, b1: 0.0, b2: 0.0 };
        Record::new(parts, shape, primitive, accel.world_triangle(&hit))
    };
    accel.places().iter().map(record).collect()
}
