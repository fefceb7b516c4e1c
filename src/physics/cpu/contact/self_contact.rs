//! Self-contact: an energy term that keeps parts of the boundary of a body apart.
//!
//! E = Σ m A K ĝ b(d/ĝ) over vertex–face and edge–edge pairs with a distance d < ĝ, where b is the
//! barrier of incremental potential contact and m its mollifier of nearly parallel edges (Li et al.
//! 2020, equations 6 and 24). Blocks are restricted to the line between the closest points and thus
//! positive semidefinite. Friction is as in [`super::tool_contact`].

use super::boundary_surface::BoundarySurface;
use super::candidates::{CollisionCandidate, Intersection, SelfContactSurface};
use super::pair_friction::PairFriction;
use crate::physics::contact::{Barrier, FrictionMollifier, PrimitivePair};
use crate::physics::cpu::linear::point_blocks::PointBlocks;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::outer_product;
use crate::physics::cpu::vectors::to_dvec;
use crate::physics::cpu::vectors::to_v4;
use crate::physics::cpu::vectors::{V4, add};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// Maximum deviation of nodes from the motion for which pairs are selected, over the mean boundary
/// edge length.
const CANDIDATE_MARGIN: f64 = 0.1;

/// Distance by which initially intersecting edges and faces are separated per step, over the mean
/// edge length.
const SEPARATION_STEP: f64 = 0.1;

/// Distance to which they are separated, over the mean edge length.
const SEPARATION_DISTANCE: f64 = 0.1;

/// Stiffness of their separation springs, over that of the material behind them.
const SEPARATION_STIFFNESS: f64 = 30.0;

/// A pair within its gap.
pub(super) struct ActivePair {
    pub weights: [f64; 4],
    pub normal: DVec3,
    pub barrier: Barrier,
    /// m, and its gradient at the four nodes.
    pub mollifier: f64,
    mollifier_gradient: [DVec3; 4],
}

/// A spring that pulls an edge out of a face: E = ½ k (goal − s)² while the clearance s of its end
/// is less than `goal`.
#[derive(Clone, Copy, Debug)]
struct SeparationSpring {
    crossing: Intersection,
    goal: f64,
    /// k.
    stiffness: f64,
    chunk: u32,
}

/// The self-contact term of a body.
pub(in crate::physics::cpu) struct SelfContactTerm<T> {
    pub surface: SelfContactSurface,
    pub friction: f64,
    /// ĝ.
    pub gap: f64,
    /// Regularisation speed of the friction.
    pub static_friction_speed: f64,
    /// Whether friction is linearised exactly.
    pub is_exact: bool,
    pub(super) pairs: Vec<CollisionCandidate>,
    /// Indices of the pairs with a node in each chunk.
    chunk_pairs: Vec<Vec<u32>>,
    lagged_friction: Vec<PairFriction>,
    separation_springs: Vec<SeparationSpring>,
    chunk_starts: Vec<usize>,
    blocks: PointBlocks<T>,
}

impl<T: Real> SelfContactTerm<T> {
    /// Creates the term for a boundary.
    pub fn new(
        hull: BoundarySurface,
        plan: &Partition,
        [friction, gap, static_friction_speed]: [f64; 3],
    ) -> SelfContactTerm<T> {
        let chunks = plan.chunks();
        SelfContactTerm {
            surface: SelfContactSurface::new(hull),
            friction,
            gap,
            static_friction_speed,
            is_exact: false,
            pairs: Vec::new(),
            chunk_pairs: vec![Vec::new(); chunks],
            lagged_friction: Vec::new(),
            separation_springs: Vec::new(),
            chunk_starts: (0..chunks).map(|c| plan.range(c).start).collect(),
            blocks: PointBlocks::new(chunks),
        }
    }

    /// Begins a step in which nodes move by about `moved`. Returns whether any pair may come near.
    pub fn begin(
        &mut self,
        with: (&[V4<T>], &[T], &Partition),
        rigid: &RigidBodies,
        moved: &(dyn Fn(usize) -> DVec3 + Sync),
    ) -> bool {
        self.surface.begin(with.0);
        self.find_intersections(with.0, with.2);
        self.lagged_friction.clear();
        self.select_candidates(with, rigid, moved, CANDIDATE_MARGIN * self.surface.edge());
        self.update_lagged_friction(with.0);
        !self.is_empty()
    }

