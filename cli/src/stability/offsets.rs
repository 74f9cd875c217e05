//! Rays that leave a surface: too early they meet it again, too late they miss what stands near.

use super::random::Random;
use super::shapes::{direction, soup};
use super::{Effort, Outcome, Row, ratios, worst};
use plot::{Axis, Chart, Guide, Series, Style, Table};
use tracer::geometry::{Accel, Counters, Hit, Ray, Shape, SurfacePoint, TriangleTest, World, spawn, textbook};
use tracer::math::Vec3;

/// Scale and distance from the origin.
pub(super) const SCALE: Row = Row {
    id: "ray-offset",
    title: "Leaving a surface: a constant offset",
    fails: "A constant step is too long for a small scene, where the ray jumps through walls, and lost to rounding in \
            a large one or far from the origin, where a surface shadows itself.",
    instead: "The step follows from the error bound of the point that was hit, along the normal, and is rounded away \
              from the surface.",
    measure: scale,
};

/// Surfaces close together.
pub(super) const GAP: Row = Row {
    id: "ray-offset-gap",
    title: "Leaving a surface that has a near neighbour",
    fails: "A ray that starts a constant step away has passed every surface that is nearer than that: light leaks \
            into the gap.",
    instead: "The step is a few units in the last place, so that surfaces are told apart down to the precision of \
              their coordinates.",
    measure: gap,
};

/// The constant of the textbook form.
const EPSILON: f32 = 1e-4;

fn scale(effort: Effort) -> Outcome {
    let rays = effort.of(4000, 500);
    let mut table = Table::new(["scene", "factor", "rays", "textbook_wrong_share", "ours_wrong_share"]);
    let mut curves = [const { Vec::new() }; 4];
    for (k, moved) in [false, true].into_iter().enumerate() {
        // Closed bodies of size 1 scaled, or of size 100 moved away.
        let factors = if moved { ratios(1e2, 1e6, 9) } else { ratios(1e-4, 1e6, 21) };
        for factor in factors {
            let (size, center) = if moved { (100.0, factor as f32) } else { (factor as f32, 0.0) };
            let bodies = [sphere(size, center), tetrahedron(size, center)];
            let (mut ours, mut theirs) = (0u32, 0u32);
            let mut random = Random::new(10);
            for i in 0..rays {
                let body = &bodies[i % 2];
                let (point, out) = leave(body, size, center, &mut random);
                ours += u32::from(goes_wrong(body, &spawn(point.p, point.p_error, point.ng, out), out, &point));
                theirs += u32::from(goes_wrong(body, &textbook::spawn(point.p, out, EPSILON), out, &point));
            }
            let [theirs, ours] = [theirs, ours].map(|wrong| f64::from(wrong) / rays as f64);
            curves[k].push((factor, ours));
            curves[2 + k].push((factor, theirs));
            let scene = if moved { "moved" } else { "scaled" };
            table.push([scene.into(), factor.into(), rays.into(), theirs.into(), ours.into()]);
        }
    }
    let [ours_scaled, ours_moved, theirs_scaled, theirs_moved] = curves;
    Outcome {
        textbook: worst(theirs_scaled.iter().chain(&theirs_moved).map(|p| p.1)),
        ours: worst(ours_scaled.iter().chain(&ours_moved).map(|p| p.1)),
        bound: 0.0,
        figure: "share of rays that meet their own surface or pass through a wall",
        chart: Chart {
            title: "Rays that leave a sphere or a tetrahedron the wrong way".into(),
            x: Axis::log("size of the body, or distance of a body of size 100 from the origin", ""),
            y: Axis::linear("share of rays", ""),
            series: vec![
                Series::new("ours, scaled", Style::Line, ours_scaled),
                Series::new("textbook: 1e-4, scaled", Style::Line, theirs_scaled),
                Series::new("ours, moved", Style::Line, ours_moved),
                Series::new("textbook: 1e-4, moved", Style::Line, theirs_moved),
            ],
            ..Chart::default()
        },
        table,
    }
}

fn alone(shape: Shape) -> Accel {
    Accel::build(World { shapes: vec![shape], ..World::default() }, TriangleTest::Watertight)
}

fn sphere(size: f32, center: f32) -> Accel {
    alone(Shape::Sphere { center: Vec3::splat(center), radius: size })
}

/// Rounding its corners leaves a tetrahedron convex, however coarse the grid of numbers is out there.
fn tetrahedron(size: f32, center: f32) -> Accel {
    let at = |x: f32, y: f32, z: f32| Vec3::splat(center) + Vec3::new(x, y, z) * size;
    let [a, b, c, d] = [at(1.0, 1.0, 1.0), at(1.0, -1.0, -1.0), at(-1.0, 1.0, -1.0), at(-1.0, -1.0, 1.0)];
    alone(Shape::Mesh(soup([[a, b, c], [a, c, d], [a, d, b], [b, d, c]])))
}

/// A point of the body away from its edges, as a ray from its middle finds it, and a direction to leave in.
fn leave(body: &Accel, size: f32, center: f32, random: &mut Random) -> (SurfacePoint, Vec3) {
    loop {
        let start = Vec3::splat(center) + direction(random).as_vec3() * (0.1 * size * random.single());
        let ray = Ray::new(start, direction(random).as_vec3());
        let Some(hit) = body.closest(&ray, &mut Counters::default()) else { continue };
        let flat = matches!(body.shapes()[0], Shape::Mesh(_));
        if flat && hit.b1.min(hit.b2).min(1.0 - hit.b1 - hit.b2) < 0.05 {
            continue;
        }
        let point = body.surface(&ray, &hit);
        let out = direction(random).as_vec3();
        // Within half a degree of the tangent plane the sign of the cosine is no longer sure of itself.
        if out.dot(point.ng).abs() > 0.01 {
            return (point, out);
        }
    }
}

