//! What a chart is written as: pictures, a table, numbers.

use std::{fmt::Write, path::Path};

use plot::{Axis, Cell, Chart, Guide, Point, Series, Style, Table};
use serde_json::{Value, json};

use super::{
    methods::TEXTBOOK,
    reference::Reference,
    study::{Estimate, Tried},
};
use crate::{error::Failure, output, stability::page::figure};

/// All that was found.
pub struct Report {
    /// Name of the scene.
    pub scene: String,
    /// The command that makes it again.
    pub command: String,
    /// Width and height of what was rendered, pixels.
    pub size: [u32; 2],
    /// Seeds of each budget.
    pub seeds: u32,
    /// Threads that rendered.
    pub threads: usize,
    /// Methods; the first is the one that efficiencies are relative to.
    pub methods: Vec<Tried>,
    /// References, by their number.
    pub references: Vec<Reference>,
    /// What else is to be said, a sentence each.
    pub notes: Vec<String>,
}

impl Report {
    /// Write charts, tables and numbers into a folder.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Failure> {
        for (name, chart) in [("error", self.error()), ("bias", self.bias()), ("efficiency", self.efficiency())] {
            output::write(&folder.join(format!("{name}.svg")), plot::svg(&chart).as_bytes())?;
            output::write(&folder.join(format!("{name}.png")), &plot::png(&chart))?;
        }
        output::write(&folder.join("chart.csv"), self.csv().as_bytes())?;
        output::write(&folder.join("chart.json"), format!("{:#}\n", self.json()).as_bytes())?;
        output::write(&folder.join("README.md"), self.page().as_bytes())
    }

    fn bias_of(&self, method: &Tried) -> Estimate {
        method.bias(self.references[method.reference].mean_error.unwrap_or(0.0))
    }

    fn against(&self, method: &Tried) -> Option<Estimate> {
        method.against(&self.methods[0])
    }

    /// What was rendered and against what.
    fn setting(&self) -> String {
        let [w, h] = self.size;
        let of = |reference: &Reference| match (reference.relmse, reference.is_clean()) {
            (Some(error), true) => format!("the reference's own relMSE, {error:.1e}, is taken out"),
            (Some(error), false) => format!("the reference's own relMSE, {error:.1e}, is part of them"),
            (None, _) => "the reference's own error is not known".into(),
        };
        let references: Vec<String> = self.references.iter().map(of).collect();
        format!("{w} x {h} pixels, {} seeds; {}.", self.seeds, references.join("; "))
    }

    /// Error against time.
    pub fn error(&self) -> Chart {
        let line = |method: &Tried| Series {
            name: method.name.clone(),
            style: Style::Line,
            points: method
                .levels()
                .iter()
                .map(|l| Point { x: l.cpu_seconds, y: l.relmse.mean, range: Some((l.relmse.low, l.relmse.high)) })
                .collect(),
        };
        let guide = self.methods[0].levels().first().map(|level| Guide::Slope {
            x: level.cpu_seconds,
            y: level.relmse.mean,
            slope: -1.0,
            label: "slope -1".into(),
        });
        Chart {
            title: format!("{}: error against time", self.scene),
            x: Axis::log("time of rendering", "processor s"),
            y: Axis::log("relMSE", ""),
            series: self.methods.iter().map(line).collect(),
            guides: guide.into_iter().collect(),
            notes: vec![format!("Bars: least to largest of the seeds. {}", self.setting())],
        }
    }

    /// Bias apart from noise.
    pub fn bias(&self) -> Chart {
        let point = |(place, method): (usize, &Tried)| {
            let Estimate { value, low, high } = self.bias_of(method);
            let point = Point { x: place as f64, y: 100.0 * value, range: Some((100.0 * low, 100.0 * high)) };
            Series { name: method.name.clone(), style: Style::Points, points: vec![point] }
        };
        Chart {
            title: format!("{}: bias", self.scene),
            x: Axis::names("methods, in the order of the legend", self.methods.iter().map(|_| "")),
            y: Axis::linear("mean difference", "% of the reference's mean"),
            series: self.methods.iter().enumerate().map(point).collect(),
            guides: vec![Guide::Level { y: 0.0, label: "no bias".into() }],
            notes: vec![format!("Bars: 95% intervals, from what pictures of one method differ by. {}", self.setting())],
        }
    }

    /// Efficiency relative to the textbook's.
    pub fn efficiency(&self) -> Chart {
        let bar = |method: &Tried| {
            let points = self.against(method).map(|e| Point { x: 0.0, y: e.value, range: Some((e.low, e.high)) });
            Series { name: method.name.clone(), style: Style::Bars, points: points.into_iter().collect() }
        };
        let series: Vec<Series> = self.methods.iter().map(bar).collect();
        let values = || series.iter().flat_map(|s| &s.points).map(|p| p.y).filter(|v| *v > 0.0);
        let (least, most) = values().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
        let axis = if most > 20.0 * least { Axis::log } else { Axis::linear };
        let budget = self.methods[0].levels().last().map_or(0, |level| level.budget);
        Chart {
            title: format!("{}: efficiency", self.scene),
            x: Axis::names(format!("at {budget} samples per pixel"), [""]),
            y: axis("1 / (relMSE x processor seconds)", "x textbook"),
            series,
            guides: vec![Guide::Level { y: 1.0, label: "as the textbook".into() }],
            notes: vec![format!("Bars: 95% intervals over the seeds. {}", self.setting())],
        }
    }

    /// Every picture, a row each.
    pub fn csv(&self) -> String {
        let columns =
            ["method", "budget", "seed", "samples", "cpu_seconds", "relmse", "relmse_plain", "rmse", "bias", "flip"];
        let mut table = Table::new(columns);
        for method in &self.methods {
            for shot in &method.shots {
                let d = &shot.distance;
                table.push([
                    Cell::from(method.name.as_str()),
                    shot.budget.into(),
                    shot.seed.to_string().into(),
                    shot.samples.into(),
                    shot.cpu_seconds.into(),
                    d.relmse.into(),
                    d.relmse_plain.into(),
                    d.rmse.into(),
                    d.bias.into(),
                    d.flip.into(),
                ]);
            }
        }
        table.csv()
    }

    /// All numbers.
    pub fn json(&self) -> Value {
        let method = |method: &Tried| {
            json!({
                "name": method.name, "method": method.method, "build_seconds": method.build_seconds,
                "reference": method.reference, "budgets": method.levels(), "bias": self.bias_of(method),
                "lasting_relmse": { "value": method.lasting.0, "standard_error": method.lasting.1 },
                "efficiency_relative": self.against(method),
            })
        };
        let reference = |reference: &Reference| {
            let files: Vec<String> = reference.files.iter().map(|file| file.display().to_string()).collect();
            json!({
                "files": files, "samples": reference.samples, "relmse": reference.relmse,
                "mean_standard_error": reference.mean_error, "noise_taken_out": reference.is_clean(),
            })
        };
        json!({
            "scene": self.scene, "resolution": self.size, "seeds": self.seeds, "threads": self.threads,
            "relative_to": self.methods[0].name,
            "references": self.references.iter().map(reference).collect::<Vec<_>>(),
            "methods": self.methods.iter().map(method).collect::<Vec<_>>(),
            "notes": self.notes,
        })
    }

    /// Heads and rows of the table.
    pub fn table(&self) -> (Vec<&'static str>, Vec<Vec<String>>) {
        let heads = vec![
            "method",
            "samples",
            "processor s",
            "relMSE",
            "FLIP",
            "bias, %",
            "lasting relMSE",
            "efficiency",
            "(95% interval)",
        ];
        let row = |method: &Tried| {
            let Some(level) = method.levels().pop() else { return vec![method.name.clone()] };
            let bias = self.bias_of(method);
            let half = 0.5 * (bias.high - bias.low);
            let (lasting, error) = method.lasting;
            let efficiency = self.against(method);
            vec![
                method.name.clone(),
                format!("{:.0}", level.samples),
                figure(level.cpu_seconds),
                format!("{:.2e}", level.relmse.mean),
                format!("{:.4}", level.flip),
                format!("{:+.2} +- {:.2}", 100.0 * bias.value, 100.0 * half),
                format!("{lasting:.1e} +- {error:.0e}"),
                efficiency.map_or("-".into(), |e| figure(e.value)),
                efficiency.map_or("-".into(), |e| format!("{} to {}", figure(e.low), figure(e.high))),
            ]
        };
        (heads, self.methods.iter().map(row).collect())
    }

    /// The page that shows it.
    fn page(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let (heads, rows) = self.table();
        let mut out = format!("# {}: speed against accuracy\n\n    {}\n\n", self.scene, self.command);
        out += &line(&heads.iter().map(ToString::to_string).collect::<Vec<_>>());
        out += &line(
            &heads
                .iter()
                .enumerate()
                .map(|(i, _)| if i == 0 { "---".into() } else { "---:".into() })
                .collect::<Vec<_>>(),
        );
        rows.iter().for_each(|row| out += &line(row));
        out += "\nAt the largest budget of each method. Efficiency is 1 / (relMSE x processor seconds), relative to the \
                first row's.\n";
        for (name, alt) in
            [("error", "relMSE against processor seconds"), ("bias", "Bias"), ("efficiency", "Efficiency")]
        {
            // Writing to a String does not fail.
            let _ = write!(out, "\n![{alt}]({name}.svg)\n");
        }
        let _ = write!(
            out,
            "\n{} `textbook` is `{TEXTBOOK}`. relMSE is the mean of (x - r)^2 / (r^2 + 0.01) over pixels and channels, r \
             the reference. Seconds are processor seconds of rendering, all threads together; methods took turns. Bias is \
             the mean difference relative to the reference's mean, of all pictures, with a 95% interval. Lasting relMSE \
             is the part of the error at the largest budget that all seeds share, so that more samples would not take \
             it away. `chart.csv` holds every picture, `chart.json` all figures.\n",
            self.setting()
        );
        for note in &self.notes {
            let _ = write!(out, "\n{note}\n");
        }
        out
    }
}
