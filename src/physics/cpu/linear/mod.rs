//! Linear algebra of the implicit step: block matrices, conjugate gradients, the coarse space and
//! the projection onto rigid-body modes.

pub(super) mod block_csr;
pub(super) mod block_matrix;
pub(super) mod cg;
pub(super) mod coarse_space;
mod flexible_cg;
pub(super) mod flexible_gmres;
pub(super) mod linear_tet_nodes;
pub(super) mod linear_tet_space;
#[cfg(test)]
mod linear_tet_tests;
pub(super) mod point_blocks;
pub(super) mod rigid_modes;
pub(super) mod rigid_projection;
pub(super) mod sparse_cholesky;
