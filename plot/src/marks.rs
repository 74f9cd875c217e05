//! What tells series apart: colour, dash and marker; and the geometry of dashes and clipping.

use crate::layout::Rect;
use plotters::style::RGBColor;

/// Letters.
pub(crate) const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
/// Frame of the plot area and ticks.
pub(crate) const FRAME: RGBColor = RGBColor(0x77, 0x77, 0x77);
/// Grid at labelled ticks.
pub(crate) const GRID: RGBColor = RGBColor(0xDD, 0xDD, 0xDD);
/// Grid at other ticks.
pub(crate) const FAINT: RGBColor = RGBColor(0xF1, 0xF1, 0xF1);

/// Okabe and Ito's palette, the most distinct first (yellow left out: too faint on white).
pub(crate) const PALETTE: [RGBColor; 7] = [
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0xD5, 0x5E, 0x00),
    RGBColor(0x00, 0x9E, 0x73),
    RGBColor(0xCC, 0x79, 0xA7),
    RGBColor(0xE6, 0x9F, 0x00),
    RGBColor(0x56, 0xB4, 0xE9),
    RGBColor(0x00, 0x00, 0x00),
];

/// Lengths of stroke and gap in turn; empty is a solid line.
const DASHES: [&[f64]; 5] = [&[], &[9.0, 5.0], &[2.5, 4.0], &[14.0, 4.0, 3.0, 4.0], &[18.0, 6.0]];

/// Colour of the series at this place in the chart.
pub(crate) fn colour(index: usize) -> RGBColor {
    PALETTE[index % PALETTE.len()]
}

/// Dash of the series at this place in the chart.
pub(crate) fn dash(index: usize) -> &'static [f64] {
    DASHES[index % DASHES.len()]
}

/// Outline of the marker of the series at this place in the chart, about the origin, at radius 1.
pub(crate) fn marker(index: usize) -> Vec<(f64, f64)> {
    match index % 5 {
        0 => (0..16).map(|i| f64::from(i) * std::f64::consts::TAU / 16.0).map(|a| (a.cos(), a.sin())).collect(),
        1 => vec![(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
        2 => vec![(0.0, -1.2), (1.15, 0.9), (-1.15, 0.9)],
        3 => vec![(0.0, -1.35), (1.35, 0.0), (0.0, 1.35), (-1.35, 0.0)],
        _ => vec![(0.0, 1.2), (1.15, -0.9), (-1.15, -0.9)],
    }
}

/// Cuts a path into dashes.
pub(crate) fn dashed(path: &[(f64, f64)], pattern: &[f64]) -> Vec<Vec<(f64, f64)>> {
    if pattern.is_empty() {
        return vec![path.to_vec()];
    }
    let mut out: Vec<Vec<(f64, f64)>> = Vec::new();
    let (mut part, mut left) = (0usize, pattern[0]);
    let mut stroke: Vec<(f64, f64)> = path.first().copied().into_iter().collect();
    for ends in path.windows(2) {
        let ((x0, y0), (x1, y1)) = (ends[0], ends[1]);
        let length = (x1 - x0).hypot(y1 - y0);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let at = (x0 + (x1 - x0) * done / length, y0 + (y1 - y0) * done / length);
            stroke.push(at);
            if part.is_multiple_of(2) {
                out.push(std::mem::take(&mut stroke));
            }
            stroke = vec![at];
            part = (part + 1) % pattern.len();
            left = pattern[part];
        }
        left -= length - done;
        stroke.push((x1, y1));
    }
    if part.is_multiple_of(2) && stroke.len() > 1 {
        out.push(stroke);
    }
    out
}

/// The part of a segment inside a rectangle (Liang and Barsky 1984).
pub(crate) fn clipped(a: (f64, f64), b: (f64, f64), area: &Rect) -> Option<[(f64, f64); 2]> {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for (step, room) in [(-dx, a.0 - area.left), (dx, area.right - a.0), (-dy, a.1 - area.top), (dy, area.bottom - a.1)]
    {
        if step == 0.0 && room < 0.0 {
            return None;
        } else if step < 0.0 {
            from = from.max(room / step);
        } else if step > 0.0 {
            to = to.min(room / step);
        }
    }
    (from < to).then_some([(a.0 + from * dx, a.1 + from * dy), (a.0 + to * dx, a.1 + to * dy)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_keep_their_share_of_the_path() {
        let path = [(0.0, 0.0), (30.0, 0.0), (30.0, 30.0)];
        let strokes = dashed(&path, &[4.0, 2.0]);
        let length: f64 =
            strokes.iter().flat_map(|s| s.windows(2)).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).sum();
        assert_eq!(strokes.len(), 10);
        assert!((length - 40.0).abs() < 1e-9);
    }

    #[test]
    fn segments_are_cut_at_the_area() {
        let area = Rect { left: 0.0, top: 0.0, right: 10.0, bottom: 10.0 };
        assert_eq!(clipped((-10.0, 5.0), (20.0, 5.0), &area), Some([(0.0, 5.0), (10.0, 5.0)]));
        assert_eq!(clipped((-10.0, 15.0), (20.0, 15.0), &area), None);
        assert_eq!(clipped((2.0, 2.0), (3.0, 3.0), &area), Some([(2.0, 2.0), (3.0, 3.0)]));
    }
}
