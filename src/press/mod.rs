//! `palpate press`: a fingertip presses on a body that lies on a table, and is withdrawn; measures
//! the resistance and the equivalent Young's modulus by Hertz.
//!
//! Presses are quasi-static: each tool step is one step of implicit Euler, so long that inertia and
//! damping are negligible. The mesh is taken as the shape under gravity, so no gravity is applied.

mod curve;
mod map;
mod site;
mod table;
mod validity;

pub use curve::{PressReport, PressSample};
pub use map::{MapOptions, MapPoint, PointResult, PressMap};
pub use site::PressSite;
pub use validity::{ContactProblem, contact_problem, curve_warnings, in_pieces};

use crate::gpu::Gpu;
use crate::number_format::significant;
use crate::physics::{DiscreteModel, Engine, EngineChoice};
use crate::render::{Plane, Sections};
use crate::scene::{Motion, Scene, SphereEntry, Stage, ToolEntry};
use crate::{Error, FailureCause, Result, no_progress};
use glam::{DVec2, DVec3};
use site::Boundary;
use table::Table;

/// Loading steps; as many unloading steps follow.
const STEPS: u32 = 16;
/// Largest number of steps into which a step that would invert tets is split.
const MAX_SUBSTEPS: u32 = 16;
/// Time step over the time in which a shear wave crosses the body: inertia is negligible even for
/// slender bodies, whose lowest frequencies are far below the inverse of that time.
const STEP_IN_CROSSINGS: f64 = 1e4;
/// Time step of a body of unknown stiffness, s.
const STEP: f64 = 100.0;
/// Default depth relative to the local thickness; and the maximum depth of a press to a force.
const DEPTH: f64 = 0.1;
const MAX_DEPTH: f64 = 0.5;
/// Fraction of the remaining force that one step aims for: the resistance increases with depth.
const FIRST_APPROACH_FRACTION: f64 = 0.6;
/// Fraction of the target force that counts as reached.
const FORCE_TOLERANCE: f64 = 0.99;
/// Initial distance of the tool from the body, relative to its radius.
const INITIAL_CLEARANCE: f64 = 0.02;
/// Minimum cosine between the view direction and the normal of the clip plane.
const MIN_VIEW_COSINE: f64 = 0.35;
/// Name of the tool.
const NAME: &str = "fingertip";

/// Position and strength of a press; unset values are chosen from the body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PressOptions {
    /// Presses the boundary point nearest to this one, in file units.
    pub at: Option<DVec3>,
    /// Presses the point visible at this pixel; by default at the centre of the image.
    pub pick: Option<DVec2>,
    /// Radius of the fingertip, in file units.
    pub radius: Option<f64>,
    /// Press depth, in file units; by default a tenth of the local thickness, unless `force` is
    /// set.
    pub depth: Option<f64>,
    /// Force at which loading stops, N.
    pub force: Option<f64>,
}

impl PressOptions {
    fn check(&self) -> Result<()> {
        let lengths = [
            ("radius", self.radius),
            ("depth", self.depth),
            ("force", self.force),
        ];
        for (what, given) in lengths {
            if let Some(x) = given.filter(|x| !(x.is_finite() && *x > 0.0)) {
                return Err(Error::Input(format!(
                    "press {what} must be positive and finite, got {x}"
                )));
            }
        }
        match (self.depth, self.force) {
            (Some(_), Some(_)) => Err(Error::Input(
                "a press needs a depth or a force, not both; give one of them".into(),
            )),
            _ => Ok(()),
        }
    }
}

/// A press in progress.
pub struct Press {
    stage: Stage,
    spot: PressSite,
    /// Radius, target depth and current depth, in file units.
    radius: f64,
    depth: f64,
    current_depth: f64,
    /// Distance of the fingertip's centre from the site along the outward direction at first
    /// contact.
    touch: f64,
    force: Option<f64>,
    /// Metres per file unit.
    unit: f64,
    poisson: f64,
    /// Remaining unloading steps; `None` while loading.
    left: Option<u32>,
    samples: Vec<PressSample>,
    /// Depth at which tets would have been inverted, m.
    inversion_depth: Option<f64>,
    /// Why presses on the body there cannot be measured.
    warnings: Vec<String>,
    notes: Vec<String>,
}

