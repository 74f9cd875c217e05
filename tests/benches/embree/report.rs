//! What was measured, as text, CSV and charts.

use std::path::Path;

use plot::{Axis, Chart, Guide, Series, Style, Table};
use tracer::geometry::InstructionSet;

/// One scene's rays of one kind: million rays a second.
pub struct Cell {
    pub scene: &'static str,
    pub rays: &'static str,
    pub ours: f64,
    pub robust: f64,
    pub fast: f64,
    pub sse: f64,
    /// The median over the repetitions of ours to Embree's robust mode in the same repetition.
    pub ratio: f64,
    /// The rate with four children a node, and how many times as fast eight are: medians as above.
    pub four: Option<(f64, f64)>,
    /// Rays of which one side says that they hit and the other that they do not.
    pub differ: usize,
}

/// One scene's trees: seconds, and bytes a triangle.
pub struct Tree {
    pub scene: &'static str,
    pub triangles: usize,
    pub threads: usize,
    pub ours: f64,
    pub theirs: f64,
    pub our_bytes: f64,
    pub their_bytes: f64,
    pub four: Option<FourTree>,
}

/// The same of four children a node.
pub struct FourTree {
    pub seconds: f64,
    pub bytes: f64,
}

pub struct Report {
    pub embree: String,
    pub instructions: InstructionSet,
    pub cells: Vec<Cell>,
    pub trees: Vec<Tree>,
}

impl Default for Report {
    fn default() -> Self {
        Self { embree: String::new(), instructions: InstructionSet::Portable, cells: Vec::new(), trees: Vec::new() }
    }
}

impl Report {
    /// The geometric mean of the ratios to Embree's robust mode.
    fn mean(&self, value: impl Fn(&Cell) -> f64) -> f64 {
        (self.cells.iter().map(|cell| value(cell).ln()).sum::<f64>() / self.cells.len() as f64).exp()
    }

    /// The tables, in Markdown.
    pub fn print(&self) {
        if !self.cells.is_empty() {
            self.print_rays();
        }
        self.print_builds();
        self.print_widths();
    }

    fn print_rays(&self) {
        let (embree, instructions) = (&self.embree, self.instructions);
        println!("Million rays a second, one thread; Tessera with {instructions:?}, Embree {embree}.\n");
        println!("| Scene | Rays | Tessera | Embree robust | ratio | Embree fast | Tessera SSE2 | differ |");
        println!("|---|---|---:|---:|---:|---:|---:|---:|");
        for c in &self.cells {
            println!(
                "| {} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {} |",
                c.scene, c.rays, c.ours, c.robust, c.ratio, c.fast, c.sse, c.differ
            );
        }
        let [ratio, fast, sse] =
            [self.mean(|c| c.ratio), self.mean(|c| c.fast / c.robust), self.mean(|c| c.sse / c.robust)];
        println!("| geometric mean, times Embree robust | | {ratio:.3} | 1 | | {fast:.3} | {sse:.3} | |\n");
    }

    fn print_builds(&self) {
        println!("| Scene | Triangles | Threads | Tessera, s | Embree, s | ratio | bytes a triangle | Embree's |");
        println!("|---|---:|---:|---:|---:|---:|---:|---:|");
        for t in &self.trees {
            println!(
                "| {} | {} | {} | {:.3} | {:.3} | {:.2} | {:.1} | {:.1} |",
                t.scene,
                t.triangles,
                t.threads,
                t.ours,
                t.theirs,
                t.theirs / t.ours,
                t.our_bytes,
                t.their_bytes
            );
        }
    }

    /// Eight children a node against four, where both were measured.
    fn print_widths(&self) {
        let rays: Vec<_> = self.cells.iter().filter_map(|c| Some((c, c.four?))).collect();
        if !rays.is_empty() {
            println!("\n| Scene | Rays | eight children | four | eight over four |");
            println!("|---|---|---:|---:|---:|");
            for (c, (rate, ratio)) in &rays {
                println!("| {} | {} | {:.2} | {rate:.2} | {ratio:.2} |", c.scene, c.rays, c.ours);
            }
            let mean = (rays.iter().map(|(_, (_, ratio))| ratio.ln()).sum::<f64>() / rays.len() as f64).exp();
            println!("| geometric mean | | | | {mean:.3} |");
        }
        let trees: Vec<_> = self.trees.iter().filter_map(|t| Some((t, t.four.as_ref()?))).collect();
        if !trees.is_empty() {
            println!("\n| Scene | Threads | build of eight, s | of four, s | bytes a triangle, eight | four |");
            println!("|---|---:|---:|---:|---:|---:|");
            for (t, four) in trees {
                println!(
                    "| {} | {} | {:.3} | {:.3} | {:.1} | {:.1} |",
                    t.scene, t.threads, t.ours, four.seconds, t.our_bytes, four.bytes
                );
            }
        }
    }

    /// `rays.csv`, `builds.csv`, and a chart of the ratios.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        std::fs::create_dir_all(folder)?;
        let mut rays =
            Table::new(["scene", "rays", "tessera", "embree_robust", "ratio", "embree_fast", "tessera_sse2", "differ"]);
        for c in &self.cells {
            let rates = [c.ours, c.robust, c.ratio, c.fast, c.sse, c.differ as f64];
            rays.push([c.scene.into(), c.rays.into()].into_iter().chain(rates.map(Into::into)));
        }
        std::fs::write(folder.join("rays.csv"), rays.csv())?;
        let mut builds =
            Table::new(["scene", "triangles", "threads", "tessera_s", "embree_s", "tessera_bytes", "embree_bytes"]);
        for t in &self.trees {
            let numbers =
                [t.triangles as f64, t.threads as f64, t.ours, t.theirs, t.our_bytes, t.their_bytes].map(Into::into);
            builds.push([t.scene.into()].into_iter().chain(numbers));
        }
        std::fs::write(folder.join("builds.csv"), builds.csv())?;
        if self.cells.is_empty() {
            return Ok(());
        }
        let chart = self.chart();
        std::fs::write(folder.join("rays.svg"), plot::svg(&chart))?;
        std::fs::write(folder.join("rays.png"), plot::png(&chart))?;
        Ok(())
    }

    fn chart(&self) -> Chart {
        // The first word of each kind; what is shuffled has an s.
        let kinds: Vec<&str> = self.cells.iter().map(|c| c.rays).collect();
        let mut names: Vec<&str> = Vec::new();
        for kind in kinds {
            if !names.contains(&kind) {
                names.push(kind);
            }
        }
        let mut scenes: Vec<&str> = Vec::new();
        for cell in &self.cells {
            if !scenes.contains(&cell.scene) {
                scenes.push(cell.scene);
            }
        }
        let series = scenes.iter().map(|scene| {
            let cells = self.cells.iter().filter(|cell| cell.scene == *scene);
            Series::new(*scene, Style::Bars, cells.enumerate().map(|(k, cell)| (k as f64, cell.ratio)))
        });
        Chart {
            title: format!("Rays a second, Tessera over Embree {}'s robust mode", self.embree),
            x: Axis::names("rays", names),
            y: Axis::linear("ratio", ""),
            series: series.collect(),
            guides: vec![Guide::Level { y: 1.0, label: "Embree robust".into() }],
            notes: vec![format!("One thread. Geometric mean {:.2}.", self.mean(|c| c.ratio))],
        }
    }
}
