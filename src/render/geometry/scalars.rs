//! Replacement of the scalars of a geometry.

use super::{Geometry, Scalars, check_input, scalar_histogram, share};
use crate::mesh::TetMesh;
use crate::{Error, Result};

impl Geometry {
    /// Sets the scalars for subsequent images, at the nodes or in the tets as before, clamped to
    /// `range`. `mesh` is the mesh of the geometry. Call [`Raycaster::update_range`] on the
    /// raycaster that owns the geometry.
    ///
    /// # Errors
    /// [`Error::Input`] if the scalars do not match the geometry or the range is invalid.
    ///
    /// [`Raycaster::update_range`]: crate::render::Raycaster::update_range
    pub fn set_scalars<'a>(
        &mut self,
        mesh: &TetMesh,
        scalars: impl Into<Scalars<'a>>,
        range: (f64, f64),
    ) -> Result<()> {
        let scalars = scalars.into();
        check_input(mesh, &self.positions, scalars)?;
        let (low, high) = range;
        if !(low < high && (high - low).is_finite()) {
            return Err(Error::Input(format!(
                "scalar range must be finite and increasing, got {low} to {high}"
            )));
        }
        if matches!(scalars, Scalars::Cells(_)) != self.is_cell_scalar {
            return Err(Error::Input(
                "scalars must be at the nodes or in the tets as in the geometry; give scalars of the same kind"
                    .into(),
            ));
        }
        self.range = range;
        self.spread = scalar_histogram(mesh, scalars, range);
        match scalars {
            Scalars::Nodes(values) => {
                let shares: Vec<f32> = values.iter().map(|s| share(*s, range)).collect();
                self.gpu.write_items(&self.scalars, 0, &shares)?;
            }
            Scalars::Cells(values) => {
                let mut shares = vec![0.0; values.len()];
                for (place, value) in self.tet_order.iter().zip(values) {
                    shares[*place as usize] = share(*value, range);
                }
                self.gpu.write_items(&self.cells, 0, &shares)?;
            }
        }
        if let Some(records) = &mut self.records {
            records.invalidate();
        }
        self.invalidate_gradients();
        Ok(())
    }
}
