//! Session of an open body: real-time stepping, manual interaction and rendering.

use crate::body_edits::{BodyEdit, BodyEditHistory, BodySnapshot};
use crate::loading::ReadScan;
use crate::series::Player;
use eframe::egui;
use glam::{DVec2, DVec3};
use palpate::gpu::{Gpu, Recorder};
use palpate::mesh::{Blade, TetMesh, Topology};
use palpate::physics::{Engine, GrabId, GrabMode, SolverKind, StepCallback};
use palpate::render::{Camera, Pick};
use palpate::scene::{
    Axis, Motion, PendingImage, Region, Scene, SkinEntry, SphereEntry, Stage, ToolEntry,
};
use palpate::{Error, Result};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use web_time::Instant;

/// Fraction of its height along gravity that rests on the table, for a body without other supports.
const TABLE_HEIGHT_FRACTION: f64 = 0.04;
/// Default time step, s.
const STEP: f64 = 0.02;
/// Default finger radius relative to the body's diagonal, and its minimum in boundary edge lengths.
const RADIUS: f64 = 0.04;
const EDGES: f64 = 1.5;
/// Maximum advance of the finger per step, relative to its radius.
const MAX_STEP_ADVANCE: f64 = 0.06;
/// Distance above the surface at which a retracted finger is parked, relative to its radius.
const RETRACT_DISTANCE: f64 = 0.5;
/// Distance of the parked finger from the body's centre, in body diagonals.
const PARKED_DISTANCE: f64 = 20.0;
/// Maximum real time to catch up, for a body that is slower than real time.
const MAX_TIME_DEBT: Duration = Duration::from_millis(100);
/// Polling interval for a body on the GPU.
const POLL_INTERVAL: Duration = Duration::from_millis(15);
/// Averaging time of the step rate.
const RATE_WINDOW: Duration = Duration::from_secs(1);
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
struct Press {
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

/// Session of an open body.
pub struct BodySession {
    stage: Stage,
    /// The mesh as read or generated.
    pub mesh: Arc<TetMesh>,
    /// Bounds of the body at rest.
    pub bounds: (DVec3, DVec3),
    /// Metres per file unit.
    pub unit: f64,
    /// Radius of the finger, in file units.
    pub radius: f64,
    /// Tool index of the finger, or why the body cannot be pressed on.
    finger: std::result::Result<usize, String>,
    press: Option<Press>,
    /// The grab, its initial position, and its displacement.
    grab: Option<(GrabId, DVec3, DVec3)>,
    /// Pending cut, the number of scene edits before it, and whether it is a redo.
    blade: Option<(Blade, usize, bool)>,
    /// History of manual edits.
    pub edits: BodyEditHistory,
    /// The scene that the stage was created from.
    made: Scene,
    /// Scans and skins read so far.
    read: (Vec<ReadScan>, Vec<SkinEntry>),
    /// The recorded series, if one is shown.
    pub player: Option<Player>,
    /// Samples since the last press began.
    pub samples: Vec<Sample>,
    /// Whether the simulation is playing.
    pub playing: bool,
    /// Simulated seconds per second.
    pub speed: f64,
    owed: f64,
    /// Whether the scene has time-dependent loads.
    timed: bool,
    /// Whether an interaction since the last step requires a new step.
    stirred: bool,
    /// Whether a requested step may still be running.
    under_way: bool,
    /// Request times of press changes: the one that awaits a step, and the one that the running
    /// step applies.
    asked: [Option<Instant>; 2],
    /// The request time of the last completed step, for the latency of its picture.
    pub shown: Option<Instant>,
    last: Instant,
    counted: (Instant, u64),
    /// Number of steps done.
    pub steps: u64,
    /// Recent steps per second.
    pub rate: f64,
    /// Why the last step failed.
    pub failure: Option<String>,
    /// Whether any step failed.
    pub failed: bool,
    /// Remark on the last step that is not an error.
    pub remark: Option<String>,
    /// Changes whenever the picture changes, except for the camera.
    pub version: u64,
    /// Automatic choices, as text.
    pub notes: Vec<String>,
}

impl BodySession {
    /// Creates the session of `scene` with `mesh`, with a finger of `radius` or of a default
    /// radius.
    ///
    /// # Errors
    /// The errors of [`Stage::with_mesh`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        mesh: Arc<TetMesh>,
        radius: Option<f64>,
    ) -> Result<BodySession> {
        let made = scene.clone();
        let (mut scene, touchable) = held(scene);
        let mut radius = radius;
        let (stage, finger) = match touchable {
            Ok(()) => {
                let radius = *radius.get_or_insert_with(|| fitting_radius(&mesh));
                let (away, number) = (put_away(mesh.bounds()), led(&scene));
                scene.tool.push(ToolEntry {
                    name: Some("finger".into()),
                    sphere: Some(SphereEntry { radius }),
                    at: away.to_array(),
                    colour: Some([0.87, 0.72, 0.62]),
                    ..ToolEntry::default()
                });
                match Stage::with_mesh(gpu, &scene, (*mesh).clone()) {
                    Ok(stage) => (stage, Ok(number)),
                    // Some bodies that move do not support tools.
                    Err(why) => {
                        scene.tool.pop();
                        let stage = Stage::with_mesh(gpu, &scene, (*mesh).clone())?;
                        (stage, Err(why.to_string()))
                    }
                }
            }
            Err(why) => {
                let stage = match scene.body.is_empty() && scene.grid.is_none() {
                    true => Stage::with_mesh(gpu, &scene, (*mesh).clone())?,
                    false => Stage::new(gpu, &scene)?,
                };
                (stage, Err(why))
            }
        };
        Ok(BodySession::on(stage, (&scene, made), mesh, radius, finger))
    }

