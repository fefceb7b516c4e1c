//! Damped springs along edges as an energy term: equations 1 to 5 of Tejada & Ertl 2005. The
//! counterparts are `shaders/physics/forces.wgsl` and the reference `reference::springs`.
//!
//! A spring from i to j with the rest vector D = x⁰_j − x⁰_i and the difference of its ends'
//! displacements e = u_j − u_i has d = D + e and the stretch
//! |d| − L = (e·(D + d) + |D|² − L²) / (|d| + L), which avoids cancellation.
//!
//! Springs are stored in blocks of 64: one loop gathers the differences of their ends, one computes
//! in SIMD lanes, one scatters the results. A chunk of nodes has the springs between its own nodes
//! and those that cross its boundary; the latter are computed by both chunks, so that no chunk
//! writes to the nodes of another.

use super::blocks::{BLOCK_SIZE, Block, SpringHessians};
use crate::physics::cpu::partition::{Chunks, Nodes, Partition};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::V4;
use crate::physics::{Damping, DiscreteModel, LocalUnits, SpringNetwork};
use glam::DMat3;
use std::ops::Range;

/// A list of springs.
#[derive(Clone, Debug, Default)]
pub(super) struct List<T> {
    pub(super) blocks: Vec<Block<T>>,
    links: Vec<SpringHessians<T>>,
}

/// The springs of a chunk of nodes.
#[derive(Clone, Debug)]
pub(super) struct Chunk<T> {
    pub(super) nodes: Range<usize>,
    /// Springs with both ends in the chunk, numbered from its first node.
    pub(super) inner: List<T>,
    /// Springs with only i in the chunk; j is numbered from the body's first node.
    pub(super) outer: List<T>,
}

/// All springs of a body.
#[derive(Clone, Debug)]
pub struct Springs<T> {
    pub(super) chunks: Vec<Chunk<T>>,
    /// κ_d = constant + time · κ, in local units.
    damping: [T; 2],
    damped: bool,
    kind: Damping,
}

impl<T: Real> Springs<T> {
    /// Creates the term for `springs` along the edges of `network`, whose node `order[k]` is the
    /// engine's k-th, partitioned by `plan`.
    pub fn new(
        network: &DiscreteModel,
        springs: &SpringNetwork,
        (order, units, plan): (&[u32], LocalUnits, &Partition),
    ) -> Springs<T> {
        let mut place = vec![0u32; order.len()];
        for (k, v) in order.iter().enumerate() {
            place[*v as usize] = k as u32;
        }
        let mut lists = vec![(Vec::new(), Vec::new()); plan.chunks()];
        for (s, spring) in network.edges.iter().enumerate() {
            let [a, b] = spring.nodes.map(|v| place[v as usize]);
            let (i, j) = (a.min(b), a.max(b));
            // A spring from a node to itself exerts no force.
            if i == j {
                continue;
            }
            let [here, there] = [i, j].map(|v| plan.chunk_of(v as usize));
            if here == there {
                lists[here].0.push((i, j, s as u32));
            } else {
                lists[here].1.push((i, j, s as u32));
                lists[there].1.push((j, i, s as u32));
            }
        }
        let fill = |(i, j, s): (u32, u32, u32), [first, base]: [u32; 2], block: &mut Block<T>| {
            let spring = &network.edges[s as usize];
            let [p, q] =
                [i, j].map(|v| network.rest_positions[order[v as usize] as usize] / units.length);
            let (d, l, n) = (q - p, spring.length / units.length, block.count);
            block.i[n] = i - first;
            block.j[n] = j - base;
            for axis in 0..3 {
                block.rest[axis][n] = T::from_f64(d[axis]);
            }
            block.length[n] = T::from_f64(l);
            let excess = d.length_squared() - l * l;
            // A spring with a rest length equal to its edge has no excess, regardless of rounding.
            let none = excess.abs() <= 1e-14 * l * l;
            block.squared_stretch[n] = T::from_f64(if none { 0.0 } else { excess });
            block.stiffness[n] = T::from_f64(spring.stiffness / units.stiffness());
            block.count += 1;
        };
        let chunks = lists.into_iter().enumerate().map(|(c, (inner, outer))| {
            let first = plan.range(c).start as u32;
            let list = |springs, base| {
                List::new(springs, first - base, |s, block| {
                    fill(s, [first, base], block)
                })
            };
            Chunk {
                nodes: plan.range(c),
                inner: list(inner, first),
                outer: list(outer, 0),
            }
        });
        let constant = springs.damping / units.damping();
        let time = network.damping_time / units.time;
        Springs {
            chunks: chunks.collect(),
            damping: [constant, time].map(T::from_f64),
            damped: constant > 0.0 || time > 0.0,
            kind: springs.damping_kind,
        }
    }
}

