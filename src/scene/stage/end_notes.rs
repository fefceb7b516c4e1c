//! Warnings about the state in which a simulation ended.

use super::Stage;
use crate::Result;
use glam::DVec3;

impl Stage {
    /// Returns why the forces and stresses of the simulated body in its current state are not valid,
    /// one sentence each with what to do: inverted tets, and tools whose contact failed.
    ///
    /// # Errors
    /// Errors of reading the body back.
    pub fn end_notes(&mut self) -> Result<Vec<String>> {
        let inverted = self.inversion_note()?;
        let tools = self.tool_notes()?;
        Ok(inverted.into_iter().chain(tools).collect())
    }

    fn inversion_note(&self) -> Result<Option<String>> {
        let Some(motion) = self.motion() else {
            return Ok(None);
        };
        let count = motion.report()?.inverted_tets;
        Ok((count > 0).then(|| {
            format!(
                "{count} of {} tets are inverted at the end: forces and stresses near them are meaningless; use a smaller load, or improve the mesh (`palpate info` lists its quality)",
                self.mesh().tets.len()
            )
        }))
    }

    fn tool_notes(&mut self) -> Result<Vec<String>> {
        let Some(motion) = self.motion_mut() else {
            return Ok(Vec::new());
        };
        let tools = &motion.time_dependent_loads.tools;
        if tools.is_empty() {
            return Ok(Vec::new());
        }
        let Some(contact) = motion.simulator.contact() else {
            return Ok(Vec::new());
        };
        let (forces, shapes) = (contact.tool_forces()?, contact.tools().to_vec());
        let body = &motion.simulator;
        let (mesh, x) = ((body.mesh(), body.topology()), body.positions()?);
        let mut notes = Vec::new();
        for ((guided, tool), on) in tools.iter().zip(&shapes).zip(forces) {
            let pose = body.loads().tool(guided.id)?;
            let touches = on.force != DVec3::ZERO;
            let state = (x.as_slice(), body.loads().pinned());
            let problem = tool.contact_problem(&pose, mesh, state, touches);
            notes.extend(problem.map(|problem| format!("the [[tool]] {} {problem}", guided.name)));
        }
        Ok(notes)
    }
}
