//! Surfaces that emit: points chosen on them, seen from a reference point, and the density of that choice.
//!
//! A density that a sample carries and the density computed later for the same point, when a scattered
//! ray hits it, come from the same function of the reference point and the point on the emitter.

use std::f64::consts::PI;

use common::method::LightSampling;

use super::{
    shard::triangle_coordinates, sphere_cone::SphereCone, spherical_rectangle::SphericalRectangle,
    spherical_triangle::SphericalTriangle,
};
use crate::math::{
    DVec3, Frame, UNIFORM_SPHERE_PDF, Vec2, Vec3, concentric_disk, gamma, safe_sqrt, sin_cos_turns, uniform_sphere,
};

/// A primitive that emits, in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Emitter {
    /// A triangle; its front is where it runs counter-clockwise.
    Triangle {
        /// Vertices.
        p: [Vec3; 3],
    },
    /// A rectangle; its front is where `edge_u` x `edge_v` points.
    Rectangle {
        /// One corner.
        corner: Vec3,
        /// An edge at the corner.
        edge_u: Vec3,
        /// The other edge at the corner, square to `edge_u`.
        edge_v: Vec3,
    },
    /// A sphere; its front is outside.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius, above 0.
        radius: f32,
    },
    /// A disk.
    Disk {
        /// Centre.
        center: Vec3,
        /// Unit normal of the front.
        normal: Vec3,
        /// Radius, above 0.
        radius: f32,
    },
}

/// One of several samples that one hit takes of one light: strata are dealt out among them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stratum {
    /// Number of the sample, below `count`.
    pub index: u32,
    /// How many there are.
    pub count: u32,
}

impl Stratum {
    /// The only sample.
    pub const ONLY: Self = Self { index: 0, count: 1 };

    /// The stratum out of `strata` that this sample falls in, and `u` within it. Samples beyond the last
    /// whole round choose by `u`.
    #[inline]
    fn deal(self, strata: u32, u: f32) -> (u32, f32) {
        if self.index < self.count - self.count % strata {
            (self.index % strata, u)
        } else {
            let scaled = u * strata as f32;
            let stratum = (scaled as u32).min(strata - 1);
            (stratum, (scaled - stratum as f32).clamp(0.0, 1.0))
        }
    }
}

/// A point on an emitter, as seen from the reference point it was chosen for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmitterSample {
    /// Unit vector towards the point.
    pub wi: Vec3,
    /// The point.
    pub point: Vec3,
    /// Bound of its error, each coordinate.
    pub point_error: Vec3,
    /// Unit geometric normal of the front.
    pub ng: Vec3,
    /// Distance of the point.
    pub distance: f32,
    /// Density per solid angle.
    pub pdf: f32,
    /// Where on the emitter: barycentrics (b1, b2) of a triangle, multiples of the edges of a rectangle;
    /// 0 for others.
    pub coordinates: Vec2,
}

/// A point on an emitter, whoever looks.
#[derive(Debug, Clone, Copy)]
struct Place {
    point: Vec3,
    error: Vec3,
    ng: Vec3,
    coordinates: Vec2,
}

/// An emitter as seen from a reference point: what the choice of a point is uniform over. Samples and
/// densities both start here, so they agree on it.
enum Seen {
    Triangle(SphericalTriangle),
    Rectangle(SphericalRectangle),
    Cone(SphereCone),
    /// Every direction: from inside a sphere.
    Around,
    /// The area.
    Surface,
}

impl Seen {
    #[inline]
    fn new(emitter: &Emitter, sampling: LightSampling, from: Vec3) -> Self {
        if sampling != LightSampling::SolidAngle {
            return Self::Surface;
        }
        match *emitter {
            Emitter::Triangle { ref p } => SphericalTriangle::new(p, from).map_or(Self::Surface, Self::Triangle),
            Emitter::Rectangle { corner, edge_u, edge_v } => {
                SphericalRectangle::new(corner, edge_u, edge_v, from).map_or(Self::Surface, Self::Rectangle)
            }
            Emitter::Sphere { center, radius } => {
                SphereCone::new(center, radius, from).map_or(Self::Around, Self::Cone)
            }
            Emitter::Disk { .. } => Self::Surface,
        }
    }

