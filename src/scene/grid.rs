//! From a scene's `[grid]` to a carved shape and its mesh.

use super::{GridEntry, Lengths, Scene};
use crate::Result;
use crate::mesh::TetMesh;
use crate::physics::grid::GridShape;
use crate::volume::Volume;
use glam::{DMat3, DVec3};

/// Particles where nothing is said.
const NODES: usize = 20_000;

impl Scene {
    /// Carves the grid body, and returns what was noted too. Its mesh has the labels and names of
    /// its regions and, of a volume cut by its values, these at the nodes.
    pub(super) fn carve(&self, grid: &GridEntry) -> Result<(GridShape, TetMesh, Vec<String>)> {
        self.mesh.recipe()?.describe(|found| {
            let axes = found.volume.map_or(DMat3::IDENTITY, axes);
            let mut shape = match (grid.spacing, grid.nodes) {
                (Some(Lengths::Same(s)), None) => {
                    GridShape::carve(found.domain, DVec3::splat(s), axes)?
                }
                (Some(Lengths::Each(s)), None) => GridShape::carve(found.domain, s.into(), axes)?,
                (None, nodes) => {
                    GridShape::carve_about(found.domain, nodes.unwrap_or(NODES), axes)?
                }
                (Some(_), Some(_)) => {
                    return Err(crate::Error::Input(
                        "[grid] has both `nodes` and `spacing`; give one of them".into(),
                    ));
                }
            };
            shape.labels = found.labels.clone();
            let mut mesh = shape.mesh(&shape.springs())?;
            mesh.length_unit = found.unit;
            let named = found.labels.iter().zip(&found.names);
            mesh.region_names = named
                .filter_map(|(label, name)| Some((*label, name.clone()?)))
                .collect();
            if let Some(volume) = found.volume {
                mesh.set_field(volume.onto_nodes(&mesh, "intensity"))?;
            }
            let mut notes = found.notes;
            let thin = shape.thin().len();
            let [x, y, z] = shape.spacing.to_array().map(|s| format!("{s:.4}"));
            notes.push(format!(
                "{} particles, {x} × {y} × {z} apart; {thin} of them, where the body is one particle thin, have no normal",
                shape.count()
            ));
            Ok((shape, mesh, notes))
        })
    }
}

/// The axes of a volume, where they are at right angles.
fn axes(volume: &Volume) -> DMat3 {
    let m = volume.to_world.matrix3;
    let mut axes = DMat3::from_cols(
        m.x_axis.normalize_or_zero(),
        m.y_axis.normalize_or_zero(),
        m.z_axis.normalize_or_zero(),
    );
    if axes.determinant() < 0.0 {
        axes.z_axis = -axes.z_axis;
    }
    match (axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-6) {
        true => axes,
        false => DMat3::IDENTITY,
    }
}
