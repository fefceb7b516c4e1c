//! Ten-node tets in files: the order of their nodes, and meshes of order 2 as they are written.

use super::cell_kinds::{QUADRATIC_TET, TET};
use super::raw_mesh::Cells;
use crate::mesh::{ElementOrder, Field, Location, TET_EDGES, TenNodes, TetMesh};
use glam::DVec3;
use std::borrow::Cow;

/// VTK number of a Lagrange tetrahedron, which has the nodes of [`QUADRATIC_TET`] if it has ten.
const LAGRANGE_TET: u8 = 71;

/// The place of the middle of each edge of [`TET_EDGES`](crate::mesh::TET_EDGES) in the order of VTK,
/// Abaqus and Medit, whose edges are 01, 12, 20, 03, 13, 23.
const VTK_PLACES: [usize; 6] = [4, 6, 7, 5, 8, 9];

/// Returns the nodes of a cell with VTK number `kind` if it is a ten-node tet.
pub(super) fn ten_nodes(kind: u8, nodes: &[u32]) -> Option<TenNodes> {
    let has_ten = nodes.len() == 10 && [QUADRATIC_TET, LAGRANGE_TET].contains(&kind);
    has_ten.then(|| {
        std::array::from_fn(|k| match k {
            0..4 => nodes[k],
            _ => nodes[VTK_PLACES[k - 4]],
        })
    })
}

/// Returns the nodes of a ten-node tet in the order of VTK, Abaqus and Medit.
fn in_vtk_order(element: &TenNodes) -> TenNodes {
    let mut nodes = *element;
    for (k, place) in VTK_PLACES.into_iter().enumerate() {
        nodes[place] = element[4 + k];
    }
    nodes
}

/// Sets the tuples of `width` values of mid-edge nodes that are `missing` to the mean of the ends of
/// the edge, where these are known.
pub(super) fn fill_middles(cells: &Cells, width: usize, values: &mut [f64], missing: &mut [bool]) {
    let ten_node = cells
        .iter()
        .filter_map(|(kind, nodes)| ten_nodes(kind, nodes));
    for nodes in ten_node.map(|nodes| nodes.map(|v| v as usize)) {
        for ([a, b], middle) in TET_EDGES.into_iter().zip(&nodes[4..]) {
            let [a, b] = [nodes[a], nodes[b]];
            if missing.get(*middle) != Some(&true) || missing[a] || missing[b] {
                continue;
            }
            for k in 0..width {
                let mean = 0.5 * (values[a * width + k] + values[b * width + k]);
                values[middle * width + k] = mean;
            }
            missing[*middle] = false;
        }
    }
}

/// Sorts the middle nodes of a ten-node tet, `nodes` with positions `at`, into VTK's order by the
/// straight edge that each is closest to; they stay as they are if two are closest to one edge.
pub(super) fn sort_by_position(nodes: &mut [usize; 10], at: impl Fn(usize) -> DVec3) {
    let edges = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
    let middles = edges.map(|[a, b]| at(nodes[a]).midpoint(at(nodes[b])));
    let mut sorted = [None; 6];
    for node in &nodes[4..] {
        let distance = |edge: &usize| middles[*edge].distance_squared(at(*node));
        let closest = (0..6).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        sorted[closest.unwrap_or(0)] = Some(*node);
    }
    if sorted.iter().all(Option::is_some) {
        for (place, node) in nodes[4..].iter_mut().zip(sorted) {
            *place = node.unwrap_or(*place);
        }
    }
}

/// A mesh as files store it: of order 2 with one cell per ten-node tet.
pub(super) struct FileMesh<'a> {
    /// The mesh; of order 2 its tets are the corners of the cells, and its cell fields have one tuple
    /// for each.
    pub mesh: Cow<'a, TetMesh>,
    /// The cells in VTK's order; empty for four-node tets.
    ten_nodes: Vec<TenNodes>,
}

impl<'a> FileMesh<'a> {
    pub fn new(mesh: &'a TetMesh) -> FileMesh<'a> {
        match mesh.quadratic_elements() {
            Some(elements) => FileMesh {
                mesh: Cow::Owned(mesh.mesh_of_corners(&elements)),
                ten_nodes: elements.iter().map(in_vtk_order).collect(),
            },
            None => FileMesh {
                mesh: Cow::Borrowed(mesh),
                ten_nodes: Vec::new(),
            },
        }
    }

    /// VTK number of the cells.
    pub fn kind(&self) -> u8 {
        match self.order() {
            ElementOrder::Linear => TET,
            ElementOrder::Quadratic => QUADRATIC_TET,
        }
    }

    pub fn order(&self) -> ElementOrder {
        match self.ten_nodes.is_empty() {
            true => ElementOrder::Linear,
            false => ElementOrder::Quadratic,
        }
    }

    /// Returns the nodes of cell `cell` in VTK's order.
    pub fn nodes_of(&self, cell: usize) -> &[u32] {
        match self.ten_nodes.get(cell) {
            Some(nodes) => nodes,
            None => &self.mesh.tets[cell],
        }
    }

    /// Returns the nodes of cell `cell` in Gmsh's order, counted from 1.
    pub fn gmsh_tags_of(&self, cell: usize) -> impl Iterator<Item = usize> {
        let nodes = self.nodes_of(cell);
        let place = move |k: usize| match (nodes.len(), k) {
            (10, 8) => 9,
            (10, 9) => 8,
            _ => k,
        };
        (0..nodes.len()).map(move |k| nodes[place(k)] as usize + 1)
    }

    /// Returns the nodes of all cells.
    pub fn cells(&self) -> impl Iterator<Item = &[u32]> {
        (0..self.mesh.tets.len()).map(|cell| self.nodes_of(cell))
    }

    /// Number of nodes of a cell.
    pub fn width(&self) -> usize {
        match self.order() {
            ElementOrder::Linear => 4,
            ElementOrder::Quadratic => 10,
        }
    }

    /// Returns a field of `mesh`, the mesh that this was made from, with one tuple per cell.
    pub fn field<'f>(&self, mesh: &TetMesh, field: &'f Field) -> Cow<'f, Field> {
        match (self.order(), field.location) {
            (ElementOrder::Quadratic, Location::Cell) => Cow::Owned(mesh.element_field(field)),
            _ => Cow::Borrowed(field),
        }
    }
}