    /// Creates the session of `scene` as a static body.
    pub(crate) fn static_body(gpu: &Gpu, scene: &Scene, mesh: Arc<TetMesh>) -> Result<BodySession> {
        let mut still = scene.clone();
        still.solver.name = None;
        let stage = Stage::with_mesh(gpu, &still, (*mesh).clone())?;
        let finger = Err("a recorded series is not simulated; open one frame".into());
        Ok(BodySession::on(
            stage,
            (&still, scene.clone()),
            mesh,
            None,
            finger,
        ))
    }

    /// Creates the session of a stage that was created from the completed scene `made`.
    fn on(
        stage: Stage,
        (scene, made): (&Scene, Scene),
        mesh: Arc<TetMesh>,
        radius: Option<f64>,
        finger: std::result::Result<usize, String>,
    ) -> BodySession {
        let mut stage = stage;
        let timed = !(scene.grab.is_empty()
            && scene.cut.is_empty()
            && scene.moves.is_empty()
            && scene.muscle.is_empty()
            && scene.pressure.is_empty())
            || scene
                .tool
                .iter()
                .any(|t| t.path.is_some() || t.file.is_some() || t.rotation.is_some());
        if stage.motion().is_some_and(Motion::has_state) {
            // Checkpoints are needed to undo cuts.
            stage.keep_checkpoints();
        }
        let now = Instant::now();
        let unit = stage.motion().map(|m| m.length_unit());
        // Scenes of several bodies and of grids generate their own mesh.
        let mesh = match mesh.tets.is_empty() {
            true => Arc::new(stage.mesh().clone()),
            false => mesh,
        };
        let radius = radius.unwrap_or_else(|| fitting_radius(&mesh));
        BodySession {
            bounds: stage.mesh().bounds(),
            unit: unit.or(mesh.length_unit).unwrap_or(1.0),
            notes: stage.notes().to_vec(),
            playing: stage.motion().is_some(),
            stage,
            mesh,
            radius,
            finger,
            press: None,
            grab: None,
            blade: None,
            edits: BodyEditHistory::default(),
            read: (Vec::new(), made.skin.clone()),
            made,
            player: None,
            samples: Vec::new(),
            speed: 1.0,
            owed: 0.0,
            timed,
            stirred: false,
            under_way: false,
            asked: [None; 2],
            shown: None,
            last: now,
            counted: (now, 0),
            steps: 0,
            rate: 0.0,
            failure: None,
            failed: false,
            remark: None,
            version: 0,
        }
    }

    /// Returns the stage.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// Returns the diagonal of the body at rest, in file units.
    pub fn diagonal(&self) -> f64 {
        self.bounds.0.distance(self.bounds.1).max(f64::MIN_POSITIVE)
    }

    /// Returns why the body cannot be pressed on, if so.
    pub fn cannot_press(&self) -> Option<&str> {
        self.finger.as_ref().err().map(String::as_str)
    }

    /// Applies the appearance of `scene`; updates `notes`.
    ///
    /// # Errors
    /// The errors of [`Stage::set_appearance`].
    pub fn set_appearance(&mut self, scene: &Scene) -> Result<()> {
        self.version += 1;
        let scene = self.with_read(scene);
        self.notes = self.stage.set_appearance(&scene)?;
        self.use_series_range(&scene)
    }

