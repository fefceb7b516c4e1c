//! Springs from points of rigid bodies to targets, as an energy term, so that a light body on a
//! stiff spring is stable.
//!
//! E = ½ k d² up to the force limit F, and F d − ½ F²/k beyond, with d the distance of a point from
//! its target. The point is a weighted mean of its body's proxy nodes.

use crate::physics::cpu::linear::point_blocks::PointBlocks;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::outer_product;
use crate::physics::cpu::vectors::to_dvec;
use crate::physics::cpu::vectors::to_v4;
use crate::physics::cpu::vectors::{V4, add};
use glam::{DMat3, DVec3};

/// A target spring, local units.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct RigidTargetSpring {
    /// Proxy nodes of a body, and their weights in the point.
    pub nodes: [u32; 4],
    pub weights: [f64; 4],
    /// Vector from the point's rest position to the target.
    pub target_offset: DVec3,
    pub stiffness: f64,
    pub limit: f64,
}

impl RigidTargetSpring {
    /// Returns the vector from the point to the target.
    fn displacement_to_target<T: Real>(&self, u: &[V4<T>]) -> DVec3 {
        let nodes = self.nodes.iter().zip(self.weights);
        self.target_offset
            - nodes
                .map(|(i, w)| w * to_dvec(u[*i as usize]))
                .sum::<DVec3>()
    }

    /// Returns its force on the point, and its energy.
    fn force_and_energy<T: Real>(&self, u: &[V4<T>]) -> (DVec3, f64) {
        let off = self.displacement_to_target(u);
        let force = (self.stiffness * off).clamp_length_max(self.limit);
        let size = force.length();
        let energy = match self.stiffness > 0.0 {
            true => size * off.length() - 0.5 * size * size / self.stiffness,
            false => 0.0,
        };
        (force, energy)
    }

    /// Returns −∂F/∂x, which is positive semidefinite.
    fn block<T: Real>(&self, u: &[V4<T>]) -> DMat3 {
        let off = self.displacement_to_target(u);
        let distance = off.length();
        if self.stiffness * distance <= self.limit {
            return DMat3::IDENTITY * self.stiffness;
        }
        (DMat3::IDENTITY - outer_product(off / distance)) * (self.limit / distance)
    }
}

/// All target springs of a body.
pub(in crate::physics::cpu) struct RigidTargetSprings<T> {
    all: Vec<RigidTargetSpring>,
    firsts: Vec<usize>,
    /// Chunk of the first node of each spring, which counts its energy.
    homes: Vec<usize>,
    blocks: PointBlocks<T>,
}

impl<T: Real> RigidTargetSprings<T> {
    /// Creates an empty set.
    pub fn new(plan: &Partition) -> RigidTargetSprings<T> {
        RigidTargetSprings {
            all: Vec::new(),
            firsts: (0..plan.chunks()).map(|c| plan.range(c).start).collect(),
            homes: Vec::new(),
            blocks: PointBlocks::new(plan.chunks()),
        }
    }

    /// Replaces the springs.
    pub fn set(&mut self, all: Vec<RigidTargetSpring>, plan: &Partition) {
        let home = |tether: &RigidTargetSpring| plan.chunk_of(tether.nodes[0] as usize);
        self.homes = all.iter().map(home).collect();
        self.all = all;
        self.blocks.clear();
    }

    fn of_chunk(&self, chunk: usize) -> impl Iterator<Item = &RigidTargetSpring> {
        let homes = self.all.iter().zip(&self.homes);
        homes
            .filter(move |(_, home)| **home == chunk)
            .map(|(t, _)| t)
    }
}

impl<T: Real> Term<T> for RigidTargetSprings<T> {
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        self.elastic_forces(chunk, at.u, f)
    }

    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        // The proxy nodes of a body are all in one chunk, like all of its nodes.
        let own = self.of_chunk(chunk).map(|tether| {
            let (force, energy) = tether.force_and_energy(u);
            for (i, w) in tether.nodes.iter().zip(tether.weights) {
                let f = &mut f[*i as usize - self.firsts[chunk]];
                *f = add(*f, to_v4(w * force));
            }
            energy
        });
        own.sum()
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        self.of_chunk(chunk)
            .map(|tether| tether.force_and_energy(u).1)
            .sum()
    }

    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    ) {
        let square = h.to_f64() * h.to_f64();
        self.blocks.clear();
        for tether in &self.all {
            let block = square * tether.block(at.u);
            let mean = (tether.nodes, tether.weights);
            self.blocks.push(plan, mean, &block, share.diagonal);
        }
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        self.blocks.multiply((chunk, self.firsts[chunk]), p, y);
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.blocks.visit_off_diagonal(visit);
    }
}