    /// Density per solid angle with which `point` is chosen.
    #[inline]
    fn pdf(&self, emitter: &Emitter, from: Vec3, point: Vec3) -> f32 {
        match self {
            Self::Triangle(triangle) => 1.0 / triangle.solid_angle(),
            Self::Rectangle(rectangle) => 1.0 / rectangle.solid_angle(),
            Self::Cone(cone) => cone.pdf(),
            // Points that are seen from outside are never chosen.
            Self::Around if emitter.facing(point).dot(point.as_dvec3() - from.as_dvec3()) < 0.0 => 0.0,
            Self::Around => UNIFORM_SPHERE_PDF,
            Self::Surface => emitter.area_pdf(from, point),
        }
    }
}

impl Emitter {
    /// The emitters that a flat convex quadrilateral is made of: one rectangle, or else the two triangles
    /// (0, 1, 2) and (0, 2, 3).
    #[must_use]
    pub fn from_quad(v: [Vec3; 4]) -> Vec<Self> {
        let d = v.map(|v| v.as_dvec3());
        let (edge_u, edge_v) = (d[1] - d[0], d[3] - d[0]);
        let scale = edge_u.length().min(edge_v.length());
        let is_parallelogram = (d[0] + edge_u + edge_v - d[2]).length() <= 1e-6 * scale;
        let is_square_angled = edge_u.dot(edge_v).abs() <= 1e-6 * edge_u.length() * edge_v.length();
        if scale > 0.0 && is_parallelogram && is_square_angled {
            vec![Self::Rectangle { corner: v[0], edge_u: v[1] - v[0], edge_v: v[3] - v[0] }]
        } else {
            vec![Self::Triangle { p: [v[0], v[1], v[2]] }, Self::Triangle { p: [v[0], v[2], v[3]] }]
        }
    }

    /// Surface area.
    #[must_use]
    pub fn area(&self) -> f64 {
        match *self {
            Self::Triangle { .. } => 0.5 * self.facing(Vec3::ZERO).length(),
            Self::Rectangle { .. } => self.facing(Vec3::ZERO).length(),
            Self::Sphere { radius, .. } => 4.0 * PI * f64::from(radius) * f64::from(radius),
            Self::Disk { radius, .. } => PI * f64::from(radius) * f64::from(radius),
        }
    }

    /// Solid angle it subtends at `p`, where points can be chosen uniformly over that: `None` for disks,
    /// and where it is below 1e-11 sr or `p` lies in its plane.
    #[must_use]
    pub fn solid_angle(&self, p: Vec3) -> Option<f32> {
        match Seen::new(self, LightSampling::SolidAngle, p) {
            Seen::Triangle(triangle) => Some(triangle.solid_angle()),
            Seen::Rectangle(rectangle) => Some(rectangle.solid_angle()),
            Seen::Cone(cone) => Some(cone.solid_angle()),
            Seen::Around => Some((4.0 * PI) as f32),
            Seen::Surface => None,
        }
    }

    /// Whether `p` sees the front.
    #[inline]
    #[must_use]
    pub fn front_faces(&self, p: Vec3) -> bool {
        match *self {
            Self::Sphere { center, radius } => {
                let radius = f64::from(radius);
                (p.as_dvec3() - center.as_dvec3()).length_squared() > radius * radius
            }
            Self::Triangle { p: [origin, ..] }
            | Self::Rectangle { corner: origin, .. }
            | Self::Disk { center: origin, .. } => self.facing(p).dot(p.as_dvec3() - origin.as_dvec3()) > 0.0,
        }
    }

