//! Rest configuration of a static body whose file contains a deformed state.

use super::Scene;
use crate::mesh::{Location, TetMesh};
use crate::{Error, Result, io};
use glam::DVec3;

/// Name of the displacement field in recorded series.
const DISPLACEMENT: &str = "displacement";

impl Scene {
    /// Moves `mesh` to its rest configuration and returns the deformed node positions, with a note.
    /// The rest configuration is the mesh `[mesh] rest`, or, if the picture needs it, follows from
    /// a field `displacement`.
    pub(super) fn move_to_rest(
        &self,
        mesh: &mut TetMesh,
    ) -> Result<Option<(Vec<DVec3>, Option<String>)>> {
        if let Some(file) = &self.mesh.rest {
            if !(self.mesh.split.is_empty() && self.mesh.join.is_empty()) {
                return Err(Error::Input(
                    "[mesh] `rest` cannot be combined with `split` or `join`; remove one of them"
                        .into(),
                ));
            }
            let mut rest = io::read(file)?;
            if let (Some(frame), None) = (self.mesh.frame, rest.frame) {
                rest.convert_to_ras(frame);
            }
            let wrong = |e: Error| {
                Error::Input(format!(
                    "{} is not the rest state of the rendered mesh: {e}",
                    file.display()
                ))
            };
            mesh.check_same_connectivity(&rest).map_err(wrong)?;
            let now = std::mem::replace(&mut mesh.nodes, rest.nodes);
            // Readers reoriented the tetrahedra that were inverted in the deformed state.
            mesh.flip_inverted();
            return Ok(Some((now, None)));
        }
        let needed = !self.scan.is_empty()
            || self.picture.mode.as_deref() == Some("xray")
            || self.plane.iter().any(|plane| plane.rest);
        let field = mesh.field(DISPLACEMENT, Location::Node);
        let Some(field) = field.filter(|f| needed && f.components == 3) else {
            return Ok(None);
        };
        let moved = field.values.chunks_exact(3).map(DVec3::from_slice);
        let rest: Vec<DVec3> = mesh.nodes.iter().zip(moved).map(|(x, u)| *x - u).collect();
        if rest == mesh.nodes || rest.iter().any(|x| !x.is_finite()) {
            return Ok(None);
        }
        let note = "rest positions computed from the field displacement; override with --rest MESH";
        Ok(Some((
            std::mem::replace(&mut mesh.nodes, rest),
            Some(note.into()),
        )))
    }
}
