//! Connectivity of the tets around a node: if they form several fans, a boundary is non-manifold
//! there.

use super::stencil::Piece;

/// The tets around a node, and which of them share a face at it.
pub(super) struct VertexFans {
    /// Region of each tet; the last entry represents the outside beyond the tets.
    pub region: Vec<u16>,
    /// Pairs that share a face.
    joined: Vec<[u32; 2]>,
    /// Edges of the node's link that belong to one tet only.
    rim: Vec<[u32; 2]>,
    /// Union-find parents of the tets.
    parent: Vec<u32>,
}

impl VertexFans {
    pub(super) fn new(v: u32, star: &[u32], pieces: &[Piece]) -> VertexFans {
        // The edges of the node's link, each with its tet.
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * star.len());
        for (n, t) in star.iter().enumerate() {
            let tet = pieces[*t as usize].0;
            let mut link = tet.into_iter().filter(|u| *u != v);
            if let (Some(a), Some(b), Some(c)) = (link.next(), link.next(), link.next()) {
                for [p, q] in [[a, b], [b, c], [c, a]] {
                    sides.push(([p.min(q), p.max(q)], n as u32));
                }
            }
        }
        sides.sort_unstable();
        let mut region: Vec<u16> = star.iter().map(|t| pieces[*t as usize].1).collect();
        region.push(0);
        let beyond = star.len() as u32;
        let mut joined = Vec::with_capacity(sides.len() / 2 + 1);
        let mut rim = Vec::new();
        for same in sides.chunk_by(|a, b| a.0 == b.0) {
            if let [a, b] = same {
                joined.push([a.1, b.1]);
            } else {
                rim.push(same[0].0);
                joined.extend(same.iter().map(|s| [s.1, beyond]));
            }
        }
        if rim.is_empty() {
            region.pop();
        }
        VertexFans {
            parent: Vec::with_capacity(region.len()),
            region,
            joined,
            rim,
        }
    }

    /// Whether the faces at the node without a second tet form one fan, or there are none.
    pub(super) fn is_boundary_manifold(&self) -> bool {
        let Some(&[start, _]) = self.rim.first() else {
            return true;
        };
        let (mut at, mut last, mut steps) = (start, u32::MAX, 0);
        loop {
            let mut next = self.rim.iter().enumerate().filter(|(_, e)| e.contains(&at));
            let (Some((i, e)), Some((j, f)), None) = (next.next(), next.next(), next.next()) else {
                return false;
            };
            let (edge, ends) = if i as u32 == last { (j, f) } else { (i, e) };
            at = if ends[0] == at { ends[1] } else { ends[0] };
            (last, steps) = (edge as u32, steps + 1);
            if at == start {
                return steps == self.rim.len();
            }
        }
    }

    /// Returns the fan of each tet whose region `wanted` accepts, identified by its smallest tet,
    /// `u32::MAX` for the others, and the number of fans.
    pub(super) fn split(&mut self, wanted: impl Fn(u16) -> bool) -> (Vec<u32>, usize) {
        let parent = &mut self.parent;
        parent.clear();
        parent.extend(0..self.region.len() as u32);
        fn root(parent: &mut [u32], mut i: u32) -> u32 {
            while parent[i as usize] != i {
                parent[i as usize] = parent[parent[i as usize] as usize];
                i = parent[i as usize];
            }
            i
        }
        for [a, b] in &self.joined {
            if wanted(self.region[*a as usize]) && wanted(self.region[*b as usize]) {
                let (a, b) = (root(parent, *a), root(parent, *b));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
        let mut fans = 0;
        let fan = (0..self.region.len() as u32)
            .map(|i| match wanted(self.region[i as usize]) {
                true => {
                    fans += usize::from(parent[i as usize] == i);
                    root(parent, i)
                }
                false => u32::MAX,
            })
            .collect();
        (fan, fans)
    }

    /// Returns the regions at the node, ascending.
    pub(super) fn regions(&self) -> Vec<u16> {
        let mut regions = self.region.clone();
        regions.sort_unstable();
        regions.dedup();
        regions
    }

    /// Counts the excess fans around the node: of the inside and the outside, and of each region
    /// and its complement. The node is manifold if both counts are 0.
    pub(super) fn count_excess_fans(&mut self) -> [usize; 2] {
        let regions = self.regions();
        if regions.len() < 2 {
            return [0; 2];
        }
        let outer = match regions[0] == 0 {
            true => self.surplus(0),
            false => 0,
        };
        if regions.len() == 2 {
            return [
                outer,
                if regions[0] == 0 {
                    0
                } else {
                    self.surplus(regions[0])
                },
            ];
        }
        let inner = regions.iter().filter(|r| **r != 0);
        let inner: Vec<u16> = inner.copied().collect();
        [outer, inner.into_iter().map(|r| self.surplus(r)).sum()]
    }

    fn surplus(&mut self, region: u16) -> usize {
        let of = self.split(|r| r == region).1;
        let not = self.split(|r| r != region).1;
        of.saturating_sub(1) + not.saturating_sub(1)
    }

    /// Returns the region that shares the most faces with the tets of a fan.
    pub(super) fn dominant_neighbour(&self, fan: &[bool]) -> Option<u16> {
        let mut shared: Vec<(u16, usize)> = Vec::new();
        for [a, b] in &self.joined {
            let (a, b) = (*a as usize, *b as usize);
            if fan[a] != fan[b] {
                let region = self.region[if fan[a] { b } else { a }];
                match shared.iter_mut().find(|s| s.0 == region) {
                    Some(s) => s.1 += 1,
                    None => shared.push((region, 1)),
                }
            }
        }
        // Among equals, inside takes precedence over outside.
        let best = shared.into_iter().max_by_key(|s| (s.1, s.0));
        best.map(|s| s.0)
    }
}