impl Press {
    /// Places the body of `scene` on a table, fixes its lowest part along gravity there, and puts
    /// the fingertip in front of the site. Loads, grabs, prescribed motions, cuts, tools and the
    /// floor of the scene are ignored, pins are kept.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene of several bodies, a grid or a cage, a point far from the body,
    /// or invalid numbers; otherwise as [`Stage::new`].
    pub fn new(gpu: &Gpu, scene: &Scene, wanted: &PressOptions) -> Result<Press> {
        wanted.check()?;
        only_tets(scene)?;
        let mesh = scene.load_mesh(&no_progress)?;
        let (mut scene, down) = prepare_scene(scene);
        let solver = scene.solver.name.take();
        let mut still = Stage::with_mesh(gpu, &scene, mesh)?;
        scene.solver.name = solver;
        let mesh = still.mesh().clone();
        let boundary = Boundary::new(&mesh);
        let spot = site::find_site(&mut still, &boundary, wanted)?;
        let camera = *still.camera_mut();
        drop(still);
        let table = Table::new(&mesh, down)?;
        if table.holds(spot.point) {
            return Err(Error::Input(format!(
                "press point {} is fixed to the table; press elsewhere (--at x,y,z or --pick X,Y), or change gravity (--gravity x,y,z)",
                spot.point
            )));
        }
        let radius = wanted
            .radius
            .unwrap_or_else(|| boundary.fitting_radius(spot.thickness, [&spot].into_iter()));
        let depth = match wanted.force {
            Some(_) => MAX_DEPTH * spot.thickness,
            None => wanted.depth.unwrap_or(DEPTH * spot.thickness),
        };
        let touch = boundary.first_touch(&spot, radius);
        let warnings = validity::body_warnings(&mesh, &boundary, &spot, radius);
        let start = spot.point + (touch + INITIAL_CLEARANCE * radius) * spot.outward;
        scene.tool.push(ToolEntry {
            name: Some(NAME.into()),
            sphere: Some(SphereEntry { radius }),
            at: start.to_array(),
            colour: Some([0.87, 0.72, 0.62]),
            ..ToolEntry::default()
        });
        scene.pin.push(table.region());
        let poisson = scene.material.poisson_of(&mesh)?;
        let mut stage = Stage::with_mesh(gpu, &scene, mesh)?;
        *stage.camera_mut() = camera;
        let motion = stage.motion_mut().ok_or_else(|| {
            Error::Input("a static body cannot be pressed; set [solver] name".into())
        })?;
        make_quasi_static(motion);
        let step = motion.dt;
        let unit = motion.simulator.loads().frame_and_unit().1;
        let mut notes = stage.notes().to_vec();
        notes.push(format!(
            "the body is placed on a table and fixed there; quasi-static: solver {} with time steps of {} s; loads, grabs, moves, cuts, tools and floor of the scene are ignored",
            scene.solver.name.as_deref().unwrap_or_default(),
            significant(step)
        ));
        notes.extend(table.note());
        Ok(Press {
            poisson,
            stage,
            spot,
            radius,
            depth,
            current_depth: -INITIAL_CLEARANCE * radius,
            touch,
            force: wanted.force,
            unit,
            left: None,
            samples: Vec::new(),
            inversion_depth: None,
            warnings,
            notes,
        })
    }

    /// Returns the stage, for rendering and output.
    pub fn stage(&mut self) -> &mut Stage {
        &mut self.stage
    }

    /// Returns the assumptions, as text.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the press site.
    pub fn site(&self) -> &PressSite {
        &self.spot
    }

    /// Returns the radius of the fingertip, in file units.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Returns the nominal number of steps; a press to a force may take more.
    pub fn steps(&self) -> u32 {
        2 * STEPS
    }

