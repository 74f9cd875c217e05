//! `tessera plan`: what a scene needs, which methods were tried, which is chosen, and what is left out.

use common::{
    job::JobRequest,
    method::Direct,
    plan::{MethodPlan, RuledOut, Trial},
    protocol::RenderSettings,
};
use serde::Serialize;

use crate::{
    args::PlanArgs,
    bench::process_seconds,
    bundle::Bundle,
    error::Failure,
    left_out::{self, LeftOut},
    print, request,
};

/// All that is printed.
#[derive(Serialize)]
struct Told<'a> {
    #[serde(flatten)]
    plan: &'a MethodPlan,
    /// Processor seconds that choosing took.
    trial_seconds: f64,
    /// Estimators that were not tried.
    ruled_out: Vec<RuledOut>,
    /// Code that the scene does not need, and what it would have cost.
    left_out: Vec<LeftOut>,
}

/// Run `tessera plan`: the same trial that a worker makes for a job with these options, and what is left out.
///
/// # Errors
/// Bad input.
pub fn plan(args: &PlanArgs) -> Result<(), Failure> {
    let mut bundle = Bundle::read(&args.scene)?;
    let request = request::of(&args.job, &bundle)?;
    let settings = request::settings(&request, &bundle)?;
    let trial = trial(&bundle, &request, settings.resolution)?;
    let (plan, trial_seconds) = of(&mut bundle, &request)?;
    for note in &bundle.notes {
        eprintln!("note: {note}");
    }
    let ruled_out = tracer::pilot::ruled_out(&plan.facts, &trial);
    let settings = RenderSettings { method: plan.method.clone(), ..settings };
    let left_out = left_out::measure(&mut bundle, &request, &settings)?;
    let told = Told { plan: &plan, trial_seconds, ruled_out, left_out };
    if args.json { print::json(&told) } else { print::lines(lines(&told)) }
}

fn trial(bundle: &Bundle, request: &JobRequest, resolution: [u32; 2]) -> Result<Trial, Failure> {
    let named = request.method.clone().or(&bundle.scene.settings.method);
    Ok(Trial { region: request.region(resolution)?, named, quality: Some(request::quality_of(request, bundle)) })
}

/// The plan of the job that `request` asks for, and the processor seconds that choosing took.
///
/// # Errors
/// The file or field that cannot be rendered.
pub fn of(bundle: &mut Bundle, request: &JobRequest) -> Result<(MethodPlan, f64), Failure> {
    let settings = request::settings(request, bundle)?;
    let prepared = bundle.load(request)?.build();
    let trial = trial(bundle, request, settings.resolution)?;
    let before = process_seconds();
    let plan = tracer::pilot::choose(&prepared, &settings, &trial);
    Ok((plan, process_seconds() - before))
}

