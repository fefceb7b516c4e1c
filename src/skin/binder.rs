//! Binding of one vertex to a base triangle: reference point and basis.

use super::binding::{BaseMesh, Mapping};
use super::vertices::Vertices;
use crate::mesh::{LocalFrame, TriangleBvh, unpack_normal};
use crate::skin::basis::{VertexBinding, interpolated_normal};
use crate::{Error, Result};
use glam::DVec3;

/// Triangles whose corner sines are all smaller are degenerate: their normals would be noise.
const FLAT_SINE: f64 = 1e-2;
/// Sums of normals shorter than this, or with a smaller sine to the edge, are not used.
const MIN_NORMAL_LENGTH: f64 = 0.1;
/// Auto: up to this offset, as a fraction of the triangle's longest edge, both bases look the same.
const MAX_AUTO_OFFSET: f64 = 0.02;
/// Auto: twice that offset is allowed if the reference point is closer to a node than this fraction
/// of the longest edge.
const NODE_PROXIMITY_RATIO: f64 = 0.05;
/// The normal-only mapping accepts weights down to minus this, beyond the border of a sheet.
const MIN_OUTSIDE_WEIGHT: f64 = 0.5;
/// Weights down to minus this count as on the border.
const RIM_TOLERANCE: f64 = 1e-9;
/// Feet of normals farther than this multiple of the closest-point distance are rejected.
const MAX_FOOT_RATIO: f64 = 3.0;
/// Distances below this, in local units, count as zero in single precision.
const ZERO_DISTANCE: f64 = 1e-6;

/// Predicate on the nodes of a triangle: whether a vertex may be bound to it.
pub(super) type TriangleFilter<'a> = &'a dyn Fn([u32; 3]) -> bool;

/// Mapping that was used for a vertex.
pub(super) enum BindingKind {
    OneToOne,
    Constant,
    Interpolated,
    NormalOnly,
    Fallback,
}

/// A vertex to bind, in the local frame.
pub(super) struct Vertex {
    position: DVec3,
    normal: DVec3,
    tangent: DVec3,
}

impl Vertex {
    /// Returns vertex `v` of `vertices` in `frame`.
    pub fn new(vertices: &Vertices, v: usize, frame: &LocalFrame) -> Vertex {
        Vertex {
            position: (vertices.positions[v] - frame.origin) / frame.scale,
            normal: vertices.normals[v],
            tangent: vertices.tangents[v],
        }
    }
}

/// A point on a base triangle: its nodes and their weights.
#[derive(Clone, Copy)]
pub(super) struct BindingSite {
    pub nodes: [u32; 3],
    pub weights: [f64; 3],
}

/// The base triangles with search structures.
pub(super) struct Binder<'a> {
    nodes: &'a [DVec3],
    normals: Vec<Option<DVec3>>,
    /// The non-degenerate triangles, each starting at the corner closest to a right angle: its
    /// edges rotate with the triangle rather than with its shear.
    triangles: Vec<[u32; 3]>,
    tree: TriangleBvh,
    /// Search tree over the nodes, as triangles of zero size, and for each node one incident
    /// triangle and the corner index; built for the one-to-one mapping.
    corner_tree: Option<(TriangleBvh, Vec<(usize, usize)>)>,
    /// Incident triangles of each node: offsets into the list, and the list.
    around: (Vec<u32>, Vec<u32>),
}