impl<T: Real> List<T> {
    fn new(
        mut springs: Vec<(u32, u32, u32)>,
        // The chunk's first node in the numbering of j.
        same: u32,
        fill: impl Fn((u32, u32, u32), &mut Block<T>),
    ) -> List<T> {
        springs.sort_unstable();
        let mut blocks = Vec::new();
        for run in springs.chunks_mut(BLOCK_SIZE) {
            // Consecutive springs of the same node would each wait for the previous sum: order them
            // as the first spring of each node, then the second.
            let mut rank = 0u32;
            let mut ranked: Vec<(u32, (u32, u32, u32))> = Vec::with_capacity(BLOCK_SIZE);
            for (n, s) in run.iter().enumerate() {
                rank = match n > 0 && run[n - 1].0 == s.0 {
                    true => rank + 1,
                    false => 0,
                };
                ranked.push((rank, *s));
            }
            ranked.sort_unstable();
            let mut block = Block {
                i: [0; BLOCK_SIZE],
                j: [same; BLOCK_SIZE],
                rest: [
                    [T::ONE; BLOCK_SIZE],
                    [T::ZERO; BLOCK_SIZE],
                    [T::ZERO; BLOCK_SIZE],
                ],
                length: [T::ONE; BLOCK_SIZE],
                squared_stretch: [T::ZERO; BLOCK_SIZE],
                stiffness: [T::ZERO; BLOCK_SIZE],
                count: 0,
            };
            for (_, s) in ranked {
                fill(s, &mut block);
            }
            blocks.push(block);
        }
        List {
            blocks,
            links: Vec::new(),
        }
    }
}

impl<T: Real> List<T> {
    fn forces<const DAMPED: u8>(
        &self,
        nodes: &Range<usize>,
        both: bool,
        damping: [T; 2],
        at: StateRef<'_, T>,
        f: &mut [V4<T>],
    ) -> f64 {
        let [u, v] = [at.u, at.v].map(|a| ends(a, nodes, both));
        let zero = [[T::ZERO; 4]; BLOCK_SIZE];
        let (mut e, mut w, mut pull) = (zero, zero, zero);
        let mut energy = [T::ZERO; BLOCK_SIZE];
        let mut sum = 0.0;
        for block in &self.blocks {
            block.differences(u, &mut e);
            if DAMPED > 0 {
                block.differences(v, &mut w);
            }
            block.pull::<DAMPED>(damping, &e, &w, &mut pull, &mut energy);
            block.scatter(both, &pull, f);
            let mut lanes = [T::ZERO; 8];
            for eight in energy.as_chunks::<8>().0 {
                for (l, e) in lanes.iter_mut().zip(eight) {
                    *l += *e;
                }
            }
            sum += lanes.map(Real::to_f64).iter().sum::<f64>();
        }
        // Both chunks count a spring between them.
        sum * if both { 0.5 } else { 0.25 }
    }

    fn energy(&self, nodes: &Range<usize>, both: bool, u: &[V4<T>]) -> f64 {
        let u = ends(u, nodes, both);
        let zero = [[T::ZERO; 4]; BLOCK_SIZE];
        let (mut e, mut pull) = (zero, zero);
        let mut energy = [T::ZERO; BLOCK_SIZE];
        let mut sum = 0.0;
        for block in &self.blocks {
            block.differences(u, &mut e);
            block.pull::<0>([T::ZERO; 2], &e, &zero, &mut pull, &mut energy);
            sum += energy.map(Real::to_f64).iter().sum::<f64>();
        }
        sum * if both { 0.5 } else { 0.25 }
    }

    fn subtract_damping_forces(
        &self,
        nodes: &Range<usize>,
        both: bool,
        (damping, axial): ([T; 2], bool),
        at: StateRef<'_, T>,
        f: &mut [V4<T>],
    ) -> f64 {
        let [u, v] = [at.u, at.v].map(|a| ends(a, nodes, both));
        let zero = [[T::ZERO; 4]; BLOCK_SIZE];
        let (mut e, mut w, mut pull) = (zero, zero, zero);
        let mut sum = 0.0;
        for block in &self.blocks {
            block.differences(u, &mut e);
            block.differences(v, &mut w);
            block.subtract_damping_forces(damping, axial, &e, &w, &mut pull);
            block.scatter(both, &pull, f);
            for (pull, w) in pull.iter().zip(&w) {
                sum += (pull[0] * w[0] + pull[1] * w[1] + pull[2] * w[2]).to_f64();
            }
        }
        sum * if both { 0.5 } else { 0.25 }
    }

    fn linearise(
        &mut self,
        nodes: &Range<usize>,
        both: bool,
        how: (T, [T; 2], bool),
        at: StateRef<'_, T>,
        share: SystemContribution<'_, T>,
    ) {
        let zero = [[T::ZERO; 4]; BLOCK_SIZE];
        let (mut e, mut w, mut change) = (zero, zero, zero);
        let mut blocks = [[T::ZERO; 8]; BLOCK_SIZE];
        let empty = SpringHessians([[T::ZERO; 4]; BLOCK_SIZE]);
        self.links.resize(self.blocks.len(), empty);
        let [u, v] = [at.u, at.v].map(|a| ends(a, nodes, both));
        for (block, links) in self.blocks.iter().zip(&mut self.links) {
            block.differences(u, &mut e);
            block.differences(v, &mut w);
            block.linearise(how, [&e, &w], links, &mut change);
            block.scatter(both, &change, share.stiffness_velocity);
            links.blocks(&mut blocks);
            for ((s, i), j) in blocks.iter().zip(&block.i).zip(&block.j) {
                let ends = [*i, *j].map(|v| v as usize);
                for v in &ends[..if both { 2 } else { 1 }] {
                    for (d, s) in share.diagonal[*v].iter_mut().zip(s) {
                        *d += *s;
                    }
                }
            }
        }
    }

