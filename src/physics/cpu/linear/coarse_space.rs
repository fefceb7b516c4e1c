//! Coarse space of the two-level preconditioner: the six rigid-body modes of every group of nodes.
//!
//! Block Jacobi reduces high-frequency errors within a few iterations; smooth errors take hundreds,
//! more where stiff parts lie in soft ones. The rigid-body modes of groups of nodes, 40 in a small
//! body and hundreds in a large one (Galerkin, added to block Jacobi), reduce smooth errors.

use super::block_matrix::BlockMatrix;
use super::rigid_modes::add_projected_block;
use super::rigid_projection::RigidProjection;
use super::sparse_cholesky::{SparseCholesky, Vec6Padded};
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{SymMat3, V4, add, cross};
use glam::{DMat3, DVec3};

/// Relative shift of the diagonal of the coarse matrix: rotations of a group with collinear nodes,
/// or of a constrained group, are null modes.
const DIAGONAL_SHIFT: f64 = 1e-7;

/// Rigid-body modes of the groups of nodes, and the Cholesky factor of their matrix.
#[derive(Clone, Debug)]
pub struct CoarseSpace<T> {
    /// Position of every node relative to the centre of its group, in the group's radii; the fourth
    /// lane is 1, or 0 for fixed nodes.
    lever_arms: Vec<V4<T>>,
    /// Group of every node.
    group: Vec<u32>,
    factor: SparseCholesky<T>,
    ready: bool,
}

impl<T: Real> CoarseSpace<T> {
    /// Analyses the couplings between the groups of `plan` in the linearised `terms`.
    pub fn new(plan: &Partition, terms: &(impl BlockMatrix<T> + ?Sized)) -> CoarseSpace<T> {
        let group = aggregate_of_nodes(plan);
        let mut pairs = Vec::new();
        let mut last = (u32::MAX, u32::MAX);
        terms.visit_off_diagonal(&mut |[i, j], _| {
            let pair = (group[i as usize], group[j as usize]);
            if pair.0 != pair.1 && pair != last {
                pairs.push(pair);
                pairs.push((pair.1, pair.0));
                last = pair;
            }
            if pairs.len() > 1 << 22 {
                pairs.sort_unstable();
                pairs.dedup();
            }
        });
        pairs.sort_unstable();
        pairs.dedup();
        CoarseSpace {
            lever_arms: vec![[T::ZERO; 4]; plan.nodes()],
            factor: SparseCholesky::new(plan.groups(), &pairs),
            group,
            ready: false,
        }
    }

    /// Whether the factorisation succeeded.
    pub fn is_factorised(&self) -> bool {
        self.ready
    }

    /// Assembles and factorises the coarse matrix of the linearised `terms`. `points` returns the
    /// nodes' positions, `free` whether they can move; a rigid body in `rigid_projection` is a
    /// group that uses the body's own modes.
    pub fn factorise(
        &mut self,
        plan: &Partition,
        points: impl Fn(usize) -> DVec3,
        free: impl Fn(usize) -> bool,
        diagonal: &[SymMat3<T>],
        terms: &(impl BlockMatrix<T> + ?Sized),
        rigid_projection: &RigidProjection<T>,
    ) {
        self.update_rigid_modes(plan, points, free, rigid_projection);
        self.factor.clear();
        let mut known = (u32::MAX, u32::MAX, 0, false);
        for (i, d) in diagonal.iter().enumerate() {
            let d = d.map(Real::to_f64);
            let m = DMat3::from_cols_array(&[d[0], d[3], d[4], d[3], d[1], d[5], d[4], d[5], d[2]]);
            let g = self.group[i];
            if let Some((index, _)) = self.factor.block_index(g, g) {
                add_projected_block(
                    &m,
                    &self.lever_arms[i],
                    &self.lever_arms[i],
                    self.factor.block_mut(index),
                    false,
                );
            }
        }
        let (arms, group, factor) = (&self.lever_arms, &self.group, &mut self.factor);
        terms.visit_off_diagonal(&mut |[i, j], m| {
            let [a, b] = [i, j].map(|v| group[v as usize]);
            let (i, j) = (&arms[i as usize], &arms[j as usize]);
            if (known.0, known.1) != (a, b) {
                let Some((index, transposed)) = factor.block_index(a, b) else {
                    return;
                };
                known = (a, b, index, transposed);
            }
            let block = factor.block_mut(known.2);
            if a == b {
                add_projected_block(m, i, j, block, false);
            }
            add_projected_block(m, i, j, block, known.3 || a == b);
        });
        self.shift_diagonal(plan.groups());
        self.ready = self.factor.factorise();
    }

