//! Loads the skins of a scene and embeds them in the body.

use super::SkinEntry;
use super::stage::NodeSource;
use crate::gpu::Gpu;
use crate::mesh::{AnatomicalFrame, TriMesh};
use crate::meshing::{Labels, MeshingConfig};
use crate::render::TransferFunction;
use crate::skin::{Map, Skin, SkinBase, SkinColouring};
use crate::{Error, ProgressFn, Result};
use std::sync::Arc;

impl SkinEntry {
    /// Reads its surface from its file.
    ///
    /// # Errors
    /// As [`MeshingConfig::extract_surface`].
    pub fn read(&self, progress: ProgressFn) -> Result<TriMesh> {
        let recipe = MeshingConfig {
            input: vec![self.file.clone()],
            above: self.above.clone(),
            labels: self.labels.clone().map(Labels::These),
            frame: self.frame,
            ..MeshingConfig::default()
        };
        recipe.extract_surface(self.smooth.unwrap_or(0), progress)
    }

    /// Embeds the skin in `carrier`, and returns it with notes for the user.
    /// `frame` is the frame of reference of the body: a skin of unknown frame meets it.
    pub(super) fn attach(
        &self,
        gpu: &Gpu,
        carrier: &SkinBase,
        frame: Option<AnatomicalFrame>,
    ) -> Result<(Skin, Vec<String>)> {
        if self.height.is_some() && self.height_map.is_none() {
            return Err(Error::Input(
                "a skin has `height` without `height_map`; set both, or remove `height`".into(),
            ));
        }
        let surface = match &self.surface.0 {
            Some(surface) => surface.clone(),
            None => Arc::new(self.read(&crate::no_progress)?),
        };
        let mut notes = Vec::new();
        let surface = match (frame, surface.frame) {
            (Some(_), None) => {
                let mut own = TriMesh::clone(&surface);
                own.notes.clear();
                own.meet_ras();
                notes.append(&mut own.notes);
                Arc::new(own)
            }
            _ => surface,
        };
        let mut skin = Skin::new(gpu, &surface, carrier, self.mapping.unwrap_or_default())?;
        match (&self.field, self.colour) {
            (Some(name), _) => {
                let preset = self.transfer.as_deref().unwrap_or("viridis");
                skin.set_colour(&SkinColouring::Field {
                    name: name.clone(),
                    transfer: TransferFunction::preset(preset)?,
                })?;
            }
            (None, Some(colour)) => skin.set_colour(&SkinColouring::Plain(colour))?,
            (None, None) => {}
        }
        skin.set_opacity(self.opacity.unwrap_or(1.0))?;
        let map = self.normal_map.as_ref().map(Map::read).transpose()?;
        skin.set_normal_map(map.as_ref())?;
        let map = self.height_map.as_ref().map(Map::read).transpose()?;
        let depth = self.height.unwrap_or(0.02);
        skin.set_height_map(map.as_ref().map(|map| (map, depth)))?;
        let name = self.file.file_name().unwrap_or_default().to_string_lossy();
        notes.extend(skin.report().notes());
        let notes = notes
            .into_iter()
            .map(|note| format!("skin {name}: {note}"))
            .collect();
        Ok((skin, notes))
    }
}

/// Returns the base of the skins of a body: its boundary, with the normals computed by the
/// simulator, or those of the faces around a node.
pub(super) fn carrier(gpu: &Gpu, drive: &mut NodeSource) -> Result<SkinBase> {
    let normals = match drive {
        NodeSource::Simulated(motion) => motion.simulator.normals()?,
        NodeSource::Posed(_) => None,
    };
    let (nodes, mesh) = (drive.nodes(), drive.mesh());
    match normals {
        Some((normals, at_rest)) => SkinBase::with_normals(nodes, mesh, &normals, &at_rest),
        None => SkinBase::from_mesh(gpu, mesh, nodes.array(), nodes.frame()),
    }
}
