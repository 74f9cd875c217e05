//! The same chart on dark paper: which colour stands for which.

use plotters::style::{RGBColor, WHITE};

use crate::marks::{FAINT, FRAME, GRID, INK, PALETTE};

/// The colours of a chart by day and by night. Those of series keep their hue, and become lighter until they have at
/// least 4.5 : 1 of contrast with the dark paper.
pub(crate) const NIGHT: [(RGBColor, RGBColor); 12] = [
    (WHITE, RGBColor(0x1F, 0x22, 0x27)),
    (INK, RGBColor(0xE8, 0xE6, 0xE1)),
    (FRAME, RGBColor(0x9A, 0xA0, 0xA8)),
    (GRID, RGBColor(0x3D, 0x43, 0x4C)),
    (FAINT, RGBColor(0x2A, 0x2E, 0x35)),
    (PALETTE[0], RGBColor(0x4A, 0xA3, 0xDF)),
    (PALETTE[1], RGBColor(0xF0, 0x80, 0x3C)),
    (PALETTE[2], RGBColor(0x2F, 0xC7, 0x9A)),
    (PALETTE[3], RGBColor(0xE3, 0x9C, 0xC4)),
    (PALETTE[4], RGBColor(0xF2, 0xB1, 0x34)),
    (PALETTE[5], RGBColor(0x9F, 0xD8, 0xF8)),
    (PALETTE[6], RGBColor(0xE8, 0xE6, 0xE1)),
];

/// A style sheet for an SVG of a chart: the colours of the night for a reader who prefers them.
pub(crate) fn sheet() -> String {
    let name = |RGBColor(r, g, b): RGBColor| format!("#{r:02X}{g:02X}{b:02X}");
    let rule = |(day, night): &(RGBColor, RGBColor)| {
        let (day, night) = (name(*day), name(*night));
        format!("[fill=\"{day}\"]{{fill:{night}}}[stroke=\"{day}\"]{{stroke:{night}}}")
    };
    let rules: String = NIGHT.iter().map(rule).collect();
    format!("<style>@media (prefers-color-scheme:dark){{{rules}}}</style>")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contrast of two colours by WCAG 2.2: (L1 + 0.05) / (L2 + 0.05) of their relative luminances.
    fn contrast(a: RGBColor, b: RGBColor) -> f64 {
        let luminance = |RGBColor(r, g, b): RGBColor| {
            let linear = |v: u8| {
                let v = f64::from(v) / 255.0;
                if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
            };
            0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b)
        };
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn letters_and_series_can_be_told_from_dark_paper() {
        let paper = NIGHT[0].1;
        for (day, night) in &NIGHT[1..] {
            let least = if *day == GRID || *day == FAINT { 1.1 } else { 4.5 };
            let found = contrast(*night, paper);
            assert!(found >= least, "{night:?}: {found:.2}");
        }
    }

    #[test]
    fn every_colour_of_a_chart_has_one_for_the_night() {
        use crate::{Axis, Chart, Series, Style, svg, svg_by_theme};
        let styles = [Style::Band, Style::Bars, Style::Line, Style::Curve, Style::Points];
        let series = (0..14).map(|i| Series::new(format!("{i}"), styles[i % 5], [(0.5, 1.0 + i as f64), (1.5, 2.0)]));
        let x = Axis::log("x", "s");
        let chart = Chart { title: "all".into(), x, series: series.collect(), ..Chart::default() };
        let plain = svg(&chart);
        let drawn: std::collections::BTreeSet<&str> =
            plain.split(['"', ' ']).filter(|word| word.len() == 7 && word.starts_with('#')).collect();
        let sheet = sheet();
        assert!(drawn.len() >= 10, "{drawn:?}");
        for colour in drawn {
            assert!(sheet.contains(&format!("[fill=\"{colour}\"]")), "{colour} has none");
        }
        assert_eq!(svg_by_theme(&chart).replace(&sheet, ""), plain, "nothing else differs");
    }
}