    /// Updates the lever arms of all nodes; arguments as for [`CoarseSpace::factorise`].
    fn update_rigid_modes(
        &mut self,
        plan: &Partition,
        points: impl Fn(usize) -> DVec3,
        free: impl Fn(usize) -> bool,
        rigid_projection: &RigidProjection<T>,
    ) {
        for g in 0..plan.groups() {
            let first = plan.group(g).start;
            let arms = &mut self.lever_arms[plan.group(g)];
            if let Some(body) = rigid_projection.block_of_group(g) {
                // A constrained body lacks some of these modes.
                match body.free() {
                    true => arms.copy_from_slice(body.lever_arms()),
                    false => arms.fill([T::ZERO; 4]),
                }
                continue;
            }
            let count = arms.len();
            let nodes = || (first..first + count).filter(|i| free(*i));
            let count = nodes().count().max(1) as f64;
            let centre = nodes().map(&points).sum::<DVec3>() / count;
            let distance_squared = |i: usize| points(i).distance_squared(centre);
            let radius = (nodes().map(distance_squared).sum::<f64>() / count).sqrt();
            let over = if radius > 0.0 { 1.0 / radius } else { 0.0 };
            for (n, arm) in arms.iter_mut().enumerate() {
                *arm = [T::ZERO; 4];
                if free(first + n) {
                    let r = (points(first + n) - centre) * over;
                    *arm = [T::from_f64(r.x), T::from_f64(r.y), T::from_f64(r.z), T::ONE];
                }
            }
        }
    }

    /// Makes the assembled matrix positive definite.
    fn shift_diagonal(&mut self, groups: usize) {
        for g in 0..groups as u32 {
            if let Some((index, _)) = self.factor.block_index(g, g) {
                let block = self.factor.block_mut(index);
                let largest = (0..6).map(|k| block[k][k]).fold(0.0, f64::max);
                for (k, column) in block.iter_mut().enumerate() {
                    match largest > 0.0 {
                        true => column[k] += DIAGONAL_SHIFT * largest,
                        // All nodes of the group are fixed.
                        false => column[k] = 1.0,
                    }
                }
            }
        }
    }

    /// Restricts the forces `r` on the nodes of a group, beginning with node `first`, to its modes.
    #[inline]
    pub fn restrict(&self, first: usize, r: &[V4<T>]) -> Vec6Padded<T> {
        let (mut sum, mut torque) = ([T::ZERO; 4], [T::ZERO; 4]);
        for (r, a) in r.iter().zip(&self.lever_arms[first..]) {
            let w = a[3];
            sum = add(sum, [w * r[0], w * r[1], w * r[2], T::ZERO]);
            torque = add(torque, cross(*a, *r));
        }
        let z = T::ZERO;
        [
            sum[0], sum[1], sum[2], torque[0], torque[1], torque[2], z, z,
        ]
    }

    /// Solves the coarse system in index: one vector per group.
    pub fn solve(&mut self, x: &mut [Vec6Padded<T>]) {
        self.factor.solve(x);
    }

    /// Returns the lever arms of the nodes from `first`, for [`prolong`](super::rigid_modes::prolong).
    pub fn lever_arms(&self, first: usize) -> &[V4<T>] {
        &self.lever_arms[first..]
    }
}

fn aggregate_of_nodes(plan: &Partition) -> Vec<u32> {
    let mut of = vec![0; plan.nodes()];
    for g in 0..plan.groups() {
        of[plan.group(g)].fill(g as u32);
    }
    of
}
