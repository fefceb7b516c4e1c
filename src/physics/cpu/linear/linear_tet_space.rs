//! Linear tets as the coarse space of quadratic ones.
//!
//! With P the matrix of [`LinearTetNodes`], which interpolates displacements linearly along each
//! edge, a few iterations of conjugate gradients on Pᵀ A P, preconditioned by its own diagonal
//! blocks and the rigid-body modes of groups of its nodes, approximate P (Pᵀ A P)⁻¹ Pᵀ. It has an
//! eighth of the unknowns of A and a fifteenth of its blocks. With it the iterations on A no longer
//! grow with the mesh.

use super::block_csr::BlockCsr;
use super::block_matrix::BlockMatrix;
use super::cg::{CgSolver, CgTolerance, SystemOperator};
use super::coarse_space::CoarseSpace;
use super::linear_tet_nodes::LinearTetNodes;
use super::rigid_projection::RigidProjection;
use crate::physics::cpu::partition::{Chunks, Nodes};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{
    Mat3Columns, SymMat3, V4, add_scaled, inverse_definite, scale, zero,
};
use glam::{DMat3, DVec3};

/// Relative residual and number of iterations at which a solve for the linear tets ends.
const TOLERANCE: f64 = 0.2;
const MAX_ITERATIONS: u32 = 10;

/// Pairs collected before they are sorted and merged.
const MAX_UNMERGED_PAIRS: usize = 1 << 22;

/// The coarse space of the linear tets within the quadratic tets of a body.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct LinearTetSpace<T> {
    nodes: LinearTetNodes,
    /// Weight of each parent in the displacement of a node of the body: ½, or 0 if the node is
    /// fixed.
    weights: Vec<T>,
    /// Pᵀ A P; `None` until it is needed, or after its pattern changed.
    matrix: Option<LinearTetMatrix<T>>,
    diagonal: Vec<SymMat3<T>>,
    masses: Vec<T>,
    free: Vec<T>,
    solver: CgSolver<T>,
    coarse: Option<CoarseSpace<T>>,
    ready: bool,
}

impl<T: Real> LinearTetSpace<T> {
    /// Creates the space.
    pub fn new(nodes: LinearTetNodes) -> LinearTetSpace<T> {
        let count = nodes.nodes.len();
        LinearTetSpace {
            weights: vec![T::ZERO; nodes.parents.len()],
            matrix: None,
            diagonal: vec![[T::ZERO; 8]; count],
            masses: vec![T::ZERO; count],
            free: vec![T::ZERO; count],
            solver: CgSolver::new(&nodes.plan),
            coarse: None,
            ready: false,
            nodes,
        }
    }

    /// Whether the last [`LinearTetSpace::factorise`] succeeded.
    pub fn is_ready(&self) -> bool {
        self.ready
    }

    /// Drops the pattern of Pᵀ A P, which changes with contact.
    pub fn drop_pattern(&mut self) {
        self.matrix = None;
        self.coarse = None;
        self.ready = false;
    }

    /// Computes Pᵀ A P of the linearised `terms` and prepares its preconditioner. Arguments as for
    /// [`CoarseSpace::factorise`].
    pub fn factorise(
        &mut self,
        points: impl Fn(usize) -> DVec3,
        free: impl Fn(usize) -> bool,
        diagonal: &[SymMat3<T>],
        terms: &(impl BlockMatrix<T> + ?Sized),
        rigid_projection: &RigidProjection<T>,
    ) {
        let half = T::from_f64(0.5);
        for (i, weight) in self.weights.iter_mut().enumerate() {
            *weight = if free(i) { half } else { T::ZERO };
        }
        let nodes = &self.nodes;
        for (free, i) in self.free.iter_mut().zip(&nodes.nodes) {
            *free = self.weights[*i as usize] + self.weights[*i as usize];
        }
        let matrix = self
            .matrix
            .get_or_insert_with(|| LinearTetMatrix::new(nodes, terms));
        matrix.assemble(nodes, &self.weights, diagonal, terms, &mut self.diagonal);
        self.solver.rigid_projection = self.nodes_of_rigid_bodies(rigid_projection);
        let definite = self.invert_diagonal();
        let (matrix, nodes) = (&self.matrix, &self.nodes);
        let Some(matrix) = matrix else {
            return;
        };
        let coarse = self
            .coarse
            .get_or_insert_with(|| CoarseSpace::new(&nodes.plan, matrix));
        coarse.factorise(
            &nodes.plan,
            |k| points(nodes.nodes[k] as usize),
            |k| self.free[k] != T::ZERO,
            &self.diagonal,
            matrix,
            &self.solver.rigid_projection,
        );
        self.ready = definite && coarse.is_factorised();
    }

