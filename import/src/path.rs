//! Paths relative to the scene's folder, as text: nothing here looks at a disk.

/// The extension in lower case, without its dot; empty where there is none.
pub(crate) fn extension(path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.rsplit_once('.').map_or(String::new(), |(_, extension)| extension.to_ascii_lowercase())
}

/// The path of `name` as written in the file `from`: relative to that file's folder, with `.` and `..`
/// resolved. `None` for a name that is empty, absolute, or leaves the scene's folder.
pub(crate) fn beside(from: &str, name: &str) -> Option<String> {
    let name = name.replace('\\', "/");
    if name.is_empty() || name.starts_with('/') || name.contains(':') || name.contains('\0') {
        return None;
    }
    let mut parts: Vec<&str> = from.split('/').collect();
    parts.pop();
    for part in name.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop()?;
            }
            part => parts.push(part),
        }
    }
    (!parts.is_empty()).then(|| parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_resolve_beside_the_file_and_never_outside() {
        for (from, name, expected) in [
            ("a.obj", "a.mtl", Some("a.mtl")),
            ("meshes/a.obj", "a.mtl", Some("meshes/a.mtl")),
            ("meshes/a.obj", "./x/../a.mtl", Some("meshes/a.mtl")),
            ("meshes/a.obj", "..\\textures\\wood.png", Some("textures/wood.png")),
            ("meshes/a.obj", "../../a.mtl", None),
            ("a.obj", "../a.mtl", None),
            ("a.obj", "/etc/passwd", None),
            ("a.obj", "C:\\a.mtl", None),
            ("a.obj", "", None),
            ("a.obj", ".", None),
        ] {
            assert_eq!(beside(from, name).as_deref(), expected, "{name} beside {from}");
        }
    }

    #[test]
    fn an_extension_is_that_of_the_last_part() {
        assert_eq!(extension("a.b/C.OBJ"), "obj");
        assert_eq!(extension("a.b/c"), "");
    }
}