    /// Sets the scalar range to that of all frames of a recorded series.
    pub(crate) fn use_series_range(&mut self, scene: &Scene) -> Result<()> {
        if let Some(wider) = self.with_series_range(scene) {
            self.notes = self.stage.set_appearance(&wider)?;
        }
        Ok(())
    }

    /// Returns the scene with the scans and skins read so far.
    fn with_read(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        for scan in &mut scene.scan {
            let mut all = self.read.0.iter().map(|(known, _)| known);
            let known = all.find(|known| known.file == scan.file);
            if let Some(known) = known.filter(|_| scan.volume.0.is_none()) {
                scan.volume = known.volume.clone();
            }
        }
        for skin in &mut scene.skin {
            let same = |k: &&SkinEntry| {
                let (a, b) = (
                    (&k.file, k.smooth, &k.labels),
                    (&skin.file, skin.smooth, &skin.labels),
                );
                a == b && k.above == skin.above
            };
            let known = self.read.1.iter().find(same).map(|k| k.surface.clone());
            if let Some(known) = known.filter(|_| skin.surface.0.is_none()) {
                skin.surface = known;
            }
        }
        scene
    }

    /// Returns the labels of a scan that was read, by number and name, if they are few.
    pub(crate) fn labels_of(&self, file: &Path) -> Option<&[(i64, String)]> {
        let known = self.read.0.iter().find(|(scan, _)| scan.file == file)?;
        known.1.as_deref()
    }

    /// Caches scans and skins, so that edits need not read them again.
    pub(crate) fn keep_read(&mut self, scans: Vec<ReadScan>, skins: Vec<SkinEntry>) {
        for scan in scans {
            self.read.0.retain(|known| known.0.file != scan.0.file);
            self.read.0.push(scan);
        }
        self.read.1.extend(skins);
    }

    /// Applies planes and isosurfaces only.
    ///
    /// # Errors
    /// The errors of [`Stage::set_planes`].
    pub fn set_planes(&mut self, scene: &Scene) -> Result<()> {
        self.version += 1;
        self.notes = self.stage.set_planes(scene)?;
        Ok(())
    }

    /// Returns the stage for changes of the rendering.
    pub fn stage_mut(&mut self) -> &mut Stage {
        self.version += 1;
        &mut self.stage
    }

    /// Whether a press or a grab is active.
    pub fn touched(&self) -> bool {
        self.press.is_some() || self.grab.is_some()
    }

    /// Sets the callback for completed steps.
    pub fn set_waker(&mut self, waker: StepCallback, context: &egui::Context) {
        if let Some(player) = &mut self.player {
            player.wake(context);
        }
        if let Some(motion) = self.stage.motion_mut() {
            motion.simulator.set_waker(waker);
        }
    }

    /// Returns the displayed time, s.
    pub fn time(&self) -> f64 {
        match &self.player {
            Some(player) => player.series().time(player.shown()),
            None => self.stage.time(),
        }
    }

    /// Whether the state changes without further input.
    fn is_busy(&self) -> bool {
        let press = self.press.as_ref();
        let goes = press.is_some_and(|p| p.gone != p.goal || p.ends);
        let awake = |m: &Motion| !m.asleep() || self.stirred || self.timed;
        let steps = self.playing || self.touched();
        let awake = steps && self.stage.motion().is_some_and(awake);
        !self.failed && (goes || awake)
    }

    /// Whether a step is running or pending.
    pub fn is_going(&self) -> bool {
        self.under_way || self.blade.is_some() || self.is_busy()
    }

    /// Returns when to poll the body, if no callback comes first.
    pub fn next_poll(&self) -> Option<Duration> {
        if self.blade.is_some() && !self.under_way {
            return Some(Duration::ZERO);
        }
        if self.player.is_some() {
            return self.next_frame();
        }
        let motion = self.stage.motion().filter(|_| self.is_busy())?;
        match (self.under_way, motion.engine()) {
            (true, Engine::Gpu) => Some(POLL_INTERVAL),
            (true, _) => None,
            (false, _) => {
                let left = (motion.dt - self.owed).max(0.0) / self.speed;
                Some(Duration::from_secs_f64(left.clamp(1e-3, 1.0)))
            }
        }
    }

