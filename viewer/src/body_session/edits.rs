//! Cuts and pins by hand, and their undoing.

use super::{BodySession, still};
use crate::body_edits::{BodyEdit, BodyEditHistory, BodySnapshot};
use glam::DVec3;
use palpate::Result;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, TetMesh};
use palpate::render::Pick;
use palpate::scene::Scene;
use std::sync::Arc;

impl BodySession {
    /// Requests a cut along `blade`, after `edits` scene edits. The cut is performed once no step is
    /// running, and its result is reported in `remark`.
    pub fn cut(&mut self, blade: Blade, edits: usize) {
        self.blade = Some((blade, edits, false));
    }

    /// Performs the requested cut; call between two steps.
    pub(super) fn cut_asked(&mut self) -> Result<()> {
        let Some((blade, edits, again)) = self.blade.take() else {
            return Ok(());
        };
        self.version += 1;
        let before = self.before()?;
        self.remark = Some(match self.stage.cut(&blade)? {
            true => {
                match before {
                    Some(before) => {
                        let touch = BodyEdit::Cut(blade, Box::new(before));
                        self.edits.push(edits, touch, again);
                    }
                    // Earlier edits cannot be undone either.
                    None => self.edits = BodyEditHistory::default(),
                }
                format!("cut; {} tets in the mesh", self.stage.mesh().tets.len())
            }
            false => "the stroke cut no tets; draw it across the body".into(),
        });
        self.stirred = true;
        if let Some(motion) = self.stage.motion_mut() {
            motion.wake();
        }
        Ok(())
    }

    /// Returns the state between two steps; `None` if the simulator has no checkpoints.
    fn before(&self) -> Result<Option<BodySnapshot>> {
        let Some(motion) = self.stage.motion().filter(|m| m.has_state()) else {
            return Ok(None);
        };
        let pinned = motion.simulator.loads().pinned().iter().enumerate();
        let pinned = pinned.filter_map(|(v, pinned)| pinned.then_some(v as u32));
        Ok(Some(BodySnapshot {
            pinned: pinned.collect(),
            checkpoint: self.stage.checkpoint(&[])?,
        }))
    }

    /// Releases the nodes that the last edit pinned.
    ///
    /// # Errors
    /// [`Error::Input`](palpate::Error::Input) for a static body.
    pub fn undo_pins(&mut self) -> Result<()> {
        let Some(touch) = self.edits.undo() else {
            return Ok(());
        };
        let BodyEdit::Pins(nodes) = touch.as_ref() else {
            return Ok(());
        };
        let motion = self.stage.motion_mut().ok_or_else(still)?;
        let loads = motion.simulator.loads_mut();
        let pinned = loads.pinned().iter().enumerate();
        let left = pinned.filter_map(|(v, pinned)| pinned.then_some(v as u32));
        let left: Vec<u32> = left.filter(|v| !nodes.contains(v)).collect();
        loads.unpin_all();
        motion.simulator.pin_nodes(&left)?;
        self.stirred = true;
        Ok(())
    }

    /// Redoes the last undone edit, after `edits` scene edits.
    ///
    /// # Errors
    /// The errors of [`BodySession::hold`].
    pub fn redo(&mut self, edits: usize) -> Result<()> {
        match self.edits.redo().as_deref() {
            Some(BodyEdit::Cut(blade, _)) => self.blade = Some((blade.clone(), edits, true)),
            Some(BodyEdit::Pins(nodes)) => {
                let motion = self.stage.motion_mut().ok_or_else(still)?;
                motion.simulator.pin_nodes(nodes)?;
                self.edits.push(edits, BodyEdit::Pins(nodes.clone()), true);
                self.stirred = true;
            }
            None => {}
        }
        Ok(())
    }

    /// Pins nodes at their current positions, after `edits` scene edits; `begins` starts a new
    /// stroke. Returns how many of them were not pinned before.
    ///
    /// # Errors
    /// [`Error::Input`](palpate::Error::Input) for a static body.
    pub fn hold(&mut self, nodes: &[u32], edits: usize, begins: bool) -> Result<usize> {
        let motion = self.stage.motion_mut().ok_or_else(still)?;
        let pinned = motion.simulator.loads().pinned();
        let free = |v: &u32| pinned.get(*v as usize) == Some(&false);
        let fresh: Vec<u32> = nodes.iter().copied().filter(free).collect();
        motion.simulator.pin_nodes(&fresh)?;
        if !fresh.is_empty() {
            match begins {
                true => {
                    let count = fresh.len();
                    self.edits.push(edits, BodyEdit::Pins(fresh), false);
                    return Ok(count);
                }
                false => self.edits.extend(edits, &fresh),
            }
        }
        Ok(fresh.len())
    }

    /// Pins the nodes within the finger's radius of `pick`, as [`BodySession::hold`].
    ///
    /// # Errors
    /// [`Error::Input`](palpate::Error::Input) for a static body.
    pub fn pin(&mut self, pick: &Pick, edits: usize, begins: bool) -> Result<usize> {
        let radius = self.radius;
        let x = self.stage.drawn_positions()?;
        let near = |(v, x): (usize, &DVec3)| (x.distance(pick.point) <= radius).then_some(v as u32);
        let mut nodes: Vec<u32> = x.iter().enumerate().filter_map(near).collect();
        if nodes.is_empty() {
            nodes.push(pick.node);
        }
        self.hold(&nodes, edits, begins)
    }
}

/// Data to rebuild a body on another thread.
pub struct RebuildRequest {
    made: Scene,
    mesh: Arc<TetMesh>,
    radius: f64,
    touches: BodyEditHistory,
}

impl RebuildRequest {
    /// Creates the request to undo the last edit of a body.
    pub fn of(show: &BodySession) -> RebuildRequest {
        let mut touches = show.edits.clone();
        touches.undo();
        RebuildRequest {
            made: show.made.clone(),
            mesh: show.mesh.clone(),
            radius: show.radius,
            touches,
        }
    }

    /// Rebuilds the body in the state `before`.
    ///
    /// # Errors
    /// As [`BodySession::new`] and [`Stage::resume`](palpate::scene::Stage::resume).
    pub fn rebuild(self, gpu: &Gpu, before: &BodySnapshot) -> Result<BodySession> {
        let mut show = BodySession::new(gpu, &self.made, self.mesh, Some(self.radius))?;
        show.stage.resume(&before.checkpoint)?;
        if let Some(motion) = show.stage.motion_mut() {
            motion.simulator.pin_nodes(&before.pinned)?;
        }
        show.edits = self.touches;
        show.notes = vec!["cut undone".into()];
        Ok(show)
    }
}
