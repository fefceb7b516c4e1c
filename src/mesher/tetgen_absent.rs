//! In a browser there are no other programs to run.

use super::{MeshedDomain, Spacing};
use crate::mesh::TriMesh;
use crate::{Error, ProgressFn, Result};

/// Says that TetGen cannot be run here.
///
/// # Errors
/// Always [`Error::Input`].
pub fn tetgen(_: &[TriMesh], _: Spacing, _: ProgressFn) -> Result<MeshedDomain> {
    Err(Error::Input(
        "TetGen is a program, which a browser cannot run; use the lattice mesher".into(),
    ))
}
