//! Repairs of triangles that describe a surface twice, or that meet at T-junctions.

use glam::DVec3;
use std::collections::HashMap;

/// Largest distance of a vertex from the edge of another triangle at a T-junction that is closed,
/// relative to the largest coordinate: the rounding of single precision.
const CLOSED_GAP_TOLERANCE: f64 = 2.5e-7;
/// The same for T-junctions that are only reported, relative to the length of the edge.
const REPORTED_GAP_TOLERANCE: f64 = 1e-3;
/// Maximum number of comparisons of edges and vertices in the search of T-junctions.
const MAX_TESTS: usize = 20_000_000;

/// Triangles with the cells they come from.
pub(super) struct Triangles {
    pub corners: Vec<[u32; 3]>,
    pub cells: Vec<u32>,
}

/// Number of dropped triangles.
#[derive(Default)]
pub(super) struct Duplicates {
    /// Those with the corners and the orientation of an earlier one.
    pub same: usize,
    /// Those with the opposite orientation.
    pub opposite: usize,
}

/// Returns the corners of a triangle in a canonical order, and whether that reverses it.
fn key([a, b, c]: [u32; 3]) -> ([u32; 3], bool) {
    let mut sorted = [a, b, c];
    sorted.sort_unstable();
    let even = [[a, b, c], [b, c, a], [c, a, b]].contains(&sorted);
    (sorted, !even)
}

impl Triangles {
    /// Keeps the triangles that satisfy `is_kept`, by number.
    fn retain(&mut self, is_kept: impl Fn(usize) -> bool) {
        let kept: Vec<usize> = (0..self.corners.len()).filter(|t| is_kept(*t)).collect();
        self.corners = kept.iter().map(|t| self.corners[*t]).collect();
        self.cells = kept.iter().map(|t| self.cells[*t]).collect();
    }

    /// Drops triangles that repeat an earlier one, and, where every triangle of a part has its
    /// opposite (a two-sided sheet), the second of each pair. Pairs of opposite triangles inside a
    /// closed surface, the walls between two bodies, are kept.
    pub fn drop_duplicates(&mut self) -> Duplicates {
        // For each set of corners, the first triangle of either orientation.
        let mut first: HashMap<[u32; 3], [Option<u32>; 2]> = HashMap::new();
        let mut repeated = vec![false; self.corners.len()];
        for (t, triangle) in self.corners.iter().enumerate() {
            let (set, reversed) = key(*triangle);
            let side = &mut first.entry(set).or_default()[usize::from(reversed)];
            repeated[t] = side.is_some();
            side.get_or_insert(t as u32);
        }
        let mut dropped = Duplicates {
            same: repeated.iter().filter(|r| **r).count(),
            opposite: 0,
        };
        let pairs: Vec<[u32; 2]> = first
            .values()
            .filter_map(|sides| Some([sides[0]?, sides[1]?]))
            .collect();
        if !pairs.is_empty() {
            for pair in self.two_sided(&repeated, &pairs) {
                repeated[pair[0].max(pair[1]) as usize] = true;
                dropped.opposite += 1;
            }
        }
        if dropped.same + dropped.opposite > 0 {
            self.retain(|t| !repeated[t]);
        }
        dropped
    }

    /// Returns the pairs of opposite triangles that belong to two-sided parts: without them, what
    /// is left of the part is nothing, or has open edges.
    fn two_sided(&self, repeated: &[bool], pairs: &[[u32; 2]]) -> Vec<[u32; 2]> {
        let vertices = self.corners.iter().flatten().max().map_or(0, |v| v + 1);
        let mut parts = crate::mesh::DisjointSets::new(vertices as usize);
        for [a, b, c] in &self.corners {
            parts.union(*a, *b);
            parts.union(*b, *c);
        }
        let mut paired = repeated.to_vec();
        for t in pairs.iter().flatten() {
            paired[*t as usize] = true;
        }
        // How often each edge of the rest is traversed, one way minus the other.
        let mut traversed: HashMap<[u32; 2], i64> = HashMap::new();
        let mut has_rest: HashMap<u32, bool> = HashMap::new();
        let rest = self
            .corners
            .iter()
            .zip(&paired)
            .filter(|(_, paired)| !**paired);
        for (triangle, _) in rest {
            has_rest.entry(parts.find(triangle[0])).or_insert(false);
            for i in 0..3 {
                let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
                *traversed.entry([a.min(b), a.max(b)]).or_default() += 1;
            }
        }
        for (edge, times) in traversed {
            if times % 2 != 0 {
                has_rest.insert(parts.find(edge[0]), true);
            }
        }
        let mut found = pairs.to_vec();
        found.retain(|pair| {
            let part = parts.find(self.corners[pair[0] as usize][0]);
            // A closed rest is a body whose inner walls the pairs are.
            has_rest.get(&part) != Some(&false)
        });
        found
    }

    /// Returns the edges of one triangle only, as traversed by it, with that triangle.
    fn open_edges(&self) -> HashMap<[u32; 2], u32> {
        let mut sides: HashMap<[u32; 2], (u32, [u32; 2], u32)> = HashMap::new();
        for (t, triangle) in self.corners.iter().enumerate() {
            for i in 0..3 {
                let edge = [triangle[i], triangle[(i + 1) % 3]];
                let key = [edge[0].min(edge[1]), edge[0].max(edge[1])];
                let side = sides.entry(key).or_insert((t as u32, edge, 0));
                side.2 += 1;
            }
        }
        let open = sides.into_values().filter(|side| side.2 == 1);
        open.map(|(t, edge, _)| (edge, t)).collect()
    }

