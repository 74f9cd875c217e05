//! Transforms as lists of steps, and their matrices.

use glam::{DAffine3, DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Vec3;

/// Steps applied in the order written: the first acts first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Transform(pub Vec<Step>);

/// One step of a transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// Multiply the coordinates.
    Scale(Vec3),
    /// Turn about an axis through the origin.
    Rotate(Rotate),
    /// Move.
    Translate(Vec3),
    /// Any affine map: three rows of four numbers, the last column moves.
    Matrix([[f64; 4]; 3]),
}

/// A rotation about an axis through the origin, counter-clockwise seen against the axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rotate {
    /// Direction of the axis.
    pub axis: Vec3,
    /// Angle in degrees.
    pub degrees: f64,
}

impl Transform {
    /// Whether there is nothing to do.
    #[must_use]
    pub fn is_identity(&self) -> bool {
        self.0.is_empty()
    }

    /// The steps as one affine map. Sines and cosines come from one pure-Rust implementation, so that
    /// the map has the same bits on every machine.
    #[must_use]
    pub fn affine(&self) -> DAffine3 {
        self.0.iter().fold(DAffine3::IDENTITY, |done, step| step.affine() * done)
    }
}

impl Step {
    fn affine(&self) -> DAffine3 {
        match self {
            Step::Scale(scale) => DAffine3::from_scale(DVec3::from_array(*scale)),
            Step::Translate(by) => DAffine3::from_translation(DVec3::from_array(*by)),
            Step::Matrix(rows) => {
                let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
                DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3))
            }
            Step::Rotate(Rotate { axis, degrees }) => {
                let (sin, cos) = libm::sincos(degrees.to_radians());
                let a = DVec3::from_array(*axis).normalize_or_zero();
                // Rodrigues: R v = v cos + (a x v) sin + a (a.v)(1 - cos)
                let column = |v: DVec3| v * cos + a.cross(v) * sin + a * (a.dot(v) * (1.0 - cos));
                DAffine3::from_mat3(DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_act_in_the_order_written() {
        let transform: Transform = serde_json::from_str(
            r#"[{"scale":[2,2,2]},{"rotate":{"axis":[0,0,1],"degrees":90}},{"translate":[10,0,0]}]"#,
        )
        .unwrap();
        let moved = transform.affine().transform_point3(DVec3::X);
        assert!((moved - DVec3::new(10.0, 2.0, 0.0)).length() < 1e-12, "{moved}");
    }

    #[test]
    fn a_matrix_is_written_by_rows() {
        let transform: Transform = serde_json::from_str(r#"[{"matrix":[[0,-1,0,5],[1,0,0,6],[0,0,1,7]]}]"#).unwrap();
        let moved = transform.affine().transform_point3(DVec3::X);
        assert_eq!(moved, DVec3::new(5.0, 7.0, 7.0));
    }
}
