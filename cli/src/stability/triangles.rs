//! Rays that slip through closed meshes.

use super::random::Random;
use super::shapes::{alone, bumpy_sphere, direction};
use super::{Effort, Outcome, Row, worst};
use plot::{Axis, Chart, Series, Style, Table};
use tracer::geometry::{Accel, Counters, Ray, TriangleMesh, TriangleTest};
use tracer::math::{DVec3, Vec3};

/// Moeller and Trumbore against the watertight test.
pub(super) const LEAKS: Row = Row {
    id: "triangle-leaks",
    title: "Ray and triangle: Moeller-Trumbore",
    fails: "Each triangle rounds its own barycentric weights, so two that share an edge can both refuse a ray that \
            passes through it, and the ray leaves a closed mesh.",
    instead: "The watertight test of Woop, Benthin and Wald projects each corner once, alike for all triangles that \
              share it, and decides the edges' signs exactly.",
    measure: leaks,
};

/// Where the second set of meshes stands.
const FAR: DVec3 = DVec3::new(148_376.0, 1_234.0, -223_423.0);

/// How a ray is aimed, from inside, at a mesh about a centre.
type Aim = fn(&TriangleMesh, DVec3, Vec3, &mut Random) -> Vec3;

const AIMS: [(&str, Aim); 3] = [
    ("anywhere", |_, _, _, random| direction(random).as_vec3()),
    ("corners", |mesh, _, origin, random| mesh.positions[below(mesh.positions.len(), random)] - origin),
    ("edge middles", |mesh, _, origin, random| {
        let [a, b, _] = mesh.triangles[below(mesh.triangles.len(), random)].map(|k| mesh.positions[k as usize]);
        (a + b) * 0.5 - origin
    }),
];

fn below(count: usize, random: &mut Random) -> usize {
    (random.uniform() * count as f64) as usize
}

fn leaks(effort: Effort) -> Outcome {
    let rays = effort.of(100_000, 20_000);
    let mut table = Table::new(["centre", "aimed_at", "rays", "textbook_leaks", "ours_leaks"]);
    let (mut names, mut ours, mut textbook) = (Vec::new(), Vec::new(), Vec::new());
    for (place, center) in [("", DVec3::ZERO), ("far: ", FAR)] {
        let mesh = bumpy_sphere(60, 120, center, &mut Random::new(4));
        let accels = [TriangleTest::Watertight, TriangleTest::MoellerTrumbore].map(|test| alone(mesh.clone(), test));
        for (aim, (name, target)) in AIMS.into_iter().enumerate() {
            let mut random = Random::new(5 + aim as u64);
            let mut lost = [0u32; 2];
            for _ in 0..rays {
                let origin = (center + direction(&mut random) * 0.7 * random.uniform()).as_vec3();
                let ray = Ray::new(origin, target(&mesh, center, origin, &mut random));
                for (lost, accel) in lost.iter_mut().zip(&accels) {
                    *lost += u32::from(escapes(accel, &ray));
                }
            }
            let at = names.len() as f64;
            let per_100k = lost.map(|lost| f64::from(lost) * 1e5 / f64::from(rays));
            names.push(format!("{place}{name}"));
            ours.push((at, per_100k[0]));
            textbook.push((at, per_100k[1]));
            let centre = format!("{} {} {}", center.x, center.y, center.z);
            table.push([centre.into(), name.into(), rays.into(), lost[1].into(), lost[0].into()]);
        }
    }
    Outcome {
        textbook: worst(textbook.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound: 0.0,
        figure: "rays of 100,000 that leave a closed mesh",
        chart: Chart {
            title: "Rays from inside a closed mesh of 14,160 triangles that meet nothing".into(),
            x: Axis::names("where the rays aim; far: centre at (148376, 1234, -223423)", names),
            y: Axis::log("rays that leak", "of 100,000").between(0.5, 3e4),
            series: vec![
                Series::new("ours: watertight", Style::Bars, ours),
                Series::new("textbook: Moeller-Trumbore", Style::Bars, textbook),
            ],
            notes: vec![
                "Far from the origin coordinates keep so few digits that the products of their differences are nearly \
                 exact: there the textbook form happens to hold."
                    .into(),
            ],
            ..Chart::default()
        },
        table,
    }
}

/// Whether a ray from inside is lost, by either traversal.
fn escapes(accel: &Accel, ray: &Ray) -> bool {
    let mut counters = Counters::default();
    accel.closest(ray, &mut counters).is_none() || !accel.occluded(ray, &mut counters)
}
