//! Values derived from a shape, computed on first use and shared by its copies.

use std::sync::{Arc, OnceLock};

/// A derived value. All values compare equal, so that they do not affect the equality of shapes.
#[derive(Clone)]
pub(super) struct Cached<T>(OnceLock<Arc<T>>);

impl<T> Cached<T> {
    /// Returns the value, from `compute` on the first call.
    pub(super) fn get_or_init(&self, compute: impl FnOnce() -> T) -> &T {
        self.0.get_or_init(|| Arc::new(compute()))
    }
}

impl<T> Default for Cached<T> {
    fn default() -> Self {
        Self(OnceLock::new())
    }
}

impl<T> std::fmt::Debug for Cached<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Cached")
    }
}

impl<T> PartialEq for Cached<T> {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
