//! The forces on all nodes of a body, of which reactions are taken.

use super::{GrabId, GrabMode, Reaction, Simulator};
use crate::{Error, Result};
use glam::DVec3;

/// A body where it stands, with the forces on its nodes: what reactions are taken from.
#[derive(Clone, Debug)]
pub struct NodalForces {
    /// Of every node, m from the origin of the file's coordinates.
    places: Vec<DVec3>,
    /// N.
    forces: Vec<DVec3>,
    /// kg.
    masses: Vec<f64>,
    /// Metres in a file unit.
    unit: f64,
}

impl NodalForces {
    /// Of `body`, read back; see [`Simulator::forces`].
    ///
    /// # Errors
    /// As [`Simulator::forces`].
    pub fn of(body: &mut dyn Simulator) -> Result<NodalForces> {
        let unit = body.loads().frame_and_unit().1;
        let forces = body.forces()?;
        let places: Vec<DVec3> = body.positions()?.iter().map(|p| *p * unit).collect();
        if forces.len() != places.len() {
            return Err(Error::Input(format!(
                "forces on {} nodes are known of a mesh of {}",
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

    /// What the body exerts on that which holds `nodes` still.
    pub fn reaction_on_pins(&self, nodes: &[u32]) -> Reaction {
        let at = nodes.iter().map(|v| *v as usize);
        Reaction::from_point_forces(at.map(|v| (self.forces[v], self.places[v])))
    }

    /// What the body exerts on that which moves nodes with these accelerations, m/s²: their forces
    /// less m a.
    pub fn reaction_on_motion(&self, nodes: impl IntoIterator<Item = (u32, DVec3)>) -> Reaction {
        Reaction::from_point_forces(nodes.into_iter().map(|(v, acceleration)| {
            let v = v as usize;
            (
                self.forces[v] - self.masses[v] * acceleration,
                self.places[v],
            )
        }))
    }

    /// What the body exerts on the grab `id` of `body`, whose target is accelerated by
    /// `acceleration`, m/s²: of nodes that follow exactly their forces less m a; of springs the
    /// force of the springs.
    ///
    /// # Errors
    /// [`Error::Input`] for a grab that is not there.
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
