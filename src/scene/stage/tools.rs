//! Tools of a stage that are moved interactively.

use super::Stage;
use crate::physics::{Capability, ToolId, ToolPose};
use crate::scene::Motion;
use crate::{Error, Result};
use glam::{DQuat, DVec3};

impl Motion {
    /// Sets the target of a tool, by its index in the scene: the tool moves there straight within
    /// the next step. The place is in file units, and the tool must not have a path in the scene.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an unknown tool, or one with a path.
    pub fn set_tool_target(&mut self, number: usize, place: DVec3) -> Result<()> {
        let (id, pose) = self.interactive_tool(number, place)?;
        self.simulator.loads_mut().set_tool_target(id, pose)
    }

    /// As [`Motion::set_tool_target`], but moves the tool at once, without collision detection.
    ///
    /// # Errors
    /// As [`Motion::set_tool_target`].
    pub fn teleport_tool(&mut self, number: usize, place: DVec3) -> Result<()> {
        let (id, pose) = self.interactive_tool(number, place)?;
        self.simulator.loads_mut().teleport_tool(id, pose)
    }

    /// Turns a tool in place, at once, from its own frame by a rotation.
    ///
    /// # Errors
    /// As [`Motion::set_tool_target`].
    pub(crate) fn turn_tool(&mut self, number: usize, rotation: DQuat) -> Result<()> {
        let (id, _) = self.interactive_tool(number, DVec3::ZERO)?;
        let place = self.simulator.loads().tool(id)?.position();
        let pose = ToolPose::new(place, rotation);
        self.simulator.loads_mut().teleport_tool(id, pose)
    }

    /// Returns a tool without a path, and its pose at `place`.
    fn interactive_tool(&self, number: usize, place: DVec3) -> Result<(ToolId, ToolPose)> {
        let tools = &self.time_dependent_loads.tools;
        let tool = tools.get(number).filter(|t| !t.moves());
        let id = tool.ok_or_else(|| no_tool(number))?.id;
        // To the bit: a body under a tool that stays does not wake.
        let pose = ToolPose {
            position: place.to_array(),
            ..self.simulator.loads().tool(id)?
        };
        Ok((id, pose))
    }

    /// Returns the tool of this number.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an unknown tool, or one with a path.
    #[cfg(feature = "identify")]
    pub(crate) fn tool_id(&self, number: usize) -> Result<ToolId> {
        Ok(self.interactive_tool(number, DVec3::ZERO)?.0)
    }

    /// Returns the force of the body on the tool of this number, N.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an unknown tool; otherwise as
    /// [`Contact::tool_forces`].
    ///
    /// [`Contact::tool_forces`]: crate::physics::Contact::tool_forces
    pub fn tool_force(&mut self, number: usize) -> Result<DVec3> {
        let contact = self.simulator.contact();
        let forces = Capability::Tools.require(contact)?.tool_forces()?;
        let force = forces.get(number).map(|on| on.force);
        force.ok_or_else(|| Error::Input(format!("unknown tool {number} (counted from 0)")))
    }
}

impl Stage {
    /// As [`Motion::set_tool_target`].
    ///
    /// # Errors
    /// As [`Motion::set_tool_target`], and [`Error::Input`](crate::Error::Input) for a static body.
    pub fn set_tool_target(&mut self, number: usize, place: DVec3) -> Result<()> {
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        motion.set_tool_target(number, place)
    }

    /// As [`Motion::teleport_tool`].
    ///
    /// # Errors
    /// As [`Stage::set_tool_target`].
    pub fn teleport_tool(&mut self, number: usize, place: DVec3) -> Result<()> {
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        motion.teleport_tool(number, place)
    }

    /// As [`Motion::tool_force`].
    ///
    /// # Errors
    /// As [`Motion::tool_force`], and [`Error::Input`](crate::Error::Input) for a static body.
    pub fn tool_force(&mut self, number: usize) -> Result<DVec3> {
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        motion.tool_force(number)
    }
}

fn no_tool(number: usize) -> Error {
    Error::Input(format!(
        "the scene has no tool {number} (counted from 0) that can be moved interactively: it must have no `path`, `file` and `rotation`"
    ))
}