impl<'a> Binder<'a> {
    /// Builds the search structures of `base` for `mapping`.
    ///
    /// # Errors
    /// As [`BaseMesh::bind`](super::BaseMesh::bind).
    pub fn new(base: &'a BaseMesh, mapping: Mapping) -> Result<Binder<'a>> {
        let count = base.nodes.len();
        if base.normals.len() != count {
            return Err(Error::Input(format!(
                "number of normals must equal the number of base nodes ({count}), got {}",
                base.normals.len()
            )));
        }
        if let Some(bad) = base
            .triangles
            .iter()
            .flatten()
            .find(|v| **v as usize >= count)
        {
            return Err(Error::Input(format!(
                "node index {bad} of a base triangle is out of range: there are {count} nodes, counted from 0"
            )));
        }
        if let Some(bad) = base.nodes.iter().position(|p| !p.is_finite()) {
            return Err(Error::Input(format!(
                "node {bad} of the base of the skin has non-finite coordinates"
            )));
        }
        let corners = |t: &[u32; 3]| t.map(|v| base.nodes[v as usize]);
        let triangles: Vec<[u32; 3]> = base
            .triangles
            .iter()
            .filter_map(|t| {
                let sines = [0, 1, 2].map(|k| sine(corners(t), k));
                let best = (0..3).max_by(|a, b| sines[*a].total_cmp(&sines[*b]))?;
                (sines[best] > FLAT_SINE).then(|| [0, 1, 2].map(|k| t[(best + k) % 3]))
            })
            .collect();
        if triangles.is_empty() {
            return Err(Error::Input(format!(
                "all {} base triangles are degenerate; a skin needs at least one with a non-zero area",
                base.triangles.len()
            )));
        }
        Ok(Binder {
            nodes: base.nodes,
            normals: base.normals.iter().map(|n| unpack_normal(*n)).collect(),
            tree: TriangleBvh::new(triangles.iter().map(corners).collect()),
            corner_tree: (mapping == Mapping::OneToOne).then(|| {
                let mut owners: Vec<(usize, usize)> = (0..triangles.len())
                    .flat_map(|t| [(t, 0), (t, 1), (t, 2)])
                    .collect();
                let node = |(t, k): (usize, usize)| triangles[t][k];
                owners.sort_by_key(|o| (node(*o), *o));
                owners.dedup_by_key(|o| node(*o));
                let points = owners.iter().map(|o| [base.nodes[node(*o) as usize]; 3]);
                (TriangleBvh::new(points.collect()), owners)
            }),
            around: triangles_around(&triangles, count),
            triangles,
        })
    }

    /// Returns the number of non-degenerate base triangles.
    pub fn count(&self) -> usize {
        self.triangles.len()
    }

    /// Binds `vertex` to the closest triangle that `accept` allows, or to the closest of all if it
    /// allows none.
    pub fn bind(
        &self,
        vertex: &Vertex,
        mapping: Mapping,
        accept: TriangleFilter,
    ) -> (VertexBinding, BindingKind) {
        let nearest = self
            .tree
            .nearest_accepted(vertex.position, |t| accept(self.triangles[t]))
            .or_else(|| self.tree.nearest(vertex.position));
        // A triangle exists: `new` rejects an empty set.
        let (t, weights) = nearest.unwrap_or_default();
        let seat = BindingSite {
            nodes: self.triangles[t],
            weights,
        };
        let constant = |kind| (self.bind_at(vertex, seat, false), kind);
        let interpolated = |seat| (self.bind_at(vertex, seat, true), BindingKind::Interpolated);
        match mapping {
            Mapping::OneToOne => (self.on_node(vertex, t, accept), BindingKind::OneToOne),
            Mapping::Constant => constant(BindingKind::Constant),
            Mapping::Interpolated => self
                .smooth_seat(vertex, t, seat, accept)
                .map_or_else(|| constant(BindingKind::Fallback), interpolated),
            Mapping::Auto if self.looks_away(seat) => constant(BindingKind::Fallback),
            Mapping::Auto if self.is_unseen(vertex, seat) => constant(BindingKind::Constant),
            Mapping::Auto => self
                .smooth_seat(vertex, t, seat, accept)
                .filter(|seat| !self.looks_away(*seat))
                .map_or_else(|| constant(BindingKind::Fallback), interpolated),
            Mapping::NormalOnly => self.along_normal(vertex, t, accept).map_or_else(
                || constant(BindingKind::Fallback),
                |bound| (bound, BindingKind::NormalOnly),
            ),
        }
    }

    fn corners(&self, nodes: [u32; 3]) -> [DVec3; 3] {
        nodes.map(|v| self.nodes[v as usize])
    }

    fn corner_normals(&self, nodes: [u32; 3]) -> [Option<DVec3>; 3] {
        nodes.map(|v| self.normals[v as usize])
    }

    /// Whether the interpolated basis is well defined at the point.
    pub fn is_smooth(&self, seat: BindingSite) -> bool {
        let [a, b, _] = self.corners(seat.nodes);
        let tangent = (b - a).normalize_or_zero();
        let sum = interpolated_normal(seat.weights, self.corner_normals(seat.nodes));
        sum.length() > MIN_NORMAL_LENGTH
            && sum.cross(tangent).length() > MIN_NORMAL_LENGTH * sum.length()
    }

    /// Whether a node of the triangle has no normal, or one that points away from the triangle's.
    fn looks_away(&self, seat: BindingSite) -> bool {
        let [a, b, c] = self.corners(seat.nodes);
        let normal = (b - a).cross(c - a);
        self.corner_normals(seat.nodes)
            .iter()
            .any(|n| n.is_none_or(|n| n.dot(normal) <= 0.0))
    }

    /// Whether both bases give visually the same result; the paper uses the constant one there too.
    fn is_unseen(&self, vertex: &Vertex, seat: BindingSite) -> bool {
        let p = self.corners(seat.nodes);
        let edge = [0, 1, 2]
            .map(|k| p[k].distance(p[(k + 1) % 3]))
            .into_iter()
            .fold(0.0, f64::max);
        let point = combined(seat.weights, p);
        let offset = vertex.position.distance(point);
        let near_node = p
            .iter()
            .any(|q| q.distance(point) <= NODE_PROXIMITY_RATIO * edge);
        offset <= MAX_AUTO_OFFSET * edge || (near_node && offset <= 2.0 * MAX_AUTO_OFFSET * edge)
    }

    /// Expresses `vertex` in a basis at `seat`, with the rounded weights that the GPU uses.
    pub fn bind_at(&self, vertex: &Vertex, seat: BindingSite, interpolated: bool) -> VertexBinding {
        let weights = rounded(seat.weights);
        let p = self.corners(seat.nodes);
        let normal = interpolated_normal(weights, self.corner_normals(seat.nodes));
        let frame = VertexBinding::basis(interpolated, p, normal).transpose();
        VertexBinding {
            nodes: seat.nodes,
            interpolated,
            weights,
            offset: frame * (vertex.position - combined(weights, p)),
            normal: frame * vertex.normal,
            tangent: frame * vertex.tangent,
        }
    }

    /// Binds `vertex` to the closest node of the base: an interpolated basis at that corner of an
    /// incident triangle, with zero offset. Its normal is that of the node.
    fn on_node(&self, vertex: &Vertex, t: usize, accept: TriangleFilter) -> VertexBinding {
        let own = match &self.corner_tree {
            Some((tree, owners)) => tree
                .nearest_accepted(vertex.position, |i| accept(self.triangles[owners[i].0]))
                .map(|(i, _)| owners[i]),
            None => None,
        };
        let (own, first) = own.unwrap_or((t, 0));
        let nodes = [0, 1, 2].map(|k| self.triangles[own][(first + k) % 3]);
        bind_to_node(nodes)
    }

    fn around(&self, node: u32) -> impl Iterator<Item = usize> {
        let (firsts, list) = &self.around;
        let range = firsts[node as usize] as usize..firsts[node as usize + 1] as usize;
        list[range].iter().map(|t| *t as usize)
    }

    /// Finds the point on triangle `t` or one of its neighbours whose interpolated normal passes
    /// through `vertex`; weights may be as low as −`beyond`.
    fn normal_foot(
        &self,
        vertex: &Vertex,
        t: usize,
        beyond: f64,
        accept: TriangleFilter,
    ) -> Option<BindingSite> {
        let mut candidates: Vec<usize> = self.triangles[t]
            .iter()
            .flat_map(|v| self.around(*v))
            .filter(|t| accept(self.triangles[*t]))
            .collect();
        candidates.sort_unstable();
        candidates.dedup();
        let found = |t: usize| {
            let nodes = self.triangles[t];
            let [a, b, c] = self.corner_normals(nodes);
            let (weights, height) = foot(vertex.position, self.corners(nodes), [a?, b?, c?])?;
            let outside = weights.iter().fold(RIM_TOLERANCE, |m, w| m.max(-w));
            let seat = BindingSite { nodes, weights };
            let fits = outside <= beyond && self.is_smooth(seat);
            fits.then_some((outside, height.abs(), seat))
        };
        candidates
            .into_iter()
            .filter_map(found)
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)))
            .map(|(_, _, seat)| seat)
    }

    /// Binds `vertex` to the interpolated normal that passes through it, with no tangential offset.
    fn along_normal(
        &self,
        vertex: &Vertex,
        t: usize,
        accept: TriangleFilter,
    ) -> Option<VertexBinding> {
        let seat = self.normal_foot(vertex, t, MIN_OUTSIDE_WEIGHT, accept)?;
        let mut bound = self.bind_at(vertex, seat, true);
        bound.offset = DVec3::new(0.0, bound.offset.y, 0.0);
        // Check: with the correct foot there is no tangential remainder.
        let back = bound.skin(self.nodes, &self.normals).position;
        (back.distance(vertex.position) < ZERO_DISTANCE).then_some(bound)
    }

    /// Returns the reference point for an interpolated basis: the foot of an interpolated normal
    /// through `vertex`, so that the offset has no tangential part that neighbouring base triangles
    /// would rotate differently; else the closest point.
    fn smooth_seat(
        &self,
        vertex: &Vertex,
        t: usize,
        nearest: BindingSite,
        accept: TriangleFilter,
    ) -> Option<BindingSite> {
        let distance = vertex
            .position
            .distance(combined(nearest.weights, self.corners(nearest.nodes)));
        let near = |seat: &BindingSite| {
            let foot = combined(seat.weights, self.corners(seat.nodes));
            vertex.position.distance(foot) <= MAX_FOOT_RATIO * distance + ZERO_DISTANCE
        };
        self.normal_foot(vertex, t, RIM_TOLERANCE, accept)
            .filter(near)
            .or_else(|| Some(nearest).filter(|seat| self.is_smooth(*seat)))
    }
}

