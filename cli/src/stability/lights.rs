//! Solid angles of lights, and which light a hit asks.

use super::random::Random;
use super::shapes::direction;
use super::{Effort, Outcome, Row, ratios, worst};
use common::method::{LightPick, LightSampling, Method};
use plot::{Axis, Chart, Guide, Series, Style, Table};
use tracer::light::{AreaLight, Emitter, LightSources, Lights, Reference, Stratum, textbook};
use tracer::math::{DVec3, Rgb, Vec2, Vec3};

/// Girard's excess.
pub(super) const TRIANGLE: Row = Row {
    id: "spherical-triangle",
    title: "Solid angle of a triangle",
    fails: "Girard's excess is the sum of three angles less pi: of a small triangle it keeps rounding errors alone, \
            so densities and samples are noise.",
    instead: "Van Oosterom and Strackee's tangent of the half angle and Peters' sampling by half angles, with one \
              function for the density sampled and evaluated.",
    measure: triangle,
};

/// Four angles less 2 pi.
pub(super) const RECTANGLE: Row = Row {
    id: "spherical-rectangle",
    title: "Solid angle of a rectangle",
    fails: "Four angles less 2 pi cancel for small and grazing rectangles as three do for triangles.",
    instead: "Tangents of half angles here too, added as complex numbers.",
    measure: rectangle,
};

/// 1 - cos.
pub(super) const SPHERE: Row = Row {
    id: "sphere-cone",
    title: "Solid angle of a sphere",
    fails: "1 - cos of a narrow cone loses its digits: at a thousandth of a radian it is off by percents, at a \
            ten-thousandth it is 0 and the density infinite.",
    instead: "1 - cos as sin^2 / (1 + cos), from squares of radius and distance in f64.",
    measure: sphere,
};

/// A length for an area.
pub(super) const CHOICE: Row = Row {
    id: "light-choice",
    title: "Choosing a light",
    fails: "An importance that clamps a squared distance by a length depends on the unit of length: the same scene \
            in millimetres asks other lights than in metres.",
    instead: "The light tree compares squares with squares, so the choice is the same at every scale.",
    measure: choice,
};

/// Solid angle of a triangle seen from `from`, in f64 (Van Oosterom and Strackee 1983, with the volume from
/// edges, which does not cancel).
fn exact_triangle(p: [DVec3; 3], from: Vec3) -> f64 {
    let [a, b, c] = p.map(|p| p - from.as_dvec3());
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let volume = a.dot((b - a).cross(c - a)).abs();
    let share = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * volume.atan2(share)
}

/// The greatest error of ours for an emitter of this solid angle: of densities, which are one over it, and
/// between those sampled and those evaluated for the same point.
fn our_error(emitter: &Emitter, from: Vec3, exact: f64, random: &mut Random) -> f64 {
    worst((0..8).map(|_| {
        let u = Vec2::new(random.single(), random.single());
        let Some(sample) = emitter.sample(LightSampling::SolidAngle, from, u, Stratum::ONLY) else { return f64::NAN };
        let again = emitter.pdf(LightSampling::SolidAngle, from, sample.point);
        let (sampled, again) = (f64::from(sample.pdf), f64::from(again));
        worst([(1.0 / (sampled * exact) - 1.0).abs(), (sampled / again - 1.0).abs()])
    }))
}

/// The density sampled and the one evaluated may differ by this, relatively; solid angles are held to it too.
const BOUND: f64 = 1e-5;

/// A flat emitter, and its solid angle from a point: exact, and by the textbook.
type Seen = (Emitter, f64, f32);

