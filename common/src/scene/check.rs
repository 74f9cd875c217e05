//! What a scene file must keep beyond its types: ranges, and that everything named exists.

use super::{
    CameraKind, Environment, Image, Light, Material, MaterialKind, MeshSource, SceneFile, Shape, ShapeKind, Texture,
    TextureKind, Vec3,
    parse::{SceneError, nearest},
};
use crate::job::{FieldError, check_resolution};

/// Version of the format that this build reads.
pub const FORMAT_VERSION: u32 = 1;
/// Most triangles a scene file may hold inline.
const MAX_NESTING: usize = 16;

type Check = Result<(), FieldError>;

fn fail(field: impl Into<String>, message: impl Into<String>) -> Check {
    Err(FieldError::new(field, message))
}

impl SceneFile {
    /// Check ranges and references.
    ///
    /// # Errors
    /// The first thing that is wrong, by its path in the file.
    pub fn check(&self) -> Result<(), SceneError> {
        self.check_fields().map_err(SceneError::Field)
    }

    fn check_fields(&self) -> Check {
        if self.tessera != FORMAT_VERSION {
            let message = format!("this build reads version {FORMAT_VERSION} of the format, found {}", self.tessera);
            return fail("tessera", message);
        }
        check_resolution("film", self.film.width, self.film.height)?;
        self.check_camera()?;
        for (name, material) in &self.materials {
            check_material(&format!("materials.{name}"), material)?;
        }
        for (name, shapes) in &self.objects {
            for (i, shape) in shapes.iter().enumerate() {
                self.check_shape(&format!("objects.{name}[{i}]"), shape)?;
            }
            self.check_loop(name, &mut Vec::new())?;
        }
        for (i, shape) in self.shapes.iter().enumerate() {
            self.check_shape(&format!("shapes[{i}]"), shape)?;
        }
        for (i, light) in self.lights.iter().enumerate() {
            check_light(&format!("lights[{i}]"), light)?;
        }
        match &self.environment {
            Some(Environment::Constant(constant)) => light_colour("environment.radiance", constant.radiance.0)?,
            Some(Environment::EnvironmentImage(image)) => {
                relative_path("environment.file", &image.file)?;
                light_colour("environment.scale", image.scale.0)?;
            }
            None => {}
        }
        self.check_animation()?;
        if let Some(quality) = &self.settings.quality {
            quality.validate().map_err(|e| FieldError::new(format!("settings.{}", e.field), e.message))?;
        }
        let method = self.settings.method.clone().resolve();
        method.validate().map_err(|e| FieldError::new(format!("settings.method.{}", e.field), e.message))
    }

    fn check_camera(&self) -> Check {
        let camera = &self.camera;
        finite("camera.position", camera.position)?;
        finite("camera.target", camera.target)?;
        finite("camera.up", camera.up)?;
        let view: Vec3 = std::array::from_fn(|i| camera.target[i] - camera.position[i]);
        if cross_is_zero(view, camera.up) {
            return fail("camera.up", "points along the line of sight, or the camera's target is its position");
        }
        if camera.kind == CameraKind::Perspective && !(camera.fov > 0.0 && camera.fov < 180.0) {
            return fail("camera.fov", format!("{} degrees is not between 0 and 180", camera.fov));
        }
        if camera.kind == CameraKind::Orthographic {
            positive("camera.height", camera.height)?;
        }
        if !(camera.lens_radius.is_finite() && camera.lens_radius >= 0.0) {
            return fail("camera.lens_radius", format!("{} is not 0 or above", camera.lens_radius));
        }
        if let Some(distance) = camera.focus_distance {
            positive("camera.focus_distance", distance)?;
        }
        if !(camera.near.is_finite() && camera.near >= 0.0) {
            return fail("camera.near", format!("{} is not 0 or above", camera.near));
        }
        match camera.far {
            Some(far) if !(far.is_finite() && far > camera.near) => {
                fail("camera.far", format!("{far} is not above camera.near, {}", camera.near))
            }
            _ => Ok(()),
        }
    }

