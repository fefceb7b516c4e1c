//! Edge collapses.

use super::editable_mesh::EditableMesh;
use super::quality::quality;
use crate::mesh::TET_EDGES;
use crate::mesher::stencil::Piece;
use std::collections::{BTreeMap, BTreeSet};

/// Boundary edges longer than this fraction of the lattice's edge are not collapsed, since the
/// boundary would move.
const MAX_ON_BOUNDARY: f64 = 0.6;

/// In links, the vertex at infinity that represents the outside.
const OUTSIDE: u32 = u32::MAX;

/// The simplices of a link: nodes, edges and faces, each with its nodes ascending.
type Link = BTreeSet<Vec<u32>>;

impl EditableMesh<'_> {
    /// Collapses the first edge of tet `t` whose collapse improves the minimum quality.
    pub(super) fn collapse_around(&mut self, t: u32) -> bool {
        let tet = self.corners(t);
        let edges = TET_EDGES.map(|[i, j]| [tet[i], tet[j]]);
        let mut both: Vec<[u32; 2]> = edges
            .iter()
            .flat_map(|[u, v]| [[*u, *v], [*v, *u]])
            .collect();
        let length = |e: &[u32; 2]| {
            let [u, v] = e.map(|v| self.nodes[v as usize]);
            u.distance_squared(v)
        };
        both.sort_by(|a, b| length(a).total_cmp(&length(b)));
        both.into_iter().any(|[u, v]| self.collapse(u, v))
    }

    /// Collapses node `u` onto `v`, if this is valid and an improvement.
    fn collapse(&mut self, u: u32, v: u32) -> bool {
        if self.is_fixed(u) || self.is_fixed(v) {
            return false;
        }
        let star = self.star(u).to_vec();
        let worst = self.min_quality(&star);
        let mut new: Vec<Piece> = Vec::with_capacity(star.len());
        for t in &star {
            let (mut tet, region) = self.pieces[*t as usize];
            if tet.contains(&v) {
                continue;
            }
            for corner in &mut tet {
                if *corner == u {
                    *corner = v;
                }
            }
            if quality(self.positions(tet)) <= worst {
                return false;
            }
            new.push((tet, region));
        }
        if new.is_empty() || !self.may_collapse(u, v) {
            return false;
        }
        self.replace(&star, &new);
        true
    }

    /// Whether collapsing an edge preserves the topology of the body and of all boundaries: the
    /// link condition of Dey et al., *Topology preserving edge contraction* (1999), in the body
    /// with the outside as an additional vertex, and in the boundaries.
    fn may_collapse(&self, u: u32, v: u32) -> bool {
        let around = self.edge_ring(u, v);
        let mut regions: Vec<u16> = around.iter().map(|t| self.pieces[*t as usize].1).collect();
        let (of_u, of_v) = (self.link(u), self.link(v));
        let shared: Link = of_u.intersection(&of_v).cloned().collect();
        if shared.contains(&vec![OUTSIDE]) && of_u.contains(&outside(&[v])) {
            regions.push(0);
        }
        regions.sort_unstable();
        regions.dedup();
        // A node stays on its boundaries and junctions.
        if regions != self.regions_at(u) {
            return false;
        }
        let [p, q] = [u, v].map(|v| self.nodes[v as usize]);
        if regions.len() > 1 && p.distance(q) > MAX_ON_BOUNDARY * self.edge {
            return false;
        }
        let of_edge: Link = of_u
            .iter()
            .filter(|part| part.contains(&v) && part.len() > 1)
            .map(|part| part.iter().copied().filter(|w| *w != v).collect())
            .collect();
        if shared != of_edge {
            return false;
        }
        // The link condition for interfaces between regions: three interface edges without a face
        // between them.
        let [beside_u, beside_v] = [u, v].map(|v| self.edges_in_boundaries(v));
        beside_u.intersection(&beside_v).all(|w| {
            let of_face = around.iter().filter(|t| self.corners(**t).contains(w));
            let regions: Vec<u16> = of_face.map(|t| self.pieces[*t as usize].1).collect();
            match regions[..] {
                [_] => true,
                [a, b] => a != b,
                _ => false,
            }
        })
    }

    /// Returns the link of node `v`, with the outside as an additional vertex.
    fn link(&self, v: u32) -> Link {
        let mut link = Link::new();
        let mut sides: BTreeMap<Vec<u32>, usize> = BTreeMap::new();
        for t in self.star(v) {
            let mut face: Vec<u32> = self.corners(*t).into_iter().filter(|w| *w != v).collect();
            face.sort_unstable();
            for i in 0..face.len() {
                let mut side = face.clone();
                side.remove(i);
                *sides.entry(side).or_default() += 1;
                link.insert(vec![face[i]]);
            }
            link.insert(face);
        }
        for (side, count) in sides {
            if count == 1 {
                link.insert(outside(&side));
                link.insert(vec![OUTSIDE]);
                side.iter().for_each(|w| {
                    link.insert(outside(&[*w]));
                });
            }
            link.insert(side);
        }
        link
    }

    /// Returns the nodes connected to `v` by edges that touch several regions, or the outside.
    fn edges_in_boundaries(&self, v: u32) -> BTreeSet<u32> {
        let mut seen: BTreeMap<u32, (u16, bool)> = BTreeMap::new();
        let mut sides: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for t in self.star(v) {
            let (tet, region) = self.pieces[*t as usize];
            let mut face: Vec<u32> = tet.into_iter().filter(|w| *w != v).collect();
            face.sort_unstable();
            for (i, w) in face.iter().enumerate() {
                let entry = seen.entry(*w).or_insert((region, false));
                entry.1 |= entry.0 != region;
                let (a, b) = (face[(i + 1) % 3], face[(i + 2) % 3]);
                *sides.entry([a.min(b), a.max(b)]).or_default() += 1;
            }
        }
        for w in sides.iter().filter(|s| *s.1 == 1).flat_map(|s| s.0) {
            if let Some(entry) = seen.get_mut(w) {
                entry.1 = true;
            }
        }
        seen.into_iter().filter(|s| s.1.1).map(|s| s.0).collect()
    }
}

/// Returns the part of a link between `part` and the outside.
fn outside(part: &[u32]) -> Vec<u32> {
    let mut part = part.to_vec();
    part.push(OUTSIDE);
    part
}
