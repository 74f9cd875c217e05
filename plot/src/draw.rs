//! A settled chart, put on a plotters backend.

use crate::axis::number;
use crate::layout::{self, Layout, Rect, SWATCH, TEXT, TITLE, What};
use crate::marks::{self, FAINT, FRAME, GRID, INK};
use crate::{Chart, Guide, Point, Series, Style};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::sync::OnceLock;

/// Draws `chart` on `area`, which is `scale` times the size of the picture.
///
/// `sink` lowers text by this share of its size: plotters' bitmap text stands higher than its SVG text.
pub(crate) fn chart<DB: DrawingBackend>(area: &DrawingArea<DB, Shift>, chart: &Chart, scale: u32, sink: f64) {
    register();
    let layout = layout::layout(chart, &width);
    Canvas { area, scale: f64::from(scale), sink }
        .chart(chart, &layout)
        .expect("drawing into memory fails only for want of a font, and the font is in the binary");
}

/// Width of a text, pixels, letters `size` pixels high.
pub(crate) fn width(text: &str, size: f64) -> f64 {
    register();
    // Measured large, since plotters rounds to whole pixels.
    FontDesc::new(FontFamily::SansSerif, size * 16.0, FontStyle::Normal)
        .layout_box(text)
        .map_or(0.0, |((left, _), (right, _))| f64::from(right - left) / 16.0)
}

fn register() {
    static DONE: OnceLock<()> = OnceLock::new();
    DONE.get_or_init(|| {
        let read = plotters::style::register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular()).is_ok();
        assert!(read, "the font in the binary is a font");
    });
}

/// The drawing area, spoken to in pixels of the picture.
struct Canvas<'a, DB: DrawingBackend> {
    area: &'a DrawingArea<DB, Shift>,
    scale: f64,
    sink: f64,
}

type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

