//! Stub for browsers, where no other programs can be run.

use crate::mesh::TriMesh;
use crate::mesher::{MeshedDomain, Spacing};
use crate::{Error, ProgressFn, Result};

/// Returns the error that TetGen cannot be run here.
///
/// # Errors
/// Always an [`Error::Input`].
pub fn tetgen(_: &[TriMesh], _: Spacing, _: ProgressFn) -> Result<MeshedDomain> {
    Err(Error::Input(
        "TetGen is not available in a browser; use the lattice mesher".into(),
    ))
}
