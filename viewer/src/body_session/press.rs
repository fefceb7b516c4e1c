//! The finger that presses on the body, and grabs.

use super::{BodySession, still};
use glam::DVec3;
use palpate::physics::GrabMode;
use palpate::press::{PressSample, PressSession};
use palpate::render::Pick;
use palpate::{Error, Result};
use web_time::Instant;

/// Distance above the surface at which a retracted finger is parked, relative to its radius.
const RETRACT_DISTANCE: f64 = 0.5;
/// Radius of a grab, relative to the finger's radius.
const GRAB_RADIUS: f64 = 1.0;

/// A finger that presses or retracts; depths in file units.
pub(super) struct Press {
    /// Target depth.
    target: f64,
    /// Depth before the last step, and maximum depth.
    previous: f64,
    most: f64,
    is_retracting: bool,
    /// Whether a step was requested at the current depth.
    stepped: bool,
}

impl BodySession {
    /// Returns why the body cannot be pressed on, if so.
    pub fn cannot_press(&self) -> Option<&str> {
        self.fingertip.as_ref().err().map(String::as_str)
    }

    /// Places the finger on the body at `pick`.
    ///
    /// # Errors
    /// [`Error::Input`] if the body cannot be pressed on.
    pub fn press(&mut self, pick: &Pick) -> Result<()> {
        let diagonal = self.diagonal();
        let session = self.fingertip.as_mut();
        let session = session.map_err(|why| Error::Input(why.clone()))?;
        session.touch(&mut self.stage, pick.point)?;
        self.failed = false;
        self.stirred = true;
        self.press_error = super::PressErrorEstimate::default();
        self.press = Some(Press {
            target: 0.0,
            previous: session.depth().unwrap_or(0.0),
            most: 0.5 * diagonal,
            is_retracting: false,
            stepped: false,
        });
        Ok(())
    }

    /// Whether the finger is on its way, or being retracted.
    pub(super) fn finger_moves(&self) -> bool {
        let depth = self.fingertip.as_ref().ok().and_then(PressSession::depth);
        let moves = |press: &Press| depth != Some(press.target) || press.is_retracting;
        self.press.as_ref().is_some_and(moves)
    }

    /// Sets the target depth of the finger, in file units.
    pub fn press_to(&mut self, depth: f64) {
        if let Some(press) = self.press.as_mut().filter(|p| !p.is_retracting) {
            let target = depth.clamp(0.0, press.most.max(0.0));
            if target != std::mem::replace(&mut press.target, target) {
                self.asked[0].get_or_insert_with(Instant::now);
            }
        }
    }

    /// Returns the target depth, in file units; `None` without a press.
    pub fn depth(&self) -> Option<f64> {
        let press = self.press.as_ref().filter(|p| !p.is_retracting);
        press.map(|p| p.target)
    }

    /// Returns the samples since the last press began.
    pub fn samples(&self) -> &[PressSample] {
        self.fingertip.as_ref().map_or(&[], PressSession::samples)
    }

    /// Returns the force of the last step of a press, N; `None` without a press.
    pub fn force(&self) -> Option<f64> {
        let last = self.samples().last().filter(|_| self.press.is_some());
        last.map(|sample| sample.force_n)
    }

    /// Returns why the force of the press has no meaning at present; `None` without a press.
    pub fn press_warning(&self) -> Option<String> {
        self.fingertip.as_ref().ok()?.problem()
    }

    /// Retracts the finger.
    pub fn retract(&mut self) {
        if let Some(press) = &mut self.press {
            press.target = -RETRACT_DISTANCE * self.radius;
            press.is_retracting = true;
        }
    }

    /// Moves the finger towards its target depth by as much as a step allows.
    pub(super) fn advance_finger(&mut self) -> Result<()> {
        if let (Some(press), Ok(session), Some(motion)) = (
            &mut self.press,
            &mut self.fingertip,
            self.stage.motion_mut(),
        ) {
            press.previous = session.depth().unwrap_or(press.previous);
            press.stepped = true;
            session.set_target_depth(motion, session.next_depth(press.target))?;
            self.asked[1] = self.asked[0].take();
        }
        Ok(())
    }

    /// Moves the finger back to its last position after a failed contact step. Returns whether
    /// there is a finger.
    pub(super) fn backs_off(&mut self) -> bool {
        self.under_way = false;
        let (Some(press), Ok(session), Some(motion)) = (
            &mut self.press,
            &mut self.fingertip,
            self.stage.motion_mut(),
        ) else {
            return false;
        };
        if session.depth().is_none_or(|depth| depth <= press.previous) {
            return false;
        }
        press.target = press.target.min(press.previous);
        press.most = press.previous;
        press.stepped = false;
        self.stirred = true;
        session.set_target_depth(motion, press.previous).is_ok()
    }

    /// Records a sample and parks a retracted finger; call between two steps.
    pub(super) fn settle(&mut self) -> Result<()> {
        let (Some(press), Ok(session), Some(motion)) = (
            &mut self.press,
            &mut self.fingertip,
            self.stage.motion_mut(),
        ) else {
            return Ok(());
        };
        if std::mem::take(&mut press.stepped) {
            let phase = if press.is_retracting {
                "unload"
            } else {
                "load"
            };
            session.measure(motion, phase)?;
        }
        if press.is_retracting && session.depth().is_none_or(|depth| depth <= press.target) {
            self.press = None;
            session.park(motion)?;
            self.version += 1;
        }
        Ok(())
    }

