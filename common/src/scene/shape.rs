//! Shapes, as written in a scene file.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use super::{Texture, Transform, Vec3, parse::tagged};

/// A shape with its place, material and light.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Shape {
    /// The geometry, told by `type`.
    #[serde(flatten)]
    pub kind: ShapeKind,
    /// Its name, for animation and messages.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Name of its material. Absent: the mesh file's own, else diffuse grey 0.5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// Light it gives. Absent: the mesh file's own, else none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission: Option<Emission>,
    /// From its own space to the world.
    #[serde(default, skip_serializing_if = "Transform::is_identity")]
    pub transform: Transform,
}

impl<'de> Deserialize<'de> for Shape {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        struct Common {
            #[serde(default)]
            name: Option<String>,
            #[serde(default)]
            material: Option<String>,
            #[serde(default)]
            emission: Option<Emission>,
            #[serde(default)]
            transform: Transform,
        }
        let mut map = serde_json::Map::deserialize(deserializer)?;
        let mut common = serde_json::Map::new();
        for key in ["name", "material", "emission", "transform"] {
            if let Some((key, value)) = map.remove_entry(key) {
                common.insert(key, value);
            }
        }
        let kind = ShapeKind::from_map(map)?;
        let Common { name, material, emission, transform } = super::nested(common)?;
        Ok(Self { kind, name, material, emission, transform })
    }
}

impl From<ShapeKind> for Shape {
    fn from(kind: ShapeKind) -> Self {
        Self { kind, name: None, material: None, emission: None, transform: Transform::default() }
    }
}

tagged!(
    /// The kinds of geometry.
    ShapeKind {
        /// Triangles, from a file or inline.
        Mesh = "mesh",
        /// A sphere.
        Sphere = "sphere",
        /// Four corners of a flat, convex quadrilateral.
        Quad = "quad",
        /// A disk.
        Disk = "disk",
        /// A group of shapes once more.
        Instance = "instance",
    }
);

/// Triangles: either `file`, or `positions` and `triangles`.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Mesh {
    /// Where the triangles are.
    #[serde(flatten)]
    pub source: MeshSource,
    /// Shading normals.
    #[serde(default)]
    pub normals: Normals,
}

impl<'de> Deserialize<'de> for Mesh {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Flat {
            #[serde(default)]
            file: Option<String>,
            #[serde(default)]
            positions: Option<Vec<Vec3>>,
            #[serde(default)]
            triangles: Vec<[u32; 3]>,
            #[serde(default)]
            vertex_normals: Vec<Vec3>,
            #[serde(default)]
            uvs: Vec<[f64; 2]>,
            #[serde(default)]
            normals: Normals,
        }
        let Flat { file, positions, triangles, vertex_normals, uvs, normals } = Flat::deserialize(deserializer)?;
        let source = match (file, positions) {
            (Some(file), None) if triangles.is_empty() && vertex_normals.is_empty() && uvs.is_empty() => {
                MeshSource::File { file }
            }
            (None, Some(positions)) => MeshSource::Inline { positions, triangles, vertex_normals, uvs },
            _ => return Err(serde::de::Error::custom("a mesh has either `file`, or `positions` and `triangles`")),
        };
        Ok(Self { source, normals })
    }
}

/// Where the triangles of a mesh are.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum MeshSource {
    /// In a file.
    File {
        /// Relative path of an OBJ or PLY file.
        file: String,
    },
    /// In the scene file.
    Inline {
        /// Vertex positions.
        positions: Vec<Vec3>,
        /// Three vertex indices a triangle, counter-clockwise seen from the front.
        triangles: Vec<[u32; 3]>,
        /// Shading normals, one a vertex, or none.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        vertex_normals: Vec<Vec3>,
        /// Texture coordinates, one a vertex, or none.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        uvs: Vec<[f64; 2]>,
    },
}

/// Which shading normals a mesh gets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Normals {
    /// Those given; flat where none are.
    #[default]
    Given,
    /// Those of the triangles themselves.
    Flat,
    /// Averages over the triangles at a vertex, weighted by angle.
    Smooth,
}

/// A sphere; its front is outside.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sphere {
    /// Centre.
    #[serde(default)]
    pub center: Vec3,
    /// Radius, above 0.
    #[serde(default = "one")]
    pub radius: f64,
}

/// Four corners of a flat, convex quadrilateral; its front is where they run counter-clockwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Quad {
    /// Corners in order around the edge.
    pub vertices: [Vec3; 4],
}

/// A disk; its front is where `normal` points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Disk {
    /// Centre.
    #[serde(default)]
    pub center: Vec3,
    /// Direction of the front.
    #[serde(default = "z_axis")]
    pub normal: Vec3,
    /// Radius, above 0.
    #[serde(default = "one")]
    pub radius: f64,
}

/// A group of shapes once more, at `transform`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// Name of the group in `objects`.
    pub object: String,
}

fn one() -> f64 {
    1.0
}

fn z_axis() -> Vec3 {
    [0.0, 0.0, 1.0]
}

/// Light that a surface gives: a radiance, or an object with more to say.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Emission {
    /// Emitted radiance.
    pub radiance: Texture,
    /// Whether the back shines too.
    #[serde(default)]
    pub two_sided: bool,
}

impl<'de> Deserialize<'de> for Emission {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Full {
            radiance: Texture,
            #[serde(default)]
            two_sided: bool,
        }
        use serde::de::Error;
        match serde_json::Value::deserialize(deserializer)? {
            serde_json::Value::Object(map) => {
                let Full { radiance, two_sided } = super::nested(map)?;
                Ok(Self { radiance, two_sided })
            }
            plain => {
                let radiance = serde_json::from_value(plain).map(Texture::Constant).map_err(D::Error::custom)?;
                Ok(Self { radiance, two_sided: false })
            }
        }
    }
}
