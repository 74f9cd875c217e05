//! Where things stand on a chart, in pixels of the 800 x 500 picture: the plot area, the legend, the
//! notes. Knows nothing of drawing, except how wide a word is.

use crate::axis::Ruler;
use crate::{Axis, Chart, Guide, HEIGHT, Point, Scale, Style, WIDTH};

/// Size of the title's letters, pixels.
pub(crate) const TITLE: f64 = 18.0;
/// Size of all other letters, pixels.
pub(crate) const TEXT: f64 = 14.5;
/// Width of the sample of line or bar before a legend's words.
pub(crate) const SWATCH: f64 = 30.0;

const MARGIN: f64 = 12.0;
const LEGEND_ROW: f64 = 20.0;
const NOTE_ROW: f64 = 18.0;

/// A rectangle, y downwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rect {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

/// One line of the legend.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entry {
    pub area: Rect,
    pub what: What,
    pub text: String,
}

/// What an entry of the legend stands for: an index into the chart's series or guides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum What {
    Series(usize),
    Guide(usize),
}

/// A settled chart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    pub plot: Rect,
    pub x: Ruler,
    pub y: Ruler,
    pub legend: Vec<Entry>,
    /// Lines of text, each with the height of its middle.
    pub notes: Vec<(f64, String)>,
}

/// Settles a chart; `width(text, size)` is the width of a word in pixels.
pub(crate) fn layout(chart: &Chart, width: &dyn Fn(&str, f64) -> f64) -> Layout {
    let (x, y) = rulers(chart);
    let full = f64::from(WIDTH) - 2.0 * MARGIN;

    let notes: Vec<String> = chart.notes.iter().cloned().chain(remarks(chart, &x, &y)).collect();
    let notes: Vec<String> = notes.iter().flat_map(|note| wrap(note, full, &|text| width(text, TEXT))).collect();
    let notes_top = f64::from(HEIGHT) - 6.0 - NOTE_ROW * notes.len() as f64;

    let named = chart.series.iter().enumerate().map(|(i, s)| (What::Series(i), &s.name));
    let guides = chart.guides.iter().enumerate().map(|(i, g)| (What::Guide(i), guide_label(g)));
    let (mut rows, mut left) = (0.0, MARGIN);
    let mut legend = Vec::new();
    for (what, text) in named.chain(guides).filter(|(_, text)| !text.is_empty()) {
        let wide = SWATCH + 6.0 + width(text, TEXT);
        if legend.is_empty() || left + wide > full + MARGIN {
            (rows, left) = (rows + 1.0, MARGIN);
        }
        let top = (rows - 1.0) * LEGEND_ROW;
        let area = Rect { left, top, right: left + wide, bottom: top + LEGEND_ROW };
        legend.push(Entry { area, what, text: text.clone() });
        left += wide + 22.0;
    }
    let legend_top = notes_top - 2.0 - LEGEND_ROW * rows;
    for entry in &mut legend {
        entry.area.top += legend_top;
        entry.area.bottom += legend_top;
    }

    let widest = y.major.iter().map(|tick| width(&tick.label, TEXT)).fold(0.0, f64::max);
    let plot = Rect {
        left: MARGIN + TEXT + 8.0 + widest + 8.0,
        top: MARGIN + TITLE + 12.0,
        right: f64::from(WIDTH) - MARGIN - 12.0,
        // Tick labels, then the axis' own label.
        bottom: legend_top - 6.0 - 2.0 * (TEXT + 6.0),
    };
    let notes = (0..).map(|i| notes_top + NOTE_ROW * (f64::from(i) + 0.5)).zip(notes).collect();
    Layout { plot, x, y, legend, notes }
}

impl Layout {
    /// Place of a point on the picture, clamped to the plot area's upper and lower edge, and whether it
    /// was; `None` where it has no horizontal place or is not a number.
    pub fn place(&self, point: &Point) -> Option<(f64, f64, bool)> {
        let x = self.x.place(point.x).filter(|x| (-1e-9..=1.0 + 1e-9).contains(x))?;
        if point.y.is_nan() {
            return None;
        }
        let y = self.y.place(point.y).unwrap_or(f64::NEG_INFINITY);
        let clamped = y.clamp(0.0, 1.0);
        Some((self.across(x), self.up(clamped), (y - clamped).abs() > 1e-9 || y.is_infinite()))
    }

    /// Height of a value, clamped to the plot area.
    pub fn height(&self, y: f64) -> f64 {
        self.up(self.y.place(y).unwrap_or(0.0).clamp(0.0, 1.0))
    }

    /// Picture coordinate of a horizontal place from 0 to 1.
    pub fn across(&self, x: f64) -> f64 {
        self.plot.left + x * (self.plot.right - self.plot.left)
    }

