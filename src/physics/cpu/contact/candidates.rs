//! Broad phase of self-contact: pairs of boundary primitives that may come near each other in a
//! step.

use super::boundary_surface::BoundarySurface;
use super::enclosed_components::EnclosedComponents;
use crate::mesh::{Bounds, Bvh, bounds_union, edge_face_intersections};
use crate::parallel;
use crate::physics::DiscreteModel;
use crate::physics::contact::PrimitivePair;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::rigid::bodies::RigidBodies;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use crate::physics::cpu::vectors::to_dvec;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// Gap of a pair that is closer at rest, over its rest distance.
const REST_GAP_RATIO: f64 = 0.8;

/// Fraction of the common gap below which pairs coincide at rest. They are ignored until a step
/// begins with them separated by it.
const COINCIDENT_GAP_RATIO: f64 = 1e-2;

/// Gap of these pairs once they are separated, over the common gap.
const SEPARATED_GAP_RATIO: f64 = 5e-2;

/// Fraction of its area that a vertex or an edge counts: each point of the surface has several
/// pairs on both sides.
pub(super) const AREA_FRACTION: f64 = 0.25;

/// Two primitives that may come near each other.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct CollisionCandidate {
    pub nodes: [u32; 4],
    pub features: PrimitivePair,
    /// Distance below which they repel each other.
    pub gap: f64,
    /// A K.
    pub weight: f64,
    /// Rest lengths of both edges.
    pub lengths: [f64; 2],
    pub chunks: [u32; 4],
}

impl CollisionCandidate {
    /// Returns the distinct chunks of its nodes.
    pub fn chunks_of(&self) -> impl Iterator<Item = usize> + use<> {
        let chunks = self.chunks;
        (0..4)
            .filter(move |k| chunks[..*k].iter().all(|c| *c != chunks[*k]))
            .map(move |k| chunks[k] as usize)
    }
}

/// The boundary for self-contact.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct SelfContactSurface {
    hull: BoundarySurface,
    edges: Vec<([u32; 2], f64)>,
    faces_tree: Bvh,
    edges_tree: Bvh,
    /// Motion of the boundary nodes in a step, from one position to another at a common parameter;
    /// the candidates are valid within `margin` of it.
    trajectories: Vec<[DVec3; 2]>,
    margin: f64,
    /// Positions of all nodes at the start of the step.
    step_start: Vec<DVec3>,
    /// Nodes of intersecting primitives: these form no pairs with each other until they are
    /// separated.
    intersecting: Vec<bool>,
    buried: EnclosedComponents,
}

/// An intersection of an edge with a face.
#[derive(Clone, Copy, Debug)]
pub(in crate::physics::cpu) struct Intersection {
    /// The edge's end behind the face, and the face.
    pub nodes: [u32; 4],
    /// The edge's other end.
    pub other: u32,
    /// Index of the face.
    pub face: u32,
    /// Σ w x is the vector from the intersection point to the end behind the face.
    pub weights: [f64; 4],
    /// Outward normal of the face.
    pub normal: DVec3,
    /// A K.
    pub weight: f64,
}

impl SelfContactSurface {
    /// Returns the boundary.
    pub fn hull(&self) -> &BoundarySurface {
        &self.hull
    }

    pub fn new(hull: BoundarySurface) -> SelfContactSurface {
        let mut edges: BTreeMap<[u32; 2], f64> = BTreeMap::new();
        for ([a, b, c], weight) in &hull.faces {
            for [i, j] in [[a, b], [b, c], [c, a]] {
                *edges.entry([*i.min(j), *i.max(j)]).or_default() += weight / 3.0;
            }
        }
        let edges: Vec<([u32; 2], f64)> = edges.into_iter().collect();
        let at = |v: u32| hull.rest[v as usize];
        let faces_tree = Bvh::new(hull.faces.len(), |k| {
            hull.faces[k].0.iter().map(|v| at(*v)).sum::<DVec3>() / 3.0
        });
        let edges_tree = Bvh::new(edges.len(), |k| {
            edges[k].0.iter().map(|v| at(*v)).sum::<DVec3>() / 2.0
        });
        SelfContactSurface {
            intersecting: vec![false; hull.rest.len()],
            hull,
            edges,
            faces_tree,
            edges_tree,
            trajectories: Vec::new(),
            margin: 0.0,
            step_start: Vec::new(),
            buried: EnclosedComponents::default(),
        }
    }

