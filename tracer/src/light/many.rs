//! Light samples of many hits at once.

use common::method::LightSampling;

use super::{Area, Ball, Choice, Emitter, LightSample, Lights, Reference, Shard, Source, Stratum, alias};
use crate::{geometry::prefetch, lanes::Proven, math::Vec2};

/// What [`Lights::for_all`] gives a hit.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Drawn {
    /// Nothing that may bring light.
    Nothing,
    /// A sample.
    Sample(LightSample),
    /// A sphere to sample.
    Ball(Ball),
    /// A triangle to sample.
    Shard(Shard),
}

/// Which emitters [`Lights::for_all`] leaves to be sampled all at once.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct AtOnce {
    /// Spheres, by solid angle.
    pub balls: bool,
    /// Triangles, by area.
    pub shards: bool,
}

impl Lights {
    /// One sample of [`Lights::for_each`], of up to [`crate::lanes::WIDTH`] hits at once: `query` gives the reference and the
    /// numbers of each, `visit` takes its sample, or what is to be sampled `at_once`. `round` counts
    /// the samples that a hit takes, all lights before the next stratum of `strata`.
    pub(crate) fn for_all(
        &self,
        proven: Proven,
        n: usize,
        (round, strata): (u32, u32),
        at_once: AtOnce,
        query: impl Fn(usize) -> (Reference, f32, Vec2),
        mut visit: impl FnMut(usize, Drawn),
    ) {
        let lights = self.samples_at_once().max(1);
        let stratum = Stratum { index: round / lights, count: strata };
        let at_once = self.that_suit(at_once);
        let mut draw = |i: usize, chosen: Option<(Source, f32)>, reference: &Reference, u| {
            let drawn = chosen.map_or(Drawn::Nothing, |(source, chosen)| {
                self.left(source, chosen, at_once).unwrap_or_else(|| {
                    self.sample_source(source, chosen, reference, u, stratum).map_or(Drawn::Nothing, Drawn::Sample)
                })
            });
            visit(i, drawn);
        };
        match &self.choice {
            Choice::Tree(tree) => {
                let number = |i| {
                    let (reference, pick, u) = query(i);
                    (reference, alias::lengthen(pick, u))
                };
                let soon = |source| {
                    if let Source::Emitter(emitter) = source {
                        prefetch(&self.emitters[emitter as usize]);
                    }
                };
                tree.pick_all(proven, n, number, soon, |i, chosen| {
                    let (reference, _, u) = query(i);
                    draw(i, chosen, &reference, u);
                });
            }
            Choice::All => {
                let light = self.live.get((round % lights) as usize);
                for i in 0..n {
                    let (reference, pick, u) = query(i);
                    let of = |&light| self.source(light, 1.0, alias::lengthen(pick, u));
                    draw(i, light.and_then(of), &reference, u);
                }
            }
            Choice::Table(table) => {
                for i in 0..n {
                    let (reference, pick, u) = query(i);
                    let light = table.pick(alias::lengthen(pick, u));
                    let of = |(light, probability, rest)| self.source(light, probability, rest);
                    draw(i, light.and_then(of), &reference, u);
                }
            }
        }
    }

    /// What [`Lights::for_all`] would leave to be sampled at once for every hit of a round, where that is the same: one
    /// emitter, where every light is sampled or it is the only one.
    pub(crate) fn same_for_all(&self, round: u32, at_once: AtOnce) -> Option<Drawn> {
        match self.choice {
            Choice::All => {}
            Choice::Table(_) if self.live.len() == 1 => {}
            _ => return None,
        }
        let light = *self.live.get((round % self.samples_at_once().max(1)) as usize)?;
        let area = self.areas.get(light as usize).filter(|area| area.table.len() == 1)?;
        self.left(Source::Emitter(area.first), 1.0, self.that_suit(at_once))
    }

    /// Of `at_once`, what the method samples so.
    pub(super) fn that_suit(&self, at_once: AtOnce) -> AtOnce {
        AtOnce {
            balls: at_once.balls && self.sampling == LightSampling::SolidAngle,
            shards: at_once.shards && self.sampling == LightSampling::Area,
        }
    }

    /// What was chosen with probability `chosen`, if it is to be sampled `at_once`.
    #[inline]
    pub(super) fn left(&self, source: Source, chosen: f32, at_once: AtOnce) -> Option<Drawn> {
        let Source::Emitter(emitter) = source else { return None };
        let primitive = &self.emitters[emitter as usize];
        let Area { radiance, two_sided, .. } = self.areas[primitive.area as usize];
        match primitive.shape {
            Emitter::Sphere { center, radius } if at_once.balls => {
                Some(Drawn::Ball(Ball { emitter, center, radius, two_sided, radiance, chosen }))
            }
            Emitter::Triangle { p } if at_once.shards => Some(Drawn::Shard(Shard { p, two_sided, radiance, chosen })),
            _ => None,
        }
    }

    /// Whether any emitter is a triangle that is sampled by area.
    #[must_use]
    pub fn has_shards(&self) -> bool {
        self.sampling == LightSampling::Area
            && self.emitters.iter().any(|primitive| matches!(primitive.shape, Emitter::Triangle { .. }))
    }

    /// Whether any emitter is a sphere that is sampled by solid angle.
    #[must_use]
    pub fn has_balls(&self) -> bool {
        self.sampling == LightSampling::SolidAngle
            && self.emitters.iter().any(|primitive| matches!(primitive.shape, Emitter::Sphere { .. }))
    }
}
