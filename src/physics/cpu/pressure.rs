//! Pressure on faces, of the boundary or where regions meet: a load that follows them as they turn.
//!
//! On each node of a face −⅓ p A n, A n = ½ (x₁ − x₀) × (x₂ − x₀) where the nodes are. Implicit
//! steps take it at their start, as they do all loads: it has no part in the second derivatives.

use super::partition::Partition;
use super::scalar::Real;
use super::vectors::{V4, add, from_metres, scale, sub, zero};
use crate::physics::LocalUnits;
use glam::DVec3;

/// A face, counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug)]
struct Face<T> {
    nodes: [u32; 3],
    /// Edges from the first node to the others at rest.
    edges: [V4<T>; 2],
}

/// Faces under one pressure.
#[derive(Clone, Debug)]
pub(super) struct Pressure<T> {
    /// The faces with a node in each chunk.
    chunks: Vec<Vec<Face<T>>>,
    /// Which level is the pressure.
    amplitude_index: usize,
    /// A sixth of it, local units.
    pressure_over_six: T,
    /// Pa.
    unit: f64,
}

impl<T: Real> Pressure<T> {
    /// On `faces`, by the file's numbers, at the level of this number; nothing as yet. `place` is
    /// the engine's number of every node, `rest` their rest positions, m.
    pub fn new(
        faces: &[[u32; 3]],
        amplitude_index: usize,
        (place, rest): (&[u32], &[DVec3]),
        units: &LocalUnits,
        plan: &Partition,
    ) -> Pressure<T> {
        let mut chunks = vec![Vec::new(); plan.chunks()];
        for face in faces {
            let [a, b, c] = face.map(|v| rest[v as usize]);
            let nodes = face.map(|v| place[v as usize]);
            let made = Face {
                nodes,
                edges: [b - a, c - a].map(|e| from_metres(e, units.length)),
            };
            let mut homes = nodes.map(|v| plan.chunk_of(v as usize)).to_vec();
            homes.sort_unstable();
            homes.dedup();
            homes.into_iter().for_each(|home| chunks[home].push(made));
        }
        Pressure {
            chunks,
            amplitude_index,
            pressure_over_six: T::ZERO,
            unit: units.force() / (units.length * units.length),
        }
    }

    /// Takes its pressure, Pa, from among all levels.
    pub fn set_amplitude(&mut self, levels: &[f64]) {
        let pressure = levels.get(self.amplitude_index).copied().unwrap_or(0.0);
        self.pressure_over_six = T::from_f64(pressure / (6.0 * self.unit));
    }

    /// Tells the force on each node of a chunk's faces, node by node.
    #[inline]
    fn each(&self, chunk: usize, u: &[V4<T>], mut take: impl FnMut(usize, V4<T>)) {
        if self.pressure_over_six == T::ZERO {
            return;
        }
        for Face { nodes, edges } in &self.chunks[chunk] {
            let [a, b, c] = nodes.map(|v| u[v as usize]);
            let e = add(edges[0], sub(b, a));
            let d = add(edges[1], sub(c, a));
            let normal = [
                e[1] * d[2] - e[2] * d[1],
                e[2] * d[0] - e[0] * d[2],
                e[0] * d[1] - e[1] * d[0],
                T::ZERO,
            ];
            let share = sub(zero(), scale(self.pressure_over_six, normal));
            nodes.iter().for_each(|v| take(*v as usize, share));
        }
    }

    /// Adds the forces on the nodes of a chunk, which begins with node `first`.
    pub fn add_forces(&self, chunk: usize, first: usize, u: &[V4<T>], f: &mut [V4<T>]) {
        self.each(chunk, u, |v, share| {
            // Nodes before the chunk wrap around and are beyond its end.
            if let Some(f) = f.get_mut(v.wrapping_sub(first)) {
                *f = add(*f, share);
            }
        });
    }

    /// The power on the nodes of a chunk, which move with `v`.
    pub fn power(&self, chunk: usize, first: usize, u: &[V4<T>], v: &[V4<T>]) -> f64 {
        let mut sum = 0.0;
        self.each(chunk, u, |node, share| {
            if let Some(v) = v.get(node.wrapping_sub(first)) {
                sum += super::vectors::dot_f64(share, *v);
            }
        });
        sum
    }
}
