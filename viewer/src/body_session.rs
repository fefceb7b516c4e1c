//! A body that is open: stepped as time goes by, touched, drawn.

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

/// Of a body that nothing else holds, the part of its height along gravity that lies on a table.
const TABLE_HEIGHT_FRACTION: f64 = 0.04;
/// Length of a step where a scene does not say, s.
const STEP: f64 = 0.02;
/// The finger's radius where nobody chose one, over the body's diagonal, at least so many edges of its
/// boundary.
const RADIUS: f64 = 0.04;
const EDGES: f64 = 1.5;
/// The finger goes in by this part of its radius in a step at most.
const MAX_STEP_ADVANCE: f64 = 0.06;
/// How far it goes out of the body before it is put away, over its radius.
const RETRACT_DISTANCE: f64 = 0.5;
/// Where it is put away, in diagonals of the body from its middle.
const PARKED_DISTANCE: f64 = 20.0;
/// No more time is owed to a body that is slower than its time.
const MAX_TIME_DEBT: Duration = Duration::from_millis(100);
/// How often a body on the GPU is looked at.
const POLL_INTERVAL: Duration = Duration::from_millis(15);
/// Over how long steps are counted.
const RATE_WINDOW: Duration = Duration::from_secs(1);
/// How far a grab reaches, over the finger's radius.
const GRAB_RADIUS: f64 = 1.0;

/// What was measured in a step of a press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Since the body was opened, simulated, s.
    pub time_s: f64,
    /// How far the fingertip was beyond where it touched, m.
    pub depth_m: f64,
    /// What the body exerted on it along its way, N.
    pub force_n: f64,
}

/// A finger on its way into a body, or out again.
struct Press {
    /// Where it touched, and which way is out there.
    spot: DVec3,
    out: DVec3,
    /// How far it is in, and how far it is to go, in file units.
    gone: f64,
    goal: f64,
    /// How far it was in before the last step, and how far it can be at most.
    before: f64,
    most: f64,
    /// Whether it was let go.
    ends: bool,
    /// Whether a step was asked for with it there.
    stepped: bool,
}

/// A body that is open.
pub struct BodySession {
    stage: Stage,
    /// As it was read or made.
    pub mesh: Arc<TetMesh>,
    /// Of the body at rest.
    pub bounds: (DVec3, DVec3),
    /// Metres in a file unit.
    pub unit: f64,
    /// Radius of the finger, in file units.
    pub radius: f64,
    /// The number of the tool that is the finger, or why there is none.
    finger: std::result::Result<usize, String>,
    press: Option<Press>,
    /// What is held, where it was, and how far it was moved from there.
    grab: Option<(GrabId, DVec3, DVec3)>,
    /// Where it is to be cut, after how many edits of the scene, and whether again.
    blade: Option<(Blade, usize, bool)>,
    /// What was done to it by hand.
    pub edits: BodyEditHistory,
    /// The scene that it was made of.
    made: Scene,
    /// Scans and skins that were read.
    read: (Vec<ReadScan>, Vec<SkinEntry>),
    /// The recorded series that is shown, where one is.
    pub player: Option<Player>,
    /// What was measured since the last press began.
    pub samples: Vec<Sample>,
    /// Whether time goes by.
    pub playing: bool,
    /// Simulated seconds a second.
    pub speed: f64,
    owed: f64,
    /// Whether anything in the scene acts at a time of its own.
    timed: bool,
    /// Whether it was touched in another way since the last step.
    stirred: bool,
    /// Whether a step was asked for that is not known to be done.
    under_way: bool,
    /// Since when a press goes elsewhere that no step has done yet, and that the step under way does.
    asked: [Option<Instant>; 2],
    /// The same of the last step that was done, for the picture of it.
    pub shown: Option<Instant>,
    last: Instant,
    counted: (Instant, u64),
    /// Steps there were.
    pub steps: u64,
    /// Steps a second, lately.
    pub rate: f64,
    /// Why the last step failed.
    pub failure: Option<String>,
    /// Whether any step failed.
    pub failed: bool,
    /// What is to be said of the last one otherwise.
    pub remark: Option<String>,
    /// Changes whenever the picture is another one, but for the view.
    pub version: u64,
    /// What was assumed, in words.
    pub notes: Vec<String>,
}

impl BodySession {
    /// The body of `scene`, whose mesh is `mesh`, with a finger of `radius`, or one that suits it.
    ///
    /// # Errors
    /// As [`Stage::with_mesh`].
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
                    // Not all that moves can be pressed on.
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