    fn check_shape(&self, path: &str, shape: &Shape) -> Check {
        if let Some(name) = &shape.material
            && !self.materials.contains_key(name)
        {
            let near = nearest(name, self.materials.keys().map(String::as_str));
            let hint = near.map_or(String::new(), |near| format!("; did you mean \"{near}\"?"));
            return fail(format!("{path}.material"), format!("no material \"{name}\"{hint}"));
        }
        if let Some(emission) = &shape.emission {
            check_texture(&format!("{path}.emission"), &emission.radiance, f64::INFINITY)?;
        }
        let affine = shape.transform.affine();
        if !affine.is_finite() || affine.matrix3.determinant() == 0.0 {
            return fail(format!("{path}.transform"), "flattens the shape or is not finite");
        }
        match &shape.kind {
            ShapeKind::Sphere(sphere) => {
                finite(&format!("{path}.center"), sphere.center)?;
                positive(&format!("{path}.radius"), sphere.radius)
            }
            ShapeKind::Disk(disk) => {
                finite(&format!("{path}.center"), disk.center)?;
                finite(&format!("{path}.normal"), disk.normal)?;
                if disk.normal == [0.0; 3] {
                    return fail(format!("{path}.normal"), "has no direction");
                }
                positive(&format!("{path}.radius"), disk.radius)
            }
            ShapeKind::Quad(quad) => {
                for (i, vertex) in quad.vertices.iter().enumerate() {
                    finite(&format!("{path}.vertices[{i}]"), *vertex)?;
                }
                Ok(())
            }
            ShapeKind::Mesh(mesh) => check_mesh(path, &mesh.source),
            ShapeKind::Instance(instance) => {
                if self.objects.contains_key(&instance.object) {
                    return Ok(());
                }
                let near = nearest(&instance.object, self.objects.keys().map(String::as_str));
                let hint = near.map_or(String::new(), |near| format!("; did you mean \"{near}\"?"));
                fail(format!("{path}.object"), format!("no object \"{}\"{hint}", instance.object))
            }
        }
    }

    /// Refuse an object that holds itself, at any depth.
    fn check_loop<'a>(&'a self, name: &'a str, above: &mut Vec<&'a str>) -> Check {
        if above.contains(&name) {
            return fail(format!("objects.{name}"), format!("holds itself: {} -> {name}", above.join(" -> ")));
        }
        if above.len() >= MAX_NESTING {
            return fail(format!("objects.{name}"), format!("nests deeper than {MAX_NESTING} levels"));
        }
        above.push(name);
        for shape in self.objects.get(name).into_iter().flatten() {
            if let ShapeKind::Instance(instance) = &shape.kind {
                self.check_loop(&instance.object, above)?;
            }
        }
        above.pop();
        Ok(())
    }

    fn check_animation(&self) -> Check {
        let Some(animation) = &self.animation else { return Ok(()) };
        let ascending = |field: String, frames: &mut dyn Iterator<Item = f64>| {
            let mut last = f64::NEG_INFINITY;
            for frame in frames {
                if frame.is_nan() || frame <= last {
                    return fail(field, format!("key at frame {frame} does not come after the one before"));
                }
                last = frame;
            }
            Ok(())
        };
        ascending("animation.camera".into(), &mut animation.camera.iter().map(|key| key.frame))?;
        for (name, keys) in &animation.shapes {
            let field = format!("animation.shapes.{name}");
            if !self.shapes.iter().any(|shape| shape.name.as_deref() == Some(name)) {
                return fail(field, format!("no shape is named \"{name}\""));
            }
            ascending(field, &mut keys.iter().map(|key| key.frame))?;
        }
        Ok(())
    }

    /// Relative paths of all files that the scene itself names, with the fields that name them.
    #[must_use]
    pub fn files(&self) -> Vec<(String, String)> {
        let mut found = Vec::new();
        let textured = |path: String, texture: &Texture, found: &mut Vec<(String, String)>| {
            if let Texture::Mapped(kind) = texture
                && let TextureKind::Image(Image { file, .. }) = kind.as_ref()
            {
                found.push((format!("{path}.file"), file.clone()));
            }
        };
        for (name, material) in &self.materials {
            let path = format!("materials.{name}");
            for (field, texture) in material.textures() {
                textured(format!("{path}.{field}"), texture, &mut found);
            }
            if let Some(map) = &material.normal_map {
                found.push((format!("{path}.normal_map.file"), map.file.clone()));
            }
        }
        let objects = self.objects.iter().flat_map(|(name, shapes)| {
            shapes.iter().enumerate().map(move |(i, shape)| (format!("objects.{name}[{i}]"), shape))
        });
        let shapes = self.shapes.iter().enumerate().map(|(i, shape)| (format!("shapes[{i}]"), shape));
        for (path, shape) in objects.chain(shapes) {
            if let ShapeKind::Mesh(mesh) = &shape.kind
                && let MeshSource::File { file } = &mesh.source
            {
                found.push((format!("{path}.file"), file.clone()));
            }
            if let Some(emission) = &shape.emission {
                textured(format!("{path}.emission.radiance"), &emission.radiance, &mut found);
            }
        }
        if let Some(Environment::EnvironmentImage(image)) = &self.environment {
            found.push(("environment.file".into(), image.file.clone()));
        }
        found
    }
}