    /// Returns the projection of the body, at its nodes among the linear tets'.
    fn nodes_of_rigid_bodies(&self, body: &RigidProjection<T>) -> RigidProjection<T> {
        body.for_coarser_system(self.nodes.first_rigid_group, self.nodes.removed())
    }

    /// Inverts the diagonal blocks. Returns whether all are positive definite.
    fn invert_diagonal(&mut self) -> bool {
        let (diagonal, free) = (&self.diagonal, &self.free);
        let solver = &mut self.solver;
        let rigid = &solver.rigid_projection;
        let data = (Nodes(&mut solver.inverse), ());
        let [bad] = self
            .nodes
            .plan
            .for_each_chunk(data, &|_, nodes, (inverses, ())| {
                let mut bad = 0.0;
                for (to, k) in inverses.0.iter_mut().zip(nodes) {
                    *to = [zero(); 3];
                    if free[k] != T::ZERO && !rigid.contains(k) {
                        let (inverse, definite) = inverse_definite(&diagonal[k]);
                        *to = inverse;
                        bad += f64::from(u8::from(!definite));
                    }
                }
                [bad]
            });
        bad == 0.0
    }

    /// Takes over the poses of the rigid bodies before a solve.
    pub fn set_rigid_bodies(&mut self, body: &RigidProjection<T>) {
        if !body.is_empty() {
            self.solver.rigid_projection = self.nodes_of_rigid_bodies(body);
        }
    }

    /// Solves Pᵀ A P x ≈ Pᵀ r for [`LinearTetSpace::add_solution`]. Returns whether no direction of
    /// negative curvature was found.
    pub fn solve(&mut self, r: &[V4<T>]) -> bool {
        let Some(matrix) = &self.matrix else {
            return true;
        };
        let (nodes, weights, free) = (&self.nodes, &self.weights, &self.free);
        let two = T::from_f64(2.0);
        let data = (Nodes(&mut self.solver.residual), ());
        nodes
            .plan
            .for_each_chunk(data, &|_, chunk, (restricted, ())| {
                for (to, k) in restricted.0.iter_mut().zip(chunk) {
                    let own = nodes.nodes[k] as usize;
                    let mut sum = scale(two * weights[own], r[own]);
                    for i in nodes.middles(k) {
                        sum = add_scaled(sum, weights[*i as usize], r[*i as usize]);
                    }
                    *to = scale(free[k], [sum[0], sum[1], sum[2], T::ZERO]);
                }
                []
            });
        let operator = SystemOperator {
            plan: &nodes.plan,
            masses: &self.masses,
            free,
            terms: matrix,
        };
        let stop = CgTolerance {
            tolerance: TOLERANCE,
            floor: 0.0,
            max_iterations: MAX_ITERATIONS,
        };
        let start = self.solver.preconditioned_norm_squared(&nodes.plan);
        let result = self
            .solver
            .solve_from_zero(&operator, &mut self.coarse, start, stop);
        !result.indefinite
    }

    /// Computes y += Pᵀ A P x.
    #[cfg(test)]
    pub fn multiply(&self, x: &[V4<T>], y: &mut [V4<T>]) {
        for (c, matrix) in self.matrix.iter().flat_map(|m| m.chunks.iter().enumerate()) {
            matrix.multiply(&matrix.values, x, &mut y[self.nodes.plan.range(c)]);
        }
    }

    /// Adds P x at node `i` of the body.
    #[inline(always)]
    pub fn add_solution(&self, i: usize, to: V4<T>) -> V4<T> {
        let [a, b] = self.nodes.parents[i].map(|k| self.solver.solution[k as usize]);
        add_scaled(add_scaled(to, self.weights[i], a), self.weights[i], b)
    }
}

/// Pᵀ A P, by chunks of the linear-tet nodes.
#[derive(Clone, Debug)]
struct LinearTetMatrix<T> {
    chunks: Vec<BlockCsr<T>>,
}

