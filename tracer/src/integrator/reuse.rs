//! Paths of neighbouring pixels share what they find (Bekaert, Sbert and Halton, "Accelerating path tracing by re-using
//! paths", 2002).
//!
//! The paths of one sample of [`MEMBERS`] pixels go on together. Each starts from the surface that its pixel sees, and ends,
//! for this purpose, at the next one, with an estimate of the light that is reflected from there. Every start is joined to
//! every end by a shadow ray, as if it had drawn the direction there itself. Drawn by start k with density p_k, an end counts
//! for start j as f_j L / (sum over k of p_k), the balance heuristic (Veach and Guibas 1995) over all starts that see it: so
//! the expected value of every pixel is what it was, a pixel averages what all members found, and no weight exceeds that of the
//! path's own sample. The price is that the errors of neighbouring pixels have much in common.
//!
//! Starts and ends are surfaces of Lambert's law, where light leaves alike in all directions and a density by solid angle is the
//! cosine over pi. Paths that see or find another surface keep what they find to themselves, and so does light found
//! directly: emission at the end, and light sampled at the start. That is decided by the end or by the start alone, whoever drew it,
//! which is why nothing is counted twice.

use super::{FirstHit, Integrator, Probe, Shading, Traced, Vertex, Walk};
use crate::{
    geometry::{Counters, Spared, spawn_to},
    lanes::WIDTH,
    math::{Rgb, Vec3, select},
    sampler::{Sampler, Stream},
};

/// Pixels that share paths.
pub const MEMBERS: usize = 16;
/// Ends that are joined to the members at once.
pub(super) const AT_ONCE: usize = WIDTH / MEMBERS;

/// A surface where a path can be joined.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joint {
    pub p: Vec3,
    pub p_error: Vec3,
    pub ng: Vec3,
    /// The normal of the side that the path is on.
    pub n: Vec3,
}

/// What a path has in common with others.
#[derive(Debug, Clone, Copy)]
pub(super) struct Share {
    /// Whether it is joined to the ends that others found.
    pub starts: bool,
    pub start: Joint,
    /// What light that arrives at the start counts for, the reflectance there included.
    pub weight: Rgb,
    /// What rays from there need not be held against, if they leave at no flat angle.
    pub own: Spared,
    /// Whether others are joined to its end.
    pub ends: bool,
    pub end: Joint,
    /// Light that leaves the end.
    pub light: Rgb,
    /// Radiance that the path found before its end, which it keeps.
    near: Rgb,
}

impl Joint {
    const NOWHERE: Self = Self { p: Vec3::ZERO, p_error: Vec3::ZERO, ng: Vec3::ZERO, n: Vec3::ZERO };
}

impl Share {
    pub(super) const NOTHING: Self = Self {
        starts: false,
        start: Joint::NOWHERE,
        weight: Rgb::ZERO,
        own: [0; 2],
        ends: false,
        end: Joint::NOWHERE,
        light: Rgb::ZERO,
        near: Rgb::ZERO,
    };

    /// A path starts.
    pub(super) fn of(start: Joint, weight: Rgb, own: Spared) -> Self {
        Self { starts: true, start, weight, own, ..Self::NOTHING }
    }

    /// The path has come to its end with `radiance` and `throughput`: the throughput to go on with. It is one number, so that
    /// what is found from here on tells of all colours, those too that this path's start does not reflect.
    pub(super) fn arrive(&mut self, end: Joint, radiance: Rgb, throughput: Rgb) -> Rgb {
        (self.ends, self.end, self.near) = (true, end, radiance);
        Rgb::splat(throughput.max_element())
    }

    /// What the path found with that is `radiance`: what it keeps to itself.
    pub(super) fn close(&mut self, radiance: Rgb) -> Rgb {
        self.light = radiance / self.weight.max_element();
        if self.light.is_finite() {
            self.ends = self.light != Rgb::ZERO;
            return self.near;
        }
        // The sample is thrown away, and no other with it.
        self.ends = false;
        self.near + radiance
    }
}

/// Density with which a direction drawn at `start` comes to `end`, by area and times pi, as if nothing were in between.
#[inline(always)]
pub(super) fn density(start: &Joint, end: &Joint) -> f32 {
    let d = end.p - start.p;
    let r2 = d.length_squared();
    let (from, to) = (start.n.dot(d), -end.n.dot(d));
    select((from > 0.0) & (to > 0.0), from * to / (r2 * r2), 0.0)
}

/// Sum of the densities with which an end would have been found, and whether it can be told who would have: not by rounding,
/// too near to a start or at too flat an angle.
#[inline(always)]
pub(super) fn total(seen: &[f32; MEMBERS], finder: usize) -> (f32, bool) {
    let mut total = 0.0;
    for density in seen {
        total += density;
    }
    (total, (seen[finder % MEMBERS] > 0.0) & total.is_finite())
}

/// The rest of one member's path, and what its ways share.
#[derive(Debug)]
pub(super) struct Shares {
    /// Where its numbers come from after its start.
    pub rest: Stream,
    pub of_ways: Vec<Share>,
}

/// How far a path is that may share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sharing {
    /// Not at all, or not yet.
    No,
    /// On its way from its start.
    Started,
    /// Beyond its end.
    Ended,
}

/// Room for paths that share, kept from group to group.
#[derive(Debug, Default)]
pub struct Together {
    shares: Vec<Shares>,
    traced: Vec<Traced>,
}

impl Together {
    /// What came of member `i`.
    #[must_use]
    pub fn traced(&self, i: usize) -> Traced {
        self.traced[i]
    }
}

