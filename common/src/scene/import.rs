//! A file of another format in the place of a scene: the workers that load it make a scene of it.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{SceneError, SceneFile, Settings, from_json};
use crate::{hash::AssetHash, job::FieldError};

/// A file of another format, with the files that go with it. Which formats there are is the importer's business.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// The file to make a scene of: one of `assets`.
    pub import: String,
    /// Hash of every file, by its path relative to the first one's folder. A file that another names and that is not
    /// here by that path is the one of that name, where there is one alone: files may come without their folders.
    pub assets: BTreeMap<String, AssetHash>,
}

impl Import {
    /// Check that the file is among those that come with it.
    ///
    /// # Errors
    /// It is not.
    pub fn check(&self) -> Result<(), FieldError> {
        if self.assets.contains_key(&self.import) {
            return Ok(());
        }
        Err(FieldError::new("import", format!("\"{}\" is not among the assets", self.import)))
    }

    /// The path in `assets` of a file that one of them names.
    #[must_use]
    pub fn find(&self, path: &str) -> Option<&str> {
        let name = |path: &str| path.rsplit('/').next().map(str::to_owned);
        if let Some((found, _)) = self.assets.get_key_value(path) {
            return Some(found);
        }
        let wanted = name(path);
        let mut same = self.assets.keys().filter(|other| name(other) == wanted);
        same.next().filter(|_| same.next().is_none()).map(String::as_str)
    }
}

/// What a job may render: what is stored under the hash of its scene.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A native scene.
    Native(Box<SceneFile>),
    /// A file that is to become one.
    Import(Import),
}

impl Source {
    /// Read and check either.
    ///
    /// # Errors
    /// The first thing that is wrong, by its path in the file.
    pub fn parse(text: &[u8]) -> Result<Self, SceneError> {
        #[derive(Deserialize)]
        struct Tag {
            import: Option<serde_json::Value>,
        }
        match serde_json::from_slice::<Tag>(text) {
            Ok(Tag { import: Some(_) }) => {
                let import: Import = from_json(text)?;
                import.check()?;
                Ok(Self::Import(import))
            }
            _ => SceneFile::parse(text).map(Box::new).map(Self::Native),
        }
    }

    /// Its files.
    #[must_use]
    pub fn assets(&self) -> &BTreeMap<String, AssetHash> {
        match self {
            Self::Native(scene) => &scene.assets,
            Self::Import(import) => &import.assets,
        }
    }

    /// What people call it.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Native(scene) => &scene.name,
            Self::Import(import) => import.import.rsplit('/').next().unwrap_or_default(),
        }
    }

    /// Width and height of its frames where the job does not say.
    #[must_use]
    pub fn resolution(&self) -> [u32; 2] {
        let film = match self {
            Self::Native(scene) => scene.film,
            Self::Import(_) => Default::default(),
        };
        [film.width, film.height]
    }

    /// What to render where the job does not say.
    #[must_use]
    pub fn settings(&self) -> Settings {
        match self {
            Self::Native(scene) => scene.settings.clone(),
            Self::Import(_) => Settings::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn import(files: &[&str]) -> Import {
        let assets = files.iter().map(|&file| (file.to_owned(), AssetHash::of(file.as_bytes()))).collect();
        Import { import: files[0].into(), assets }
    }

    #[test]
    fn files_without_their_folders_are_found_by_name_where_one_has_it() {
        let flat = import(&["a.obj", "a.mtl", "wood.png", "x/stone.png", "y/stone.png"]);
        assert_eq!(flat.find("textures/wood.png"), Some("wood.png"));
        assert_eq!(flat.find("y/stone.png"), Some("y/stone.png"));
        assert_eq!(flat.find("stone.png"), None, "two have that name");
        assert_eq!(flat.find("ood.png"), None, "a name is whole");
    }

    #[test]
    fn what_is_to_be_imported_is_told_from_a_scene() {
        let text = serde_json::to_vec(&import(&["m/a.obj"])).unwrap();
        let source = Source::parse(&text).unwrap();
        assert_eq!((source.name(), source.assets().len()), ("a.obj", 1));
        let scene = br#"{"tessera":1,"name":"n","camera":{"position":[0,0,3],"target":[0,0,0]},"film":{"width":7}}"#;
        let source = Source::parse(scene).unwrap();
        assert_eq!((source.name(), source.resolution()), ("n", [7, 512]));
        for (text, field) in [
            (r#"{"import":"a.obj","assets":{}}"#, "import"),
            (r#"{"import":1,"assets":{}}"#, "import"),
            (r#"{"import":"a.obj","assets":{},"colour":1}"#, "colour"),
            (r#"{"tessera":1}"#, "(top level)"),
        ] {
            let Err(SceneError::Field(error)) = Source::parse(text.as_bytes()) else { panic!("{text}") };
            assert_eq!(error.field, field, "{text}");
        }
    }
}
