//! Contact of a body with tools and with itself.

use super::capability::Capability;
use crate::Result;
use crate::physics::{Reaction, SelfContactSettings, Tool, ToolId};

/// Contact of a body with tools and with itself.
pub trait Contact {
    /// Adds a tool that presses on the body's boundary.
    /// [`Loads::set_tool_target`](crate::physics::Loads::set_tool_target) moves it.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the tool is invalid, or the model or the scheme of
    /// the body does not support contact.
    fn add_tool(&mut self, tool: Tool) -> Result<ToolId>;

    /// The tools, in the order of their addition.
    fn tools(&self) -> &[Tool];

    /// Returns the reaction on each tool in the present configuration: the force, N, and its
    /// moment, N·m, about the origin of the tool's shape. Waits for requested steps.
    ///
    /// # Errors
    /// As [`Simulator::finish`](crate::physics::Simulator::finish).
    fn tool_forces(&mut self) -> Result<Vec<Reaction>>;

    /// Enables self-contact: between parts of the boundary, and within its folds. Returns the
    /// number of boundary faces that intersect others, or belong to parts inside others, in the
    /// present configuration; these are gradually separated and exert no contact forces until they
    /// are free.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a setting is out of range, or the body supports
    /// tools only.
    fn set_self_contact(&mut self, _: SelfContactSettings) -> Result<usize> {
        Err(Capability::SelfContact.unsupported())
    }

    /// The settings of self-contact, if enabled.
    fn self_contact(&self) -> Option<SelfContactSettings> {
        None
    }
}
