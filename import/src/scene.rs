//! A bare mesh into a scene: a camera that frames it, and a light.

use common::scene::{
    Camera, CameraKind, Constant, Disk, Emission, Environment, FilmSettings, FovAxis, Mesh, MeshSource, Normals, Rgb,
    SceneFile, Settings, Shape, ShapeKind, Texture,
};
use glam::DVec3;

use crate::Imported;

/// Where the camera stands, seen from the mesh: in front, to the right and above.
const VIEW: DVec3 = DVec3::new(0.45, 0.35, 1.0);
/// Full angle of view, degrees.
const FOV: f64 = 36.0;
/// Room around the mesh in the image.
const MARGIN: f64 = 1.06;
/// Where the lamp hangs, seen from the mesh: to the left of the camera and above.
const LAMP: DVec3 = DVec3::new(-0.6, 1.0, 0.7);
/// Irradiance that the lamp gives the middle of the mesh, on a surface that faces it.
const LAMP_IRRADIANCE: f64 = 4.0;
/// Radiance of the surroundings.
const SKY: f64 = 0.12;

/// A scene of one mesh file: a camera whose image holds all of it, and a lamp above with a dim sky, unless
/// the file's materials emit light themselves. The scene's description says what was made up.
///
/// `path` is the mesh file's, relative to the scene's folder.
#[must_use]
pub fn scene_from_mesh(path: &str, imported: &Imported) -> SceneFile {
    let (low, high) = bounds(imported);
    let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
    // A mesh without extent still needs a camera at some distance.
    let radius = Some(half.length()).filter(|r| *r > 0.0).unwrap_or(1.0);
    let camera = camera(centre, half, radius);

    let mut shapes = vec![Shape::from(ShapeKind::Mesh(Mesh {
        source: MeshSource::File { file: path.to_owned() },
        normals: Normals::Given,
    }))];
    let shines = imported.parts.iter().any(|part| !part.emission.is_black());
    let light = if shines {
        "The light is that of its materials."
    } else {
        shapes.push(lamp(centre, radius));
        "It has no light: a disk lamp above and a dim sky are added."
    };
    SceneFile {
        tessera: 1,
        name: path.rsplit('/').next().unwrap_or(path).to_owned(),
        description: format!("Made from {path}, which has no camera: one that frames it is added. {light}"),
        camera,
        film: FilmSettings::default(),
        materials: Default::default(),
        objects: Default::default(),
        shapes,
        lights: Vec::new(),
        environment: (!shines).then(|| Environment::Constant(Constant { radiance: Rgb::grey(SKY) })),
        animation: None,
        settings: Settings::default(),
        assets: Default::default(),
    }
}

/// The box around all vertices.
fn bounds(imported: &Imported) -> (DVec3, DVec3) {
    let points =
        imported.parts.iter().flat_map(|part| &part.mesh.positions).map(|p| DVec3::from_array(p.map(f64::from)));
    points
        .map(|p| (p, p))
        .reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))
        .unwrap_or((DVec3::NEG_ONE, DVec3::ONE))
}

/// As near as the box's corners allow.
fn camera(centre: DVec3, half: DVec3, radius: f64) -> Camera {
    let back = VIEW.normalize();
    let right = DVec3::Y.cross(back).normalize();
    let up = back.cross(right);
    let slope = libm::tan((FOV / 2.0).to_radians());
    let corners = (0..8).map(|i| {
        let sign = |bit: u32| if i & bit == 0 { -1.0 } else { 1.0 };
        half * DVec3::new(sign(1), sign(2), sign(4))
    });
    // A corner at height h above the axis and depth z towards the camera is seen below the angle's half
    // when h <= slope (distance - z).
    let needed = |corner: DVec3| MARGIN * corner.dot(right).abs().max(corner.dot(up).abs()) / slope + corner.dot(back);
    let distance = corners.map(needed).fold(radius * 1e-3, f64::max);
    Camera {
        kind: CameraKind::Perspective,
        position: (centre + back * distance.max(radius * 0.5)).to_array(),
        target: centre.to_array(),
        up: [0.0, 1.0, 0.0],
        fov: FOV,
        fov_axis: FovAxis::Smaller,
        height: 2.0,
        near: 0.0,
        far: None,
        lens_radius: 0.0,
        focus_distance: None,
    }
}

fn lamp(centre: DVec3, radius: f64) -> Shape {
    let (direction, distance) = (LAMP.normalize(), 4.0 * radius);
    let disk = Disk { center: (centre + direction * distance).to_array(), normal: (-direction).to_array(), radius };
    // On its axis a disk gives pi L sin^2 of the angle it is seen under.
    let sine_squared = radius * radius / (radius * radius + distance * distance);
    let radiance = Texture::grey(LAMP_IRRADIANCE / (std::f64::consts::PI * sine_squared));
    Shape {
        name: Some("lamp".into()),
        emission: Some(Emission { radiance, two_sided: false }),
        ..Shape::from(ShapeKind::Disk(disk))
    }
}
