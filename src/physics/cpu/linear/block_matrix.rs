//! Sparse matrices of 3×3 blocks: the linearised terms of a body, or their restriction to linear
//! tets.

use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::V4;
use glam::DMat3;

/// A symmetric matrix of 3×3 blocks, its rows partitioned into chunks.
pub trait BlockMatrix<T: Real>: Sync {
    /// Adds the matrix times p to the nodes of a chunk: `y` begins with the chunk's first node; its
    /// fourth lanes are arbitrary.
    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]);

    /// Visits every block above the diagonal, whole or in several parts.
    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3));
}

impl<T: Real> BlockMatrix<T> for [Box<dyn Term<T>>] {
    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        for term in self {
            term.multiply(chunk, p, y);
        }
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for term in self {
            term.visit_off_diagonal(visit);
        }
    }
}
