//! Schlick's approximation against Fresnel's equations, for dielectrics and metals.

use super::{Effort, Outcome, Row, worst};
use common::method::Fresnel;
use common::scene::Metal;
use plot::{Axis, Chart, Guide, Series, Style, Table};
use tracer::fresnel;

/// Dielectrics, error against the angle.
pub(super) const ANGLE: Row = Row {
    id: "schlick-angle",
    title: "Schlick's reflectance of glass, by angle",
    fails: "Schlick's polynomial is fitted to light that enters; light that leaves a denser medium reflects almost \
            all of itself near the critical angle, where the polynomial still says a few percent.",
    instead: "Fresnel's equations themselves, with the refracted cosine in a form that does not cancel.",
    measure: by_angle,
};

/// Dielectrics, worst error against the index.
pub(super) const INDEX: Row = Row {
    id: "schlick-index",
    title: "Schlick's reflectance of dielectrics, by index",
    fails: "The polynomial has the right value at normal incidence and at grazing only: in between its error grows \
            both for indices near 1 and for high ones.",
    instead: "Fresnel's equations themselves.",
    measure: by_index,
};

/// Metals, error against the angle.
pub(super) const METALS: Row = Row {
    id: "schlick-metals",
    title: "Schlick's reflectance of metals, by angle",
    fails: "A metal's reflectance dips before it rises to 1 at grazing; the polynomial only rises, and for metals \
            that absorb weakly, such as chromium, it is far too high there.",
    instead: "Fresnel's equations for a complex index of refraction, per channel.",
    measure: metals,
};

/// Absolute error that single precision may add. The curve is vertical at the critical angle, where one
/// unit in the last place of the cosine moves the reflectance by about 1e-3; the sweeps keep 0.02 degrees
/// away from it.
const BOUND: f64 = 1e-4;

/// Reflectance by Fresnel's equations in f64; `eta` is far over near.
fn exact(cos_i: f64, eta: f64) -> f64 {
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    0.5 * (s * s + p * p)
}

/// Errors of ours and of Schlick's at an angle in degrees, on the side where light meets `eta`.
fn errors(degrees: f64, eta: f64) -> (f64, f64) {
    let (cos, eta) = (degrees.to_radians().cos() as f32, eta as f32);
    let truth = exact(cos.into(), eta.into());
    let error = |method| (f64::from(fresnel::split(method, cos, eta).reflected) - truth).abs();
    (error(Fresnel::Exact), error(Fresnel::Schlick))
}

/// Angles in degrees: 0.25 apart, and 0.02 on both sides of the critical one; none nearer to it.
fn angles(eta: f64) -> Vec<f64> {
    let critical = eta.asin().to_degrees();
    let mut all: Vec<f64> = (0..360).map(|i| f64::from(i) * 0.25).collect();
    if critical.is_finite() {
        all.retain(|a| (a - critical).abs() > 0.02);
        all.extend([critical - 0.02, critical + 0.02]);
        all.sort_by(f64::total_cmp);
    }
    all
}

fn by_angle(_: Effort) -> Outcome {
    let mut table = Table::new(["angle_degrees", "index_far_over_near", "ours_error", "schlick_error"]);
    let mut curves = Vec::new();
    for (name, eta) in
        [("n 1.5 entering", 1.5), ("n 1.5 leaving", 1.0 / 1.5), ("n 1.33 entering", 1.33), ("n 2.4 entering", 2.4)]
    {
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for (i, angle) in angles(eta).into_iter().enumerate() {
            let (a, b) = errors(angle, eta);
            // The curves are finer than the table.
            if i % 4 == 0 {
                table.push([angle, eta, a, b].map(Into::into));
            }
            ours.push((angle, a));
            theirs.push((angle, b));
        }
        curves.push((name, ours, theirs));
    }
    let ours = worst(curves.iter().flat_map(|c| c.1.iter().map(|p| p.1)));
    let textbook = worst(curves.iter().flat_map(|c| c.2.iter().map(|p| p.1)));
    // Ours at each angle is the worst of the four: they lie on each other.
    let series = std::iter::once(Series::new(
        "ours, worst of the four",
        Style::Curve,
        (0..360).map(|i| f64::from(i) * 0.25).map(|angle| {
            let at = curves.iter().flat_map(|c| c.1.iter().filter(|p| p.0 == angle).map(|p| p.1));
            (angle, worst(at).max(1e-9))
        }),
    ))
    .chain(curves.iter().map(|c| Series::new(format!("Schlick, {}", c.0), Style::Curve, c.2.iter().copied())))
    .collect();
    Outcome {
        textbook,
        ours,
        bound: BOUND,
        figure: "absolute error of the reflectance",
        chart: Chart {
            title: "Reflectance of a dielectric against the angle of incidence".into(),
            x: Axis::linear("angle of incidence", "degrees").between(0.0, 90.0),
            y: Axis::log("absolute error of the reflectance", "").between(1e-9, 2.0),
            series,
            guides: vec![Guide::Level { y: BOUND, label: "bound".into() }],
            notes: vec![],
        },
        table,
    }
}