    /// The body of `scene`, which nothing moves.
    pub(crate) fn static_body(gpu: &Gpu, scene: &Scene, mesh: Arc<TetMesh>) -> Result<BodySession> {
        let mut still = scene.clone();
        still.solver.name = None;
        let stage = Stage::with_mesh(gpu, &still, (*mesh).clone())?;
        let finger = Err("it was recorded, and is not simulated".into());
        Ok(BodySession::on(
            stage,
            (&still, scene.clone()),
            mesh,
            None,
            finger,
        ))
    }

    /// What is on a stage that was made of a scene, as it was `made` of the one that was given.
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
                .any(|t| t.path.is_some() || t.file.is_some() || t.turn.is_some());
        if stage.motion().is_some_and(Motion::has_state) {
            // Cuts are undone by these.
            stage.keep_checkpoints();
        }
        let now = Instant::now();
        let unit = stage.motion().map(|m| m.length_unit());
        // Several bodies and grids have made their own.
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

    /// The stage, to look at it.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// The diagonal of the body at rest, in file units.
    pub fn diagonal(&self) -> f64 {
        self.bounds.0.distance(self.bounds.1).max(f64::MIN_POSITIVE)
    }

    /// Why the body cannot be pressed on, if it cannot.
    pub fn cannot_press(&self) -> Option<&str> {
        self.finger.as_ref().err().map(String::as_str)
    }

    /// Shows the body as `scene` has it from now on; what was assumed is told by `notes`.
    ///
    /// # Errors
    /// As [`Stage::set_appearance`].
    pub fn set_appearance(&mut self, scene: &Scene) -> Result<()> {
        self.version += 1;
        let scene = self.with_read(scene);
        self.notes = self.stage.set_appearance(&scene)?;
        self.use_series_range(&scene)
    }

    /// Has what a recorded series shows be in the range of all its frames.
    pub(crate) fn use_series_range(&mut self, scene: &Scene) -> Result<()> {
        if let Some(wider) = self.with_series_range(scene) {
            self.notes = self.stage.set_appearance(&wider)?;
        }
        Ok(())
    }

    /// The scene with the scans and skins that were read already.
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

    /// The labels of a scan that was read, by number and name, where they are few.
    pub(crate) fn labels_of(&self, file: &Path) -> Option<&[(i64, String)]> {
        let known = self.read.0.iter().find(|(scan, _)| scan.file == file)?;
        known.1.as_deref()
    }

    /// Keeps scans and skins that were read, so that edits need not read them again.
    pub(crate) fn keep_read(&mut self, scans: Vec<ReadScan>, skins: Vec<SkinEntry>) {
        for scan in scans {
            self.read.0.retain(|known| known.0.file != scan.0.file);
            self.read.0.push(scan);
        }
        self.read.1.extend(skins);
    }

    /// The same of planes and isosurfaces alone.
    ///
    /// # Errors
    /// As [`Stage::set_planes`].
    pub fn set_planes(&mut self, scene: &Scene) -> Result<()> {
        self.version += 1;
        self.notes = self.stage.set_planes(scene)?;
        Ok(())
    }

    /// The stage, to change what its pictures show.
    pub fn stage_mut(&mut self) -> &mut Stage {
        self.version += 1;
        &mut self.stage
    }

    /// Whether the body is being touched.
    pub fn touched(&self) -> bool {
        self.press.is_some() || self.grab.is_some()
    }

    /// Has `waker` called when steps were done.
    pub fn set_waker(&mut self, waker: StepCallback, context: &egui::Context) {
        if let Some(player) = &mut self.player {
            player.wake(context);
        }
        if let Some(motion) = self.stage.motion_mut() {
            motion.simulator.set_waker(waker);
        }
    }

    /// The time that is shown, s.
    pub fn time(&self) -> f64 {
        match &self.player {
            Some(player) => player.series().time(player.shown()),
            None => self.stage.time(),
        }
    }

    /// Whether anything is going to change without being asked.
    fn is_busy(&self) -> bool {
        let press = self.press.as_ref();
        let goes = press.is_some_and(|p| p.gone != p.goal || p.ends);
        let awake = |m: &Motion| !m.asleep() || self.stirred || self.timed;
        let steps = self.playing || self.touched();
        let awake = steps && self.stage.motion().is_some_and(awake);
        !self.failed && (goes || awake)
    }

    /// Whether a step is under way or to come.
    pub fn is_going(&self) -> bool {
        self.under_way || self.blade.is_some() || self.is_busy()
    }

    /// When the body is to be looked at again, where nothing calls before.
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

