//! Playback of recorded series in a static stage.

use super::{NodeSource, Stage};
use crate::mesh::{Field, Location};
use crate::{Error, Result};
use glam::DVec3;

impl Stage {
    /// Sets the state of the mesh: its nodes to `nodes`, and its fields to `fields`. The displayed
    /// field keeps its range; scans, regions and quantities derived from the mesh's shape are not
    /// changed.
    ///
    /// # Errors
    /// [`Error::Input`] for a simulated body, for nodes or fields of another mesh, and if the
    /// displayed field is not finite or is at another location in this frame.
    pub fn show_frame(&mut self, nodes: &[DVec3], fields: &[Field]) -> Result<()> {
        let NodeSource::Posed(posed) = &mut self.drive else {
            return Err(Error::Input(
                "frames of a series cannot be shown on a simulated body; remove the solver".into(),
            ));
        };
        posed.show(nodes, fields)?;
        self.cached = None;
        let name = &self.scalars.name;
        let own = [Location::Node, Location::Cell];
        let named = own
            .iter()
            .any(|at| self.drive.mesh().field(name, *at).is_some());
        if !self.scene.scan.is_empty() || !self.scalars.regions.is_empty() || !named {
            return Ok(());
        }
        let mut scene = self.scene.clone();
        scene.picture.field = Some(name.clone());
        let seen = scene.scalar_field(self.drive.mesh(), self.drive.topology())?;
        if seen.cells.is_some() != self.scalars.cells.is_some() {
            return Err(Error::Input(format!(
                "the frame has the field {name} at another location (nodes or tets) than the previous frame"
            )));
        }
        self.scalars.values = seen.values;
        self.scalars.cells = seen.cells;
        let (low, high) = self.scalars.range;
        // A constant field needs a non-empty range, too.
        let range = if low < high {
            (low, high)
        } else {
            (low, low + 1.0)
        };
        let geometry = self.raycaster.geometry_mut();
        geometry.set_scalars(self.drive.mesh(), self.scalars.scalars(), range)?;
        self.raycaster.update_range()?;
        let geometry = self.raycaster.geometry();
        self.surface.set_scalars(geometry, &self.scalars.values)
    }
}
