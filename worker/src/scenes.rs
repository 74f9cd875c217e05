//! Scenes made ready to render: fetched, decoded, built, and kept for the next lease.

use std::{
    collections::{BTreeMap, BTreeSet, HashSet},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

use bytes::Bytes;
use common::{
    hash::AssetHash,
    mesh::MeshPart,
    protocol::RenderSettings,
    scene::{Image, Import, MeshSource, SceneFile, ShapeKind, Source, Texture, TextureKind},
};
use futures::{StreamExt, TryStreamExt, stream};
use tokio::sync::OnceCell;
use tracer::{Assets, Loaded, Prepared};

use crate::{assets::AssetSource, picture, pool::Pool};

/// Scenes kept ready to render.
const KEPT: usize = 4;
/// Scenes whose decoded files are kept, for their next frame.
const KEPT_FILES: usize = 2;
/// Files fetched at a time.
const FETCHES: usize = 8;

/// A scene ready to render, and what that cost.
#[derive(Debug)]
pub struct ReadyScene {
    /// The tracer's form of it.
    pub prepared: Prepared,
    /// Seconds to fetch and decode it.
    pub load: Arc<Cost>,
    /// Seconds to build its acceleration structure.
    pub build: Arc<Cost>,
}

/// Seconds that are charged to whoever asks first, and to nobody else.
#[derive(Debug)]
pub struct Cost {
    seconds: f64,
    charged: AtomicBool,
}

impl Cost {
    fn new(seconds: f64) -> Self {
        Self { seconds, charged: AtomicBool::new(false) }
    }

    /// The seconds, the first time; 0 from then on.
    pub fn charge(&self) -> f64 {
        if self.charged.swap(true, Ordering::Relaxed) { 0.0 } else { self.seconds }
    }
}

/// All that a prepared scene depends on.
#[derive(Debug, Clone, PartialEq)]
struct Key {
    scene: AssetHash,
    frame: u32,
    resolution: [u32; 2],
    method: common::method::Method,
}

/// A scene file with its decoded files.
#[derive(Debug)]
struct Decoded {
    scene: SceneFile,
    assets: Assets,
    load: Cost,
}

/// The scenes of a worker, most recently used last.
#[derive(Debug)]
pub struct Scenes {
    source: AssetSource,
    pool: Pool,
    ready: Recent<Key, ReadyScene>,
    decoded: Recent<AssetHash, Decoded>,
    warned: Mutex<HashSet<String>>,
}

impl Scenes {
    /// No scenes yet.
    #[must_use]
    pub fn new(source: AssetSource, pool: Pool) -> Self {
        Self { source, pool, ready: Recent::new(KEPT), decoded: Recent::new(KEPT_FILES), warned: Mutex::default() }
    }

    /// Scenes and frames that are ready.
    #[must_use]
    pub fn prepared(&self) -> Vec<(AssetHash, u32)> {
        let frames: BTreeSet<_> = self.ready.present().into_iter().map(|key| (key.scene, key.frame)).collect();
        frames.into_iter().collect()
    }

    /// The scene with this hash, ready for units with these settings. Asked for twice at once, it is
    /// prepared once. Waits while the coordinator is away.
    ///
    /// # Errors
    /// One sentence: a file that cannot be had or read, or a part of the scene that cannot be rendered.
    pub async fn get(&self, scene: AssetHash, settings: &RenderSettings) -> Result<Arc<ReadyScene>, String> {
        let RenderSettings { frame, resolution, ref method, .. } = *settings;
        let key = Key { scene, frame, resolution, method: method.clone() };
        let cell = self.ready.cell(&key);
        cell.get_or_try_init(|| self.prepare(key)).await.cloned()
    }

    async fn prepare(&self, key: Key) -> Result<Arc<ReadyScene>, String> {
        if let Some(shared) = self.shared(&key) {
            return Ok(Arc::new(shared));
        }
        let cell = self.decoded.cell(&key.scene);
        let decoded = Arc::clone(cell.get_or_try_init(|| self.decode(key.scene)).await?);
        let prepare = move || {
            let start = Instant::now();
            let scene = decoded.scene.at_frame(key.frame);
            let loaded = Loaded::new(&scene, &decoded.assets, &key.method, key.resolution);
            let loaded = loaded.map_err(|error| error.to_string())?;
            let warnings = loaded.warnings().to_vec();
            let load = Arc::new(Cost::new(decoded.load.charge() + start.elapsed().as_secs_f64()));
            let start = Instant::now();
            let prepared = loaded.build();
            let build = Arc::new(Cost::new(start.elapsed().as_secs_f64()));
            Ok((ReadyScene { prepared, load, build }, warnings))
        };
        let (ready, warnings) = self.pool.run(prepare).await.flatten()?;
        self.warn(warnings);
        Ok(Arc::new(ready))
    }

    /// The scene made of one that is ready for another method, where both share everything dear.
    fn shared(&self, key: &Key) -> Option<ReadyScene> {
        self.ready.find(|other, ready| {
            let same = (other.scene, other.frame, other.resolution) == (key.scene, key.frame, key.resolution);
            let prepared = same.then(|| ready.prepared.with_method(&other.method, &key.method)).flatten()?;
            Some(ReadyScene { prepared, load: Arc::clone(&ready.load), build: Arc::clone(&ready.build) })
        })
    }

    async fn decode(&self, hash: AssetHash) -> Result<Arc<Decoded>, String> {
        let start = Instant::now();
        let text = self.source.get(hash).await.map_err(|error| error.to_string())?;
        let source = Source::parse(&text).map_err(|error| format!("scene {hash}: {error}"))?;
        let files: BTreeMap<String, Bytes> = stream::iter(source.assets().clone())
            .map(async |(path, hash)| match self.source.get(hash).await {
                Ok(bytes) => Ok((path, bytes)),
                Err(error) => Err(format!("{path}: {error}")),
            })
            .buffer_unordered(FETCHES)
            .try_collect()
            .await?;
        let fetched = start.elapsed();
        let decode = move || {
            let start = Instant::now();
            let (scene, files) = match source {
                Source::Native(scene) => (*scene, files),
                Source::Import(import) => imported(&import, &files)?,
            };
            let (assets, warnings) = decode_files(&scene, &files)?;
            let load = Cost::new((fetched + start.elapsed()).as_secs_f64());
            Ok((Decoded { scene, assets, load }, warnings))
        };
        let (decoded, warnings) = self.pool.run(decode).await.flatten()?;
        self.warn(warnings);
        Ok(Arc::new(decoded))
    }

    /// Log each warning once in the life of the worker, not once a frame.
    fn warn(&self, warnings: Vec<String>) {
        for warning in warnings {
            if self.is_news(&warning) {
                tracing::warn!("{warning}");
            }
        }
    }

    /// Whether this was never asked before, of anything that is worth one line in the log and not a thousand.
    pub fn is_news(&self, what: &str) -> bool {
        self.warned.lock().unwrap_or_else(PoisonError::into_inner).insert(what.into())
    }
}

/// The scene made of a file of another format, and its files by the paths that they are named by.
///
/// # Errors
/// One sentence that names the file.
fn imported(import: &Import, files: &BTreeMap<String, Bytes>) -> Result<(SceneFile, BTreeMap<String, Bytes>), String> {
    let path = &import.import;
    let extension = path.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    if !import::MESH_EXTENSIONS.contains(&extension.as_str()) {
        let known = import::MESH_EXTENSIONS.join(" or .");
        return Err(format!("{path}: not a scene: expected a .json, .{known} file"));
    }
    let mut named = BTreeMap::new();
    let mut wanted = vec![path.clone()];
    while let Some(path) = wanted.pop() {
        if let Some(bytes) = import.find(&path).and_then(|place| files.get(place))
            && !named.contains_key(&path)
        {
            wanted.extend(import::references(&path, bytes));
            named.insert(path, bytes.clone());
        }
    }
    let mut resolve = |file: &str| named.get(file).map(|bytes| bytes.to_vec());
    let bytes = named.get(path).cloned().unwrap_or_default();
    let mesh = import::mesh(path, &bytes, &mut resolve).map_err(|error| error.to_string())?;
    let mut scene = import::scene_from_mesh(path, &mesh);
    scene.assets = named.iter().map(|(path, bytes)| (path.clone(), AssetHash::of(bytes))).collect();
    Ok((scene, named))
}

/// Decode what the scene names: meshes first, then the pictures of the scene and of the meshes' own
/// materials.
///
/// # Errors
/// One sentence that names the file.
pub fn decode_files(scene: &SceneFile, files: &BTreeMap<String, Bytes>) -> Result<(Assets, Vec<String>), String> {
    let mut assets = Assets::default();
    let mut warnings = Vec::new();
    let find = |path: &str| files.get(path).ok_or_else(|| format!("{path}: not among the files of the scene"));
    for path in mesh_files(scene) {
        let mut resolve = |path: &str| files.get(path).map(|bytes| bytes.to_vec());
        let imported = import::mesh(path, find(path)?, &mut resolve).map_err(|error| error.to_string())?;
        warnings.extend(imported.warnings);
        assets.meshes.insert(path.to_string(), imported.parts);
    }
    let own = scene.files().into_iter().map(|(_, path)| path).filter(|path| !assets.meshes.contains_key(path));
    let theirs = assets.meshes.values().flatten().flat_map(pictures_of);
    let pictures: BTreeSet<String> = own.chain(theirs).collect();
    for path in pictures {
        let picture = picture::decode(&path, find(&path)?)?;
        assets.pictures.insert(path, picture);
    }
    Ok((assets, warnings))
}

fn mesh_files(scene: &SceneFile) -> BTreeSet<&str> {
    let shapes = scene.objects.values().flatten().chain(&scene.shapes);
    shapes
        .filter_map(|shape| match &shape.kind {
            ShapeKind::Mesh(mesh) => match &mesh.source {
                MeshSource::File { file } => Some(file.as_str()),
                MeshSource::Inline { .. } => None,
            },
            _ => None,
        })
        .collect()
}

fn pictures_of(part: &MeshPart) -> Vec<String> {
    let Some(material) = &part.material else { return Vec::new() };
    let textures = material.textures().into_iter().filter_map(|(_, texture)| match texture {
        Texture::Mapped(kind) => match kind.as_ref() {
            TextureKind::Image(Image { file, .. }) => Some(file.clone()),
            TextureKind::Checkerboard(_) => None,
        },
        Texture::Constant(_) => None,
    });
    textures.chain(material.normal_map.as_ref().map(|map| map.file.clone())).collect()
}

/// A few values that are dear to make, by key; the least recently used goes first.
#[derive(Debug)]
struct Recent<K, V> {
    most: usize,
    cells: Mutex<Vec<(K, Cell<V>)>>,
}

type Cell<V> = Arc<OnceCell<Arc<V>>>;

impl<K: Clone + PartialEq, V> Recent<K, V> {
    fn new(most: usize) -> Self {
        Self { most, cells: Mutex::default() }
    }

    /// The place of a value, which whoever comes first fills.
    fn cell(&self, key: &K) -> Cell<V> {
        let mut cells = self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = match cells.iter().position(|(other, _)| other == key) {
            Some(index) => cells.remove(index),
            None => (key.clone(), Cell::default()),
        };
        let cell = Arc::clone(&entry.1);
        cells.push(entry);
        if cells.len() > self.most {
            cells.remove(0);
        }
        cell
    }

    /// The first that `of` makes of a value that is there.
    fn find<T>(&self, of: impl Fn(&K, &V) -> Option<T>) -> Option<T> {
        let cells = self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        cells.iter().find_map(|(key, cell)| of(key, cell.get()?))
    }

    fn present(&self) -> Vec<K> {
        let cells = self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        cells.iter().filter(|(_, cell)| cell.initialized()).map(|(key, _)| key.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_that_is_dropped_with_its_files_becomes_a_scene_wherever_they_lie() {
        const MESH: &str = "mtllib materials/m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n";
        const MATERIAL: &str = "newmtl red\nKd 1 0 0\nmap_Kd wood.png\n";
        let file = |path: &str, text: &'static str| (path.to_owned(), Bytes::from_static(text.as_bytes()));
        for place in ["materials/m.mtl", "m.mtl"] {
            let files = BTreeMap::from([file("t.obj", MESH), file(place, MATERIAL), file("other.txt", "")]);
            let assets = files.iter().map(|(path, bytes)| (path.clone(), AssetHash::of(bytes))).collect();
            let (scene, named) = imported(&Import { import: "t.obj".into(), assets }, &files).unwrap();
            assert_eq!(named.keys().collect::<Vec<_>>(), ["materials/m.mtl", "t.obj"], "{place}");
            assert_eq!(scene.assets["materials/m.mtl"], AssetHash::of(MATERIAL.as_bytes()));
            assert!(scene.check().is_ok() && scene.description.contains("camera"));
            let (decoded, _) = decode_files(&scene, &named).unwrap();
            assert!(decoded.meshes["t.obj"][0].material.is_some(), "{place}");
        }
        for (name, text, said) in [
            ("t.gif", "", "t.gif: not a scene: expected a .json, .obj or .ply file"),
            ("t.obj", "v 0 0 0\nf 1 2 3\n", "t.obj: line 2: "),
        ] {
            let files = BTreeMap::from([file(name, text)]);
            let assets = BTreeMap::from([(name.to_owned(), AssetHash::of(text.as_bytes()))]);
            let error = imported(&Import { import: name.into(), assets }, &files).unwrap_err();
            assert!(error.starts_with(said), "{error}");
        }
    }

    #[test]
    fn the_least_recently_used_goes_first() {
        let recent: Recent<u32, u32> = Recent::new(2);
        for key in [1, 2] {
            recent.cell(&key).set(Arc::new(key)).unwrap();
        }
        assert!(recent.cell(&1).initialized());
        assert!(!recent.cell(&3).initialized());
        assert_eq!(recent.present(), [1], "2 went, 3 is not there yet");
    }
}
