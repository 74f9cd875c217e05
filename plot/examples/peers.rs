//! The chart of docs/performance.md: `cargo run --release -p tessera-plot --example peers -- ROWS.jsonl OUT`, the rows as
//! benches/peers/compare.py writes them, draws OUT.svg and OUT.png.

use std::collections::BTreeMap;

use plot::{Axis, Chart, Series, Style};
use serde_json::Value;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(rows), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err("expected ROWS.jsonl and OUT".into());
    };
    // Of each renderer and scene, the efficiencies of its pictures.
    let mut found: BTreeMap<String, BTreeMap<String, Vec<f64>>> = BTreeMap::new();
    for line in std::fs::read_to_string(rows)?.lines() {
        let row: Value = serde_json::from_str(line)?;
        let text = |key: &str| row[key].as_str().unwrap_or_default().to_owned();
        let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
        let efficiency = 1.0 / (number("relmse") * number("cpu_seconds"));
        found.entry(text("renderer")).or_default().entry(text("scene")).or_default().push(efficiency);
    }
    let mut scenes: Vec<String> = found.values().flat_map(BTreeMap::keys).cloned().collect();
    scenes.sort();
    scenes.dedup();
    let place = |scene: &String| scenes.iter().position(|name| name == scene).unwrap_or(0) as f64;
    let series = found.iter().map(|(renderer, by_scene)| {
        let points = by_scene.iter().map(|(scene, values)| (place(scene), median(values)));
        Series::new(renderer, Style::Points, points)
    });
    let chart = Chart {
        title: "Error against time, one core each: more is better".into(),
        x: Axis::names("scene", scenes.clone()),
        y: Axis::log("1 / (relMSE x processor seconds)", "1/s"),
        series: series.collect(),
        notes: vec!["Medians over the pictures of one run, in which the renderers took turns.".into()],
        ..Chart::default()
    };
    std::fs::write(format!("{out}.svg"), plot::svg(&chart))?;
    std::fs::write(format!("{out}.png"), plot::png(&chart))?;
    Ok(())
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
