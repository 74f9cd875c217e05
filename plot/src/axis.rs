//! From a value to its place along an axis, and which values get a tick.

use crate::Scale;

/// A tick with a label, and its place on the axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    pub value: f64,
    pub label: String,
}

/// An axis whose range and ticks are settled.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ruler {
    pub low: f64,
    pub high: f64,
    pub log: bool,
    /// Labelled ticks.
    pub major: Vec<Tick>,
    /// Ticks without a label.
    pub minor: Vec<f64>,
}

impl Ruler {
    /// A ruler over `values` (those that are not finite, or not positive on a log axis, are passed over)
    /// or over `range`, with a label about every `1 / labels` of its length.
    pub fn new(scale: &Scale, range: Option<(f64, f64)>, values: impl Iterator<Item = f64>, labels: f64) -> Self {
        match scale {
            Scale::Names(names) => Self {
                low: -0.5,
                high: names.len() as f64 - 0.5,
                log: false,
                major: (0..).map(f64::from).zip(names).map(|(v, n)| Tick { value: v, label: n.clone() }).collect(),
                minor: Vec::new(),
            },
            Scale::Linear => {
                let (low, high) = range.unwrap_or_else(|| padded(extent(values.filter(|v| v.is_finite()), 0.0, 1.0)));
                linear(low, high, labels)
            }
            Scale::Log => {
                let positive = values.filter(|v| v.is_finite() && *v > 0.0).map(f64::log10);
                let (low, high) = range
                    .map_or_else(|| padded(extent(positive, -1.0, 0.0)), |(low, high)| (low.log10(), high.log10()));
                logarithmic(low, high, labels)
            }
        }
    }

    /// Place of `v`: 0 at the low end, 1 at the high end, beyond for values outside; `None` where the
    /// axis has no place for it (NaN, or 0 and below on a log axis).
    pub fn place(&self, v: f64) -> Option<f64> {
        let along = |v: f64, low: f64, high: f64| (v - low) / (high - low);
        if v.is_nan() || (self.log && v <= 0.0) {
            None
        } else if self.log {
            Some(along(v.log10(), self.low.log10(), self.high.log10()))
        } else {
            Some(along(v, self.low, self.high))
        }
    }
}

/// Smallest and largest of `values`, or the range given where there are none.
fn extent(values: impl Iterator<Item = f64>, low: f64, high: f64) -> (f64, f64) {
    let (a, b) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if a <= b { (a, b) } else { (low, high) }
}

/// Some air around the data; a lone value gets half a unit on both sides.
fn padded((low, high): (f64, f64)) -> (f64, f64) {
    let pad = if high > low { 0.04 * (high - low) } else { 0.5 * low.abs().max(1.0) };
    (low - pad, high + pad)
}

fn linear(low: f64, high: f64, labels: f64) -> Ruler {
    let raw = (high - low) / labels;
    let magnitude = 10f64.powf(raw.log10().floor());
    let step = magnitude * [1.0, 2.0, 5.0, 10.0].into_iter().find(|m| m * magnitude >= raw * 0.999).unwrap_or(10.0);
    let major = (ceil(low / step)..=floor(high / step))
        .map(|i| Tick { value: i as f64 * step, label: number(i as f64 * step) })
        .collect();
    Ruler { low, high, log: false, major, minor: Vec::new() }
}

