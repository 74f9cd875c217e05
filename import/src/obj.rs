//! Wavefront OBJ, read by tobj.
//!
//! tobj tells neither the line of an error nor whether a number is finite, and splits meshes at groups.
//! So the text is first brought into a plain form, with every line checked: vertices first, then faces
//! with absolute indices and their materials, and nothing else.

use std::{collections::HashMap, fmt::Write as _, path::Path};

use common::{
    mesh::{Mesh, MeshPart},
    scene::Rgb,
};

use crate::{ImportError, Imported, Resolve, mtl, path::beside};

/// Name of the one material library that the plain form refers to.
const LIBRARY: &str = "library";

pub(crate) fn read(path: &str, bytes: &[u8], resolve: &mut Resolve) -> Result<Imported, ImportError> {
    let plain = Plain::of(path, bytes)?;
    let mut warnings = plain.warnings(path);
    let materials = load_materials(path, &plain, resolve, &mut warnings)?;

    let names: HashMap<String, usize> =
        materials.iter().enumerate().map(|(i, material)| (material.name.clone(), i)).collect();
    for name in plain.used.iter().filter(|name| !names.contains_key(name.as_str())) {
        warnings.push(format!("{path}: no material \"{name}\" is defined; its faces get the default."));
    }
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };
    let library = |_: &Path| Ok((materials.clone(), names.clone()));
    let (models, _) = tobj::load_obj_buf(&mut plain.text.as_bytes(), &options, library)
        .map_err(|error| ImportError::new(path, error.to_string()))?;

    let mut parts: Vec<(Option<usize>, Mesh)> = Vec::new();
    for model in models.into_iter().filter(|model| !model.mesh.indices.is_empty()) {
        let id = model.mesh.material_id;
        let mesh = to_mesh(model.mesh);
        match parts.iter_mut().find(|(known, _)| *known == id) {
            Some((_, known)) => append(known, mesh),
            None => parts.push((id, mesh)),
        }
    }
    let mut library = mtl::Library { path, resolve, warnings: &mut warnings };
    let part = |(id, mesh): (Option<usize>, Mesh)| {
        let found = id.and_then(|id| materials.get(id)).map(|source| library.material(source));
        let (material, emission) = found.map_or((None, Rgb::default()), |(m, e)| (Some(m), e));
        MeshPart { mesh, material, emission }
    };
    let parts = parts.into_iter().map(part).collect();
    Ok(Imported { parts, warnings })
}

pub(crate) fn references(path: &str, bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let lines = text.lines().filter_map(|line| line.trim_start().strip_prefix("mtllib"));
    lines.flat_map(|names| library_names(names.trim())).filter_map(|name| beside(path, &name)).collect()
}

/// A `mtllib` line may name several files, and a file's name may hold spaces: both readings, the likelier
/// first.
fn library_names(names: &str) -> Vec<String> {
    let mut readings = vec![names.to_owned()];
    let several: Vec<&str> = names.split_whitespace().collect();
    if several.len() > 1 {
        readings.extend(several.into_iter().map(str::to_owned));
    }
    readings
}

fn load_materials(
    path: &str,
    plain: &Plain,
    resolve: &mut Resolve,
    warnings: &mut Vec<String>,
) -> Result<Vec<tobj::Material>, ImportError> {
    let mut materials = Vec::new();
    for names in &plain.libraries {
        let mut found = false;
        for name in library_names(names) {
            let Some(file) = beside(path, &name) else { continue };
            let Some(bytes) = resolve(&file) else { continue };
            materials.extend(mtl::read(&file, &bytes, warnings)?);
            found = true;
            if name == *names {
                break;
            }
        }
        if !found {
            warnings.push(format!("{path}: the material file \"{names}\" is missing; its materials get the default."));
        }
    }
    Ok(materials)
}

/// An OBJ file reduced to what is used of it, every line checked.
struct Plain {
    /// `v`, `vt`, `vn`, then `usemtl` and `f` with positive indices.
    text: String,
    /// What `mtllib` lines say.
    libraries: Vec<String>,
    /// Names of materials used, in order, without repeats.
    used: Vec<String>,
    /// Elements that are not surfaces.
    lines: usize,
    points: usize,
    curves: usize,
}

