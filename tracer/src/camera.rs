//! From a point of the image to a ray: pinhole, thin lens and parallel projection, and the pixel filter.
//!
//! Directions have length 1 along the view axis, so a ray's parameter is the depth along that axis; near
//! and far planes are then ranges of the parameter. Knows nothing of the scene.

use common::scene::{self, CameraKind, Filter, FovAxis};

use crate::math::{DVec3, Vec2, Vec3, concentric_disk, exp, ln, sin_cos_turns};

/// A camera for one image size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    eye: Vec3,
    forward: Vec3,
    /// From the middle of the image to its right edge, at depth 1 (perspective) or any (orthographic).
    right: Vec3,
    /// From the middle of the image to its top edge.
    up: Vec3,
    /// 2 / width and 2 / height of the image in pixels.
    pixel: Vec2,
    near: f32,
    /// Depth between the near and the far plane.
    range: f32,
    /// Radius of the lens along the image's axes; zero for a pinhole.
    lens_right: Vec3,
    lens_up: Vec3,
    focus: f32,
    orthographic: bool,
    filter: Filter,
}

/// A ray of the camera. Its direction has length 1 along the view axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraRay {
    /// On the near plane.
    pub origin: Vec3,
    /// Not of unit length.
    pub direction: Vec3,
    /// End of the ray, in lengths of `direction`.
    pub t_max: f32,
}

/// Standard deviation of the Gaussian filter, pixels.
const GAUSSIAN_SIGMA: f32 = 0.5;
/// Where it is cut, pixels from the centre.
const GAUSSIAN_RADIUS: f32 = 1.5;

impl Camera {
    /// The camera of a checked scene for an image of `resolution` pixels. The angle of view is that of the
    /// whole image, whatever its shape.
    #[must_use]
    pub fn new(camera: &scene::Camera, filter: Filter, resolution: [u32; 2]) -> Self {
        let eye = DVec3::from_array(camera.position);
        let view = DVec3::from_array(camera.target) - eye;
        let forward = view.normalize();
        let right = forward.cross(DVec3::from_array(camera.up)).normalize();
        let up = right.cross(forward);
        let [w, h] = resolution.map(f64::from);
        let orthographic = camera.kind == CameraKind::Orthographic;
        let (half_w, half_h) = if orthographic {
            (0.5 * camera.height * w / h, 0.5 * camera.height)
        } else {
            let half = libm::tan(0.5 * camera.fov.to_radians());
            let along_x = match camera.fov_axis {
                FovAxis::X => true,
                FovAxis::Y => false,
                FovAxis::Smaller => w <= h,
                FovAxis::Larger => w >= h,
            };
            if along_x { (half, half * h / w) } else { (half * w / h, half) }
        };
        let lens = if orthographic { 0.0 } else { camera.lens_radius };
        Self {
            eye: eye.as_vec3(),
            forward: forward.as_vec3(),
            right: (right * half_w).as_vec3(),
            up: (up * half_h).as_vec3(),
            pixel: Vec2::new((2.0 / w) as f32, (2.0 / h) as f32),
            near: camera.near as f32,
            range: camera.far.map_or(f32::INFINITY, |far| (far - camera.near) as f32),
            lens_right: (right * lens).as_vec3(),
            lens_up: (up * lens).as_vec3(),
            focus: camera.focus_distance.unwrap_or_else(|| view.length()) as f32,
            orthographic,
            filter,
        }
    }

    /// Whether [`Camera::ray`] looks at `u_lens`.
    #[must_use]
    pub fn has_lens(&self) -> bool {
        self.lens_right != Vec3::ZERO
    }

