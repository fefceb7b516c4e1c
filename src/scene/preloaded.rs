//! Data that is loaded before a scene uses it.

use std::fmt;
use std::sync::Arc;

/// Content of the file of an entry, if the caller has loaded it already; otherwise the file is read
/// when needed. It is not part of the scene's checksum.
pub struct Preloaded<T>(pub Option<Arc<T>>);

impl<T> Default for Preloaded<T> {
    fn default() -> Preloaded<T> {
        Preloaded(None)
    }
}

impl<T> Clone for Preloaded<T> {
    fn clone(&self) -> Preloaded<T> {
        Preloaded(self.0.clone())
    }
}

impl<T> fmt::Debug for Preloaded<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("_")
    }
}