fn lines(told: &Told) -> Vec<String> {
    let plan = told.plan;
    let facts = &plan.facts;
    let (has, has_not) = facts.has_and_has_not();
    let list = |names: &[&str]| if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
    let mut lines = vec![
        format!("scene     {} triangles; lights {}, with {} primitives", facts.triangles, facts.lights, facts.emitters),
        format!("has       {}", list(&has)),
        format!("has not   {}", list(&has_not)),
        format!("kernel    {}", plan.kernel.join(", ")),
        format!("method    {}", plan.line()),
    ];
    if plan.untried.is_none() {
        lines.push(format!("          chosen in {:.3} processor seconds", told.trial_seconds));
    }
    if plan.method.direct == Direct::Auto {
        lines.push("          auto, untried, is multiple importance sampling".into());
    }
    if !plan.considered.is_empty() {
        let names = plan.considered.iter().map(|tried| &*tried.name);
        let width = width("method", names);
        lines.push(String::new());
        lines.push(format!("  {:width$}  {:>10}  {:>8}  {:>10}", "method", "variance", "cost", "efficiency"));
        for tried in &plan.considered {
            let mark = if tried.name == plan.chosen { '*' } else { ' ' };
            let (name, variance, cost) = (&tried.name, tried.variance, tried.cost);
            lines.push(format!("{mark} {name:width$}  {variance:>10.4}  {cost:>8.0}  {:>10.2}", tried.efficiency));
        }
        lines.push(
            "  variance: of one sample, relative to luminance^2 + 0.01, mean over pixels; cost: counted work of a"
                .into(),
        );
        lines.push(
            "  sample, about nanoseconds; efficiency: 1 / (variance x cost), relative to the method chosen".into(),
        );
    }
    if !told.ruled_out.is_empty() {
        let width = width("not tried", told.ruled_out.iter().map(|out| &*out.what));
        lines.push(String::new());
        lines.push(format!("  {:width$}  why", "not tried"));
        lines.extend(told.ruled_out.iter().map(|out| format!("  {:width$}  {}", out.what, out.why)));
    }
    if !told.left_out.is_empty() {
        let name = |out: &LeftOut| match &out.beside[..] {
            [] => out.name.to_owned(),
            beside => format!("{} (without {})", out.name, beside.join(", ")),
        };
        let names: Vec<String> = told.left_out.iter().map(name).collect();
        let first = width("left out", told.left_out.iter().map(|out| out.what));
        let second = width("specialised on", names.iter().map(|name| &**name));
        lines.push(String::new());
        lines.push(format!("  {:first$}  {:second$}  would take", "left out", "specialised on"));
        lines.extend(told.left_out.iter().zip(&names).map(|(out, name)| {
            let LeftOut { what, times, times_error, .. } = out;
            format!("  {what:first$}  {name:second$}  {times:.2} +- {times_error:.2} times as long")
        }));
        lines.push("  processor time of the same picture by the general code, over that by the special one".into());
    }
    lines
}

fn width<'a>(head: &str, cells: impl Iterator<Item = &'a str>) -> usize {
    cells.map(str::len).max().unwrap_or(0).max(head.len())
}

#[cfg(test)]
mod tests {
    use common::plan::{Considered, Facts};

    use super::*;

    #[test]
    fn the_choice_is_marked_among_what_was_tried() {
        let tried = |name: &str, efficiency| Considered {
            name: name.into(),
            samples: 64,
            variance: 0.5,
            cost: 90.0,
            efficiency,
        };
        let plan = MethodPlan {
            facts: Facts { area_lights: true, lights: 1, ..Facts::default() },
            chosen: "light".into(),
            method: Default::default(),
            kernel: vec!["one path at a time".into()],
            untried: None,
            considered: vec![tried("mis", 0.5), tried("light", 1.0)],
        };
        let left_out = LeftOut { name: "few", what: "a tree", beside: vec!["waves"], times: 1.5, times_error: 0.02 };
        let ruled_out = vec![RuledOut { what: "bsdf".into(), why: "no ray hits it".into() }];
        let told = Told { plan: &plan, trial_seconds: 0.25, ruled_out, left_out: vec![left_out] };
        let lines = lines(&told);
        assert!(lines.iter().any(|line| line.contains("chosen in 0.250 processor seconds")), "{lines:?}");
        let starred: Vec<&String> = lines.iter().filter(|line| line.starts_with('*')).collect();
        assert!(starred.len() == 1 && starred[0].contains("light"), "{lines:?}");
        assert!(lines.iter().any(|line| line.starts_with("has not") && line.contains("textures")), "{lines:?}");
        assert!(lines.iter().any(|line| line.contains("bsdf") && line.contains("no ray hits it")), "{lines:?}");
        let cost = "few (without waves)  1.50 +- 0.02 times as long";
        assert!(lines.iter().any(|line| line.contains("a tree") && line.contains(cost)), "{lines:?}");
        let json = serde_json::to_value(&told).unwrap();
        assert_eq!((&json["chosen"], &json["left_out"][0]["times"]), (&"light".into(), &1.5.into()));
    }
}
