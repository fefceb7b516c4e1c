//! The nodes in the middle of the edges of ten-node tets, by edge.

use super::quadratic::TenNodes;
use super::{TET_EDGES, TetMesh};
use crate::Result;
use glam::DVec3;

/// Largest distance of a node from the middle of its edge's chord, as a fraction of the chord's
/// length: beyond the arc of a half circle the node is not likely to belong to this edge.
const FAR: f64 = 0.5;

/// The node in the middle of each edge of the ten-node tets of a file, which may have other tets.
#[derive(Default)]
pub(crate) struct EdgeMiddles {
    /// Edges as (smaller, larger) node with their middle node, sorted; an edge may have several.
    all: Vec<([u32; 2], u32)>,
}

impl EdgeMiddles {
    /// Collects the middle nodes of `elements`.
    pub fn new(elements: impl IntoIterator<Item = TenNodes>) -> EdgeMiddles {
        let mut all = Vec::new();
        for nodes in elements {
            for ([a, b], middle) in TET_EDGES.into_iter().zip(&nodes[4..]) {
                if nodes[a] != nodes[b] {
                    all.push((sorted([nodes[a], nodes[b]]), *middle));
                }
            }
        }
        all.sort_unstable();
        all.dedup();
        EdgeMiddles { all }
    }

    /// Keeps one middle node per edge, and describes those that are left out or look wrong: `tets`
    /// are the four-node tets of the file, `nodes` its positions.
    fn checked(self, tets: &[[u32; 4]], nodes: &[DVec3], notes: &mut Vec<String>) -> Checked {
        // Nodes that cannot be the middle of an edge.
        let mut taken: Vec<bool> = nodes.iter().map(|p| !p.is_finite()).collect();
        for v in tets.iter().flatten() {
            taken[*v as usize] = true;
        }
        let mut edge_of = vec![None; nodes.len()];
        for (edge, middle) in &self.all {
            let v = *middle as usize;
            taken[v] |= edge_of[v]
                .replace(*edge)
                .is_some_and(|other| other != *edge);
        }
        let [mut several, mut shared, mut far] = [Finding::default(); 3];
        let mut kept: Vec<([u32; 2], u32)> = Vec::with_capacity(self.all.len());
        for (edge, middle) in self.all {
            if kept.last().is_some_and(|(known, _)| *known == edge) {
                several.add(edge, middle);
                continue;
            }
            let v = middle as usize;
            if taken[v] {
                shared.add(edge, middle);
                continue;
            }
            let [a, b] = edge.map(|v| nodes[v as usize]);
            if nodes[v].distance(a.midpoint(b)) > FAR * a.distance(b) {
                far.add(edge, middle);
            }
            kept.push((edge, middle));
        }
        several.describe(
            "edges of ten-node tets have several mid-edge nodes; the first of each is used; merge \
            these nodes in the file if the body should hold together there",
            notes,
        );
        shared.describe(
            "mid-edge nodes of ten-node tets are corners, belong to another edge or are not finite; \
            their edges are taken as straight; check the order of the nodes of the tets",
            notes,
        );
        far.describe(
            "mid-edge nodes of ten-node tets are further from the middle of their edge than half of \
            its length; check the order of the nodes of the tets",
            notes,
        );
        Checked { kept }
    }
}

/// One middle node per edge, sorted by edge.
struct Checked {
    kept: Vec<([u32; 2], u32)>,
}

/// Number of irregular edges, and the first of them with its node.
#[derive(Clone, Copy, Default)]
struct Finding {
    count: usize,
    first: Option<([u32; 2], u32)>,
}

impl Finding {
    fn add(&mut self, edge: [u32; 2], middle: u32) {
        self.count += 1;
        self.first.get_or_insert((edge, middle));
    }

    fn describe(&self, what: &str, notes: &mut Vec<String>) {
        if let Some(([a, b], middle)) = self.first {
            notes.push(format!(
                "{} {what} (the first: node {middle} on the edge from node {a} to {b}, counted from 0 in the file)",
                self.count
            ));
        }
    }
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

impl TetMesh {
    /// Returns this mesh of four-node tets as one of order 2 whose edges have the nodes of
    /// `middles`; those of other edges are added after all nodes.
    pub(super) fn with_edge_middles(self, middles: EdgeMiddles) -> Result<TetMesh> {
        let mut notes = Vec::new();
        let Checked { kept } = middles.checked(&self.tets, &self.nodes, &mut notes);
        let given = |edge: [u32; 2]| {
            let found = kept.binary_search_by_key(&edge, |(edge, _)| *edge);
            found.ok().map(|i| kept[i].1)
        };
        let mut mesh = self.with_middles(given)?;
        mesh.repairs.warnings.extend(notes);
        Ok(mesh)
    }
}
