//! Projection of conjugate gradients onto rigid-body modes: the nodes of a rigid body share its six
//! unknowns.
//!
//! Vectors of a solve keep an entry for every node. Directions stay in the range of P, where row i
//! of P is [I, −[a]×] for node i's arm a: they are P B Pᵀ r, with B the inverse of the body's own
//! block of Pᵀ A P. This is conjugate gradients on Pᵀ A P, without forming that matrix.

use super::rigid_modes::{add_projected_block, prolong};
use super::sparse_cholesky::{Block, DOF_PER_GROUP, Vec6Padded, inverse_factor};
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::Term;
use crate::physics::cpu::vectors::{SymMat3, V4, add, zero};
use glam::{DMat3, DQuat, DVec3};
use std::ops::Range;

/// Nodes of one rigid body.
#[derive(Clone, Debug)]
pub struct RigidBlock<T> {
    nodes: Range<usize>,
    /// Position of each node relative to the pivot, in the body's radii; the fourth lane is 1, or 0
    /// if the pivot is fixed. All zero if the body is fixed.
    lever_arms: Vec<V4<T>>,
    /// Projector onto the permitted rotations.
    rotation_projector: DMat3,
    /// B.
    inverse: [Vec6Padded<T>; DOF_PER_GROUP],
    /// B as built, the body's rotation at that time, and its current one; the block is `None` if it
    /// was not positive definite.
    built_block: Option<Block>,
    built_rotation: DQuat,
    rotation: DQuat,
    /// Whether the body has all six modes, like a group of a coarse space.
    free: bool,
}

/// Rigid bodies, the last groups of a plan; usually there are none.
#[derive(Clone, Debug)]
pub struct RigidProjection<T> {
    /// First of these groups.
    first: usize,
    /// First of their nodes.
    node: usize,
    bodies: Vec<RigidBlock<T>>,
}

/// Pose of a rigid body, as its modes need it.
#[derive(Clone, Copy, Debug)]
pub struct BlockPose<'a> {
    /// Position of each of its nodes relative to its centre, before the rotation.
    pub lever_arms: &'a [DVec3],
    /// Pivot, relative to its centre.
    pub pivot: DVec3,
    /// Inverse of its length scale; 0 if the body is fixed.
    pub scale: f64,
    /// Rotation.
    pub rotation: DQuat,
    /// Projector onto the permitted rotations.
    pub rotation_projector: DMat3,
    /// Whether the body has all six modes.
    pub free: bool,
}

impl<T: Real> RigidProjection<T> {
    /// Creates a projection without rigid bodies.
    pub fn empty() -> RigidProjection<T> {
        RigidProjection {
            first: usize::MAX,
            node: usize::MAX,
            bodies: Vec::new(),
        }
    }

    /// Creates the projection for bodies with these nodes, the last groups of a plan. `first` is
    /// the first of these groups.
    pub fn new(first: usize, bodies: &[Range<usize>]) -> RigidProjection<T> {
        let Some(start) = bodies.first().map(|nodes| nodes.start) else {
            return RigidProjection::empty();
        };
        let body = |nodes: &Range<usize>| RigidBlock {
            nodes: nodes.clone(),
            lever_arms: vec![zero(); nodes.len()],
            rotation_projector: DMat3::ZERO,
            inverse: [[T::ZERO; 8]; DOF_PER_GROUP],
            built_block: None,
            built_rotation: DQuat::IDENTITY,
            rotation: DQuat::IDENTITY,
            free: false,
        };
        RigidProjection {
            first,
            node: start,
            bodies: bodies.iter().map(body).collect(),
        }
    }

    /// Returns the projection for a coarser system with the same rigid bodies, the first of them its
    /// group `first`, and `fewer` nodes less before them.
    pub fn for_coarser_system(&self, first: usize, fewer: usize) -> RigidProjection<T> {
        let mut coarser = self.clone();
        if !coarser.bodies.is_empty() {
            coarser.first = first;
            coarser.node -= fewer;
        }
        for body in &mut coarser.bodies {
            body.nodes = body.nodes.start - fewer..body.nodes.end - fewer;
        }
        coarser
    }

    /// Whether there are no rigid bodies.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Index of the first node of a rigid body.
    pub fn first_node(&self) -> usize {
        self.node
    }

    /// Returns the body of a group, if it is one.
    #[inline(always)]
    pub fn block_of_group(&self, group: usize) -> Option<&RigidBlock<T>> {
        self.bodies.get(group.checked_sub(self.first)?)
    }

