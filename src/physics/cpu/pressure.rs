//! Follower pressure on faces of the boundary or of interfaces between regions.
//!
//! The load on the nodes of a linear tet's face is −p A n / 3, with A n = ½ (x₁ − x₀) × (x₂ − x₀) at
//! the current positions; on the nodes of a ten-node tet's face it is −p ∫ N n dA over the curved face
//! ([`SixNodeFace`]). If a pressure acts on only some of its four pieces, these are flat, and the
//! nodes have −p A n times their shares in an even traction ([`traction_shares`]). Implicit steps
//! evaluate it at their start, like all loads: it has no part in the Hessian.

use super::partition::Partition;
use super::scalar::Real;
use super::six_node_face::{SixNodeFace, join_pieces};
use super::vectors::{V4, add, add_scaled, cross, from_metres, scale, sub, zero};
use crate::mesh::traction_shares;
use crate::physics::LocalUnits;
use glam::DVec3;

/// The nodes of a face, and whether each is in the middle of an edge of a ten-node tet.
pub type LoadedFace = ([u32; 3], [bool; 3]);

/// A flat face, counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug)]
struct FlatFace<T> {
    nodes: [u32; 3],
    /// Edges from the first node to the others at rest.
    edges: [V4<T>; 2],
    /// Share of each node.
    shares: [T; 3],
}

/// Faces with a node in a chunk.
#[derive(Clone, Debug)]
struct ChunkFaces<T> {
    flat: Vec<FlatFace<T>>,
    six_node: Vec<SixNodeFace<T>>,
}

/// Faces under a common pressure.
#[derive(Clone, Debug)]
pub(super) struct Pressure<T> {
    chunks: Vec<ChunkFaces<T>>,
    /// Index of the amplitude that is the pressure.
    amplitude_index: usize,
    /// Half of the pressure, local units.
    half_pressure: T,
    /// Pressure unit, Pa.
    unit: f64,
}

impl<T: Real> Pressure<T> {
    /// Creates a pressure on `faces`, in the file's numbering, each with whether its nodes are in the
    /// middle of edges of ten-node tets, with the amplitude of index `amplitude_index`; initially 0.
    /// `place` is the engine's index of every node, `rest` their rest positions, m.
    pub fn new(
        faces: &[LoadedFace],
        amplitude_index: usize,
        (place, rest): (&[u32], &[DVec3]),
        units: &LocalUnits,
        plan: &Partition,
    ) -> Pressure<T> {
        let none = ChunkFaces {
            flat: Vec::new(),
            six_node: Vec::new(),
        };
        let mut chunks = vec![none; plan.chunks()];
        let homes = |nodes: &[u32]| {
            let mut homes: Vec<usize> = nodes.iter().map(|v| plan.chunk_of(*v as usize)).collect();
            homes.sort_unstable();
            homes.dedup();
            homes
        };
        let (joined, flat) = join_pieces(faces);
        for (face, is_middle) in flat {
            let [a, b, c] = face.map(|v| rest[v as usize]);
            let nodes = face.map(|v| place[v as usize]);
            let made = FlatFace {
                nodes,
                edges: [b - a, c - a].map(|e| from_metres(e, units.length)),
                shares: traction_shares(is_middle).map(T::from_f64),
            };
            let homes = homes(&nodes).into_iter();
            homes.for_each(|home| chunks[home].flat.push(made));
        }
        for face in joined {
            let nodes = face.map(|v| place[v as usize]);
            let made = SixNodeFace::new(nodes, face.map(|v| rest[v as usize]), units.length);
            let homes = homes(&nodes).into_iter();
            homes.for_each(|home| chunks[home].six_node.push(made.clone()));
        }
        Pressure {
            chunks,
            amplitude_index,
            half_pressure: T::ZERO,
            unit: units.force() / (units.length * units.length),
        }
    }

    /// Sets the pressure, Pa, from the amplitudes.
    pub fn set_amplitude(&mut self, levels: &[f64]) {
        let pressure = levels.get(self.amplitude_index).copied().unwrap_or(0.0);
        self.half_pressure = T::from_f64(pressure / (2.0 * self.unit));
    }

    /// Passes the force on each node of a chunk's faces to `take`.
    #[inline]
    fn each(&self, chunk: usize, u: &[V4<T>], mut take: impl FnMut(usize, V4<T>)) {
        if self.half_pressure == T::ZERO {
            return;
        }
        let faces = &self.chunks[chunk];
        for FlatFace {
            nodes,
            edges,
            shares,
        } in &faces.flat
        {
            let [a, b, c] = nodes.map(|v| u[v as usize]);
            let e = add(edges[0], sub(b, a));
            let d = add(edges[1], sub(c, a));
            let normal = [
                e[1] * d[2] - e[2] * d[1],
                e[2] * d[0] - e[0] * d[2],
                e[0] * d[1] - e[1] * d[0],
                T::ZERO,
            ];
            for (v, share) in nodes.iter().zip(shares) {
                take(*v as usize, scale(-(self.half_pressure * *share), normal));
            }
        }
        for face in &faces.six_node {
            for (v, area) in face.nodes.iter().zip(face.area_vectors(u)) {
                take(*v as usize, scale(-self.half_pressure, area));
            }
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

    /// Subtracts (∂f/∂u)ᵀ y from `out`, with f the forces at the displacements `u`: the load follows
    /// the normals, so that ∂f/∂u is not symmetric unless the surface is closed.
    pub fn subtract_transposed_tangent(
        &self,
        plan: &Partition,
        (u, y): (&[V4<T>], &[V4<T>]),
        out: &mut [V4<T>],
    ) {
        for (chunk, faces) in self.chunks.iter().enumerate() {
            let own = plan.range(chunk);
            for face in &faces.flat {
                let [a, b, c] = face.nodes.map(|v| u[v as usize]);
                let (e, d) = (add(face.edges[0], sub(b, a)), add(face.edges[1], sub(c, a)));
                // Each chunk has the shares of its own nodes.
                let mut sum = zero();
                for (v, share) in face.nodes.iter().zip(face.shares) {
                    if own.contains(&(*v as usize)) {
                        sum = add_scaled(sum, self.half_pressure * share, y[*v as usize]);
                    }
                }
                let (by_e, by_d) = (cross(d, sum), cross(sum, e));
                let [first, second, third] = face.nodes.map(|v| v as usize);
                out[first] = sub(out[first], add(by_e, by_d));
                out[second] = add(out[second], by_e);
                out[third] = add(out[third], by_d);
            }
            for face in &faces.six_node {
                let own = face.nodes.map(|v| match own.contains(&(v as usize)) {
                    true => scale(self.half_pressure, y[v as usize]),
                    false => zero(),
                });
                face.add_area_derivatives(u, &own, out);
            }
        }
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
