//! PLY, ASCII and binary, read by ply-rs-bw but for the bulk of large files ([`binary`]).

mod binary;

use common::{
    mesh::{Mesh, MeshPart},
    scene::Rgb,
};
use ply_rs_bw::{
    parser::{ParseError, Parser, Reader},
    ply::{ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult},
};

use crate::{ImportError, Imported};

pub(crate) fn read(path: &str, bytes: &[u8]) -> Result<Imported, ImportError> {
    let fail = |message: String| ImportError::new(path, message);
    if !bytes.starts_with(b"ply") {
        return Err(fail("is not a PLY file: it does not begin with \"ply\"".into()));
    }
    let mut reader = Reader::new(bytes);
    let header = Parser::<Other>::new().read_header(&mut reader).map_err(|error| syntax(path, &error, true))?;
    let ascii = header.encoding == Encoding::Ascii;
    check_counts(&header, bytes.len()).map_err(fail)?;

    let mut mesh = Mesh::default();
    let mut warnings = Vec::new();
    for (name, element) in &header.elements {
        let done = match name.as_str() {
            "vertex" => match binary::vertices(reader.get_mut(), element, header.encoding) {
                Some(vertices) => Ok(vertices),
                None => Parser::<Vertex>::new().read_payload_for_element(&mut reader, element, &header),
            }
            .map(|vertices| take_vertices(&mut mesh, element, &vertices)),
            "face" => match binary::triangles(reader.get_mut(), element, header.encoding) {
                Some(triangles) => {
                    mesh.triangles = triangles;
                    Ok(Ok(()))
                }
                None => Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map(|faces| take_faces(&mut mesh, &faces)),
            },
            _ => Parser::<Other>::new().read_payload_for_element(&mut reader, element, &header).map(|_| Ok(())),
        };
        done.map_err(|error| syntax(path, &error, ascii))?.map_err(fail)?;
        if name == "vertex" && element.properties.contains_key("red") {
            warnings.push(format!("{path}: the colours of its vertices are not rendered."));
        }
    }
    if let Some(index) = mesh.triangles.iter().flatten().find(|&&index| index as usize >= mesh.positions.len()) {
        return Err(fail(format!("a face refers to vertex {index}, and there are {}", mesh.positions.len())));
    }
    if mesh.triangles.is_empty() {
        return Err(fail("holds no faces".into()));
    }
    Ok(Imported { parts: vec![MeshPart { mesh, material: None, emission: Rgb::default() }], warnings })
}

/// Refuse counts that the file cannot hold, before anything is reserved for them: every element takes at
/// least a byte.
fn check_counts(header: &Header, length: usize) -> Result<(), String> {
    for (name, element) in &header.elements {
        if element.count > 0 && element.properties.is_empty() {
            return Err(format!("{} elements \"{name}\" have no properties", element.count));
        }
        if element.count > length {
            let count = element.count;
            return Err(format!("{count} elements \"{name}\" do not fit into {length} bytes: the file is cut short"));
        }
    }
    Ok(())
}

/// The parser's messages run over several lines and quote the input: the first says what is wrong. Its
/// number of a line means something only in text.
fn syntax(path: &str, error: &ParseError, lines: bool) -> ImportError {
    let text = error.to_string();
    let first = text.lines().next().unwrap_or_default();
    let message = first.split_once(": ").filter(|(line, _)| line.starts_with("Line ")).map_or(first, |(_, rest)| rest);
    let message = message.trim_end_matches('.').to_owned();
    ImportError { path: path.to_owned(), line: error.line().filter(|_| lines), message }
}

#[derive(Clone, Copy, Default)]
struct Vertex {
    position: [f32; 3],
    normal: [f32; 3],
    uv: [f32; 2],
}

/// Where the property with this name goes.
fn field<'a>(vertex: &'a mut Vertex, name: &str) -> Option<&'a mut f32> {
    Some(match name {
        "x" => &mut vertex.position[0],
        "y" => &mut vertex.position[1],
        "z" => &mut vertex.position[2],
        "nx" => &mut vertex.normal[0],
        "ny" => &mut vertex.normal[1],
        "nz" => &mut vertex.normal[2],
        "u" | "s" | "texture_u" => &mut vertex.uv[0],
        "v" | "t" | "texture_v" => &mut vertex.uv[1],
        _ => return None,
    })
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let Some(field) = field(self, name) else { return PropertyAccessResult::Ignored };
        match value.to_f32_lossy() {
            Some(value) => *field = value,
            None => return PropertyAccessResult::UnsupportedType,
        }
        PropertyAccessResult::Set
    }
}

/// What the list of a face's corners is called.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

#[derive(Default)]
struct Face {
    /// `None`: a list that is not one of indices.
    corners: Option<Vec<u32>>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if !INDICES.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.corners = value.to_u32_list();
        PropertyAccessResult::Set
    }
}

/// An element that is read over.
struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Self
    }
}

fn take_vertices(mesh: &mut Mesh, element: &ElementDef, vertices: &[Vertex]) -> Result<(), String> {
    let has = |names: &[&str]| names.iter().all(|name| element.properties.contains_key(*name));
    if !has(&["x", "y", "z"]) {
        return Err("its vertices have no x, y and z".into());
    }
    let finite =
        |vertex: &Vertex| vertex.position.iter().chain(&vertex.normal).chain(&vertex.uv).all(|c| c.is_finite());
    if let Some(bad) = vertices.iter().position(|vertex| !finite(vertex)) {
        return Err(format!("vertex {bad} holds a number that is not finite"));
    }
    mesh.positions = vertices.iter().map(|vertex| vertex.position).collect();
    if has(&["nx", "ny", "nz"]) {
        mesh.normals = vertices.iter().map(|vertex| vertex.normal).collect();
    }
    if has(&["u", "v"]) || has(&["s", "t"]) || has(&["texture_u", "texture_v"]) {
        mesh.uvs = vertices.iter().map(|vertex| vertex.uv).collect();
    }
    Ok(())
}

/// Polygons become fans about their first corner.
fn take_faces(mesh: &mut Mesh, faces: &[Face]) -> Result<(), String> {
    mesh.triangles.reserve(faces.len());
    for (i, face) in faces.iter().enumerate() {
        let corners = match &face.corners {
            Some(corners) if corners.len() >= 3 => corners,
            Some(corners) => return Err(format!("face {i} has {} corners", corners.len())),
            None => return Err(format!("face {i} has no list of vertex indices at or above 0")),
        };
        mesh.triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
    }
    Ok(())
}