    /// The ray of the pixel at column `x`, row `y` (from the top) for `u_film`, `u_lens` in 0..1. The place
    /// in the pixel has the filter's density, so every sample counts alike and for its own pixel alone.
    #[inline]
    #[must_use]
    pub fn ray(&self, x: u32, y: u32, u_film: Vec2, u_lens: Vec2) -> CameraRay {
        let offset = filter_offset(self.filter, u_film);
        let (px, py) = (x as f32 + 0.5 + offset.x, y as f32 + 0.5 + offset.y);
        let across = self.right * (px * self.pixel.x - 1.0) + self.up * (1.0 - py * self.pixel.y);
        if self.orthographic {
            return CameraRay {
                origin: self.eye + across + self.forward * self.near,
                direction: self.forward,
                t_max: self.range,
            };
        }
        let mut direction = self.forward + across;
        let mut origin = self.eye;
        if self.has_lens() {
            let lens = concentric_disk(u_lens);
            let on_lens = self.lens_right * lens.x + self.lens_up * lens.y;
            direction -= on_lens / self.focus;
            origin += on_lens;
        }
        CameraRay { origin: origin + direction * self.near, direction, t_max: self.range }
    }

    /// Whether [`Camera::plain_ray`] serves: a pinhole, and pixels that weigh all of their area alike.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.filter == Filter::Box && !self.orthographic && !self.has_lens()
    }

    /// [`Camera::ray`] where [`Camera::is_plain`]. Without branches, so that loops over it become vector code.
    #[inline(always)]
    #[must_use]
    pub fn plain_ray(&self, x: f32, y: f32, u_film: Vec2) -> CameraRay {
        let offset = u_film - Vec2::splat(0.5);
        let (px, py) = (x + 0.5 + offset.x, y + 0.5 + offset.y);
        let across = self.right * (px * self.pixel.x - 1.0) + self.up * (1.0 - py * self.pixel.y);
        let direction = self.forward + across;
        CameraRay { origin: self.eye + direction * self.near, direction, t_max: self.range }
    }

    /// Depth of `p` along the view axis.
    #[inline]
    #[must_use]
    pub fn depth(&self, p: Vec3) -> f32 {
        (p - self.eye).dot(self.forward)
    }
}

/// A place relative to the pixel's centre with the density of the filter.
#[inline]
fn filter_offset(filter: Filter, u: Vec2) -> Vec2 {
    match filter {
        Filter::Box => u - Vec2::splat(0.5),
        Filter::Tent => Vec2::new(tent(u.x), tent(u.y)),
        Filter::Gaussian => {
            // Box and Muller's radius with the tail beyond the cut left out.
            let inside = 1.0 - exp(-GAUSSIAN_RADIUS * GAUSSIAN_RADIUS / (2.0 * GAUSSIAN_SIGMA * GAUSSIAN_SIGMA));
            let r = GAUSSIAN_SIGMA * (-2.0 * ln(1.0 - u.x * inside)).max(0.0).sqrt();
            let (sin, cos) = sin_cos_turns(u.y);
            Vec2::new(r * cos, r * sin)
        }
    }
}

