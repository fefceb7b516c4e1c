//! Capabilities that only some bodies have.

use crate::{Error, Result};

/// A capability that only some bodies have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Capability {
    /// Tools that press on the body.
    Tools,
    /// Contact between parts of the boundary.
    SelfContact,
    /// Pressure on the boundary.
    Pressure,
    /// Tets that contract along fibres.
    Muscles,
    /// Nodes whose motion is prescribed.
    PrescribedMotion,
    /// Forces on nodes.
    NodalForces,
    /// Joints between rigid regions.
    Joints,
    /// States that can be saved and restored.
    Checkpoints,
    /// Gradients of quantities by parameters.
    Gradients,
}

impl Capability {
    /// Returns the answer of a simulator that was asked for the capability, such as that of
    /// [`Simulator::contact`](crate::physics::Simulator::contact).
    ///
    /// # Errors
    /// [`Capability::unsupported`] if the body does not have it.
    pub fn require<T>(self, found: Option<T>) -> Result<T> {
        found.ok_or_else(|| self.unsupported())
    }

    /// Returns the error for a body without the capability; it names the engine that has it.
    pub fn unsupported(self) -> Error {
        let subject = match self {
            Capability::Tools => "tools are",
            Capability::SelfContact => "self-contact is",
            Capability::Pressure => "pressure is",
            Capability::Muscles => "muscles are",
            Capability::PrescribedMotion => "prescribed motion of nodes is",
            Capability::NodalForces => {
                return Error::Input(
                    "nodal forces are available for a tet body on the CPU only; use --engine cpu, without [grid] or [cage]".into(),
                );
            }
            Capability::Joints => {
                return Error::Input(
                    "joints are supported by rapier only; use --engine rapier (a build with the feature `rapier`), or remove [[joint]]".into(),
                );
            }
            Capability::Gradients => {
                return Error::Input(
                    "gradients are available for a tet body on the CPU only; use --engine cpu, without [grid] or [cage], and one body in the scene".into(),
                );
            }
            Capability::Checkpoints => {
                return Error::Input(
                    "rapier does not support checkpoints, because its internal state cannot be saved; use --engine cpu, or restart from the beginning".into(),
                );
            }
        };
        Error::Input(format!(
            "{subject} supported for a tet body on the CPU only; use --engine cpu, without [grid] or [cage], and one body in the scene"
        ))
    }
}
