//! A scene's grabs, as time goes on.

use super::GrabEntry;
use super::path::{acceleration, along, check};
use crate::physics::{GrabId, Grip, Simulator};
use crate::{Error, Result};
use glam::DVec3;

/// A grab of a scene: waiting, holding, or done.
#[derive(Debug)]
pub(super) struct Attachment {
    entry: GrabEntry,
    pub(super) grab: Option<GrabId>,
    pub(super) done: bool,
}

impl Attachment {
    pub fn new(entry: &GrabEntry) -> Result<Attachment> {
        check(&entry.path, 1, "grab")?;
        if entry.limit.is_some() && entry.spring.is_none() {
            return Err(Error::Input(
                "a grab has a `limit` of force without a `spring`; nodes that follow exactly have none".into(),
            ));
        }
        Ok(Attachment {
            entry: entry.clone(),
            grab: None,
            done: false,
        })
    }

    /// Its name, where it has one.
    pub fn name(&self) -> Option<&str> {
        self.entry.name.as_deref()
    }

    /// The acceleration of its target over the step of length `dt` that ended at `time`, file units
    /// a second².
    pub fn acceleration(&self, time: f64, dt: f64) -> DVec3 {
        acceleration(|time| along(&self.entry.path, time), time, dt)
    }

    /// Lets go of what it holds.
    pub fn let_go(&mut self, body: &mut dyn Simulator) -> Result<()> {
        if let Some(grab) = self.grab.take() {
            body.release(grab)?;
        }
        Ok(())
    }

    /// Takes hold, moves or lets go, as the path has it at `time`.
    pub fn act(&mut self, body: &mut dyn Simulator, time: f64) -> Result<()> {
        let begins = self.entry.path[0][0];
        if self.done || time < begins {
            return Ok(());
        }
        if self.entry.release.is_some_and(|release| time >= release) {
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
                let grip = match self.entry.spring {
                    None => Grip::Follow,
                    Some(stiffness) => Grip::Spring {
                        stiffness,
                        limit: self.entry.limit.unwrap_or(f64::INFINITY),
                    },
                };
                let grab = body.grab(at, self.entry.radius, grip)?;
                self.grab = Some(grab);
                grab
            }
        };
        body.set_target(grab, at + along(&self.entry.path, time))
    }
}
