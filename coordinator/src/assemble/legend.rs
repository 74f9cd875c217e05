//! Maps in colours, with a legend below: a bar, its unit, and values at both ends and in between.

use image::ExtendedColorType;

use super::{
    BadPicture, Raster,
    colour::{balance, viridis},
    font, png, standard_errors, verdicts,
};

const PAPER: [u8; 3] = [24, 24, 27];
const INK: [u8; 3] = [235, 235, 235];
/// What nothing is known of.
const UNKNOWN: [u8; 3] = [110, 110, 110];
/// Width of the narrowest picture: the legend must fit.
const NARROWEST: u32 = 220;

/// A logarithmic scale from `low` to `high`, both above 0.
#[derive(Debug, Clone, Copy)]
struct Scale {
    low: f64,
    high: f64,
}

impl Scale {
    fn at(&self, value: f64) -> f64 {
        if self.high <= self.low {
            return 0.5;
        }
        (libm::log(value.max(self.low) / self.low) / libm::log(self.high / self.low)).clamp(0.0, 1.0)
    }

    fn value(&self, t: f64) -> f64 {
        self.low * libm::exp(t * libm::log(self.high / self.low))
    }

    fn legend(self, unit: &'static str, label: fn(f64) -> String) -> Legend<'static> {
        let marks = match (self.low.is_finite() && self.low > 0.0, self.high <= self.low) {
            (false, _) => Vec::new(),
            (true, true) => vec![(0.5, label(self.low))],
            (true, false) => [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(|t| (t, label(self.value(t)))).into(),
        };
        Legend { unit, place: Box::new(move |value| self.at(value)), colour: viridis, marks }
    }
}

/// What is written below a map.
struct Legend<'a> {
    /// What is shown.
    unit: &'a str,
    /// Place of a value on the bar, 0 to 1.
    place: Box<dyn Fn(f64) -> f64>,
    /// Colour of a place.
    colour: fn(f64) -> [u8; 3],
    /// Values to be written, each with its place.
    marks: Vec<(f64, String)>,
}

/// Samples of each pixel; grey where there are none yet.
pub(super) fn samples(raster: &Raster) -> Result<Vec<u8>, BadPicture> {
    let values = super::samples(raster);
    let taken = || values.iter().copied().filter(|&n| n > 0.0);
    let scale =
        Scale { low: f64::from(taken().fold(f32::INFINITY, f32::min)), high: f64::from(taken().fold(0.0, f32::max)) };
    let known = |value: f32| value > 0.0;
    map(size(raster), &values, known, &scale.legend("samples per pixel", whole))
}

/// Standard error of each pixel's luminance; grey where it is not known. Three decades below the error that
/// all but one pixel in a thousand keep to.
pub(super) fn errors(raster: &Raster) -> Result<Vec<u8>, BadPicture> {
    let values = standard_errors(&verdicts(raster));
    let mut sorted: Vec<f32> = values.iter().copied().filter(|e| e.is_finite()).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let high = sorted.get(sorted.len().saturating_sub(1 + sorted.len() / 1000)).copied().unwrap_or(1.0);
    let high = if high > 0.0 { f64::from(high) } else { 1.0 };
    let scale = Scale { low: high * 1e-3, high };
    map(size(raster), &values, f32::is_finite, &scale.legend("standard error of luminance", short))
}

/// Signed differences, row by row; grey where there is none to be told. Black is 0; the ends of the scale are the
/// difference that all but one pixel in a thousand keep to.
pub(super) fn differences(size: [u32; 2], values: &[f32], of: &str) -> Result<Vec<u8>, BadPicture> {
    let mut sorted: Vec<f32> = values.iter().filter(|d| d.is_finite()).map(|d| d.abs()).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let end = sorted.get(sorted.len().saturating_sub(1 + sorted.len() / 1000)).copied().unwrap_or(0.0);
    let end = f64::from(end);
    // Where all is alike there is no end to be told, and any will do.
    let marks = if end > 0.0 {
        vec![(0.0, format!("-{}", short(end))), (0.5, "0".into()), (1.0, format!("+{}", short(end)))]
    } else {
        vec![(0.5, "0".into())]
    };
    let end = if end > 0.0 { end } else { 1.0 };
    let place = Box::new(move |value| 0.5 + 0.5 * value / end);
    map(size, values, f32::is_finite, &Legend { unit: of, place, colour: balance, marks })
}

fn size(raster: &Raster) -> [u32; 2] {
    [raster.region.w, raster.region.h]
}

fn map([w, h]: [u32; 2], values: &[f32], known: impl Fn(f32) -> bool, legend: &Legend) -> Result<Vec<u8>, BadPicture> {
    let zoom = if w >= 480 { 2 } else { 1 };
    let margin = 6 * zoom;
    let (bar, line) = (10 * zoom, font::HEIGHT * zoom);
    let (width, height) = (w.max(NARROWEST), h + 3 * margin + 2 * line + bar);
    let mut canvas = Canvas { width, pixels: vec![PAPER; width as usize * height as usize] };
    for (i, &value) in values.iter().enumerate() {
        let colour = if known(value) { (legend.colour)((legend.place)(f64::from(value))) } else { UNKNOWN };
        canvas.set(i as u32 % w, i as u32 / w, colour);
    }
    let top = h + margin;
    canvas.text(legend.unit, margin, top, zoom);
    let length = width - 2 * margin;
    let bar_top = top + line + margin / 2;
    for x in 0..length {
        let colour = (legend.colour)(f64::from(x) / f64::from(length - 1));
        (0..bar).for_each(|y| canvas.set(margin + x, bar_top + y, colour));
    }
    for (t, text) in &legend.marks {
        let half = font::width(text) * zoom / 2;
        let middle = margin + (t * f64::from(length - 1)) as u32;
        let x = middle.saturating_sub(half).clamp(margin, width - margin - 2 * half);
        (0..margin / 2).for_each(|y| canvas.set(middle, bar_top + bar + y, INK));
        canvas.text(text, x, bar_top + bar + margin / 2 + zoom, zoom);
    }
    let bytes: Vec<u8> = canvas.pixels.into_iter().flatten().collect();
    png::encode(&bytes, width, height, ExtendedColorType::Rgb8)
}

fn whole(value: f64) -> String {
    format!("{value:.0}")
}

/// Two digits that count.
fn short(value: f64) -> String {
    match value {
        v if v >= 10.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.1}"),
        v if v >= 0.1 => format!("{v:.2}"),
        v if v >= 0.01 => format!("{v:.3}"),
        v => format!("{v:.1e}"),
    }
}

