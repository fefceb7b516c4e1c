//! A body's contact with itself: a term of its energy that keeps parts of its boundary apart.
//!
//! E = Σ m A K ĝ b(d/ĝ) over pairs of vertices and faces and of edges whose distance d is less than
//! ĝ, b being the barrier of incremental potential contact and m its mollifier of edges that are
//! nearly parallel (Li et al. 2020, equations 6 and 24). Blocks are those along the line between
//! the nearest points, which are positive. Friction is as in [`super::contact`].

use super::contact::{narrow, outer, wide};
use super::contact_blocks::Blocks;
use super::contact_hull::Hull;
use super::pool::Plan;
use super::real::Real;
use super::rigid::RigidBodies;
use super::self_pairs::{Crossing, Pair, Surface};
use super::terms::{At, Share, Term};
use super::vectors::{V4, add};
use crate::physics::contact::{Barrier, Features, Slip};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// How far nodes may stray from the ways that pairs are chosen for, over the boundary's mean edge.
const MARGIN: f64 = 0.1;

/// Where a start has an edge go through a face they are drawn apart: by this part of the mean edge in
/// a step, until they are so far apart, with so many times the stiffness of what is behind them.
const STRIDE: f64 = 0.1;
const APART: f64 = 0.1;
const STIFF: f64 = 30.0;

/// What a pair's friction goes by: those of the iterate before.
#[derive(Clone, Copy, Debug, Default)]
struct Rub {
    weights: [f64; 4],
    normal: DVec3,
    /// μ times the normal force.
    limit: f64,
}

/// A pair that pushes.
struct Pushing {
    weights: [f64; 4],
    normal: DVec3,
    barrier: Barrier,
    /// m, and its slope at the four nodes.
    share: f64,
    slope: [DVec3; 4],
}

/// An edge that is drawn out of a face: E = ½ k (goal − s)² while its end is not so far in front.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    crossing: Crossing,
    goal: f64,
    /// k.
    stiffness: f64,
    home: u32,
}

/// A body's contact with itself.
pub(super) struct Touching<T> {
    pub surface: Surface,
    pub friction: f64,
    /// ĝ.
    pub gap: f64,
    /// The speed below which friction holds.
    pub least_speed: f64,
    pairs: Vec<Pair>,
    /// Those with a node in each chunk.
    homes: Vec<Vec<u32>>,
    rubs: Vec<Rub>,
    drawn: Vec<Drawn>,
    firsts: Vec<usize>,
    blocks: Blocks<T>,
}

impl<T: Real> Touching<T> {
    /// Of a boundary.
    pub fn new(hull: Hull, plan: &Plan, [friction, gap, least_speed]: [f64; 3]) -> Touching<T> {
        let chunks = plan.chunks();
        Touching {
            surface: Surface::new(hull),
            friction,
            gap,
            least_speed,
            pairs: Vec::new(),
            homes: vec![Vec::new(); chunks],
            rubs: Vec::new(),
            drawn: Vec::new(),
            firsts: (0..chunks).map(|c| plan.range(c).start).collect(),
            blocks: Blocks::new(chunks),
        }
    }

    /// Begins a step in which nodes move by about `moved`. Whether anything may come near.
    pub fn begin(
        &mut self,
        with: (&[V4<T>], &[T], &Plan),
        rigid: &RigidBodies,
        moved: &(dyn Fn(usize) -> DVec3 + Sync),
    ) -> bool {
        self.surface.begin(with.0);
        self.draw(with.0, with.2);
        self.rubs.clear();
        self.choose(with, rigid, moved, MARGIN * self.surface.edge());
        self.rub(with.0);
        !self.is_empty()
    }