/// Sweeps a flat shape from far to near. `make(width, height, turn, from)` is the shape of half-width 1
/// times `width`, at `height` above `from`.
fn flat(
    what: &str,
    names: [&str; 2],
    effort: Effort,
    make: impl Fn(f64, f64, &dyn Fn(DVec3) -> DVec3, Vec3) -> Seen,
) -> Outcome {
    let mut table = Table::new(["shape", "solid_angle", "textbook_relative_error", "ours_relative_error"]);
    let mut curves = [const { Vec::new() }; 4];
    let mut random = Random::new(30);
    for (k, (shape, width)) in [("fat", 1.0), ("sliver", 0.01)].into_iter().enumerate() {
        for height in ratios(1e-3, 1e4, 29) {
            let (mut ours, mut theirs, mut solid_angle) = (0.0, 0.0, 0.0);
            for _ in 0..effort.of(24, 6) {
                // Turned at random; from a point that is not 0.
                let z = direction(&mut random);
                let x = z.cross(direction(&mut random)).normalize();
                let y = z.cross(x);
                let from = Vec3::new(random.single(), random.single(), random.single());
                // What is far away is scaled to a distance of 1: small, not far.
                let scale = 1.0 / height.max(1.0);
                let place = move |p: DVec3| from.as_dvec3() + (x * p.x + y * p.y + z * p.z) * scale;
                let (emitter, exact, textbook) = make(width, height, &place, from);
                solid_angle = exact;
                theirs = worst([theirs, (f64::from(textbook) / exact - 1.0).abs()]);
                ours = worst([ours, our_error(&emitter, from, exact, &mut random)]);
            }
            if solid_angle < 1e-8 {
                continue;
            }
            table.push([shape.into(), solid_angle.into(), theirs.into(), ours.into()]);
            curves[k].push((solid_angle, ours));
            curves[2 + k].push((solid_angle, theirs));
        }
    }
    let [our_fat, our_sliver, their_fat, their_sliver] = curves;
    Outcome {
        textbook: worst(their_fat.iter().chain(&their_sliver).map(|p| p.1)),
        ours: worst(our_fat.iter().chain(&our_sliver).map(|p| p.1)),
        bound: BOUND,
        figure: "relative error of densities",
        chart: Chart {
            title: format!("Solid angle of {what}, from tiny to nearly a hemisphere"),
            x: Axis::log("solid angle", "sr"),
            y: Axis::log("worst relative error", "").between(1e-9, 1e4),
            series: vec![
                Series::new(format!("ours, {}", names[0]), Style::Line, our_fat),
                Series::new(format!("textbook, {}", names[0]), Style::Line, their_fat),
                Series::new(format!("ours, {}", names[1]), Style::Line, our_sliver),
                Series::new(format!("textbook, {}", names[1]), Style::Line, their_sliver),
            ],
            guides: vec![Guide::Level { y: BOUND, label: "bound".into() }],
            notes: vec!["Ours: worst of 1 / (pdf x solid angle) and of pdf sampled / pdf evaluated.".into()],
        },
        table,
    }
}

fn triangle(effort: Effort) -> Outcome {
    flat("a triangle", ["equilateral", "100 times as long as wide"], effort, |width, height, place, from| {
        let corner = |turn: f64| {
            let (s, c) = (turn * std::f64::consts::TAU).sin_cos();
            place(DVec3::new(c, width * s, height)).as_vec3()
        };
        let p = [corner(0.0), corner(1.0 / 3.0), corner(2.0 / 3.0)];
        (Emitter::Triangle { p }, exact_triangle(p.map(|p| p.as_dvec3()), from), textbook::girard_solid_angle(&p, from))
    })
}

fn rectangle(effort: Effort) -> Outcome {
    flat("a rectangle", ["square", "100 times as long as wide"], effort, |width, height, place, from| {
        let at = |x: f64, y: f64| place(DVec3::new(x, width * y, height));
        let corner = at(-1.0, -1.0).as_vec3();
        // Rounded once each, so that they stay square to each other.
        let [u, v] = [at(1.0, -1.0), at(-1.0, 1.0)].map(|p| (p - at(-1.0, -1.0)).as_vec3());
        let p = {
            let [corner, u, v] = [corner, u, v].map(|p| p.as_dvec3());
            [corner, corner + u, corner + u + v, corner + v]
        };
        let exact = exact_triangle([p[0], p[1], p[2]], from) + exact_triangle([p[0], p[2], p[3]], from);
        let textbook = textbook::urena_solid_angle(corner, u, v, from);
        (Emitter::Rectangle { corner, edge_u: u, edge_v: v }, exact, textbook)
    })
}