    /// Finds the components of `network` that are inside others at `u`. Returns the number of
    /// boundary faces that belong to them or intersect others.
    pub fn find_enclosed<T: Real>(&mut self, of: (&DiscreteModel, &[u32]), u: &[V4<T>]) -> usize {
        self.buried = EnclosedComponents::new(&self.hull, of, u);
        let through = self.crossings(u);
        let through = through.iter().map(|crossing| crossing.face);
        let all: BTreeSet<u32> = through
            .chain(self.buried.enclosed_faces(&self.hull))
            .collect();
        all.len()
    }

    /// Returns the mean edge length.
    pub fn edge(&self) -> f64 {
        self.hull.edge
    }

    /// Returns the position of a node.
    #[inline]
    pub fn position<T: Real>(&self, i: u32, u: &[V4<T>]) -> DVec3 {
        self.hull.position(i as usize, u)
    }

    /// Returns whether a boundary node at `u` is farther than the margin from the motion for which
    /// the candidates were selected, at a common parameter of all nodes: bodies that move together
    /// may meet if only one is stopped.
    pub fn exceeds_margin<T: Real>(&self, u: &[V4<T>]) -> bool {
        let ways = || {
            let nodes = self.hull.nodes.iter().zip(&self.trajectories);
            nodes.map(|((i, _), [a, b])| (self.position(*i, u), *a, *b - *a))
        };
        let (mut travelled, mut all) = (0.0, 0.0);
        for (p, a, way) in ways() {
            travelled += (p - a).dot(way);
            all += way.length_squared();
        }
        let part = match all > 0.0 {
            true => (travelled / all).clamp(0.0, 1.0),
            false => 0.0,
        };
        let off = ways().map(|(p, a, way)| p.distance_squared(a + part * way));
        off.fold(0.0, f64::max) > self.margin * self.margin
    }

    /// Stores the positions at the start of a step.
    pub fn begin<T: Real>(&mut self, u: &[V4<T>]) {
        self.step_start.clear();
        let places = self.hull.rest.iter().zip(u);
        self.step_start
            .extend(places.map(|(x, u)| *x + to_dvec(*u)));
    }

    /// Marks the primitives that intersect at `u`. Returns these intersections and the pairs that
    /// extract enclosed components.
    pub fn mark_intersections<T: Real>(&mut self, u: &[V4<T>]) -> Vec<Intersection> {
        let mut found = self.crossings(u);
        self.intersecting.fill(false);
        for crossing in &found {
            let nodes = crossing.nodes.iter().chain([&crossing.other]);
            nodes.for_each(|v| self.intersecting[*v as usize] = true);
        }
        let (hull, tangled) = (&self.hull, &mut self.intersecting);
        let more = self.buried.extraction_pairs((hull, u), &found, tangled);
        found.extend(more);
        found
    }

    /// Returns the edge–face intersections at `u`.
    pub fn crossings<T: Real>(&mut self, u: &[V4<T>]) -> Vec<Intersection> {
        let (hull, edges, tree) = (&self.hull, &self.edges, &mut self.faces_tree);
        let at = |v: u32| hull.position(v as usize, u);
        let (edge, face) = (|k: usize| edges[k].0, |k: usize| hull.faces[k].0);
        let found = edge_face_intersections((edges.len(), edge), face, tree, at).into_iter();
        let of = |found: crate::mesh::EdgeFaceIntersection| {
            let ([first, second], weight) = edges[found.edge];
            let ends = [first, second];
            let [a, b, c] = hull.faces[found.face].0;
            let [x, y, z] = [a, b, c].map(at);
            let [u, v, w] = found.weights;
            Intersection {
                nodes: [ends[found.inner_end], a, b, c],
                other: ends[1 - found.inner_end],
                face: found.face as u32,
                weights: [1.0, -u, -v, -w],
                normal: (y - x).cross(z - x).normalize_or_zero(),
                weight,
            }
        };
        found.map(of).collect()
    }

