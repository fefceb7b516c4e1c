//! Meshes of order 2 by element: their ten-node tets instead of the pieces of these.

use super::quadratic::{PIECES, TenNodes, pieces};
use super::quadratic_shape::{QUADRATURE_POINTS, jacobians};
use super::{EdgeMiddles, ElementOrder, Field, Location, ScalarType, TET_EDGES, TetMesh};
use crate::{Error, Result};
use glam::DVec3;

impl TetMesh {
    /// Builds a mesh of order 2 from ten-node tets: their corners, then the nodes in the middle of their
    /// edges in the order of [`TET_EDGES`], as those of [`TetMesh::ten_node_tets`].
    /// Cell fields have one tuple per ten-node tet. Repairs are those of [`TetMesh::new`]; a middle node
    /// that is a corner or on several edges is replaced by one of a straight edge, with a warning.
    ///
    /// # Errors
    /// As [`TetMesh::new`].
    pub fn from_ten_node_tets(
        nodes: Vec<DVec3>,
        elements: &[[u32; 10]],
        fields: Vec<Field>,
        warnings: Vec<String>,
    ) -> Result<TetMesh> {
        let count = nodes.len();
        let bad = |element: &[u32; 10]| element.iter().any(|v| *v as usize >= count);
        if let Some(k) = elements.iter().position(bad) {
            return Err(Error::Mesh(format!(
                "ten-node tet {k} has nodes {:?}, but there are only {count} nodes (counted from 0)",
                elements[k]
            )));
        }
        let corners = elements.iter().map(|[a, b, c, d, ..]| [*a, *b, *c, *d]);
        let middles = EdgeMiddles::new(elements.iter().copied());
        TetMesh::of_order(nodes, corners.collect(), fields, warnings, Some(middles))
    }

    /// Returns the ten-node tets of a mesh of order 2; `None` for a mesh of order 1, and for one whose
    /// tets are no longer pieces of ten-node tets.
    pub(crate) fn quadratic_elements(&self) -> Option<Vec<TenNodes>> {
        match self.order {
            ElementOrder::Linear => None,
            ElementOrder::Quadratic => self.ten_node_tets().ok(),
        }
    }

    /// Number of elements: of order 2 that of the ten-node tets, otherwise that of the tets.
    pub fn element_count(&self) -> usize {
        match self.quadratic_elements() {
            Some(elements) => elements.len(),
            None => self.tets.len(),
        }
    }

    /// Returns a mesh of order 2 without the nodes in the middle of its edges: of four-node tets with
    /// straight edges, whose fields are those of the corners and the elements
    /// ([`TetMesh::element_field`]). `None` for a mesh of order 1.
    pub(crate) fn corner_mesh(&self) -> Option<TetMesh> {
        let mut mesh = self.mesh_of_corners(&self.quadratic_elements()?);
        let unused = mesh.repairs.unused_nodes;
        mesh.drop_unused_nodes();
        mesh.repairs.unused_nodes = unused;
        Some(mesh)
    }

    /// Returns the corners of ten-node tets among `nodes`, and the nodes in the middle of edges between
    /// two of these; `nodes` if no corner is among them, and in a mesh of order 1.
    pub(crate) fn nodes_between(&self, nodes: Vec<u32>) -> Vec<u32> {
        let Some(elements) = self.quadratic_elements() else {
            return nodes;
        };
        let mut given = vec![false; self.nodes.len()];
        nodes.iter().for_each(|v| given[*v as usize] = true);
        let mut chosen = vec![false; self.nodes.len()];
        for element in &elements {
            let corner = |end: usize| given[element[end] as usize];
            (0..4).for_each(|end| chosen[element[end] as usize] = corner(end));
            for (edge, [a, b]) in TET_EDGES.into_iter().enumerate() {
                chosen[element[4 + edge] as usize] = corner(a) && corner(b);
            }
        }
        let all = (0u32..).zip(chosen).filter(|(_, chosen)| *chosen);
        let all: Vec<u32> = all.map(|(v, _)| v).collect();
        if all.is_empty() { nodes } else { all }
    }

