//! Pixels whose paths share what they find ([`crate::integrator::MEMBERS`] at a time) lie within a square region of the
//! picture. Which ones do is told by their place and by the number of the batch: other tiles, units or workers make no
//! other groups. A unit renders the regions that it has a pixel of, and keeps its own.

use super::{Pixel, UnitRender, WORKSPACE, Workspace, pixel};
use crate::{
    geometry::Counters,
    integrator::{Integrator, MEMBERS, REQUESTS, Traced},
    math::Rgb,
    sampler::Sampler,
};

/// Side of a region.
pub(crate) const SIDE: u32 = 16;
/// Side of a group.
const GROUP: u32 = 4;
const _: () = assert!((GROUP * GROUP) as usize == MEMBERS);
const PIXELS: usize = (SIDE * SIDE) as usize;

/// The groups of a region in one batch: blocks of pixels, shifted from batch to batch with those that go out at one side
/// coming in at the other, so that no block stands out in the sum.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// Columns and rows, group by group.
    pixels: [[u32; 2]; PIXELS],
    /// How many there are, up to each group's last.
    ends: [u32; PIXELS / MEMBERS],
    groups: usize,
}

impl Layout {
    /// That of the region with this corner, for the batch of sample `sample`.
    fn new(sampler: &Sampler, resolution: [u32; 2], [left, top]: [u32; 2], sample: u32) -> Self {
        const APART: u32 = 0x6772_6F75;
        let first = sample - sample % sampler.batch();
        let (bits, _) = sampler.stream(left, top, first).split(APART ^ first).parts();
        let (dx, dy) = ((bits >> 32) as u32 % GROUP, (bits >> 48) as u32 % GROUP);
        let mut layout = Self { pixels: [[0; 2]; PIXELS], ends: [0; PIXELS / MEMBERS], groups: 0 };
        let mut n = 0;
        for block in 0..PIXELS as u32 / (GROUP * GROUP) {
            let begin = n;
            let (bx, by) = (block % (SIDE / GROUP) * GROUP + dx, block / (SIDE / GROUP) * GROUP + dy);
            for i in 0..GROUP * GROUP {
                let (x, y) = (left + (bx + i % GROUP) % SIDE, top + (by + i / GROUP) % SIDE);
                if x < resolution[0] && y < resolution[1] {
                    layout.pixels[n] = [x, y];
                    n += 1;
                }
            }
            if n > begin {
                layout.ends[layout.groups] = n as u32;
                layout.groups += 1;
            }
        }
        layout
    }

    /// The layout that a pixel is in at sample `sample`.
    pub fn of(sampler: &Sampler, resolution: [u32; 2], [x, y]: [u32; 2], sample: u32) -> Self {
        Self::new(sampler, resolution, [x / SIDE * SIDE, y / SIDE * SIDE], sample)
    }

    /// Pixels of each group.
    pub fn groups(&self) -> impl Iterator<Item = &[[u32; 2]]> + Clone {
        (0..self.groups).map(|group| {
            let begin = if group == 0 { 0 } else { self.ends[group - 1] };
            &self.pixels[begin as usize..self.ends[group] as usize]
        })
    }
}

/// The pixels that share paths with `pixel` in the first batch.
pub(crate) fn group_of(sampler: &Sampler, resolution: [u32; 2], pixel: [u32; 2]) -> Option<Vec<[u32; 2]>> {
    let layout = Layout::of(sampler, resolution, pixel, 0);
    layout.groups().find(|group| group.contains(&pixel)).map(<[_]>::to_vec)
}

impl Workspace {
    /// Render samples `first` to `first + count`, all of one batch, of each group, and give `visit` every sample, a pixel's in
    /// order.
    pub(super) fn share<'a>(
        &mut self,
        (integrator, sampler): (&Integrator, &Sampler),
        groups: impl Iterator<Item = &'a [[u32; 2]]> + Clone,
        (first, count): (u32, u32),
        features: bool,
        counters: &mut Counters,
        mut visit: impl FnMut([u32; 3], Traced),
    ) {
        let waves = integrator.has_wave();
        let most = if waves { REQUESTS - MEMBERS } else { 0 };
        let mut flush = |work: &mut Self| {
            let Self { wave, together, requests, ends, .. } = work;
            if waves {
                integrator.wave(wave, sampler, requests, ends, features, counters);
            } else {
                integrator.together(together, sampler, requests, None, counters);
            }
            for (i, request) in requests.iter().enumerate() {
                visit(*request, if waves { wave.traced(i) } else { together.traced(i) });
            }
            requests.clear();
            ends.clear();
        };
        for sample in first..first + count {
            for group in groups.clone() {
                self.requests.extend(group.iter().map(|[x, y]| [*x, *y, sample]));
                self.ends.push(self.requests.len() as u32);
                if self.requests.len() > most {
                    flush(self);
                }
            }
        }
        if !self.requests.is_empty() {
            flush(self);
        }
    }
}