    /// Closes T-junctions, where vertices of other triangles divide an open edge exactly: its
    /// triangle is divided, too. Returns the number of closed edges, and of those whose vertices
    /// lie off the edge by more than rounding, which are left open.
    pub fn close_t_junctions(&mut self, places: &[DVec3], may_divide: bool) -> [usize; 2] {
        let mut closed = 0;
        // A triangle with several such edges is divided once per round.
        for round in 0.. {
            let open = self.open_edges();
            let found = self.t_junctions(&open, places);
            let near = found.iter().filter(|found| !found.is_exact).count();
            let exact = found.iter().filter(|found| found.is_exact && may_divide);
            let mut divided = HashMap::new();
            for junction in exact {
                divided.entry(junction.triangle).or_insert(junction);
            }
            if divided.is_empty() || round == 16 {
                return [closed, if may_divide { near } else { found.len() }];
            }
            closed += divided.len();
            let mut divided: Vec<_> = divided.into_iter().collect();
            divided.sort_unstable_by_key(|d| d.0);
            for (t, junction) in divided {
                self.divide(t as usize, junction);
            }
        }
        [closed, 0]
    }

    /// Divides triangle `t` at the vertices on one of its edges.
    fn divide(&mut self, t: usize, junction: &TJunction) {
        let [a, b] = junction.edge;
        let triangle = self.corners[t];
        let apex = triangle.into_iter().find(|v| *v != a && *v != b);
        let Some(apex) = apex else { return };
        let mut chain = vec![a];
        chain.extend(&junction.vertices);
        chain.push(b);
        for (n, pair) in chain.windows(2).enumerate() {
            let part = [pair[0], pair[1], apex];
            if n == 0 {
                self.corners[t] = part;
            } else {
                self.corners.push(part);
                self.cells.push(self.cells[t]);
            }
        }
    }

    /// Returns the open edges that chains of other open edges follow, in order of their triangles.
    fn t_junctions(&self, open: &HashMap<[u32; 2], u32>, places: &[DVec3]) -> Vec<TJunction> {
        let mut rim: Vec<u32> = open.keys().flatten().copied().collect();
        rim.sort_unstable();
        rim.dedup();
        let largest = rim
            .iter()
            .map(|v| places[*v as usize].abs().max_element())
            .fold(0.0, f64::max);
        let (low, high) = rim
            .iter()
            .map(|v| places[*v as usize])
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
                (low.min(p), high.max(p))
            });
        let extent = high - low;
        let axis = (0..3).fold(0, |best, a| if extent[a] > extent[best] { a } else { best });
        let along = |v: u32| places[v as usize][axis];
        rim.sort_by(|a, b| along(*a).total_cmp(&along(*b)).then(a.cmp(b)));
        let mut edges: Vec<(&[u32; 2], &u32)> = open.iter().collect();
        edges.sort_unstable();
        let mut tests = 0;
        let mut found = Vec::new();
        for (&[a, b], &triangle) in edges {
            let [p, q] = [a, b].map(|v| places[v as usize]);
            let length = p.distance(q);
            let reach = REPORTED_GAP_TOLERANCE * length;
            let start = rim.partition_point(|v| along(*v) < along(a).min(along(b)) - reach);
            let end = rim.partition_point(|v| along(*v) <= along(a).max(along(b)) + reach);
            tests += end - start;
            if tests > MAX_TESTS {
                break;
            }
            let mut beside: Vec<(f64, u32, f64)> = Vec::new();
            let own = self.corners[triangle as usize];
            for &v in rim[start..end].iter().filter(|v| !own.contains(v)) {
                let to = places[v as usize] - p;
                let part = to.dot(q - p) / (length * length);
                let distance = to.distance(part * (q - p));
                if part > 0.0 && part < 1.0 && distance <= reach.max(CLOSED_GAP_TOLERANCE * largest)
                {
                    beside.push((part, v, distance));
                }
            }
            if beside.is_empty() {
                continue;
            }
            beside.sort_by(|x, y| x.0.total_cmp(&y.0));
            // The other side of the edge: b to a over open edges, through these vertices.
            let mut chain = vec![a];
            chain.extend(beside.iter().map(|v| v.1));
            chain.push(b);
            let follows = |pair: &[u32]| {
                open.contains_key(&[pair[1], pair[0]]) || open.contains_key(&[pair[0], pair[1]])
            };
            if chain.windows(2).all(follows) {
                let farthest = beside.iter().map(|v| v.2).fold(0.0, f64::max);
                found.push(TJunction {
                    triangle,
                    edge: [a, b],
                    vertices: beside.iter().map(|v| v.1).collect(),
                    is_exact: farthest <= CLOSED_GAP_TOLERANCE * largest,
                });
            }
        }
        found.sort_by_key(|j| j.triangle);
        found
    }
}

/// An open edge that vertices of other open edges divide.
struct TJunction {
    triangle: u32,
    edge: [u32; 2],
    /// The vertices between its ends, in order.
    vertices: Vec<u32>,
    is_exact: bool,
}
