//! Rectangles of a frame, and the grid that cuts a frame into tiles.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A rectangle of pixels: `x`, `y` of its top-left corner, rows counted from the top of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rect {
    /// Left edge, pixels.
    pub x: u32,
    /// Top edge, pixels.
    pub y: u32,
    /// Width, pixels.
    pub w: u32,
    /// Height, pixels.
    pub h: u32,
}

impl Rect {
    /// The whole of a frame of `w` x `h` pixels.
    #[must_use]
    pub fn frame(w: u32, h: u32) -> Self {
        Self { x: 0, y: 0, w, h }
    }

    /// Number of pixels.
    #[must_use]
    pub fn area(&self) -> usize {
        self.w as usize * self.h as usize
    }

    /// Whether `other` lies wholly inside.
    #[must_use]
    pub fn contains(&self, other: &Rect) -> bool {
        let end = |start: u32, length: u32| u64::from(start) + u64::from(length);
        other.x >= self.x
            && other.y >= self.y
            && end(other.x, other.w) <= end(self.x, self.w)
            && end(other.y, other.h) <= end(self.y, self.h)
    }

    /// Pixel coordinates in row order.
    pub fn pixels(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let Rect { x, y, w, h } = *self;
        (y..y + h).flat_map(move |py| (x..x + w).map(move |px| (px, py)))
    }

    /// Cut into pieces of at most `max_pixels`, whole rows first, in row order.
    ///
    /// Splitting a unit means sub-rectangles, never ranges of a pixel's samples: the order in which a
    /// pixel's samples are merged is part of the image's bits.
    #[must_use]
    pub fn split(&self, max_pixels: usize) -> Vec<Rect> {
        let max = max_pixels.max(1);
        if self.area() <= max {
            return vec![*self];
        }
        let width = (max as u64).min(u64::from(self.w)) as u32;
        let height = ((max / width as usize) as u64).clamp(1, u64::from(self.h)) as u32;
        let mut pieces = Vec::new();
        for y in (self.y..self.y + self.h).step_by(height as usize) {
            for x in (self.x..self.x + self.w).step_by(width as usize) {
                let (w, h) = (width.min(self.x + self.w - x), height.min(self.y + self.h - y));
                pieces.push(Rect { x, y, w, h });
            }
        }
        pieces
    }
}

impl fmt::Display for Rect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{} at {},{}", self.w, self.h, self.x, self.y)
    }
}

/// The tiles of a frame: squares of `tile` pixels in row order, smaller at the right and bottom edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileGrid {
    region: Rect,
    tile: u32,
}

impl TileGrid {
    /// Tiles of `tile` x `tile` pixels over `region` (the frame, or its crop).
    #[must_use]
    pub fn new(region: Rect, tile: u32) -> Self {
        Self { region, tile: tile.max(1) }
    }

    /// The region that is cut, in frame coordinates.
    #[must_use]
    pub fn region(&self) -> Rect {
        self.region
    }

    /// Tiles in a row.
    #[must_use]
    pub fn columns(&self) -> u32 {
        self.region.w.div_ceil(self.tile)
    }

    /// Rows of tiles.
    #[must_use]
    pub fn rows(&self) -> u32 {
        self.region.h.div_ceil(self.tile)
    }

    /// Number of tiles.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.columns() * self.rows()
    }

    /// The rectangle of tile `index`, in frame coordinates; `None` past the end.
    #[must_use]
    pub fn rect(&self, index: u32) -> Option<Rect> {
        if index >= self.count() {
            return None;
        }
        let (column, row) = (index % self.columns(), index / self.columns());
        let (x, y) = (column * self.tile, row * self.tile);
        Some(Rect {
            x: self.region.x + x,
            y: self.region.y + y,
            w: self.tile.min(self.region.w - x),
            h: self.tile.min(self.region.h - y),
        })
    }

    /// The up to eight tiles that touch tile `index`, in index order.
    #[must_use]
    pub fn neighbours(&self, index: u32) -> Vec<u32> {
        let (columns, rows) = (self.columns(), self.rows());
        let (column, row) = (index % columns, index / columns);
        let mut found = Vec::with_capacity(8);
        for r in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
            for c in column.saturating_sub(1)..=(column + 1).min(columns - 1) {
                if (c, r) != (column, row) {
                    found.push(r * columns + c);
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn paint(counts: &mut [u32], region: Rect, rect: Rect) {
        for (x, y) in rect.pixels() {
            counts[((y - region.y) * region.w + (x - region.x)) as usize] += 1;
        }
    }

    proptest! {
        #[test]
        fn tiles_cover_every_pixel_once(x in 0u32..9, y in 0u32..9, w in 1u32..70, h in 1u32..70, tile in 1u32..40) {
            let region = Rect { x, y, w, h };
            let grid = TileGrid::new(region, tile);
            let mut counts = vec![0; region.area()];
            for index in 0..grid.count() {
                let rect = grid.rect(index).unwrap();
                prop_assert!(region.contains(&rect));
                paint(&mut counts, region, rect);
            }
            prop_assert!(counts.iter().all(|&n| n == 1));
            prop_assert_eq!(grid.rect(grid.count()), None);
        }

        #[test]
        fn pieces_cover_every_pixel_once_and_keep_the_limit(w in 1u32..70, h in 1u32..70, max in 1usize..5000) {
            let region = Rect { x: 3, y: 5, w, h };
            let mut counts = vec![0; region.area()];
            for piece in region.split(max) {
                prop_assert!(piece.area() <= max);
                paint(&mut counts, region, piece);
            }
            prop_assert!(counts.iter().all(|&n| n == 1));
        }

        #[test]
        fn neighbourhood_is_symmetric_and_touches(w in 1u32..70, h in 1u32..70, tile in 1u32..40) {
            let grid = TileGrid::new(Rect::frame(w, h), tile);
            for a in 0..grid.count() {
                for b in grid.neighbours(a) {
                    prop_assert!(grid.neighbours(b).contains(&a));
                    prop_assert!(a != b);
                }
            }
        }
    }

    #[test]
    fn an_inner_tile_has_eight_neighbours() {
        let grid = TileGrid::new(Rect::frame(30, 30), 10);
        assert_eq!(grid.neighbours(4), [0, 1, 2, 3, 5, 6, 7, 8]);
        assert_eq!(grid.neighbours(0), [1, 3, 4]);
    }

    #[test]
    fn rectangles_near_the_largest_number_do_not_wrap() {
        let huge = Rect { x: u32::MAX, y: 0, w: 2, h: 1 };
        assert!(!Rect::frame(10, 10).contains(&huge));
    }
}