    /// Takes note of what goes through what at `u`: all that is drawn apart in a step.
    fn draw(&mut self, u: &[V4<T>], plan: &Plan) {
        let edge = self.surface.edge();
        let found = self.surface.untangle(u);
        let draw = |crossing: Crossing| {
            let depth = self.in_front(&crossing, u);
            Drawn {
                goal: (APART * edge).min(depth + STRIDE * edge),
                stiffness: STIFF * crossing.weight / edge,
                home: plan.chunk_of(crossing.nodes[0] as usize) as u32,
                crossing,
            }
        };
        self.drawn = found.into_iter().map(draw).collect();
    }

    /// How far in front of a face the end of an edge is that goes through it: less than 0.
    fn in_front(&self, crossing: &Crossing, u: &[V4<T>]) -> f64 {
        let ends = crossing.nodes.iter().zip(crossing.weights);
        let apart: DVec3 = ends.map(|(i, w)| w * self.surface.place(*i, u)).sum();
        apart.dot(crossing.normal)
    }

    /// How much farther it should be, where it is not far enough.
    fn lacks(&self, drawn: &Drawn, u: &[V4<T>]) -> f64 {
        (drawn.goal - self.in_front(&drawn.crossing, u)).max(0.0)
    }

    /// Whether any edge goes through a face at `u`, of a step that began with none that did.
    pub fn passed(&mut self, u: &[V4<T>]) -> bool {
        self.drawn.is_empty() && !self.pairs.is_empty() && !self.surface.crossings(u).is_empty()
    }

    fn choose(
        &mut self,
        with: (&[V4<T>], &[T], &Plan),
        rigid: &RigidBodies,
        moved: &(dyn Fn(usize) -> DVec3 + Sync),
        margin: f64,
    ) {
        let key = |pair: &Pair| (pair.features == Features::EdgeEdge, pair.nodes);
        // Friction goes by the same forces whatever pairs there are.
        let rubs: BTreeMap<_, Rub> = self
            .pairs
            .iter()
            .zip(&self.rubs)
            .filter(|(_, rub)| rub.limit > 0.0)
            .map(|(pair, rub)| (key(pair), *rub))
            .collect();
        self.pairs = self.surface.choose(with, rigid, moved, (self.gap, margin));
        self.homes.iter_mut().for_each(Vec::clear);
        for (k, pair) in self.pairs.iter().enumerate() {
            pair.homes().for_each(|c| self.homes[c].push(k as u32));
        }
        let rub = |pair: &Pair| rubs.get(&key(pair)).copied().unwrap_or_default();
        self.rubs = match rubs.is_empty() {
            true => Vec::new(),
            false => self.pairs.iter().map(rub).collect(),
        };
    }

    /// Sees to it that all that may touch on the way from the displacements `from` to `to` is among
    /// the pairs.
    pub fn cover(
        &mut self,
        [from, to]: [&[V4<T>]; 2],
        (free, plan): (&[T], &Plan),
        rigid: &RigidBodies,
    ) {
        if [from, to].iter().any(|u| self.surface.strays(u)) {
            let moved = |i: usize| wide(to[i]) - wide(from[i]);
            let margin = MARGIN * self.surface.edge();
            self.choose((from, free, plan), rigid, &moved, margin);
        }
    }

    /// The part of the way from the displacements `from` to `to` on which all pairs keep the part
    /// `kept` of their distances.
    pub fn way(
        &mut self,
        [from, to]: [&[V4<T>]; 2],
        with: (&[T], &Plan),
        rigid: &RigidBodies,
        kept: f64,
    ) -> f64 {
        self.cover([from, to], with, rigid);
        let ways = self.pairs.iter().map(|pair| {
            let ends = [from, to].map(|u| self.places(pair, u));
            pair.features.free_way(&ends[0], &ends[1], kept)
        });
        ways.fold(1.0, f64::min)
    }

