//! The boundary of a body as tools see it, and the points of it that are kept out of them.
//!
//! These are its nodes, and of faces that are large beside a tool points of a lattice as well, so
//! that none lets it through. They keep their places in the faces: what they feel is smooth in the
//! nodes' places, and so many areas under a pressure.

use super::tool_contact::ToolState;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use crate::physics::cpu::vectors::to_dvec;
use glam::DVec3;

/// Points of a face's lattice are nearer to each other at rest than this part of a tool's size.
const MAX_SPACING_RATIO: f64 = 0.2;

/// The finest lattice has so many points along an edge of a face.
const MAX_SUBDIVISIONS: f64 = 12.0;

/// A point whose nodes are free by less than this has nowhere to go.
const MIN_MOBILITY: f64 = 0.25;

/// A point of the boundary and a tool that it may come near to.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct ContactPoint {
    nodes: [u32; 3],
    weights: [f64; 3],
    pub tool: u32,
    /// A K: its area by the stiffness of what is behind it.
    pub area_stiffness: f64,
    /// The chunk that counts its energy.
    pub owner_chunk: u32,
    chunks: [u32; 3],
}

impl ContactPoint {
    /// Its nodes, with their weights.
    #[inline]
    pub fn corners(&self) -> impl Iterator<Item = (usize, f64)> + use<> {
        let corners = self.nodes.map(|i| i as usize);
        let weights = self.weights;
        (0..3)
            .map(move |k| (corners[k], weights[k]))
            .filter(|(_, w)| *w != 0.0)
    }

    /// As a mean of four nodes.
    pub fn spread(&self) -> ([u32; 4], [f64; 4]) {
        let ([a, b, c], [u, v, w]) = (self.nodes, self.weights);
        ([a, b, c, a], [u, v, w, 0.0])
    }

    /// The chunks that these are in, each once.
    pub fn chunks(&self) -> impl Iterator<Item = usize> + use<> {
        let chunks = self.chunks;
        (0..3)
            .filter(move |k| chunks[..*k].iter().all(|c| *c != chunks[*k]))
            .map(move |k| chunks[k] as usize)
    }
}

/// A tool, and from how far away points come near that do not move.
#[derive(Clone, Copy)]
pub(in crate::physics::cpu) struct ToolNeighbourhood<'a> {
    pub tool: &'a ToolState,
    pub extra: f64,
}

/// The boundary of a body: local units, the engine's numbers.
#[derive(Clone, Debug)]
pub(in crate::physics) struct BoundarySurface {
    /// Rest positions of all nodes of the body.
    pub rest: Vec<DVec3>,
    /// Nodes of the boundary, each with A K.
    pub nodes: Vec<(u32, f64)>,
    /// Faces of it, each with A K.
    pub faces: Vec<([u32; 3], f64)>,
    /// The mean edge of these.
    pub edge: f64,
    /// Where the nodes were when points were last chosen, and how far they may go from there.
    reference_positions: Vec<DVec3>,
    pub margin: f64,
}

