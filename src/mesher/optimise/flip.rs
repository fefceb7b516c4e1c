//! Topological flips of edges and faces within one region.

use super::editable_mesh::EditableMesh;
use super::quality::quality;
use crate::mesh::{FACES, TET_EDGES};
use crate::mesher::stencil::Piece;

/// Maximum number of tets around an edge to be removed.
const MAX_RING: usize = 7;

impl EditableMesh<'_> {
    /// Flips the first edge or face of tet `t` whose flip improves the minimum quality.
    pub(super) fn flip_around(&mut self, t: u32) -> bool {
        let tet = self.corners(t);
        TET_EDGES
            .iter()
            .any(|[i, j]| self.remove_edge(tet[*i], tet[*j]))
            || (0..4).any(|f| self.remove_face(t, f))
    }

    /// Replaces the tets around an edge by those over the best triangulation of their ring.
    fn remove_edge(&mut self, a: u32, b: u32) -> bool {
        let around = self.edge_ring(a, b);
        if around.len() < 3 || around.len() > MAX_RING {
            return false;
        }
        let region = self.pieces[around[0] as usize].1;
        if around.iter().any(|t| self.pieces[*t as usize].1 != region) {
            return false;
        }
        let Some(ring) = self.ring(a, b, &around) else {
            return false;
        };
        let worst = self.min_quality(&around);
        let n = ring.len();
        let cap = |i: usize, j: usize, k: usize| {
            [
                [ring[i], ring[j], ring[k], b],
                [ring[k], ring[j], ring[i], a],
            ]
        };
        // best[i][j]: the minimum quality of the best triangulation of ring[i..=j], and its apex
        // over the side i–j (Klincsek 1980).
        let mut best = [[(f64::INFINITY, 0usize); MAX_RING]; MAX_RING];
        for length in 2..n {
            for i in 0..n - length {
                let j = i + length;
                best[i][j] = (f64::NEG_INFINITY, 0);
                for k in i + 1..j {
                    let own = cap(i, k, j).map(|tet| quality(self.positions(tet)));
                    let all = own[0].min(own[1]).min(best[i][k].0).min(best[k][j].0);
                    if all > best[i][j].0 {
                        best[i][j] = (all, k);
                    }
                }
            }
        }
        if best[0][n - 1].0 <= worst {
            return false;
        }
        let mut new: Vec<Piece> = Vec::new();
        let mut open = vec![(0, n - 1)];
        while let Some((i, j)) = open.pop() {
            if j > i + 1 {
                let k = best[i][j].1;
                new.extend(cap(i, k, j).map(|tet| (tet, region)));
                open.extend([(i, k), (k, j)]);
            }
        }
        self.replace(&around, &new);
        true
    }

    /// Returns the nodes around the edge from `a` to `b` in right-handed order; `None` if the tets
    /// do not form a closed ring.
    fn ring(&self, a: u32, b: u32, around: &[u32]) -> Option<Vec<u32>> {
        let mut steps: Vec<[u32; 2]> = Vec::with_capacity(around.len());
        for t in around {
            let tet = self.corners(*t);
            let rest: Vec<u32> = tet.into_iter().filter(|v| *v != a && *v != b).collect();
            let [p, q] = rest[..] else { return None };
            let [x, y, u, v] = self.positions([a, b, p, q]);
            let forward = (y - x).cross(u - x).dot(v - x) > 0.0;
            steps.push(if forward { [p, q] } else { [q, p] });
        }
        let mut ring = vec![steps[0][0]];
        while ring.len() < steps.len() {
            let last = *ring.last()?;
            let next = steps.iter().find(|s| s[0] == last)?[1];
            ring.push(next);
        }
        let last = *ring.last()?;
        let closed = steps.iter().any(|s| *s == [last, ring[0]]);
        closed.then_some(ring)
    }

    /// Replaces two tets of one region that share face `f` of tet `t` by three around the edge
    /// between their opposite corners.
    fn remove_face(&mut self, t: u32, f: usize) -> bool {
        let tet = self.corners(t);
        let face = FACES[f].map(|i| tet[i]);
        let region = self.pieces[t as usize].1;
        let beside = self
            .star(face[0])
            .iter()
            .copied()
            .find(|other| *other != t && face.iter().all(|v| self.corners(*other).contains(v)));
        let Some(other) = beside.filter(|o| self.pieces[*o as usize].1 == region) else {
            return false;
        };
        let apex = tet[f];
        let far = self.corners(other).into_iter().find(|v| !face.contains(v));
        let Some(far) = far else { return false };
        let [p, q, r] = face;
        // The face is counter-clockwise seen from the far side.
        let new = [[p, q], [q, r], [r, p]].map(|[u, v]| [apex, u, v, far]);
        let shapes = new.map(|tet| quality(self.positions(tet)));
        let least = shapes.into_iter().fold(f64::INFINITY, f64::min);
        if least <= self.min_quality(&[t, other]) {
            return false;
        }
        self.replace(&[t, other], &new.map(|tet| (tet, region)));
        true
    }
}
