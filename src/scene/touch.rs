//! A scene's grabs and cuts, as time goes on.

use super::picture::Shown;
use super::skin::carrier;
use super::stage::{Actor, Stage};
use super::{CutEntry, GrabEntry, Mover};
use crate::mesh::{Blade, Location, Topology};
use crate::physics::{GrabId, Grip};
use crate::skin::{Skin, SkinColour};
use crate::{Error, Result};
use glam::DVec3;

/// The colour of the walls that cuts lay bare, under a skin.
const WALL: [f32; 3] = [0.55, 0.12, 0.12];

/// A grab of a scene: waiting, holding, or done.
#[derive(Debug)]
pub(super) struct Hand {
    entry: GrabEntry,
    pub(super) grab: Option<GrabId>,
    pub(super) done: bool,
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
    pub(super) cut: Option<f64>,
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

impl Stage {
    /// Cuts the body along `blade` (file units) where it stands now: its springs or tets, and
    /// its skins. Returns whether anything was hit.
    ///
    /// # Errors
    /// [`Error::Input`] for a body that nothing moves; otherwise as
    /// [`Body::cut`](crate::physics::Body::cut) and
    /// [`GridBody::cut`](crate::physics::grid::GridBody::cut).
    pub fn cut(&mut self, blade: &Blade) -> Result<bool> {
        if self.motion().is_none() {
            return Err(Error::Input(
                "what nothing moves cannot be cut: name a solver".into(),
            ));
        }
        if self.motion().is_some_and(|m| m.caged.is_some()) {
            return Err(Error::Input(
                "a mesh that a cage carries cannot be cut; leave [cage] out".into(),
            ));
        }
        self.still = None;
        let pose = match self.journal {
            Some(_) => self.pose_now()?,
            None => None,
        };
        let hit = match &mut self.actor {
            Actor::Posed(_) => false,
            Actor::Moving(motion) => match &mut motion.body {
                Mover::Tets(body, _) => {
                    let cut = body.cut(&mut self.mesh, &mut self.topology, blade)?;
                    for [_, from] in &cut.doubled {
                        self.seen.values.push(self.seen.values[*from as usize]);
                    }
                    let geometry = self.raycaster.geometry_mut();
                    let positions = body.nodes().array();
                    let scalars = self.seen.scalars();
                    geometry.follow(&self.mesh, &self.topology, &cut, positions, scalars)?;
                    self.surface
                        .follow(self.raycaster.geometry(), &self.seen.values)?;
                    !cut.is_empty()
                }
                Mover::Grid(body) => {
                    let cut = body.cut(blade)?;
                    if cut.tets > 0 {
                        let before = std::mem::replace(&mut self.mesh, body.mesh().clone());
                        self.mesh.region_names = before.region_names;
                        self.mesh.length_unit = before.length_unit;
                        for field in before.fields {
                            if field.location == Location::Node {
                                self.mesh.set_field(field)?;
                            }
                        }
                        self.topology = Topology::new(&self.mesh);
                        self.seen = self.scene.seen(&self.mesh, &self.topology)?;
                        let (gpu, seen) = (&self.gpu, &self.seen);
                        (self.raycaster, self.surface) = self.scene.painters(
                            gpu,
                            &self.mesh,
                            &self.topology,
                            seen,
                            body.nodes(),
                        )?;
                    }
                    cut.springs > 0
                }
            },
        };
        if hit && let (Some(journal), Some(pose)) = (&mut self.journal, pose) {
            journal.note(blade, pose);
        }
        if hit && !self.skins.is_empty() {
            let carrier = carrier(&self.gpu, &self.mesh, &mut self.actor)?;
            self.skins.truncate(self.scene.skin.len());
            let mut walls = Vec::new();
            for skin in &mut self.skins {
                walls = skin.follow_cut(&carrier, blade)?.walls;
            }
            if self.shown == Shown::Skin && !walls.is_empty() {
                let mut walls = Skin::bare(&self.gpu, &carrier, Some(&walls))?;
                let colour = self.scene.skin[0].wall.unwrap_or(WALL);
                walls.set_colour(&SkinColour::Plain(colour))?;
                self.skins.push(walls);
            }
        }
        Ok(hit)
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
