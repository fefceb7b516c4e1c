//! Rows of directed edges in sliced ELLPACK format for the GPU.
//!
//! Slices have 32 rows; within a slice, the q-th groups of four neighbours of all rows are
//! contiguous, so neighbouring invocations load neighbouring texels, and a node with many edges
//! lengthens its own slice only. Rows are sorted by length within a window of the file's order, so
//! that invocations running side by side finish together. The incident tet corners of nodes have
//! the same layout. The CPU side of `shaders/lib/sliced_ellpack.wgsl`.

use crate::physics::model::discrete_model::DiscreteModel;
use crate::physics::model::discretisation::Edge;
use crate::physics::model::units::LocalUnits;
use crate::{Error, Result};
use glam::Vec3;

/// Rows per slice.
const SLICE_HEIGHT: usize = 32;

/// Number of rows in a sorting window.
const SORT_WINDOW: usize = 512;

/// The rows in the uploaded layout.
#[derive(Debug)]
pub(in crate::physics) struct SlicedEllpack {
    /// For each row: its node, the first texel of its slice in `columns`, its number of texels, and
    /// its capacity.
    pub rows: Vec<[u32; 4]>,
    /// Four neighbours per texel, padded with the node itself.
    pub columns: Vec<[u32; 4]>,
    /// κ and L of each directed edge, in local units; zero in the padding.
    pub stiffnesses: Vec<[f32; 2]>,
    /// The row of each node.
    row_of: Vec<u32>,
    /// Padding value, if not the node itself.
    filler: Option<u32>,
}

/// An edge at its node: the other node, κ and L in local units.
pub(in crate::physics) type DirectedEdge = (u32, f32, f32);

/// Indices changed by [`SlicedEllpack::replace`] in the three lists.
#[derive(Debug, Default, PartialEq)]
pub(in crate::physics) struct Replaced {
    pub rows: Vec<u32>,
    pub columns: Vec<u32>,
    pub stiffnesses: Vec<u32>,
}

impl SlicedEllpack {
    /// The rows of `model`, whose nodes rest at the local positions `rest`.
    ///
    /// Rest lengths are computed from the rounded positions, so that a body at rest has no forces.
    pub fn new(model: &DiscreteModel, rest: &[Vec3], units: &LocalUnits) -> Result<SlicedEllpack> {
        let mut neighbours: Vec<Vec<DirectedEdge>> = vec![Vec::new(); rest.len()];
        for edge in &model.edges {
            for (node, directed) in directed_pair(edge, |v| rest[v as usize], units) {
                neighbours[node as usize].push(directed);
            }
        }
        for row in &mut neighbours {
            row.sort_unstable_by_key(|n| n.0);
        }
        SlicedEllpack::build(&neighbours, None)
    }

    /// Rows with these numbers for each node, padded with `filler` or the node itself.
    pub fn from_lists(lists: &[Vec<u32>], filler: Option<u32>) -> Result<SlicedEllpack> {
        let entries = |list: &Vec<u32>| list.iter().map(|n| (*n, 0.0, 0.0)).collect();
        let lists: Vec<Vec<DirectedEdge>> = lists.iter().map(entries).collect();
        SlicedEllpack::build(&lists, filler)
    }

    /// Rows with these lists for each node, padded with `filler` or the node itself.
    fn build(neighbours: &[Vec<DirectedEdge>], filler: Option<u32>) -> Result<SlicedEllpack> {
        let nodes = neighbours.len();
        let mut built = SlicedEllpack {
            filler,
            rows: Vec::with_capacity(nodes),
            columns: Vec::new(),
            stiffnesses: Vec::new(),
            row_of: vec![0; nodes],
        };
        let mut order: Vec<u32> = (0..nodes as u32).collect();
        for window in order.chunks_mut(SORT_WINDOW) {
            window.sort_by_key(|i| std::cmp::Reverse(neighbours[*i as usize].len()));
        }
        for slice in order.chunks(SLICE_HEIGHT) {
            let texels = |node: &u32| neighbours[*node as usize].len().div_ceil(4);
            let width = slice.iter().map(texels).max().unwrap_or(0);
            let base = built.new_slice(width)?;
            for node in slice {
                built.row_of[*node as usize] = built.rows.len() as u32;
                built.rows.push([*node, base, 0, width as u32]);
                built.fill(*node, &neighbours[*node as usize]);
            }
        }
        Ok(built)
    }

