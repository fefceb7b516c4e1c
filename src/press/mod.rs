//! `palpate press`: a fingertip presses on a body that lies on a table, and is withdrawn; measures
//! the resistance and the equivalent Young's modulus by Hertz.
//!
//! Presses are quasi-static: each tool step is one step of implicit Euler, so long that inertia and
//! damping are negligible. The mesh is taken as the shape under gravity, so no gravity is applied.

mod curve;
mod error;
mod finger;
mod interactive;
mod interactive_error;
mod map;
mod picture;
#[cfg(feature = "identify")]
mod presser;
mod question;
mod refined;
mod refined_session;
mod report;
mod session;
mod setup;
mod site;
mod support_table;
mod surface_moments;
mod validity;

#[cfg(feature = "identify")]
pub(crate) use curve::FIT_FRACTION;
pub use curve::{Bed, PressConditions, PressReport, PressSample};
pub use interactive::InteractiveStage;
#[cfg(feature = "identify")]
pub(crate) use map::step_depths;
pub use map::{MapOptions, MapPoint, PointResult, PressMap};
pub use picture::PressPicture;
#[cfg(feature = "identify")]
pub(crate) use presser::Presser;
pub use session::PressSession;
pub(crate) use setup::PressSetup;
pub use site::PressSite;
pub(crate) use validity::curve_warnings;

use crate::accuracy::{RestBody, error_stage, with_error_field};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::number_format::significant;
use crate::render::{Image, Plane, Sections};
use crate::scene::{Scene, Stage};
use crate::{Error, ProgressFn, Result, no_progress};
use error::{ErrorEstimator, LoadedState, LoadedStates, PressError};
use glam::{DVec2, DVec3};
use question::Question;
use refined::Refinement;
use session::INITIAL_CLEARANCE;
use site::Boundary;
use web_time::Instant;

/// Loading steps; as many unloading steps follow.
const STEPS: u32 = 16;
/// Default depth relative to the local thickness; and the maximum depth of a press to a force.
const DEPTH: f64 = 0.1;
const MAX_DEPTH: f64 = 0.5;
/// Fraction of the remaining force that one step aims for: the resistance increases with depth.
const FIRST_APPROACH_FRACTION: f64 = 0.6;
/// Fraction of the target force that counts as reached.
const FORCE_TOLERANCE: f64 = 0.99;
/// Minimum cosine between the view direction and the normal of the clip plane.
const MIN_VIEW_COSINE: f64 = 0.35;

/// Position and strength of a press; unset values are chosen from the body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PressOptions {
    /// Presses the boundary point nearest to this one, in file units.
    pub at: Option<DVec3>,
    /// Presses the point visible at this pixel; by default at the centre of the image that shows the
    /// whole body (`frame_all`).
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
    session: PressSession,
    site: PressSite,
    /// Target depth, in file units.
    depth: f64,
    force: Option<f64>,
    /// Poisson's ratio at the site.
    poisson: f64,
    /// Number of fixed nodes.
    fixed_nodes: usize,
    /// Root mean square and maximum distance of the mesh's boundary from what was meshed, m.
    shape_error: Option<[f64; 2]>,
    /// Remaining unloading steps; `None` while loading.
    left: Option<u32>,
    /// Depth at which tets would have been inverted, m.
    inversion_depth: Option<f64>,
    /// Why the press ended early, if so.
    ended: Option<String>,
    /// The states that the error estimate starts from, and the estimate, or why there is none.
    states: LoadedStates,
    error: Option<std::result::Result<PressError, String>>,
    /// The meshes on the way, if the body was refined for this press.
    refinement: Option<Refinement>,
    /// What pictures show: the body, and the state kept for them.
    drawn: picture::KeptPictures,
    notes: Vec<String>,
    gpu: Gpu,
}

impl Press {
    /// Places the body of `scene` on a table, fixes the lowest part of its surface along gravity there,
    /// and places the fingertip in front of the site. Loads, grabs, prescribed motions, cuts, tools and
    /// the floor of the scene are left out, pins are kept.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene of several bodies, a grid or a cage, a point far from the body,
    /// or invalid numbers; otherwise as [`Stage::new`].
    pub fn new(gpu: &Gpu, scene: &Scene, wanted: &PressOptions) -> Result<Press> {
        let scene = &setup::with_default_order(scene);
        let mesh = scene.load_simulated_mesh(&no_progress)?;
        Press::with_mesh(gpu, (scene, mesh), wanted)
    }

    /// As [`Press::new`], with the mesh of the scene.
    pub(crate) fn with_mesh(
        gpu: &Gpu,
        (scene, mesh): (&Scene, TetMesh),
        wanted: &PressOptions,
    ) -> Result<Press> {
        let (question, mesh) = Question::new(gpu, (scene, mesh), wanted)?;
        Press::of_question(gpu, &question, scene, mesh)
    }

