//! Charts in one house style, as SVG and as PNG, and tables as CSV.
//!
//! A [`Chart`] says what is to be seen; [`svg`] and [`png()`] draw the same picture of it, 800 x 500
//! pixels, with the same bits every time. Series are told apart by colour (the palette of Okabe and
//! Ito, safe for colour-blind readers), by dash and by marker, so a chart reads in grey too. The
//! legend and the notes stand below the plot area, never in it. This crate knows nothing of files,
//! nor of what is drawn. Letters are those of DejaVu Sans (LICENSE-DEJAVU).

mod axis;
mod csv;
mod draw;
mod layout;
mod marks;
mod theme;

pub use csv::{Cell, Table};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use plotters::prelude::{BitMapBackend, IntoDrawingArea, SVGBackend};

/// Width of every chart, pixels.
pub const WIDTH: u32 = 800;
/// Height of every chart, pixels.
pub const HEIGHT: u32 = 500;

/// Both backends place things on whole pixels. The picture is drawn this many times larger, then shown
/// smaller (SVG) or averaged down (PNG), so lines and letters sit on thirds of a pixel.
const OVERSAMPLE: u32 = 3;

/// One chart: what is on its axes, and what is drawn between them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// Says what is to be seen, one line.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Drawn in order; the order also gives each its colour, dash and marker.
    pub series: Vec<Series>,
    /// Lines that are not data.
    pub guides: Vec<Guide>,
    /// Remarks below the chart. What a log axis cannot show is added to them.
    pub notes: Vec<String>,
}

/// An axis: what it measures, in which unit, and how it is scaled.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Axis {
    /// The quantity.
    pub label: String,
    /// Its unit, without brackets; empty for none.
    pub unit: String,
    /// How values map to pixels.
    pub scale: Scale,
    /// The range shown; `None`: what the data need.
    pub range: Option<(f64, f64)>,
}

impl Axis {
    /// A linear axis.
    #[must_use]
    pub fn linear(label: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { label: label.into(), unit: unit.into(), scale: Scale::Linear, range: None }
    }

    /// A logarithmic axis.
    #[must_use]
    pub fn log(label: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::linear(label, unit) }
    }

    /// A horizontal axis of named places, at x = 0, 1, 2, ...
    #[must_use]
    pub fn names<S: Into<String>>(label: impl Into<String>, names: impl IntoIterator<Item = S>) -> Self {
        Self { scale: Scale::Names(names.into_iter().map(Into::into).collect()), ..Self::linear(label, "") }
    }

    /// The same axis with a fixed range.
    #[must_use]
    pub fn between(mut self, low: f64, high: f64) -> Self {
        self.range = Some((low, high));
        self
    }
}

/// How an axis is scaled.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Scale {
    /// Equal steps.
    #[default]
    Linear,
    /// Equal ratios. A value at or below 0 on the vertical axis is drawn on the lower edge and told in
    /// a note; on the horizontal axis it is left out and told in a note.
    Log,
    /// Named places at 0, 1, 2, ... (horizontal axis only).
    Names(Vec<String>),
}

/// One set of points and how they are drawn.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// How it is drawn.
    pub style: Style,
    /// Its points, in the order in which a line joins them.
    pub points: Vec<Point>,
}

impl Series {
    /// A series of (x, y).
    pub fn new(name: impl Into<String>, style: Style, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let points = points.into_iter().map(|(x, y)| Point { x, y, range: None }).collect();
        Self { name: name.into(), style, points }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Style {
    /// A line with markers.
    #[default]
    Line,
    /// A line alone: for curves of many points.
    Curve,
    /// Markers alone.
    Points,
    /// Bars standing on 0 (or on the lower edge of a log axis), with their values written above.
    Bars,
    /// The area between each point's `range`.
    Band,
}

/// A point of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Horizontal value.
    pub x: f64,
    /// Vertical value.
    pub y: f64,
    /// Low and high end of its interval: an error bar, or the edges of a band.
    pub range: Option<(f64, f64)>,
}

/// A line that is not data.
#[derive(Debug, Clone, PartialEq)]
pub enum Guide {
    /// A bound: a horizontal line at `y`.
    Level {
        /// Its height.
        y: f64,
        /// Its name in the legend.
        label: String,
    },
    /// A vertical line at `x`.
    At {
        /// Its place.
        x: f64,
        /// Its name in the legend.
        label: String,
    },
    /// A straight line of the drawn plane through (`x`, `y`): on two log axes y ~ x^slope.
    Slope {
        /// A point on it.
        x: f64,
        /// The same point's height.
        y: f64,
        /// Its slope, in decades a decade on log axes.
        slope: f64,
        /// Its name in the legend.
        label: String,
    },
}

/// The chart as an SVG document. Letters use the reader's sans-serif font.
#[must_use]
pub fn svg(chart: &Chart) -> String {
    let (wide, high) = (WIDTH * OVERSAMPLE, HEIGHT * OVERSAMPLE);
    let mut drawn = String::new();
    draw::chart(&SVGBackend::with_string(&mut drawn, (wide, high)).into_drawing_area(), chart, OVERSAMPLE, 0.0);
    let title = chart.title.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
    drawn.replacen(
        &format!("width=\"{wide}\" height=\"{high}\""),
        &format!("width=\"{WIDTH}\" height=\"{HEIGHT}\" role=\"img\" aria-label=\"{title}\""),
        1,
    )
}

/// The chart as an SVG document for a page that is light or dark as the reader prefers.
#[must_use]
pub fn svg_by_theme(chart: &Chart) -> String {
    svg(chart).replacen("svg\">", &format!("svg\">{}", theme::sheet()), 1)
}

/// The chart as a PNG file, 800 x 500 pixels, 8-bit RGB.
#[must_use]
pub fn png(chart: &Chart) -> Vec<u8> {
    let (wide, high) = (WIDTH * OVERSAMPLE, HEIGHT * OVERSAMPLE);
    let mut large = vec![0; (wide * high * 3) as usize];
    draw::chart(&BitMapBackend::with_buffer(&mut large, (wide, high)).into_drawing_area(), chart, OVERSAMPLE, 0.11);
    let small = shrink(&large, wide as usize, OVERSAMPLE as usize);
    let mut file = Vec::new();
    PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive)
        .write_image(&small, WIDTH, HEIGHT, ExtendedColorType::Rgb8)
        .expect("a buffer of WIDTH x HEIGHT x 3 bytes encodes into memory");
    file
}

/// Averages squares of `by` x `by` pixels of an RGB image `wide` pixels wide.
fn shrink(large: &[u8], wide: usize, by: usize) -> Vec<u8> {
    let (columns, rows) = (wide / by, large.len() / 3 / wide / by);
    let mut small = Vec::with_capacity(columns * rows * 3);
    for y in 0..rows {
        for x in 0..columns {
            for channel in 0..3 {
                let at = |i: usize| ((y * by + i / by) * wide + x * by + i % by) * 3 + channel;
                let sum: usize = (0..by * by).map(|i| usize::from(large[at(i)])).sum();
                // A mean of bytes is a byte.
                small.push(((sum + by * by / 2) / (by * by)) as u8);
            }
        }
    }
    small
}

#[cfg(test)]
mod tests;
