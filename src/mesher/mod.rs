//! From scans and surfaces to tetrahedral meshes.

mod domain;
mod length;
mod window;

pub use domain::Domain;
pub use length::{Length, metres_in};
pub use window::Window;

/// Told what is being done and the fraction of it that is done, now and then.
pub type Progress<'a> = &'a (dyn Fn(&str, f64) + Sync);
