//! Things known by name: entries of one crate, and entries that other crates register.

use crate::error::{Error, Result};
use std::sync::{PoisonError, RwLock};

/// Something with a name.
pub trait Named {
    /// Its name.
    fn name(&self) -> &'static str;
}

/// Entries by name.
#[derive(Debug)]
pub struct Registry<T: 'static> {
    /// The noun for an entry in messages.
    what: &'static str,
    own: &'static [T],
    registered: RwLock<Vec<T>>,
}

impl<T: Named + Clone> Registry<T> {
    /// A registry of `what`, in the singular, with the entries of its crate.
    pub const fn new(what: &'static str, own: &'static [T]) -> Self {
        Self { what, own, registered: RwLock::new(Vec::new()) }
    }

    /// Adds an entry after all others.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if its name is taken.
    pub fn register(&self, entry: T) -> Result<()> {
        let mut registered = self.registered.write().unwrap_or_else(PoisonError::into_inner);
        if self.own.iter().chain(&*registered).any(|known| known.name() == entry.name()) {
            let article = if self.what.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
            return Err(Error::Inconsistent(format!("there is {article} {} '{}' already", self.what, entry.name())));
        }
        registered.push(entry);
        Ok(())
    }

    /// All entries.
    pub fn all(&self) -> Vec<T> {
        let registered = self.registered.read().unwrap_or_else(PoisonError::into_inner);
        self.own.iter().chain(&*registered).cloned().collect()
    }

    /// An entry by its name.
    ///
    /// # Errors
    /// [`Error::UnknownName`] if there is none.
    pub fn find(&self, name: &str) -> Result<T> {
        let mut all = self.all();
        let names: Vec<_> = all.iter().map(Named::name).collect();
        match names.iter().position(|known| *known == name) {
            Some(found) => Ok(all.swap_remove(found)),
            None => Err(Error::unknown(self.what, name, &names)),
        }
    }
}
