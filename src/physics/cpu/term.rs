//! Terms of a body's energy: elements, springs, a floor, contact and external potentials.

use super::partition::Partition;
use super::scalar::Real;
use super::vectors::{SymMat3, V4};
use glam::DMat3;
use std::any::Any;
use std::ops::Range;

/// State at which forces are evaluated, in local units and the engine's order.
#[derive(Clone, Copy, Debug)]
pub struct StateRef<'a, T> {
    /// Displacement of every node from its rest position. Not positions: a spring's stretch is a
    /// small difference of displacements, which in f32 would lose most of its digits.
    pub u: &'a [V4<T>],
    /// Velocity of every node.
    pub v: &'a [V4<T>],
}

/// Contribution of a term to the implicit Euler system, A = M − h ∂f/∂v − h² K̃, where K̃ is ∂f/∂x
/// projected to negative semidefinite.
#[derive(Debug)]
pub struct SystemContribution<'a, T> {
    /// Diagonal blocks of A.
    pub diagonal: &'a mut [SymMat3<T>],
    /// K̃ v; finite elements do not need it and leave it unchanged.
    pub stiffness_velocity: &'a mut [V4<T>],
}

/// A term of a body's energy, with its forces and damping.
///
/// The nodes are partitioned by a [`Partition`]. Functions with a chunk argument add to the nodes
/// of that chunk only, and run for all chunks in parallel. A term uses the partition and node order
/// that it was made for.
pub trait Term<T: Real>: Any + Send + Sync {
    /// Adds the forces on the nodes of a chunk to `f`, which begins with the chunk's first node.
    /// Returns the chunk's share of the energy; the shares sum to the term's energy. Local units.
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64;

    /// As [`Term::forces`] without damping, at the displacements `u`.
    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64;

    /// Returns only the energy of [`Term::elastic_forces`].
    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64;

    /// Whether any element of the chunk is inverted at the displacements `u`.
    fn inverted(&self, _: usize, _: &[V4<T>]) -> bool {
        false
    }

    /// Whether there is any damping.
    fn damped(&self) -> bool {
        false
    }

    /// Stores the displacements at which [`Term::damping_forces`] and the damping of
    /// [`Term::linearise`] are evaluated, if the term keeps them.
    fn freeze_damping(&mut self, _: &Partition, _: &[V4<T>]) {}

    /// Adds the damping forces alone, with D(u) at the displacements `at.u`, which are those of the
    /// last [`Term::freeze_damping`]. Returns the chunk's share of ½ v·D v.
    fn damping_forces(&self, _: usize, _: StateRef<'_, T>, _: &mut [V4<T>]) -> f64 {
        0.0
    }

    /// Whether its damping is friction, which is not linear in velocities.
    fn is_friction(&self) -> bool {
        false
    }

    /// Sets the term's amplitude, if it has one, from all amplitudes.
    fn set_amplitudes(&mut self, _: &[f64]) {}

    /// Sets whether the stiffness is projected to positive semidefinite; terms that are always
    /// semidefinite ignore it.
    fn set_psd_projection(&mut self, _: bool) {}

    /// Linearises the term at a state for steps of length `h`, and adds its share of the system;
    /// keeps the data that [`Term::multiply`] needs.
    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    );

    /// Adds the term's part of A p, at the last linearisation, to the nodes of a chunk: `y` begins
    /// with the chunk's first node; its fourth lanes are arbitrary. Damping and stiffness only: the
    /// masses belong to no term.
    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]);

    /// Visits every block A_ij with i < j, at the last linearisation, whole or in several parts, to
    /// build a coarse space. The diagonal blocks are in [`SystemContribution::diagonal`].
    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3));

    /// [`Term::visit_off_diagonal`] restricted to pairs within `nodes`, which lie in one chunk.
    fn visit_off_diagonal_in(&self, nodes: Range<usize>, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.visit_off_diagonal(&mut |pair, m| {
            if pair.iter().all(|i| nodes.contains(&(*i as usize))) {
                visit(pair, m);
            }
        });
    }
}

/// Returns the first of `terms` that is a `K`.
pub fn find_term<T: Real, K: Term<T>>(terms: &[Box<dyn Term<T>>]) -> Option<&K> {
    let mut all = terms.iter().map(|term| term.as_ref() as &dyn Any);
    all.find_map(|term| term.downcast_ref())
}

/// As [`find_term`], mutable.
pub fn find_term_mut<T: Real, K: Term<T>>(terms: &mut [Box<dyn Term<T>>]) -> Option<&mut K> {
    let mut all = terms.iter_mut().map(|term| term.as_mut() as &mut dyn Any);
    all.find_map(|term| term.downcast_mut())
}
