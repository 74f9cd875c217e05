//! `tessera plan`: what a scene needs, which methods were tried, which is chosen, and what is left out.

use common::{
    method::Direct,
    plan::{MethodPlan, Trial},
};

use crate::{args::PlanArgs, bundle::Bundle, error::Failure, print, request};

/// Run `tessera plan`: the same trial that a worker makes for a job with these options.
///
/// # Errors
/// Bad input.
pub fn plan(args: &PlanArgs) -> Result<(), Failure> {
    let mut bundle = Bundle::read(&args.scene)?;
    let request = request::of(&args.job, &bundle)?;
    let plan = of(&mut bundle, &request)?;
    for note in &bundle.notes {
        eprintln!("note: {note}");
    }
    if args.json { print::json(&plan) } else { print::lines(lines(&plan)) }
}

/// The plan of the job that `request` asks for.
///
/// # Errors
/// The file or field that cannot be rendered.
pub fn of(bundle: &mut Bundle, request: &common::job::JobRequest) -> Result<MethodPlan, Failure> {
    let settings = request::settings(request, bundle)?;
    let prepared = bundle.load(request)?.build();
    let named = request.method.clone().or(&bundle.scene.settings.method);
    let trial = Trial { region: request.region(settings.resolution)?, named };
    Ok(tracer::pilot::choose(&prepared, &settings, &trial))
}

fn lines(plan: &MethodPlan) -> Vec<String> {
    let facts = &plan.facts;
    let (has, has_not) = facts.has_and_has_not();
    let list = |names: &[&str]| if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
    let mut lines = vec![
        format!("scene     {} triangles; lights {}, with {} primitives", facts.triangles, facts.lights, facts.emitters),
        format!("has       {}", list(&has)),
        format!("has not   {}: nothing is spent on it", list(&has_not)),
        format!("kernel    {}", plan.kernel.join(", ")),
        format!("method    {}", plan.line()),
    ];
    if plan.method.direct == Direct::Auto {
        lines.push("          auto, untried, is multiple importance sampling".into());
    }
    if plan.considered.is_empty() {
        return lines;
    }
    let width = plan.considered.iter().map(|tried| tried.name.len()).max().unwrap_or(0).max(6);
    lines.push(String::new());
    lines.push(format!("  {:width$}  {:>10}  {:>8}  {:>10}", "method", "variance", "cost", "efficiency"));
    for tried in &plan.considered {
        let mark = if tried.name == plan.chosen { '*' } else { ' ' };
        let (name, variance, cost) = (&tried.name, tried.variance, tried.cost);
        lines.push(format!("{mark} {name:width$}  {variance:>10.4}  {cost:>8.0}  {:>10.2}", tried.efficiency));
    }
    lines.push(String::new());
    lines.push(
        "variance: of one sample, relative to luminance^2 + 0.01, mean over pixels; cost: counted work of a".into(),
    );
    lines.push("sample, about nanoseconds; efficiency: 1 / (variance x cost), relative to the method chosen".into());
    lines
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
        let lines = lines(&plan);
        let starred: Vec<&String> = lines.iter().filter(|line| line.starts_with('*')).collect();
        assert!(starred.len() == 1 && starred[0].contains("light"), "{lines:?}");
        assert!(lines.iter().any(|line| line.starts_with("has not") && line.contains("textures")), "{lines:?}");
    }
}
