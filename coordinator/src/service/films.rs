//! Films in memory between two results, up to a number of bytes. What is not here is in the store.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex},
};

use common::film::{Features, Film, Moments};

use super::lock;
use crate::{farm::TileKey, store::TileRecord};

/// A tile's film and record.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TileFilm {
    /// How far it is and what it cost.
    pub record: TileRecord,
    /// Its pixels.
    pub film: Arc<Film>,
}

/// A bounded cache. Only what is stored already is put in.
#[derive(Debug)]
pub(super) struct FilmCache {
    limit: usize,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    films: HashMap<TileKey, (u64, Arc<TileFilm>)>,
    bytes: usize,
    uses: u64,
}

fn size(film: &Film) -> usize {
    film.moments.len() * size_of::<Moments>() + film.features.len() * size_of::<Features>()
}

impl FilmCache {
    pub(super) fn new(limit: usize) -> Self {
        FilmCache { limit, held: Mutex::default() }
    }

    pub(super) fn get(&self, key: TileKey) -> Option<Arc<TileFilm>> {
        let mut held = lock(&self.held);
        held.uses += 1;
        let uses = held.uses;
        let (used, film) = held.films.get_mut(&key)?;
        *used = uses;
        Some(Arc::clone(film))
    }

    pub(super) fn put(&self, key: TileKey, film: Arc<TileFilm>) {
        let mut held = lock(&self.held);
        held.uses += 1;
        held.bytes += size(&film.film);
        let uses = held.uses;
        if let Some((_, old)) = held.films.insert(key, (uses, film)) {
            held.bytes -= size(&old.film);
        }
        if held.bytes > self.limit {
            held.shrink(self.limit / 4 * 3);
        }
    }

    pub(super) fn forget(&self, mut which: impl FnMut(&TileKey) -> bool) {
        let mut held = lock(&self.held);
        held.films.retain(|key, _| !which(key));
        held.bytes = held.films.values().map(|(_, film)| size(&film.film)).sum();
    }
}

impl Held {
    /// Let go of the films that were not used for longest.
    fn shrink(&mut self, to: usize) {
        let mut order: Vec<(u64, TileKey)> = self.films.iter().map(|(&key, &(used, _))| (used, key)).collect();
        order.sort_unstable();
        for (_, key) in order {
            if self.bytes <= to {
                break;
            }
            if let Some((_, film)) = self.films.remove(&key) {
                self.bytes -= size(&film.film);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::job::JobId;

    #[test]
    fn the_least_used_films_go_when_memory_is_short() {
        let key = |tile| TileKey { job: JobId(1), frame: 1, tile };
        let film = |pixels| {
            let film = Film { moments: vec![Moments::default(); pixels], features: Vec::new() };
            Arc::new(TileFilm { film: Arc::new(film), ..TileFilm::default() })
        };
        let cache = FilmCache::new(10 * size_of::<Moments>());
        (0..3).for_each(|tile| cache.put(key(tile), film(3)));
        assert!(cache.get(key(0)).is_some());
        cache.put(key(3), film(3));
        assert!(cache.get(key(0)).is_some() && cache.get(key(3)).is_some());
        assert!(cache.get(key(1)).is_none());
        cache.forget(|key| key.tile == 0);
        assert!(cache.get(key(0)).is_none());
    }
}
