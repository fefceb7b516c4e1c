//! Time-dependent grabs of a scene.

use super::GrabEntry;
use super::trajectory::{check, position_at, second_difference};
use crate::physics::{GrabId, GrabMode, Simulator};
use crate::{Error, Result};
use glam::DVec3;

/// A grab of a scene: waiting, active or released.
#[derive(Debug)]
pub(super) struct ActiveGrab {
    entry: GrabEntry,
    pub(super) grab: Option<GrabId>,
    pub(super) done: bool,
}

impl ActiveGrab {
    pub fn new(entry: &GrabEntry) -> Result<ActiveGrab> {
        check(&entry.path, 1, "grab")?;
        if entry.max_force.is_some() && entry.spring_stiffness.is_none() {
            return Err(Error::Input(
                "a grab has `max_force` without `spring_stiffness`: a prescribed displacement has no force limit; set `spring_stiffness`, or remove `max_force`".into(),
            ));
        }
        Ok(ActiveGrab {
            entry: entry.clone(),
            grab: None,
            done: false,
        })
    }

    /// Returns its name, or one from its number, counted from 0.
    pub fn name_or_number(&self, number: usize) -> String {
        let name = self.entry.name.clone();
        name.unwrap_or_else(|| format!("grab{}", number + 1))
    }

    /// Returns the acceleration of its target over the step of length `dt` that ended at `time`, in
    /// file units/s².
    pub fn acceleration(&self, time: f64, dt: f64) -> DVec3 {
        second_difference(|time| position_at(&self.entry.path, time), time, dt)
    }

    /// Releases the grabbed nodes.
    pub fn release(&mut self, body: &mut dyn Simulator) -> Result<()> {
        if let Some(grab) = self.grab.take() {
            body.release(grab)?;
        }
        Ok(())
    }

    /// Starts, moves or releases the grab according to its path at `time`.
    pub fn update(&mut self, body: &mut dyn Simulator, time: f64) -> Result<()> {
        let begins = self.entry.path[0][0];
        if self.done || time < begins {
            return Ok(());
        }
        if self
            .entry
            .release_time
            .is_some_and(|release| time >= release)
        {
            self.done = true;
            if let Some(grab) = self.grab.take() {
                body.release(grab)?;
            }
            return Ok(());
        }
        let at = DVec3::from(self.entry.at);
        let grab = match self.grab {
            Some(grab) => grab,
            None => {
                let grip = match self.entry.spring_stiffness {
                    None => GrabMode::Follow,
                    Some(stiffness) => GrabMode::Spring {
                        stiffness,
                        limit: self.entry.max_force.unwrap_or(f64::INFINITY),
                    },
                };
                let grab = body.grab(at, self.entry.radius, grip)?;
                self.grab = Some(grab);
                grab
            }
        };
        body.set_target(grab, at + position_at(&self.entry.path, time))
    }
}
