//! The editable mesh of the optimiser.

use super::quality::quality;
use crate::mesher::domain::{OffsetDomain, Sampler};
use crate::mesher::fans::VertexFans;
use crate::mesher::stars::Stars;
use crate::mesher::stencil::Piece;
use glam::DVec3;
use rustc_hash::{FxHashMap, FxHashSet};

/// A mesh with the tets at each node, updated as it changes.
pub(super) struct EditableMesh<'a> {
    pub nodes: Vec<DVec3>,
    /// Removed tets have region 0.
    pub pieces: Vec<Piece>,
    pub sampler: Sampler<'a>,
    /// The edge of the lattice.
    pub edge: f64,
    stars: Stars,
    /// The tets at nodes whose tets have changed.
    changed: FxHashMap<u32, Vec<u32>>,
    fixed: FxHashSet<u32>,
}

impl<'a> EditableMesh<'a> {
    pub(super) fn new(
        domain: OffsetDomain<'a>,
        edge: f64,
        doubled: usize,
        nodes: Vec<DVec3>,
        pieces: Vec<Piece>,
    ) -> EditableMesh<'a> {
        let places: FxHashSet<[u64; 3]> = nodes[doubled..].iter().map(bits).collect();
        let fixed = match places.is_empty() {
            true => FxHashSet::default(),
            false => (0..nodes.len() as u32)
                .filter(|v| places.contains(&bits(&nodes[*v as usize])))
                .collect(),
        };
        EditableMesh {
            stars: Stars::new(nodes.len(), &pieces),
            nodes,
            pieces,
            sampler: Sampler::new(domain),
            edge,
            changed: FxHashMap::default(),
            fixed,
        }
    }

    /// Whether a node is fixed because another lies at its position.
    pub(super) fn is_fixed(&self, v: u32) -> bool {
        self.fixed.contains(&v)
    }

    /// Returns the tets at node `v`.
    pub(super) fn star(&self, v: u32) -> &[u32] {
        match self.changed.get(&v) {
            Some(star) => star,
            None => self.stars.of(v),
        }
    }

    pub(super) fn corners(&self, t: u32) -> [u32; 4] {
        self.pieces[t as usize].0
    }

    pub(super) fn positions(&self, tet: [u32; 4]) -> [DVec3; 4] {
        tet.map(|v| self.nodes[v as usize])
    }

    pub(super) fn tet_quality(&self, t: u32) -> f64 {
        quality(self.positions(self.corners(t)))
    }

    /// Returns the minimum quality of some tets.
    pub(super) fn min_quality(&self, tets: &[u32]) -> f64 {
        let shapes = tets.iter().map(|t| self.tet_quality(*t));
        shapes.fold(f64::INFINITY, f64::min)
    }

    /// Returns the tets at the edge between two nodes.
    pub(super) fn edge_ring(&self, a: u32, b: u32) -> Vec<u32> {
        let star = self.star(a).iter().copied();
        star.filter(|t| self.corners(*t).contains(&b)).collect()
    }

    /// Returns the regions at node `v`, ascending; 0 is included if it lies on the boundary.
    pub(super) fn regions_at(&self, v: u32) -> Vec<u16> {
        VertexFans::new(v, self.star(v), &self.pieces).regions()
    }

    /// Replaces the tets `old` by others with these corners and regions.
    pub(super) fn replace(&mut self, old: &[u32], new: &[Piece]) {
        for &t in old {
            for v in self.corners(t) {
                self.own_star(v).retain(|other| *other != t);
            }
            self.pieces[t as usize].1 = 0;
        }
        for piece in new {
            let t = self.pieces.len() as u32;
            self.pieces.push(*piece);
            for v in piece.0 {
                self.own_star(v).push(t);
            }
        }
    }

    fn own_star(&mut self, v: u32) -> &mut Vec<u32> {
        let stars = &self.stars;
        let entry = self.changed.entry(v);
        entry.or_insert_with(|| stars.of(v).to_vec())
    }
}

fn bits(p: &DVec3) -> [u64; 3] {
    p.to_array().map(f64::to_bits)
}
