//! Both pictures of charts that hold everything a chart can.

use super::*;
use crate::layout::What;
use image::ImageReader;
use std::io::Cursor;

fn full() -> Chart {
    let xs = || (0..20).map(|i| 10f64.powf(-8.0 + 0.45 * f64::from(i)));
    let band = xs().map(|x| Point { x, y: x.sqrt(), range: Some((0.5 * x.sqrt(), 2.0 * x.sqrt())) }).collect();
    Chart {
        title: "Error of <two> forms & a \"bound\"".into(),
        x: Axis::log("solid angle", "sr"),
        y: Axis::log("relative error", ""),
        series: vec![
            Series::new("ours", Style::Line, xs().map(|x| (x, 1e-7))),
            Series::new("textbook", Style::Line, xs().map(|x| (x, (1e-7 / x).min(3.0)))),
            Series::new("zero now and then", Style::Points, xs().enumerate().map(|(i, x)| (x, if i % 3 == 0 { 0.0 } else { 1e-5 }))),
            Series { name: "spread".into(), style: Style::Band, points: band },
            Series::new("curve", Style::Curve, xs().map(|x| (x, 1e-3 * x.powf(0.1)))),
        ],
        guides: vec![
            Guide::Level { y: 1e-4, label: "bound 1e-4".into() },
            Guide::Slope { x: 1e-4, y: 1e-3, slope: -1.0, label: "slope -1".into() },
            Guide::At { x: 1e-2, label: "switch to area sampling".into() },
        ],
        notes: vec!["A note that is long enough to need a second line, since it goes on and on about what the reader should know before judging the curves.".into()],
    }
}

fn bars() -> Chart {
    Chart {
        title: "Leaks".into(),
        x: Axis::names("", ["vertices", "edges", "far from the origin"]),
        y: Axis::log("rays that leak", "of 1e5"),
        series: vec![
            Series::new("ours", Style::Bars, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)]),
            Series::new("textbook", Style::Bars, [(0.0, 1200.0), (1.0, 31.0), (2.0, 8.0)]),
        ],
        ..Chart::default()
    }
}

fn pixels(file: &[u8]) -> image::RgbImage {
    ImageReader::new(Cursor::new(file)).with_guessed_format().unwrap().decode().unwrap().to_rgb8()
}

#[test]
fn the_svg_is_well_formed_and_holds_every_word() {
    for chart in [full(), bars(), Chart::default()] {
        let text = svg(&chart);
        let document = roxmltree::Document::parse(&text).unwrap();
        let root = document.root_element();
        assert_eq!((root.attribute("width"), root.attribute("height")), (Some("800"), Some("500")));
        assert_eq!(root.attribute("viewBox"), Some("0 0 2400 1500"));
        assert_eq!(root.attribute("aria-label"), Some(chart.title.as_str()));
        let words: String = document.descendants().filter_map(|n| n.text()).collect();
        for series in &chart.series {
            assert!(words.contains(&series.name), "{}", series.name);
        }
    }
}

#[test]
fn the_png_has_its_size_and_every_colour() {
    let chart = full();
    let picture = pixels(&png(&chart));
    assert_eq!(picture.dimensions(), (WIDTH, HEIGHT));
    for (index, series) in chart.series.iter().enumerate().filter(|(_, s)| s.style != Style::Band) {
        let c = marks::colour(index);
        let near = |p: &image::Rgb<u8>| p.0.iter().zip([c.0, c.1, c.2]).all(|(a, b)| a.abs_diff(b) < 12);
        assert!(picture.pixels().filter(|p| near(p)).count() > 30, "{} is not to be seen", series.name);
    }
}

#[test]
fn the_same_chart_gives_the_same_bytes() {
    assert_eq!(svg(&full()), svg(&full()));
    assert_eq!(png(&bars()), png(&bars()));
}

#[test]
fn zeros_on_a_log_axis_are_told_and_drawn_on_the_edge() {
    let chart = full();
    let layout = layout::layout(&chart, &draw::width);
    assert!(layout.notes.iter().any(|(_, n)| n == "Exactly 0, drawn on the lower edge: zero now and then."));
    let (_, y, clamped) = layout.place(&Point { x: 1e-4, y: 0.0, range: None }).unwrap();
    assert!(clamped && y == layout.plot.bottom);
    assert_eq!(layout.place(&Point { x: 0.0, y: 1.0, range: None }), None);
    assert_eq!(layout.place(&Point { x: 1e-4, y: f64::NAN, range: None }), None);
    let on_linear = Chart { y: Axis::linear("", ""), ..chart };
    assert!(!layout::layout(&on_linear, &draw::width).notes.iter().any(|(_, n)| n.contains("lower edge")));
}

#[test]
fn legend_and_notes_stay_below_the_plot_area_and_inside_the_picture() {
    for chart in [full(), bars()] {
        let layout = layout::layout(&chart, &draw::width);
        let Chart { series, guides, .. } = &chart;
        assert_eq!(layout.legend.len(), series.len() + guides.len());
        for (i, entry) in layout.legend.iter().enumerate() {
            assert!(entry.area.top > layout.plot.bottom + 40.0, "{}", entry.text);
            assert!(entry.area.left >= 0.0 && entry.area.right <= f64::from(WIDTH), "{}", entry.text);
            assert_eq!(entry.what, if i < series.len() { What::Series(i) } else { What::Guide(i - series.len()) });
            for other in &layout.legend[..i] {
                let apart = other.area.right <= entry.area.left || other.area.bottom <= entry.area.top;
                assert!(apart, "{} on {}", entry.text, other.text);
            }
        }
        let lowest = layout.legend.iter().map(|e| e.area.bottom).fold(0.0, f64::max);
        for (y, note) in &layout.notes {
            assert!(*y > lowest && *y < f64::from(HEIGHT), "{note}");
            assert!(draw::width(note, layout::TEXT) <= f64::from(WIDTH) - 20.0, "{note}");
        }
        assert!(layout.plot.bottom - layout.plot.top > 200.0, "too little room for the data");
    }
}

#[test]
fn a_table_reads_back() {
    let mut table = Table::new(["x", "what, then"]);
    table.push([0.1.into(), "say \"no\"".into()]);
    table.push([1.0 / 3.0, 1e-30].map(Cell::from));
    table.push([Cell::from(70_000usize), f64::INFINITY.into()]);
    assert_eq!(table.csv(), "x,\"what, then\"\n0.1,\"say \"\"no\"\"\"\n0.3333333,1e-30\n70000,inf\n");
    assert_eq!((table.len(), table.is_empty(), table.columns().len()), (3, false, 2));
}
