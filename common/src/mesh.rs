//! Triangle meshes and pictures in memory: what importers make and the tracer takes.

use crate::scene::{Material, Rgb};

/// An indexed triangle mesh in object space.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Three vertex indices a triangle, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Shading normals, one a vertex, or empty: then the triangles are flat.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, one a vertex, or empty. v grows upwards.
    pub uvs: Vec<[f32; 2]>,
}

/// A part of an imported file: a mesh and the material the file gives it.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshPart {
    /// The triangles.
    pub mesh: Mesh,
    /// The file's own material, used where the scene names none.
    pub material: Option<Material>,
    /// Radiance the file's material emits (MTL `Ke`), linear RGB; black for none.
    pub emission: Rgb,
}

/// A decoded picture, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// RGBA per pixel, as stored: `encoding` says what the colour values mean. Alpha is linear.
    pub pixels: Vec<[f32; 4]>,
    /// How the file encodes colour.
    pub encoding: Encoding,
}

/// What the numbers of a picture file mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// sRGB transfer curve, scaled to 0..1 (PNG, JPEG).
    Srgb,
    /// Linear light (EXR, HDR).
    Linear,
}
