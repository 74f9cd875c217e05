//! Points on emitters: do they fall where the density says, from near, from far, and edge-on?

use std::f64::consts::PI;

use super::*;
use crate::math::{DVec3, uniform_sphere};

/// Cells an edge.
const CELLS: usize = 10;

/// Solid angle of a triangle in f64: tangents of half angles, from the edges.
fn exact_solid_angle(p: [DVec3; 3], from: DVec3) -> f64 {
    let [a, b, c] = p.map(|p| p - from);
    let volume = a.dot((b - a).cross(c - a)).abs();
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    2.0 * volume.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
}

/// The same by quadrature of cos / distance^2 over the area: an independent check of the check.
fn integrated_solid_angle(p: [DVec3; 3], from: DVec3, n: usize) -> f64 {
    let (u, v) = ((p[1] - p[0]) / n as f64, (p[2] - p[0]) / n as f64);
    let normal = u.cross(v) / 2.0;
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..2 * (n - i) - 1 {
            // Centroids of the upright and the turned triangles.
            let (k, at) = (j / 2, if j % 2 == 0 { 1.0 / 3.0 } else { 2.0 / 3.0 });
            let to = p[0] + u * (i as f64 + at) + v * (k as f64 + at) - from;
            sum += normal.dot(to).abs() / to.length().powi(3);
        }
    }
    sum
}

/// The corners of the cell of a triangle or rectangle that the coordinates `c` fall into, two a square.
fn cell(c: Vec2, is_triangle: bool) -> usize {
    let (x, y) = (f64::from(c.x) * CELLS as f64, f64::from(c.y) * CELLS as f64);
    let (i, j) = ((x as usize).min(CELLS - 1), (y as usize).min(CELLS - 1));
    // Along the long side of a triangle there are no upper ones, however f32 rounds 1 - b1.
    let upper = x - i as f64 + y - j as f64 > 1.0 && !(is_triangle && i + j + 1 >= CELLS);
    2 * (i * CELLS + j) + usize::from(upper)
}

/// Solid angle of every cell of the triangle or parallelogram (origin, u, v).
fn cell_solid_angles(origin: DVec3, u: DVec3, v: DVec3, from: DVec3, is_triangle: bool) -> Vec<f64> {
    let at = |i: usize, j: usize| origin + u * (i as f64 / CELLS as f64) + v * (j as f64 / CELLS as f64);
    let mut cells = Vec::new();
    for i in 0..CELLS {
        for j in 0..CELLS {
            let lower = exact_solid_angle([at(i, j), at(i + 1, j), at(i, j + 1)], from);
            let upper = exact_solid_angle([at(i + 1, j + 1), at(i + 1, j), at(i, j + 1)], from);
            cells.push(if is_triangle && i + j + 1 > CELLS { 0.0 } else { lower });
            cells.push(if is_triangle && i + j + 2 > CELLS { 0.0 } else { upper });
        }
    }
    cells
}

fn edges(emitter: &Emitter) -> (DVec3, DVec3, DVec3) {
    match *emitter {
        Emitter::Triangle { p: [a, b, c] } => (a.as_dvec3(), b.as_dvec3() - a.as_dvec3(), c.as_dvec3() - a.as_dvec3()),
        Emitter::Rectangle { corner, edge_u, edge_v } => (corner.as_dvec3(), edge_u.as_dvec3(), edge_v.as_dvec3()),
        _ => unreachable!("flat emitters only"),
    }
}

