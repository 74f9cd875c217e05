//! The scenes that come with the coordinator, so that a page can render one without any file.

use std::sync::Arc;

use common::{
    hash::AssetHash,
    protocol::{ShippedScene, ShippedScenes},
    scene::SceneFile,
};

use super::{Service, submit::MAX_SCENE};
use crate::error::Failure;

/// The repository's folder of scenes, without those of the tests.
#[derive(rust_embed::RustEmbed)]
#[folder = "../scenes"]
#[include = "*.json"]
#[include = "meshes/*"]
#[exclude = "analytic/*"]
struct Files;

impl Service {
    /// The scenes, stored with all their files: each can be submitted by its hash.
    ///
    /// # Errors
    /// The asset store failed.
    pub async fn shipped(self: &Arc<Self>) -> Result<ShippedScenes, Failure> {
        let mut scenes = Vec::new();
        for path in Files::iter() {
            let Some(id) = path.strip_suffix(".json").filter(|id| !id.contains('/')) else { continue };
            let Some(file) = Files::get(&path) else { continue };
            let mut scene = SceneFile::parse(&file.data)
                .map_err(|error| Failure::Internal(format!("the shipped scene {id}: {error}")))?;
            for (_, name) in scene.files() {
                let bytes = Files::get(&name)
                    .ok_or_else(|| Failure::Internal(format!("the shipped scene {id} lacks {name}")))?;
                scene.assets.insert(name, self.keep(bytes.data.into_owned()).await?);
            }
            let text = serde_json::to_vec(&scene).map_err(|error| Failure::Internal(error.to_string()))?;
            let hash = self.keep(text).await?;
            scenes.push(ShippedScene {
                id: id.into(),
                name: scene.name,
                description: scene.description,
                resolution: [scene.film.width, scene.film.height],
                quality: scene.settings.quality.unwrap_or_default(),
                scene: hash,
            });
        }
        scenes.sort_by(|a, b| a.id.cmp(&b.id));
        Ok(ShippedScenes { scenes })
    }

    /// Store bytes under their hash.
    pub(super) async fn keep(&self, bytes: Vec<u8>) -> Result<AssetHash, Failure> {
        let hash = AssetHash::of(&bytes);
        if self.blobs.size(hash).await?.is_none() {
            let once = futures::stream::iter([Ok::<_, String>(bytes.into())]);
            self.blobs.put(hash, once, MAX_SCENE).await?;
        }
        Ok(hash)
    }
}
