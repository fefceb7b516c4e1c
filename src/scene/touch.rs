//! A scene's grabs and cuts, as time goes on.

use super::{CutEntry, GrabEntry, Mover};
use crate::mesh::Blade;
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
        check(&entry.path, 1, "grab")?;
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

    /// Lets go of what it holds.
    pub fn let_go(&mut self, body: &mut Mover) -> Result<()> {
        if let Some(grab) = self.grab.take() {
            body.release(grab)?;
        }
        Ok(())
    }

    /// Takes hold of what is at least within `reach`, moves or lets go, as the path has it at
    /// `time`.
    pub fn act(&mut self, body: &mut Mover, time: f64, reach: f64) -> Result<()> {
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
                let grab = body.grab(at, self.entry.radius.max(reach), grip)?;
                self.grab = Some(grab);
                grab
            }
        };
        body.set_target(grab, at + along(&self.entry.path, time))
    }
}

/// How often a cut is made on a blade's way.
const CUTS: f64 = 16.0;

/// A blade of a scene, on its way.
#[derive(Debug)]
pub(super) struct Knife {
    entry: CutEntry,
    /// The time up to which it has cut.
    cut: Option<f64>,
}

impl Knife {
    pub fn new(entry: &CutEntry) -> Result<Knife> {
        check(&entry.path, 2, "cut")?;
        let knife = Knife {
            entry: entry.clone(),
            cut: None,
        };
        // A blade that sweeps nothing is an error at once, not in the middle of a simulation.
        let [begin, end] = knife.span();
        Blade::swept(&[knife.edge(begin), knife.edge(end)])?;
        Ok(knife)
    }

    fn span(&self) -> [f64; 2] {
        let times = |p: Option<&[f64; 4]>| p.map_or(0.0, |p| p[0]);
        [
            times(self.entry.path.first()),
            times(self.entry.path.last()),
        ]
    }

    /// The time between two cuts, while it cuts at `time`; none before and after.
    pub fn pace(&self, time: f64) -> Option<f64> {
        let [begin, end] = self.span();
        (self.cut.is_none_or(|cut| cut < end) && time <= end).then(|| {
            let pace = (end - begin) / CUTS;
            if time < begin {
                pace.max(begin - time)
            } else {
                pace
            }
        })
    }

    /// What the blade has swept since the last time it was asked; none where that is nothing.
    pub fn swept(&mut self, time: f64) -> Option<Blade> {
        let [begin, end] = self.span();
        let from = self.cut.unwrap_or(begin);
        let to = time.min(end);
        if to <= from {
            return None;
        }
        self.cut = Some(to);
        let path = self.entry.path.iter().map(|p| p[0]);
        let between = path.filter(|t| *t > from && *t < to);
        let times: Vec<f64> = [from].into_iter().chain(between).chain([to]).collect();
        let edges: Vec<[DVec3; 2]> = times.iter().map(|t| self.edge(*t)).collect();
        // A blade at rest sweeps nothing.
        Blade::swept(&edges).ok()
    }

    fn edge(&self, time: f64) -> [DVec3; 2] {
        let moved = along(&self.entry.path, time);
        self.entry.edge.map(|end| DVec3::from(end) + moved)
    }
}

fn check(path: &[[f64; 4]], least: usize, what: &str) -> Result<()> {
    let ordered = path.windows(2).all(|w| w[0][0] < w[1][0]);
    let finite = path.iter().flatten().all(|x| x.is_finite());
    if path.len() < least || !ordered || !finite {
        return Err(Error::Input(format!(
            "the path of a {what} should be a list of at least {least} [time, x, y, z], the times increasing"
        )));
    }
    Ok(())
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
