//! A scene with all its files, read from disk and checked before anything is sent anywhere.

use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    ffi::OsStr,
    io::ErrorKind,
    path::{Path, PathBuf},
};

use bytes::Bytes;
use common::{
    hash::AssetHash,
    job::JobRequest,
    scene::{SceneError, SceneFile},
};

use crate::error::{Failure, reason};

/// A scene with all its files.
#[derive(Debug, Clone)]
pub struct Bundle {
    /// Where the scene was read from.
    pub path: PathBuf,
    /// The scene, with the hash of every file filled in.
    pub scene: SceneFile,
    /// What was made up or left out, a sentence each.
    pub notes: Vec<String>,
    files: BTreeMap<String, Bytes>,
}

impl Bundle {
    /// Read a native scene file, or a bare mesh file with a made-up camera and light, and every file that
    /// it names or that one of those names.
    ///
    /// # Errors
    /// A file that is missing or is not what it should be, named with the field that names it.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let text = std::fs::read(path).map_err(|error| Failure::file(path, &error))?;
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
        let mut bundle = match extension.as_str() {
            "json" => Self::of(path, parse(path, &text)?),
            mesh if import::MESH_EXTENSIONS.contains(&mesh) => Self::of_mesh(path, &text)?,
            _ => {
                let known = import::MESH_EXTENSIONS.join(" or .");
                let shown = path.display();
                return Err(Failure::Input(format!("{shown}: not a scene: expected a .json, .{known} file")));
            }
        };
        bundle.gather()?;
        Ok(bundle)
    }

    fn of(path: &Path, scene: SceneFile) -> Self {
        Self { path: path.into(), scene, notes: Vec::new(), files: BTreeMap::new() }
    }

    fn of_mesh(path: &Path, bytes: &[u8]) -> Result<Self, Failure> {
        let shown = path.display();
        let name = path.file_name().and_then(OsStr::to_str);
        let name = name.ok_or_else(|| Failure::Input(format!("{shown}: the file's name is not Unicode")))?;
        let folder = folder_of(path);
        let mut resolve = |file: &str| std::fs::read(folder.join(file)).ok();
        let imported = import::mesh(name, bytes, &mut resolve).map_err(|error| placed(path, "", &error))?;
        let scene = import::scene_from_mesh(name, &imported);
        let mut bundle = Self::of(path, scene);
        bundle.notes.push(bundle.scene.description.clone());
        Ok(bundle)
    }

    /// Read the files that the scene names, then those that they name, and note their hashes.
    fn gather(&mut self) -> Result<(), Failure> {
        let folder = folder_of(&self.path);
        let mut wanted: VecDeque<(Option<String>, String)> =
            self.scene.files().into_iter().map(|(field, file)| (Some(field), file)).collect();
        let mut seen = BTreeSet::new();
        self.scene.assets.clear();
        while let Some((field, file)) = wanted.pop_front() {
            if !seen.insert(file.clone()) {
                continue;
            }
            match std::fs::read(folder.join(&file)) {
                Ok(bytes) => {
                    wanted.extend(import::references(&file, &bytes).into_iter().map(|file| (None, file)));
                    self.scene.assets.insert(file.clone(), AssetHash::of(&bytes));
                    self.files.insert(file, bytes.into());
                }
                Err(error) => match field {
                    Some(field) => {
                        let what = format!("{file}: {}", reason(&error));
                        return Err(placed(&self.path, &field, &what));
                    }
                    // The importer does without a file that a mesh names, and says so.
                    None if error.kind() == ErrorKind::NotFound => {}
                    None => return Err(Failure::file(&folder.join(&file), &error)),
                },
            }
        }
        Ok(())
    }

    /// Decode every file and reduce the scene to what rendering needs, as a worker will, so that what is
    /// wrong with it is found before it is sent. Adds what was left out to the notes.
    ///
    /// # Errors
    /// The file or field that cannot be rendered.
    pub fn verify(&mut self, request: &JobRequest) -> Result<(), Failure> {
        self.load(request).map(drop)
    }

    /// The scene at the first frame that `request` asks for, reduced to what rendering needs.
    ///
    /// # Errors
    /// The file or field that cannot be rendered.
    pub fn load(&mut self, request: &JobRequest) -> Result<tracer::Loaded, Failure> {
        let (assets, warnings) =
            worker::decode_files(&self.scene, &self.files).map_err(|error| placed(&self.path, "", &error))?;
        let scene = self.scene.at_frame(crate::request::first_frame(request, self));
        let method = crate::request::method_of(request, self);
        let loaded = tracer::Loaded::new(&scene, &assets, &method, self.resolution(request));
        let loaded = loaded.map_err(|error| placed(&self.path, &error.field, &error.message))?;
        self.notes.extend(warnings.into_iter().chain(loaded.warnings().iter().cloned()));
        Ok(loaded)
    }

    /// Width and height of the frames that `request` asks for.
    #[must_use]
    pub fn resolution(&self, request: &JobRequest) -> [u32; 2] {
        request.resolution.unwrap_or([self.scene.film.width, self.scene.film.height])
    }

    /// The scene file as it is sent: with hashes.
    #[must_use]
    pub fn asset(&self) -> (AssetHash, Bytes) {
        let text = serde_json::to_vec(&self.scene).unwrap_or_default();
        (AssetHash::of(&text), text.into())
    }

    /// All that a farm needs: the files, then the scene that names them.
    #[must_use]
    pub fn assets(&self) -> BTreeMap<AssetHash, Bytes> {
        let files = self.files.iter().map(|(path, bytes)| (self.scene.assets[path], bytes.clone()));
        files.chain([self.asset()]).collect()
    }
}

