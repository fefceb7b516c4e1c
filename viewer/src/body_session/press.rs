//! The finger that presses on the body, and grabs.

use super::{BodySession, still};
use glam::DVec3;
use palpate::mesh::{TetMesh, Topology};
use palpate::physics::GrabMode;
use palpate::press::contact_problem;
use palpate::render::Pick;
use palpate::{Error, Result};
use web_time::Instant;

/// Default finger radius relative to the body's diagonal, and its minimum in boundary edge lengths.
const RADIUS: f64 = 0.04;
const EDGES: f64 = 1.5;
/// Maximum advance of the finger per step, relative to its radius.
const MAX_STEP_ADVANCE: f64 = 0.06;
/// Distance above the surface at which a retracted finger is parked, relative to its radius.
const RETRACT_DISTANCE: f64 = 0.5;
/// Distance of the parked finger from the body's centre, in body diagonals.
const PARKED_DISTANCE: f64 = 20.0;
/// Radius of a grab, relative to the finger's radius.
const GRAB_RADIUS: f64 = 1.0;

/// Measurement of one step of a press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Simulated time since the body was opened, s.
    pub time_s: f64,
    /// Indentation depth of the fingertip from first contact, m.
    pub depth_m: f64,
    /// Force of the body on the finger along its path, N.
    pub force_n: f64,
}

/// A finger that presses or retracts.
pub(super) struct Press {
    /// Contact point and outward normal.
    spot: DVec3,
    out: DVec3,
    /// Current and target depth, in file units.
    gone: f64,
    goal: f64,
    /// Depth before the last step, and maximum depth.
    before: f64,
    most: f64,
    /// Whether the finger is being retracted.
    ends: bool,
    /// Whether a step was requested at the current depth.
    stepped: bool,
}

impl Press {
    /// Whether the finger is on its way, or being retracted.
    pub fn is_moving(&self) -> bool {
        self.gone != self.goal || self.ends
    }
}

impl BodySession {
    /// Returns why the body cannot be pressed on, if so.
    pub fn cannot_press(&self) -> Option<&str> {
        self.finger.as_ref().err().map(String::as_str)
    }

    /// Places the finger on the body at `pick`; `sight` is the viewing direction.
    ///
    /// # Errors
    /// [`Error::Input`] if the body cannot be pressed on.
    pub fn press(&mut self, pick: &Pick, sight: DVec3) -> Result<()> {
        let finger = *self
            .finger
            .as_ref()
            .map_err(|why| Error::Input(why.clone()))?;
        let out = self.outward(pick, sight)?;
        self.stage
            .teleport_tool(finger, pick.point + 1.02 * self.radius * out)?;
        self.samples.clear();
        self.failed = false;
        self.stirred = true;
        self.press = Some(Press {
            spot: pick.point,
            out,
            gone: -0.02 * self.radius,
            goal: 0.0,
            before: -0.02 * self.radius,
            most: 0.5 * self.diagonal(),
            ends: false,
            stepped: false,
        });
        Ok(())
    }

    /// Sets the target depth of the finger, in file units.
    pub fn press_to(&mut self, depth: f64) {
        if let Some(press) = self.press.as_mut().filter(|p| !p.ends) {
            let goal = depth.clamp(0.0, press.most.max(0.0));
            if goal != std::mem::replace(&mut press.goal, goal) {
                self.asked[0].get_or_insert_with(Instant::now);
            }
        }
    }

    /// Returns the target depth, in file units; `None` without a press.
    pub fn depth(&self) -> Option<f64> {
        self.press.as_ref().filter(|p| !p.ends).map(|p| p.goal)
    }

    /// Returns the force of the last step of a press, N; `None` without a press.
    pub fn force(&self) -> Option<f64> {
        let last = self.samples.last().filter(|_| self.press.is_some());
        last.map(|sample| sample.force_n)
    }

    /// Returns why the force of the press has no meaning at present; `None` without a press.
    pub fn press_warning(&self) -> Option<String> {
        self.press.as_ref()?;
        let samples: Vec<[f64; 2]> = self
            .samples
            .iter()
            .map(|s| [s.depth_m, s.force_n])
            .collect();
        let problem = contact_problem(&samples).map(|problem| problem.to_string());
        problem.or_else(|| self.site_warning.clone())
    }

    /// Retracts the finger.
    pub fn retract(&mut self) {
        if let Some(press) = &mut self.press {
            press.goal = -RETRACT_DISTANCE * self.radius;
            press.ends = true;
        }
    }

