//! Boxes that cull what a ray hits.

use super::shapes::{alone, soup};
use super::{Effort, Outcome, Row, worst};
use plot::{Axis, Chart, Series, Style, Table};
use tracer::geometry::{Counters, Ray, TriangleTest, textbook};
use tracer::math::Vec3;

/// 0 times infinity.
pub(super) const SLABS: Row = Row {
    id: "slab-nan",
    title: "Ray and box: the slab test",
    fails: "A ray that runs along a face of a box multiplies a distance of 0 by an infinite reciprocal: NaN, and \
            the comparison that follows culls the box or not by the order of its operands.",
    instead: "Operands are ordered so that NaN never culls, and the far end is padded by its error bound, alike in \
              every instruction set.",
    measure: slabs,
};

/// What stands for 0 in a direction.
const NOTHING: [f32; 4] = [0.0, -0.0, 1e-45, -1e-45];

fn slabs(_: Effort) -> Outcome {
    let faces = cube();
    let accel = alone(soup(faces.iter().copied()), TriangleTest::Watertight);
    let bounds = accel.bounds();
    let mut table = Table::new(["ray_along", "starts_on", "hits", "textbook_culled", "ours_culled"]);
    let (mut names, mut ours, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        // By the number of slab planes that the ray runs in.
        for (planes, kind) in ["inside", "face", "edge"].into_iter().enumerate() {
            let mut counts = [0u32; 3];
            for ray in rays(axis, planes) {
                let mut counters = Counters::default();
                if accel.closest_by_brute_force(&ray, &mut counters).is_none() {
                    continue;
                }
                counts[0] += 1;
                counts[1] += u32::from(textbook::slab_test(&bounds, &ray).is_none());
                let found = accel.closest(&ray, &mut counters).is_some() && accel.occluded(&ray, &mut counters);
                counts[2] += u32::from(!found);
            }
            let at = names.len() as f64;
            let share = |culled: u32| 100.0 * f64::from(culled) / f64::from(counts[0].max(1));
            names.push(format!("{name}, {kind}"));
            theirs.push((at, share(counts[1])));
            ours.push((at, share(counts[2])));
            table.push([name.into(), kind.into(), counts[0].into(), counts[1].into(), counts[2].into()]);
        }
    }
    Outcome {
        textbook: worst(theirs.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound: 0.0,
        figure: "percent of true hits culled",
        chart: Chart {
            title: "True hits that a box culls, for rays along an axis".into(),
            x: Axis::names("axis of the ray, and whether it runs inside the cube, in a face or in an edge", names),
            y: Axis::linear("hits culled", "%").between(0.0, 108.0),
            series: vec![
                Series::new("ours: the traversal", Style::Bars, ours),
                Series::new("textbook: slabs by reciprocals", Style::Bars, theirs),
            ],
            notes: vec!["Other components of the direction: 0, -0 and the least denormals of both signs.".into()],
            ..Chart::default()
        },
        table,
    }
}

/// Rays both ways along an axis, towards and from inside the unit cube, with `planes` of the other two
/// coordinates on a face's plane.
fn rays(axis: usize, planes: usize) -> Vec<Ray> {
    let (on, off) = ([0.0f32, 1.0], [0.25f32, 0.6]);
    let values = |on_plane: bool| if on_plane { on } else { off };
    let patterns: &[[bool; 2]] = match planes {
        0 => &[[false, false]],
        1 => &[[true, false], [false, true]],
        _ => &[[true, true]],
    };
    let mut out = Vec::new();
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    for pattern in patterns {
        for a in values(pattern[0]) {
            for b in values(pattern[1]) {
                for (start, sense) in [(-1.0f32, 1.0f32), (2.0, -1.0), (0.5, 1.0), (0.5, -1.0), (0.0, 1.0), (1.0, -1.0)]
                {
                    for du in NOTHING {
                        for dv in NOTHING {
                            let (mut origin, mut direction) = (Vec3::ZERO, Vec3::ZERO);
                            (origin[axis], origin[u], origin[v]) = (start, a, b);
                            (direction[axis], direction[u], direction[v]) = (sense, du, dv);
                            out.push(Ray::new(origin, direction));
                        }
                    }
                }
            }
        }
    }
    out
}

/// The twelve triangles of the unit cube.
fn cube() -> Vec<[Vec3; 3]> {
    let mut out = Vec::new();
    for axis in 0..3 {
        for side in [0.0f32, 1.0] {
            let corner = |a: f32, b: f32| {
                let mut p = Vec3::ZERO;
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, a, b);
                p
            };
            let [a, b, c, d] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
            out.extend([[a, b, c], [a, c, d]]);
        }
    }
    out
}