impl<DB: DrawingBackend> Canvas<'_, DB> {
    fn chart(&self, chart: &Chart, layout: &Layout) -> Drawn<DB> {
        self.area.fill(&WHITE)?;
        self.frame(chart, layout)?;
        let order = |series: &Series| match series.style {
            Style::Band => 0,
            Style::Bars => 1,
            Style::Line | Style::Curve => 2,
            Style::Points => 3,
        };
        for layer in 0..4 {
            if layer == 2 {
                for guide in &chart.guides {
                    self.guide(guide, layout)?;
                }
            }
            for (index, series) in chart.series.iter().enumerate().filter(|(_, s)| order(s) == layer) {
                match series.style {
                    Style::Band => self.band(series, index, layout)?,
                    Style::Bars => self.bars(chart, series, index, layout)?,
                    Style::Line | Style::Curve | Style::Points => self.points(series, index, layout)?,
                }
            }
        }
        for (index, series) in chart.series.iter().enumerate().filter(|(_, s)| s.style == Style::Bars) {
            self.values(chart, series, index, layout)?;
        }
        self.legend(chart, layout)
    }

    /// Grid, ticks, labels, title and notes.
    fn frame(&self, chart: &Chart, layout: &Layout) -> Drawn<DB> {
        let Rect { left, top, right, bottom } = layout.plot;
        let names = matches!(chart.x.scale, crate::Scale::Names(_));
        let xs = |v: f64| layout.x.place(v).map(|u| layout.across(u));
        let ys = |v: f64| layout.y.place(v).map(|u| layout.up(u));
        if !names {
            for x in layout.x.minor.iter().filter_map(|v| xs(*v)) {
                self.path(&[(x, top), (x, bottom)], FAINT, 1.0)?;
            }
        }
        for y in layout.y.minor.iter().filter_map(|v| ys(*v)) {
            self.path(&[(left, y), (right, y)], FAINT, 1.0)?;
        }
        for (x, tick) in layout.x.major.iter().filter_map(|t| xs(t.value).map(|x| (x, t))) {
            if !names {
                self.path(&[(x, top), (x, bottom)], GRID, 1.0)?;
            }
            self.path(&[(x, bottom), (x, bottom + 4.0)], FRAME, 1.0)?;
            self.text(&tick.label, (x, bottom + 8.0), TEXT, HPos::Center, VPos::Top)?;
        }
        for (y, tick) in layout.y.major.iter().filter_map(|t| ys(t.value).map(|y| (y, t))) {
            self.path(&[(left, y), (right, y)], GRID, 1.0)?;
            self.path(&[(left - 4.0, y), (left, y)], FRAME, 1.0)?;
            self.text(&tick.label, (left - 7.0, y), TEXT, HPos::Right, VPos::Center)?;
        }
        self.path(&[(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], FRAME, 1.0)?;
        let middle = 0.5 * (left + right);
        let axis = bottom + TEXT + 11.0;
        self.text(&chart.title, (12.0, 12.0), TITLE, HPos::Left, VPos::Top)?;
        self.text(&layout::words(&chart.x), (middle, axis), TEXT, HPos::Center, VPos::Top)?;
        let style = self.letters(TEXT, HPos::Center, VPos::Center).transform(FontTransform::Rotate270);
        self.area.draw(&Text::new(
            layout::words(&chart.y),
            self.at((13.0 + self.sink * TEXT, 0.5 * (top + bottom))),
            style,
        ))?;
        for (y, note) in &layout.notes {
            self.text(note, (12.0, *y), TEXT, HPos::Left, VPos::Center)?;
        }
        Ok(())
    }

    fn guide(&self, guide: &Guide, layout: &Layout) -> Drawn<DB> {
        let Rect { left, top, right, bottom } = layout.plot;
        let ends = match guide {
            Guide::Level { y, .. } => layout.y.place(*y).map(|u| [(left, layout.up(u)), (right, layout.up(u))]),
            Guide::At { x, .. } => layout.x.place(*x).map(|u| [(layout.across(u), bottom), (layout.across(u), top)]),
            Guide::Slope { x, y, slope, .. } => layout.x.place(*x).zip(layout.y.place(*y)).map(|(u, v)| {
                let span = |r: &crate::axis::Ruler| {
                    if r.log { r.high.log10() - r.low.log10() } else { r.high - r.low }
                };
                let rise = slope * span(&layout.x) / span(&layout.y);
                [0.0, 1.0].map(|end| (layout.across(end), layout.up(v + (end - u) * rise)))
            }),
        };
        let Some([a, b]) = ends.and_then(|[a, b]| marks::clipped(a, b, &layout.plot)) else { return Ok(()) };
        self.dashes(&[a, b], INK, 1.4, guide_dash(guide))
    }

    fn band(&self, series: &Series, index: usize, layout: &Layout) -> Drawn<DB> {
        let edges: Vec<(f64, f64, f64)> = series
            .points
            .iter()
            .filter_map(|p| {
                let (low, high) = p.range?;
                let x = layout.x.place(p.x).filter(|u| (0.0..=1.0).contains(u))?;
                Some((layout.across(x), layout.height(low), layout.height(high)))
            })
            .collect();
        let outline = edges.iter().map(|e| (e.0, e.2)).chain(edges.iter().rev().map(|e| (e.0, e.1)));
        let outline: Vec<(i32, i32)> = outline.map(|p| self.at(p)).collect();
        self.area.draw(&Polygon::new(outline, marks::colour(index).mix(0.22).filled()))
    }

    fn bars(&self, chart: &Chart, series: &Series, index: usize, layout: &Layout) -> Drawn<DB> {
        for point in &series.points {
            let Some(area) = bar_area(chart, point, index, layout) else { continue };
            self.bar(&area, index)?;
            if let Some((low, high)) = point.range {
                let middle = 0.5 * (area.left + area.right);
                self.path(&[(middle, layout.height(low)), (middle, layout.height(high))], INK, 1.5)?;
            }
        }
        Ok(())
    }

    /// The bars' values, above all lines, on a ground that keeps them readable.
    fn values(&self, chart: &Chart, series: &Series, index: usize, layout: &Layout) -> Drawn<DB> {
        for point in &series.points {
            let Some(area) = bar_area(chart, point, index, layout) else { continue };
            let (middle, size, text) = (0.5 * (area.left + area.right), TEXT - 1.5, short(point.y));
            let half = 0.5 * width(&text, size) + 1.0;
            let ground = [self.at((middle - half, area.top - size - 1.0)), self.at((middle + half, area.top - 2.0))];
            self.area.draw(&Rectangle::new(ground, WHITE.mix(0.85).filled()))?;
            self.text(&text, (middle, area.top - 3.0), size, HPos::Center, VPos::Bottom)?;
        }
        Ok(())
    }

    /// A bar: solid for even places in the chart, hatched for odd ones.
    fn bar(&self, area: &Rect, index: usize) -> Drawn<DB> {
        let colour = marks::colour(index);
        let corners = [self.at((area.left, area.top)), self.at((area.right, area.bottom))];
        if index.is_multiple_of(2) {
            return self.area.draw(&Rectangle::new(corners, colour.filled()));
        }
        self.area.draw(&Rectangle::new(corners, colour.mix(0.15).filled()))?;
        let high = area.bottom - area.top;
        let mut x = area.left - high;
        while x < area.right {
            if let Some(stroke) = marks::clipped((x, area.bottom), (x + high, area.top), area) {
                self.path(&stroke, colour, 1.6)?;
            }
            x += 7.0;
        }
        let Rect { left, top, right, bottom } = *area;
        self.path(&[(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], colour, 1.6)
    }

    /// A line, its markers, or both.
    fn points(&self, series: &Series, index: usize, layout: &Layout) -> Drawn<DB> {
        let colour = marks::colour(index);
        let placed: Vec<_> = series.points.iter().map(|p| (p, layout.place(p))).collect();
        if series.style != Style::Points {
            // A point without a place breaks the line: what lies there is not known.
            for run in placed.split(|(_, place)| place.is_none()) {
                let path: Vec<(f64, f64)> = run.iter().filter_map(|(_, place)| place.map(|(x, y, _)| (x, y))).collect();
                self.dashes(&path, colour, 2.2, marks::dash(index))?;
            }
        }
        if series.style == Style::Curve {
            return Ok(());
        }
        for (point, place) in placed {
            let Some((x, y, clamped)) = place else { continue };
            if let Some((low, high)) = point.range {
                self.path(&[(x, layout.height(low)), (x, layout.height(high))], colour, 1.5)?;
            }
            self.marker(index, (x, y), clamped)?;
        }
        Ok(())
    }

    /// A marker; hollow where it stands on an edge in place of a value beyond it.
    fn marker(&self, index: usize, (x, y): (f64, f64), hollow: bool) -> Drawn<DB> {
        let mut outline: Vec<(f64, f64)> =
            marks::marker(index).iter().map(|(u, v)| (x + 4.2 * u, y + 4.2 * v)).collect();
        let fill = if hollow { WHITE } else { marks::colour(index) };
        let corners: Vec<(i32, i32)> = outline.iter().map(|p| self.at(*p)).collect();
        self.area.draw(&Polygon::new(corners, fill.filled()))?;
        outline.push(outline[0]);
        self.path(&outline, marks::colour(index), 1.4)
    }

    fn legend(&self, chart: &Chart, layout: &Layout) -> Drawn<DB> {
        for entry in &layout.legend {
            let middle = 0.5 * (entry.area.top + entry.area.bottom);
            let (left, right) = (entry.area.left, entry.area.left + SWATCH);
            let block = Rect { left: left + 6.0, right: right - 6.0, top: middle - 6.0, bottom: middle + 6.0 };
            let line = [(left, middle), (right, middle)];
            match entry.what {
                What::Guide(i) => self.dashes(&line, INK, 1.4, guide_dash(&chart.guides[i]))?,
                What::Series(i) => match chart.series[i].style {
                    Style::Band => {
                        let corners = [self.at((block.left, block.top)), self.at((block.right, block.bottom))];
                        self.area.draw(&Rectangle::new(corners, marks::colour(i).mix(0.22).filled()))?;
                    }
                    Style::Bars => self.bar(&block, i)?,
                    Style::Curve => self.dashes(&line, marks::colour(i), 2.2, marks::dash(i))?,
                    Style::Points => self.marker(i, (0.5 * (left + right), middle), false)?,
                    Style::Line => {
                        self.dashes(&line, marks::colour(i), 2.2, marks::dash(i))?;
                        self.marker(i, (0.5 * (left + right), middle), false)?;
                    }
                },
            }
            self.text(&entry.text, (right + 6.0, middle), TEXT, HPos::Left, VPos::Center)?;
        }
        Ok(())
    }

    fn dashes(&self, path: &[(f64, f64)], colour: RGBColor, thick: f64, pattern: &[f64]) -> Drawn<DB> {
        for stroke in marks::dashed(path, pattern) {
            self.path(&stroke, colour, thick)?;
        }
        Ok(())
    }

    fn path(&self, path: &[(f64, f64)], colour: RGBColor, thick: f64) -> Drawn<DB> {
        if path.len() < 2 {
            return Ok(());
        }
        let points: Vec<(i32, i32)> = path.iter().map(|p| self.at(*p)).collect();
        self.area.draw(&PathElement::new(points, colour.stroke_width((thick * self.scale).round() as u32)))
    }

    fn text(&self, text: &str, at: (f64, f64), size: f64, h: HPos, v: VPos) -> Drawn<DB> {
        let at = self.at((at.0, at.1 + self.sink * size));
        self.area.draw(&Text::new(text.to_string(), at, self.letters(size, h, v)))
    }

    fn letters(&self, size: f64, h: HPos, v: VPos) -> TextStyle<'static> {
        TextStyle::from(FontDesc::new(FontFamily::SansSerif, size * self.scale, FontStyle::Normal))
            .color(&INK)
            .pos(Pos::new(h, v))
    }

    fn at(&self, (x, y): (f64, f64)) -> (i32, i32) {
        ((x * self.scale).round() as i32, (y * self.scale).round() as i32)
    }
}