/// Binding to the first of `nodes`, with the normal of that node.
pub(super) fn bind_to_node(nodes: [u32; 3]) -> VertexBinding {
    VertexBinding {
        nodes,
        interpolated: true,
        weights: [1.0, 0.0, 0.0],
        offset: DVec3::ZERO,
        normal: DVec3::Y,
        tangent: DVec3::X,
    }
}

/// Returns weights (of sum 1) and a height h with Σ wᵢ (pᵢ + h nᵢ) = v: the triangle offset by h
/// along its corner normals contains v. Solves for zero volume of the offset triangle and v, a
/// cubic in h, by Newton's method.
fn foot(v: DVec3, p: [DVec3; 3], n: [DVec3; 3]) -> Option<([f64; 3], f64)> {
    let volume = |a: DVec3, b: DVec3, c: DVec3| a.cross(b).dot(c);
    let [a, b, c] = p.map(|p| p - v);
    let cubic = [
        volume(a, b, c),
        volume(n[0], b, c) + volume(a, n[1], c) + volume(a, b, n[2]),
        volume(n[0], n[1], c) + volume(n[0], b, n[2]) + volume(a, n[1], n[2]),
        volume(n[0], n[1], n[2]),
    ];
    let plane = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize()?;
    let mut h = (v - p[0]).dot(plane);
    for _ in 0..40 {
        let value = ((cubic[3] * h + cubic[2]) * h + cubic[1]) * h + cubic[0];
        let slope = (3.0 * cubic[3] * h + 2.0 * cubic[2]) * h + cubic[1];
        let step = value / slope;
        h -= step;
        if !h.is_finite() {
            return None;
        }
        if step.abs() < 1e-15 {
            break;
        }
    }
    let [a, b, c] = [a + h * n[0], b + h * n[1], c + h * n[2]];
    let normal = (b - a).cross(c - a);
    let shares = [(b, c), (c, a), (a, b)].map(|(x, y)| x.cross(y).dot(normal));
    let sum: f64 = shares.iter().sum();
    let weights = shares.map(|s| s / sum);
    weights
        .iter()
        .all(|w| w.is_finite())
        .then_some((weights, h))
}