    /// Returns the outward normal around a pick, averaged over the boundary faces within the
    /// finger's radius; notes whether they are larger than the finger.
    fn outward(&mut self, pick: &Pick, sight: DVec3) -> Result<DVec3> {
        let x = self.stage.drawn_positions()?;
        let (mesh, topology) = match self.stage.motion() {
            Some(motion) => (self.stage.mesh(), motion.simulator.topology()),
            None => return Ok(-sight),
        };
        let (mut out, mut edges, mut count) = (DVec3::ZERO, 0.0, 0);
        for face in &topology.boundary {
            let [a, b, c] = topology.boundary_nodes(mesh, *face).map(|v| x[v as usize]);
            let middle = (a + b + c) / 3.0;
            let normal = (b - a).cross(c - a);
            // Skip back faces: in thin parts both sides are within the radius.
            if middle.distance(pick.point) <= self.radius && normal.dot(sight) < 0.0 {
                out += normal;
                edges += (a.distance(b) + b.distance(c) + c.distance(a)) / 3.0;
                count += 1;
            }
        }
        let coarse = count == 0 || self.radius < edges / f64::from(count);
        self.site_warning = coarse.then(|| {
            "force not valid: the finger is smaller than the faces beneath it; use a larger finger or a finer mesh".into()
        });
        Ok(out.normalize_or(-sight))
    }

    /// Moves the finger towards its target depth by as much as a step allows.
    pub(super) fn advance_finger(&mut self) -> Result<()> {
        if let (Some(press), Ok(finger)) = (&mut self.press, &self.finger) {
            let most = MAX_STEP_ADVANCE * self.radius;
            // Retraction is faster than pressing.
            let by = (press.goal - press.gone).clamp(-8.0 * most, most);
            press.before = press.gone;
            press.gone += by;
            press.stepped = true;
            let place = press.spot + (self.radius - press.gone) * press.out;
            self.stage.set_tool_target(*finger, place)?;
            self.asked[1] = self.asked[0].take();
        }
        Ok(())
    }

    /// Retracts the finger to its last position after a failed contact step. Returns whether there
    /// is a finger.
    pub(super) fn backs_off(&mut self) -> bool {
        self.under_way = false;
        let radius = self.radius;
        let (Some(press), Ok(finger)) = (&mut self.press, &self.finger) else {
            return false;
        };
        if press.gone <= press.before {
            return false;
        }
        press.gone = press.before;
        press.goal = press.goal.min(press.gone);
        press.most = press.gone;
        press.stepped = false;
        let place = press.spot + (radius - press.gone) * press.out;
        self.stirred = true;
        self.stage.set_tool_target(*finger, place).is_ok()
    }

    /// Records a sample and parks a retracted finger; call between two steps.
    pub(super) fn settle(&mut self) -> Result<()> {
        let (Some(press), Ok(finger)) = (&mut self.press, &self.finger) else {
            return Ok(());
        };
        let finger = *finger;
        if std::mem::take(&mut press.stepped) {
            let (depth, out) = (press.gone, press.out);
            let force = self.stage.tool_force(finger)?.dot(out);
            self.samples.push(Sample {
                time_s: self.stage.time(),
                depth_m: depth * self.unit,
                force_n: force,
            });
        }
        if press.ends && press.gone <= press.goal {
            self.press = None;
            self.stage.teleport_tool(finger, put_away(self.bounds))?;
            self.version += 1;
        }
        Ok(())
    }

    /// Grabs the nodes around `pick`.
    ///
    /// # Errors
    /// [`Error::Input`] for a static body, or if there are no nodes to grab.
    pub fn grab(&mut self, pick: &Pick) -> Result<()> {
        let reach = GRAB_RADIUS * self.radius;
        let motion = self.stage.motion_mut().ok_or_else(still)?;
        self.failed = false;
        let id = motion.simulator.grab(pick.point, reach, GrabMode::Follow)?;
        self.grab = Some((id, pick.point, DVec3::ZERO));
        Ok(())
    }

    /// Moves the grabbed nodes by `moved` from their initial position, in file units.
    ///
    /// # Errors
    /// The errors of [`Simulator::set_target`](palpate::physics::Simulator::set_target).
    pub fn pull(&mut self, moved: DVec3) -> Result<()> {
        if let (Some((id, from, last)), Some(motion)) = (&mut self.grab, self.stage.motion_mut())
            && *last != moved
        {
            motion.simulator.set_target(*id, *from + moved)?;
            *last = moved;
            self.stirred = true;
        }
        Ok(())
    }

    /// Releases the grab.
    ///
    /// # Errors
    /// The errors of [`Simulator::release`](palpate::physics::Simulator::release).
    pub fn release(&mut self) -> Result<()> {
        if let (Some((id, ..)), Some(motion)) = (self.grab.take(), self.stage.motion_mut()) {
            motion.simulator.release(id)?;
            self.stirred = true;
        }
        Ok(())
    }
}

/// Returns the parking position of a finger for a body with these bounds.
pub(super) fn put_away((low, high): (DVec3, DVec3)) -> DVec3 {
    0.5 * (low + high) + DVec3::splat(PARKED_DISTANCE * low.distance(high))
}

/// Returns the default finger radius for a body.
pub(super) fn fitting_radius(mesh: &TetMesh) -> f64 {
    let (low, high) = mesh.bounds();
    let topology = Topology::new(mesh);
    let edges = topology.boundary.iter().map(|face| {
        let [a, b, c] = topology
            .boundary_nodes(mesh, *face)
            .map(|v| mesh.nodes[v as usize]);
        (a.distance(b) + b.distance(c) + c.distance(a)) / 3.0
    });
    let edge = edges.sum::<f64>() / topology.boundary.len().max(1) as f64;
    (RADIUS * low.distance(high)).max(EDGES * edge)
}