    /// Returns the four-node tets at the corners of `elements`, with all nodes of this mesh.
    pub(crate) fn mesh_of_corners(&self, elements: &[TenNodes]) -> TetMesh {
        let of_element = |f: &Field| match f.location {
            Location::Node => f.clone(),
            Location::Cell => self.element_field(f),
        };
        TetMesh {
            nodes: self.nodes.clone(),
            tets: elements
                .iter()
                .map(|[a, b, c, d, ..]| [*a, *b, *c, *d])
                .collect(),
            order: ElementOrder::Linear,
            fields: self.fields.iter().map(of_element).collect(),
            region_names: self.region_names.clone(),
            length_unit: self.length_unit,
            frame: self.frame,
            repairs: self.repairs.clone(),
        }
    }

    /// Returns a field of the pieces with one tuple per ten-node tet: the value of its pieces, or, if
    /// they differ, their mean by volume; of integers the value of the first piece.
    pub(crate) fn element_field(&self, field: &Field) -> Field {
        let width = field.components.max(1);
        let real = matches!(field.scalar_type, ScalarType::F32 | ScalarType::F64);
        let mut values = Vec::with_capacity(field.values.len() / PIECES);
        for (element, group) in field.values.chunks_exact(PIECES * width).enumerate() {
            let first = &group[..width];
            if !real || group.chunks_exact(width).all(|piece| piece == first) {
                values.extend_from_slice(first);
                continue;
            }
            let volume = |k: usize| self.tet_volume(PIECES * element + k).abs();
            let whole: f64 = (0..PIECES).map(volume).sum();
            for component in 0..width {
                let of_piece = |k: usize| volume(k) * group[k * width + component];
                let mean = (0..PIECES).map(of_piece).sum::<f64>() / whole;
                values.push(if whole > 0.0 { mean } else { first[component] });
            }
        }
        Field {
            values,
            name: field.name.clone(),
            ..*field
        }
    }

    /// Returns the ten-node tets whose Jacobian is not positive at all quadrature points: such an
    /// element is inverted or folded.
    pub(crate) fn folded_elements(&self, elements: &[TenNodes]) -> Vec<usize> {
        let is_folded = |element: &TenNodes| {
            let jacobians: [f64; QUADRATURE_POINTS] = jacobians(element, &self.nodes);
            !jacobians.iter().all(|j| *j > 0.0)
        };
        let folded = elements.iter().enumerate().filter(|(_, e)| is_folded(e));
        folded.map(|(k, _)| k).collect()
    }

    /// Returns the volumes of ten-node tets by their quadrature points.
    pub(super) fn element_volumes(&self, elements: &[TenNodes]) -> Vec<f64> {
        let volume = |element: &TenNodes| jacobians(element, &self.nodes).iter().sum::<f64>();
        elements.iter().map(|e| volume(e) / 24.0).collect()
    }

    /// Flips the tets of negative volume; in a mesh of order 2 the elements with such corners.
    pub(crate) fn flip_inverted(&mut self) {
        let Some(elements) = self.quadratic_elements() else {
            for t in 0..self.tets.len() {
                if self.tet_volume(t) < 0.0 {
                    self.tets[t].swap(2, 3);
                }
            }
            return;
        };
        for (k, element) in elements.into_iter().enumerate() {
            let [a, b, c, d, ab, ac, ad, bc, bd, cd] = element;
            let corners = [a, b, c, d].map(|v| self.nodes[v as usize]);
            if super::signed_volume(corners) < 0.0 {
                let flipped = pieces([a, b, d, c], [ab, ad, ac, bd, bc, cd], &self.nodes);
                self.tets[PIECES * k..PIECES * (k + 1)].copy_from_slice(&flipped);
            }
        }
    }

    /// Whether this mesh has the same elements as `other`. Ten-node tets may be divided into their
    /// pieces in another way, since the shape of an element decides that.
    pub fn has_elements_of(&self, other: &TetMesh) -> bool {
        match (self.quadratic_elements(), other.quadratic_elements()) {
            (Some(own), Some(others)) => own == others,
            _ => self.tets == other.tets,
        }
    }
}
