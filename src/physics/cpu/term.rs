//! What a body's energy is made of: springs, a floor, and whatever else pushes or pulls.

use super::contact::self_contact::SelfContactTerm;
use super::contact::tool_contact::ToolContact;
use super::partition::Partition;
use super::rigid::target_springs::RigidTargetSprings;
use super::scalar::Real;
use super::vectors::{SymMat3, V4};
use glam::DMat3;
use std::ops::Range;

/// The state that forces are taken at, in local units and the engine's order.
#[derive(Clone, Copy, Debug)]
pub struct StateRef<'a, T> {
    /// Displacement of every node from its rest position. Not positions: what a spring stretches
    /// is a small difference of these, which in f32 would lose most of its digits.
    pub u: &'a [V4<T>],
    /// Velocity of every node.
    pub v: &'a [V4<T>],
}

/// What a term adds to the system of implicit Euler, A = M − h ∂f/∂v − h² K̃: K̃ is ∂f/∂x without
/// what is not negative semidefinite.
#[derive(Debug)]
pub struct SystemContribution<'a, T> {
    /// The diagonal blocks of A.
    pub diagonal: &'a mut [SymMat3<T>],
    /// K̃ v; finite elements, which are stepped without it, leave it alone.
    pub stiffness_velocity: &'a mut [V4<T>],
}

/// A term of a body's energy, with the forces and the damping that come of it.
///
/// The nodes are shared out by a [`Partition`]. Functions that are given a chunk add to the nodes of
/// that chunk alone, and are called for all chunks at the same time. A term goes by the plan and
/// the order of nodes that it was made for.
pub trait Term<T: Real>: Send + Sync {
    /// Adds the forces on the nodes of a chunk to `f`, which begins with the chunk's first node.
    /// Returns the energy of the chunk's share, such that all shares make up the term's energy.
    /// Local units.
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64;

    /// As [`Term::forces`] without damping, at the displacements `u`.
    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64;

    /// The energy alone that [`Term::elastic_forces`] returns.
    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64;

    /// Whether any of the chunk's share is inside out at the displacements `u`.
    fn inverted(&self, _: usize, _: &[V4<T>]) -> bool {
        false
    }

    /// Whether there is any damping.
    fn damped(&self) -> bool {
        false
    }

    /// Takes note of the displacements at which [`Term::damping_forces`] and the damping of
    /// [`Term::linearise`] are to be taken, as far as they are kept.
    fn freeze_damping(&mut self, _: &Partition, _: &[V4<T>]) {}

    /// Adds the forces of the damping alone, D(u) being taken at the displacements `at.u`, which
    /// are those of the last [`Term::freeze_damping`]. Returns the chunk's share of ½ v·D v.
    fn damping_forces(&self, _: usize, _: StateRef<'_, T>, _: &mut [V4<T>]) -> f64 {
        0.0
    }

    /// Takes the level that the term acts at, if it has one, from among all.
    fn set_amplitudes(&mut self, _: &[f64]) {}

    /// Says whether the stiffness is to be linearised without what is not positive semidefinite;
    /// terms that never have any of that ignore it.
    fn set_psd_projection(&mut self, _: bool) {}

    /// Linearises the term at a state for steps of length `h`, and adds its share of the system;
    /// what [`Term::multiply`] needs is kept.
    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    );

    /// Adds the term's part of A p, as last linearised, to the nodes of a chunk: `y` begins with
    /// the chunk's first node; its fourth lanes may be anything. Damping and stiffness only, the
    /// masses are no term's.
    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]);

    /// The tools that press on the body, of the term that they are.
    fn as_tool_contact(&self) -> Option<&ToolContact<T>> {
        None
    }

    /// As [`Term::as_tool_contact`], to move them.
    fn contact_mut(&mut self) -> Option<&mut ToolContact<T>> {
        None
    }

    /// The body's contact with itself, of the term that it is.
    fn as_self_contact(&self) -> Option<&SelfContactTerm<T>> {
        None
    }

    /// As [`Term::as_self_contact`], to change it.
    fn touching_mut(&mut self) -> Option<&mut SelfContactTerm<T>> {
        None
    }

    /// The springs from rigid bodies to targets, of the term that they are, to change them.
    fn tethers_mut(&mut self) -> Option<&mut RigidTargetSprings<T>> {
        None
    }

    /// Tells every block A_ij with i < j, as last linearised, once or in parts: what a coarse
    /// space is built from. The blocks on the diagonal are those of [`SystemContribution::diagonal`].
    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3));

    /// [`Term::visit_off_diagonal`] of which both nodes are among these, which are all in one chunk.
    fn visit_off_diagonal_in(&self, nodes: Range<usize>, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.visit_off_diagonal(&mut |pair, m| {
            if pair.iter().all(|i| nodes.contains(&(*i as usize))) {
                visit(pair, m);
            }
        });
    }
}
