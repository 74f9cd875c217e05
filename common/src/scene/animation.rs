//! Keyframes, and the scene at one frame.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Camera, SceneFile, Step, Transform, Vec3};

/// Movement over frames. Between keys values go linearly; before the first and after the last they stay.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Animation {
    /// Keys of the camera, by ascending frame.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera: Vec<CameraKey>,
    /// Keys of shapes, by the shape's name, by ascending frame. They act after the shape's own transform.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub shapes: BTreeMap<String, Vec<TransformKey>>,
}

/// The camera at a frame; what is absent stays as the camera has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraKey {
    /// Frame number.
    pub frame: f64,
    /// The eye.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<Vec3>,
    /// A point in the middle of the image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<Vec3>,
    /// Angle of view, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fov: Option<f64>,
    /// Distance of the plane in focus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focus_distance: Option<f64>,
}

/// A shape's movement at a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TransformKey {
    /// Frame number.
    pub frame: f64,
    /// Moved by this much.
    #[serde(default)]
    pub translate: Vec3,
    /// Turned about this axis through the origin, before it is moved.
    #[serde(default = "y_axis")]
    pub axis: Vec3,
    /// By this angle, degrees.
    #[serde(default)]
    pub degrees: f64,
    /// Scaled, before it is turned.
    #[serde(default = "ones")]
    pub scale: Vec3,
}

fn y_axis() -> Vec3 {
    [0.0, 1.0, 0.0]
}

fn ones() -> Vec3 {
    [1.0; 3]
}

impl SceneFile {
    /// The scene as it stands at `frame`: keyframes applied and removed.
    #[must_use]
    pub fn at_frame(&self, frame: u32) -> SceneFile {
        let mut scene = self.clone();
        let Some(animation) = scene.animation.take() else { return scene };
        let frame = f64::from(frame);
        animate_camera(&mut scene.camera, &animation.camera, frame);
        for shape in &mut scene.shapes {
            let Some(keys) = shape.name.as_ref().and_then(|name| animation.shapes.get(name)) else { continue };
            if let Some((a, b, t)) = around(keys, |key| key.frame, frame) {
                shape.transform.0.extend(between(a, b, t).0);
            }
        }
        scene
    }
}

fn animate_camera(camera: &mut Camera, keys: &[CameraKey], frame: f64) {
    /// Interpolate one value over the keys that have it.
    fn value<T: Copy>(
        keys: &[CameraKey],
        frame: f64,
        get: impl Fn(&CameraKey) -> Option<T>,
        mix: impl Fn(T, T, f64) -> T,
    ) -> Option<T> {
        let present: Vec<(f64, T)> = keys.iter().filter_map(|key| get(key).map(|v| (key.frame, v))).collect();
        around(&present, |key| key.0, frame).map(|(a, b, t)| mix(a.1, b.1, t))
    }
    if let Some(position) = value(keys, frame, |key| key.position, mix3) {
        camera.position = position;
    }
    if let Some(target) = value(keys, frame, |key| key.target, mix3) {
        camera.target = target;
    }
    if let Some(fov) = value(keys, frame, |key| key.fov, mix) {
        camera.fov = fov;
    }
    if let Some(distance) = value(keys, frame, |key| key.focus_distance, mix) {
        camera.focus_distance = Some(distance);
    }
}

/// The keys before and after `frame`, and how far between them it is.
fn around<K>(keys: &[K], at: impl Fn(&K) -> f64, frame: f64) -> Option<(&K, &K, f64)> {
    let after = keys.partition_point(|key| at(key) <= frame);
    let a = keys.get(after.saturating_sub(1))?;
    let b = keys.get(after).unwrap_or(a);
    let span = at(b) - at(a);
    Some((a, b, if span > 0.0 { ((frame - at(a)) / span).clamp(0.0, 1.0) } else { 0.0 }))
}

fn between(a: &TransformKey, b: &TransformKey, t: f64) -> Transform {
    Transform(vec![
        Step::Scale(mix3(a.scale, b.scale, t)),
        Step::Rotate(super::Rotate { axis: mix3(a.axis, b.axis, t), degrees: mix(a.degrees, b.degrees, t) }),
        Step::Translate(mix3(a.translate, b.translate, t)),
    ])
}

fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

fn mix3(a: Vec3, b: Vec3, t: f64) -> Vec3 {
    std::array::from_fn(|i| mix(a[i], b[i], t))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(animation: &str) -> SceneFile {
        let text = format!(
            r#"{{"tessera":1,"camera":{{"position":[0,0,0],"target":[0,0,-1]}},
                "shapes":[{{"type":"sphere","name":"ball"}}],"animation":{animation}}}"#
        );
        SceneFile::parse(text.as_bytes()).unwrap()
    }

    #[test]
    fn the_camera_goes_linearly_between_keys_and_stays_outside_them() {
        let scene = scene(r#"{"camera":[{"frame":1,"position":[0,0,0]},{"frame":11,"position":[10,0,0],"fov":60}]}"#);
        for (frame, x) in [(0, 0.0), (1, 0.0), (6, 5.0), (11, 10.0), (50, 10.0)] {
            assert_eq!(scene.at_frame(frame).camera.position[0], x, "frame {frame}");
        }
        assert_eq!(scene.at_frame(5).camera.fov, 60.0, "a value with one key is that value");
        assert_eq!(scene.at_frame(5).camera.target, [0.0, 0.0, -1.0]);
    }

    #[test]
    fn a_named_shape_moves() {
        let scene = scene(r#"{"shapes":{"ball":[{"frame":0},{"frame":4,"translate":[4,0,0],"degrees":90}]}}"#);
        let at = |frame| scene.at_frame(frame).shapes[0].transform.affine().transform_point3(glam::DVec3::ZERO).x;
        assert_eq!([at(0), at(1), at(4)], [0.0, 1.0, 4.0]);
        assert!(scene.at_frame(1).animation.is_none());
    }
}
