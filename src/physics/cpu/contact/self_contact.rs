//! Self-contact: an energy term that keeps parts of the boundary of a body apart.
//!
//! E = Σ m A K ĝ b(d/ĝ) over vertex–face and edge–edge pairs with a distance d < ĝ, where b is the
//! barrier of incremental potential contact and m its mollifier of nearly parallel edges (Li et al.
//! 2020, equations 6 and 24). Blocks are restricted to the line between the closest points and thus
//! positive semidefinite. Friction is as in [`super::tool_contact`].

use super::boundary_surface::BoundarySurface;
use super::candidates::{CollisionCandidate, Intersection, SelfContactSurface};
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

/// Initially intersecting edges and faces are separated: by the first fraction of the mean edge
/// length per step, up to the second, with the third times the stiffness of the material behind
/// them.
const SEPARATION_STEP: f64 = 0.1;
const SEPARATION_DISTANCE: f64 = 0.1;
const SEPARATION_STIFFNESS: f64 = 30.0;

/// Friction data of a pair, from the previous iterate.
#[derive(Clone, Copy, Debug, Default)]
struct PairFriction {
    weights: [f64; 4],
    normal: DVec3,
    /// μ times the normal force.
    limit: f64,
}

/// A pair within its gap.
struct ActivePair {
    weights: [f64; 4],
    normal: DVec3,
    barrier: Barrier,
    /// m, and its gradient at the four nodes.
    share: f64,
    slope: [DVec3; 4],
}

/// A spring that pulls an edge out of a face: E = ½ k (goal − s)² while the clearance s of its end
/// is less than `goal`.
#[derive(Clone, Copy, Debug)]
struct SeparationSpring {
    crossing: Intersection,
    goal: f64,
    /// k.
    stiffness: f64,
    home: u32,
}

/// The self-contact term of a body.
pub(in crate::physics::cpu) struct SelfContactTerm<T> {
    pub surface: SelfContactSurface,
    pub friction: f64,
    /// ĝ.
    pub gap: f64,
    /// Regularisation speed of the friction.
    pub least_speed: f64,
    pairs: Vec<CollisionCandidate>,
    /// Indices of the pairs with a node in each chunk.
    homes: Vec<Vec<u32>>,
    rubs: Vec<PairFriction>,
    drawn: Vec<SeparationSpring>,
    firsts: Vec<usize>,
    blocks: PointBlocks<T>,
}