struct Canvas {
    width: u32,
    pixels: Vec<[u8; 3]>,
}

impl Canvas {
    fn set(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        if x < self.width
            && let Some(pixel) = self.pixels.get_mut(y as usize * self.width as usize + x as usize)
        {
            *pixel = colour;
        }
    }

    fn text(&mut self, text: &str, x: u32, y: u32, zoom: u32) {
        font::draw(text, |dx, dy| {
            for (sx, sy) in (0..zoom * zoom).map(|i| (i % zoom, i / zoom)) {
                self.set(x + dx * zoom + sx, y + dy * zoom + sy, INK);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_logarithmic_and_takes_an_even_map() {
        let scale = Scale { low: 1.0, high: 100.0 };
        assert!((scale.at(10.0) - 0.5).abs() < 1e-12 && (scale.value(0.5) - 10.0).abs() < 1e-9);
        assert_eq!((scale.at(0.0), scale.at(1e9)), (0.0, 1.0));
        assert_eq!(Scale { low: 64.0, high: 64.0 }.at(64.0), 0.5);
    }

    #[test]
    fn labels_are_short() {
        for (value, text) in [(64.0, "64"), (1.25, "1.2"), (0.034, "0.034"), (0.0012, "1.2e-3"), (0.5, "0.50")] {
            assert_eq!(short(value), text);
        }
    }
}
