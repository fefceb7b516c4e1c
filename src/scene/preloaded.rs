//! What a program has read before a scene does.

use std::fmt;
use std::sync::Arc;

/// What the file of an entry holds, where who uses the scene has read it already; otherwise it is read
/// when it is needed. No part of what tells one scene from another.
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
