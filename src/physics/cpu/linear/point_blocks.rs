//! Contact blocks of the linear system, each acting on a weighted mean of nodes.

use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{SymMat3, V4, add, add_scaled, apply_symmetric, scale, zero};
use glam::DMat3;

/// A weighted mean of nodes, with weights that may be negative or 0, and its 3×3 block.
#[derive(Clone, Copy, Debug)]
struct Block<T> {
    nodes: [u32; 4],
    weights: [f64; 4],
    block: SymMat3<T>,
}

impl<T: Real> Block<T> {
    fn corners(&self) -> impl Iterator<Item = (usize, f64)> + use<T> {
        let (nodes, weights) = (self.nodes, self.weights);
        let corners = (0..4).map(move |k| (nodes[k] as usize, weights[k]));
        corners.filter(|(_, w)| *w != 0.0)
    }
}

/// Blocks of the last linearisation.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct PointBlocks<T> {
    all: Vec<Block<T>>,
    /// Indices of the blocks with a node in each chunk.
    of_chunks: Vec<Vec<u32>>,
}

impl<T: Real> PointBlocks<T> {
    /// Creates an empty set for `chunks` chunks.
    pub fn new(chunks: usize) -> PointBlocks<T> {
        PointBlocks {
            all: Vec::new(),
            of_chunks: vec![Vec::new(); chunks],
        }
    }

    pub fn clear(&mut self) {
        self.all.clear();
        self.of_chunks.iter_mut().for_each(Vec::clear);
    }

    /// Adds a block, also to the diagonal.
    pub fn push(
        &mut self,
        plan: &Partition,
        (nodes, weights): ([u32; 4], [f64; 4]),
        block: &DMat3,
        diagonal: &mut [SymMat3<T>],
    ) {
        if *block == DMat3::ZERO {
            return;
        }
        let added = Block {
            nodes,
            weights,
            block: pack_symmetric(block),
        };
        let number = self.all.len() as u32;
        for (i, w) in added.corners() {
            let square = T::from_f64(w * w);
            let own = diagonal[i].iter_mut().zip(&added.block);
            own.for_each(|(d, b)| *d += square * *b);
            let chunk = &mut self.of_chunks[plan.chunk_of(i)];
            if chunk.last() != Some(&number) {
                chunk.push(number);
            }
        }
        self.all.push(added);
    }

    /// Adds the blocks' part of A p to the nodes of a chunk, which begins with node `first`.
    pub fn multiply(&self, (chunk, first): (usize, usize), p: &[V4<T>], y: &mut [V4<T>]) {
        for k in &self.of_chunks[chunk] {
            let own = &self.all[*k as usize];
            let mut sum = zero();
            for (i, w) in own.corners() {
                sum = add_scaled(sum, T::from_f64(w), p[i]);
            }
            let force = apply_symmetric(&own.block, sum);
            for (i, w) in own.corners() {
                // For nodes before the chunk the subtraction wraps around to an index past its end.
                if let Some(y) = y.get_mut(i.wrapping_sub(first)) {
                    *y = add(*y, scale(T::from_f64(w), force));
                }
            }
        }
    }

    /// Visits the blocks of pairs of nodes.
    pub fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for own in &self.all {
            let m = unpacked(&own.block);
            for (i, v) in own.corners() {
                for (j, w) in own.corners().filter(|(j, _)| i < *j) {
                    visit([i as u32, j as u32], &(m * (v * w)));
                }
            }
        }
    }
}

fn pack_symmetric<T: Real>(m: &DMat3) -> SymMat3<T> {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    [x.x, y.y, z.z, x.y, x.z, y.z, 0.0, 0.0].map(T::from_f64)
}

fn unpacked<T: Real>(m: &SymMat3<T>) -> DMat3 {
    let [a, b, c, d, e, f, ..] = m.map(Real::to_f64);
    DMat3::from_cols_array(&[a, d, e, d, b, f, e, f, c])
}