/// Stream of the group's first member, `first`, that the rest of all its members' paths come from.
pub(super) fn common(sampler: &Sampler, [x, y, sample]: [u32; 3]) -> Stream {
    const APART: u32 = 0x7368_6172;
    sampler.stream(x, y, sample).split(APART)
}

impl Integrator<'_> {
    /// Whether paths share.
    #[must_use]
    pub fn shares(&self) -> bool {
        self.reuse
    }

    /// The samples `members`, each (column, row, sample), of at most [`MEMBERS`] pixels, whose paths share, one after the other;
    /// [`Together::traced`] tells them. The path of member `probe.0` is told to `probe.1`.
    pub fn together(
        &self,
        room: &mut Together,
        sampler: &Sampler,
        members: &[[u32; 3]],
        mut probe: Option<(usize, &mut dyn Probe)>,
        counters: &mut Counters,
    ) {
        let ways = self.splits as usize;
        let Together { shares, traced } = room;
        traced.clear();
        let Some(&first) = members.first() else { return };
        let common = common(sampler, first);
        for (i, &[x, y, sample]) in members.iter().enumerate() {
            let rest = common.fork(i as u32, MEMBERS as u32);
            if shares.len() == i {
                shares.push(Shares { rest, of_ways: Vec::new() });
            }
            shares[i].rest = rest;
            shares[i].of_ways.clear();
            shares[i].of_ways.resize(ways, Share::NOTHING);
            let told = match &mut probe {
                Some((whom, probe)) if *whom == i => Some(&mut **probe as &mut dyn Probe),
                _ => None,
            };
            let mut seen = First { hit: None, probe: told };
            let stream = sampler.stream(x, y, sample);
            let sample = self.path(x, y, &stream, counters, Some(&mut seen), Some(&mut shares[i]));
            traced.push(Traced { sample, first: seen.hit });
        }
        for way in 0..ways {
            self.join_all(&shares[..members.len()], way, traced, counters);
        }
    }

    /// Join the paths of all members, way `way` of each.
    fn join_all(&self, shares: &[Shares], way: usize, traced: &mut [Traced], counters: &mut Counters) {
        // Added up as many at once do it.
        let mut sums = [[Rgb::ZERO; MEMBERS]; AT_ONCE];
        let ends = (0..shares.len()).filter(|&i| shares[i].of_ways[way].ends);
        let mut some = false;
        for (round, finder) in ends.enumerate() {
            some = true;
            let Share { end, light, .. } = &shares[finder].of_ways[way];
            let mut seen = [0.0; MEMBERS];
            for (i, of_ways) in shares.iter().map(|shares| &shares.of_ways[way]).enumerate() {
                if !of_ways.starts {
                    continue;
                }
                let start = &of_ways.start;
                let density = density(start, end);
                let open = i == finder
                    || density > 0.0 && {
                        let ray = spawn_to(start.p, start.p_error, start.ng, end.p, end.p_error, end.ng);
                        !self.scene.occluded(&ray, counters)
                    };
                if open {
                    seen[i] = density;
                }
            }
            let (total, told) = total(&seen, finder);
            let sums = &mut sums[round % AT_ONCE];
            for (i, shares) in shares.iter().enumerate() {
                let part = if told { seen[i] / total } else { f32::from(u8::from(i == finder)) };
                sums[i] += shares.of_ways[way].weight * (*light * part);
            }
        }
        if some {
            for (i, traced) in traced.iter_mut().enumerate() {
                let sum = sums.iter().fold(Rgb::ZERO, |sum, sums| sum + sums[i]);
                traced.sample.radiance += sum / self.splits as f32;
            }
        }
    }

    /// Where a path can be joined at this vertex, and what is reflected there; `None` where it cannot.
    pub(super) fn joint(&self, shading: &Shading) -> Option<(Joint, Rgb)> {
        let reflectance = shading.bsdf.reflects_diffusely(shading.wo)?;
        let point = &shading.point;
        let plain = shading.frame.n == point.ng && shading.reference.n != Vec3::ZERO;
        plain.then_some((
            Joint { p: point.p, p_error: point.p_error, ng: point.ng, n: shading.reference.n },
            reflectance,
        ))
    }

    /// Begin to share the path of `walk`, if that can be done here.
    pub(super) fn start(&self, walk: &mut Walk, shading: &Shading, share: &mut Share) -> bool {
        if walk.depth != 0 {
            return false;
        }
        let Some((start, reflectance)) = self.joint(shading) else { return false };
        let weight = walk.throughput * reflectance;
        if weight == Rgb::ZERO {
            return false;
        }
        *share = Share::of(start, weight, [0; 2]);
        walk.sharing = Sharing::Started;
        true
    }
}

/// Notes the first hit, and passes everything on.
struct First<'a> {
    hit: Option<FirstHit>,
    probe: Option<&'a mut dyn Probe>,
}

impl Probe for First<'_> {
    fn vertex(&mut self, vertex: &Vertex) {
        let Vertex { albedo, ns, camera_depth, .. } = *vertex;
        self.hit.get_or_insert(FirstHit { albedo, ns, camera_depth });
        if let Some(probe) = &mut self.probe {
            probe.vertex(vertex);
        }
    }

    fn way(&mut self, radiance: Rgb) {
        if let Some(probe) = &mut self.probe {
            probe.way(radiance);
        }
    }

    fn end(&mut self, end: super::End, radiance: Rgb) {
        if let Some(probe) = &mut self.probe {
            probe.end(end, radiance);
        }
    }
}