impl<T: Real> LinearTetMatrix<T> {
    /// Creates the matrix with the pattern of `terms`, and no values.
    fn new(nodes: &LinearTetNodes, terms: &(impl BlockMatrix<T> + ?Sized)) -> LinearTetMatrix<T> {
        let mut pairs: Vec<[u32; 2]> = Vec::new();
        let middles = nodes.parents.iter().filter(|[a, b]| a != b);
        pairs.extend(middles.map(|[a, b]| [*a.min(b), *a.max(b)]));
        let mut unmerged = MAX_UNMERGED_PAIRS;
        terms.visit_off_diagonal(&mut |[i, j], _| {
            each_pair(nodes, i, j, |a, b, _| {
                if a != b {
                    pairs.push([a.min(b), a.max(b)]);
                }
            });
            if pairs.len() > unmerged {
                pairs.sort_unstable();
                pairs.dedup();
                unmerged = pairs.len() + MAX_UNMERGED_PAIRS;
            }
        });
        pairs.sort_unstable();
        pairs.dedup();
        let plan = &nodes.plan;
        let rows = |c| BlockCsr::new(plan.range(c), pairs.iter().map(|pair| pair.as_slice()));
        LinearTetMatrix {
            chunks: (0..plan.chunks()).map(rows).collect(),
        }
    }

    /// Computes Pᵀ A P from the diagonal blocks of A and its `terms`, and its diagonal blocks.
    fn assemble(
        &mut self,
        nodes: &LinearTetNodes,
        weights: &[T],
        diagonal: &[SymMat3<T>],
        terms: &(impl BlockMatrix<T> + ?Sized),
        diagonal_out: &mut [SymMat3<T>],
    ) {
        let chunks = &mut self.chunks;
        chunks
            .iter_mut()
            .for_each(|rows| rows.values.fill([zero(); 3]));
        let mut on_diagonal = vec![DMat3::ZERO; nodes.nodes.len()];
        let mut add = |a: u32, b: u32, m: &DMat3| {
            let block = columns(m);
            let homes = [a, b].map(|k| nodes.plan.chunk_of(k as usize));
            for home in &homes[..if homes[0] == homes[1] { 1 } else { 2 }] {
                let slot = chunks[*home].entry_slot(a, b);
                chunks[*home].add_placed(slot, &block);
            }
        };
        for (i, d) in diagonal.iter().enumerate() {
            let (w, [a, b]) = (weights[i].to_f64(), nodes.parents[i]);
            let m = symmetric(d) * (w * w);
            on_diagonal[a as usize] += m;
            on_diagonal[b as usize] += m;
            if a == b {
                on_diagonal[a as usize] += 2.0 * m;
            } else {
                add(a, b, &m);
            }
        }
        terms.visit_off_diagonal(&mut |[i, j], m| {
            let by = weights[i as usize].to_f64() * weights[j as usize].to_f64();
            if by == 0.0 {
                return;
            }
            each_pair(nodes, i, j, |a, b, times| {
                let m = *m * (by * times);
                if a == b {
                    on_diagonal[a as usize] += m + m.transpose();
                } else {
                    add(a, b, &m);
                }
            });
        });
        for (to, m) in diagonal_out.iter_mut().zip(&on_diagonal) {
            let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
            *to = [x.x, y.y, z.z, y.x, z.x, z.y, 0.0, 0.0].map(T::from_f64);
        }
        let (plan, diagonal) = (&nodes.plan, &*diagonal_out);
        plan.for_each_chunk((Chunks(chunks), ()), &|_, nodes, (rows, ())| {
            for rows in rows.0 {
                rows.finish_with_diagonal(&diagonal[nodes.clone()]);
            }
            []
        });
    }
}

impl<T: Real> BlockMatrix<T> for LinearTetMatrix<T> {
    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        let rows = &self.chunks[chunk];
        rows.multiply(&rows.values, p, y);
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for rows in &self.chunks {
            rows.visit_upper_blocks(visit);
        }
    }
}

/// Calls `found(a, b, times)` for the parents a of node `i` and b of node `j`, which is how often
/// they occur: a node that is its own parent has it twice.
#[inline(always)]
fn each_pair(nodes: &LinearTetNodes, i: u32, j: u32, mut found: impl FnMut(u32, u32, f64)) {
    let [a, b] = [i, j].map(|i| nodes.parents[i as usize]);
    let [once_a, once_b] = [a, b].map(|[p, q]| p == q);
    for p in &a[..if once_a { 1 } else { 2 }] {
        for q in &b[..if once_b { 1 } else { 2 }] {
            let times = f64::from((1 + u8::from(once_a)) * (1 + u8::from(once_b)));
            found(*p, *q, times);
        }
    }
}

fn symmetric<T: Real>(d: &SymMat3<T>) -> DMat3 {
    let d = d.map(Real::to_f64);
    DMat3::from_cols_array(&[d[0], d[3], d[4], d[3], d[1], d[5], d[4], d[5], d[2]])
}

fn columns<T: Real>(m: &DMat3) -> Mat3Columns<T> {
    [m.x_axis, m.y_axis, m.z_axis].map(|c| {
        let [x, y, z] = c.to_array().map(T::from_f64);
        [x, y, z, T::ZERO]
    })
}
