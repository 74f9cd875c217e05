//! Other formats into Tessera's own: mesh files into triangles and materials, a bare mesh into a scene.
//!
//! Pure functions over bytes and a resolver. This crate opens no file and knows nothing of HTTP, async
//! runtimes or the tracer. Whatever the bytes are, an answer is a value or one clear error: no panic, and
//! no more memory than a small multiple of the input.

mod mtl;
mod obj;
mod path;
mod ply;
mod scene;

pub use scene::scene_from_mesh;

use common::mesh::MeshPart;

/// Finds a file by its path relative to the scene's folder; `None` where there is none.
pub type Resolve<'a> = dyn FnMut(&str) -> Option<Vec<u8>> + 'a;

/// Extensions of the mesh files that [`mesh`] reads, lower case.
pub const MESH_EXTENSIONS: &[&str] = &["obj", "ply"];

/// What a mesh file held.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Imported {
    /// The triangles, one part for each material.
    pub parts: Vec<MeshPart>,
    /// What was left out, replaced or assumed: a sentence each, which names the file.
    pub warnings: Vec<String>,
}

/// Why a file cannot be used: one sentence that names the file, the line where there is one, and the fault.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {}{message}", .line.map_or(String::new(), |line| format!("line {line}: ")))]
pub struct ImportError {
    /// Path of the file, as it was given.
    pub path: String,
    /// Line of the fault, counted from 1, in files that have lines.
    pub line: Option<usize>,
    /// What was found and what was expected.
    pub message: String,
}

impl ImportError {
    fn new(path: &str, message: impl Into<String>) -> Self {
        Self { path: path.into(), line: None, message: message.into() }
    }

    fn at(path: &str, line: usize, message: impl Into<String>) -> Self {
        Self { path: path.into(), line: Some(line), message: message.into() }
    }
}

/// Read a mesh file: OBJ with its MTL files, or PLY. Which one it is, its extension says.
///
/// `path` is relative to the scene's folder, with `/` between its parts; `resolve` is asked for the
/// files it names by paths of the same kind. Textures of the materials are named likewise, and only
/// those that `resolve` finds.
///
/// # Errors
/// A file that is not what its name says, is cut short, holds a number that is not finite, refers to a
/// vertex it does not have, or holds no triangle.
pub fn mesh(path: &str, bytes: &[u8], resolve: &mut Resolve) -> Result<Imported, ImportError> {
    match path::extension(path).as_str() {
        "obj" => obj::read(path, bytes, resolve),
        "ply" => ply::read(path, bytes),
        other => Err(ImportError::new(
            path,
            format!("\".{other}\" is not a mesh format that is known, which are .{}", MESH_EXTENSIONS.join(" and .")),
        )),
    }
}

/// Paths of the files that a file names: an OBJ's material libraries, an MTL's textures. Relative to the
/// scene's folder, without repeats, in the order of the file. Nothing is checked to exist; of a name that
/// leaves the folder, and of a file of another kind, nothing comes.
#[must_use]
pub fn references(path: &str, bytes: &[u8]) -> Vec<String> {
    let mut found = match path::extension(path).as_str() {
        "obj" => obj::references(path, bytes),
        "mtl" => mtl::references(path, bytes),
        _ => Vec::new(),
    };
    let mut seen = std::collections::HashSet::new();
    found.retain(|reference| seen.insert(reference.clone()));
    found
}
