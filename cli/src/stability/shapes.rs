//! Closed surfaces to aim rays at.

use super::random::Random;
use tracer::geometry::{Accel, Shape, TriangleMesh, TriangleTest, World};
use tracer::math::{DVec3, Vec3};

/// A closed sphere of radius 1 about `center`, its corners moved in and out by up to 5%: rows of
/// quadrilaterals cut in two, and a fan at each pole.
pub(super) fn bumpy_sphere(rows: u32, columns: u32, center: DVec3, random: &mut Random) -> TriangleMesh {
    let mut positions = Vec::new();
    let mut corner = |theta: f64, phi: f64| {
        let radius = 1.0 + 0.1 * (random.uniform() - 0.5);
        let p = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * radius;
        positions.push((center + p).as_vec3());
    };
    corner(0.0, 0.0);
    for row in 1..rows {
        for column in 0..columns {
            let turn = f64::from(column) / f64::from(columns) * std::f64::consts::TAU;
            corner(std::f64::consts::PI * f64::from(row) / f64::from(rows), turn);
        }
    }
    corner(std::f64::consts::PI, 0.0);
    let at = |row: u32, column: u32| match row {
        0 => 0,
        _ if row == rows => 1 + (rows - 1) * columns,
        _ => 1 + (row - 1) * columns + column % columns,
    };
    let mut triangles = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let [a, b, c, d] = [at(row, column), at(row + 1, column), at(row + 1, column + 1), at(row, column + 1)];
            if row + 1 < rows {
                triangles.push([a, b, c]);
            }
            if row > 0 {
                triangles.push([a, c, d]);
            }
        }
    }
    TriangleMesh { positions, triangles }
}

/// A mesh alone in the world.
pub(super) fn alone(mesh: TriangleMesh, test: TriangleTest) -> Accel {
    Accel::build(World { shapes: vec![Shape::Mesh(mesh)], ..World::default() }, test)
}

/// A direction uniform over the sphere.
pub(super) fn direction(random: &mut Random) -> DVec3 {
    let z = 1.0 - 2.0 * random.uniform();
    let turn = std::f64::consts::TAU * random.uniform();
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * turn.cos(), r * turn.sin(), z)
}

/// Triangles that share no corner.
pub(super) fn soup(triangles: impl IntoIterator<Item = [Vec3; 3]>) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for corners in triangles {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}