    /// Returns the samples so far.
    pub fn samples(&self) -> &[PressSample] {
        &self.samples
    }

    /// Adds a clip plane through the press site, so that images show the interior: along the body's
    /// longest axis if the camera sees the plane at a suitable angle, else facing the camera.
    ///
    /// # Errors
    /// As [`Stage::set_sections`].
    pub fn clip_at_press(&mut self) -> Result<()> {
        let out = self.spot.outward;
        let to_eye = self.stage.camera_mut().eye - self.spot.point;
        let across = (to_eye - out * out.dot(to_eye)).normalize_or(out.any_orthonormal_vector());
        let (low, high) = self.stage.mesh().bounds();
        let longest = DVec3::AXES[(high - low).max_position()];
        let beside = out.cross(longest).normalize_or_zero();
        let seen = beside.dot(to_eye.normalize_or_zero());
        let across =
            match seen.abs() > MIN_VIEW_COSINE && out.cross(longest).length() > MIN_VIEW_COSINE {
                true => beside * seen.signum(),
                false => across,
            };
        let mut inside: Sections = self.stage.inside().clone();
        inside.planes.push(Plane::clip(self.spot.point, across));
        self.stage.set_sections(&inside)
    }

    /// Advances one step: loading, and after the maximum depth unloading. `None` when finished.
    ///
    /// # Errors
    /// As a simulation step: the tool cannot advance where the body cannot yield.
    pub fn advance(&mut self) -> Result<Option<PressSample>> {
        let stride = self.stride();
        let (loads, goal) = match self.left {
            Some(0) => return Ok(None),
            Some(left) => (
                false,
                self.current_depth
                    - (self.current_depth + INITIAL_CLEARANCE * self.radius) / f64::from(left),
            ),
            // The factor avoids an extra step by rounding.
            None => match self.current_depth + 1.001 * stride < self.depth {
                true => (true, self.current_depth + stride),
                false => (true, self.depth),
            },
        };
        if !self.move_fingertip(goal)? {
            if loads {
                self.inversion_depth = Some(self.unit * self.current_depth);
            } else {
                self.warnings.push(format!(
                    "tets would be inverted while the fingertip withdraws from {} mm, so the press ended there: the body had snapped to another shape; press less deep (--depth), or on a finer mesh",
                    significant(1e3 * self.unit * self.current_depth)
                ));
            }
            // After loading, the last sample is that of the largest depth.
            self.left = Some(if loads { STEPS } else { 0 });
            return match loads {
                true => Ok(self.samples.last().copied()),
                false => Ok(None),
            };
        }
        let force = self.stage.tool_force(0)?.dot(self.spot.outward);
        let sample = PressSample {
            time_s: self.stage.time(),
            phase: if loads { "load" } else { "unload" },
            depth_m: self.unit * goal,
            force_n: force,
        };
        self.samples.push(sample);
        let deep = goal >= self.depth
            || self
                .force
                .is_some_and(|most| force >= FORCE_TOLERANCE * most);
        self.left = match self.left {
            Some(left) => Some(left - 1),
            None if deep => Some(STEPS),
            None => None,
        };
        Ok(Some(sample))
    }

    /// Moves the fingertip to the depth `goal`, in several steps if one would invert tets. Returns
    /// false if tets still invert: the fingertip then is where the last valid step took it.
    fn move_fingertip(&mut self, goal: f64) -> Result<bool> {
        let mut parts = 1;
        let mut done = 0;
        let mut start = self.current_depth;
        while done < parts {
            let depth = start + (goal - start) * f64::from(done + 1) / f64::from(parts);
            let place = self.spot.point + (self.touch - depth) * self.spot.outward;
            self.stage.set_tool_target(0, place)?;
            match self.stage.run(1, &mut |_| {}) {
                Ok(()) => {
                    self.current_depth = depth;
                    done += 1;
                }
                Err(Error::Solver {
                    cause: FailureCause::InvertedTets,
                    ..
                }) => {
                    if parts >= MAX_SUBSTEPS {
                        return Ok(false);
                    }
                    (parts, done, start) = (4 * parts, 0, self.current_depth);
                }
                Err(error) => return Err(error),
            }
        }
        self.current_depth = goal;
        Ok(true)
    }

