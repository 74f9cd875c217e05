//! Writes a chart with one of everything: `cargo run --example sampler -- DIR`.

use plot::{Axis, Chart, Guide, Series, Style};

fn main() -> std::io::Result<()> {
    let dir = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    let xs = || (0..20).map(|i| 10f64.powf(-8.0 + 0.45 * f64::from(i)));
    let chart = Chart {
        title: "Two forms of one quantity".into(),
        x: Axis::log("solid angle", "sr"),
        y: Axis::log("relative error", ""),
        series: vec![
            Series::new("ours", Style::Line, xs().map(|x| (x, 1e-7))),
            Series::new("textbook", Style::Line, xs().map(|x| (x, (1e-7 / x).min(3.0)))),
            Series::new("another", Style::Points, xs().map(|x| (x, 1e-5 * x.powf(0.2)))),
            Series::new("zero at times", Style::Line, xs().map(|x| (x, (1e-3 - x).max(0.0)))),
        ],
        guides: vec![
            Guide::Level { y: 1e-4, label: "bound 1e-4".into() },
            Guide::Slope { x: 1e-4, y: 1e-3, slope: -1.0, label: "slope -1".into() },
        ],
        notes: vec!["A remark on how the figures were come by.".into()],
    };
    let bars = Chart {
        title: "Rays that leak".into(),
        x: Axis::names("where they aim", ["vertices", "edges", "far from the origin"]),
        y: Axis::log("rays that leak", "of 1e5"),
        series: vec![
            Series::new("ours", Style::Bars, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)]),
            Series::new("textbook", Style::Bars, [(0.0, 1200.0), (1.0, 31.0), (2.0, 8.0)]),
        ],
        ..Chart::default()
    };
    for (name, chart) in [("lines", chart), ("bars", bars)] {
        std::fs::write(format!("{dir}/{name}.svg"), plot::svg(&chart))?;
        std::fs::write(format!("{dir}/{name}.png"), plot::png(&chart))?;
    }
    Ok(())
}
