//! Measured pixels of a frame, and the rule's verdict on each by itself and the pixels that touch it.

use common::{
    adaptive::{Rule, Verdict},
    film::Moments,
    tile::Rect,
};

/// A tile and the ring of pixels around it, all exactly as of the end of one pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// The pixels covered: the tile grown by [`super::RING`] pixels and cut at the region's edge.
    pub rect: Rect,
    /// Their moments, in row order.
    pub moments: Vec<Moments>,
}

impl Surroundings {
    /// What is known of them.
    #[must_use]
    pub fn field(&self) -> Field<'_> {
        Field { rect: self.rect, moments: &self.moments }
    }
}

/// Let pixels be judged anew, under a finer target or with what their neighbours learnt since: none of them has
/// stopped, and every sample stays.
pub fn judge_anew(moments: &mut [Moments]) {
    moments.iter_mut().for_each(|pixel| pixel.stopped = false);
}

/// Moments of a rectangle's pixels. Nothing is known of what lies outside: a pixel at its edge has fewer
/// neighbours.
#[derive(Debug, Clone, Copy)]
pub struct Field<'a> {
    rect: Rect,
    moments: &'a [Moments],
}

impl<'a> Field<'a> {
    /// These moments, in row order, of the pixels of `rect`.
    #[must_use]
    pub fn new(rect: Rect, moments: &'a [Moments]) -> Self {
        Field { rect, moments }
    }

    /// The pixel at these coordinates of the frame.
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> Option<&'a Moments> {
        let (column, row) = (x.checked_sub(self.rect.x)?, y.checked_sub(self.rect.y)?);
        if column >= self.rect.w || row >= self.rect.h {
            return None;
        }
        self.moments.get(row as usize * self.rect.w as usize + column as usize)
    }

    /// The pixels of `part` that are here, in row order, each with what `rule` says of it.
    pub fn judge(self, rule: &Rule, part: Rect) -> impl Iterator<Item = (&'a Moments, Verdict)> {
        part.pixels().filter_map(move |(x, y)| {
            let own = self.at(x, y)?;
            Some((own, rule.judge(own, self.touching(x, y))))
        })
    }

    /// The pixel and those that touch it, fewer at the edges; in row order.
    fn touching(self, x: u32, y: u32) -> impl Iterator<Item = &'a Moments> {
        let (left, top) = (x.saturating_sub(1), y.saturating_sub(1));
        (top..=y + 1).flat_map(move |py| (left..=x + 1).filter_map(move |px| self.at(px, py)))
    }
}
