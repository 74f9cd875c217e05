//! Axis-aligned boxes.

use glam::{DAffine3, DVec3, Vec3};

/// An axis-aligned box; empty when `lo > hi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub lo: Vec3,
    /// Largest coordinates.
    pub hi: Vec3,
}

impl Bounds {
    /// Contains nothing; joins as the neutral element.
    pub const EMPTY: Self = Self { lo: Vec3::INFINITY, hi: Vec3::NEG_INFINITY };

    /// The smallest box around some points.
    #[must_use]
    pub fn of(points: &[Vec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| b.include(p))
    }

    /// The smallest box around this one and a point.
    #[must_use]
    pub fn include(self, p: Vec3) -> Self {
        Self { lo: self.lo.min(p), hi: self.hi.max(p) }
    }

    /// The smallest box around two.
    #[must_use]
    pub fn join(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// Whether it contains nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !(self.lo.x <= self.hi.x && self.lo.y <= self.hi.y && self.lo.z <= self.hi.z)
    }

    /// Whether a point is in it, faces included.
    #[must_use]
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.lo).all() && p.cmple(self.hi).all()
    }

    /// Middle.
    #[must_use]
    pub fn center(&self) -> Vec3 {
        self.lo * 0.5 + self.hi * 0.5
    }

    /// Extent along each axis.
    #[must_use]
    pub fn diagonal(&self) -> Vec3 {
        self.hi - self.lo
    }

    /// A sphere around the box: centre and radius.
    #[must_use]
    pub fn bounding_sphere(&self) -> (Vec3, f32) {
        if self.is_empty() { (Vec3::ZERO, 0.0) } else { (self.center(), self.diagonal().length() * 0.5) }
    }

    /// The box, in `f32`, that surely contains a box given in `f64`.
    #[must_use]
    pub(crate) fn around(lo: DVec3, hi: DVec3) -> Self {
        let down = |x: f64| if f64::from(x as f32) <= x { x as f32 } else { (x as f32).next_down() };
        let up = |x: f64| if f64::from(x as f32) >= x { x as f32 } else { (x as f32).next_up() };
        Self { lo: Vec3::new(down(lo.x), down(lo.y), down(lo.z)), hi: Vec3::new(up(hi.x), up(hi.y), up(hi.z)) }
    }

    /// A box around the image of this one. `slack` widens it by that many times the largest
    /// magnitude that goes into a coordinate: room for the rounding of rays that are taken into this
    /// box's space.
    #[must_use]
    pub fn transformed(&self, map: &DAffine3, slack: f64) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        let (lo, hi) = (self.lo.as_dvec3(), self.hi.as_dvec3());
        let (center, half) = ((lo + hi) * 0.5, (hi - lo) * 0.5);
        let m = map.matrix3;
        let absolute = glam::DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs());
        let middle = map.transform_point3(center);
        let reach = absolute * half;
        let pad = (absolute * lo.abs().max(hi.abs()) + map.translation.abs()) * slack;
        Self::around(middle - reach - pad, middle + reach + pad)
    }
}