    /// A point chosen by `u` for the reference point `p`; `None` where the choice is of no use: the
    /// emitter is seen edge-on, or has no area.
    #[inline]
    #[must_use]
    pub fn sample(&self, sampling: LightSampling, p: Vec3, u: Vec2, stratum: Stratum) -> Option<EmitterSample> {
        let seen = Seen::new(self, sampling, p);
        let mut direction = None;
        let place = match (&seen, sampling) {
            (Seen::Triangle(triangle), _) => self.at(triangle.sample(u)),
            (Seen::Rectangle(rectangle), _) => self.at(rectangle.sample(u)),
            (Seen::Cone(cone), _) => {
                // A hair above the surface the rounding of the point would bend the direction.
                let (wi, normal) = cone.sample(u);
                direction = Some(wi);
                self.on_sphere_at(normal)
            }
            (Seen::Around, _) => return self.around(p, uniform_sphere(u)),
            (Seen::Surface, LightSampling::Stratified) => self.by_stratum(u, stratum),
            (Seen::Surface, _) => self.by_area(u),
        };
        let to = place.point.as_dvec3() - p.as_dvec3();
        let distance = to.length();
        let wi = direction.unwrap_or_else(|| (to / distance).as_vec3());
        let pdf = seen.pdf(self, p, place.point);
        (pdf > 0.0 && wi.is_finite()).then_some(EmitterSample {
            wi,
            point: place.point,
            point_error: place.error,
            ng: place.ng,
            distance: distance as f32,
            pdf,
            coordinates: place.coordinates,
        })
    }

    /// Density per solid angle with which [`Emitter::sample`] chooses `point` for the reference point `p`.
    #[inline]
    #[must_use]
    pub fn pdf(&self, sampling: LightSampling, p: Vec3, point: Vec3) -> f32 {
        Seen::new(self, sampling, p).pdf(self, p, point)
    }

    /// Density per solid angle of a choice that is uniform over the area: distance^2 / (|cos| area).
    #[inline]
    fn area_pdf(&self, p: Vec3, point: Vec3) -> f32 {
        let p = p.as_dvec3();
        let to = point.as_dvec3() - p;
        // |cos| area distance: the offset along a normal that is as long as the area is large. On a plane
        // every point has the same offset: taking it at one place keeps the rounding of `point` out.
        let shadow = match *self {
            Self::Triangle { p: [origin, ..] } => 0.5 * self.facing(point).dot(origin.as_dvec3() - p),
            Self::Rectangle { corner, .. } => self.facing(point).dot(corner.as_dvec3() - p),
            Self::Disk { center, .. } => self.facing(point).dot(center.as_dvec3() - p) * self.area(),
            Self::Sphere { center, radius } => {
                (point.as_dvec3() - center.as_dvec3()).dot(to) / f64::from(radius) * self.area()
            }
        }
        .abs();
        let distance2 = to.length_squared();
        if shadow > 0.0 { ratio(distance2 * distance2.sqrt(), shadow) } else { 0.0 }
    }

    /// A normal of the front at `point`: the product of the edges for triangles and rectangles, a unit
    /// vector for the rest.
    #[inline]
    fn facing(&self, point: Vec3) -> DVec3 {
        match *self {
            Self::Triangle { p: [a, b, c] } => {
                let a = a.as_dvec3();
                (b.as_dvec3() - a).cross(c.as_dvec3() - a)
            }
            Self::Rectangle { edge_u, edge_v, .. } => edge_u.as_dvec3().cross(edge_v.as_dvec3()),
            Self::Sphere { center, .. } => (point.as_dvec3() - center.as_dvec3()).normalize_or_zero(),
            Self::Disk { normal, .. } => normal.as_dvec3(),
        }
    }

    /// Uniform over the area.
    fn by_area(&self, u: Vec2) -> Place {
        match *self {
            Self::Triangle { .. } => self.at(triangle_coordinates(u)),
            Self::Rectangle { .. } => self.at(u),
            Self::Sphere { .. } => self.on_sphere(1.0 - 2.0 * u.x, u.y),
            Self::Disk { center, normal, radius } => {
                let d = concentric_disk(u) * radius;
                let frame = Frame::from_normal(normal);
                let offset = frame.t * d.x + frame.b * d.y;
                Place {
                    point: center + offset,
                    error: gamma(8) * (center.abs() + frame.t.abs() * d.x.abs() + frame.b.abs() * d.y.abs()),
                    ng: normal,
                    coordinates: Vec2::ZERO,
                }
            }
        }
    }