    /// Finds the intersections at `u`, which are separated in this step.
    fn find_intersections(&mut self, u: &[V4<T>], plan: &Partition) {
        let edge = self.surface.edge();
        let found = self.surface.mark_intersections(u);
        let spring = |crossing: Intersection| {
            let depth = self.signed_clearance(&crossing, u);
            SeparationSpring {
                goal: (SEPARATION_DISTANCE * edge).min(depth + SEPARATION_STEP * edge),
                stiffness: SEPARATION_STIFFNESS * crossing.weight / edge,
                chunk: plan.chunk_of(crossing.nodes[0] as usize) as u32,
                crossing,
            }
        };
        self.separation_springs = found.into_iter().map(spring).collect();
    }

    /// Returns the signed distance of an intersecting edge's end in front of the face; negative
    /// behind it.
    fn signed_clearance(&self, crossing: &Intersection, u: &[V4<T>]) -> f64 {
        let ends = crossing.nodes.iter().zip(crossing.weights);
        let separation: DVec3 = ends.map(|(i, w)| w * self.surface.position(*i, u)).sum();
        separation.dot(crossing.normal)
    }

    /// Returns the missing clearance; 0 if there is enough.
    fn separation_deficit(&self, spring: &SeparationSpring, u: &[V4<T>]) -> f64 {
        (spring.goal - self.signed_clearance(&spring.crossing, u)).max(0.0)
    }

    /// Returns whether any edge intersects a face at `u`, if the step began without intersections.
    pub fn has_new_intersections(&mut self, u: &[V4<T>]) -> bool {
        self.separation_springs.is_empty()
            && !self.pairs.is_empty()
            && !self.surface.crossings(u).is_empty()
    }

    /// Whether the step began with intersections, which it separates.
    pub fn is_separating(&self) -> bool {
        !self.separation_springs.is_empty()
    }

    fn select_candidates(
        &mut self,
        with: (&[V4<T>], &[T], &Partition),
        rigid: &RigidBodies,
        moved: &(dyn Fn(usize) -> DVec3 + Sync),
        margin: f64,
    ) {
        let key =
            |pair: &CollisionCandidate| (pair.features == PrimitivePair::EdgeEdge, pair.nodes);
        // Keeps the friction forces of pairs that are selected again.
        let lagged_friction: BTreeMap<_, PairFriction> = self
            .pairs
            .iter()
            .zip(&self.lagged_friction)
            .filter(|(_, friction)| friction.max_force > 0.0)
            .map(|(pair, friction)| (key(pair), *friction))
            .collect();
        self.pairs = self
            .surface
            .build_candidates(with, rigid, moved, (self.gap, margin));
        self.chunk_pairs.iter_mut().for_each(Vec::clear);
        for (k, pair) in self.pairs.iter().enumerate() {
            pair.chunks_of()
                .for_each(|c| self.chunk_pairs[c].push(k as u32));
        }
        let friction = |pair: &CollisionCandidate| {
            lagged_friction.get(&key(pair)).copied().unwrap_or_default()
        };
        self.lagged_friction = match lagged_friction.is_empty() {
            true => Vec::new(),
            false => self.pairs.iter().map(friction).collect(),
        };
    }

    /// Updates the pairs if necessary, so that they include all primitives that may touch on the
    /// path from the displacements `from` to `to`.
    pub fn refresh_candidates(
        &mut self,
        [from, to]: [&[V4<T>]; 2],
        (free, plan): (&[T], &Partition),
        rigid: &RigidBodies,
    ) {
        if [from, to].iter().any(|u| self.surface.exceeds_margin(u)) {
            let moved = |i: usize| to_dvec(to[i]) - to_dvec(from[i]);
            let margin = CANDIDATE_MARGIN * self.surface.edge();
            self.select_candidates((from, free, plan), rigid, &moved, margin);
        }
    }

    /// Returns the fraction of the path from the displacements `from` to `to` on which every pair
    /// keeps the fraction `kept` of its distance.
    pub fn collision_free_fraction(
        &mut self,
        [from, to]: [&[V4<T>]; 2],
        with: (&[T], &Partition),
        rigid: &RigidBodies,
        kept: f64,
    ) -> f64 {
        self.refresh_candidates([from, to], with, rigid);
        let fractions = self.pairs.iter().map(|pair| {
            let ends = [from, to].map(|u| self.positions(pair, u));
            pair.features
                .collision_free_fraction(&ends[0], &ends[1], kept)
        });
        fractions.fold(1.0, f64::min)
    }

