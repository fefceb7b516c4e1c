//! The six rigid-body modes of a group of nodes: the row of node i in their matrix P is
//! w [I, −[a]×], with a the node's arm and w its fourth lane.

use super::sparse_cholesky::{Block, Vec6Padded};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{V4, add, cross};
use glam::{DMat3, DVec3};

/// Returns the displacement of a node with the given arm for the rigid motion `m` of its group.
#[inline(always)]
pub fn prolong<T: Real>(arm: &V4<T>, m: &Vec6Padded<T>) -> V4<T> {
    let w = arm[3];
    add(
        [w * m[0], w * m[1], w * m[2], T::ZERO],
        cross([m[3], m[4], m[5], T::ZERO], *arm),
    )
}

/// Adds P_iᵀ m P_j, or its transpose, to a block: P = w [I, −[a]×].
pub(in crate::physics::cpu) fn add_projected_block<T: Real>(
    m: &DMat3,
    i: &V4<T>,
    j: &V4<T>,
    block: &mut Block,
    transposed: bool,
) {
    let [a, b] = [i, j].map(|v| DVec3::new(v[0].to_f64(), v[1].to_f64(), v[2].to_f64()));
    let [wa, wb] = [i, j].map(|v| v[3].to_f64());
    let columns = [
        m.x_axis * wb,
        m.y_axis * wb,
        m.z_axis * wb,
        // m (e_k × b).
        m.z_axis * b.y - m.y_axis * b.z,
        m.x_axis * b.z - m.z_axis * b.x,
        m.y_axis * b.x - m.x_axis * b.y,
    ];
    for (c, column) in columns.iter().enumerate() {
        let (s, t) = (*column * wa, a.cross(*column));
        let full = [s.x, s.y, s.z, t.x, t.y, t.z];
        for (r, x) in full.iter().enumerate() {
            if transposed {
                block[r][c] += x;
            } else {
                block[c][r] += x;
            }
        }
    }
}