/// The three lists that a face refers to.
const LISTS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

impl Plain {
    fn of(path: &str, bytes: &[u8]) -> Result<Plain, ImportError> {
        if bytes.contains(&0) {
            return Err(ImportError::new(path, "is not an OBJ file: it holds binary data"));
        }
        let text = String::from_utf8_lossy(bytes);
        let mut plain = Plain {
            text: format!("mtllib {LIBRARY}\n"),
            libraries: Vec::new(),
            used: Vec::new(),
            lines: 0,
            points: 0,
            curves: 0,
        };
        let mut faces = String::new();
        let mut counts = [0usize; 3];
        // The largest index into each list and its line, checked when the lists are complete.
        let mut largest = [(0usize, 0usize); 3];
        for (number, line) in logical_lines(&text) {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => {
                    plain.vertex(path, number, "v", 3, 3, words)?;
                    counts[0] += 1;
                }
                Some("vt") => {
                    plain.vertex(path, number, "vt", 1, 2, words)?;
                    counts[1] += 1;
                }
                Some("vn") => {
                    plain.vertex(path, number, "vn", 3, 3, words)?;
                    counts[2] += 1;
                }
                Some("f") => face(path, number, words, &counts, &mut largest, &mut faces)?,
                Some("usemtl") => {
                    let name = rest(&line);
                    if name.is_empty() {
                        return Err(ImportError::at(path, number, "usemtl names no material"));
                    }
                    if !plain.used.iter().any(|used| used == name) {
                        plain.used.push(name.to_owned());
                    }
                    let _ = writeln!(faces, "usemtl {name}"); // writing to a String cannot fail
                }
                Some("mtllib") => plain.libraries.push(rest(&line).to_owned()),
                Some("l") => plain.lines += 1,
                Some("p") => plain.points += 1,
                Some("curv" | "curv2" | "surf") => plain.curves += 1,
                _ => {}
            }
        }
        for ((count, list), (index, line)) in counts.iter().zip(LISTS).zip(largest) {
            if index > *count {
                let message = format!("the face refers to {list} {index}, and there are {count}");
                return Err(ImportError::at(path, line, message));
            }
        }
        if !faces.contains("f ") {
            return Err(ImportError::new(path, "holds no faces: not an OBJ file, or cut short"));
        }
        plain.text.push_str(&faces);
        Ok(plain)
    }

    /// Copy a line of numbers, `most` of them, with 0 for those beyond `least` that are absent.
    fn vertex<'a>(
        &mut self,
        path: &str,
        line: usize,
        key: &str,
        least: usize,
        most: usize,
        mut words: impl Iterator<Item = &'a str>,
    ) -> Result<(), ImportError> {
        self.text.push_str(key);
        for i in 0..most {
            let word = match words.next() {
                Some(word) => word,
                None if i >= least => "0",
                None => {
                    let message = format!("`{key}` has {i} numbers where {least} are expected");
                    return Err(ImportError::at(path, line, message));
                }
            };
            if !word.parse::<f32>().is_ok_and(f32::is_finite) {
                let message = format!("expected a finite number in `{key}`, found \"{}\"", shorten(word));
                return Err(ImportError::at(path, line, message));
            }
            self.text.push(' ');
            self.text.push_str(word);
        }
        self.text.push('\n');
        Ok(())
    }

    fn warnings(&self, path: &str) -> Vec<String> {
        let mut warnings = Vec::new();
        for (count, what) in [(self.lines, "lines"), (self.points, "points"), (self.curves, "curves and surfaces")] {
            if count > 0 {
                warnings.push(format!("{path}: {count} elements are {what}, which are not rendered."));
            }
        }
        warnings
    }
}