fn combined(w: [f64; 3], p: [DVec3; 3]) -> DVec3 {
    w[0] * p[0] + w[1] * p[1] + w[2] * p[2]
}

/// Rounds the weights as on the GPU: the last two to single precision, the first computed from
/// them.
fn rounded([_, second, third]: [f64; 3]) -> [f64; 3] {
    let (second, third) = (second as f32, third as f32);
    [1.0 - second - third, second, third].map(f64::from)
}

/// Returns the sine of the angle at corner `k`; 0 where two corners coincide.
fn sine(p: [DVec3; 3], k: usize) -> f64 {
    let [a, b, c] = [0, 1, 2].map(|i| p[(k + i) % 3]);
    let (ab, ac) = ((b - a).normalize_or_zero(), (c - a).normalize_or_zero());
    ab.cross(ac).length()
}

/// Returns the incident triangles of each node: offsets into the list, one more than nodes, and the
/// list.
pub(super) fn triangles_around(triangles: &[[u32; 3]], nodes: usize) -> (Vec<u32>, Vec<u32>) {
    let mut firsts = vec![0u32; nodes + 1];
    for v in triangles.iter().flatten() {
        firsts[*v as usize + 1] += 1;
    }
    for v in 0..nodes {
        firsts[v + 1] += firsts[v];
    }
    let mut next = firsts.clone();
    let mut around = vec![0; 3 * triangles.len()];
    for (t, triangle) in triangles.iter().enumerate() {
        for v in triangle {
            around[next[*v as usize] as usize] = t as u32;
            next[*v as usize] += 1;
        }
    }
    (firsts, around)
}
