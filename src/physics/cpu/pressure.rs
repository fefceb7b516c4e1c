//! Follower pressure on faces of the boundary or of interfaces between regions.
//!
//! The load on each node of a face is −⅓ p A n, with A n = ½ (x₁ − x₀) × (x₂ − x₀) at the current
//! positions. Implicit steps evaluate it at their start, like all loads: it has no part in the
//! Hessian.

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

/// Faces under a common pressure.
#[derive(Clone, Debug)]
pub(super) struct Pressure<T> {
    /// Faces with a node in each chunk.
    chunks: Vec<Vec<Face<T>>>,
    /// Index of the amplitude that is the pressure.
    amplitude_index: usize,
    /// A sixth of the pressure, local units.
    pressure_over_six: T,
    /// Pressure unit, Pa.
    unit: f64,
}

impl<T: Real> Pressure<T> {
    /// Creates a pressure on `faces`, in the file's numbering, with the amplitude of index
    /// `amplitude_index`; initially 0. `place` is the engine's index of every node, `rest` their
    /// rest positions, m.
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

    /// Sets the pressure, Pa, from the amplitudes.
    pub fn set_amplitude(&mut self, levels: &[f64]) {
        let pressure = levels.get(self.amplitude_index).copied().unwrap_or(0.0);
        self.pressure_over_six = T::from_f64(pressure / (6.0 * self.unit));
    }

    /// Passes the force on each node of a chunk's faces to `take`.
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

    /// Adds the forces on the nodes of a chunk that begins with node `first`.
    pub fn add_forces(&self, chunk: usize, first: usize, u: &[V4<T>], f: &mut [V4<T>]) {
        self.each(chunk, u, |v, share| {
            // For nodes before the chunk the subtraction wraps around to an index past its end.
            if let Some(f) = f.get_mut(v.wrapping_sub(first)) {
                *f = add(*f, share);
            }
        });
    }

    /// Returns the power on the nodes of a chunk, which move with `v`.
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