/// Whether a ray that leaves a convex body outwards meets it, or one that goes in does not.
fn goes_wrong(body: &Accel, ray: &Ray, out: Vec3, point: &SurfacePoint) -> bool {
    let outside = point.p + point.ng;
    let middle = body.bounds().center();
    let outwards = out.dot(if (outside - middle).dot(point.ng) > 0.0 { point.ng } else { -point.ng }) > 0.0;
    body.occluded(ray, &mut Counters::default()) == outwards
}

fn gap(effort: Effort) -> Outcome {
    let rays = effort.of(4000, 500);
    let mut table = Table::new(["surfaces", "gap", "rays", "textbook_missed_share", "ours_missed_share"]);
    let mut curves = [const { Vec::new() }; 4];
    for (k, (name, pair)) in [("walls", walls as fn(f32) -> Pair), ("spheres", spheres)].into_iter().enumerate() {
        for gap in ratios(1e-7, 1e-2, 21) {
            let pair = pair(gap as f32);
            let mut random = Random::new(11);
            let (mut ours, mut theirs, mut count) = (0u32, 0u32, 0u32);
            while count < rays {
                let Some((point, up)) = pair.leave(&mut random) else { continue };
                count += 1;
                ours += u32::from(pair.misses(&spawn(point.p, point.p_error, point.ng, up)));
                theirs += u32::from(pair.misses(&textbook::spawn(point.p, up, EPSILON)));
            }
            let [theirs, ours] = [theirs, ours].map(|missed| f64::from(missed) / f64::from(rays));
            curves[k].push((gap, ours));
            curves[2 + k].push((gap, theirs));
            table.push([name.into(), gap.into(), rays.into(), theirs.into(), ours.into()]);
        }
    }
    let missed = |curves: [&Vec<(f64, f64)>; 2]| {
        worst(curves.into_iter().flatten().map(|(gap, share)| if *share > 0.0 { *gap } else { 0.0 }))
    };
    let (ours, textbook) = (missed([&curves[0], &curves[1]]), missed([&curves[2], &curves[3]]));
    let [our_walls, our_spheres, their_walls, their_spheres] = curves;
    // The point that a ray leaves and both surfaces are rounded to f32: eight units in the last place of what the
    // offset is computed with, coordinates below 1.
    let bound = 5e-7;
    Outcome {
        textbook,
        ours,
        bound,
        figure: "widest gap that some ray misses, of the surfaces' size",
        chart: Chart {
            title: "Rays from one surface that miss another close by".into(),
            x: Axis::log("gap between the surfaces", "of their half-width or radius"),
            y: Axis::linear("share of rays", "").between(-0.02, 1.02),
            series: vec![
                Series::new("ours, walls", Style::Line, our_walls),
                Series::new("textbook: 1e-4, walls", Style::Line, their_walls),
                Series::new("ours, spheres", Style::Line, our_spheres),
                Series::new("textbook: 1e-4, spheres", Style::Line, their_spheres),
            ],
            guides: vec![Guide::At { x: bound, label: "bound: no wider gap is missed".into() }],
            ..Chart::default()
        },
        table,
    }
}

/// Two surfaces across a gap: a ray from the lower one up must meet the upper one.
struct Pair {
    accel: Accel,
    /// Height of the lower surface in the middle, and how far from the middle rays may start.
    floor: f32,
    reach: f32,
    gap: f32,
    /// Primitives of the lower surface; those of the upper one follow, or are another shape.
    lower: u32,
}

/// Two squares of half-width 1.
fn walls(gap: f32) -> Pair {
    let floor = 0.3f32;
    let quad = |z: f32| {
        let at = |x: f32, y: f32| Vec3::new(x, y, z);
        let [a, b, c, d] = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
        [[a, b, c], [a, c, d]]
    };
    let accel = alone(Shape::Mesh(soup(quad(floor).into_iter().chain(quad(floor + gap)))));
    Pair { accel, floor, reach: 0.5, gap, lower: 2 }
}

/// Two spheres of radius 1, one above the other.
fn spheres(gap: f32) -> Pair {
    let sphere = |z: f32| Shape::Sphere { center: Vec3::new(0.0, 0.0, z), radius: 1.0 };
    let world = World { shapes: vec![sphere(-1.0), sphere(1.0 + gap)], ..World::default() };
    // The spheres part by the square of the distance from the middle.
    Pair { accel: Accel::build(world, TriangleTest::Watertight), floor: 0.0, reach: 0.3 * gap.sqrt(), gap, lower: 1 }
}

impl Pair {
    fn is_lower(&self, hit: &Hit) -> bool {
        hit.shape == 0 && hit.primitive < self.lower
    }

    /// A point of the lower surface as a ray from inside the gap finds it, and a direction up, at most 60
    /// degrees from the vertical.
    fn leave(&self, random: &mut Random) -> Option<(SurfacePoint, Vec3)> {
        let mut across = || self.reach * (2.0 * random.single() - 1.0);
        let start = Vec3::new(across(), across(), self.floor + 0.5 * self.gap);
        let ray = Ray::new(start, -Vec3::Z);
        let hit = self.accel.closest(&ray, &mut Counters::default()).filter(|hit| self.is_lower(hit))?;
        let up = direction(random).as_vec3();
        (up.z > 0.5).then(|| (self.accel.surface(&ray, &hit), up))
    }

    /// Whether a ray up meets nothing, the lower surface, or the far side of the upper one.
    fn misses(&self, ray: &Ray) -> bool {
        self.accel
            .closest(ray, &mut Counters::default())
            .is_none_or(|hit| self.is_lower(&hit) || hit.t > 10.0 * self.gap)
    }
}