    /// Whether node `i` belongs to a rigid body.
    #[inline(always)]
    pub fn contains(&self, i: usize) -> bool {
        i >= self.node
    }

    /// Updates the arms of a body to its pose, and rotates B with it.
    pub fn set_pose(&mut self, body: usize, pose: &BlockPose<'_>) {
        let body = &mut self.bodies[body];
        body.free = pose.free;
        body.rotation_projector = pose.rotation_projector;
        let weight = if body.free { T::ONE } else { T::ZERO };
        for (lever_arm, r) in body.lever_arms.iter_mut().zip(pose.lever_arms) {
            let a = pose.rotation * (*r - pose.pivot) * pose.scale;
            *lever_arm = [T::from_f64(a.x), T::from_f64(a.y), T::from_f64(a.z), weight];
        }
        body.rotation = pose.rotation;
        body.rotate_inverse();
    }

    /// Builds the bodies' blocks from the linearised terms, with the diagonal blocks `diagonal`.
    /// They are kept as long as a coarse space.
    pub(in crate::physics::cpu) fn build(
        &mut self,
        diagonal: &[SymMat3<T>],
        terms: &[Box<dyn Term<T>>],
    ) {
        for body in &mut self.bodies {
            let (first, lever_arms) = (body.nodes.start, &body.lever_arms);
            let mut block: Block = [[0.0; DOF_PER_GROUP]; DOF_PER_GROUP];
            for (d, lever_arm) in diagonal[body.nodes.clone()].iter().zip(lever_arms) {
                let d = d.map(Real::to_f64);
                let x = DVec3::new(d[0], d[3], d[4]);
                let (y, z) = (DVec3::new(d[3], d[1], d[5]), DVec3::new(d[4], d[5], d[2]));
                let m = DMat3::from_cols(x, y, z);
                add_projected_block(&m, lever_arm, lever_arm, &mut block, false);
            }
            for term in terms {
                term.visit_off_diagonal_in(body.nodes.clone(), &mut |[i, j], m| {
                    let [a, b] = [i, j].map(|v| &lever_arms[v as usize - first]);
                    add_projected_block(m, a, b, &mut block, false);
                    add_projected_block(m, a, b, &mut block, true);
                });
            }
            body.built_block = inverse_within(&block, body.free, &body.rotation_projector);
            body.built_rotation = body.rotation;
            body.rotate_inverse();
        }
    }

    /// Whether all blocks were positive definite.
    pub(in crate::physics::cpu) fn is_positive_definite(&self) -> bool {
        self.bodies.iter().all(|body| body.built_block.is_some())
    }

    /// Iterates over the rigid bodies of a chunk.
    pub(in crate::physics::cpu) fn bodies_of(
        &self,
        plan: &Partition,
        chunk: usize,
    ) -> impl Iterator<Item = &RigidBlock<T>> + '_ {
        plan.groups_of(chunk).filter_map(|g| self.block_of_group(g))
    }

    /// Zeroes the forces on constrained bodies, which the coarse space must not include.
    pub fn remove_constrained_forces(&self, forces: &mut [Vec6Padded<T>]) {
        for (body, f) in self.bodies.iter().zip(forces.iter_mut().skip(self.first)) {
            if !body.free {
                *f = [T::ZERO; 8];
            }
        }
    }

    /// Adds the motions B f of the bodies for `forces` to those of the coarse space, if there was
    /// one.
    pub fn apply_inverse(
        &self,
        forces: &[Vec6Padded<T>],
        motions: &mut [Vec6Padded<T>],
        coarse: bool,
    ) {
        let from = self.first.min(forces.len());
        let all = forces[from..].iter().zip(&mut motions[from..]);
        for (body, (f, m)) in self.bodies.iter().zip(all) {
            let motion = body.apply_inverse_block(f);
            match coarse {
                true => m.iter_mut().zip(motion).for_each(|(m, o)| *m += o),
                false => *m = motion,
            }
        }
    }
}

impl<T: Real> RigidBlock<T> {
    fn rotate_inverse(&mut self) {
        let Some(built) = &self.built_block else {
            return;
        };
        let relative_rotation = DMat3::from_quat(self.rotation * self.built_rotation.inverse());
        let mut q = [[0.0; DOF_PER_GROUP]; DOF_PER_GROUP];
        for k in 0..3 {
            for r in 0..3 {
                (q[k][r], q[3 + k][3 + r]) =
                    (relative_rotation.col(k)[r], relative_rotation.col(k)[r]);
            }
        }
        let back: Block = std::array::from_fn(|c| std::array::from_fn(|r| q[r][c]));
        let inverse = times(&times(&q, built), &back);
        let entry = |c: usize, r: usize| {
            if r < DOF_PER_GROUP {
                T::from_f64(inverse[c][r])
            } else {
                T::ZERO
            }
        };
        self.inverse = std::array::from_fn(|c| std::array::from_fn(|r| entry(c, r)));
    }