    /// Returns the depth (m) at which tets would have been inverted, if the press ended there: its
    /// curve is valid up to that depth.
    pub fn inversion_depth(&self) -> Option<f64> {
        self.inversion_depth
    }

    /// Returns the next increment of depth: constant for a press to a depth, extrapolated from the
    /// last two steps for a press to a force.
    fn stride(&self) -> f64 {
        let even = (self.depth + INITIAL_CLEARANCE * self.radius) / f64::from(STEPS);
        let Some(force) = self.force else {
            return even;
        };
        let small = 0.25 * even;
        match self.samples.as_slice() {
            [.., a, b] if b.force_n > a.force_n && a.force_n > 0.0 => {
                let slope = self.unit * (b.force_n - a.force_n) / (b.depth_m - a.depth_m);
                (FIRST_APPROACH_FRACTION * (force - b.force_n) / slope).clamp(0.05 * small, even)
            }
            _ => small,
        }
    }

    /// Whether loading has just ended.
    pub fn at_max_depth(&self) -> bool {
        self.left == Some(STEPS)
    }

    /// Whether the target force was not reached.
    pub fn force_not_reached(&self) -> bool {
        let most = self.samples.iter().map(|s| s.force_n).fold(0.0, f64::max);
        self.left.is_some()
            && self
                .force
                .is_some_and(|force| most < FORCE_TOLERANCE * force)
    }

    /// Returns the result after `seconds` of computing time.
    pub fn report(&self, seconds: f64) -> PressReport {
        let engine = self.stage.motion().map(|m| m.engine().to_string());
        curve::report(
            &self.samples,
            [self.unit * self.radius, self.poisson],
            (engine.unwrap_or_default(), seconds),
            self.warnings(),
        )
    }

    /// Returns why the press does not measure the elastic response of the body, one sentence each
    /// with what to do.
    pub fn warnings(&self) -> Vec<String> {
        let body = self.warnings.iter().cloned();
        body.chain(curve_warnings(&self.samples)).collect()
    }
}

/// Makes the steps of `motion` so long that inertia and damping are negligible.
fn make_quasi_static(motion: &mut Motion) {
    let crossing = motion
        .simulator
        .model()
        .and_then(DiscreteModel::wave_crossing_time);
    motion.dt = crossing.map_or(STEP, |time| STEP_IN_CROSSINGS * time);
}

/// Rejects scenes other than a single tetrahedral body.
fn only_tets(scene: &Scene) -> Result<()> {
    match scene.body.is_empty() && scene.grid.is_none() && scene.cage.is_none() {
        true => Ok(()),
        false => Err(Error::Input(
            "a press needs a single tetrahedral body; remove [[body]], [grid] and [cage]".into(),
        )),
    }
}

/// Returns the scene without loads, prepared for quasi-static steps, and the downward direction.
fn prepare_scene(scene: &Scene) -> (Scene, DVec3) {
    let mut prepared = scene.clone();
    let down = scene.solver.gravity.map_or(DVec3::ZERO, DVec3::from);
    let down = down.try_normalize().unwrap_or(DVec3::NEG_Z);
    prepared.force.clear();
    prepared.grab.clear();
    prepared.moves.clear();
    prepared.pressure.clear();
    prepared.muscle.clear();
    prepared.cut.clear();
    prepared.tool.clear();
    prepared.floor = None;
    prepared.solver.gravity = Some([0.0; 3]);
    prepared.solver.name = Some("implicit".into());
    prepared.solver.dt = Some(STEP);
    prepared.solver.sleep = Some(false);
    let engine = scene.solver.engine.unwrap_or(EngineChoice::Auto);
    prepared.solver.engine = Some(match engine {
        EngineChoice::Auto => EngineChoice::Exactly(Engine::Cpu),
        named => named,
    });
    (prepared, down)
}
