//! Local refinement: tets are divided in the middle of marked edges, the longest first.
//!
//! Each face is divided by its own marked edges only, and so equally in both of its tets: any set of
//! marked edges has a conforming division. For the shape of the tets, the longest edge of a face with
//! a marked edge is marked, too (Plaza & Carey 2000, "Local refinement of simplicial grids based on
//! the skeleton").

use super::{FACES, TET_EDGES};
use crate::parallel;
use glam::DVec3;

/// The edges of tets that are divided, and how they compare in length.
pub(super) struct MarkedEdges {
    /// All edges as (smaller, larger) node, sorted.
    edges: Vec<[u32; 2]>,
    /// Place of each edge in the order of lengths.
    rank: Vec<u32>,
    is_marked: Vec<bool>,
}

impl MarkedEdges {
    /// Marks all edges of the `chosen` tets, and those that the shape of their neighbours requires.
    /// `edges` are those of the tets, sorted.
    pub fn new(
        tets: &[[u32; 4]],
        edges: Vec<[u32; 2]>,
        nodes: &[DVec3],
        chosen: &[bool],
    ) -> MarkedEdges {
        let length = |k: u32| {
            let [a, b] = edges[k as usize].map(|v| nodes[v as usize]);
            a.distance_squared(b)
        };
        let mut by_length: Vec<u32> = (0..edges.len() as u32).collect();
        // Edges of equal length in the order of their nodes.
        by_length.sort_by(|a, b| length(*a).total_cmp(&length(*b)));
        let mut rank = vec![0; edges.len()];
        for (place, k) in (0u32..).zip(by_length) {
            rank[k as usize] = place;
        }
        let mut marked = MarkedEdges {
            is_marked: vec![false; edges.len()],
            edges,
            rank,
        };
        let of_tets = parallel::map(tets.len(), |t| {
            TET_EDGES.map(|[a, b]| marked.number([tets[t][a], tets[t][b]]).unwrap_or_default())
        });
        for (own, _) in of_tets.iter().zip(chosen).filter(|(_, chosen)| **chosen) {
            own.iter().for_each(|k| marked.is_marked[*k] = true);
        }
        marked.close(&of_tets);
        marked
    }

    /// Marks the longest edge of each face with a marked edge, until all are.
    fn close(&mut self, of_tets: &[[usize; 6]]) {
        let faces = FACES.map(|corners| {
            let inside = |e: &usize| TET_EDGES[*e].iter().all(|v| corners.contains(v));
            let mut own = (0..TET_EDGES.len()).filter(inside);
            [(); 3].map(|()| own.next().unwrap_or_default())
        });
        let mut changed = true;
        while changed {
            changed = false;
            for own in of_tets {
                for face in faces {
                    let face = face.map(|e| own[e]);
                    let longest = face.into_iter().max_by_key(|k| self.rank[*k]);
                    let longest = longest.unwrap_or_default();
                    if !self.is_marked[longest] && face.iter().any(|k| self.is_marked[*k]) {
                        self.is_marked[longest] = true;
                        changed = true;
                    }
                }
            }
        }
    }

    /// Returns the marked edges, sorted.
    pub fn marked(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let all = self.edges.iter().zip(&self.is_marked);
        all.filter(|(_, is_marked)| **is_marked).map(|(e, _)| *e)
    }

    fn number(&self, [a, b]: [u32; 2]) -> Option<usize> {
        self.edges.binary_search(&[a.min(b), a.max(b)]).ok()
    }

    /// Returns the tets that `tet` is divided into, with the node in the middle of each marked edge
    /// given by `middle`.
    pub fn divide(&self, tet: [u32; 4], middle: &impl Fn([u32; 2]) -> u32) -> Vec<[u32; 4]> {
        let (mut left, mut done) = (vec![tet], Vec::new());
        while let Some(tet) = left.pop() {
            let marked = TET_EDGES.iter().filter_map(|[a, b]| {
                let k = self.number([tet[*a], tet[*b]])?;
                self.is_marked[k].then_some((self.rank[k], [*a, *b], self.edges[k]))
            });
            let Some((_, ends, edge)) = marked.max_by_key(|(rank, ..)| *rank) else {
                done.push(tet);
                continue;
            };
            // A middle in the place of an end keeps the orientation.
            for end in ends {
                let mut half = tet;
                half[end] = middle(edge);
                left.push(half);
            }
        }
        done
    }
}
