//! From scans and surfaces to tetrahedral meshes.

mod domain;

pub use domain::Domain;

/// Told what is being done and the fraction of it that is done, now and then.
pub type Progress<'a> = &'a (dyn Fn(&str, f64) + Sync);