    fn multiply(&self, nodes: &Range<usize>, both: bool, p: &[V4<T>], y: &mut [V4<T>]) {
        let [here, there] = ends(p, nodes, both);
        for (block, links) in self.blocks.iter().zip(&self.links) {
            for ((q, i), j) in links.0.iter().zip(&block.i).zip(&block.j) {
                let (i, j) = (*i as usize, *j as usize);
                let (q, b) = (T::lanes(q), q[3].splat());
                let e = T::lanes(&there[j]) - T::lanes(&here[i]);
                // The fourth lane of e is zero; that of the result is not.
                let share = T::dot(q, e) * q + b * e;
                // A_ij p_j + A_ii p_i = −(q qᵀ + b I)(p_j − p_i).
                y[i] = T::array(T::lanes(&y[i]) - share);
                if both {
                    y[j] = T::array(T::lanes(&y[j]) + share);
                }
            }
        }
    }
}

/// Returns the arrays in which the two ends of a list's springs are numbered.
fn ends<'a, T>(a: &'a [V4<T>], nodes: &Range<usize>, both: bool) -> [&'a [V4<T>]; 2] {
    let here = &a[nodes.clone()];
    [here, if both { here } else { a }]
}

impl<T: Real> Term<T> for Springs<T> {
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let Chunk {
            nodes,
            inner,
            outer,
        } = &self.chunks[chunk];
        let c = self.damping;
        let both =
            [(inner, true), (outer, false)].map(|(list, both)| match (self.damped, self.kind) {
                (false, _) => list.forces::<0>(nodes, both, c, at, f),
                (true, Damping::Axial) => list.forces::<1>(nodes, both, c, at, f),
                (true, Damping::Relative) => list.forces::<2>(nodes, both, c, at, f),
            });
        both[0] + both[1]
    }

    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        let Chunk {
            nodes,
            inner,
            outer,
        } = &self.chunks[chunk];
        let at = StateRef { u, v: u };
        let c = [T::ZERO; 2];
        inner.forces::<0>(nodes, true, c, at, f) + outer.forces::<0>(nodes, false, c, at, f)
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let Chunk {
            nodes,
            inner,
            outer,
        } = &self.chunks[chunk];
        inner.energy(nodes, true, u) + outer.energy(nodes, false, u)
    }

    fn damped(&self) -> bool {
        self.damped
    }

    fn damping_forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        if !self.damped {
            return 0.0;
        }
        let Chunk {
            nodes,
            inner,
            outer,
        } = &self.chunks[chunk];
        let how = (self.damping, self.kind == Damping::Axial);
        inner.subtract_damping_forces(nodes, true, how, at, f)
            + outer.subtract_damping_forces(nodes, false, how, at, f)
    }

    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    ) {
        let (damping, axial) = (self.damping, self.kind == Damping::Axial);
        let data = (
            Chunks(&mut self.chunks),
            Nodes(share.diagonal),
            Nodes(share.stiffness_velocity),
        );
        plan.for_each_chunk(data, &|_, _, (chunks, diagonal, change)| {
            if let [chunk] = chunks.0 {
                for (list, both) in [(&mut chunk.inner, true), (&mut chunk.outer, false)] {
                    let share = SystemContribution {
                        diagonal: &mut *diagonal.0,
                        stiffness_velocity: &mut *change.0,
                    };
                    list.linearise(&chunk.nodes, both, (h, damping, axial), at, share);
                }
            }
            []
        });
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        let chunk = &self.chunks[chunk];
        chunk.inner.multiply(&chunk.nodes, true, p, y);
        chunk.outer.multiply(&chunk.nodes, false, p, y);
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for chunk in &self.chunks {
            let first = chunk.nodes.start as u32;
            for (list, base) in [(&chunk.inner, first), (&chunk.outer, 0)] {
                for (block, links) in list.blocks.iter().zip(&list.links) {
                    for n in 0..block.count {
                        let [i, j] = [block.i[n] + first, block.j[n] + base];
                        // Springs between chunks are stored twice.
                        if i > j {
                            continue;
                        }
                        let [x, y, z, b] = links.0[n].map(Real::to_f64);
                        let q = [x, y, z];
                        let mut m = DMat3::from_diagonal(glam::DVec3::splat(-b));
                        for (column, across) in q.iter().enumerate() {
                            *m.col_mut(column) -= glam::DVec3::from(q) * *across;
                        }
                        visit([i, j], &m);
                    }
                }
            }
        }
    }
}
