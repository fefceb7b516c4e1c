//! Components of a body that are initially inside others without any edge–face intersection. Each
//! is pulled out by its node nearest to an exit until edges intersect faces; from then on these
//! intersections are separated.

use super::boundary_surface::BoundarySurface;
use super::candidates::Intersection;
use crate::mesher::solid_angle;
use crate::physics::DiscreteModel;
use crate::physics::contact::PrimitivePair;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use glam::DVec3;
use std::collections::BTreeMap;

/// Connected components of the tets, and which of them are inside others.
#[derive(Clone, Debug, Default)]
pub(in crate::physics::cpu) struct EnclosedComponents {
    /// Component of every node, in the engine's order.
    node_component: Vec<u32>,
    /// Pairs of a component and one that contained it at the last check.
    enclosures: Vec<[u32; 2]>,
}

impl EnclosedComponents {
    /// Finds the components of `network`, whose nodes have the engine indices `place`, that are
    /// inside others at `u`.
    pub fn new<T: Real>(
        hull: &BoundarySurface,
        (network, place): (&DiscreteModel, &[u32]),
        u: &[V4<T>],
    ) -> EnclosedComponents {
        let mut leads: Vec<u32> = (0..hull.rest.len() as u32).collect();
        let mut join = |nodes: &[u32]| {
            for pair in nodes.windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|v| root(&mut leads, place[v as usize]));
                leads[a.max(b) as usize] = a.min(b);
            }
        };
        if let Some(elements) = network.elements() {
            for t in 0..elements.tets.len() {
                join(&elements.nodes_of(t).collect::<Vec<_>>());
            }
        }
        network
            .rigid_bodies()
            .iter()
            .for_each(|body| join(&body.nodes));
        let part = (0..leads.len() as u32).map(|v| root(&mut leads, v));
        let mut buried = EnclosedComponents {
            node_component: part.collect(),
            enclosures: Vec::new(),
        };
        let mut some: BTreeMap<u32, DVec3> = BTreeMap::new();
        let mut bounds: BTreeMap<u32, [DVec3; 2]> = BTreeMap::new();
        for (v, _) in &hull.nodes {
            let x = hull.position(*v as usize, u);
            let own = buried.node_component[*v as usize];
            some.entry(own).or_insert(x);
            let [low, high] = bounds.entry(own).or_insert([x; 2]);
            (*low, *high) = (low.min(x), high.max(x));
        }
        for (a, x) in &some {
            for (b, [low, high]) in &bounds {
                let near = a != b && low.cmple(*x).all() && x.cmple(*high).all();
                if near && buried.contains(hull, *b, *x, u) {
                    buried.enclosures.push([*a, *b]);
                }
            }
        }
        buried
    }

    /// Returns the faces of `hull` that belong to enclosed components.
    pub fn enclosed_faces(&self, hull: &BoundarySurface) -> impl Iterator<Item = u32> {
        let of = move |face: &[u32; 3]| self.node_component[face[0] as usize];
        let buried = move |k: &usize| {
            let own = of(&hull.faces[*k].0);
            self.enclosures.iter().any(|[a, _]| *a == own)
        };
        (0..hull.faces.len()).filter(buried).map(|k| k as u32)
    }

    /// Returns whether a point is inside a component.
    fn contains<T: Real>(&self, hull: &BoundarySurface, part: u32, x: DVec3, u: &[V4<T>]) -> bool {
        let own = hull.faces.iter().map(|(face, _)| *face);
        let own = own.filter(|face| self.node_component[face[0] as usize] == part);
        let turns = own.map(|face| solid_angle(face.map(|v| hull.position(v as usize, u) - x)));
        turns.sum::<f64>() > std::f64::consts::TAU
    }

    /// Returns the pairs that pull out enclosed components at `u`, where `through` are the present
    /// intersections; marks the nodes of both components.
    pub fn extraction_pairs<T: Real>(
        &mut self,
        (hull, u): (&BoundarySurface, &[V4<T>]),
        through: &[Intersection],
        tangled: &mut [bool],
    ) -> Vec<Intersection> {
        let mut found = Vec::new();
        let within = std::mem::take(&mut self.enclosures);
        for [a, b] in within {
            let of = |v: u32| self.node_component[v as usize];
            let out = through.iter().any(|c| {
                let mut parts = [of(c.nodes[0]), of(c.nodes[1])];
                parts.sort_unstable();
                parts == [a.min(b), a.max(b)]
            });
            let mut own = hull.nodes.iter().filter(|(v, _)| of(*v) == a);
            let Some((first, _)) = own.clone().next() else {
                continue;
            };
            if !out && !self.contains(hull, b, hull.position(*first as usize, u), u) {
                continue;
            }
            self.enclosures.push([a, b]);
            if out {
                continue;
            }
            let mut nearest: Option<(f64, Intersection)> = None;
            for (v, weight) in own.by_ref() {
                let x = hull.position(*v as usize, u);
                for (face, (corners, _)) in hull.faces.iter().enumerate() {
                    if self.node_component[corners[0] as usize] != b {
                        continue;
                    }
                    let [p, q, r] = corners.map(|v| hull.position(v as usize, u));
                    let near = PrimitivePair::VertexFace.closest_points(&[x, p, q, r]);
                    if nearest.is_none_or(|(distance, _)| near.distance < distance) {
                        let [i, j, k] = *corners;
                        let crossing = Intersection {
                            nodes: [*v, i, j, k],
                            other: *v,
                            face: face as u32,
                            weights: near.weights,
                            normal: (q - p).cross(r - p).normalize_or_zero(),
                            weight: *weight,
                        };
                        nearest = Some((near.distance, crossing));
                    }
                }
            }
            found.extend(nearest.map(|(_, crossing)| crossing));
            for (v, tangled) in tangled.iter_mut().enumerate() {
                *tangled |= [a, b].contains(&self.node_component[v]);
            }
        }
        found
    }
}

fn root(leads: &mut [u32], v: u32) -> u32 {
    let mut v = v;
    while leads[v as usize] != v {
        leads[v as usize] = leads[leads[v as usize] as usize];
        v = leads[v as usize];
    }
    v
}