fn sphere(effort: Effort) -> Outcome {
    let mut table = Table::new(["radius_over_distance", "textbook_relative_error", "ours_relative_error"]);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let mut random = Random::new(31);
    for sine in ratios(1e-6, 1.0, 37).into_iter().map(|s| s.min(0.9999)) {
        let (mut mine, mut textbook) = (0.0, 0.0);
        for _ in 0..effort.of(24, 6) {
            let (from, center) = (Vec3::ZERO, (direction(&mut random) * 3.0).as_vec3());
            let radius = (3.0 * sine) as f32;
            let distance2 = center.as_dvec3().length_squared();
            let sin2 = f64::from(radius).powi(2) / distance2;
            let exact = std::f64::consts::TAU * sin2 / (1.0 + (1.0 - sin2).sqrt());
            let cone = textbook::cone_solid_angle(radius, distance2.sqrt() as f32);
            textbook = worst([textbook, (f64::from(cone) / exact - 1.0).abs()]);
            mine = worst([mine, our_error(&Emitter::Sphere { center, radius }, from, exact, &mut random)]);
        }
        table.push([sine, textbook, mine].map(Into::into));
        ours.push((sine, mine));
        theirs.push((sine, textbook));
    }
    Outcome {
        textbook: worst(theirs.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound: BOUND,
        figure: "relative error of densities (1: the solid angle is 0)",
        chart: Chart {
            title: "Solid angle of a sphere, from far away to touching it".into(),
            x: Axis::log("radius / distance", ""),
            y: Axis::log("worst relative error", "").between(1e-9, 10.0),
            series: vec![
                Series::new("ours", Style::Line, ours),
                Series::new("textbook: 2 pi (1 - cos)", Style::Line, theirs),
            ],
            guides: vec![Guide::Level { y: BOUND, label: "bound".into() }],
            notes: vec!["Ours: worst of 1 / (pdf x solid angle) and of pdf sampled / pdf evaluated.".into()],
        },
        table,
    }
}

/// Small lights strewn about, and places that ask for light, in units of `scale`.
fn strewn(scale: f64) -> (Vec<(Emitter, f32)>, Vec<Vec3>) {
    let mut random = Random::new(32);
    let mut at = |reach: f64| {
        let mut one = || reach * (2.0 * random.uniform() - 1.0);
        DVec3::new(one(), one(), one())
    };
    let lights = (0..24)
        .map(|i| {
            let (p, u, v) = (at(5.0), at(0.3), at(0.3));
            let p = [p, p + u, p + v].map(|p| (p * scale).as_vec3());
            (Emitter::Triangle { p }, 1.0 + (i % 5) as f32)
        })
        .collect();
    (lights, (0..12).map(|_| (at(4.0) * scale).as_vec3()).collect())
}

/// Probability with which each light is asked from each place, by the light tree: the density of a point
/// on it, over the density that the light alone would have there.
fn our_choice(scale: f64) -> Vec<f64> {
    let (lights, places) = strewn(scale);
    let area = |(emitter, radiance): &(Emitter, f32)| AreaLight {
        emitters: vec![*emitter],
        radiance: Rgb::splat(*radiance),
        two_sided: true,
    };
    let sources = LightSources {
        areas: lights.iter().map(area).collect(),
        scene_radius: (10.0 * scale) as f32,
        ..LightSources::default()
    };
    let tree = Lights::build(sources, &Method { light_pick: Some(LightPick::Tree), ..Method::default() });
    let mut out = Vec::new();
    for &p in &places {
        for (i, (emitter, _)) in lights.iter().enumerate() {
            let Emitter::Triangle { p: corners } = emitter else { continue };
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let number = tree.first_emitter(i).unwrap_or(u32::MAX);
            let with_choice = tree.pdf(&Reference { p, n: Vec3::ZERO }, number, middle);
            out.push(f64::from(with_choice) / f64::from(emitter.pdf(LightSampling::SolidAngle, p, middle)));
        }
    }
    out
}

/// The same in proportion to the textbook's importance of each light.
fn textbook_choice(scale: f64) -> Vec<f64> {
    let (lights, places) = strewn(scale);
    let mut out = Vec::new();
    for &p in &places {
        let importance = |(emitter, radiance): &(Emitter, f32)| {
            let Emitter::Triangle { p: [a, b, c] } = *emitter else { return 0.0 };
            let diagonal = (a.max(b).max(c) - a.min(b).min(c)).length();
            let distance2 = ((a + b + c) / 3.0 - p).length_squared();
            f64::from(textbook::mixed_importance(radiance * emitter.area() as f32, distance2, diagonal))
        };
        let all: Vec<f64> = lights.iter().map(importance).collect();
        let sum: f64 = all.iter().sum();
        out.extend(all.iter().map(|i| i / sum));
    }
    out
}

fn choice(_: Effort) -> Outcome {
    let mut table = Table::new(["scale", "textbook_greatest_change", "ours_greatest_change"]);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let change = |now: &[f64], then: &[f64]| worst(now.iter().zip(then).map(|(a, b)| (a - b).abs()));
    let (our_first, their_first) = (our_choice(1.0), textbook_choice(1.0));
    // An even number, so that the scale compared with is not among them.
    for scale in ratios(1e-4, 1e4, 24) {
        let mine = change(&our_choice(scale), &our_first);
        let textbook = change(&textbook_choice(scale), &their_first);
        table.push([scale, textbook, mine].map(Into::into));
        ours.push((scale, mine));
        theirs.push((scale, textbook));
    }
    let bound = 1e-4;
    Outcome {
        textbook: worst(theirs.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound,
        figure: "change of a light's probability with the unit of length",
        chart: Chart {
            title: "Probability of 24 lights from 12 places, as the whole scene is scaled".into(),
            x: Axis::log("scale of the scene", ""),
            y: Axis::log("greatest change of a probability", "").between(1e-9, 2.0),
            series: vec![
                Series::new("ours: the light tree", Style::Line, ours),
                Series::new("textbook: clamp by a length", Style::Line, theirs),
            ],
            guides: vec![Guide::Level { y: bound, label: "bound".into() }],
            notes: vec![],
        },
        table,
    }
}