    /// Whether a step is under way; one on the processor is waited for until then.
    fn under_way_until(&mut self, until: Option<Instant>) -> Result<bool> {
        let on_cpu = |motion: &Motion| motion.engine() == Engine::Cpu;
        // In a browser steps are done once they are asked for.
        let waits = !cfg!(target_arch = "wasm32") && self.stage.motion().is_some_and(on_cpu);
        loop {
            let under_way = self.stage.poll_steps()?;
            if !(under_way && waits && until.is_some_and(|until| Instant::now() < until)) {
                return Ok(under_way);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Has the body go on to now: takes over steps that are done, and asks for more of them. One that is
    /// under way is waited for `until` then, if it says so.
    pub fn advance_to_now(&mut self, until: Option<Instant>) {
        let under_way = self.under_way_until(until);
        let now = Instant::now();
        let passed = now.duration_since(self.last);
        self.last = now;
        self.count(now);
        if self.player.is_some() {
            return self.play_series(passed.as_secs_f64());
        }
        // Also while a step is under way: a body that is slower than its time never waits for the next.
        match self.playing || self.touched() {
            true => self.owed += self.speed * passed.min(MAX_TIME_DEBT).as_secs_f64(),
            false => self.owed = 0.0,
        }
        match under_way {
            Ok(true) => return,
            // What it led to is seen now.
            Ok(false) if std::mem::take(&mut self.under_way) => {
                self.version += 1;
                let done = self.asked[1].take();
                self.shown = self.shown.or(done);
            }
            Ok(false) => {}
            Err(Error::Solver { .. }) if self.backs_off() => {
                self.remark = Some("the body gives no further there".into());
                return;
            }
            Err(why) => return self.fail(&why),
        }
        if let Err(why) = self.cut_asked() {
            self.remark = Some(format!("not cut: {why}"));
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

    /// Has a finger that the body cannot make way for stay where it was before. Whether there is one.
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
            // It stays in the picture where even that cannot be.
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

    /// Asks for one step, with the finger where it is to go.
    pub fn step(&mut self) -> Result<()> {
        if let (Some(press), Ok(finger)) = (&mut self.press, &self.finger) {
            let most = MAX_STEP_ADVANCE * self.radius;
            // Out it goes as fast as it likes.
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

    /// Measures, and puts a finger away that is out again; between two steps.
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

    /// What the view of `camera` shows at a point of a picture of `size`.
    ///
    /// # Errors
    /// As [`Stage::pick`].
    pub fn pick(&mut self, camera: &Camera, pixel: DVec2, size: [u32; 2]) -> Result<Option<Pick>> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_size(size);
        self.stage.pick(pixel)
    }

    /// Puts the finger on the body where `pick` is, which is seen along `sight`.
    ///
    /// # Errors
    /// [`Error::Input`] for a body that cannot be pressed on.
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

    /// Has the finger go in so far, in file units.
    pub fn press_to(&mut self, depth: f64) {
        if let Some(press) = self.press.as_mut().filter(|p| !p.ends) {
            let goal = depth.clamp(0.0, press.most.max(0.0));
            if goal != std::mem::replace(&mut press.goal, goal) {
                self.asked[0].get_or_insert_with(Instant::now);
            }
        }
    }

    /// How far the finger is to go in, in file units; none where nothing is pressed.
    pub fn depth(&self) -> Option<f64> {
        self.press.as_ref().filter(|p| !p.ends).map(|p| p.goal)
    }

    /// Takes the finger out again.
    pub fn retract(&mut self) {
        if let Some(press) = &mut self.press {
            press.goal = -RETRACT_DISTANCE * self.radius;
            press.ends = true;
        }
    }

    /// Which way is out of the body around a pick: of faces about as far away as the finger is wide.
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
            // Not what is seen from behind: of thin parts both sides are near.
            if middle.distance(pick.point) <= self.radius && normal.dot(sight) < 0.0 {
                out += normal;
            }
        }
        Ok(out.normalize_or(-sight))
    }

    /// Takes hold of what is around `pick`.
    ///
    /// # Errors
    /// [`Error::Input`] where nothing moves, or nothing is there to take hold of.
    pub fn grab(&mut self, pick: &Pick) -> Result<()> {
        let reach = GRAB_RADIUS * self.radius;
        let motion = self.stage.motion_mut().ok_or_else(still)?;
        self.failed = false;
        let id = motion.simulator.grab(pick.point, reach, GrabMode::Follow)?;
        self.grab = Some((id, pick.point, DVec3::ZERO));
        Ok(())
    }

    /// Where what is held was, and moves it from there by `moved`, in file units.
    ///
    /// # Errors
    /// As [`Simulator::set_target`](palpate::physics::Simulator::set_target).
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

    /// Lets go of what is held.
    ///
    /// # Errors
    /// As [`Simulator::release`](palpate::physics::Simulator::release).
    pub fn release(&mut self) -> Result<()> {
        if let (Some((id, ..)), Some(motion)) = (self.grab.take(), self.stage.motion_mut()) {
            motion.simulator.release(id)?;
            self.stirred = true;
        }
        Ok(())
    }

    /// Cuts along `blade`, as soon as no step is under way, after so many edits of the scene; what
    /// came of it is a remark.
    pub fn cut(&mut self, blade: Blade, edits: usize) {
        self.blade = Some((blade, edits, false));
    }

    /// Cuts where it was asked for; between two steps.
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
                    // What was done before cannot be undone either.
                    None => self.edits = BodyEditHistory::default(),
                }
                format!("cut; {} tets now", self.stage.mesh().tets.len())
            }
            false => "the stroke cut nothing".into(),
        });
        self.stirred = true;
        if let Some(motion) = self.stage.motion_mut() {
            motion.wake();
        }
        Ok(())
    }

    /// The body as it stands between two steps; none of one whose state cannot be had.
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

    /// Lets go of the nodes that the last touch held.
    ///
    /// # Errors
    /// [`Error::Input`] where nothing moves.
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

    /// Does again what was undone last, after so many edits of the scene.
    ///
    /// # Errors
    /// As [`BodySession::hold`].
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

    /// Holds nodes where they are, after so many edits of the scene; in a stroke that begins, or goes
    /// on. How many of them were not held before.
    ///
    /// # Errors
    /// [`Error::Input`] where nothing moves.
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

    /// Holds what is within the finger's radius of `pick` where it is, as [`BodySession::hold`].
    ///
    /// # Errors
    /// [`Error::Input`] where nothing moves.
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

    /// Records the picture of `camera` into `colour`, on `backdrop`.
    ///
    /// # Errors
    /// As [`Stage::record`].
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

    /// Makes what pictures are drawn with, so that the first of them need not.
    ///
    /// # Errors
    /// As [`Stage::render_async`].
    pub(crate) fn prepare_pictures(&mut self) -> Result<()> {
        let size = self.stage.size();
        self.stage.set_size([64, 64]);
        let asked = self.stage.render_async();
        self.stage.set_size(size);
        asked.map(|_| ())
    }

    /// Asks for the picture of `camera`, `size` pixels large, and waits for none of it.
    ///
    /// # Errors
    /// As [`Stage::render_async`].
    pub fn ask_image(&mut self, camera: &Camera, size: [u32; 2]) -> Result<PendingImage> {
        *self.stage.camera_mut() = *camera;
        self.stage.set_size(size);
        self.stage.render_async()
    }

    /// The force of the last step of a press, N; none where nothing is pressed.
    pub fn force(&self) -> Option<f64> {
        let last = self.samples.last().filter(|_| self.press.is_some());
        last.map(|sample| sample.force_n)
    }
}