impl Material {
    /// Every texture of the material with the name of its field.
    #[must_use]
    pub fn textures(&self) -> Vec<(&'static str, &Texture)> {
        let mut found = match &self.kind {
            MaterialKind::Diffuse(m) => vec![("reflectance", &m.reflectance)],
            MaterialKind::Mirror(m) => vec![("reflectance", &m.reflectance)],
            MaterialKind::Dielectric(m) => {
                vec![("reflectance", &m.reflectance), ("transmittance", &m.transmittance)]
            }
            MaterialKind::Conductor(m) => vec![("reflectance", &m.reflectance)],
            MaterialKind::Plastic(m) => vec![("reflectance", &m.reflectance)],
            MaterialKind::Phong(m) => vec![("reflectance", &m.reflectance)],
            MaterialKind::BlinnPhong(m) => vec![("reflectance", &m.reflectance)],
            MaterialKind::BlinnMicrofacet(m) => vec![("reflectance", &m.reflectance)],
            MaterialKind::MetallicRoughness(m) => {
                vec![("base_color", &m.base_color), ("metallic", &m.metallic), ("roughness", &m.roughness)]
            }
        };
        if let Some(opacity) = &self.opacity {
            found.push(("opacity", opacity));
        }
        found
    }
}

fn check_material(path: &str, material: &Material) -> Check {
    for (field, texture) in material.textures() {
        check_texture(&format!("{path}.{field}"), texture, 1.0)?;
    }
    if let Some(map) = &material.normal_map {
        relative_path(&format!("{path}.normal_map.file"), &map.file)?;
    }
    let roughness = |value: super::Roughness| {
        let alphas = value.alphas();
        if alphas.iter().all(|a| (0.0..=1.0).contains(a)) {
            Ok(())
        } else {
            fail(format!("{path}.roughness"), format!("{alphas:?} is not within 0 to 1"))
        }
    };
    let exponent = |value: f64| {
        if value.is_finite() && value >= 0.0 {
            Ok(())
        } else {
            fail(format!("{path}.exponent"), format!("{value} is not 0 or above"))
        }
    };
    match &material.kind {
        MaterialKind::Dielectric(m) => {
            positive(&format!("{path}.ior"), m.ior)?;
            positive(&format!("{path}.exterior_ior"), m.exterior_ior)?;
            roughness(m.roughness)
        }
        MaterialKind::Conductor(m) => {
            if m.eta.is_some() != m.k.is_some() {
                return fail(format!("{path}.eta"), "eta and k go together");
            }
            if m.eta.is_some() && m.metal.is_some() {
                return fail(format!("{path}.metal"), "give the metal's name or eta and k, not both");
            }
            for (field, value) in [("eta", m.eta), ("k", m.k)] {
                if let Some(value) = value {
                    light_colour(&format!("{path}.{field}"), value.0)?;
                }
            }
            roughness(m.roughness)
        }
        MaterialKind::Plastic(m) => {
            positive(&format!("{path}.ior"), m.ior)?;
            roughness(m.roughness)
        }
        MaterialKind::MetallicRoughness(m) => positive(&format!("{path}.ior"), m.ior),
        MaterialKind::Phong(m) => exponent(m.exponent),
        MaterialKind::BlinnPhong(m) => exponent(m.exponent),
        MaterialKind::BlinnMicrofacet(m) => exponent(m.exponent),
        MaterialKind::Diffuse(_) | MaterialKind::Mirror(_) => Ok(()),
    }
}

fn check_texture(path: &str, texture: &Texture, most: f64) -> Check {
    let colour = |path: String, value: [f64; 3]| {
        if value.iter().all(|c| c.is_finite() && (0.0..=most).contains(c)) {
            Ok(())
        } else if most.is_finite() {
            fail(path, format!("{value:?} is not within 0 to {most}"))
        } else {
            fail(path, format!("{value:?} is not finite and 0 or above"))
        }
    };
    match texture {
        Texture::Constant(rgb) => colour(path.into(), rgb.0),
        Texture::Mapped(kind) => match kind.as_ref() {
            TextureKind::Image(image) => {
                relative_path(&format!("{path}.file"), &image.file)?;
                light_colour(&format!("{path}.scale"), image.scale.0)
            }
            TextureKind::Checkerboard(squares) => {
                colour(format!("{path}.color0"), squares.color0.0)?;
                colour(format!("{path}.color1"), squares.color1.0)
            }
        },
    }
}

