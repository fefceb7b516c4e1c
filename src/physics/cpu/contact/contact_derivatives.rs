//! Derivatives of contact forces for adjoint sensitivities: by tool poses, by gaps, and by the
//! stiffness behind the boundary. Each is that of Σ y·f over contact points with forces f, at given
//! vectors y, in local units.

use super::boundary_surface::{BoundarySurface, ContactPoint};
use super::candidates::{AREA_FRACTION, CollisionCandidate};
use super::self_contact::SelfContactTerm;
use super::tool_contact::ToolContact;
use crate::physics::contact::{Barrier, PrimitivePair};
use crate::physics::cpu::vectors::{V4, outer_product, to_dvec};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// Step of central differences of the force between two features, over their distance.
pub(super) const PAIR_DIFFERENCE_STEP: f64 = 1e-4;

/// Derivatives by the pose, the gap and the friction of a tool.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::physics::cpu) struct ToolDerivatives {
    /// By a translation.
    pub translation: DVec3,
    /// By a rotation vector about the origin of its shape.
    pub rotation: DVec3,
    /// By its gap ĝ.
    pub gap: f64,
    /// By its coefficient of friction.
    pub friction: f64,
}

/// Derivatives by the weights A K of boundary nodes, edges and faces.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct WeightDerivatives {
    nodes: Vec<f64>,
    edges: BTreeMap<[u32; 2], f64>,
    faces: BTreeMap<[u32; 3], f64>,
    /// By the speed below which friction is static.
    pub static_speed: f64,
}

impl WeightDerivatives {
    /// Creates derivatives of 0 for a body of `nodes` nodes.
    pub fn new(nodes: usize) -> WeightDerivatives {
        WeightDerivatives {
            nodes: vec![0.0; nodes],
            edges: BTreeMap::new(),
            faces: BTreeMap::new(),
            static_speed: 0.0,
        }
    }

    /// Adds the derivatives of a number that is proportional to the weight of a point; `whole` are
    /// the weights of faces.
    pub(super) fn add_point(
        &mut self,
        s: &ContactPoint,
        value: f64,
        whole: &BTreeMap<[u32; 3], f64>,
    ) {
        match s.face() {
            None => self.nodes[s.spread().0[0] as usize] += value / s.area_stiffness,
            // A point of a face has a fixed part of its weight.
            Some(face) => {
                let whole = whole.get(&face).copied().unwrap_or(f64::INFINITY);
                *self.faces.entry(face).or_default() += value / whole;
            }
        }
    }

    /// Adds the derivatives of a number that is proportional to the weight of a pair.
    pub(super) fn add_pair(&mut self, pair: &CollisionCandidate, value: f64) {
        let by_weight = AREA_FRACTION * value / pair.weight;
        let [a, b, ..] = pair.nodes;
        match pair.features {
            PrimitivePair::VertexFace => self.nodes[a as usize] += by_weight,
            PrimitivePair::EdgeEdge => {
                *self.edges.entry([a.min(b), a.max(b)]).or_default() += by_weight;
            }
        }
    }

    /// Returns the derivative by the A K of each face of `hull`, of which each node and each edge
    /// has a third.
    pub fn of_faces(&self, hull: &BoundarySurface) -> Vec<f64> {
        let of_face = |(face, _): &([u32; 3], f64)| {
            let nodes: f64 = face.iter().map(|v| self.nodes[*v as usize]).sum();
            let edges = [0, 1, 2].map(|k| {
                let (i, j) = (face[k], face[(k + 1) % 3]);
                self.edges.get(&[i.min(j), i.max(j)]).copied()
            });
            let edges: f64 = edges.into_iter().flatten().sum();
            let own = self.faces.get(face).copied().unwrap_or(0.0);
            own + (nodes + edges) / 3.0
        };
        hull.faces.iter().map(of_face).collect()
    }
}

impl ToolContact<f64> {
    /// Returns ∂/∂x of minus the sum of the forces of tool `tool` on the body along `direction`:
    /// pairs of nodes and vectors.
    pub fn tool_force_gradient(
        &self,
        u: &[V4<f64>],
        (tool, direction): (usize, DVec3),
    ) -> Vec<(usize, DVec3)> {
        let mut gradient = Vec::new();
        let points = self
            .contact_points
            .iter()
            .filter(|s| s.tool as usize == tool);
        for s in points {
            if let Some((_, stiffness, _)) = self.point_tangent(s, u) {
                let along = stiffness * direction;
                gradient.extend(s.corners().map(|(i, w)| (i, w * along)));
            }
        }
        gradient
    }