    /// Picture coordinate of a vertical place from 0 to 1.
    pub fn up(&self, y: f64) -> f64 {
        self.plot.bottom - y * (self.plot.bottom - self.plot.top)
    }
}

/// An axis' own words.
pub(crate) fn words(axis: &Axis) -> String {
    if axis.unit.is_empty() { axis.label.clone() } else { format!("{} ({})", axis.label, axis.unit) }
}

fn guide_label(guide: &Guide) -> &String {
    match guide {
        Guide::Level { label, .. } | Guide::At { label, .. } | Guide::Slope { label, .. } => label,
    }
}

fn rulers(chart: &Chart) -> (Ruler, Ruler) {
    let points = || chart.series.iter().flat_map(|s| s.points.iter().map(move |p| (s.style, p)));
    let bars = chart.series.iter().any(|s| s.style == Style::Bars);
    let xs = points().map(|(_, p)| p.x);
    let ys = points().flat_map(|(style, p)| {
        let (low, high) = p.range.unwrap_or((p.y, p.y));
        let foot = if style == Style::Bars { 0.0 } else { p.y };
        [if style == Style::Band { low } else { p.y }, low, high, foot]
    });
    let levels = chart.guides.iter().filter_map(|g| if let Guide::Level { y, .. } = g { Some(*y) } else { None });
    let labels = |scale: &Scale| if *scale == Scale::Log { 10.0 } else { 6.0 };
    let (x_labels, y_labels) = (labels(&chart.x.scale), labels(&chart.y.scale));
    let x = Ruler::new(&chart.x.scale, chart.x.range, xs, x_labels);
    let mut y = Ruler::new(&chart.y.scale, chart.y.range, ys.chain(levels), y_labels);
    let at_zero = points().any(|(style, p)| style != Style::Band && p.y == 0.0);
    if y.log && at_zero && !bars && chart.y.range.is_none() {
        // Room between the smallest value and those drawn on the edge.
        let low = y.low * (y.low / y.high).powf(0.05);
        y = Ruler::new(&Scale::Log, Some((low, y.high)), std::iter::empty(), y_labels);
    }
    if bars && chart.y.range.is_none() {
        // A bar stands on its foot, and its value is written above it.
        y = match chart.y.scale {
            Scale::Log => Ruler::new(&Scale::Log, Some((y.low / 2.0, y.high * 2.0)), std::iter::empty(), y_labels),
            _ => Ruler::new(
                &Scale::Linear,
                Some((y.low.min(0.0).max(y.low * 1e9), y.high * 1.06)),
                std::iter::empty(),
                6.0,
            ),
        };
        if chart.y.scale != Scale::Log && chart.series.iter().flat_map(|s| &s.points).all(|p| p.y >= 0.0) {
            y.low = 0.0;
        }
    }
    (x, y)
}

/// What the axes could not show, in words.
fn remarks(chart: &Chart, x: &Ruler, y: &Ruler) -> Vec<String> {
    let mut out = Vec::new();
    let mut tell = |what: &str, test: &dyn Fn(&Point) -> bool| {
        let of: Vec<&str> = chart
            .series
            .iter()
            .filter(|s| !matches!(s.style, Style::Band | Style::Bars) && s.points.iter().any(test))
            .map(|s| s.name.as_str())
            .collect();
        if !of.is_empty() {
            out.push(format!("{what}: {}.", of.join(", ")));
        }
    };
    let slack = |r: &Ruler| 1e-9 * (r.high - r.low).abs();
    if y.log {
        tell("Exactly 0, drawn on the lower edge", &|p| p.y == 0.0);
        tell("Below 0, drawn on the lower edge", &|p| p.y < 0.0);
    }
    tell("Below the axis, drawn on the lower edge", &|p| p.y < y.low - slack(y) && !(y.log && p.y <= 0.0));
    tell("Infinite, drawn on the upper edge", &|p| p.y == f64::INFINITY);
    tell("Beyond the axis, drawn on the upper edge", &|p| p.y > y.high + slack(y) && p.y.is_finite());
    tell("Not a number, left out", &|p| p.y.is_nan());
    if x.log {
        tell("Left out, since a log axis has no place for 0", &|p| p.x <= 0.0);
    }
    out
}

/// Breaks a text into lines no wider than `full`.
fn wrap(text: &str, full: f64, width: &dyn Fn(&str) -> f64) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let last = lines.len() - 1;
        let longer = if lines[last].is_empty() { word.to_string() } else { format!("{} {word}", lines[last]) };
        if lines[last].is_empty() || width(&longer) <= full {
            lines[last] = longer;
        } else {
            lines.push(word.to_string());
        }
    }
    lines
}