/// What a body is made anew from, on another thread.
pub struct RebuildRequest {
    made: Scene,
    mesh: Arc<TetMesh>,
    radius: f64,
    touches: BodyEditHistory,
}

impl RebuildRequest {
    /// Of a body, whose last touch is to be undone.
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

    /// The body as it was before.
    ///
    /// # Errors
    /// As [`BodySession::new`] and [`Stage::resume`].
    pub fn rebuild(self, gpu: &Gpu, before: &BodySnapshot) -> Result<BodySession> {
        let mut show = BodySession::new(gpu, &self.made, self.mesh, Some(self.radius))?;
        show.stage.resume(&before.checkpoint)?;
        if let Some(motion) = show.stage.motion_mut() {
            motion.simulator.pin_nodes(&before.pinned)?;
        }
        show.edits = self.touches;
        show.notes = vec!["the cut is undone".into()];
        Ok(show)
    }
}

fn still() -> Error {
    Error::Input("nothing moves in this scene, so nothing can be touched".into())
}

/// The scene with a solver, and held somewhere, if nothing in it says so; and whether it can be
/// pressed on, or why not.
fn held(scene: &Scene) -> (Scene, std::result::Result<(), String>) {
    let mut scene = scene.clone();
    if !scene.body.is_empty() || scene.grid.is_some() || scene.cage.is_some() {
        let why = "a finger presses on one body of tets that is simulated itself, and this scene has several, a grid or a cage";
        return (scene, Err(why.into()));
    }
    if scene.mesh.rest.is_some() {
        return (
            scene,
            Err("a mesh that is shown bent is not simulated".into()),
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

/// Tools that are not regions of the mesh, which those with a mass or a spring become.
fn led(scene: &Scene) -> usize {
    let carried = |t: &&ToolEntry| t.mass.is_some() || t.spring.is_some();
    scene.tool.len() - scene.tool.iter().filter(carried).count()
}

/// Where a finger is put away that presses on what lies between two corners.
fn put_away((low, high): (DVec3, DVec3)) -> DVec3 {
    0.5 * (low + high) + DVec3::splat(PARKED_DISTANCE * low.distance(high))
}

/// A radius that suits a body.
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
