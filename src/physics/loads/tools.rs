//! The targets of tools.

use super::Loads;
use crate::physics::contact::{ToolId, ToolPose, check_pose};
use crate::{Error, Result};

impl Loads {
    /// Adds a tool in a pose. The engine must support tools:
    /// [`Contact::add_tool`](crate::physics::Contact::add_tool).
    pub(in crate::physics) fn add_tool(&mut self, pose: ToolPose) -> ToolId {
        self.tools.push((pose, 0));
        self.versions.tools += 1;
        self.versions.any += 1;
        ToolId(self.tools.len() - 1)
    }

    /// The targets of the tools, and how often each was teleported.
    pub(in crate::physics) fn tools(&self) -> &[(ToolPose, u64)] {
        &self.tools
    }

    /// The target pose of a tool at the end of the next step, or its present pose.
    ///
    /// # Errors
    /// [`Error::Input`] if the tool does not exist.
    pub fn tool(&self, id: ToolId) -> Result<ToolPose> {
        let tool = self.tools.get(id.0).map(|tool| tool.0);
        tool.ok_or_else(|| Error::Input(format!("this body has no tool {}", id.0)))
    }

    /// Sets the target `pose` of a tool: it moves there along a straight path in the next step and
    /// pushes obstacles away.
    ///
    /// # Errors
    /// [`Error::Input`] if the tool does not exist, or the pose is not finite.
    pub fn set_tool_target(&mut self, id: ToolId, pose: ToolPose) -> Result<()> {
        check_pose(&pose)?;
        if self.tool(id)? != pose {
            self.tools[id.0].0 = pose;
            self.versions.tools += 1;
            self.versions.any += 1;
        }
        Ok(())
    }

    /// Teleports a tool to `pose`, ignoring obstacles; points then inside it are pushed out.
    ///
    /// # Errors
    /// As [`Loads::set_tool_target`].
    pub fn teleport_tool(&mut self, id: ToolId, pose: ToolPose) -> Result<()> {
        check_pose(&pose)?;
        self.tool(id)?;
        self.tools[id.0] = (pose, self.tools[id.0].1 + 1);
        self.versions.tools += 1;
        self.versions.any += 1;
        Ok(())
    }
}
