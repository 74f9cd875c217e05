//! Meshes that break the build of a tree.

use super::random::Random;
use super::shapes::{alone, direction, soup};
use super::{Effort, Outcome, Row, worst};
use plot::{Axis, Chart, Guide, Series, Style, Table};
use tracer::geometry::{Accel, Counters, Ray, TriangleTest};
use tracer::math::Vec3;

/// Split in the middle, without a way out.
pub(super) const BUILD: Row = Row {
    id: "bvh-build",
    title: "Building a tree over hostile meshes",
    fails: "Splitting in the middle of the box leaves one side empty where centroids coincide or are not numbers, and \
            peels off one triangle at a time where sizes grow by ratios: the recursion, or the fixed stack of the \
            traversal, overflows.",
    instead: "Binned surface area splits fall back to halves by number, depth is bounded, and triangles that nothing \
              can hit are dropped and counted.",
    measure: build,
};

/// Levels of a fixed stack as renderers often have it.
const STACK: f64 = 64.0;
/// Depth at which the textbook's recursion counts as endless.
const ENDLESS: u32 = 2000;
/// Triangles that the textbook puts in a leaf.
const LEAF: usize = 4;

fn build(effort: Effort) -> Outcome {
    let identical = effort.of(70_000, 10_000);
    let mut random = Random::new(8);
    let unit = [Vec3::ZERO, Vec3::X, Vec3::Y];
    // Each triangle is `ratio` times as large as the one before, and as much farther out.
    let progression = |ratio: f32, count: i32| -> Vec<[Vec3; 3]> {
        (0..count).map(|k| ratio.powi(k - count / 2)).map(|s| unit.map(|p| (p * 0.25 + Vec3::X) * s)).collect()
    };
    let mut cloud = |scale: f32, bad: bool| -> Vec<[Vec3; 3]> {
        let mut at = || direction(&mut random).as_vec3();
        (0..2000)
            .map(|k| {
                let p = at();
                let c = if bad && k % 5 == 0 { Vec3::splat(f32::NAN) } else { p + at() * 0.3 };
                [p * scale, (p + at() * 0.3) * scale, c * scale]
            })
            .collect()
    };
    let cases = [
        (format!("{identical} alike"), vec![unit; identical]),
        ("ratio 2".to_string(), progression(2.0, 240)),
        ("ratio 1.5".to_string(), progression(1.5, 400)),
        ("ordinary".to_string(), cloud(1.0, false)),
        ("with NaN".to_string(), cloud(1.0, true)),
        ("x 1e18".to_string(), cloud(1e18, false)),
        ("x 1e30".to_string(), cloud(1e30, false)),
    ];
    let mut table =
        Table::new(["mesh", "triangles", "textbook_depth", "ours_depth", "ours_dropped", "ours_wrong_answers"]);
    let (mut names, mut ours, mut textbook) = (Vec::new(), Vec::new(), Vec::new());
    for (place, (name, triangles)) in cases.into_iter().enumerate() {
        let theirs = textbook_depth(&triangles);
        let accel = alone(soup(triangles.iter().copied()), TriangleTest::Watertight);
        let stats = accel.stats();
        let wrong = wrong_answers(&accel, &triangles, effort.of(200, 60));
        table.push([
            name.clone().into(),
            triangles.len().into(),
            theirs.into(),
            stats.depth.into(),
            stats.dropped.into(),
            wrong.into(),
        ]);
        names.push(name);
        // A tree that gives wrong answers has no depth that would do.
        ours.push((place as f64, if wrong == 0 { stats.depth as f64 } else { f64::INFINITY }));
        textbook.push((place as f64, theirs));
    }
    Outcome {
        textbook: worst(textbook.iter().map(|p| p.1)),
        ours: worst(ours.iter().map(|p| p.1)),
        bound: STACK,
        figure: "levels of the tree (infinite: it never ends, or answers wrongly)",
        chart: Chart {
            title: "Depth of the tree over hostile meshes".into(),
            x: Axis::names("mesh; ratio: of the size of each triangle to the last", names),
            y: Axis::log("levels of the deepest branch", "").between(0.8, 5000.0),
            series: vec![
                Series::new("ours: eight-wide", Style::Bars, ours),
                Series::new("textbook: split in the middle", Style::Bars, textbook),
            ],
            guides: vec![Guide::Level { y: STACK, label: "a stack of 64 levels".into() }],
            notes: vec!["inf: the recursion does not end.".into()],
        },
        table,
    }
}

/// Depth of a tree split in the middle of the centroids' box, along its longest axis; infinite where it never ends.
fn textbook_depth(triangles: &[[Vec3; 3]]) -> f64 {
    let mut deepest = 0;
    let mut open = vec![(triangles.iter().map(|[a, b, c]| (*a + *b + *c) / 3.0).collect::<Vec<Vec3>>(), 1)];
    while let Some((centroids, depth)) = open.pop() {
        deepest = deepest.max(depth);
        if depth > ENDLESS {
            return f64::INFINITY;
        }
        if centroids.len() <= LEAF {
            continue;
        }
        let (lo, hi) = centroids.iter().fold((centroids[0], centroids[0]), |(lo, hi), &c| (lo.min(c), hi.max(c)));
        let extent = hi - lo;
        let axis = if extent.x >= extent.y && extent.x >= extent.z {
            0
        } else if extent.y >= extent.z {
            1
        } else {
            2
        };
        let middle = 0.5 * lo[axis] + 0.5 * hi[axis];
        let (left, right): (Vec<Vec3>, Vec<Vec3>) = centroids.into_iter().partition(|c| c[axis] < middle);
        if left.is_empty() || right.is_empty() {
            // The same set again, and so on for ever.
            return f64::INFINITY;
        }
        open.push((left, depth + 1));
        open.push((right, depth + 1));
    }
    f64::from(deepest)
}

/// Rays at triangles of the mesh that the tree answers otherwise than a test of every triangle does.
fn wrong_answers(accel: &Accel, triangles: &[[Vec3; 3]], rays: u32) -> usize {
    let mut random = Random::new(9);
    (0..rays)
        .filter(|_| {
            let [a, b, c] = triangles[(random.uniform() * triangles.len() as f64) as usize];
            let target = (a + b + c) / 3.0;
            let size = (b - a).abs().max_element().max((c - a).abs().max_element());
            let ray = {
                let origin = target + direction(&mut random).as_vec3() * size;
                Ray::new(origin, target - origin)
            };
            let mut counters = Counters::default();
            accel.closest(&ray, &mut counters) != accel.closest_by_brute_force(&ray, &mut counters)
        })
        .count()
}
