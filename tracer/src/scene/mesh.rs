//! Vertex data of meshes: placed in the world, with normals made where they are asked for.

use common::scene::Normals;

use crate::math::{DAffine3, DVec3, Vec2, Vec3};

/// Triangles with what their vertices carry, as they come from a file or from the scene.
pub(super) struct Source<'a> {
    pub positions: Vec<DVec3>,
    pub triangles: &'a [[u32; 3]],
    /// One a vertex, or none.
    pub normals: Vec<DVec3>,
    /// One a vertex, or none.
    pub uvs: Vec<Vec2>,
}

/// A mesh in its final place.
pub(super) struct Placed {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// One a vertex, or none: then the triangles are flat.
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    /// Triangles without area, or with a vertex that is not finite.
    pub bad: usize,
}

impl Source<'_> {
    /// Apply `to_world`. A mirror image keeps its front: its triangles are turned round.
    pub fn place(self, to_world: DAffine3, normals: Normals) -> Placed {
        let positions: Vec<DVec3> = self.positions.into_iter().map(|p| to_world.transform_point3(p)).collect();
        let mirrored = to_world.matrix3.determinant() < 0.0;
        let triangles: Vec<[u32; 3]> =
            self.triangles.iter().map(|&[a, b, c]| if mirrored { [a, c, b] } else { [a, b, c] }).collect();
        let normals = match normals {
            Normals::Flat => Vec::new(),
            Normals::Given => {
                let map = to_world.matrix3.inverse().transpose();
                self.normals.into_iter().map(|n| (map * n).normalize_or_zero().as_vec3()).collect()
            }
            Normals::Smooth => smooth(&positions, &triangles),
        };
        let positions: Vec<Vec3> = positions.into_iter().map(|p| p.as_vec3()).collect();
        let bad = triangles.iter().filter(|t| is_bad(t.map(|i| positions[i as usize]))).count();
        Placed { positions, triangles, normals, uvs: self.uvs, bad }
    }
}

fn is_bad([a, b, c]: [Vec3; 3]) -> bool {
    let [a, b, c] = [a, b, c].map(|p| p.as_dvec3());
    let area2 = (b - a).cross(c - a).length_squared();
    !(area2 > 0.0 && area2.is_finite())
}

/// Normals averaged over the triangles at a place, weighted by their angles there (Thuermer and Wuethrich
/// 1998). Vertices at the same place share one, so a seam of texture coordinates does not show.
fn smooth(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let leader = leaders(positions);
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for triangle in triangles {
        let p = triangle.map(|i| positions[i as usize]);
        let n = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
        if !n.is_finite() {
            continue;
        }
        for i in 0..3 {
            let (u, v) = (p[(i + 1) % 3] - p[i], p[(i + 2) % 3] - p[i]);
            let angle = libm::atan2(u.cross(v).length(), u.dot(v));
            sums[leader[triangle[i] as usize] as usize] += n * angle;
        }
    }
    leader.iter().map(|&i| sums[i as usize].normalize_or_zero().as_vec3()).collect()
}

/// For each vertex the first one at the same place.
fn leaders(positions: &[DVec3]) -> Vec<u32> {
    let key = |i: u32| positions[i as usize].to_array().map(|c| (c + 0.0).to_bits());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|&i| (key(i), i));
    let mut leader = vec![0; positions.len()];
    let mut first = 0;
    for (n, &i) in order.iter().enumerate() {
        if n == 0 || key(i) != key(first) {
            first = i;
        }
        leader[i as usize] = first;
    }
    leader
}

/// (dp/du, dp/dv) of every triangle; zero where the texture coordinates do not tell.
pub(super) fn tangents(positions: &[Vec3], triangles: &[[u32; 3]], uvs: &[Vec2]) -> Vec<[Vec3; 2]> {
    if uvs.is_empty() {
        return Vec::new();
    }
    let of = |triangle: &[u32; 3]| {
        let [p, q, r] = triangle.map(|i| positions[i as usize].as_dvec3());
        let [a, b, c] = triangle.map(|i| uvs[i as usize].as_dvec2());
        let (d1, d2, e1, e2) = (b - a, c - a, q - p, r - p);
        let determinant = d1.x * d2.y - d1.y * d2.x;
        if determinant == 0.0 || !determinant.is_finite() {
            return [Vec3::ZERO; 2];
        }
        let dpdu = (e1 * d2.y - e2 * d1.y) / determinant;
        let dpdv = (e2 * d1.x - e1 * d2.x) / determinant;
        [dpdu.as_vec3(), dpdv.as_vec3()].map(|d| if d.is_finite() { d } else { Vec3::ZERO })
    };
    triangles.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube_corner() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        // Three faces of a cube at the origin; the face z = 0 is cut in two, and has vertices of its own.
        let positions =
            vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0)];
        (positions, vec![[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6]])
    }

    #[test]
    fn smooth_normals_weigh_by_angle_and_cross_seams() {
        let (positions, triangles) = cube_corner();
        let normals = smooth(&positions, &triangles);
        // Each face fills a right angle at the corner, however it is cut: all three count alike.
        let expected = Vec3::new(1.0, 1.0, 1.0).normalize();
        assert!((normals[0] - expected).length() < 1e-6, "{}", normals[0]);
        assert_eq!(normals[0], normals[4]);
    }

    #[test]
    fn a_mirror_image_keeps_its_front() {
        let (positions, triangles) = cube_corner();
        let given: Vec<DVec3> = smooth(&positions, &triangles).iter().map(|n| n.as_dvec3()).collect();
        let mirror = DAffine3::from_scale(DVec3::new(-2.0, 1.0, 1.0));
        let source = Source { positions, triangles: &triangles, normals: given, uvs: Vec::new() };
        let placed = source.place(mirror, Normals::Given);
        let [a, b, c] = placed.triangles[0].map(|i| placed.positions[i as usize]);
        // The face x = 0 looked along +x; its image looks along -x.
        assert!((b - a).cross(c - a).x < 0.0);
        assert!(placed.normals[0].dot((b - a).cross(c - a)) > 0.0);
        assert_eq!(placed.bad, 0);
    }

    #[test]
    fn bad_triangles_are_counted() {
        let positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::splat(f64::NAN)];
        let triangles = [[0, 1, 2], [0, 0, 1], [0, 1, 3]];
        let source = Source { positions, triangles: &triangles, normals: Vec::new(), uvs: Vec::new() };
        assert_eq!(source.place(DAffine3::IDENTITY, Normals::Smooth).bad, 2);
    }

    #[test]
    fn tangents_follow_the_texture() {
        let positions = [Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * 3.0];
        let uvs = [Vec2::ZERO, Vec2::X, Vec2::Y];
        assert_eq!(tangents(&positions, &[[0, 1, 2]], &uvs), [[Vec3::X * 2.0, Vec3::Y * 3.0]]);
        assert_eq!(tangents(&positions, &[[0, 1, 2]], &[Vec2::ZERO; 3]), [[Vec3::ZERO; 2]]);
    }
}