/// Samples of a flat emitter against the solid angle of its cells, and 1/pdf against that of the whole.
fn check_flat(name: &str, emitter: &Emitter, from: Vec3, samples: u32) {
    let (origin, u, v) = edges(emitter);
    let is_triangle = matches!(emitter, Emitter::Triangle { .. });
    let cells = cell_solid_angles(origin, u, v, from.as_dvec3(), is_triangle);
    let whole: f64 = cells.iter().sum();
    let Some(told) = emitter.solid_angle(from).map(f64::from) else {
        assert!(whole < 2e-11, "{name}: no solid angle where it is {whole}");
        return;
    };
    assert!((told / whole - 1.0).abs() < 1e-6, "{name}: solid angle {told}, in parts {whole}");
    let mut counts = vec![0; cells.len()];
    let mut rng = Rng::new(3);
    for _ in 0..samples {
        let sample = emitter.sample(LightSampling::SolidAngle, from, rng.next_2d(), Stratum::ONLY).unwrap();
        assert!((f64::from(1.0 / sample.pdf) / whole - 1.0).abs() < 1e-6, "{name}");
        // The density of the place that a ray would report, which is not quite this point.
        let evaluated = emitter.pdf(LightSampling::SolidAngle, from, from + sample.wi * sample.distance);
        assert_eq!(sample.pdf, evaluated, "{name}");
        counts[cell(sample.coordinates, is_triangle)] += 1;
    }
    let expected: Vec<f64> = cells.iter().map(|c| c / whole * f64::from(samples)).collect();
    check_counts(name, &counts, &expected);
}

/// A right-handed frame that is aligned with nothing.
const AXES: [Vec3; 3] = [Vec3::new(0.36, 0.48, -0.8), Vec3::new(-0.8, 0.6, 0.0), Vec3::new(0.48, 0.64, 0.6)];

/// Unit shapes in the plane z = 0, and reference points above it: solid angles of 1e-8 to 6.28 and grazing
/// views.
fn views() -> Vec<(&'static str, Vec3)> {
    vec![
        ("1e-10 sr", Vec3::new(2.0, -1.0, 7e4)),
        ("1e-8 sr", Vec3::new(0.3, 0.3, 7e3)),
        ("1e-8 sr, oblique", Vec3::new(4e3, 1e3, 2e3)),
        ("1e-6 sr", Vec3::new(-100.0, 50.0, 700.0)),
        ("1e-4 sr", Vec3::new(0.0, 20.0, 60.0)),
        ("1e-2 sr", Vec3::new(3.0, 3.0, 5.0)),
        ("0.1 sr", Vec3::new(0.3, 0.3, 2.2)),
        ("1 sr", Vec3::new(0.3, 0.2, 0.5)),
        ("3 sr", Vec3::new(0.3, 0.3, 0.15)),
        ("6 sr", Vec3::new(0.3, 0.3, 0.012)),
        ("6.28 sr", Vec3::new(0.3, 0.3, 1e-4)),
        ("above an edge", Vec3::new(0.5, 0.0, 1e-3)),
        ("above a vertex", Vec3::new(1.0, 0.0, 1e-3)),
        ("edge-on", Vec3::new(2.0, 1.0, 1e-3)),
        ("edge-on, far", Vec3::new(300.0, 200.0, 0.1)),
    ]
}

/// A point of the unit shape's own space, in the world: off the axes and off the origin.
fn world(p: Vec3, scale: f32) -> Vec3 {
    let [x, y, z] = AXES;
    (Vec3::new(3.0, -2.0, 1.0) + x * p.x + y * p.y + z * p.z) * scale
}

#[test]
fn two_ways_to_a_solid_angle_agree() {
    let p = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for from in [DVec3::new(0.3, 0.2, 0.5), DVec3::new(30.0, 20.0, 50.0), DVec3::new(-0.4, 1.0, -0.2)] {
        let (exact, integrated) = (exact_solid_angle(p, from), integrated_solid_angle(p, from, 400));
        assert!((exact / integrated - 1.0).abs() < 1e-4, "{exact} {integrated}");
    }
}

#[test]
fn triangles_are_uniform_over_their_solid_angle_from_1e_10_to_2_pi() {
    for (name, from) in views() {
        for scale in [1.0, 1e-3, 1e3] {
            let p = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| world(p, scale));
            check_flat(name, &Emitter::Triangle { p }, world(from, scale), 60_000);
        }
    }
}

