//! Reaction forces and moments on the supports of a body.

use super::{Capability, GrabId, GrabMode, Reaction, Simulator};
use crate::{Error, Result};
use glam::DVec3;

/// The constraint of one node.
#[derive(Clone, Debug)]
pub(crate) struct NodalForces {
    /// Node positions, m from the origin of the file's coordinates.
    places: Vec<DVec3>,
    /// Nodal forces, N.
    forces: Vec<DVec3>,
    /// Nodal masses, kg.
    masses: Vec<f64>,
    /// Metres per file unit.
    unit: f64,
}

impl NodalForces {
    /// The forces of `body`, read back; see [`Reactions::nodal_forces`](super::Reactions::nodal_forces).
    ///
    /// # Errors
    /// As [`Reactions::nodal_forces`](super::Reactions::nodal_forces).
    pub fn of(body: &mut dyn Simulator) -> Result<NodalForces> {
        let unit = body.loads().frame_and_unit().1;
        let forces = Capability::NodalForces.require(body.reactions())?;
        let forces = forces.nodal_forces()?;
        let places: Vec<DVec3> = body.positions()?.iter().map(|p| *p * unit).collect();
        if forces.len() != places.len() {
            return Err(Error::Input(format!(
                "the body has forces on {} nodes, but its mesh has {} nodes",
                forces.len(),
                places.len()
            )));
        }
        Ok(NodalForces {
            places,
            forces,
            masses: body.masses().to_vec(),
            unit,
        })
    }

    /// Returns the reaction force and moment on the supports of `nodes`.
    pub fn reaction_on_pins(&self, nodes: &[u32]) -> Reaction {
        let at = nodes.iter().map(|v| *v as usize);
        Reaction::from_point_forces(at.map(|v| (self.forces[v], self.places[v])))
    }

    /// Returns the reaction on the drive of nodes moved with these accelerations (m/s²): their
    /// forces minus m a.
    pub fn reaction_on_motion(&self, nodes: impl IntoIterator<Item = (u32, DVec3)>) -> Reaction {
        Reaction::from_point_forces(nodes.into_iter().map(|(v, acceleration)| {
            let v = v as usize;
            (
                self.forces[v] - self.masses[v] * acceleration,
                self.places[v],
            )
        }))
    }

    /// Returns the reaction on the grab `id` of `body`, whose target has the acceleration
    /// `acceleration`, m/s²: for exactly followed nodes their forces minus m a, for springs the
    /// spring force.
    ///
    /// # Errors
    /// [`Error::Input`] if the grab does not exist.
    pub fn reaction_on_grab(
        &self,
        body: &dyn Simulator,
        id: GrabId,
        acceleration: DVec3,
    ) -> Result<Reaction> {
        let held = body.held_by(id)?;
        Ok(Reaction::from_point_forces(held.into_iter().map(|held| {
            let v = held.node as usize;
            let force = match held.grip {
                GrabMode::Follow => self.forces[v] - self.masses[v] * acceleration,
                GrabMode::Spring { stiffness, limit } => {
                    let pull = stiffness * (self.places[v] - held.place * self.unit);
                    pull.clamp_length_max(limit)
                }
            };
            (force, self.places[v])
        })))
    }
}