fn by_index(_: Effort) -> Outcome {
    let mut table = Table::new(["index", "side", "ours_worst_error", "schlick_worst_error"]);
    let mut curves = [const { Vec::new() }; 4];
    for i in 0..=59 {
        let index = 1.05 + 0.05 * f64::from(i);
        for (side, eta) in [index, 1.0 / index].into_iter().enumerate() {
            let (ours, theirs): (Vec<f64>, Vec<f64>) = angles(eta).into_iter().map(|angle| errors(angle, eta)).unzip();
            let (ours, theirs) = (worst(ours), worst(theirs));
            let name = ["entering", "leaving"][side];
            table.push([index.into(), name.into(), ours.into(), theirs.into()]);
            curves[side].push((index, ours));
            curves[2 + side].push((index, theirs));
        }
    }
    let [ours_in, ours_out, theirs_in, theirs_out] = curves;
    Outcome {
        textbook: worst(theirs_in.iter().chain(&theirs_out).map(|p| p.1)),
        ours: worst(ours_in.iter().chain(&ours_out).map(|p| p.1)),
        bound: BOUND,
        figure: "absolute error of the reflectance, worst angle",
        chart: Chart {
            title: "Reflectance of dielectrics of every index, at the worst angle".into(),
            x: Axis::linear("index of refraction", ""),
            y: Axis::log("worst absolute error of the reflectance", ""),
            series: vec![
                Series::new("ours, entering", Style::Curve, ours_in),
                Series::new("Schlick, entering", Style::Curve, theirs_in),
                Series::new("ours, leaving", Style::Curve, ours_out),
                Series::new("Schlick, leaving", Style::Curve, theirs_out),
            ],
            guides: vec![Guide::Level { y: BOUND, label: "bound".into() }],
            notes: vec![],
        },
        table,
    }
}

/// Reflectance of a conductor in air by Fresnel's equations in f64, with the index as a complex number:
/// unlike the form in real numbers that rendering uses.
fn exact_metal(cos: f64, eta: f64, k: f64) -> f64 {
    // Complex numbers as pairs.
    let mul = |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let norm = |a: (f64, f64)| a.0 * a.0 + a.1 * a.1;
    let index2 = mul((eta, k), (eta, k));
    let (re, im) = (index2.0 - (1.0 - cos * cos), index2.1);
    // Square root with positive parts: index times the cosine inside.
    let length = re.hypot(im);
    let inside = ((0.5 * (length + re)).max(0.0).sqrt(), (0.5 * (length - re)).max(0.0).sqrt());
    let s = norm((cos - inside.0, -inside.1)) / norm((cos + inside.0, inside.1));
    let dense = (index2.0 * cos, index2.1 * cos);
    let p = norm((dense.0 - inside.0, dense.1 - inside.1)) / norm((dense.0 + inside.0, dense.1 + inside.1));
    0.5 * (s + p)
}

fn metals(_: Effort) -> Outcome {
    let mut table = Table::new(["metal", "angle_degrees", "channel", "ours_error", "schlick_error"]);
    let mut ours = Vec::new();
    let mut series = Vec::new();
    let all = [Metal::Au, Metal::Ag, Metal::Cu, Metal::Al, Metal::Cr];
    let mut ours_at = vec![0.0f64; 361];
    let mut textbook = 0.0;
    for metal in all {
        let name = format!("{metal:?}");
        let index = fresnel::metals::index(metal);
        let f0 = index.reflectance(1.0);
        let mut curve = Vec::new();
        for (i, mine) in ours_at.iter_mut().enumerate() {
            let angle = i as f64 * 0.25;
            let cos = angle.to_radians().cos().max(0.0) as f32;
            let (exactly, schlick) = (index.reflectance(cos), fresnel::schlick_rgb(f0, cos));
            let mut most = 0.0;
            for channel in 0..3 {
                let truth = exact_metal(cos.into(), index.eta[channel].into(), index.k[channel].into());
                let [a, b] = [exactly, schlick].map(|found| (f64::from(found[channel]) - truth).abs());
                if i % 4 == 0 {
                    table.push([name.clone().into(), angle.into(), channel.into(), a.into(), b.into()]);
                }
                *mine = worst([*mine, a]);
                most = worst([most, b]);
            }
            curve.push((angle, most));
        }
        textbook = worst(curve.iter().map(|p| p.1).chain([textbook]));
        series.push(Series::new(format!("Schlick, {name}"), Style::Curve, curve));
    }
    ours.extend(ours_at.iter().enumerate().map(|(i, e)| (i as f64 * 0.25, e.max(1e-9))));
    series.insert(0, Series::new("ours, worst of the five", Style::Curve, ours));
    let bound = 2e-6;
    Outcome {
        textbook,
        ours: worst(ours_at),
        bound,
        figure: "absolute error of the reflectance, worst channel",
        chart: Chart {
            title: "Reflectance of metals against the angle of incidence".into(),
            x: Axis::linear("angle of incidence", "degrees").between(0.0, 90.0),
            y: Axis::log("absolute error, worst channel", "").between(1e-9, 2.0),
            series,
            guides: vec![Guide::Level { y: bound, label: "bound".into() }],
            notes: vec![],
        },
        table,
    }
}