    /// Uniform over the area, one stratum a sample: sub-triangles, quarters, slices.
    fn by_stratum(&self, u: Vec2, stratum: Stratum) -> Place {
        match *self {
            Self::Triangle { .. } => {
                let (part, x) = stratum.deal(4, u.x);
                let b = triangle_coordinates(Vec2::new(x, u.y)) * 0.5;
                self.at(match part {
                    0 => b,
                    1 => b + Vec2::new(0.5, 0.0),
                    2 => b + Vec2::new(0.0, 0.5),
                    // The middle one, turned over.
                    _ => Vec2::splat(0.5) - b,
                })
            }
            Self::Rectangle { .. } | Self::Disk { .. } => {
                let (part, x) = stratum.deal(4, u.x);
                self.by_area(Vec2::new(0.5 * (x + (part & 1) as f32), 0.5 * (u.y + (part >> 1) as f32)))
            }
            Self::Sphere { .. } => {
                let (slice, x) = stratum.deal(stratum.count, u.x);
                self.on_sphere(1.0 - 2.0 * u.y, (slice as f32 + x) / stratum.count as f32)
            }
        }
    }

    /// The point with these coordinates on a triangle or a rectangle.
    fn at(&self, c: Vec2) -> Place {
        let (origin, u, v) = match *self {
            Self::Triangle { p: [a, b, c] } => (a, b - a, c - a),
            Self::Rectangle { corner, edge_u, edge_v } => (corner, edge_u, edge_v),
            Self::Sphere { center, .. } | Self::Disk { center, .. } => (center, Vec3::ZERO, Vec3::ZERO),
        };
        let (u, v) = (u * c.x, v * c.y);
        Place {
            point: origin + u + v,
            error: gamma(6) * (origin.abs() + u.abs() + v.abs()),
            ng: self.facing(origin).normalize_or_zero().as_vec3(),
            coordinates: c,
        }
    }

    /// The point of a sphere at height `z` and `turn` of a full turn about its axis.
    fn on_sphere(&self, z: f32, turn: f32) -> Place {
        let r = safe_sqrt(1.0 - z * z);
        let (sin, cos) = sin_cos_turns(turn);
        self.on_sphere_at(Vec3::new(r * cos, r * sin, z))
    }

    /// The point of a sphere that the ray from `p`, inside it, along the unit vector `wi` meets. It may be
    /// so near that its own rounding hides the direction: that comes from `wi`.
    fn around(&self, p: Vec3, wi: Vec3) -> Option<EmitterSample> {
        let Self::Sphere { center, radius } = *self else { return None };
        let (from, d, radius) = (p.as_dvec3() - center.as_dvec3(), wi.as_dvec3(), f64::from(radius));
        let along = from.dot(d);
        let t = (along * along - from.length_squared() + radius * radius).max(0.0).sqrt() - along;
        let Place { point, error, ng, coordinates } = self.on_sphere_at((from + d * t).try_normalize()?.as_vec3());
        Some(EmitterSample {
            wi,
            point,
            point_error: error,
            ng,
            distance: t.max(0.0) as f32,
            pdf: UNIFORM_SPHERE_PDF,
            coordinates,
        })
    }

    /// The point of a sphere whose normal is the unit vector `n`.
    fn on_sphere_at(&self, n: Vec3) -> Place {
        let (center, radius) = match *self {
            Self::Sphere { center, radius } => (center, radius),
            _ => (Vec3::ZERO, 0.0),
        };
        let offset = n * radius;
        Place {
            point: center + offset,
            error: gamma(6) * (center.abs() + offset.abs()),
            ng: n,
            coordinates: Vec2::ZERO,
        }
    }
}

/// a / b as f32, at most the largest finite one.
#[inline]
fn ratio(a: f64, b: f64) -> f32 {
    (a / b).min(f64::from(f32::MAX)) as f32
}