fn check_mesh(path: &str, source: &MeshSource) -> Check {
    match source {
        MeshSource::File { file } => relative_path(&format!("{path}.file"), file),
        MeshSource::Inline { positions, triangles, vertex_normals, uvs } => {
            for (field, length) in [("vertex_normals", vertex_normals.len()), ("uvs", uvs.len())] {
                if length != 0 && length != positions.len() {
                    let message = format!("{length} entries for {} positions", positions.len());
                    return fail(format!("{path}.{field}"), message);
                }
            }
            for (i, triangle) in triangles.iter().enumerate() {
                if let Some(index) = triangle.iter().find(|&&index| index as usize >= positions.len()) {
                    let message = format!("index {index} is past the {} positions", positions.len());
                    return fail(format!("{path}.triangles[{i}]"), message);
                }
            }
            Ok(())
        }
    }
}

fn check_light(path: &str, light: &Light) -> Check {
    match light {
        Light::Point(point) => {
            finite(&format!("{path}.position"), point.position)?;
            light_colour(&format!("{path}.intensity"), point.intensity.0)
        }
        Light::Spot(spot) => {
            finite(&format!("{path}.position"), spot.position)?;
            finite(&format!("{path}.target"), spot.target)?;
            if spot.position == spot.target {
                return fail(format!("{path}.target"), "is the light's own position");
            }
            if !(spot.cutoff_angle > 0.0 && spot.cutoff_angle <= 180.0) {
                let message = format!("{} degrees is not above 0 and at most 180", spot.cutoff_angle);
                return fail(format!("{path}.cutoff_angle"), message);
            }
            if !(0.0..=spot.cutoff_angle).contains(&spot.beam_angle) {
                let message = format!("{} degrees is not within 0 to cutoff_angle", spot.beam_angle);
                return fail(format!("{path}.beam_angle"), message);
            }
            light_colour(&format!("{path}.intensity"), spot.intensity.0)
        }
        Light::Directional(light) => {
            finite(&format!("{path}.direction"), light.direction)?;
            if light.direction == [0.0; 3] {
                return fail(format!("{path}.direction"), "has no direction");
            }
            light_colour(&format!("{path}.irradiance"), light.irradiance.0)
        }
    }
}

/// No path from a scene leaves the scene's folder.
fn relative_path(field: &str, path: &str) -> Check {
    let unsafe_part = |part: &str| part.is_empty() || part == ".." || part.contains(':');
    if path.is_empty() || path.contains('\\') || path.contains('\0') || path.split('/').any(unsafe_part) {
        return fail(field, format!("\"{path}\" is not a relative path inside the scene's folder"));
    }
    Ok(())
}

fn finite(field: &str, value: Vec3) -> Check {
    if value.iter().all(|c| c.is_finite() && c.abs() <= 1e30) {
        return Ok(());
    }
    fail(field, format!("{value:?} is not finite and below 1e30"))
}

fn positive(field: &str, value: f64) -> Check {
    if value.is_finite() && value > 0.0 { Ok(()) } else { fail(field, format!("{value} is not a positive number")) }
}

fn light_colour(field: &str, value: [f64; 3]) -> Check {
    if value.iter().all(|c| c.is_finite() && *c >= 0.0) {
        return Ok(());
    }
    fail(field, format!("{value:?} is not finite and 0 or above"))
}