/// Where the bar of a point stands: the bars of one place stand beside each other.
fn bar_area(chart: &Chart, point: &Point, index: usize, layout: &Layout) -> Option<Rect> {
    let bars = |end: usize| chart.series[..end].iter().filter(|s| s.style == Style::Bars).count() as f64;
    let wide = 0.78 / bars(chart.series.len());
    let left = point.x - 0.39 + bars(index) * wide;
    let (from, to) = layout.x.place(left + 0.06 * wide).zip(layout.x.place(left + 0.94 * wide))?;
    if point.y.is_nan() {
        return None;
    }
    let foot = if layout.y.log { layout.plot.bottom } else { layout.height(0.0) };
    let head = layout.height(point.y);
    Some(Rect { left: layout.across(from), right: layout.across(to), top: head.min(foot), bottom: head.max(foot) })
}

fn guide_dash(guide: &Guide) -> &'static [f64] {
    match guide {
        Guide::Level { .. } => &[6.0, 4.0],
        Guide::At { .. } => &[2.0, 3.0],
        Guide::Slope { .. } => &[1.5, 4.0],
    }
}

/// A bar's value, in few letters.
fn short(v: f64) -> String {
    if v.abs() >= 100.0 && v.abs() < 1e7 {
        return format!("{v:.0}");
    }
    if (0.01..100.0).contains(&v.abs()) {
        let text = format!("{v:.*}", if v.abs() < 1.0 { 3 } else { 2 });
        return text.trim_end_matches('0').trim_end_matches('.').into();
    }
    if v == 0.0 || !v.is_finite() { number(v) } else { format!("{v:.1e}") }
}