    /// Whether a step is running; waits for one on the CPU until `until`.
    fn under_way_until(&mut self, until: Option<Instant>) -> Result<bool> {
        let on_cpu = |motion: &Motion| motion.engine() == Engine::Cpu;
        // In a browser, steps complete synchronously.
        let waits = !cfg!(target_arch = "wasm32") && self.stage.motion().is_some_and(on_cpu);
        loop {
            let under_way = self.stage.poll_steps()?;
            if !(under_way && waits && until.is_some_and(|until| Instant::now() < until)) {
                return Ok(under_way);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Advances the body to the current time: collects completed steps and requests more. Waits for
    /// a running step until `until`, if given.
    pub fn advance_to_now(&mut self, until: Option<Instant>) {
        let under_way = self.under_way_until(until);
        let now = Instant::now();
        let passed = now.duration_since(self.last);
        self.last = now;
        self.count(now);
        if self.player.is_some() {
            return self.play_series(passed.as_secs_f64());
        }
        // Also while a step is running, so that a body slower than real time starts its next step
        // immediately.
        match self.playing || self.touched() {
            true => self.owed += self.speed * passed.min(MAX_TIME_DEBT).as_secs_f64(),
            false => self.owed = 0.0,
        }
        match under_way {
            Ok(true) => return,
            // The result of the step is visible now.
            Ok(false) if std::mem::take(&mut self.under_way) => {
                self.version += 1;
                let done = self.asked[1].take();
                self.shown = self.shown.or(done);
            }
            Ok(false) => {}
            Err(Error::Solver { .. }) if self.backs_off() => {
                self.remark = Some("finger stopped: the contact step failed here".into());
                return;
            }
            Err(why) => return self.fail(&why),
        }
        if let Err(why) = self.cut_asked() {
            self.remark = Some(format!("cut failed: {why}"));
        }
        if self.stage.motion().is_none() {
            return;
        }
        if let Err(why) = self.settle() {
            return self.fail(&why);
        }
        let dt = self.stage.motion().map_or(STEP, |m| m.dt);
        if self.is_busy() && self.owed >= dt {
            self.owed = (self.owed - dt).min(dt);
            if let Err(why) = self.step() {
                self.fail(&why);
            }
        }
    }

    /// Retracts the finger to its last position after a failed contact step. Returns whether there
    /// is a finger.
    fn backs_off(&mut self) -> bool {
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

    fn fail(&mut self, why: &Error) {
        self.failure = Some(why.to_string());
        self.failed = true;
        self.grab = None;
        self.under_way = false;
        self.playing = false;
        self.owed = 0.0;
        if let (Some(_), Ok(finger)) = (self.press.take(), &self.finger) {
            // If that fails too, the finger stays in the picture.
            let _ = self.stage.teleport_tool(*finger, put_away(self.bounds));
            self.version += 1;
        }
    }

    fn count(&mut self, now: Instant) {
        let (since, before) = self.counted;
        let passed = now.duration_since(since);
        if passed >= RATE_WINDOW {
            self.rate = (self.steps - before) as f64 / passed.as_secs_f64();
            self.counted = (now, self.steps);
        }
    }

    /// Requests one step, with the finger moved towards its target depth.
    pub fn step(&mut self) -> Result<()> {
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
        self.stage.request_steps(1)?;
        self.stirred = false;
        self.under_way = true;
        self.steps += 1;
        self.version += 1;
        Ok(())
    }

    /// Records a sample and parks a retracted finger; call between two steps.
    fn settle(&mut self) -> Result<()> {
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

    /// Picks the body at a pixel of the view of `camera` with `size` pixels.
    ///
    /// # Errors
    /// The errors of [`Stage::pick`].
    pub fn pick(&mut self, camera: &Camera, pixel: DVec2, size: [u32; 2]) -> Result<Option<Pick>> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_size(size);
        self.stage.pick(pixel)
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

    /// Retracts the finger.
    pub fn retract(&mut self) {
        if let Some(press) = &mut self.press {
            press.goal = -RETRACT_DISTANCE * self.radius;
            press.ends = true;
        }
    }

    /// Returns the outward normal around a pick, averaged over the boundary faces within the
    /// finger's radius.
    fn outward(&self, pick: &Pick, sight: DVec3) -> Result<DVec3> {
        let x = self.stage.drawn_positions()?;
        let (mesh, topology) = match self.stage.motion() {
            Some(motion) => (self.stage.mesh(), motion.simulator.topology()),
            None => return Ok(-sight),
        };
        let mut out = DVec3::ZERO;
        for face in &topology.boundary {
            let [a, b, c] = topology.boundary_nodes(mesh, *face).map(|v| x[v as usize]);
            let middle = (a + b + c) / 3.0;
            let normal = (b - a).cross(c - a);
            // Skip back faces: in thin parts both sides are within the radius.
            if middle.distance(pick.point) <= self.radius && normal.dot(sight) < 0.0 {
                out += normal;
            }
        }
        Ok(out.normalize_or(-sight))
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

    /// Requests a cut along `blade`, after `edits` scene edits. The cut is performed once no step is
    /// running, and its result is reported in `remark`.
    pub fn cut(&mut self, blade: Blade, edits: usize) {
        self.blade = Some((blade, edits, false));
    }

    /// Performs the requested cut; call between two steps.
    fn cut_asked(&mut self) -> Result<()> {
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
    /// [`Error::Input`] for a static body.
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
    /// [`Error::Input`] for a static body.
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
    /// [`Error::Input`] for a static body.
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

    /// Records the rendering of the view of `camera` into `colour`, over `backdrop`.
    ///
    /// # Errors
    /// The errors of [`Stage::record`].
    pub fn record(
        &mut self,
        work: &mut Recorder,
        camera: &Camera,
        (colour, backdrop): (&wgpu::TextureView, [f32; 4]),
    ) -> Result<()> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_backdrop(backdrop);
        self.stage.record(work, colour)
    }

    /// Creates the rendering pipelines, so that the first picture is not delayed.
    ///
    /// # Errors
    /// The errors of [`Stage::render_async`].
    pub(crate) fn prepare_pictures(&mut self) -> Result<()> {
        let size = self.stage.size();
        self.stage.set_size([64, 64]);
        let asked = self.stage.render_async();
        self.stage.set_size(size);
        asked.map(|_| ())
    }

    /// Starts rendering the view of `camera` with `size` pixels, without waiting.
    ///
    /// # Errors
    /// The errors of [`Stage::render_async`].
    pub fn ask_image(&mut self, camera: &Camera, size: [u32; 2]) -> Result<PendingImage> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_size(size);
        self.stage.render_async()
    }

    /// Returns the force of the last step of a press, N; `None` without a press.
    pub fn force(&self) -> Option<f64> {
        let last = self.samples.last().filter(|_| self.press.is_some());
        last.map(|sample| sample.force_n)
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
    /// The errors of [`BodySession::new`] and [`Stage::resume`].
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

fn still() -> Error {
    Error::Input("a static body cannot be grabbed or pinned; a simulated body is required".into())
}

/// Returns the scene with a default solver and default supports if it has none, and whether it can
/// be pressed on, or why not.
fn held(scene: &Scene) -> (Scene, std::result::Result<(), String>) {
    let mut scene = scene.clone();
    if !scene.body.is_empty() || scene.grid.is_some() || scene.cage.is_some() {
        let why =
            "pressing requires one tet body; remove [[body]], [grid] and [cage] from the scene";
        return (scene, Err(why.into()));
    }
    if scene.mesh.rest.is_some() {
        return (
            scene,
            Err(
                "a deformed mesh ([mesh] rest) is not simulated; remove `rest` to press on it"
                    .into(),
            ),
        );
    }
    if scene.solver.name.is_none() {
        scene.solver.name = Some(SolverKind::Implicit.to_string());
        scene.solver.gravity.get_or_insert([0.0; 3]);
        scene.solver.dt.get_or_insert(STEP);
        scene.solver.tolerance.get_or_insert(0.01);
        if scene.pin.is_empty() && scene.moves.is_empty() {
            scene.pin.push(Region {
                name: Some("table".into()),
                axis: Some(Axis::Z),
                below: Some(TABLE_HEIGHT_FRACTION),
                ..Region::default()
            });
        }
    }
    (scene, Ok(()))
}

/// Returns the number of tools with prescribed motion; tools with a mass or a spring become regions
/// of the mesh.
fn led(scene: &Scene) -> usize {
    let carried = |t: &&ToolEntry| t.mass.is_some() || t.spring_stiffness.is_some();
    scene.tool.len() - scene.tool.iter().filter(carried).count()
}

/// Returns the parking position of a finger for a body with these bounds.
fn put_away((low, high): (DVec3, DVec3)) -> DVec3 {
    0.5 * (low + high) + DVec3::splat(PARKED_DISTANCE * low.distance(high))
}

/// Returns the default finger radius for a body.
fn fitting_radius(mesh: &TetMesh) -> f64 {
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