    /// Whether nothing may come near anything.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty() && self.drawn.is_empty()
    }

    fn places(&self, pair: &Pair, u: &[V4<T>]) -> [DVec3; 4] {
        pair.nodes.map(|i| self.surface.place(i, u))
    }

    /// How a pair pushes; nothing where it is too far.
    fn pushing(&self, pair: &Pair, u: &[V4<T>]) -> Option<Pushing> {
        let x = self.places(pair, u);
        let nearest = pair.features.nearest(&x);
        if nearest.distance >= pair.gap {
            return None;
        }
        let (share, slope) = pair.features.share(&x, pair.lengths);
        Some(Pushing {
            weights: nearest.weights,
            normal: nearest.normal,
            barrier: Barrier::between(nearest.distance / pair.gap),
            share,
            slope,
        })
    }

    /// The forces of a pair that pushes on its four nodes.
    fn push(pair: &Pair, own: &Pushing) -> [DVec3; 4] {
        let along = -pair.weight * own.share * own.barrier.slope * own.normal;
        let turn = -pair.weight * pair.gap * own.barrier.value;
        [0, 1, 2, 3].map(|k| own.weights[k] * along + turn * own.slope[k])
    }

    /// Takes note of normal forces and normals at `u`, for friction. By how much the forces changed,
    /// over themselves.
    pub fn rub(&mut self, u: &[V4<T>]) -> f64 {
        if self.friction == 0.0 {
            return 0.0;
        }
        let mut rubs = std::mem::take(&mut self.rubs);
        rubs.resize(self.pairs.len(), Rub::default());
        let (mut change, mut all) = (0.0, 0.0);
        for (pair, rub) in self.pairs.iter().zip(&mut rubs) {
            let before = std::mem::take(rub);
            if let Some(own) = self.pushing(pair, u) {
                let force = pair.weight * own.share * own.barrier.slope.abs();
                *rub = Rub {
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

    /// The velocity at which the first feature of a pair slides along the second.
    fn sliding(pair: &Pair, rub: &Rub, v: &[V4<T>]) -> DVec3 {
        let nodes = pair.nodes.iter().zip(rub.weights);
        let off: DVec3 = nodes.map(|(i, w)| w * wide(v[*i as usize])).sum();
        off - rub.normal * rub.normal.dot(off)
    }

    /// Σ λ² w²/m over pairs; see [`super::contact::Contact::weight`].
    pub fn weight(&self, u: &[V4<T>], over: impl Fn(usize, DVec3) -> f64) -> f64 {
        let of = |pair: &Pair| {
            let own = self.pushing(pair, u)?;
            let forces = pair.nodes.iter().zip(Self::push(pair, &own));
            Some(forces.map(|(i, f)| over(*i as usize, f)).sum::<f64>())
        };
        let drawn = self.drawn.iter().map(|drawn| {
            let forces = drawn.crossing.nodes.iter().zip(self.drawing(drawn, u));
            forces.map(|(i, f)| over(*i as usize, f)).sum::<f64>()
        });
        self.pairs.iter().filter_map(of).sum::<f64>() + drawn.sum::<f64>()
    }

    /// The forces that draw an edge out of a face.
    fn drawing(&self, drawn: &Drawn, u: &[V4<T>]) -> [DVec3; 4] {
        let force = drawn.stiffness * self.lacks(drawn, u) * drawn.crossing.normal;
        drawn.crossing.weights.map(|w| w * force)
    }

    /// The energy of what is drawn apart, of a chunk.
    fn drawing_energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let own = self.drawn.iter().filter(|d| d.home as usize == chunk);
        own.map(|d| 0.5 * d.stiffness * self.lacks(d, u).powi(2))
            .sum()
    }

    /// The pairs with a node in a chunk, and whether it is the one to count their energy.
    fn of_chunk(&self, chunk: usize) -> impl Iterator<Item = (usize, &Pair, bool)> {
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
                *f = add(*f, narrow(force));
            }
        }
    }

    fn rubbing(&self, k: usize) -> Option<&Rub> {
        self.rubs.get(k).filter(|rub| rub.limit > 0.0)
    }

    /// The smallest distance over the gap of any pair at `u`.
    #[cfg(test)]
    pub fn nearest(&self, u: &[V4<T>]) -> f64 {
        let gap = |pair: &Pair| pair.features.nearest(&self.places(pair, u)).distance / pair.gap;
        self.pairs.iter().map(gap).fold(f64::INFINITY, f64::min)
    }
}

