//! A scene's grabs, as time goes on.

use super::{GrabEntry, Mover};
use crate::physics::{GrabId, Grip};
use crate::{Error, Result};
use glam::DVec3;

/// A grab of a scene: waiting, holding, or done.
#[derive(Debug)]
pub(super) struct Hand {
    entry: GrabEntry,
    grab: Option<GrabId>,
    done: bool,
}

impl Hand {
    pub fn new(entry: &GrabEntry) -> Result<Hand> {
        let ordered = entry.path.windows(2).all(|w| w[0][0] < w[1][0]);
        let finite = entry.path.iter().flatten().all(|x| x.is_finite());
        if entry.path.is_empty() || !ordered || !finite {
            return Err(Error::Input(
                "the path of a grab should be a list of [time, x, y, z], the times increasing"
                    .into(),
            ));
        }
        if entry.limit.is_some() && entry.spring.is_none() {
            return Err(Error::Input(
                "a grab has a `limit` of force without a `spring`; nodes that follow exactly have none".into(),
            ));
        }
        Ok(Hand {
            entry: entry.clone(),
            grab: None,
            done: false,
        })
    }

    /// Takes hold, moves or lets go, as the path has it at `time`.
    pub fn act(&mut self, body: &mut Mover, time: f64) -> Result<()> {
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

/// Where a path is at `time`.
fn along(path: &[[f64; 4]], time: f64) -> DVec3 {
    let place = |p: &[f64; 4]| DVec3::new(p[1], p[2], p[3]);
    let after = path.partition_point(|p| p[0] <= time);
    match (
        after.checked_sub(1).and_then(|n| path.get(n)),
        path.get(after),
    ) {
        (Some(a), Some(b)) => place(a).lerp(place(b), (time - a[0]) / (b[0] - a[0])),
        (Some(only), None) | (None, Some(only)) => place(only),
        (None, None) => DVec3::ZERO,
    }
}
