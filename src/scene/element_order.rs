//! The order of the elements of a scene's mesh.

use super::Scene;
use crate::cage::CageKind;
use crate::mesh::{ElementOrder, Location, PIECES, TenNodes, TetMesh};
use crate::number_format::significant;
use crate::physics::{
    Engine, EngineChoice, Material, MaterialModel, SolverKind, VolumetricFormulation,
};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;
use std::str::FromStr;

/// Largest number of tets for which [`OrderChoice::Auto`] chooses order 2: a press of so many takes
/// tens of seconds on two processor cores (`docs/validation/elements.md`).
const MAX_AUTO_TETS: usize = 30_000;

/// The order of the elements of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrderChoice {
    /// This order.
    Exactly(ElementOrder),
    /// Order 2 for bodies of at most 30,000 tets that support it, else order 1. It does not depend
    /// on the machine.
    Auto,
}

impl FromStr for OrderChoice {
    type Err = Error;

    fn from_str(text: &str) -> Result<OrderChoice> {
        if text == "auto" {
            return Ok(OrderChoice::Auto);
        }
        let number = text.parse().map_err(|_| {
            Error::Input(format!(
                "expected order 1 (linear tets), 2 (quadratic tets) or auto, got \"{text}\""
            ))
        });
        ElementOrder::from_number(number?).map(OrderChoice::Exactly)
    }
}

impl Scene {
    /// Returns the order of the elements of `mesh`, and if it is chosen automatically a note that
    /// says why.
    pub(crate) fn element_order(&self, mesh: &TetMesh) -> (ElementOrder, Option<String>) {
        match self.material.order {
            None => (ElementOrder::Linear, None),
            Some(OrderChoice::Exactly(order)) => (order, None),
            Some(OrderChoice::Auto) => match self.unsuited_to_order_2(mesh) {
                None => (
                    ElementOrder::Quadratic,
                    Some("finite elements of order 2 (quadratic tets); --order 1 is faster, and stiffer by up to tens of percent on the same mesh; a finer mesh (--tets) shows how far off either is".into()),
                ),
                Some(why) => (
                    ElementOrder::Linear,
                    Some(format!(
                        "finite elements of order 1 (linear tets), which can be too stiff by tens of percent: {why}"
                    )),
                ),
            },
        }
    }

    /// Whether its body has linear tets, and no order is set.
    pub(crate) fn has_linear_tets_by_default(&self) -> bool {
        let of_tets = self.grid.is_none() && self.cage.is_none();
        self.material.order.is_none() && self.material.model(of_tets) != MaterialModel::Springs
    }

    /// Returns why a body of this scene and `mesh` is not simulated by order 2 unless asked for.
    fn unsuited_to_order_2(&self, mesh: &TetMesh) -> Option<String> {
        let tets = match mesh.order {
            ElementOrder::Linear => mesh.tets.len(),
            ElementOrder::Quadratic => mesh.tets.len() / PIECES,
        };
        let grid_cage = self.cage.as_ref().and_then(|c| c.kind) == Some(CageKind::Grid);
        let of_tets = self.grid.is_none() && !grid_cage;
        let explicit = self.solver.name.as_ref().filter(|name| {
            let kind: Result<SolverKind> = name.parse();
            kind.is_ok_and(|kind| !kind.is_implicit())
        });
        let engine = match self.solver.engine {
            Some(EngineChoice::Exactly(engine)) if engine != Engine::Cpu => Some(engine),
            _ => None,
        };
        if self.material.model(of_tets) == MaterialModel::Springs {
            Some("springs have no order 2".into())
        } else if self.grid.is_some() || self.cage.is_some() {
            Some("grids and cages have no order 2".into())
        } else if self.material.volume == Some(VolumetricFormulation::NodalAveraged) {
            Some("averaged volumes have no order 2".into())
        } else if let Some(engine) = engine {
            Some(format!("the engine {engine} has no order 2"))
        } else if let Some(name) = explicit {
            Some(format!("the solver {name} would need very short steps"))
        } else if tets > MAX_AUTO_TETS {
            Some(format!(
                "its {tets} tets are more than the {MAX_AUTO_TETS} for which order 2 is the default; --order 2 takes several times as long"
            ))
        } else {
            None
        }
    }

    /// Whether order 2 is worth trying for the tets of `mesh` in this scene, with an implicit solver
    /// and no cage: the scene sets it, or nothing excludes it and there are at most `most` tets.
    pub(crate) fn supports_order_2(&self, mesh: &TetMesh, most: usize) -> bool {
        if self.material.order == Some(OrderChoice::Exactly(ElementOrder::Quadratic)) {
            return true;
        }
        if mesh.element_count() > most {
            return false;
        }
        let mut plain = self.clone();
        plain.cage = None;
        plain.solver.name = None;
        plain.unsuited_to_order_2(mesh).is_none()
    }

    /// Loads the mesh of a scene of one body as it is simulated: of ten-node tets the corners only,
    /// unless the scene sets order 2.
    ///
    /// # Errors
    /// As [`Scene::load_mesh`].
    pub(crate) fn load_simulated_mesh(&self, progress: ProgressFn) -> Result<TetMesh> {
        Ok(self.as_simulated(self.load_mesh(progress)?))
    }

    /// Returns the mesh of this scene as it is simulated.
    pub(crate) fn as_simulated(&self, mesh: TetMesh) -> TetMesh {
        match self.element_order(&mesh).0 {
            ElementOrder::Linear => four_node_mesh(mesh),
            ElementOrder::Quadratic => mesh,
        }
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
