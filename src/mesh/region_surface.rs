//! Extraction of the boundary of regions of a mesh as a surface.

use super::{Field, Location, ScalarType, TetMesh, Topology, TriMesh};
use crate::{Error, Result};
use std::collections::BTreeSet;

impl TetMesh {
    /// Returns the boundary of the union of all tets whose value in the cell field `label` is one
    /// of `labels`, or of all tets for `None`; triangles face outward.
    ///
    /// The vertex field `node` holds the node of this mesh for each vertex; vertices are in the
    /// order of the nodes. Scalar node fields are copied.
    ///
    /// # Errors
    /// An [`Error::Input`] if the mesh has no field `label`, or no tet has one of the labels.
    pub fn boundary_surface(&self, labels: Option<&[i64]>) -> Result<TriMesh> {
        let chosen = TetMesh {
            tets: match labels {
                None => self.tets.clone(),
                Some(labels) => self.tets_labelled(labels)?,
            },
            ..TetMesh::default()
        };
        let topology = Topology::new(&chosen);
        let mut triangles: Vec<[u32; 3]> = topology
            .boundary
            .iter()
            .map(|face| topology.boundary_nodes(&chosen, *face))
            .collect();
        let mut nodes: Vec<u32> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mut number = vec![0; self.nodes.len()];
        for (vertex, node) in nodes.iter().enumerate() {
            number[*node as usize] = vertex as u32;
        }
        for corner in triangles.iter_mut().flatten() {
            *corner = number[*corner as usize];
        }
        let mut fields = vec![Field {
            scalar_type: ScalarType::U32,
            ..Field::scalar(
                "node",
                Location::Node,
                nodes.iter().map(|n| f64::from(*n)).collect(),
            )
        }];
        let carried =
            |f: &&Field| f.location == Location::Node && f.components == 1 && f.name != "node";
        fields.extend(self.fields.iter().filter(carried).map(|field| Field {
            values: nodes.iter().map(|n| field.values[*n as usize]).collect(),
            ..field.clone()
        }));
        Ok(TriMesh {
            vertices: nodes.iter().map(|n| self.nodes[*n as usize]).collect(),
            triangles,
            fields,
            frame: self.frame,
            notes: Vec::new(),
        })
    }

    /// Returns the tets whose value in the cell field `label` is one of `labels`.
    fn tets_labelled(&self, labels: &[i64]) -> Result<Vec<[u32; 4]>> {
        let field = self.field("label", Location::Cell).ok_or_else(|| {
            Error::Input(
                "mesh has no cell field \"label\" with region labels; omit the labels to extract \
                the boundary of the whole mesh"
                    .into(),
            )
        })?;
        let is_in = |value: f64| labels.iter().any(|l| *l as f64 == value);
        let values = field.values.iter().step_by(field.components.max(1));
        let chosen: Vec<[u32; 4]> = self
            .tets
            .iter()
            .zip(values.clone())
            .filter(|(_, value)| is_in(**value))
            .map(|(tet, _)| *tet)
            .collect();
        if chosen.is_empty() {
            let there: BTreeSet<i64> = values.map(|v| *v as i64).collect();
            let there: Vec<String> = there.iter().take(20).map(i64::to_string).collect();
            return Err(Error::Input(format!(
                "no tet has a label in {labels:?}; available labels: {}",
                there.join(", ")
            )));
        }
        Ok(chosen)
    }
}
