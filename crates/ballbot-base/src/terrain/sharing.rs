//! Reuse of terrains and grounds that are already in use.

use super::{Ground, Recipe, Terrain};
use crate::error::Result;
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Objects in use, by their inputs.
type Used<K, V> = Mutex<Vec<(K, Weak<V>)>>;

static TERRAINS: Used<Recipe, Terrain> = Mutex::new(Vec::new());
/// By the address of the terrain, which lives as long as its ground, and the radius.
static GROUNDS: Used<(usize, u64), Ground> = Mutex::new(Vec::new());

fn shared<K: PartialEq, V>(used: &Used<K, V>, key: K, make: impl FnOnce() -> Result<V>) -> Result<Arc<V>> {
    let lock = || used.lock().unwrap_or_else(PoisonError::into_inner);
    let found = lock().iter().find(|(known, _)| *known == key).and_then(|(_, value)| value.upgrade());
    if let Some(value) = found {
        return Ok(value);
    }
    let value = Arc::new(make()?);
    let mut used = lock();
    used.retain(|(_, value)| value.strong_count() > 0);
    used.push((key, Arc::downgrade(&value)));
    Ok(value)
}

impl Terrain {
    /// [`Terrain::generate`], created only if no such terrain is in use.
    ///
    /// # Errors
    /// As [`Terrain::generate`].
    pub fn shared(kind: &'static str, seed: u64, parameters: &[(&'static str, f64)]) -> Result<Arc<Self>> {
        let key = Recipe { kind, seed, parameters: parameters.to_vec() };
        shared(&TERRAINS, key, || Self::generate(kind, seed, parameters))
    }
}

impl Ground {
    /// [`Ground::new`], created only if no such ground is in use.
    ///
    /// # Errors
    /// As [`Ground::new`].
    pub fn shared(terrain: &Arc<Terrain>, ball_radius: f64) -> Result<Arc<Self>> {
        shared(&GROUNDS, (Arc::as_ptr(terrain).addr(), ball_radius.to_bits()), || Self::new(terrain, ball_radius))
    }
}
