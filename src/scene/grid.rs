//! Builds the grid shape and the mesh of a scene's `[grid]`.

use super::{GridEntry, Lengths, Scene};
use crate::io::{self, Kind};
use crate::mesh::TetMesh;
use crate::mesher::Domain;
use crate::meshing::MeshingConfig;
use crate::number_format::significant;
use crate::physics::grid::GridShape;
use crate::volume::Volume;
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Default number of particles.
const NODES: usize = 20_000;

impl Scene {
    /// Carves the grid body and returns its shape, mesh and notes. The mesh has the labels and
    /// names of its regions and, if made from thresholds of a volume, the volume's values at the
    /// nodes.
    pub(super) fn carve(&self, grid: &GridEntry) -> Result<(GridShape, TetMesh, Vec<String>)> {
        let recipe = MeshingConfig {
            meets_scan: self.meets_scan(),
            ..self.mesh.recipe()?
        };
        recipe.with_domain(|found| {
            let axes = found.volume.map_or(DMat3::IDENTITY, axes);
            let grown = Grown {
                domain: found.domain,
                margin: self.margin(grid)?,
            };
            let domain: &dyn Domain = &grown;
            let mut shape = match (grid.spacing, grid.nodes) {
                (Some(Lengths::Same(s)), None) => {
                    GridShape::from_domain(domain, DVec3::splat(s), axes)?
                }
                (Some(Lengths::Each(s)), None) => GridShape::from_domain(domain, s.into(), axes)?,
                (None, nodes) => {
                    GridShape::from_domain_with_count(domain, nodes.unwrap_or(NODES), axes)?
                }
                (Some(_), Some(_)) => {
                    return Err(Error::Input(
                        "[grid] has both `nodes` and `spacing`; remove one of them".into(),
                    ));
                }
            };
            shape.labels = found.labels.clone();
            let mut mesh = shape.mesh(&shape.springs())?;
            mesh.length_unit = found.unit;
            mesh.frame = found.frame;
            let named = found.labels.iter().zip(&found.names);
            mesh.region_names = named
                .filter_map(|(label, name)| Some((*label, name.clone()?)))
                .collect();
            if let Some(volume) = found.volume {
                mesh.set_field(volume.onto_nodes(&mesh, "intensity"))?;
            }
            let mut notes = found.notes;
            let thin = shape.undefined_normal_particles().len();
            let [x, y, z] = shape.spacing.to_array().map(significant);
            notes.push(format!(
                "{} particles, spacing {x} × {y} × {z}; {thin} of them have no normal, where the body is one particle thick",
                shape.count()
            ));
            Ok((shape, mesh, notes))
        })
    }

    fn margin(&self, grid: &GridEntry) -> Result<f64> {
        let margin = grid.margin.unwrap_or(0.0);
        let of_volume = match &self.mesh.file {
            Some(file) => io::detect_kind(file)? == Kind::Volume,
            None => false,
        };
        if !(margin.is_finite() && margin >= 0.0) || (margin > 0.0 && of_volume) {
            return Err(Error::Input(format!(
                "[grid] margin must be ≥ 0, got {margin}; volumes do not support it, so adjust their thresholds instead"
            )));
        }
        Ok(margin)
    }
}

/// A domain whose weights are distances, offset outwards by a margin.
struct Grown<'a> {
    domain: &'a dyn Domain,
    margin: f64,
}

impl Domain for Grown<'_> {
    fn bounds(&self) -> (DVec3, DVec3) {
        let (low, high) = self.domain.bounds();
        (low - self.margin, high + self.margin)
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        self.domain.weights(p, weights);
        // The distance is half the difference between the weights of a region and the outside.
        for (_, weight) in weights.iter_mut().filter(|w| w.0 != 0) {
            *weight += 2.0 * self.margin;
        }
    }
}

/// Returns the axes of a volume, or the identity if they are not orthogonal.
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
