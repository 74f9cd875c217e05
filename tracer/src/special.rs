//! What code is specialised on, and how to leave that unused: to measure what each specialisation saves, and to prove that
//! none changes a bit.
//!
//! A specialisation is a path through the code that a fact of the scene, of the method or of the processor opens. Leaving it
//! out makes the renderer do what it would for a scene without that fact.

/// A specialisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Special {
    /// Many paths side by side; without it, one path at a time.
    Waves,
    /// No opacity masks; without it, every hit is asked, and shadow rays look at each surface on their way.
    Opacity,
    /// Few primitives; without it, they are found by way of a tree.
    Few,
    /// Two triangles that make a flat quadrilateral are one; without it, each is held against rays by itself.
    Quads,
    /// Rays are held against neither the plane that they leave nor that of the lamp, or the sphere, which they end before;
    /// without it, they are.
    Planes,
    /// The only light is a rectangle; without it, its samples are taken as those of any light.
    Lamp,
    /// Lambert's law for many paths at once; without it, each is asked of its material.
    Lambert,
    /// Rough metals for many paths at once; without it, each is asked of its material.
    Facets,
    /// Points on spheres that shine for many paths at once; without it, they are chosen one by one.
    Balls,
    /// Points on triangles that shine for many paths at once; without it, they are chosen one by one.
    Shards,
    /// A pinhole, and pixels that weigh all of their area alike; without it, rays are made one by one.
    Pinhole,
    /// Points of a batch of Sobol' numbers for many paths at once; without it, they are drawn one by one.
    Points,
    /// Russian roulette for many paths at once; without it, it is played one by one.
    Roulette,
    /// No mirrors or smooth glass; without it, paths of light sampling alone go on to the last scattering.
    NoDeltas,
    /// AVX-512; without it, AVX2.
    Avx512,
    /// AVX2; without it and AVX-512, what every processor of the kind has.
    Avx2,
}

impl Special {
    /// All of them, by name.
    pub const ALL: &[(&str, Self)] = &[
        ("waves", Self::Waves),
        ("opacity", Self::Opacity),
        ("few", Self::Few),
        ("quads", Self::Quads),
        ("planes", Self::Planes),
        ("lamp", Self::Lamp),
        ("lambert", Self::Lambert),
        ("facets", Self::Facets),
        ("balls", Self::Balls),
        ("shards", Self::Shards),
        ("pinhole", Self::Pinhole),
        ("points", Self::Points),
        ("roulette", Self::Roulette),
        ("no-deltas", Self::NoDeltas),
        ("avx512", Self::Avx512),
        ("avx2", Self::Avx2),
    ];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, special)| *special == self).map_or("", |(name, _)| name)
    }

    /// What is left out thanks to it, for people.
    #[must_use]
    pub fn spares(self) -> &'static str {
        match self {
            Self::Waves => "one path at a time",
            Self::Opacity => "opacity masks",
            Self::Few => "a tree over the surfaces",
            Self::Quads => "each half of a quadrilateral by itself",
            Self::Planes => "the planes that rays leave or end before, and spheres",
            Self::Lamp => "lights of other shapes than one rectangle",
            Self::Lambert => "asking each material how it scatters",
            Self::Facets => "asking each rough metal how it scatters",
            Self::Balls => "points on shining spheres one by one",
            Self::Shards => "points on shining triangles one by one",
            Self::Pinhole => "depth of field, pixel filters",
            Self::Points => "points drawn one by one",
            Self::Roulette => "roulette played one by one",
            Self::NoDeltas => "mirrors and smooth glass at a path's end",
            Self::Avx512 => "AVX2 in place of AVX-512",
            Self::Avx2 => "the instructions of every processor",
        }
    }
}

/// Specialisations to leave unused.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Without(u32);

impl Without {
    /// None is left unused.
    pub const NOTHING: Self = Self(0);

    /// Those given.
    #[must_use]
    pub fn all(specials: &[Special]) -> Self {
        Self(specials.iter().fold(0, |bits, special| bits | 1 << *special as u32))
    }

    /// Whether `special` is left unused.
    #[must_use]
    pub fn leaves(self, special: Special) -> bool {
        self.0 >> special as u32 & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_left_out_by_itself() {
        for (name, special) in Special::ALL {
            let without = Without::all(&[*special]);
            let left: Vec<&str> =
                Special::ALL.iter().filter(|(_, s)| without.leaves(*s)).map(|(name, _)| *name).collect();
            assert_eq!((left, special.name()), (vec![*name], *name));
            assert!(!Without::NOTHING.leaves(*special) && !special.spares().is_empty());
        }
    }
}
