//! A mesh that is worked on.

use super::quality::quality;
use crate::mesher::domain::{OffsetDomain, Sampler};
use crate::mesher::fans::VertexFans;
use crate::mesher::id_hash::{KeyMap, KeySet};
use crate::mesher::stars::Stars;
use crate::mesher::stencil::Piece;
use glam::DVec3;

/// A mesh with the tets at each node, kept up as it changes.
pub(super) struct EditableMesh<'a> {
    pub nodes: Vec<DVec3>,
    /// Tets that were removed have the region 0.
    pub pieces: Vec<Piece>,
    pub sampler: Sampler<'a>,
    /// The lattice's edge.
    pub edge: f64,
    stars: Stars,
    /// The tets at nodes where they have changed.
    changed: KeyMap<u32, Vec<u32>>,
    fixed: KeySet<u32>,
}

impl<'a> EditableMesh<'a> {
    pub(super) fn new(
        domain: OffsetDomain<'a>,
        edge: f64,
        doubled: usize,
        nodes: Vec<DVec3>,
        pieces: Vec<Piece>,
    ) -> EditableMesh<'a> {
        let places: KeySet<[u64; 3]> = nodes[doubled..].iter().map(bits).collect();
        let fixed = match places.is_empty() {
            true => KeySet::default(),
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
            changed: KeyMap::default(),
            fixed,
        }
    }

    /// Whether a node must stay, because another lies at its place.
    pub(super) fn is_fixed(&self, v: u32) -> bool {
        self.fixed.contains(&v)
    }

    /// The tets at node `v`.
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

    /// The worst shape of some tets.
    pub(super) fn min_quality(&self, tets: &[u32]) -> f64 {
        let shapes = tets.iter().map(|t| self.tet_quality(*t));
        shapes.fold(f64::INFINITY, f64::min)
    }

    /// The tets at the edge between two nodes.
    pub(super) fn edge_ring(&self, a: u32, b: u32) -> Vec<u32> {
        let star = self.star(a).iter().copied();
        star.filter(|t| self.corners(*t).contains(&b)).collect()
    }

    /// The regions at node `v`, rising; 0 is there where it lies on the boundary.
    pub(super) fn regions_at(&self, v: u32) -> Vec<u16> {
        VertexFans::new(v, self.star(v), &self.pieces).regions()
    }

    /// Takes the tets `old` out and puts others, of these corners and regions, in.
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