    /// Creates the press that `question` asks for, on a mesh of the same shape.
    fn of_question(gpu: &Gpu, question: &Question, scene: &Scene, mesh: TetMesh) -> Result<Press> {
        let setup = PressSetup::on_table(scene, &mesh, Some(question.radius))?;
        let untouched = setup.scene.material.poisson_of(&mesh)?;
        let mut stage = Stage::with_mesh(gpu, &setup.scene, mesh)?;
        *stage.camera_mut() = question.camera;
        let motion = stage.motion_mut().ok_or_else(session::static_body)?;
        let fixed = motion.simulator.loads().pinned().iter();
        let fixed_nodes = fixed.filter(|pinned| **pinned).count();
        let mut session = PressSession::new(setup, motion);
        session.touch_site(motion, &Boundary::at_rest(motion), question.site)?;
        session.turn_finger(motion, -question.camera.axes().forward)?;
        let unit = motion.length_unit();
        let shape_error = motion.simulator.mesh().repairs.surface_distance;
        let shape_error = shape_error.map(|distances| distances.map(|d| unit * d));
        let notes = stage.notes().iter().cloned().chain(session.notes());
        let notes = notes.chain(shape_error.map(report::shape_note));
        Ok(Press {
            poisson: session.poisson().unwrap_or(untouched),
            notes: notes.collect(),
            stage,
            session,
            site: question.site,
            depth: question.depth,
            force: question.force,
            fixed_nodes,
            shape_error,
            left: None,
            inversion_depth: None,
            ended: None,
            states: LoadedStates::default(),
            error: None,
            refinement: None,
            drawn: picture::KeptPictures::default(),
            gpu: gpu.clone(),
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
        &self.site
    }

    /// Returns the radius of the fingertip, in file units.
    pub fn radius(&self) -> f64 {
        self.session.radius()
    }

    /// Returns the nominal number of steps; a press to a force may take more.
    pub fn steps(&self) -> u32 {
        2 * STEPS
    }

    /// Returns the samples so far.
    pub fn samples(&self) -> &[PressSample] {
        self.session.samples()
    }

    /// Adds a clip plane through the press site, so that images show the interior: along the body's
    /// longest axis if the camera sees the plane at a suitable angle, else facing the camera.
    ///
    /// # Errors
    /// As [`Stage::set_sections`].
    pub fn clip_at_press(&mut self) -> Result<()> {
        let inside = self.sections_at_press();
        self.stage.set_sections(&inside)
    }

    /// Returns the sections of the stage with the plane of [`Press::clip_at_press`].
    fn sections_at_press(&mut self) -> Sections {
        let out = self.site.outward;
        let to_eye = self.stage.camera_mut().eye - self.site.point;
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
        inside.planes.push(Plane::clip(self.site.point, across));
        inside
    }

    /// Advances one step: loading, and after the maximum depth unloading. `None` when finished.
    ///
    /// # Errors
    /// As a simulation step: the fingertip cannot advance where the body cannot yield.
    pub fn advance(&mut self) -> Result<Option<PressSample>> {
        let (phase, goal) = match self.left {
            Some(0) => return Ok(None),
            Some(left) => ("unload", self.withdrawn(left)),
            None => ("load", self.advanced()),
        };
        let motion = self.stage.motion_mut().ok_or_else(session::static_body)?;
        let Some(sample) = self.session.press_to(motion, goal, phase)? else {
            return Ok(self.end_at_inversion());
        };
        if phase == "load" {
            self.states.push(LoadedState {
                depth: goal,
                force: sample.force_n,
                positions: motion.positions()?,
            });
        }
        let deep = goal >= self.depth
            || self
                .force
                .is_some_and(|most| sample.force_n >= FORCE_TOLERANCE * most);
        self.left = match self.left {
            Some(left) => Some(left - 1),
            None if deep => Some(STEPS),
            None => None,
        };
        Ok(Some(sample))
    }

    /// Ends the phase in which tets would be inverted; returns the last sample of loading.
    fn end_at_inversion(&mut self) -> Option<PressSample> {
        let depth = self.session.unit() * self.current_depth();
        if self.left.is_some() {
            self.ended = Some(format!(
                "tets would be inverted while the fingertip withdraws from {} mm, so the press ended there: the body had snapped to another shape; press less deep (--depth), or on a finer mesh",
                significant(1e3 * depth)
            ));
            self.left = Some(0);
            return None;
        }
        self.inversion_depth = Some(depth);
        self.left = Some(STEPS);
        self.samples().last().copied()
    }

    fn current_depth(&self) -> f64 {
        self.session.depth().unwrap_or(0.0)
    }

    /// Returns the depth after the next loading step.
    fn advanced(&self) -> f64 {
        let (depth, stride) = (self.current_depth(), self.stride());
        // The factor avoids an extra step by rounding.
        match depth + 1.001 * stride < self.depth {
            true => depth + stride,
            false => self.depth,
        }
    }

    /// Returns the depth after the next of `left` unloading steps.
    fn withdrawn(&self, left: u32) -> f64 {
        let depth = self.current_depth();
        depth - (depth + INITIAL_CLEARANCE * self.radius()) / f64::from(left)
    }

    /// Returns the depth (m) at which tets would have been inverted, if the press ended there: its
    /// curve is valid up to that depth.
    pub fn inversion_depth(&self) -> Option<f64> {
        self.inversion_depth
    }

    /// Returns the next increment of depth: constant for a press to a depth, extrapolated from the
    /// last two steps for a press to a force.
    fn stride(&self) -> f64 {
        let even = (self.depth + INITIAL_CLEARANCE * self.radius()) / f64::from(STEPS);
        let Some(force) = self.force else {
            return even;
        };
        let small = 0.25 * even;
        match self.samples() {
            [.., a, b] if b.force_n > a.force_n && a.force_n > 0.0 => {
                let slope = self.session.unit() * (b.force_n - a.force_n) / (b.depth_m - a.depth_m);
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
        let most = self.samples().iter().map(|s| s.force_n).fold(0.0, f64::max);
        self.left.is_some()
            && self
                .force
                .is_some_and(|force| most < FORCE_TOLERANCE * force)
    }

    /// Estimates the errors of the measured numbers, for [`Press::report`]: solves the deepest state,
    /// and one of half of its depth, again in a finer space. Takes two to four times as long as the steps of the
    /// press. A
    /// press that is not valid, or a body whose error cannot be estimated, has no estimate, and the
    /// report says why.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and errors of the device.
    pub fn estimate_error(&mut self, progress: ProgressFn) -> Result<()> {
        let start = Instant::now();
        if !self.warnings().is_empty() {
            self.error = Some(Err("the press is not valid, because of the warnings".into()));
            return Ok(());
        }
        let conditions = self.conditions();
        let estimator = self.estimator(&conditions);
        let body = self.rest_body();
        let refined = self.refinement.as_ref();
        let refined = refined.and_then(|own| Some((own, own.error?)));
        let found = body.and_then(|body| match refined {
            Some(refined) => estimator.of_refined(&self.gpu, (&body, &self.states), refined),
            None => estimator.run(&self.gpu, (&body, &self.states), progress),
        });
        self.error = match found {
            Ok(found) => found.map(|mut error| {
                error.seconds = start.elapsed().as_secs_f64();
                Ok(error)
            }),
            Err(Error::Input(why)) => Some(Err(why)),
            Err(Error::Solver { what, .. }) => Some(Err(format!(
                "the finer body has no equilibrium near the pressed one ({what}); press less deep (--depth), or on a finer mesh (--tets)"
            ))),
            Err(other) => return Err(other),
        };
        Ok(())
    }

    /// Returns the pressed body at its largest depth with the field `error`, if
    /// [`Press::estimate_error`] found it: the share of each tet in the mesh's error of the largest
    /// force, %. Where it is high, the mesh is too coarse.
    ///
    /// # Errors
    /// [`Error::Input`] if the field does not fit the mesh.
    pub fn error_mesh(&self) -> Result<Option<TetMesh>> {
        let (Some(Ok(error)), Some(state)) = (&self.error, self.states.deepest()) else {
            return Ok(None);
        };
        let mut mesh = self.stage.mesh().clone();
        mesh.nodes = state.positions.clone();
        with_error_field(mesh, &error.tet_shares).map(Some)
    }

    /// Returns a picture of [`Press::error_mesh`], seen as the press.
    ///
    /// # Errors
    /// As [`Stage::image`].
    pub fn error_image(&mut self) -> Result<Option<Image>> {
        let Some(mesh) = self.error_mesh()? else {
            return Ok(None);
        };
        error_stage(mesh, &mut self.stage)?
            .render_on_background()
            .map(Some)
    }

    /// Returns the largest force in each of `levels` spaces, each finer than the one before, N: the
    /// first is that of the error estimate.
    ///
    /// # Errors
    /// As a simulation step.
    #[cfg(feature = "study")]
    pub(crate) fn finer_forces(&self, levels: usize) -> Result<Vec<f64>> {
        let conditions = self.conditions();
        let body = self.rest_body()?;
        self.estimator(&conditions)
            .finer_forces(&self.gpu, (body, &self.states), levels)
    }

    /// Returns the force in the deepest state, N.
    #[cfg(feature = "study")]
    pub(crate) fn deepest_force(&self) -> f64 {
        self.states.deepest().map_or(f64::NAN, |state| state.force)
    }

    fn rest_body(&self) -> Result<RestBody> {
        let motion = self.stage.motion().ok_or_else(session::static_body)?;
        RestBody::new(&self.session.setup().scene, motion)
    }

    fn estimator<'a>(&'a self, conditions: &'a PressConditions) -> ErrorEstimator<'a> {
        ErrorEstimator {
            session: &self.session,
            samples: self.session.samples(),
            conditions,
        }
    }

    /// Whether [`Press::estimate_error`] found the errors of the measured numbers.
    pub fn has_error(&self) -> bool {
        matches!(self.error, Some(Ok(_)))
    }

    /// Returns the error of the force of a sample, N, if [`Press::estimate_error`] found it.
    pub fn force_error(&self, sample: &PressSample) -> Option<f64> {
        let error = self.error.as_ref()?.as_ref().ok()?;
        Some(error.of_sample(sample))
    }
}
