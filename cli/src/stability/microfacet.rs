//! GGX as roughness goes to nothing.

use super::{Effort, Outcome, Row, ratios, worst};
use plot::{Axis, Chart, Guide, Series, Style, Table};
use tracer::math::Vec3;
use tracer::microfacet::{Ggx, SMOOTH_ALPHA};

/// The distribution's peak.
pub(super) const GGX: Row = Row {
    id: "ggx",
    title: "GGX for small alpha",
    fails: "(n.h)^2 (alpha^2 - 1) + 1 in f32 is what rounding leaves of 1 - 1: below alpha 1e-3 the density of normals \
            is off by factors, then infinite.",
    instead: "The density by slopes has no such difference, and below alpha 1e-3 the surface is a delta.",
    measure: ggx,
};

/// The distribution as textbooks print it, in f32.
fn textbook(alpha: f32, cos: f32) -> f32 {
    let a2 = alpha * alpha;
    let d = cos * cos * (a2 - 1.0) + 1.0;
    a2 / (std::f32::consts::PI * d * d)
}

/// The same by slopes, in f64.
fn exact(alpha: f64, m: Vec3) -> f64 {
    let m = m.as_dvec3();
    let cos2 = m.z * m.z / m.length_squared();
    let tan2 = (m.x * m.x + m.y * m.y) / (m.z * m.z);
    let e = cos2 * (1.0 + tan2 / (alpha * alpha));
    1.0 / (std::f64::consts::PI * alpha * alpha * e * e)
}

fn ggx(_: Effort) -> Outcome {
    let mut table = Table::new(["alpha", "slope_over_alpha", "textbook_relative_error", "ours_relative_error"]);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for alpha in ratios(1e-4, 1.0, 41).into_iter().map(|a| a as f32) {
        let mut most = [0.0f64; 2];
        let ggx = Ggx::new(alpha, alpha);
        for slope in [0.0f32, 0.25, 0.5, 1.0, 2.0, 4.0] {
            for turn in [0.0f32, 0.7, 2.5] {
                let (s, c) = (f64::from(turn).sin() as f32, f64::from(turn).cos() as f32);
                let m = Vec3::new(slope * alpha * c, slope * alpha * s, 1.0).normalize();
                let truth = exact(alpha.into(), m);
                let error = |found: f32| (f64::from(found) / truth - 1.0).abs();
                let textbook = error(textbook(alpha, m.z));
                let mine = ggx.map(|ggx| error(ggx.d(m)));
                most[0] = worst([most[0], textbook]);
                most[1] = worst([most[1], mine.unwrap_or(0.0)]);
                if turn == 0.0 {
                    let mine = mine.map_or_else(|| "delta".into(), Into::into);
                    table.push([f64::from(alpha).into(), f64::from(slope).into(), textbook.into(), mine]);
                }
            }
        }
        theirs.push((f64::from(alpha), most[0]));
        if ggx.is_some() {
            ours.push((f64::from(alpha), most[1]));
        }
    }
    let bound = 2e-6;
    Outcome {
        textbook: worst(theirs.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound,
        figure: "relative error of the density of normals",
        chart: Chart {
            title: "GGX's density of normals, within four alphas of the peak".into(),
            x: Axis::log("alpha", ""),
            y: Axis::log("worst relative error", "").between(1e-8, 1e3),
            series: vec![
                Series::new("ours: by slopes", Style::Line, ours),
                Series::new("textbook: by cosines", Style::Line, theirs),
            ],
            guides: vec![
                Guide::Level { y: bound, label: "bound".into() },
                Guide::At { x: SMOOTH_ALPHA.into(), label: "below: ours is a delta".into() },
            ],
            notes: vec![],
        },
        table,
    }
}