    /// Returns whether no pair may come near.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty() && self.separation_springs.is_empty()
    }

    pub(super) fn positions(&self, pair: &CollisionCandidate, u: &[V4<T>]) -> [DVec3; 4] {
        pair.nodes.map(|i| self.surface.position(i, u))
    }

    /// Returns the contact data of a pair, or `None` beyond its gap.
    pub(super) fn active_pair(&self, pair: &CollisionCandidate, u: &[V4<T>]) -> Option<ActivePair> {
        Self::active_pair_at(pair, &self.positions(pair, u))
    }

    /// As [`SelfContactTerm::active_pair`], with the four nodes at `x`.
    pub(super) fn active_pair_at(pair: &CollisionCandidate, x: &[DVec3; 4]) -> Option<ActivePair> {
        let nearest = pair.features.closest_points(x);
        if nearest.distance >= pair.gap {
            return None;
        }
        let (mollifier, mollifier_gradient) = pair.features.edge_edge_mollifier(x, pair.lengths);
        Some(ActivePair {
            weights: nearest.weights,
            normal: nearest.normal,
            barrier: Barrier::unclamped(nearest.distance / pair.gap),
            mollifier,
            mollifier_gradient,
        })
    }

    /// Returns the forces of an active pair on its four nodes.
    pub(super) fn pair_forces(pair: &CollisionCandidate, active: &ActivePair) -> [DVec3; 4] {
        let along =
            -pair.weight * active.mollifier * active.barrier.first_derivative * active.normal;
        let by_gradient = -pair.weight * pair.gap * active.barrier.value;
        [0, 1, 2, 3].map(|k| active.weights[k] * along + by_gradient * active.mollifier_gradient[k])
    }

    /// Stores the normal forces and normals at `u` for friction. Returns the relative change of the
    /// forces.
    pub fn update_lagged_friction(&mut self, u: &[V4<T>]) -> f64 {
        if self.friction == 0.0 {
            return 0.0;
        }
        let mut lagged_friction = std::mem::take(&mut self.lagged_friction);
        lagged_friction.resize(self.pairs.len(), PairFriction::default());
        let (mut change, mut all) = (0.0, 0.0);
        for (pair, friction) in self.pairs.iter().zip(&mut lagged_friction) {
            let before = std::mem::take(friction);
            if let Some(active) = self.active_pair(pair, u) {
                *friction = self.friction_at(pair, &active);
            }
            change +=
                (friction.max_force * friction.normal).distance(before.max_force * before.normal);
            all += friction.max_force;
        }
        self.lagged_friction = lagged_friction;
        match change > 0.0 {
            true => change / all.max(change),
            false => 0.0,
        }
    }

    pub(super) fn velocities(pair: &CollisionCandidate, v: &[V4<T>]) -> [DVec3; 4] {
        pair.nodes.map(|i| to_dvec(v[i as usize]))
    }

    /// Σ λ² w²/m over pairs; see [`super::tool_contact::ToolContact::residual_scale`].
    pub fn residual_scale(&self, u: &[V4<T>], over: impl Fn(usize, DVec3) -> f64) -> f64 {
        let of = |pair: &CollisionCandidate| {
            let active = self.active_pair(pair, u)?;
            let forces = pair.nodes.iter().zip(Self::pair_forces(pair, &active));
            Some(forces.map(|(i, f)| over(*i as usize, f)).sum::<f64>())
        };
        let separation_springs = self.separation_springs.iter().map(|spring| {
            let forces = spring
                .crossing
                .nodes
                .iter()
                .zip(self.separation_forces(spring, u));
            forces.map(|(i, f)| over(*i as usize, f)).sum::<f64>()
        });
        self.pairs.iter().filter_map(of).sum::<f64>() + separation_springs.sum::<f64>()
    }

    /// Returns the forces of a separation spring.
    fn separation_forces(&self, spring: &SeparationSpring, u: &[V4<T>]) -> [DVec3; 4] {
        let force = spring.stiffness * self.separation_deficit(spring, u) * spring.crossing.normal;
        spring.crossing.weights.map(|w| w * force)
    }

    /// Returns the energy of a chunk's separation springs.
    fn separation_energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let springs = self
            .separation_springs
            .iter()
            .filter(|d| d.chunk as usize == chunk);
        springs
            .map(|d| 0.5 * d.stiffness * self.separation_deficit(d, u).powi(2))
            .sum()
    }

    /// Returns the pairs with a node in a chunk, and whether the chunk counts their energy.
    fn of_chunk(&self, chunk: usize) -> impl Iterator<Item = (usize, &CollisionCandidate, bool)> {
        self.chunk_pairs[chunk].iter().map(move |k| {
            let pair = &self.pairs[*k as usize];
            (*k as usize, pair, pair.chunks[0] as usize == chunk)
        })
    }

    /// Adds forces on nodes to those of a chunk.
    fn add(&self, chunk: usize, nodes: &[u32; 4], forces: [DVec3; 4], f: &mut [V4<T>]) {
        for (i, force) in nodes.iter().zip(forces) {
            // Nodes before the chunk wrap around and are beyond its end.
            if let Some(f) = f.get_mut((*i as usize).wrapping_sub(self.chunk_starts[chunk])) {
                *f = add(*f, to_v4(force));
            }
        }
    }

    fn friction_of(&self, k: usize) -> Option<&PairFriction> {
        self.lagged_friction
            .get(k)
            .filter(|friction| friction.max_force > 0.0)
    }

    /// Returns the minimum of distance over gap of all pairs at `u`.
    #[cfg(test)]
    pub fn min_gap_ratio(&self, u: &[V4<T>]) -> f64 {
        let gap = |pair: &CollisionCandidate| {
            pair.features
                .closest_points(&self.positions(pair, u))
                .distance
                / pair.gap
        };
        self.pairs.iter().map(gap).fold(f64::INFINITY, f64::min)
    }
}