impl<T: Real> Term<T> for Touching<T> {
    fn forces(&self, chunk: usize, at: At<'_, T>, f: &mut [V4<T>]) -> f64 {
        let energy = self.elastic(chunk, at.u, f);
        self.resist(chunk, at, f);
        energy
    }

    fn elastic(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        let mut energy = 0.0;
        for (_, pair, counts) in self.of_chunk(chunk) {
            let Some(own) = self.pushing(pair, u) else {
                continue;
            };
            self.add(chunk, &pair.nodes, Self::push(pair, &own), f);
            if counts {
                energy += own.share * pair.weight * pair.gap * own.barrier.value;
            }
        }
        for drawn in &self.drawn {
            self.add(chunk, &drawn.crossing.nodes, self.drawing(drawn, u), f);
        }
        energy + self.drawing_energy(chunk, u)
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let own = self.of_chunk(chunk).filter(|(.., counts)| *counts);
        own.filter_map(|(_, pair, _)| {
            let own = self.pushing(pair, u)?;
            Some(own.share * pair.weight * pair.gap * own.barrier.value)
        })
        .sum::<f64>()
            + self.drawing_energy(chunk, u)
    }

    fn damped(&self) -> bool {
        self.friction > 0.0
    }

    fn resist(&self, chunk: usize, at: At<'_, T>, f: &mut [V4<T>]) -> f64 {
        let mut loss = 0.0;
        for (k, pair, counts) in self.of_chunk(chunk) {
            let Some(rub) = self.rubbing(k) else {
                continue;
            };
            let slide = Self::sliding(pair, rub, at.v);
            let slip = Slip::at(slide.length(), self.least_speed);
            let force = -rub.limit * slip.slope_over * slide;
            self.add(chunk, &pair.nodes, rub.weights.map(|w| w * force), f);
            if counts {
                loss += rub.limit * slip.value;
            }
        }
        loss
    }

    fn linearise(&mut self, plan: &Plan, at: At<'_, T>, h: T, share: Share<'_, T>) {
        let h = h.wide();
        let mut blocks = std::mem::replace(&mut self.blocks, Blocks::new(0));
        blocks.clear();
        for (k, pair) in self.pairs.iter().enumerate() {
            if let Some(own) = self.pushing(pair, at.u) {
                let bend = h * h * own.share * pair.weight * own.barrier.bend / pair.gap;
                let block = bend * outer(own.normal);
                blocks.push(plan, (pair.nodes, own.weights), &block, share.diagonal);
            }
            if let Some(rub) = self.rubbing(k) {
                let slide = Self::sliding(pair, rub, at.v);
                let slip = Slip::at(slide.length(), self.least_speed);
                // As if what slides stuck a little, or it would slide back and forth.
                let plane = DMat3::IDENTITY - outer(rub.normal);
                let block = plane * (h * rub.limit * slip.slope_over);
                blocks.push(plan, (pair.nodes, rub.weights), &block, share.diagonal);
            }
        }
        for drawn in self.drawn.iter().filter(|d| self.lacks(d, at.u) > 0.0) {
            let Crossing {
                nodes,
                weights,
                normal,
                ..
            } = drawn.crossing;
            let block = outer(normal) * (h * h * drawn.stiffness);
            blocks.push(plan, (nodes, weights), &block, share.diagonal);
        }
        self.blocks = blocks;
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        self.blocks.multiply((chunk, self.firsts[chunk]), p, y);
    }

    fn pairs(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.blocks.pairs(visit);
    }

    fn touching(&self) -> Option<&Touching<T>> {
        Some(self)
    }

    fn touching_mut(&mut self) -> Option<&mut Touching<T>> {
        Some(self)
    }
}