fn parse(path: &Path, text: &[u8]) -> Result<SceneFile, Failure> {
    SceneFile::parse(text).map_err(|error| match error {
        SceneError::Field(error) => placed(path, &error.field, &error.message),
        syntax @ SceneError::Syntax(_) => placed(path, "", &syntax),
    })
}

/// A failure at a field of the scene at `path`.
fn placed(path: &Path, field: &str, what: &dyn std::fmt::Display) -> Failure {
    let separator = if field.is_empty() { "" } else { ": " };
    Failure::Input(format!("{}: {field}{separator}{what}", path.display()))
}

fn folder_of(path: &Path) -> PathBuf {
    path.parent().map(Path::to_path_buf).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }

    fn scene(file: &str) -> String {
        format!(
            r#"{{"tessera":1,"camera":{{"position":[0,0,3],"target":[0,0,0]}},
                "shapes":[{{"type":"sphere"}},{{"type":"mesh","file":"{file}"}}]}}"#
        )
    }

    const TRIANGLE: &str = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n";

    #[test]
    fn files_named_by_files_come_along() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "sub/t.obj", TRIANGLE);
        write(folder.path(), "sub/m.mtl", "newmtl red\nKd 1 0 0\nmap_Kd wood.png\n");
        write(folder.path(), "sub/wood.png", "not looked at yet");
        let path = write(folder.path(), "s.json", &scene("sub/t.obj"));
        let bundle = Bundle::read(&path).unwrap();
        let named: Vec<&String> = bundle.scene.assets.keys().collect();
        assert_eq!(named, ["sub/m.mtl", "sub/t.obj", "sub/wood.png"]);
        assert_eq!(bundle.scene.assets["sub/t.obj"], AssetHash::of(TRIANGLE.as_bytes()));
        let assets = bundle.assets();
        assert_eq!(assets.len(), 4);
        let sent = SceneFile::parse(&assets[&bundle.asset().0]).unwrap();
        assert_eq!(sent, bundle.scene);
    }

    #[test]
    fn a_bare_mesh_becomes_a_scene_and_says_what_was_made_up() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "m.mtl", "newmtl red\nKd 1 0 0\n");
        let bundle = Bundle::read(&write(folder.path(), "t.obj", TRIANGLE)).unwrap();
        assert!(bundle.notes[0].contains("camera") && bundle.notes[0].contains("light"), "{:?}", bundle.notes);
        assert_eq!(bundle.scene.assets.len(), 2);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_file_and_field() {
        let folder = tempfile::tempdir().unwrap();
        let missing = write(folder.path(), "missing.json", &scene("meshes/x.obj"));
        let unknown =
            write(folder.path(), "unknown.json", &scene("x.obj").replace("\"camera\"", "\"kamera\":1,\"camera\""));
        let broken = write(folder.path(), "broken.json", "{\"tessera\":1,");
        let other = write(folder.path(), "picture.gif", "");
        for (path, expected) in [
            (&missing, "missing.json: shapes[1].file: meshes/x.obj: no such file"),
            (&unknown, "unknown.json: kamera: unknown field `kamera`"),
            (&broken, "broken.json: not valid JSON"),
            (&other, "picture.gif: not a scene"),
            (&folder.path().join("absent.json"), "absent.json: no such file"),
        ] {
            let Err(Failure::Input(message)) = Bundle::read(path) else { panic!("{}", path.display()) };
            assert!(message.contains(expected), "{message}");
        }
        write(folder.path(), "t.obj", "v 0 0 0\nf 1 2 3\n");
        let mut bundle = Bundle::read(&write(folder.path(), "t.json", &scene("t.obj"))).unwrap();
        let request = crate::request::of(&Default::default(), &bundle).unwrap();
        let Err(Failure::Input(message)) = bundle.verify(&request) else { panic!("a bad index is found") };
        assert!(message.contains("t.json: t.obj: "), "{message}");
    }
}