impl<T: Real> Term<T> for SelfContactTerm<T> {
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let energy = self.elastic_forces(chunk, at.u, f);
        self.damping_forces(chunk, at, f);
        energy
    }

    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        let mut energy = 0.0;
        for (_, pair, counts) in self.of_chunk(chunk) {
            let Some(active) = self.active_pair(pair, u) else {
                continue;
            };
            self.add(chunk, &pair.nodes, Self::pair_forces(pair, &active), f);
            if counts {
                energy += active.mollifier * pair.weight * pair.gap * active.barrier.value;
            }
        }
        for spring in &self.separation_springs {
            self.add(
                chunk,
                &spring.crossing.nodes,
                self.separation_forces(spring, u),
                f,
            );
        }
        energy + self.separation_energy(chunk, u)
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let counted = self.of_chunk(chunk).filter(|(.., counts)| *counts);
        counted
            .filter_map(|(_, pair, _)| {
                let active = self.active_pair(pair, u)?;
                Some(active.mollifier * pair.weight * pair.gap * active.barrier.value)
            })
            .sum::<f64>()
            + self.separation_energy(chunk, u)
    }

    fn damped(&self) -> bool {
        self.friction > 0.0
    }

    fn is_friction(&self) -> bool {
        true
    }

    fn damping_forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let mut loss = 0.0;
        for (k, pair, counts) in self.of_chunk(chunk) {
            let Some(friction) = self.friction_of(k) else {
                continue;
            };
            let velocities = Self::velocities(pair, at.v);
            let force = friction.force(velocities, self.static_friction_speed);
            self.add(chunk, &pair.nodes, friction.weights.map(|w| w * force), f);
            if counts {
                let speed = friction.slide(velocities).length();
                loss += friction.max_force
                    * FrictionMollifier::at(speed, self.static_friction_speed).value;
            }
        }
        loss
    }

    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        contribution: SystemContribution<'_, T>,
    ) {
        let h = h.to_f64();
        let mut blocks = std::mem::replace(&mut self.blocks, PointBlocks::new(0));
        blocks.clear();
        for (k, pair) in self.pairs.iter().enumerate() {
            if let Some(active) = self.active_pair(pair, at.u) {
                let stiffness_along =
                    h * h * active.mollifier * pair.weight * active.barrier.second_derivative
                        / pair.gap;
                let block = stiffness_along * outer_product(active.normal);
                blocks.push(
                    plan,
                    (pair.nodes, active.weights),
                    &block,
                    contribution.diagonal,
                );
            }
            if let Some(friction) = self.friction_of(k) {
                let velocities = Self::velocities(pair, at.v);
                let block = self.friction_block(friction, velocities) * h;
                blocks.push(
                    plan,
                    (pair.nodes, friction.weights),
                    &block,
                    contribution.diagonal,
                );
            }
        }
        for spring in self
            .separation_springs
            .iter()
            .filter(|d| self.separation_deficit(d, at.u) > 0.0)
        {
            let Intersection {
                nodes,
                weights,
                normal,
                ..
            } = spring.crossing;
            let block = outer_product(normal) * (h * h * spring.stiffness);
            blocks.push(plan, (nodes, weights), &block, contribution.diagonal);
        }
        self.blocks = blocks;
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        self.blocks
            .multiply((chunk, self.chunk_starts[chunk]), p, y);
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.blocks.visit_off_diagonal(visit);
    }
}
