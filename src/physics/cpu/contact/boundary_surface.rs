//! The boundary of a body for tool contact, and its contact points.
//!
//! Contact points are the boundary nodes and, on faces that are large relative to a tool, the
//! points of a lattice, so that no tool passes through a face. Their barycentric coordinates are
//! constant, so their forces are smooth functions of the node positions, and each represents a
//! fixed area under a pressure.

use super::tool_contact::ToolState;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use crate::physics::cpu::vectors::to_dvec;
use glam::DVec3;

/// Maximum spacing of a face's lattice points at rest, over the tool's feature size.
const MAX_SPACING_RATIO: f64 = 0.2;

/// Maximum number of lattice intervals along an edge of a face.
const MAX_SUBDIVISIONS: f64 = 12.0;

/// Minimum weighted fraction of free nodes of a contact point; others are ignored.
const MIN_MOBILITY: f64 = 0.25;

/// A contact point and a tool that it may come near.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct ContactPoint {
    nodes: [u32; 3],
    weights: [f64; 3],
    pub tool: u32,
    /// A K: its area times the Young's modulus behind it.
    pub area_stiffness: f64,
    /// The chunk that counts its energy.
    pub owner_chunk: u32,
    chunks: [u32; 3],
}

impl ContactPoint {
    /// Returns its nodes with their weights.
    #[inline]
    pub fn corners(&self) -> impl Iterator<Item = (usize, f64)> + use<> {
        let corners = self.nodes.map(|i| i as usize);
        let weights = self.weights;
        (0..3)
            .map(move |k| (corners[k], weights[k]))
            .filter(|(_, w)| *w != 0.0)
    }

    /// Returns its face; `None` for a boundary node.
    pub fn face(&self) -> Option<[u32; 3]> {
        let [a, b, _] = self.nodes;
        (a != b).then_some(self.nodes)
    }

    /// Returns it as a weighted mean of four nodes.
    pub fn spread(&self) -> ([u32; 4], [f64; 4]) {
        let ([a, b, c], [u, v, w]) = (self.nodes, self.weights);
        ([a, b, c, a], [u, v, w, 0.0])
    }

    /// Returns the distinct chunks of its nodes.
    pub fn chunks(&self) -> impl Iterator<Item = usize> + use<> {
        let chunks = self.chunks;
        (0..3)
            .filter(move |k| chunks[..*k].iter().all(|c| *c != chunks[*k]))
            .map(move |k| chunks[k] as usize)
    }
}

/// A tool, and the distance below which fixed points are near it.
#[derive(Clone, Copy)]
pub(in crate::physics::cpu) struct ToolNeighbourhood<'a> {
    pub tool: &'a ToolState,
    pub extra: f64,
}

/// The boundary of a body, in local units and the engine's node order.
#[derive(Clone, Debug)]
pub(in crate::physics) struct BoundarySurface {
    /// Rest positions of all nodes of the body.
    pub rest: Vec<DVec3>,
    /// Boundary nodes, each with A K.
    pub nodes: Vec<(u32, f64)>,
    /// Boundary faces, each with A K.
    pub faces: Vec<([u32; 3], f64)>,
    /// Mean edge length of the faces.
    pub edge: f64,
    /// Node positions at the last selection of contact points; the selection is valid for
    /// displacements up to `margin`.
    reference_positions: Vec<DVec3>,
    pub margin: f64,
}

impl BoundarySurface {
    /// Creates the boundary from `faces`, given by the engine's node indices, each with the Young's
    /// modulus behind it, for a body with rest positions `rest`.
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
            // Nodes of faces without area are excluded.
            nodes: nodes
                .into_iter()
                .filter(|(_, weight)| *weight > 0.0)
                .collect(),
            faces: own,
            reference_positions: Vec::new(),
            margin: 0.0,
        }
    }

    /// Returns the position of node `i` at the displacements `u`.
    #[inline]
    pub fn position<T: Real>(&self, i: usize, u: &[V4<T>]) -> DVec3 {
        self.rest[i] + to_dvec(u[i])
    }

    /// Returns the maximum distance of a boundary node from `p`.
    pub fn max_distance_from<T: Real>(&self, p: DVec3, u: &[V4<T>]) -> f64 {
        let all = self
            .nodes
            .iter()
            .map(|(i, _)| self.position(*i as usize, u));
        all.map(|x| x.distance(p)).fold(0.0, f64::max)
    }

    /// Returns the maximum displacement at `u` of a boundary node since the last selection of
    /// contact points.
    pub fn max_displacement_since<T: Real>(&self, u: &[V4<T>]) -> f64 {
        let nodes = self.nodes.iter().zip(&self.reference_positions);
        let off = nodes.map(|((i, _), x)| x.distance_squared(self.position(*i as usize, u)));
        off.fold(0.0, f64::max).sqrt()
    }

    /// Selects the points that may come near tools while no node moves by more than `margin`: those
    /// closer than `margin` plus the tool's extra distance. Fixed nodes are exempt from contact.
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
            // No point of a face is closer to a plane than the nearest of its nodes.
            if size.is_infinite() {
                continue;
            }
            for (face, weight) in &self.faces {
                // Uses the rest lengths: points added when a face stretches could already be inside
                // a tool.
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

/// Returns the longest edge of a triangle.
fn edges([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance(b).max(b.distance(c)).max(c.distance(a))
}

/// Returns the contact point of these nodes and weights for tool `t`, or `None` if it is not mobile
/// enough.
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
