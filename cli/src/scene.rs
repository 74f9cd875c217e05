//! `tessera scene`: check, convert, schema.

use std::{collections::BTreeMap, path::Path};

use common::{hash::AssetHash, scene::SceneFile};
use serde::Serialize;

use crate::{
    args::{JobOptions, SceneCheckArgs, SceneCommand, SceneConvertArgs},
    bundle::Bundle,
    error::Failure,
    output, print, request,
};

/// Run `tessera scene`.
///
/// # Errors
/// What is wrong with the scene, or a file that cannot be written.
pub fn scene(command: SceneCommand) -> Result<(), Failure> {
    match command {
        SceneCommand::Check(args) => check(&args),
        SceneCommand::Convert(args) => convert(&args),
        SceneCommand::Schema => print::json(&schemars::schema_for!(SceneFile)),
    }
}

fn check(args: &SceneCheckArgs) -> Result<(), Failure> {
    let mut bundle = Bundle::read(&args.scene)?;
    let request = request::of(&JobOptions::default(), &bundle)?;
    bundle.verify(&request)?;
    let scene = &bundle.scene;
    if args.json {
        return print::json(&Sound::of(&args.scene, &bundle));
    }
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let facts = [
        count(scene.shapes.len(), "shape"),
        count(scene.materials.len(), "material"),
        count(scene.assets.len(), "file"),
        format!("{}x{} pixels", scene.film.width, scene.film.height),
    ];
    let notes = bundle.notes.iter().map(|note| format!("note: {note}"));
    print::lines(notes.chain([format!("{}: sound: {}", args.scene.display(), facts.join(", "))]))
}

/// What is told of a scene that can be rendered.
#[derive(Serialize)]
struct Sound<'a> {
    /// The file.
    scene: &'a Path,
    name: &'a str,
    shapes: usize,
    materials: usize,
    lights: usize,
    /// Hashes of the files that it names.
    files: &'a BTreeMap<String, AssetHash>,
    resolution: [u32; 2],
    /// What was made up or left out.
    notes: &'a [String],
}

impl<'a> Sound<'a> {
    fn of(path: &'a Path, bundle: &'a Bundle) -> Self {
        let scene = &bundle.scene;
        Self {
            scene: path,
            name: &scene.name,
            shapes: scene.shapes.len(),
            materials: scene.materials.len(),
            lights: scene.lights.len(),
            files: &scene.assets,
            resolution: [scene.film.width, scene.film.height],
            notes: &bundle.notes,
        }
    }
}

fn convert(args: &SceneConvertArgs) -> Result<(), Failure> {
    let mut bundle = Bundle::read(&args.scene)?;
    let request = request::of(&JobOptions::default(), &bundle)?;
    bundle.verify(&request)?;
    if !args.json {
        bundle.notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
    let folder = |path: &std::path::Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        std::path::absolute(folder.unwrap_or(std::path::Path::new(".")))
    };
    // Files are named relative to the scene: it must stay where they are.
    let same = matches!((folder(&args.scene), folder(&args.out)), (Ok(from), Ok(to)) if from == to);
    if !same && !bundle.scene.assets.is_empty() {
        let (out, scene) = (args.out.display(), args.scene.display());
        return Err(Failure::Input(format!("{out}: must be in the folder of {scene}, whose files it names")));
    }
    let written = SceneFile { assets: BTreeMap::new(), ..bundle.scene.clone() };
    let text = serde_json::to_string_pretty(&written).map_err(|error| Failure::Work(error.to_string()))?;
    output::write(&args.out, format!("{text}\n").as_bytes())?;
    if args.json { print::json(&Sound::of(&args.out, &bundle)) } else { Ok(()) }
}