#[test]
fn slivers_are_uniform_over_their_solid_angle() {
    for width in [1e-2, 1e-4] {
        for (name, from) in views().into_iter().skip(4) {
            // Thin, and blunt in the middle.
            let thin = [Vec3::ZERO, Vec3::X, Vec3::new(0.5, width, 0.0)].map(|p| world(p, 1.0));
            check_flat(name, &Emitter::Triangle { p: thin }, world(from, 1.0), 30_000);
            let needle = [Vec3::ZERO, Vec3::new(1.0, width, 0.0), Vec3::X].map(|p| world(p, 1.0));
            check_flat(name, &Emitter::Triangle { p: needle }, world(from, 1.0), 30_000);
        }
    }
}

#[test]
fn rectangles_are_uniform_over_their_solid_angle_from_1e_10_to_2_pi() {
    let [x, y, _] = AXES;
    for (name, from) in views() {
        for (width, height) in [(1.0f32, 1.0), (1.0, 0.01), (1e3, 2e3), (1e-3, 1.0)] {
            let (corner, from) = (world(Vec3::ZERO, width.max(height)), world(from, width.max(height)));
            let rectangle = Emitter::Rectangle { corner, edge_u: x * width, edge_v: y * height };
            check_flat(name, &rectangle, from, 60_000);
        }
    }
}

#[test]
fn spheres_are_uniform_over_their_cone_at_any_distance() {
    for ratio in [1e-6f64, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 0.9, 0.999, 0.999_999] {
        // The centre at 0: the points of a sphere 1e6 radii away must not be rounded to a few places.
        let radius = 0.7f32;
        let from = (AXES[2].as_dvec3().normalize() * (f64::from(radius) / ratio)).as_vec3();
        let sphere = Emitter::Sphere { center: Vec3::ZERO, radius };
        let distance = from.as_dvec3().length();
        let axis = from.as_dvec3() / distance;
        let sin2 = (f64::from(radius) / distance).powi(2);
        let height = if sin2 < 1e-5 { sin2 / 2.0 + sin2 * sin2 / 8.0 } else { 1.0 - (1.0 - sin2).sqrt() };
        let (rows, columns, samples) = (16, 12, 200_000);
        let (tangent, bitangent) = axis.any_orthonormal_pair();
        let mut counts = vec![0; rows * columns];
        let mut rng = Rng::new(5);
        for _ in 0..samples {
            let sample = sphere.sample(LightSampling::SolidAngle, from, rng.next_2d(), Stratum::ONLY).unwrap();
            assert!((f64::from(1.0 / sample.pdf) / (2.0 * PI * height) - 1.0).abs() < 1e-6, "{ratio}");
            let hit = from + sample.wi * sample.distance;
            assert_eq!(sample.pdf, sphere.pdf(LightSampling::SolidAngle, from, hit));
            // From near the direction tells the share of the cone; from far the normal does, by
            // tan = r sin a / (d - r cos a).
            let (n, wi) = (sample.ng.as_dvec3(), sample.wi.as_dvec3());
            let rise = if ratio < 0.5 {
                let sin = (n - axis * n.dot(axis)).length();
                let tan = f64::from(radius) * sin / (distance - f64::from(radius) * n.dot(axis));
                let root = (1.0 + tan * tan).sqrt();
                tan * tan / (root * (1.0 + root))
            } else {
                0.5 * (wi + axis).length_squared()
            };
            assert!(n.dot(axis) > f64::from(radius) / distance - 1e-3, "{ratio}: on the far side");
            let share = rise / height;
            let off = if ratio < 0.5 { n } else { wi };
            let turn = off.dot(bitangent).atan2(off.dot(tangent)) / (2.0 * PI) + 0.5;
            let (row, column) = ((share * rows as f64) as usize, (turn * columns as f64) as usize);
            counts[row.min(rows - 1) * columns + column.min(columns - 1)] += 1;
        }
        let expected = vec![f64::from(samples) / counts.len() as f64; counts.len()];
        check_counts(&format!("sphere, r/d {ratio}"), &counts, &expected);
    }
}