fn cross_is_zero(a: Vec3, b: Vec3) -> bool {
    let cross = glam::DVec3::from_array(a).cross(glam::DVec3::from_array(b));
    cross.length_squared()
        <= 1e-24 * glam::DVec3::from_array(a).length_squared() * glam::DVec3::from_array(b).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Replace one part of a good scene and tell the error.
    fn error(from: &str, to: &str) -> String {
        let good = r#"{"tessera":1,"camera":{"position":[0,0,5],"target":[0,0,0],"fov":40},"film":{"width":8,"height":8},
            "materials":{"white":{"type":"diffuse","reflectance":0.7},"glass":{"type":"dielectric","ior":1.5}},
            "shapes":[{"type":"sphere","radius":1,"material":"white","emission":[1,1,1]},
                      {"type":"mesh","file":"a/b.obj"},
                      {"type":"mesh","positions":[[0,0,0],[1,0,0],[0,1,0]],"triangles":[[0,1,2]]}],
            "lights":[{"type":"point","position":[0,1,0],"intensity":1}]}"#;
        SceneFile::parse(good.as_bytes()).expect("the scene is good before it is spoilt");
        assert!(good.contains(from), "{from}");
        SceneFile::parse(good.replace(from, to).as_bytes()).expect_err(to).to_string()
    }

    #[test]
    fn errors_name_the_place_and_what_was_expected() {
        for (from, to, expected) in [
            (r#""tessera":1"#, r#""tessera":2"#, "tessera: this build reads version 1"),
            (r#""radius":1"#, r#""radius":"x""#, "shapes[0].radius: invalid type: string \"x\", expected f64"),
            (r#""radius":1"#, r#""radius":0"#, "shapes[0].radius: 0 is not a positive number"),
            (r#""radius":1"#, r#""radios":1"#, "shapes[0].radios: unknown field `radios`"),
            (
                r#""material":"white""#,
                r#""material":"whte""#,
                "shapes[0].material: no material \"whte\"; did you mean \"white\"?",
            ),
            (r#""type":"sphere""#, r#""type":"spere""#, "shapes[0].type: unknown type \"spere\""),
            (r#""type":"sphere","#, "", "shapes[0]: missing field `type`"),
            (
                r#""reflectance":0.7"#,
                r#""reflectance":1.5"#,
                "materials.white.reflectance: [1.5, 1.5, 1.5] is not within 0 to 1",
            ),
            (r#""reflectance":0.7"#, r#""reflectance":"red""#, "materials.white.reflectance: expected a colour"),
            (r#""emission":[1,1,1]"#, r#""emission":[1,1]"#, "shapes[0].emission: expected a colour"),
            (r#""fov":40"#, r#""fov":180"#, "camera.fov: 180 degrees"),
            (r#""fov":40"#, r#""fow":40"#, "camera.fow: unknown field `fow`"),
            (r#""width":8"#, r#""width":1000000"#, "film: 1000000x8 is not within"),
            (r#""width":8"#, r#""width":-8"#, "film.width: invalid value: integer `-8`"),
            (r#"a/b.obj"#, r#"../b.obj"#, "shapes[1].file: \"../b.obj\" is not a relative path"),
            (r#"a/b.obj"#, r#"/etc/passwd"#, "shapes[1].file"),
            (r#"[[0,1,2]]"#, r#"[[0,1,3]]"#, "shapes[2].triangles[0]: index 3 is past the 3 positions"),
            (r#""position":[0,0,5]"#, r#""position":[0,0,0]"#, "camera.up"),
            (r#""intensity":1"#, r#""intensity":-1"#, "lights[0].intensity"),
            (r#""intensity":1"#, r#""watts":1"#, "lights[0].watts: unknown field `watts`"),
        ] {
            let found = error(from, to);
            assert!(found.starts_with(expected), "{to}\n found {found}\n expected {expected}");
        }
    }

    #[test]
    fn text_that_is_not_json_says_where() {
        let error = SceneFile::parse(b"{\"tessera\":1,").unwrap_err().to_string();
        assert!(error.contains("not valid JSON") && error.contains("line 1"), "{error}");
        assert!(SceneFile::parse(b"").is_err());
    }

    #[test]
    fn an_object_that_holds_itself_is_refused() {
        let text = r#"{"tessera":1,"camera":{"position":[0,0,5],"target":[0,0,0]},
            "objects":{"a":[{"type":"instance","object":"b"}],"b":[{"type":"instance","object":"a"}]}}"#;
        let error = SceneFile::parse(text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains("holds itself"), "{error}");
    }

    #[test]
    fn a_scene_survives_writing_and_reading() {
        let text = r#"{"tessera":1,"camera":{"position":[0,0,5],"target":[0,0,0]},
            "materials":{"m":{"type":"metallic_roughness","metallic":{"type":"image","file":"m.png","linear":true},
                         "two_sided":false,"opacity":0.5}},
            "shapes":[{"type":"quad","vertices":[[0,0,0],[1,0,0],[1,1,0],[0,1,0]],"material":"m",
                       "emission":{"radiance":[1,2,3],"two_sided":true},"transform":[{"translate":[1,2,3]}]}],
            "environment":{"type":"image","file":"sky.exr"}}"#;
        let scene = SceneFile::parse(text.as_bytes()).unwrap();
        let again = SceneFile::parse(&serde_json::to_vec(&scene).unwrap()).unwrap();
        assert_eq!(scene, again);
        let files: Vec<String> = scene.files().into_iter().map(|(_, file)| file).collect();
        assert_eq!(files, ["m.png", "sky.exr"]);
    }
}