/// `low` and `high` are decimal exponents.
fn logarithmic(low: f64, high: f64, labels: f64) -> Ruler {
    let decades = high - low;
    let least = decades / labels;
    let every = [1, 2, 3, 5, 10, 20, 50].into_iter().find(|e| f64::from(*e) >= least).map_or(100, i64::from);
    let (first, last) = (ceil(low), floor(high));
    let inside = |v: f64| (low..=high).contains(&v.log10());
    let mut major: Vec<f64> = (first..=last).filter(|e| e % every == 0).map(power).collect();
    let mut minor: Vec<f64> = (first..=last).filter(|e| e % every != 0).map(power).collect();
    let between = |steps: &[f64]| -> Vec<f64> {
        (first - 1..=last).flat_map(|e| steps.iter().map(move |s| s * power(e))).filter(|v| inside(*v)).collect()
    };
    if every == 1 && decades <= 0.8 {
        // Less than a decade: labels as on a linear axis say more than powers of ten would.
        let linear = linear(10f64.powf(low), 10f64.powf(high), labels * 0.8);
        return Ruler { log: true, ..linear };
    } else if every == 1 && decades < 2.6 {
        major.extend(between(&[2.0, 5.0]));
        major.sort_by(f64::total_cmp);
        minor = between(&[3.0, 4.0, 6.0, 7.0, 8.0, 9.0]);
    } else if decades < 6.0 {
        minor = between(&[2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    }
    let major = major.into_iter().map(|value| Tick { value, label: number(value) }).collect();
    Ruler { low: 10f64.powf(low), high: 10f64.powf(high), log: true, major, minor }
}

/// 10^e, to the last bit what `1e<e>` reads as, so that labels come out round.
fn power(e: i64) -> f64 {
    format!("1e{e}").parse().unwrap_or(f64::NAN)
}

fn ceil(v: f64) -> i64 {
    (v - 1e-9).ceil() as i64
}

fn floor(v: f64) -> i64 {
    (v + 1e-9).floor() as i64
}

/// A number as a reader expects it on an axis: `0.25`, `40`, `1e-3`, `2.5e6`.
pub(crate) fn number(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    if !v.is_finite() {
        return format!("{v}");
    }
    if (0.01..10_000.0).contains(&v.abs()) {
        let text = format!("{v:.4}");
        return text.trim_end_matches('0').trim_end_matches('.').into();
    }
    let text = format!("{v:.2e}");
    match text.split_once('e') {
        Some((mantissa, exponent)) => {
            format!("{}e{exponent}", mantissa.trim_end_matches('0').trim_end_matches('.'))
        }
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ruler: &Ruler) -> Vec<&str> {
        ruler.major.iter().map(|tick| tick.label.as_str()).collect()
    }

    #[test]
    fn numbers_read_well() {
        for (v, text) in [
            (0.0, "0"),
            (0.25, "0.25"),
            (40.0, "40"),
            (1e-3, "1e-3"),
            (2.5e6, "2.5e6"),
            (0.1, "0.1"),
            (1000.0, "1000"),
            (-3e-5, "-3e-5"),
        ] {
            assert_eq!(number(v), text);
        }
    }

    #[test]
    fn a_log_axis_has_a_tick_at_every_decade() {
        let ruler = Ruler::new(&Scale::Log, Some((1e-5, 1.0)), std::iter::empty(), 6.0);
        assert_eq!(labels(&ruler), ["1e-5", "1e-4", "1e-3", "0.01", "0.1", "1"]);
        assert_eq!(ruler.minor.len(), 5 * 8);
        assert!((ruler.place(1e-4).unwrap() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_long_log_axis_labels_some_decades_and_marks_all() {
        let ruler = Ruler::new(&Scale::Log, Some((1e-30, 1e30)), std::iter::empty(), 6.0);
        assert_eq!(labels(&ruler), ["1e-30", "1e-20", "1e-10", "1", "1e10", "1e20", "1e30"]);
        assert_eq!(ruler.major.len() + ruler.minor.len(), 61);
    }

    #[test]
    fn a_linear_axis_has_round_steps() {
        let ruler = Ruler::new(&Scale::Linear, Some((0.0, 90.0)), std::iter::empty(), 6.0);
        assert_eq!(labels(&ruler), ["0", "20", "40", "60", "80"]);
        assert_eq!(ruler.place(45.0), Some(0.5));
    }

    #[test]
    fn a_log_axis_has_no_place_for_zero() {
        let ruler = Ruler::new(&Scale::Log, None, [0.0, -1.0, 1e-3, 1.0, f64::NAN].into_iter(), 6.0);
        assert!(ruler.low > 1e-4 && ruler.low < 1e-3);
        assert_eq!(ruler.place(0.0), None);
        assert_eq!(ruler.place(f64::NAN), None);
    }

    #[test]
    fn no_data_still_gives_an_axis() {
        for scale in [Scale::Linear, Scale::Log, Scale::Names(vec!["one".into()])] {
            let ruler = Ruler::new(&scale, None, std::iter::empty(), 6.0);
            assert!(ruler.high > ruler.low && !ruler.major.is_empty(), "{scale:?}");
        }
    }
}