/// Density 1 - |x| over -1..1, by inversion.
#[inline]
fn tent(u: f32) -> f32 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(json: &str) -> scene::Camera {
        let text = format!(r#"{{"tessera":1,"camera":{{"position":[1,2,3],"target":[1,2,-1],{json}"fov":90}}}}"#);
        scene::SceneFile::parse(text.as_bytes()).unwrap().camera
    }

    fn at(camera: &Camera, x: f32, y: f32, u_lens: Vec2) -> CameraRay {
        let (column, row) = (x as u32, y as u32);
        camera.ray(column, row, Vec2::new(x - column as f32, y - row as f32), u_lens)
    }

    #[test]
    fn the_angle_of_view_spans_the_axis_it_is_measured_along() {
        for (axis, w, h, x, y) in [
            ("x", 200, 100, 1.0, 0.5),
            ("y", 200, 100, 2.0, 1.0),
            ("smaller", 200, 100, 2.0, 1.0),
            ("smaller", 100, 200, 1.0, 2.0),
            ("larger", 200, 100, 1.0, 0.5),
        ] {
            let camera = Camera::new(&camera(&format!(r#""fov_axis":"{axis}","#)), Filter::Box, [w, h]);
            // The top-left corner of the image; tan(90 / 2) = 1.
            let ray = at(&camera, 0.0, 0.0, Vec2::ZERO);
            assert!((ray.direction - Vec3::new(-x, y, -1.0)).length() < 1e-6, "{axis} {}", ray.direction);
            assert_eq!((ray.origin, ray.t_max), (Vec3::new(1.0, 2.0, 3.0), f32::INFINITY));
        }
    }

    #[test]
    fn near_and_far_are_depths_along_the_axis() {
        let camera = Camera::new(&camera(r#""near":2,"far":7,"#), Filter::Box, [64, 64]);
        for (x, y) in [(0.0, 0.0), (32.0, 32.0), (63.5, 1.0)] {
            let ray = at(&camera, x, y, Vec2::ZERO);
            assert!((camera.depth(ray.origin) - 2.0).abs() < 1e-5);
            assert!((camera.depth(ray.origin + ray.direction * ray.t_max) - 7.0).abs() < 1e-5);
        }
    }

    #[test]
    fn every_ray_through_the_lens_meets_at_the_plane_in_focus() {
        for (json, focus) in [(r#""lens_radius":0.5,"#, 4.0), (r#""lens_radius":0.5,"focus_distance":9,"#, 9.0)] {
            let camera = Camera::new(&camera(json), Filter::Box, [64, 64]);
            let place = |u_lens| {
                let ray = at(&camera, 10.0, 50.0, u_lens);
                ray.origin + ray.direction * focus
            };
            let sharp = place(Vec2::splat(0.5));
            for u in [Vec2::ZERO, Vec2::X, Vec2::new(0.3, 0.9)] {
                assert!((place(u) - sharp).length() < 1e-5, "{u}");
                assert!((at(&camera, 10.0, 50.0, u).origin - camera.eye).length() <= 0.5 + 1e-6);
            }
        }
    }

    #[test]
    fn parallel_rays_span_the_height_of_the_image() {
        let camera = Camera::new(&camera(r#""type":"orthographic","height":6,"#), Filter::Box, [200, 100]);
        let ray = at(&camera, 0.0, 0.0, Vec2::ZERO);
        assert!((ray.origin - Vec3::new(1.0 - 6.0, 2.0 + 3.0, 3.0)).length() < 1e-5, "{}", ray.origin);
        assert_eq!(ray.direction, Vec3::NEG_Z);
    }

    #[test]
    fn offsets_have_the_variance_of_their_filters() {
        // Box 1/12, tent 1/6, Gaussian cut at 3 sigma: sigma^2 (1 - 4.5 e^-4.5 / (1 - e^-4.5)).
        let cut = (-4.5f64).exp();
        let gaussian = 0.25 * (1.0 - 4.5 * cut / (1.0 - cut));
        for (filter, variance, reach) in
            [(Filter::Box, 1.0 / 12.0, 0.5), (Filter::Tent, 1.0 / 6.0, 1.0), (Filter::Gaussian, gaussian, 1.5)]
        {
            let n = 400;
            let offsets: Vec<Vec2> = (0..n * n)
                .map(|i| filter_offset(filter, Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32))
                .collect();
            let mean =
                |f: &dyn Fn(&Vec2) -> f32| offsets.iter().map(|o| f64::from(f(o))).sum::<f64>() / offsets.len() as f64;
            assert!(mean(&|o| o.x).abs() < 1e-4 && mean(&|o| o.y).abs() < 1e-4);
            assert!((mean(&|o| o.x * o.x) - variance).abs() < 2e-3 * variance, "{filter:?}");
            assert!((mean(&|o| o.y * o.y) - variance).abs() < 2e-3 * variance, "{filter:?}");
            assert!(offsets.iter().all(|o| o.x.abs() <= reach && o.y.abs() <= reach));
        }
    }
}
