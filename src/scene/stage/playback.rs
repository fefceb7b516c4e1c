//! Playback of recorded series in a static stage.

use super::{NodeSource, Stage};
use crate::mesh::{Field, Location, TetMesh};
use crate::scene::Scene;
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;

/// The range of each field over the frames of a series, by name; of vectors that of the magnitude.
#[derive(Clone, Debug, Default)]
pub struct FieldRanges(BTreeMap<String, (f64, f64)>);

impl FieldRanges {
    /// Extends the ranges by the fields of a frame.
    pub fn add(&mut self, fields: &[Field]) {
        for field in fields {
            if let Some(range) = field.range() {
                self.extend(&field.name, range);
            }
        }
    }

    /// Extends the range of the field `name`.
    pub fn extend(&mut self, name: &str, (low, high): (f64, f64)) {
        let known = self.0.entry(name.to_owned()).or_insert((low, high));
        *known = (known.0.min(low), known.1.max(high));
    }

    /// Returns the range of a field; `None` if it is unknown or the field is constant.
    pub fn get(&self, name: &str) -> Option<(f64, f64)> {
        self.0.get(name).copied().filter(|(low, high)| low < high)
    }

    /// Returns the names and ranges.
    pub fn iter(&self) -> impl Iterator<Item = (&str, (f64, f64))> {
        self.0.iter().map(|(name, range)| (name.as_str(), *range))
    }
}

impl Stage {
    /// Returns `scene` with the range of the displayed field over a series, if the scene does not
    /// set one; `None` if that changes nothing.
    pub fn with_series_range(&self, scene: &Scene, ranges: &FieldRanges) -> Option<Scene> {
        let field = &self.looks.scalars;
        let (low, high) = ranges.get(&field.name)?;
        let own = scene.picture.range.is_some() || !field.regions.is_empty();
        if own || !scene.scan.is_empty() || field.range == (low, high) {
            return None;
        }
        let mut scene = scene.clone();
        scene.picture.range = Some([low, high]);
        Some(scene)
    }

    /// Displays the field in its range over a series, unless the scene sets one.
    ///
    /// # Errors
    /// As [`Stage::set_appearance`].
    pub fn use_series_range(&mut self, ranges: &FieldRanges) -> Result<()> {
        if let Some(scene) = self.with_series_range(&self.scene, ranges) {
            self.set_appearance(&scene)?;
        }
        Ok(())
    }

    /// Shows the mesh of a frame: as [`Stage::show_frame`] if it has the tets and regions of the
    /// mesh of this stage; otherwise the stage is recreated for it, with the same view and range.
    /// Returns whether it has.
    ///
    /// # Errors
    /// As [`Stage::show_frame`] and [`Stage::with_mesh`].
    pub fn show_mesh(&mut self, mesh: TetMesh) -> Result<bool> {
        let own = self.mesh();
        let regions = |mesh: &TetMesh| mesh.region_field().map(|f| f.values.clone());
        let same = own.has_elements_of(&mesh)
            && own.nodes.len() == mesh.nodes.len()
            && regions(own) == regions(&mesh);
        if same || self.motion().is_some() {
            return self.show_frame(&mesh.nodes, &mesh.fields).map(|()| same);
        }
        let mut scene = self.scene.clone();
        let field = &self.looks.scalars;
        let is_stored = own.fields.iter().any(|f| f.name == field.name);
        if is_stored && scene.scan.is_empty() && field.regions.is_empty() {
            scene.picture.field = Some(field.name.clone());
            let (low, high) = field.range;
            scene.picture.range = Some([low, high]).filter(|_| low < high);
        }
        let mut stage = Stage::with_mesh(&self.gpu, &scene, mesh)?;
        (stage.looks.camera, stage.looks.size) = (self.looks.camera, self.looks.size);
        stage.backdrop = self.backdrop;
        *self = stage;
        Ok(false)
    }

    /// Sets the state of the mesh: its nodes to `nodes`, and its fields to `fields`. The displayed
    /// field keeps its range; scans, regions and quantities derived from the mesh's shape are not
    /// changed.
    ///
    /// # Errors
    /// [`Error::Input`] for a simulated body, for nodes or fields of another mesh, and if the
    /// displayed field is not finite or is at another location in this frame.
    pub fn show_frame(&mut self, nodes: &[DVec3], fields: &[Field]) -> Result<()> {
        let name = &self.looks.scalars.name;
        let has_field = |mesh: &TetMesh| {
            let mut own = [Location::Node, Location::Cell].into_iter();
            own.any(|at| mesh.field(name, at).is_some())
        };
        let before = has_field(self.drive.mesh());
        let NodeSource::Posed(posed) = &mut self.drive else {
            return Err(Error::Input(
                "frames of a series cannot be shown on a simulated body; remove the solver".into(),
            ));
        };
        if before && !fields.iter().any(|f| f.name == *name) {
            return Err(Error::Input(format!(
                "the frame has no field {name}, which is displayed; select a field that all frames have (--field)"
            )));
        }
        posed.show(nodes, fields)?;
        self.cached = None;
        let named = has_field(self.drive.mesh());
        if !self.scene.scan.is_empty() || !self.looks.scalars.regions.is_empty() || !named {
            return Ok(());
        }
        if self.looks.drawn.is_some() {
            return self.draw_own_mesh();
        }
        let mut scene = self.scene.clone();
        scene.picture.field = Some(name.clone());
        let seen = scene.scalar_field(self.drive.mesh(), self.drive.topology())?;
        if seen.cells.is_some() != self.looks.scalars.cells.is_some() {
            return Err(Error::Input(format!(
                "the frame has the field {name} at another location (nodes or tets) than the previous frame"
            )));
        }
        self.looks.scalars.values = seen.values;
        self.looks.scalars.cells = seen.cells;
        let (low, high) = self.looks.scalars.range;
        // A constant field needs a non-empty range, too.
        let range = if low < high {
            (low, high)
        } else {
            (low, low + 1.0)
        };
        let geometry = self.looks.raycaster.geometry_mut();
        geometry.set_scalars(self.drive.mesh(), self.looks.scalars.scalars(), range)?;
        self.looks.raycaster.update_range()?;
        let geometry = self.looks.raycaster.geometry();
        self.looks
            .surface
            .set_scalars(geometry, &self.looks.scalars.values)
    }
}
