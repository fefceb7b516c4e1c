//! The largest step an explicit scheme can take, from the mesh.

use super::kind::SolverKind;
use super::network::SpringNetwork;
use crate::reference::spectrum::Linearised;

/// The largest stable time step of `solver` for `network` at rest with these nodes pinned, in
/// seconds; `None` for implicit Euler, which has none.
///
/// From the eigenvalues of the scheme's own step matrix, damping included: see
/// [`Linearised::largest_step`]. Undamped it is 2/ω_max for the symplectic schemes; explicit Euler
/// without damping is never stable: 0. A body stretched far from rest may need less.
pub fn largest_stable_step(
    network: &SpringNetwork,
    pinned: &[bool],
    solver: SolverKind,
) -> Option<f64> {
    let limit = Linearised::new(network, pinned).largest_step(solver)?;
    Some(limit.step)
}