impl BoundarySurface {
    /// Of `faces`, by the engine's numbers, each of them with the stiffness of what is behind it,
    /// in a body whose nodes rest at `rest`.
    pub fn new(rest: Vec<DVec3>, faces: &[([u32; 3], f64)]) -> BoundarySurface {
        let mut nodes = std::collections::BTreeMap::new();
        let (mut edges, mut own) = (0.0, Vec::with_capacity(faces.len()));
        for (face, stiffness) in faces {
            let [a, b, c] = face.map(|v| rest[v as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            edges += a.distance(b) + b.distance(c) + c.distance(a);
            own.push((*face, area * stiffness));
            for v in face {
                *nodes.entry(*v).or_insert(0.0) += area * stiffness / 3.0;
            }
        }
        BoundarySurface {
            rest,
            edge: edges / (3.0 * faces.len().max(1) as f64),
            // A node of faces without area is kept out all the same.
            nodes: nodes
                .into_iter()
                .filter(|(_, weight)| *weight > 0.0)
                .collect(),
            faces: own,
            reference_positions: Vec::new(),
            margin: 0.0,
        }
    }

    /// Where node `i` is at the displacements `u`.
    #[inline]
    pub fn position<T: Real>(&self, i: usize, u: &[V4<T>]) -> DVec3 {
        self.rest[i] + to_dvec(u[i])
    }

    /// How far the boundary comes from `p`.
    pub fn max_distance_from<T: Real>(&self, p: DVec3, u: &[V4<T>]) -> f64 {
        let all = self
            .nodes
            .iter()
            .map(|(i, _)| self.position(*i as usize, u));
        all.map(|x| x.distance(p)).fold(0.0, f64::max)
    }

    /// The farthest that a node of the boundary is at `u` from where it was when points were last
    /// chosen.
    pub fn max_displacement_since<T: Real>(&self, u: &[V4<T>]) -> f64 {
        let nodes = self.nodes.iter().zip(&self.reference_positions);
        let off = nodes.map(|((i, _), x)| x.distance_squared(self.position(*i as usize, u)));
        off.fold(0.0, f64::max).sqrt()
    }

    /// Chooses the points that may come near to tools while no node moves by more than `margin`:
    /// those that are nearer than that and what tools have in addition. Nodes that are not free do not
    /// feel tools.
    pub(in crate::physics::cpu) fn build_candidates<T: Real>(
        &mut self,
        (u, free, plan): (&[V4<T>], &[T], &Partition),
        margin: f64,
        tools: &[ToolNeighbourhood<'_>],
    ) -> Vec<ContactPoint> {
        self.margin = margin;
        self.reference_positions.clear();
        let places = self
            .nodes
            .iter()
            .map(|(i, _)| self.rest[*i as usize] + to_dvec(u[*i as usize]));
        self.reference_positions.extend(places);
        let mut samples = Vec::new();
        for (t, near) in tools.iter().enumerate() {
            let distance = |p: DVec3| near.tool.shape.distance(near.tool.from.to_local(p));
            let (extra, size) = (near.extra, near.tool.shape.feature_size());
            for ((i, weight), x) in self.nodes.iter().zip(&self.reference_positions) {
                if distance(*x) < margin + extra {
                    let point = ([*i; 3], [1.0, 0.0, 0.0], *weight);
                    samples.extend(contact_point(point, t, (free, plan)));
                }
            }
            // No face comes nearer to a plane than its nodes.
            if size.is_infinite() {
                continue;
            }
            for (face, weight) in &self.faces {
                // At rest: points that came with a face's stretch could be inside already.
                let longest = edges(face.map(|v| self.rest[v as usize]));
                let parts = (longest / (MAX_SPACING_RATIO * size))
                    .ceil()
                    .min(MAX_SUBDIVISIONS) as usize;
                if parts < 2 {
                    continue;
                }
                let corners = face.map(|v| self.rest[v as usize] + to_dvec(u[v as usize]));
                let middle = corners.iter().sum::<DVec3>() / 3.0;
                if distance(middle) >= margin + extra + edges(corners) {
                    continue;
                }
                let count = ((parts + 1) * (parts + 2) / 2 - 3) as f64;
                for i in 0..=parts {
                    for j in 0..=parts - i {
                        let k = parts - i - j;
                        if [i, j, k].contains(&parts) {
                            continue;
                        }
                        let weights = [i, j, k].map(|n| n as f64 / parts as f64);
                        let point = (*face, weights, weight / count);
                        samples.extend(contact_point(point, t, (free, plan)));
                    }
                }
            }
        }
        samples
    }
}

/// The longest edge of a triangle.
fn edges([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance(b).max(b.distance(c)).max(c.distance(a))
}

/// The point of these nodes with these weights, for tool `t`; none where it has nowhere to go.
fn contact_point<T: Real>(
    (nodes, weights, weight): ([u32; 3], [f64; 3], f64),
    t: usize,
    (free, plan): (&[T], &Partition),
) -> Option<ContactPoint> {
    let corners = nodes.iter().zip(weights);
    let moves = corners
        .map(|(i, w)| w * free[*i as usize].to_f64())
        .sum::<f64>();
    let chunks = nodes.map(|i| plan.chunk_of(i as usize) as u32);
    (moves >= MIN_MOBILITY).then_some(ContactPoint {
        nodes,
        weights,
        tool: t as u32,
        area_stiffness: weight,
        owner_chunk: chunks[0],
        chunks,
    })
}