    /// Returns the derivatives by each tool at y = Σ w `lambda` at the nodes of each point, minus
    /// the vector of `force` at the points of its tool; adds those by weights to `weights`.
    pub fn force_derivatives(
        &self,
        u: &[V4<f64>],
        lambda: &[V4<f64>],
        force: Option<(usize, DVec3)>,
        weights: &mut WeightDerivatives,
    ) -> Vec<ToolDerivatives> {
        let mut all = vec![ToolDerivatives::default(); self.tools.len()];
        let stiffness_of = self.face_weights();
        for s in &self.contact_points {
            let Some((f, stiffness, by_gap)) = self.point_tangent(s, u) else {
                continue;
            };
            let tool = s.tool as usize;
            let mut y: DVec3 = s.corners().map(|(i, w)| w * to_dvec(lambda[i])).sum();
            if let Some((_, direction)) = force.filter(|(of, _)| *of == tool) {
                y -= direction;
            }
            let (along, arm) = (
                stiffness * y,
                self.point(s, u) - self.tools[tool].at.position,
            );
            let to = &mut all[tool];
            to.translation += along;
            to.rotation += f.cross(y) + arm.cross(along);
            to.gap += by_gap.dot(y);
            weights.add_point(s, f.dot(y), &stiffness_of);
        }
        all
    }

    /// Returns the A K of each boundary face.
    pub(super) fn face_weights(&self) -> BTreeMap<[u32; 3], f64> {
        self.hull.faces.iter().copied().collect()
    }

    /// Returns the force on an active point, minus its derivative by the point, and its derivative
    /// by the gap.
    fn point_tangent(&self, s: &ContactPoint, u: &[V4<f64>]) -> Option<(DVec3, DMat3, DVec3)> {
        let (tool, touch) = self.active_distance(s, u)?;
        let ratio = touch.distance / tool.gap;
        let barrier = Barrier::clamped(ratio);
        let along = outer_product(touch.normal) * (barrier.second_derivative / tool.gap);
        let across = touch.curvature * barrier.first_derivative;
        let by_gap = s.area_stiffness * barrier.second_derivative * ratio / tool.gap;
        Some((
            self.contact_force(s, tool, &touch),
            (along + across) * s.area_stiffness,
            by_gap * touch.normal,
        ))
    }
}

/// A pair of features and the 3×3 blocks of its four nodes.
pub(in crate::physics::cpu) type PairTangent = ([u32; 4], [[DMat3; 4]; 4]);

impl SelfContactTerm<f64> {
    /// Returns for each active pair the difference between the exact Hessian at `u`, by central
    /// differences of its forces, and the one of `linearise`, which keeps the part along the normal.
    pub fn tangent_corrections(&self, u: &[V4<f64>]) -> Vec<PairTangent> {
        let correction = |pair: &CollisionCandidate| {
            let active = self.active_pair(pair, u)?;
            let x = self.positions(pair, u);
            let step = PAIR_DIFFERENCE_STEP * pair.features.closest_points(&x).distance;
            let forces = |x: &[DVec3; 4]| {
                let active = Self::active_pair_at(pair, x);
                active.map_or([DVec3::ZERO; 4], |active| Self::pair_forces(pair, &active))
            };
            let along = active.mollifier * pair.weight * active.barrier.second_derivative;
            let along = outer_product(active.normal) * (along / pair.gap);
            let mut blocks = [[DMat3::ZERO; 4]; 4];
            for (b, axis) in (0..4).flat_map(|b| (0..3).map(move |axis| (b, axis))) {
                let shifted = |by: f64| {
                    let mut x = x;
                    x[b][axis] += by * step;
                    forces(&x)
                };
                let [[p, q], [r, s]] = [[1.0, -1.0], [2.0, -2.0]].map(|pair| pair.map(shifted));
                for a in 0..4 {
                    // Fourth order.
                    let slope = (8.0 * (p[a] - q[a]) - (r[a] - s[a])) / (12.0 * step);
                    *blocks[a][b].col_mut(axis) = -slope;
                }
            }
            for (a, b) in (0..4).flat_map(|a| (0..4).map(move |b| (a, b))) {
                blocks[a][b] -= along * (active.weights[a] * active.weights[b]);
            }
            Some((pair.nodes, blocks))
        };
        self.pairs.iter().filter_map(correction).collect()
    }

    /// Adds the derivatives by the weights of the pairs, with y = `lambda`, to `weights`.
    pub fn add_weight_derivatives(
        &self,
        u: &[V4<f64>],
        lambda: &[V4<f64>],
        weights: &mut WeightDerivatives,
    ) {
        for pair in &self.pairs {
            let Some(active) = self.active_pair(pair, u) else {
                continue;
            };
            let forces = pair.nodes.iter().zip(Self::pair_forces(pair, &active));
            let sum: f64 = forces
                .map(|(i, f)| f.dot(to_dvec(lambda[*i as usize])))
                .sum();
            weights.add_pair(pair, sum);
        }
    }
}