impl UnitRender<'_> {
    /// Rows of regions that the unit has pixels of.
    pub(super) fn strips(&self) -> u32 {
        let rect = self.unit.id.rect;
        (rect.y + rect.h).div_ceil(SIDE) - rect.y / SIDE
    }

    /// Rows of the picture, from and to, that a row of regions and the unit have in common.
    pub(super) fn strip(&self, strip: u32) -> (u32, u32) {
        let rect = self.unit.id.rect;
        let top = (rect.y / SIDE + strip) * SIDE;
        (top.max(rect.y), (top + SIDE).min(rect.y + rect.h))
    }

    /// The pixels of a strip, row by row.
    pub(super) fn in_regions(&self, strip: u32, counters: &mut Counters) -> Vec<Pixel> {
        let rect = self.unit.id.rect;
        let (top, bottom) = self.strip(strip);
        let count = (rect.w * (bottom - top)) as usize;
        let mut pixels: Vec<Pixel> = (0..count).map(|_| Pixel::new(self.unit.features)).collect();
        let mut work = WORKSPACE.take().unwrap_or_default();
        for left in (rect.x / SIDE * SIDE..rect.x + rect.w).step_by(SIDE as usize) {
            self.region(&mut work, left, (top, bottom), &mut pixels, counters);
        }
        WORKSPACE.set(Some(work));
        pixels
    }

    /// The pixels of one region.
    fn region(
        &self,
        work: &mut Workspace,
        left: u32,
        (top, bottom): (u32, u32),
        pixels: &mut [Pixel],
        counters: &mut Counters,
    ) {
        let rect = self.unit.id.rect;
        // Number of a pixel of the unit, and its samples.
        let own = |[x, y]: [u32; 2]| {
            let inside = (rect.x..rect.x + rect.w).contains(&x) && (top..bottom).contains(&y);
            inside.then(|| {
                let (first, samples) = self.range(y - rect.y, x - rect.x);
                (((y - top) * rect.w + x - rect.x) as usize, first, first.saturating_add(samples))
            })
        };
        let all = (top..bottom).flat_map(|y| (left..left + SIDE).map(move |x| [x, y])).filter_map(own);
        let begin = all.clone().map(|(_, first, _)| first).min().unwrap_or(0);
        let end = all.clone().map(|(.., end)| end).max().unwrap_or(0);
        for (first, size) in pixel::batches(&self.sampler, begin, end - begin) {
            // Pixels that are to have this batch have all of it.
            let wanted =
                |pixel: [u32; 2]| own(pixel).filter(|(_, begin, end)| (begin..end).contains(&&first)).map(|own| own.0);
            for (index, ..) in all.clone().filter(|(_, begin, end)| (begin..end).contains(&&first)) {
                pixels[index].begin(size);
            }
            let layout = Layout::new(&self.sampler, self.resolution, [left, top / SIDE * SIDE], first);
            let groups = layout.groups().filter(|group| group.iter().any(|pixel| wanted(*pixel).is_some()));
            let by = (&self.integrator, &self.sampler);
            work.share(by, groups, (first, size), self.unit.features, counters, |[x, y, sample], traced| {
                if let Some(index) = wanted([x, y]) {
                    pixels[index].take_traced(sample, &traced);
                }
            });
        }
    }
}

/// Samples of the pixels of a row, and of no others.
pub(super) fn samples(
    by: (&Integrator, &Sampler),
    resolution: [u32; 2],
    row: u32,
    samples: std::ops::Range<u32>,
    counters: &mut Counters,
    mut visit: impl FnMut(u32, u32, Rgb),
) {
    let mut work = Workspace::default();
    for left in (0..resolution[0]).step_by(SIDE as usize) {
        for (first, size) in pixel::batches(by.1, samples.start, samples.len() as u32) {
            let layout = Layout::of(by.1, resolution, [left, row], first);
            let groups = layout.groups().filter(|group| group.iter().any(|[_, y]| *y == row));
            work.share(by, groups, (first, size), false, counters, |[x, y, sample], traced| {
                if y == row {
                    visit(x, sample, traced.sample.radiance);
                }
            });
        }
    }
}