/// Copy a face with absolute indices.
fn face<'a>(
    path: &str,
    line: usize,
    corners: impl Iterator<Item = &'a str>,
    counts: &[usize; 3],
    largest: &mut [(usize, usize); 3],
    out: &mut String,
) -> Result<(), ImportError> {
    out.push('f');
    let mut number = 0;
    for corner in corners {
        number += 1;
        out.push(' ');
        let mut indices = corner.split('/');
        for (list, index) in indices.by_ref().take(3).enumerate() {
            if list > 0 {
                out.push('/');
                if index.is_empty() {
                    continue;
                }
            }
            let bad = || {
                let message = format!("expected the index of a {}, found \"{}\"", LISTS[list], shorten(index));
                ImportError::at(path, line, message)
            };
            let index: i64 = index.parse().map_err(|_| bad())?;
            let from_the_end = || counts[list].checked_sub(usize::try_from(index.unsigned_abs()).ok()?);
            let absolute = match index {
                0 => return Err(bad()),
                1.. => usize::try_from(index).map_err(|_| bad())?,
                _ => from_the_end().map(|before| before + 1).ok_or_else(|| {
                    let message =
                        format!("the face refers to {} {index}, and there are {} so far", LISTS[list], counts[list]);
                    ImportError::at(path, line, message)
                })?,
            };
            if absolute > largest[list].0 {
                largest[list] = (absolute, line);
            }
            let _ = write!(out, "{absolute}"); // writing to a String cannot fail
        }
        if indices.next().is_some() {
            return Err(ImportError::at(path, line, format!("expected v/vt/vn, found \"{}\"", shorten(corner))));
        }
    }
    if number < 3 {
        return Err(ImportError::at(path, line, format!("a face has at least 3 corners, found {number}")));
    }
    out.push('\n');
    Ok(())
}

/// Lines with the number of their first, a backslash at the end joining the next.
pub(crate) fn logical_lines(text: &str) -> impl Iterator<Item = (usize, std::borrow::Cow<'_, str>)> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let Some(start) = line.strip_suffix('\\') else { return Some((number + 1, line.into())) };
        let mut joined = start.to_owned();
        for (_, next) in lines.by_ref() {
            joined.push(' ');
            match next.strip_suffix('\\') {
                Some(start) => joined.push_str(start),
                None => {
                    joined.push_str(next);
                    break;
                }
            }
        }
        Some((number + 1, joined.into()))
    })
}

/// What follows the first word of a line.
pub(crate) fn rest(line: &str) -> &str {
    line.trim().split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim())
}

/// At most the first few characters, for a message.
pub(crate) fn shorten(word: &str) -> String {
    word.chars().take(24).collect()
}

fn to_mesh(mesh: tobj::Mesh) -> Mesh {
    let three = |flat: &[f32]| -> Vec<[f32; 3]> { flat.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect() };
    let positions = three(&mesh.positions);
    // Where only some corners have a normal or a texture coordinate, tobj's lists are shorter and no longer
    // belong to the vertices.
    let whole = |length: usize, of: usize| length == of * positions.len();
    Mesh {
        triangles: mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        normals: if whole(mesh.normals.len(), 3) { three(&mesh.normals) } else { Vec::new() },
        uvs: if whole(mesh.texcoords.len(), 2) {
            mesh.texcoords.chunks_exact(2).map(|uv| [uv[0], uv[1]]).collect()
        } else {
            Vec::new()
        },
        positions,
    }
}

/// Add the triangles of `more`. Normals and texture coordinates stay only where both have them.
fn append(mesh: &mut Mesh, more: Mesh) {
    let offset = mesh.positions.len() as u32;
    mesh.positions.extend(more.positions);
    mesh.triangles.extend(more.triangles.into_iter().map(|t| t.map(|index| index + offset)));
    if mesh.normals.is_empty() || more.normals.is_empty() {
        mesh.normals.clear();
    } else {
        mesh.normals.extend(more.normals);
    }
    if mesh.uvs.is_empty() || more.uvs.is_empty() {
        mesh.uvs.clear();
    } else {
        mesh.uvs.extend(more.uvs);
    }
}
