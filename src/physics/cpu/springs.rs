//! Springs along edges, with damping: equations 1 to 5 of Tejada & Ertl 2005. The twin of
//! `shaders/physics/forces.wgsl` and `plain::springs`.
//!
//! A spring from i to j with the rest vector D = x⁰_j − x⁰_i and e = u_j − u_i, the difference of
//! its ends' displacements, has d = D + e and the stretch
//! |d| − L = (e·(D + d) + |D|² − L²) / (|d| + L), in which nothing cancels.
//!
//! Springs lie in blocks of 64: one loop gathers the differences of their ends, one computes in
//! SIMD lanes, one scatters what comes out. A chunk of nodes has the springs between its own nodes
//! and those that leave it; the latter are computed on both sides, so that no chunk writes to
//! another's nodes.

use super::pool::{Chunks, Nodes, Plan};
use super::real::Real;
use super::terms::{At, Share, Term};
use super::vectors::{Symmetric, V4, add, sub};
use crate::physics::{Damping, SpringNetwork, Units};
use glam::DMat3;
use std::ops::Range;

/// Springs in a block.
const B: usize = 64;

/// Stretches are scaled by this before they are squared.
const ENERGY_SCALE: f64 = 1048576.0;

type Vectors<T> = [V4<T>; B];

/// Springs side by side; what fills up the last block of a list has no stiffness.
#[derive(Clone, Debug)]
struct Block<T> {
    i: [u32; B],
    j: [u32; B],
    rest: [[T; B]; 3],
    length: [T; B],
    /// |D|² − L².
    excess: [T; B],
    stiffness: [T; B],
    /// How many of them are springs.
    count: usize,
}

/// Each spring's part of A as q qᵀ + b I: in the diagonal blocks of its ends, and negative between
/// them.
#[derive(Clone, Debug)]
struct Links<T> {
    q: [[T; B]; 3],
    b: [T; B],
}

/// A list of springs.
#[derive(Clone, Debug, Default)]
struct List<T> {
    blocks: Vec<Block<T>>,
    links: Vec<Links<T>>,
}

/// The springs of a chunk of nodes.
#[derive(Clone, Debug)]
struct Chunk<T> {
    nodes: Range<usize>,
    /// Both ends are in the chunk, and numbered from its first node.
    inner: List<T>,
    /// Only i is; j is numbered from the body's first node.
    outer: List<T>,
}

/// All springs of a body.
#[derive(Clone, Debug)]
pub struct Springs<T> {
    chunks: Vec<Chunk<T>>,
    /// κ_d = constant + time · κ, in local units.
    damping: [T; 2],
    damped: bool,
    kind: Damping,
}