#[test]
fn inside_a_sphere_every_direction_is_as_likely() {
    let sphere = Emitter::Sphere { center: Vec3::new(1.0, 2.0, 3.0), radius: 2.0 };
    for from in [Vec3::new(1.0, 2.0, 3.0), Vec3::new(2.5, 2.0, 3.0), Vec3::new(1.0, 2.0, 4.999_999)] {
        let mut rng = Rng::new(8);
        let mut counts = vec![0; 64];
        for _ in 0..60_000 {
            let sample = sphere.sample(LightSampling::SolidAngle, from, rng.next_2d(), Stratum::ONLY).unwrap();
            assert_eq!(sample.pdf, sphere.pdf(LightSampling::SolidAngle, from, sample.point));
            assert!((sample.point.distance(Vec3::new(1.0, 2.0, 3.0)) - 2.0).abs() < 1e-5);
            let d = sample.wi;
            let turn = (f64::from(d.y).atan2(f64::from(d.x)) / (2.0 * PI) + 0.5) * 8.0;
            counts[((d.z * 0.5 + 0.5) * 7.999) as usize * 8 + (turn as usize).min(7)] += 1;
        }
        check_counts("inside", &counts, &[60_000.0 / 64.0; 64]);
    }
}

/// All kinds of emitters, about 1 large, around the origin.
fn kinds() -> Vec<Emitter> {
    let [x, y, z] = AXES;
    vec![
        Emitter::Triangle { p: [Vec3::ZERO, x, y] },
        Emitter::Rectangle { corner: -0.5 * (x + y), edge_u: x, edge_v: y },
        Emitter::Sphere { center: Vec3::ZERO, radius: 0.5 },
        Emitter::Disk { center: Vec3::ZERO, normal: z, radius: 0.5 },
    ]
}

#[test]
fn area_and_strata_are_uniform_over_the_area() {
    let [x, y, z] = AXES;
    for sampling in [LightSampling::Area, LightSampling::Stratified] {
        for count in [1, 3, 4, 7] {
            for (kind, emitter) in kinds().iter().enumerate() {
                // Mean of points and of their squares along the axes against the closed forms.
                let (mut rng, from) = (Rng::new(21), Vec3::new(5.0, 6.0, 70.0));
                let (mut counts, mut n) = (vec![0; 8 * 8 * 2], 0u32);
                for i in 0..84_000 {
                    let stratum = Stratum { index: i % count, count };
                    let Some(sample) = emitter.sample(sampling, from, rng.next_2d(), stratum) else { continue };
                    n += 1;
                    let p = sample.point;
                    let (a, b) = (f64::from(p.dot(x)), f64::from(p.dot(y)));
                    let (u, v) = match kind {
                        0 => (f64::from(sample.coordinates.x), f64::from(sample.coordinates.y)),
                        1 => (a + 0.5, b + 0.5),
                        2 => (f64::from(p.dot(z)) + 0.5, b.atan2(a) / (2.0 * PI) + 0.5),
                        _ => (4.0 * (a * a + b * b), b.atan2(a) / (2.0 * PI) + 0.5),
                    };
                    let (i, j) = (((u * 8.0) as usize).min(7), ((v * 8.0) as usize).min(7));
                    let upper = u * 8.0 - i as f64 + v * 8.0 - j as f64 > 1.0;
                    counts[2 * (8 * i + j) + usize::from(upper)] += 1;
                }
                let expected: Vec<f64> = (0..128)
                    .map(|c| {
                        let (i, j, upper) = (c / 16, c / 2 % 8, c % 2);
                        let inside = if kind == 0 { i + j + upper < 8 } else { true };
                        let cells = if kind == 0 { 64.0 } else { 128.0 };
                        if inside { f64::from(n) / cells } else { 0.0 }
                    })
                    .collect();
                check_counts(&format!("{sampling} {count} {emitter:?}"), &counts, &expected);
            }
        }
    }
}