impl<T: Real> SelfContactTerm<T> {
    /// Creates the term for a boundary.
    pub fn new(
        hull: BoundarySurface,
        plan: &Partition,
        [friction, gap, least_speed]: [f64; 3],
    ) -> SelfContactTerm<T> {
        let chunks = plan.chunks();
        SelfContactTerm {
            surface: SelfContactSurface::new(hull),
            friction,
            gap,
            least_speed,
            pairs: Vec::new(),
            homes: vec![Vec::new(); chunks],
            rubs: Vec::new(),
            drawn: Vec::new(),
            firsts: (0..chunks).map(|c| plan.range(c).start).collect(),
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
        self.rubs.clear();
        self.choose(with, rigid, moved, CANDIDATE_MARGIN * self.surface.edge());
        self.update_friction(with.0);
        !self.is_empty()
    }

    /// Finds the intersections at `u`, which are separated in this step.
    fn find_intersections(&mut self, u: &[V4<T>], plan: &Partition) {
        let edge = self.surface.edge();
        let found = self.surface.mark_intersections(u);
        let draw = |crossing: Intersection| {
            let depth = self.signed_clearance(&crossing, u);
            SeparationSpring {
                goal: (SEPARATION_DISTANCE * edge).min(depth + SEPARATION_STEP * edge),
                stiffness: SEPARATION_STIFFNESS * crossing.weight / edge,
                home: plan.chunk_of(crossing.nodes[0] as usize) as u32,
                crossing,
            }
        };
        self.drawn = found.into_iter().map(draw).collect();
    }

    /// Returns the signed distance of an intersecting edge's end in front of the face; negative
    /// behind it.
    fn signed_clearance(&self, crossing: &Intersection, u: &[V4<T>]) -> f64 {
        let ends = crossing.nodes.iter().zip(crossing.weights);
        let apart: DVec3 = ends.map(|(i, w)| w * self.surface.place(*i, u)).sum();
        apart.dot(crossing.normal)
    }

    /// Returns the missing clearance; 0 if there is enough.
    fn separation_deficit(&self, drawn: &SeparationSpring, u: &[V4<T>]) -> f64 {
        (drawn.goal - self.signed_clearance(&drawn.crossing, u)).max(0.0)
    }

    /// Returns whether any edge intersects a face at `u`, if the step began without intersections.
    pub fn has_new_intersections(&mut self, u: &[V4<T>]) -> bool {
        self.drawn.is_empty() && !self.pairs.is_empty() && !self.surface.crossings(u).is_empty()
    }

    fn choose(
        &mut self,
        with: (&[V4<T>], &[T], &Partition),
        rigid: &RigidBodies,
        moved: &(dyn Fn(usize) -> DVec3 + Sync),
        margin: f64,
    ) {
        let key =
            |pair: &CollisionCandidate| (pair.features == PrimitivePair::EdgeEdge, pair.nodes);
        // Keeps the friction forces of pairs that are selected again.
        let rubs: BTreeMap<_, PairFriction> = self
            .pairs
            .iter()
            .zip(&self.rubs)
            .filter(|(_, rub)| rub.limit > 0.0)
            .map(|(pair, rub)| (key(pair), *rub))
            .collect();
        self.pairs = self
            .surface
            .build_candidates(with, rigid, moved, (self.gap, margin));
        self.homes.iter_mut().for_each(Vec::clear);
        for (k, pair) in self.pairs.iter().enumerate() {
            pair.chunks_of().for_each(|c| self.homes[c].push(k as u32));
        }
        let rub = |pair: &CollisionCandidate| rubs.get(&key(pair)).copied().unwrap_or_default();
        self.rubs = match rubs.is_empty() {
            true => Vec::new(),
            false => self.pairs.iter().map(rub).collect(),
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
            self.choose((from, free, plan), rigid, &moved, margin);
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
        let ways = self.pairs.iter().map(|pair| {
            let ends = [from, to].map(|u| self.places(pair, u));
            pair.features
                .collision_free_fraction(&ends[0], &ends[1], kept)
        });
        ways.fold(1.0, f64::min)
    }

    /// Returns whether no pair may come near.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty() && self.drawn.is_empty()
    }

    fn places(&self, pair: &CollisionCandidate, u: &[V4<T>]) -> [DVec3; 4] {
        pair.nodes.map(|i| self.surface.place(i, u))
    }

    /// Returns the contact data of a pair, or `None` beyond its gap.
    fn active_pair(&self, pair: &CollisionCandidate, u: &[V4<T>]) -> Option<ActivePair> {
        let x = self.places(pair, u);
        let nearest = pair.features.closest_points(&x);
        if nearest.distance >= pair.gap {
            return None;
        }
        let (share, slope) = pair.features.edge_edge_mollifier(&x, pair.lengths);
        Some(ActivePair {
            weights: nearest.weights,
            normal: nearest.normal,
            barrier: Barrier::unclamped(nearest.distance / pair.gap),
            share,
            slope,
        })
    }

    /// Returns the forces of an active pair on its four nodes.
    fn push(pair: &CollisionCandidate, own: &ActivePair) -> [DVec3; 4] {
        let along = -pair.weight * own.share * own.barrier.first_derivative * own.normal;
        let turn = -pair.weight * pair.gap * own.barrier.value;
        [0, 1, 2, 3].map(|k| own.weights[k] * along + turn * own.slope[k])
    }

    /// Stores the normal forces and normals at `u` for friction. Returns the relative change of the
    /// forces.
    pub fn update_friction(&mut self, u: &[V4<T>]) -> f64 {
        if self.friction == 0.0 {
            return 0.0;
        }
        let mut rubs = std::mem::take(&mut self.rubs);
        rubs.resize(self.pairs.len(), PairFriction::default());
        let (mut change, mut all) = (0.0, 0.0);
        for (pair, rub) in self.pairs.iter().zip(&mut rubs) {
            let before = std::mem::take(rub);
            if let Some(own) = self.active_pair(pair, u) {
                let force = pair.weight * own.share * own.barrier.first_derivative.abs();
                *rub = PairFriction {
                    weights: own.weights,
                    normal: own.normal,
                    limit: self.friction * force,
                };
            }
            change += (rub.limit * rub.normal).distance(before.limit * before.normal);
            all += rub.limit;
        }
        self.rubs = rubs;
        match change > 0.0 {
            true => change / all.max(change),
            false => 0.0,
        }
    }

    /// Returns the tangential velocity of the first primitive of a pair relative to the second.
    fn sliding(pair: &CollisionCandidate, rub: &PairFriction, v: &[V4<T>]) -> DVec3 {
        let nodes = pair.nodes.iter().zip(rub.weights);
        let off: DVec3 = nodes.map(|(i, w)| w * to_dvec(v[*i as usize])).sum();
        off - rub.normal * rub.normal.dot(off)
    }

    /// Σ λ² w²/m over pairs; see [`super::tool_contact::ToolContact::residual_scale`].
    pub fn weight(&self, u: &[V4<T>], over: impl Fn(usize, DVec3) -> f64) -> f64 {
        let of = |pair: &CollisionCandidate| {
            let own = self.active_pair(pair, u)?;
            let forces = pair.nodes.iter().zip(Self::push(pair, &own));
            Some(forces.map(|(i, f)| over(*i as usize, f)).sum::<f64>())
        };
        let drawn = self.drawn.iter().map(|drawn| {
            let forces = drawn
                .crossing
                .nodes
                .iter()
                .zip(self.separation_forces(drawn, u));
            forces.map(|(i, f)| over(*i as usize, f)).sum::<f64>()
        });
        self.pairs.iter().filter_map(of).sum::<f64>() + drawn.sum::<f64>()
    }

    /// Returns the forces of a separation spring.
    fn separation_forces(&self, drawn: &SeparationSpring, u: &[V4<T>]) -> [DVec3; 4] {
        let force = drawn.stiffness * self.separation_deficit(drawn, u) * drawn.crossing.normal;
        drawn.crossing.weights.map(|w| w * force)
    }

    /// Returns the energy of a chunk's separation springs.
    fn separation_energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let own = self.drawn.iter().filter(|d| d.home as usize == chunk);
        own.map(|d| 0.5 * d.stiffness * self.separation_deficit(d, u).powi(2))
            .sum()
    }