    /// Takes the finger away after a failure.
    pub(super) fn remove_finger(&mut self) {
        if let (Some(_), Ok(session), Some(motion)) = (
            self.press.take(),
            &mut self.fingertip,
            self.stage.motion_mut(),
        ) {
            // If that fails too, the finger stays in the picture.
            let _ = session.park(motion);
            self.version += 1;
        }
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use palpate::gpu::Gpu;
    use palpate::mesh::Topology;
    use palpate::no_progress;
    use palpate::press::{Press as CommandPress, PressOptions, PressSample, PressSite};
    use palpate::scene::Scene;
    use std::sync::Arc;

    /// Takes a step and measures.
    fn step(window: &mut BodySession) -> Result<()> {
        window.step()?;
        while window.stage_mut().poll_steps()? {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        window.settle()
    }

    fn pick_at(point: DVec3) -> Pick {
        Pick {
            node: 0,
            tet: 0,
            face: 0,
            nodes: [0; 3],
            weights: [0.0; 3],
            point,
            distance: 0.0,
        }
    }

    /// Bodies on which the command, the window and the Python package must agree; the Python tests
    /// have the same list.
    const BODIES: [(&str, u32); 4] = [
        ("box", 1500),
        ("ball", 1500),
        ("breast", 4000),
        ("limb", 4000),
    ];

    /// The pieces of the knee pass through each other, and it snaps: no force of a press on it goes
    /// unmarked.
    #[test]
    fn press_on_knee_is_marked() {
        let gpu = Gpu::new().unwrap();
        let document = crate::examples::Example::named("knee").unwrap().open();
        let scene = document.unwrap().scene().unwrap();
        let mesh = Arc::new(scene.load_mesh(&no_progress).unwrap());
        let mut window = BodySession::new(&gpu, &scene, mesh, None).unwrap();
        let point = DVec3::new(26.5, 19.3, 0.5);
        window.press(&pick_at(point)).unwrap();
        window.press_to(4.0);
        let mut marked = 0;
        // A step that would invert tets is refused.
        while marked < 20 && step(&mut window).is_ok() {
            assert!(window.press_warning().is_some(), "{:?}", window.force());
            marked += 1;
        }
        assert!(marked > 4, "{marked}");
    }

    /// A body with loads of its own falls asleep before its equilibrium; the first force of a press on it
    /// is no larger than those that follow.
    #[test]
    fn first_force_on_loaded_body_is_settled() {
        let gpu = Gpu::new().unwrap();
        let text = "[mesh]\ngenerate = \"bar\"\ntets = 1500\n[material]\nyoung = 2e4\norder = 1\n[solver]\nname = \"implicit\"\ndt = 0.02\n";
        let scene = Scene::parse(text).unwrap();
        let mesh = Arc::new(scene.load_mesh(&no_progress).unwrap());
        let mut window = BodySession::new(&gpu, &scene, mesh.clone(), None).unwrap();
        // Far from its equilibrium under its own load.
        step(&mut window).unwrap();
        let (low, high) = mesh.bounds();
        let top = (0.5 * (low + high)).with_z(high.z);
        window.press(&pick_at(top)).unwrap();
        let radius = window.radius;
        for depth in [0.06, 0.12, 0.18, 0.24, 0.3] {
            window.press_to(depth * radius);
            step(&mut window).unwrap();
        }
        let forces: Vec<f64> = window.samples().iter().map(|s| s.force_n).collect();
        assert_eq!(forces[0], 0.0, "{forces:?}");
        let most = forces.iter().copied().fold(0.0, f64::max);
        assert_eq!(most, forces[forces.len() - 1], "{forces:?}");
    }

    #[test]
    fn window_measures_force_of_command() {
        let gpu = Gpu::new().unwrap();
        for (name, tets) in BODIES {
            let text =
                format!("[mesh]\ngenerate = \"{name}\"\ntets = {tets}\n[material]\norder = 1\n");
            let scene = Scene::parse(&text).unwrap();
            let mesh = scene.load_mesh(&no_progress).unwrap();
            let radius = PressSite::default_radius(&mesh, &Topology::new(&mesh));
            let wanted = PressOptions {
                depth: Some(0.5 * radius),
                ..PressOptions::default()
            };
            // Both are given the same point, of which they find the nearest on the boundary.
            let point = CommandPress::new(&gpu, &scene, &wanted)
                .unwrap()
                .site()
                .point;
            let wanted = PressOptions {
                at: Some(point),
                ..wanted
            };
            let mut command = CommandPress::new(&gpu, &scene, &wanted).unwrap();
            for _ in 0..12 {
                command.advance().unwrap();
            }
            let mut window = BodySession::new(&gpu, &scene, Arc::new(mesh), None).unwrap();
            assert_eq!(window.radius, radius);
            window.press(&pick_at(point)).unwrap();
            for sample in command.samples() {
                window.press_to(sample.depth_m / window.unit);
                step(&mut window).unwrap();
            }
            let (theirs, ours) = (command.samples(), window.samples());
            assert_eq!(theirs.len(), ours.len());
            assert!(theirs.iter().any(|s| s.force_n > 0.0), "{name}");
            for (a, b) in theirs.iter().zip(ours) {
                // The window turns the finger, whose tip is a sphere: the last digits differ.
                let apart = (a.force_n - b.force_n).abs() / a.force_n.max(f64::MIN_POSITIVE);
                assert!(apart < 1e-9, "{name}: {a:?} {b:?}");
                let (force_n, others) = (a.force_n, b);
                assert_eq!(*a, PressSample { force_n, ..*others }, "{name}");
            }
            assert_eq!(window.time(), 0.0, "quasi-static steps take no time");
        }
    }
}