    /// Selects the pairs that may come closer than `gap` while nodes stay within `margin` of their
    /// motion by `moved` from `u`. Pairs without free nodes and pairs within one rigid body are
    /// excluded.
    pub fn build_candidates<T: Real>(
        &mut self,
        (u, free, plan): (&[V4<T>], &[T], &Partition),
        rigid: &RigidBodies,
        moved: &(dyn Fn(usize) -> DVec3 + Sync),
        (gap, margin): (f64, f64),
    ) -> Vec<CollisionCandidate> {
        self.margin = margin;
        let way = |v: u32| {
            let at = self.hull.rest[v as usize] + to_dvec(u[v as usize]);
            [at, at + moved(v as usize)]
        };
        self.trajectories = self.hull.nodes.iter().map(|(v, _)| way(*v)).collect();
        // Relative to the mean motion.
        let count = self.trajectories.len().max(1) as f64;
        let mean = self
            .trajectories
            .iter()
            .map(|[a, b]| *b - *a)
            .sum::<DVec3>()
            / count;
        let more = margin + 0.5 * gap;
        let boxed = |nodes: &[u32]| -> Bounds {
            let boxes = nodes.iter().map(|v| {
                let [a, b] = way(*v);
                [a.min(b - mean) - more, a.max(b - mean) + more]
            });
            boxes.reduce(bounds_union).unwrap_or_default()
        };
        let (faces, edges, nodes) = (&self.hull.faces, &self.edges, &self.hull.nodes);
        self.faces_tree.refit(|k| boxed(&faces[k].0));
        self.edges_tree.refit(|k| boxed(&edges[k].0));
        let made = |features: PrimitivePair, own: [u32; 4], weight: f64| {
            let ways = own.map(way);
            self.candidate((features, own, weight), ways, (free, plan), rigid, gap)
        };
        let (faces_tree, edges_tree) = (&self.faces_tree, &self.edges_tree);
        let mut pairs =
            parallel::collect(nodes.len(), |range, pairs: &mut Vec<CollisionCandidate>| {
                for (v, weight) in &nodes[range] {
                    faces_tree.for_each_overlapping(&boxed(&[*v]), |f| {
                        let [a, b, c] = faces[f as usize].0;
                        if ![a, b, c].contains(v) {
                            pairs.extend(made(PrimitivePair::VertexFace, [*v, a, b, c], *weight));
                        }
                    });
                }
            });
        pairs.extend(parallel::collect(edges.len(), |range, pairs| {
            for k in range {
                let ([a, b], weight) = edges[k];
                edges_tree.for_each_overlapping(&boxed(&[a, b]), |other| {
                    let ([c, d], _) = edges[other as usize];
                    if other as usize > k && ![c, d].contains(&a) && ![c, d].contains(&b) {
                        pairs.extend(made(PrimitivePair::EdgeEdge, [a, b, c, d], weight));
                    }
                });
            }
        }));
        pairs
    }

    /// Returns the candidate of a pair with these nodes, which moves along `ways`; `None` if it
    /// cannot come near, or is none.
    fn candidate<T: Real>(
        &self,
        (features, own, weight): (PrimitivePair, [u32; 4], f64),
        ways: [[DVec3; 2]; 4],
        (free, plan): (&[T], &Partition),
        rigid: &RigidBodies,
        gap: f64,
    ) -> Option<CollisionCandidate> {
        let start = features.closest_points(&ways.map(|[a, _]| a)).distance;
        let approach = features.max_approach(&ways.map(|[a, b]| b - a));
        if start - approach - 2.0 * self.margin >= gap {
            return None;
        }
        let held = own.iter().all(|v| free[*v as usize] == T::ZERO);
        let bodies = own.map(|v| rigid.body_of(v as usize));
        let one = bodies[0].is_some() && bodies.iter().all(|b| *b == bodies[0]);
        let ends = match features {
            PrimitivePair::VertexFace => own.split_at(1),
            PrimitivePair::EdgeEdge => own.split_at(2),
        };
        let through = |nodes: &[u32]| nodes.iter().any(|v| self.intersecting[*v as usize]);
        if held || one || (through(ends.0) && through(ends.1)) {
            return None;
        }
        let rest = own.map(|v| self.hull.rest[v as usize]);
        let mut own_gap = gap.min(REST_GAP_RATIO * features.closest_points(&rest).distance);
        if own_gap < COINCIDENT_GAP_RATIO * gap {
            let begun = own.map(|v| self.step_start[v as usize]);
            if features.closest_points(&begun).distance < COINCIDENT_GAP_RATIO * gap {
                return None;
            }
            own_gap = SEPARATED_GAP_RATIO * gap;
        }
        Some(CollisionCandidate {
            nodes: own,
            features,
            gap: own_gap,
            weight: AREA_FRACTION * weight,
            lengths: [rest[0].distance(rest[1]), rest[2].distance(rest[3])],
            chunks: own.map(|v| plan.chunk_of(v as usize) as u32),
        })
    }
}