#[test]
fn four_samples_of_a_triangle_fall_into_its_four_parts_and_slices_into_theirs() {
    let mut rng = Rng::new(2);
    let from = Vec3::new(0.0, 0.0, 9.0);
    let triangle = Emitter::Triangle { p: [Vec3::ZERO, Vec3::X, Vec3::Y] };
    let sphere = Emitter::Sphere { center: Vec3::ZERO, radius: 1.0 };
    for _ in 0..1000 {
        let (mut parts, mut slices) = ([0; 4], [0; 5]);
        for index in 0..4 {
            let stratum = Stratum { index, count: 4 };
            let c = triangle.sample(LightSampling::Stratified, from, rng.next_2d(), stratum).unwrap().coordinates;
            parts[if c.x > 0.5 {
                1
            } else if c.y > 0.5 {
                2
            } else if c.x + c.y < 0.5 {
                0
            } else {
                3
            }] += 1;
        }
        for index in 0..5 {
            let stratum = Stratum { index, count: 5 };
            let p = sphere.sample(LightSampling::Stratified, from, rng.next_2d(), stratum).unwrap().point;
            slices[(((f64::from(p.y).atan2(f64::from(p.x)) / (2.0 * PI)).rem_euclid(1.0) * 5.0) as usize).min(4)] += 1;
        }
        assert_eq!((parts, slices), ([1; 4], [1; 5]));
    }
}

#[test]
fn a_density_evaluated_at_the_hit_is_the_one_sampled() {
    // A ray reports its hit with an error of a few ulp of the coordinates; grazing views of a sphere
    // aside, where the cosine itself is no better than that, densities agree to 1e-4.
    let mut rng = Rng::new(4);
    for emitter in kinds() {
        for sampling in SAMPLINGS {
            for _ in 0..20_000 {
                let distance = [0.7, 2.0, 30.0, 1000.0][rng.next_u32() as usize % 4];
                let from = uniform_sphere(rng.next_2d()) * distance;
                let Some(sample) = emitter.sample(sampling, from, rng.next_2d(), Stratum::ONLY) else { continue };
                if matches!(emitter, Emitter::Sphere { .. }) && sample.ng.dot(sample.wi).abs() < 0.01 {
                    continue;
                }
                let ulps = 4.0 * f32::EPSILON * sample.point.abs().max_element();
                let jitter = uniform_sphere(rng.next_2d()) * ulps;
                let evaluated = emitter.pdf(sampling, from, sample.point + jitter);
                assert!((sample.pdf / evaluated - 1.0).abs() < 1e-4, "{emitter:?} from {from}: {sample:?} {evaluated}");
            }
        }
    }
}

