//! Rays that leave a surface without meeting it again.
//!
//! A computed point lies somewhere in a box around the true one. The origin is pushed along the normal
//! until the whole box is on its side, then each coordinate is rounded away from the surface (Pharr,
//! Jakob and Humphreys, "Physically Based Rendering", 4th edition, 6.8.5 and 6.8.6). The step follows
//! the size of the numbers involved, so the same scene at any scale and any distance from the
//! origin behaves alike.
//!
//! What can be had: a surface at a gap of eight units in the last place of the largest
//! coordinate, or more, is not skipped; a smaller gap cannot be told from rounding.

use glam::Vec3;

use super::Ray;

/// Bound of the relative error of `n` rounded operations in `f32` (Higham, "Accuracy and Stability of
/// Numerical Algorithms", 3.1).
#[must_use]
pub const fn gamma(n: u32) -> f64 {
    let nu = n as f64 * (0.5 * f32::EPSILON as f64);
    nu / (1.0 - nu)
}

/// A point clear of the surface that passes within `p_error` of `p` with normal `ng`, on the side that
/// `direction` points to.
#[inline(always)]
#[must_use]
pub fn offset_origin(p: Vec3, p_error: Vec3, ng: Vec3, direction: Vec3) -> Vec3 {
    let distance = ng.abs().dot(p_error);
    let mut push = ng * distance;
    if direction.dot(ng) < 0.0 {
        push = -push;
    }
    let away = |x: f32, by: f32| further(x + by, by);
    Vec3::new(away(p.x, push.x), away(p.y, push.y), away(p.z, push.z))
}

/// The number next to `x` in the direction of `by`; `x` itself where that has none or `x` is not finite. Without branches,
/// and by one step up or down of the bits, where [`f32::next_up`] and [`f32::next_down`] would each look for their exceptions.
#[inline(always)]
fn further(x: f32, by: f32) -> f32 {
    let (up, down) = (u32::from(by > 0.0), u32::from(by < 0.0));
    let (bits, direction) = (x.to_bits(), up.wrapping_sub(down));
    let size = bits & !SIGN;
    // Away from 0 bits count up, on either side.
    let sign = (bits.cast_signed() >> 31).cast_unsigned();
    let step = (direction ^ sign).wrapping_sub(sign);
    let from_zero = (direction & SIGN) | (up | down);
    let pick = |condition: bool| u32::from(condition).wrapping_neg();
    let (leaves_zero, finite) = (pick((size == 0) & (direction != 0)), pick(size < f32::INFINITY.to_bits()));
    let next = from_zero & leaves_zero | bits.wrapping_add(step) & !leaves_zero;
    f32::from_bits(next & finite | bits & !finite)
}

const SIGN: u32 = 1 << 31;

/// A ray without end from a surface point.
#[inline(always)]
#[must_use]
pub fn spawn(p: Vec3, p_error: Vec3, ng: Vec3, direction: Vec3) -> Ray {
    Ray::new(offset_origin(p, p_error, ng, direction), direction)
}

/// A shadow ray from one surface point to another, clear of both: it meets whatever stands between them
/// and neither of them. A point without a surface (a point light, a point in space) has a normal of zero.
/// The direction is not unit length: the target is at parameter 1, and the ray ends just before it.
#[inline(always)]
#[must_use]
pub fn spawn_to(p: Vec3, p_error: Vec3, ng: Vec3, target: Vec3, target_error: Vec3, target_ng: Vec3) -> Ray {
    let from = offset_origin(p, p_error, ng, target - p);
    let to = offset_origin(target, target_error, target_ng, from - target);
    let direction = to - from;
    // The ray meets a surface seen at a slant later or sooner by its lateral error over the cosine.
    let cosine = target_ng.dot(direction).abs();
    let slant = if cosine > 0.0 { direction.length() / cosine } else { 0.0 };
    let margin = (8.0 * f32::EPSILON * (1.0 + slant)).min(0.01);
    Ray { origin: from, direction, t_max: 1.0 - margin }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn further_is_the_next_number_up_or_down() {
        let some = (0..=u32::MAX).step_by(65_537).map(f32::from_bits);
        let edges = [0.0, f32::from_bits(1), f32::MIN_POSITIVE, 1.0, f32::MAX].into_iter().flat_map(|x| [x, -x]);
        for x in some.chain(edges).filter(|x| x.is_finite()) {
            assert_eq!(further(x, 2.0).to_bits(), x.next_up().to_bits(), "{x:e}");
            assert_eq!(further(x, -1e-40).to_bits(), x.next_down().to_bits(), "{x:e}");
            for none in [0.0, -0.0, f32::NAN] {
                assert_eq!(further(x, none).to_bits(), x.to_bits(), "{x:e}");
            }
        }
        assert!(further(f32::NAN, 1.0).is_nan() && further(f32::INFINITY, 1.0) == f32::INFINITY);
    }
}
