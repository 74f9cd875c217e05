//! Light samples of many hits at once.

use common::method::LightSampling;

use super::{Area, Ball, Choice, Emitter, LightSample, Lights, Reference, Source, Stratum, alias};
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
}

impl Lights {
    /// One sample of [`Lights::for_each`], of up to [`crate::lanes::WIDTH`] hits at once: `query` gives the reference and the
    /// numbers of each, `visit` takes its sample, or with `balls` a sphere that is to be sampled by solid angle. `round`
    /// counts the samples that a hit takes, all lights before the next stratum of `strata`.
    pub(crate) fn for_all(
        &self,
        proven: Proven,
        n: usize,
        (round, strata): (u32, u32),
        balls: bool,
        query: impl Fn(usize) -> (Reference, f32, Vec2),
        mut visit: impl FnMut(usize, Drawn),
    ) {
        let lights = self.samples_at_once().max(1);
        let stratum = Stratum { index: round / lights, count: strata };
        let balls = balls && self.sampling == LightSampling::SolidAngle;
        let mut draw = |i: usize, chosen: Option<(Source, f32)>, reference: &Reference, u| {
            let drawn = chosen.map_or(Drawn::Nothing, |(source, chosen)| {
                let ball = if balls { self.ball(source, chosen) } else { None };
                ball.map(Drawn::Ball).unwrap_or_else(|| {
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
                // The same sphere for every hit.
                let ball = light.and_then(|&light| self.lone_source(light)).filter(|_| balls);
                if let Some(ball) = ball.and_then(|source| self.ball(source, 1.0)) {
                    return (0..n).for_each(|i| visit(i, Drawn::Ball(ball)));
                }
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

    /// The emitter that is all of the light with this number.
    fn lone_source(&self, light: u32) -> Option<Source> {
        let area = self.areas.get(light as usize).filter(|area| area.table.len() == 1)?;
        Some(Source::Emitter(area.first))
    }

    /// The sphere that was chosen with probability `chosen`, if it is one.
    #[inline]
    fn ball(&self, source: Source, chosen: f32) -> Option<Ball> {
        let Source::Emitter(emitter) = source else { return None };
        let primitive = &self.emitters[emitter as usize];
        let Emitter::Sphere { center, radius } = primitive.shape else { return None };
        let Area { radiance, two_sided, .. } = self.areas[primitive.area as usize];
        Some(Ball { center, radius, two_sided, radiance, chosen })
    }

    /// Whether any emitter is a sphere that is sampled by solid angle.
    #[must_use]
    pub fn has_balls(&self) -> bool {
        self.sampling == LightSampling::SolidAngle
            && self.emitters.iter().any(|primitive| matches!(primitive.shape, Emitter::Sphere { .. }))
    }
}
