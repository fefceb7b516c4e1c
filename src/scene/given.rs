//! What a program has read before a scene does.

use std::fmt;
use std::sync::Arc;

/// What the file of an entry holds, where who uses the scene has read it already; otherwise it is read
/// when it is needed. No part of what tells one scene from another.
pub struct Given<T>(pub Option<Arc<T>>);

impl<T> Default for Given<T> {
    fn default() -> Given<T> {
        Given(None)
    }
}

impl<T> Clone for Given<T> {
    fn clone(&self) -> Given<T> {
        Given(self.0.clone())
    }
}

impl<T> fmt::Debug for Given<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("_")
    }
}