    /// Returns the pairs with a node in a chunk, and whether the chunk counts their energy.
    fn of_chunk(&self, chunk: usize) -> impl Iterator<Item = (usize, &CollisionCandidate, bool)> {
        self.homes[chunk].iter().map(move |k| {
            let pair = &self.pairs[*k as usize];
            (*k as usize, pair, pair.chunks[0] as usize == chunk)
        })
    }

    /// Adds forces on nodes to those of a chunk.
    fn add(&self, chunk: usize, nodes: &[u32; 4], forces: [DVec3; 4], f: &mut [V4<T>]) {
        for (i, force) in nodes.iter().zip(forces) {
            // Nodes before the chunk wrap around and are beyond its end.
            if let Some(f) = f.get_mut((*i as usize).wrapping_sub(self.firsts[chunk])) {
                *f = add(*f, to_v4(force));
            }
        }
    }

    fn friction_of(&self, k: usize) -> Option<&PairFriction> {
        self.rubs.get(k).filter(|rub| rub.limit > 0.0)
    }

    /// Returns the minimum of distance over gap of all pairs at `u`.
    #[cfg(test)]
    pub fn min_gap_ratio(&self, u: &[V4<T>]) -> f64 {
        let gap = |pair: &CollisionCandidate| {
            pair.features.closest_points(&self.places(pair, u)).distance / pair.gap
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
            let Some(own) = self.active_pair(pair, u) else {
                continue;
            };
            self.add(chunk, &pair.nodes, Self::push(pair, &own), f);
            if counts {
                energy += own.share * pair.weight * pair.gap * own.barrier.value;
            }
        }
        for drawn in &self.drawn {
            self.add(
                chunk,
                &drawn.crossing.nodes,
                self.separation_forces(drawn, u),
                f,
            );
        }
        energy + self.separation_energy(chunk, u)
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let own = self.of_chunk(chunk).filter(|(.., counts)| *counts);
        own.filter_map(|(_, pair, _)| {
            let own = self.active_pair(pair, u)?;
            Some(own.share * pair.weight * pair.gap * own.barrier.value)
        })
        .sum::<f64>()
            + self.separation_energy(chunk, u)
    }

    fn damped(&self) -> bool {
        self.friction > 0.0
    }

    fn damping_forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let mut loss = 0.0;
        for (k, pair, counts) in self.of_chunk(chunk) {
            let Some(rub) = self.friction_of(k) else {
                continue;
            };
            let slide = Self::sliding(pair, rub, at.v);
            let slip = FrictionMollifier::at(slide.length(), self.least_speed);
            let force = -rub.limit * slip.slope_over_speed * slide;
            self.add(chunk, &pair.nodes, rub.weights.map(|w| w * force), f);
            if counts {
                loss += rub.limit * slip.value;
            }
        }
        loss
    }

    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    ) {
        let h = h.to_f64();
        let mut blocks = std::mem::replace(&mut self.blocks, PointBlocks::new(0));
        blocks.clear();
        for (k, pair) in self.pairs.iter().enumerate() {
            if let Some(own) = self.active_pair(pair, at.u) {
                let bend =
                    h * h * own.share * pair.weight * own.barrier.second_derivative / pair.gap;
                let block = bend * outer_product(own.normal);
                blocks.push(plan, (pair.nodes, own.weights), &block, share.diagonal);
            }
            if let Some(rub) = self.friction_of(k) {
                let slide = Self::sliding(pair, rub, at.v);
                let slip = FrictionMollifier::at(slide.length(), self.least_speed);
                // The secant stiffness in all tangential directions; with the exact derivative,
                // sliding pairs would oscillate.
                let plane = DMat3::IDENTITY - outer_product(rub.normal);
                let block = plane * (h * rub.limit * slip.slope_over_speed);
                blocks.push(plan, (pair.nodes, rub.weights), &block, share.diagonal);
            }
        }
        for drawn in self
            .drawn
            .iter()
            .filter(|d| self.separation_deficit(d, at.u) > 0.0)
        {
            let Intersection {
                nodes,
                weights,
                normal,
                ..
            } = drawn.crossing;
            let block = outer_product(normal) * (h * h * drawn.stiffness);
            blocks.push(plan, (nodes, weights), &block, share.diagonal);
        }
        self.blocks = blocks;
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        self.blocks.multiply((chunk, self.firsts[chunk]), p, y);
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.blocks.visit_off_diagonal(visit);
    }
}