    /// Its nodes.
    pub fn nodes(&self) -> Range<usize> {
        self.nodes.clone()
    }

    /// Returns Pᵀ r of the body's nodes: `at` returns r of the n-th node.
    #[inline]
    pub fn restrict(&self, at: impl Fn(usize) -> V4<T>) -> Vec6Padded<T> {
        let (mut sum, mut torque) = ([0.0; 3], [0.0; 3]);
        for (n, lever_arm) in self.lever_arms.iter().enumerate() {
            let [a, r] = [lever_arm, &at(n)].map(|v| [v[0].to_f64(), v[1].to_f64(), v[2].to_f64()]);
            let w = lever_arm[3].to_f64();
            for k in 0..3 {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                sum[k] += w * r[k];
                torque[k] += a[i] * r[j] - a[j] * r[i];
            }
        }
        let [[x, y, z], [a, b, c]] = [sum, torque].map(|v| v.map(T::from_f64));
        [x, y, z, a, b, c, T::ZERO, T::ZERO]
    }

    /// Returns B f.
    #[inline]
    pub fn apply_inverse_block(&self, f: &Vec6Padded<T>) -> Vec6Padded<T> {
        let mut out = [T::ZERO; 8];
        for (column, f) in self.inverse.iter().zip(f) {
            for (o, c) in out.iter_mut().zip(column) {
                *o += *c * *f;
            }
        }
        out
    }

    /// Returns f·B f.
    #[inline]
    pub fn energy(&self, f: &Vec6Padded<T>) -> f64 {
        let m = self.apply_inverse_block(f);
        (0..DOF_PER_GROUP).map(|k| (f[k] * m[k]).to_f64()).sum()
    }

    /// Returns the lever arms, for [`prolong`].
    pub fn lever_arms(&self) -> &[V4<T>] {
        &self.lever_arms
    }

    /// Whether the body has all six modes.
    pub fn free(&self) -> bool {
        self.free
    }

    /// Computes p = z + P m + β p at the body's nodes, where z is from the diagonal blocks.
    #[inline]
    pub fn update_direction(&self, m: &Vec6Padded<T>, beta: T, p: &mut [V4<T>]) {
        for (p, lever_arm) in p.iter_mut().zip(&self.lever_arms) {
            let z = prolong(lever_arm, m);
            *p = add(z, [beta * p[0], beta * p[1], beta * p[2], T::ZERO]);
        }
    }
}

/// a b.
fn times(a: &Block, b: &Block) -> Block {
    std::array::from_fn(|c| {
        std::array::from_fn(|r| (0..DOF_PER_GROUP).map(|k| a[k][r] * b[c][k]).sum::<f64>())
    })
}

/// Returns the inverse of a body's block, restricted to its permitted modes.
fn inverse_within(block: &Block, free: bool, within: &DMat3) -> Option<Block> {
    let keep = f64::from(u8::from(free));
    let mut p = [[0.0; DOF_PER_GROUP]; DOF_PER_GROUP];
    for k in 0..3 {
        p[k][k] = keep;
        for r in 0..3 {
            p[3 + k][3 + r] = within.col(k)[r];
        }
    }
    let mut whole = times(&times(&p, block), &p);
    let scale = (0..DOF_PER_GROUP).map(|k| whole[k][k]).fold(0.0, f64::max);
    let scale = if scale > 0.0 { scale } else { 1.0 };
    for c in 0..DOF_PER_GROUP {
        for r in 0..DOF_PER_GROUP {
            whole[c][r] += scale * (f64::from(u8::from(r == c)) - p[c][r]);
        }
    }
    let lower = inverse_factor(&whole)?;
    // A⁻¹ = L⁻ᵀ L⁻¹.
    let inverse: Block = std::array::from_fn(|c| {
        std::array::from_fn(|r| {
            (0..DOF_PER_GROUP)
                .map(|k| lower[r][k] * lower[c][k])
                .sum::<f64>()
        })
    });
    Some(times(&times(&p, &inverse), &p))
}