    /// Allocates a slice for [`SLICE_HEIGHT`] rows of `width` texels. Returns its first texel.
    fn new_slice(&mut self, width: usize) -> Result<u32> {
        let base = self.columns.len();
        let end = base + width * SLICE_HEIGHT;
        if 4 * end > u32::MAX as usize {
            return Err(Error::Mesh(
                "the mesh has more edges than 32-bit indices allow; use a coarser mesh".into(),
            ));
        }
        self.columns.resize(end, [0; 4]);
        self.stiffnesses.resize(4 * end, [0.0; 2]);
        Ok(base as u32)
    }

    /// Writes the row of `node`, for which there is capacity, and pads it.
    fn fill(&mut self, node: u32, row: &[DirectedEdge]) {
        let t = self.row_of[node as usize] as usize;
        let [_, base, _, room] = self.rows[t];
        self.rows[t][2] = row.len().div_ceil(4) as u32;
        let filler = self.filler.unwrap_or(node);
        for e in 0..4 * room as usize {
            let (other, stiffness, length) = row.get(e).copied().unwrap_or((filler, 0.0, 0.0));
            let (column, place) = entry_position(base, t, e);
            self.columns[column][e % 4] = other;
            self.stiffnesses[place] = [stiffness, length];
        }
    }

    /// The row of each node.
    pub fn row_of(&self) -> &[u32] {
        &self.row_of
    }

    /// The edges of `node`.
    pub fn row(&self, node: u32) -> impl Iterator<Item = DirectedEdge> + '_ {
        let t = self.row_of[node as usize] as usize;
        let [_, base, texels, _] = self.rows[t];
        (0..4 * texels as usize)
            .map(move |e| {
                let (column, place) = entry_position(base, t, e);
                let [stiffness, length] = self.stiffnesses[place];
                (self.columns[column][e % 4], stiffness, length)
            })
            .filter(move |directed| directed.0 != node)
    }

    /// The index in `stiffnesses` of the edge from `node` to `other`.
    pub fn entry(&self, node: u32, other: u32) -> Option<u32> {
        let t = *self.row_of.get(node as usize)? as usize;
        let [_, base, texels, _] = self.rows[t];
        let mut places = (0..4 * texels as usize).map(|e| (e, entry_position(base, t, e)));
        let found = places.find(|(e, (column, _))| self.columns[*column][e % 4] == other)?;
        Some(found.1.1 as u32)
    }

    /// Replaces the edges of nodes; nodes beyond the present count are added. A row that exceeds
    /// its slice moves to a new slice at the end of the lists, shared with other moved rows.
    pub fn replace(&mut self, mut given: Vec<(u32, Vec<DirectedEdge>)>) -> Result<Replaced> {
        let count = given.iter().map(|(node, _)| *node + 1).max().unwrap_or(0);
        for node in self.row_of.len() as u32..count {
            self.row_of.push(self.rows.len() as u32);
            self.rows.push([node, 0, 0, 0]);
        }
        // The longest first, so that every row fits the slice it joins.
        given.sort_by_key(|(node, row)| (std::cmp::Reverse(row.len()), *node));
        let mut slices: Vec<([bool; SLICE_HEIGHT], u32, u32)> = Vec::new();
        let mut replaced = Replaced::default();
        for (node, row) in &mut given {
            row.sort_unstable_by_key(|directed| directed.0);
            let t = self.row_of[*node as usize];
            let width = row.len().div_ceil(4);
            if width > self.rows[t as usize][3] as usize {
                let lane = t as usize % SLICE_HEIGHT;
                let free = slices.iter().position(|(taken, _, _)| !taken[lane]);
                let slice = match free {
                    Some(slice) => slice,
                    None => {
                        let base = self.new_slice(width)?;
                        slices.push(([false; SLICE_HEIGHT], base, width as u32));
                        slices.len() - 1
                    }
                };
                let (taken, base, room) = &mut slices[slice];
                taken[lane] = true;
                (self.rows[t as usize][1], self.rows[t as usize][3]) = (*base, *room);
            }
            self.fill(*node, row);
            let [_, base, _, room] = self.rows[t as usize];
            replaced.rows.push(t);
            for e in 0..4 * room as usize {
                let (column, place) = entry_position(base, t as usize, e);
                replaced.stiffnesses.push(place as u32);
                if e % 4 == 0 {
                    replaced.columns.push(column as u32);
                }
            }
        }
        Ok(replaced)
    }
}