#[test]
fn points_in_the_plane_on_an_edge_or_at_a_vertex_give_no_nan() {
    let [x, y, z] = AXES;
    let mut places = vec![Vec3::ZERO, x, y, 0.5 * x, 0.5 * (x + y), 0.2 * x + 0.3 * y, 3.0 * x, -2.0 * y, 0.5 * z];
    places.extend((0..40).map(|i| 0.3 * x + 0.3 * y + z * 10f32.powi(-i)));
    places.extend([Vec3::splat(1e18), Vec3::splat(1e30), Vec3::splat(1e-30)]);
    let mut emitters = kinds();
    // Nothing, a line, and a triangle too small to have an area in f32.
    emitters.push(Emitter::Triangle { p: [x; 3] });
    emitters.push(Emitter::Triangle { p: [Vec3::ZERO, x, 2.0 * x] });
    emitters.push(Emitter::Triangle { p: [Vec3::ZERO, x * 1e-25, y * 1e-25] });
    emitters.push(Emitter::Rectangle { corner: x, edge_u: Vec3::ZERO, edge_v: y });
    let mut rng = Rng::new(6);
    let corners = [Vec2::ZERO, Vec2::splat(crate::math::ONE_MINUS_EPSILON)];
    for emitter in &emitters {
        for &from in &places {
            for sampling in SAMPLINGS {
                for i in 0..50 {
                    let u = corners.get(i).copied().unwrap_or_else(|| rng.next_2d());
                    if let Some(sample) = emitter.sample(sampling, from, u, Stratum::ONLY) {
                        assert!(sample.pdf > 0.0 && sample.pdf.is_finite(), "{emitter:?} {from} {sample:?}");
                        assert!((sample.wi.length() - 1.0).abs() < 1e-5, "{emitter:?} {from} {sample:?}");
                        assert!(sample.point.is_finite() && sample.point_error.is_finite());
                    }
                    let pdf = emitter.pdf(
                        sampling,
                        from,
                        emitter.sample(sampling, from + z, u, Stratum::ONLY).map_or(x, |s| s.point),
                    );
                    assert!(pdf >= 0.0 && pdf.is_finite(), "{emitter:?} {from} {pdf}");
                }
            }
        }
    }
}

#[test]
fn a_right_angled_parallelogram_is_one_rectangle_and_other_quads_are_two_triangles() {
    let square = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 2.0, 0.0), Vec3::new(0.0, 2.0, 0.0)];
    assert!(matches!(Emitter::from_quad(square)[..], [Emitter::Rectangle { .. }]));
    let mut skew = square;
    skew[2].x = 1.01;
    let parts = Emitter::from_quad(skew);
    assert_eq!(parts.len(), 2);
    assert!((parts.iter().map(Emitter::area).sum::<f64>() - 2.01).abs() < 1e-6);
}

#[test]
fn textbook_forms_agree_where_they_work_and_fail_where_it_is_said() {
    let p = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let near = Vec3::new(0.3, 0.2, 0.5);
    let ours = |from| Emitter::Triangle { p }.solid_angle(from).unwrap();
    assert!((textbook::girard_solid_angle(&p, near) / ours(near) - 1.0).abs() < 1e-5);
    let far = Vec3::new(100.0, 50.0, 200.0);
    assert!((textbook::girard_solid_angle(&p, far) / ours(far) - 1.0).abs() > 0.01);
    let rectangle = Emitter::Rectangle { corner: Vec3::ZERO, edge_u: Vec3::X, edge_v: Vec3::Y };
    let urena = |from| textbook::urena_solid_angle(Vec3::ZERO, Vec3::X, Vec3::Y, from);
    assert!((urena(near) / rectangle.solid_angle(near).unwrap() - 1.0).abs() < 1e-5);
    assert!((urena(far) / rectangle.solid_angle(far).unwrap() - 1.0).abs() > 0.01);
    assert_eq!(textbook::cone_solid_angle(1e-4, 1.0), 0.0);
    let sphere = Emitter::Sphere { center: Vec3::ZERO, radius: 0.5 };
    let ratio = textbook::cone_solid_angle(0.5, near.length()) / sphere.solid_angle(near).unwrap();
    assert!((ratio - 1.0).abs() < 1e-5);
    // Both maps choose directions within the triangle, with the same mean.
    let mut rng = Rng::new(9);
    let (mut a, mut b) = (Vec3::ZERO, Vec3::ZERO);
    for _ in 0..40_000 {
        a += textbook::arvo_triangle(&p, near, rng.next_2d());
        let sample = Emitter::Triangle { p }.sample(LightSampling::SolidAngle, near, rng.next_2d(), Stratum::ONLY);
        b += sample.unwrap().wi;
    }
    assert!((a - b).length() / 40_000.0 < 0.01);
}
