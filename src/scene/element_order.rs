//! The order of the elements of a scene's mesh.

use super::Scene;
use crate::mesh::{ElementOrder, Location, PIECES, TenNodes, TetMesh};
use crate::number_format::significant;
use crate::physics::Material;
use crate::{Error, ProgressFn, Result};
use glam::DVec3;

impl Scene {
    /// Loads the mesh of a scene of one body as it is simulated: of ten-node tets the corners only,
    /// unless the scene sets order 2.
    ///
    /// # Errors
    /// As [`Scene::load_mesh`].
    pub(crate) fn load_simulated_mesh(&self, progress: ProgressFn) -> Result<TetMesh> {
        let mesh = self.load_mesh(progress)?;
        Ok(match self.material.order.unwrap_or_default() {
            ElementOrder::Linear => four_node_mesh(mesh),
            ElementOrder::Quadratic => mesh,
        })
    }
}

/// Returns a mesh of order 2 without its mid-edge nodes, with a note; others as they are.
pub(super) fn four_node_mesh(mesh: TetMesh) -> TetMesh {
    let Some(mut corners) = mesh.corner_mesh() else {
        return TetMesh {
            order: ElementOrder::Linear,
            ..mesh
        };
    };
    corners.repairs.warnings.push(format!(
        "{} ten-node tets simulated as four-node tets, without their mid-edge nodes; use these with --order 2 ([material] order = 2)",
        corners.tets.len()
    ));
    corners
}

/// Returns `mesh` with ten-node tets: those of its file, or with straight edges.
///
/// # Errors
/// [`Error::Input`] for a ten-node tet of the file that is inverted at rest, and for too many nodes.
pub(super) fn ten_node_mesh(mesh: TetMesh, material: &Material) -> Result<TetMesh> {
    if mesh.order == ElementOrder::Linear {
        return mesh.with_mid_edge_nodes();
    }
    check_folded(&mesh, &mesh.ten_node_tets()?, material)?;
    Ok(mesh)
}

/// Refuses inverted elements, except in rigid regions.
fn check_folded(mesh: &TetMesh, elements: &[TenNodes], material: &Material) -> Result<()> {
    let labels = material.region_field.as_deref();
    let labels = labels.and_then(|name| mesh.field(name, Location::Cell));
    let is_rigid = |element: &usize| {
        let label = labels.and_then(|field| field.values.get(PIECES * element));
        label.is_some_and(|label| material.rigid.contains(&(label.round() as i64)))
    };
    let mut folded = mesh.folded_elements(elements);
    folded.retain(|element| !is_rigid(element));
    let Some(first) = folded.first() else {
        return Ok(());
    };
    let corners = elements[*first].first_chunk::<4>().into_iter().flatten();
    let centre = corners.map(|v| mesh.nodes[*v as usize]).sum::<DVec3>() / 4.0;
    let [x, y, z] = centre.to_array().map(significant);
    Err(Error::Input(format!(
        "{} of {} ten-node tets are inverted or folded at rest (a Jacobian ≤ 0 at a quadrature point), the first of them tet {first} (counted from 0) at ({x}, {y}, {z}); straighten its edges or mesh the body finer, check the order of its nodes, or use order 1",
        folded.len(),
        elements.len()
    )))
}