/// The location of entry e of row t in the slice starting at `base`: texel in `columns`, index in
/// `stiffnesses`.
fn entry_position(base: u32, t: usize, e: usize) -> (usize, usize) {
    let (base, lane) = (base as usize, t % SLICE_HEIGHT);
    (
        base + e / 4 * SLICE_HEIGHT + lane,
        4 * base + e * SLICE_HEIGHT + lane,
    )
}

/// The two directed edges of an edge, whose nodes rest at the local positions `rest`.
pub(in crate::physics) fn directed_pair(
    edge: &Edge,
    rest: impl Fn(u32) -> Vec3,
    units: &LocalUnits,
) -> [(u32, DirectedEdge); 2] {
    let [i, j] = edge.nodes;
    let length = rest(i).as_dvec3().distance(rest(j).as_dvec3()) as f32;
    let stiffness = (edge.stiffness / units.stiffness()) as f32;
    [(i, (j, stiffness, length)), (j, (i, stiffness, length))]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn rows_of(lists: &[Vec<DirectedEdge>]) -> SlicedEllpack {
        let empty = SlicedEllpack {
            rows: Vec::new(),
            columns: Vec::new(),
            stiffnesses: Vec::new(),
            row_of: Vec::new(),
            filler: None,
        };
        let mut rows = empty;
        let given = lists.iter().cloned().enumerate();
        rows.replace(given.map(|(i, row)| (i as u32, row)).collect())
            .unwrap();
        rows
    }

    #[test]
    fn rows_are_replaced_moved_and_added() {
        let directed = |j: u32| (j, j as f32, 0.5);
        let list = |node: u32, count: u32| -> Vec<DirectedEdge> {
            (0..count).map(|k| directed((node + 1 + k) % 90)).collect()
        };
        let mut lists: Vec<Vec<DirectedEdge>> = (0..70).map(|i| list(i, 3 + i % 9)).collect();
        let mut rows = rows_of(&lists);
        let check = |rows: &SlicedEllpack, lists: &[Vec<DirectedEdge>]| {
            for (i, list) in lists.iter().enumerate() {
                let mut list = list.clone();
                list.sort_unstable_by_key(|d| d.0);
                assert_eq!(rows.row(i as u32).collect::<Vec<_>>(), list, "{i}");
            }
        };
        check(&rows, &lists);
        // One row becomes shorter, two in one lane exceed their capacity, one is new.
        let changes = [(7, 2), (3, 30), (35, 20), (70, 5)];
        let texels = rows.columns.len();
        let given = changes.map(|(node, count)| (node, list(node, count)));
        lists.push(Vec::new());
        for (node, list) in &given {
            lists[*node as usize] = list.clone();
        }
        let before = (
            rows.rows.clone(),
            rows.columns.clone(),
            rows.stiffnesses.clone(),
        );
        let replaced = rows.replace(given.to_vec()).unwrap();
        check(&rows, &lists);
        assert_eq!(rows.columns.len(), texels + (8 + 5) * SLICE_HEIGHT);
        // Unlisted rows have not changed.
        for (t, row) in before.0.iter().enumerate() {
            assert!(rows.rows[t] == *row || replaced.rows.contains(&(t as u32)));
        }
        for (k, column) in before.1.iter().enumerate() {
            assert!(rows.columns[k] == *column || replaced.columns.contains(&(k as u32)));
        }
        for (k, stiffness) in before.2.iter().enumerate() {
            assert!(
                rows.stiffnesses[k] == *stiffness || replaced.stiffnesses.contains(&(k as u32))
            );
        }
    }
}