impl<T: Real> Springs<T> {
    /// The springs of `network`, of which node `order[k]` is the engine's k-th, shared out by
    /// `plan`.
    pub fn new(network: &SpringNetwork, order: &[u32], units: &Units, plan: &Plan) -> Springs<T> {
        let mut place = vec![0u32; order.len()];
        for (k, v) in order.iter().enumerate() {
            place[*v as usize] = k as u32;
        }
        let mut lists = vec![(Vec::new(), Vec::new()); plan.chunks()];
        for (s, spring) in network.springs.iter().enumerate() {
            let [a, b] = spring.nodes.map(|v| place[v as usize]);
            let (i, j) = (a.min(b), a.max(b));
            // A spring from a node to itself neither pulls nor resists.
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
            let spring = &network.springs[s as usize];
            let [p, q] = [i, j].map(|v| network.rest[order[v as usize] as usize] / units.length);
            let (d, l, n) = (q - p, spring.length / units.length, block.count);
            block.i[n] = i - first;
            block.j[n] = j - base;
            for axis in 0..3 {
                block.rest[axis][n] = T::of(d[axis]);
            }
            block.length[n] = T::of(l);
            let excess = d.length_squared() - l * l;
            // A spring that is as long as its edge has none, whatever the rounding says.
            let none = excess.abs() <= 1e-14 * l * l;
            block.excess[n] = T::of(if none { 0.0 } else { excess });
            block.stiffness[n] = T::of(spring.stiffness / units.stiffness());
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
        let constant = network.damping / units.damping();
        let time = network.damping_time / units.time;
        Springs {
            chunks: chunks.collect(),
            damping: [constant, time].map(T::of),
            damped: constant > 0.0 || time > 0.0,
            kind: network.damping_kind,
        }
    }
}

impl<T: Real> List<T> {
    fn new(
        mut springs: Vec<(u32, u32, u32)>,
        // What the chunk's first node is called as j.
        same: u32,
        fill: impl Fn((u32, u32, u32), &mut Block<T>),
    ) -> List<T> {
        springs.sort_unstable();
        let mut blocks = Vec::new();
        for run in springs.chunks_mut(B) {
            // Springs of the same node one after the other would each wait for the sum of the one
            // before: first the first spring of each node, then the second.
            let mut rank = 0u32;
            let mut ranked: Vec<(u32, (u32, u32, u32))> = Vec::with_capacity(B);
            for (n, s) in run.iter().enumerate() {
                rank = match n > 0 && run[n - 1].0 == s.0 {
                    true => rank + 1,
                    false => 0,
                };
                ranked.push((rank, *s));
            }
            ranked.sort_unstable();
            let mut block = Block {
                i: [0; B],
                j: [same; B],
                rest: [[T::ONE; B], [T::ZERO; B], [T::ZERO; B]],
                length: [T::ONE; B],
                excess: [T::ZERO; B],
                stiffness: [T::ZERO; B],
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

impl<T: Real> Block<T> {
    /// b_j − a_i.
    #[inline(always)]
    fn differences(&self, [a, b]: [&[V4<T>]; 2], out: &mut Vectors<T>) {
        for ((o, i), j) in out.iter_mut().zip(&self.i).zip(&self.j) {
            *o = sub(b[*j as usize], a[*i as usize]);
        }
    }

    /// Adds what was computed to the nodes i and, of springs within a chunk, takes it from j.
    #[inline(always)]
    fn scatter(&self, both: bool, shares: &Vectors<T>, out: &mut [V4<T>]) {
        for ((s, i), j) in shares.iter().zip(&self.i).zip(&self.j) {
            let (i, j) = (*i as usize, *j as usize);
            out[i] = add(out[i], *s);
            if both {
                out[j] = sub(out[j], *s);
            }
        }
    }

    /// Of spring n with the difference e: d, |d|² and 1/((|d| + L) |d|).
    #[inline(always)]
    fn lengths(&self, n: usize, e: V4<T>) -> ([T; 3], T, T, T) {
        let d = [
            self.rest[0][n] + e[0],
            self.rest[1][n] + e[1],
            self.rest[2][n] + e[2],
        ];
        // The fourth lane is zero; read, the four are one load.
        let square = (d[0] * d[0] + d[1] * d[1]) + (d[2] * d[2] + e[3] * e[3]);
        let square = square.or_more(T::COINCIDENT);
        let l = square.root();
        let over = T::ONE / ((l + self.length[n]) * l);
        // |d|² − L².
        let gain = e[0] * (self.rest[0][n] + d[0])
            + e[1] * (self.rest[1][n] + d[1])
            + e[2] * (self.rest[2][n] + d[2]);
        (d, square, over, gain + self.excess[n])
    }

    /// Forces of the springs on their nodes i, and κ times stretch², lane by lane.
    #[inline(always)]
    fn pull<const DAMPED: u8>(
        &self,
        damping: [T; 2],
        e: &Vectors<T>,
        w: &Vectors<T>,
        f: &mut Vectors<T>,
        energy: &mut [T; B],
    ) {
        for n in 0..B {
            let (d, square, over, gain) = self.lengths(n, e[n]);
            let k = self.stiffness[n];
            // Stretch over length.
            let s = gain * over;
            let mut along = k * s;
            // Scaled, for the squares of what a wave has hardly reached would be subnormal.
            let scaled = s * T::of(ENERGY_SCALE);
            energy[n] = k * (scaled * scaled) * square;
            let mut relative = T::ZERO;
            if DAMPED == 1 {
                let dw = d[0] * w[n][0] + d[1] * w[n][1] + d[2] * w[n][2];
                along += (damping[0] + damping[1] * k) * dw / square;
            }
            if DAMPED == 2 {
                relative = damping[0] + damping[1] * k;
            }
            f[n] = [along * d[0], along * d[1], along * d[2], T::ZERO];
            if DAMPED == 2 {
                for axis in 0..3 {
                    f[n][axis] += relative * w[n][axis];
                }
            }
        }
        // The springs that fill up a block are not damped, but they have no ends that differ.
    }

    /// The springs' parts of A, and κ((1 − t) n n·w + t w) with w the difference of velocities.
    #[inline(always)]
    fn linearise(
        &self,
        h: T,
        damping: [T; 2],
        axial: bool,
        e: &Vectors<T>,
        w: &Vectors<T>,
        links: &mut Links<T>,
        change: &mut Vectors<T>,
    ) {
        for n in 0..B {
            let (d, square, over, gain) = self.lengths(n, e[n]);
            let k = self.stiffness[n];
            // Without a direction only a spring of no length pushes back, in all of them.
            let stretch = (gain * over).or_more(T::ZERO);
            let t = match self.length[n] > T::ZERO {
                true => stretch,
                false => T::ONE,
            };
            let c = h * (damping[0] + damping[1] * k);
            let (axial, relative) = match axial {
                true => (c, T::ZERO),
                false => (T::ZERO, c),
            };
            let stiff = k * (T::ONE - t);
            let q = ((h * h * stiff + axial) / square).or_more(T::ZERO).root();
            links.q[0][n] = q * d[0];
            links.q[1][n] = q * d[1];
            links.q[2][n] = q * d[2];
            links.b[n] = h * h * k * t + relative;
            let dw = d[0] * w[n][0] + d[1] * w[n][1] + d[2] * w[n][2];
            let along = stiff * dw / square;
            let across = k * t;
            change[n] = [
                along * d[0] + across * w[n][0],
                along * d[1] + across * w[n][1],
                along * d[2] + across * w[n][2],
                T::ZERO,
            ];
        }
        // What fills up the block is damped like any spring; it must not weigh on its node.
        for n in self.count..B {
            links.b[n] = T::ZERO;
            for q in &mut links.q {
                q[n] = T::ZERO;
            }
        }
    }
}

impl<T: Real> Links<T> {
    /// (q qᵀ + b I) e, lane by lane.
    #[inline(always)]
    fn multiply(&self, e: &Vectors<T>, out: &mut Vectors<T>) {
        for n in 0..B {
            let [x, y, z] = [self.q[0][n], self.q[1][n], self.q[2][n]];
            let along = (x * e[n][0] + y * e[n][1]) + (z * e[n][2] + e[n][3]);
            let b = self.b[n];
            out[n] = [
                along * x + b * e[n][0],
                along * y + b * e[n][1],
                along * z + b * e[n][2],
                T::ZERO,
            ];
        }
    }

    /// The blocks themselves.
    #[inline(always)]
    fn blocks(&self, out: &mut [Symmetric<T>; B]) {
        for n in 0..B {
            let [x, y, z] = [self.q[0][n], self.q[1][n], self.q[2][n]];
            let b = self.b[n];
            out[n] = [
                x * x + b,
                y * y + b,
                z * z + b,
                x * y,
                x * z,
                y * z,
                T::ZERO,
                T::ZERO,
            ];
        }
    }
}

impl<T: Real> List<T> {
    fn forces<const DAMPED: u8>(
        &self,
        nodes: &Range<usize>,
        both: bool,
        damping: [T; 2],
        at: At<'_, T>,
        f: &mut [V4<T>],
    ) -> f64 {
        let [u, v] = [at.u, at.v].map(|a| ends(a, nodes, both));
        let zero = [[T::ZERO; 4]; B];
        let (mut e, mut w, mut pull) = (zero, zero, zero);
        let mut energy = [T::ZERO; B];
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
            sum += lanes.map(Real::wide).iter().sum::<f64>();
        }
        // Both sides count a spring that leaves a chunk.
        sum * if both { 0.5 } else { 0.25 } / (ENERGY_SCALE * ENERGY_SCALE)
    }

    fn linearise(
        &mut self,
        nodes: &Range<usize>,
        both: bool,
        h: T,
        damping: [T; 2],
        axial: bool,
        at: At<'_, T>,
        share: Share<'_, T>,
    ) {
        let zero = [[T::ZERO; 4]; B];
        let (mut e, mut w, mut change) = (zero, zero, zero);
        let mut blocks = [[T::ZERO; 8]; B];
        let empty = Links {
            q: [[T::ZERO; B]; 3],
            b: [T::ZERO; B],
        };
        self.links.resize(self.blocks.len(), empty);
        let [u, v] = [at.u, at.v].map(|a| ends(a, nodes, both));
        for (block, links) in self.blocks.iter().zip(&mut self.links) {
            block.differences(u, &mut e);
            block.differences(v, &mut w);
            block.linearise(h, damping, axial, &e, &w, links, &mut change);
            block.scatter(both, &change, share.change);
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
        let p = ends(p, nodes, both);
        let zero = [[T::ZERO; 4]; B];
        let (mut e, mut pull) = (zero, zero);
        for (block, links) in self.blocks.iter().zip(&self.links) {
            block.differences(p, &mut e);
            links.multiply(&e, &mut pull);
            // A_ij p_j + A_ii p_i = −(q qᵀ + b I)(p_j − p_i).
            for ((s, i), j) in pull.iter().zip(&block.i).zip(&block.j) {
                let (i, j) = (*i as usize, *j as usize);
                y[i] = sub(y[i], *s);
                if both {
                    y[j] = add(y[j], *s);
                }
            }
        }
    }
}

/// What the two ends of a list's springs are numbered in.
fn ends<'a, T>(a: &'a [V4<T>], nodes: &Range<usize>, both: bool) -> [&'a [V4<T>]; 2] {
    let here = &a[nodes.clone()];
    [here, if both { here } else { a }]
}

impl<T: Real> Term<T> for Springs<T> {
    fn forces(&self, chunk: usize, at: At<'_, T>, f: &mut [V4<T>]) -> f64 {
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

    fn linearise(&mut self, plan: &Plan, at: At<'_, T>, h: T, share: Share<'_, T>) {
        let (damping, axial) = (self.damping, self.kind == Damping::Axial);
        let data = (
            Chunks(&mut self.chunks),
            Nodes(share.diagonal),
            Nodes(share.change),
        );
        plan.each(data, &|_, _, (chunks, diagonal, change)| {
            if let [chunk] = chunks.0 {
                for (list, both) in [(&mut chunk.inner, true), (&mut chunk.outer, false)] {
                    let share = Share {
                        diagonal: &mut *diagonal.0,
                        change: &mut *change.0,
                    };
                    list.linearise(&chunk.nodes, both, h, damping, axial, at, share);
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

    fn pairs(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for chunk in &self.chunks {
            let first = chunk.nodes.start as u32;
            for (list, base) in [(&chunk.inner, first), (&chunk.outer, 0)] {
                for (block, links) in list.blocks.iter().zip(&list.links) {
                    for n in 0..block.count {
                        let [i, j] = [block.i[n] + first, block.j[n] + base];
                        // Springs that leave a chunk are there twice.
                        if i > j {
                            continue;
                        }
                        let q = links.q.map(|q| q[n].wide());
                        let b = links.b[n].wide();
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
