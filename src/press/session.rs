//! A fingertip on a body, placed and advanced step by step. The command, maps, the window and the
//! Python package all press with it, so that they measure the same force at the same depth.

use super::curve::PressSample;
use super::interactive_error::PressedState;
use super::setup::PressSetup;
use super::site::{Boundary, PressSite};
use super::validity::{ContactProblem, body_warnings, contact_problem, is_held};
use crate::accuracy::{ErrorParts, Round, quasi_static_step, settle};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::scene::{Motion, Stage};
use crate::{Error, FailureCause, ProgressFn, Result};
use glam::{DMat3, DQuat, DVec3};

/// Initial distance of the fingertip from the body, relative to its radius.
pub(super) const INITIAL_CLEARANCE: f64 = 0.02;
/// Largest number of steps into which a step that would invert tets is split.
const MAX_SUBSTEPS: u32 = 16;
/// Largest advance and withdrawal of an interactive press in a step, relative to the radius.
const MAX_ADVANCE: f64 = 0.06;
const MAX_WITHDRAWAL: f64 = 8.0 * MAX_ADVANCE;
/// Largest error of the force of an interactive press for which its mesh is not refined, relative to it.
const INTERACTIVE_SHARE: f64 = 0.05;

/// Receives an estimate of a force: a round of refinement, and the parts of its error, N.
type OnEstimate<'a> = &'a mut dyn FnMut(&Round, &ErrorParts);

/// The fingertip of a body, and the press in progress.
#[derive(Clone, Debug)]
pub struct PressSession {
    setup: PressSetup,
    /// Metres per file unit.
    unit: f64,
    /// Time steps during and between presses, s.
    press_dt: f64,
    idle_dt: f64,
    contact: Option<Contact>,
    samples: Vec<PressSample>,
    /// Time passed in quasi-static steps, without physical meaning, s.
    static_time: f64,
}

/// A placed fingertip; lengths in file units.
#[derive(Clone, Debug)]
struct Contact {
    site: PressSite,
    /// Distance of the fingertip's centre from the site along the outward direction at first
    /// contact.
    touch: f64,
    depth: f64,
    /// Simulated time before the step, s.
    time: f64,
    /// Poisson's ratio of the tissue at the site.
    poisson: Option<f64>,
    /// Why a press there cannot be measured.
    warnings: Vec<String>,
    /// Whether the faces there are larger than the fingertip.
    is_coarse: bool,
    /// Whether the body is in pieces that pass through each other.
    is_in_pieces: bool,
    /// Whether the nodes there are held.
    is_held: bool,
    /// Whether the body has been in equilibrium: one with loads of its own may still have moved when the
    /// fingertip was placed.
    is_settled: bool,
}

impl PressSession {
    /// Creates the session of `motion`, which simulates the scene of `setup`.
    pub(crate) fn new(setup: PressSetup, motion: &Motion) -> PressSession {
        let press_dt = match setup.quasi_static {
            true => quasi_static_step(motion),
            false => motion.dt,
        };
        PressSession {
            unit: motion.length_unit(),
            press_dt,
            idle_dt: motion.dt,
            setup,
            contact: None,
            samples: Vec::new(),
            static_time: 0.0,
        }
    }

    /// Places the fingertip in front of the boundary point nearest to `point`, in file units, of
    /// the body in its present configuration, and starts a new curve.
    ///
    /// # Errors
    /// [`Error::Input`] for a static body; errors of reading the body back.
    pub fn touch(&mut self, stage: &mut Stage, point: DVec3) -> Result<PressSite> {
        let motion = stage.motion_mut().ok_or_else(static_body)?;
        let x = motion.positions()?;
        let (mesh, topology) = (motion.simulator.mesh(), motion.simulator.topology());
        let boundary = Boundary::new(mesh, topology, &x);
        let site = boundary.site_at(point, self.setup.radius);
        self.touch_site(motion, &boundary, site)?;
        let to_eye = -stage.camera_mut().axes().forward;
        self.turn_finger(stage.motion_mut().ok_or_else(static_body)?, to_eye)?;
        Ok(site)
    }

    /// As [`PressSession::touch`], at a site of the `boundary` of the body.
    pub(super) fn touch_site(
        &mut self,
        motion: &mut Motion,
        boundary: &Boundary,
        site: PressSite,
    ) -> Result<()> {
        let radius = self.setup.radius;
        let pieces = self.setup.pieces_warning(motion.simulator.mesh());
        let is_held = is_held(motion, &site, radius)?;
        let contact = Contact {
            site,
            touch: boundary.first_touch(&site, radius),
            depth: -INITIAL_CLEARANCE * radius,
            time: motion.time(),
            poisson: boundary
                .tet_at(site.point)
                .and_then(|t| poisson_of_tet(motion, t)),
            warnings: body_warnings(boundary, &site, radius, (is_held, pieces.clone())),
            is_held,
            is_settled: self.setup.table.is_some() || !self.setup.quasi_static,
            is_in_pieces: pieces.is_some(),
            is_coarse: radius < boundary.edge_near(site.point, radius),
        };
        motion.teleport_tool(self.setup.tool, contact.place(contact.depth))?;
        motion.dt = self.press_dt;
        self.contact = Some(contact);
        self.samples.clear();
        Ok(())
    }

    /// Turns the finger that is drawn: it presses against the outward direction of its site, and the hand is
    /// to the right of the eye, which is in the direction `to_eye`.
    ///
    /// # Errors
    /// [`Error::Input`] without a placed fingertip.
    pub(super) fn turn_finger(&self, motion: &mut Motion, to_eye: DVec3) -> Result<()> {
        let outward = self.contact.as_ref().ok_or_else(not_placed)?.site.outward;
        let right = outward
            .cross(to_eye)
            .normalize_or(outward.any_orthonormal_vector());
        let axes = DMat3::from_cols(right, outward.cross(right), outward);
        motion.turn_tool(self.setup.tool, DQuat::from_mat3(&axes))
    }

    /// Sets the depth, in file units, to which the next step of `motion` takes the fingertip.
    ///
    /// # Errors
    /// [`Error::Input`] without a placed fingertip.
    pub fn set_target_depth(&mut self, motion: &mut Motion, depth: f64) -> Result<()> {
        let contact = self.contact.as_mut().ok_or_else(not_placed)?;
        motion.set_tool_target(self.setup.tool, contact.place(depth))?;
        contact.depth = depth;
        contact.time = motion.time();
        contact.is_settled = true;
        Ok(())
    }

    /// Returns the force at the depth of [`PressSession::set_target_depth`], after the step, and adds it to the
    /// curve.
    ///
    /// # Errors
    /// [`Error::Input`] without a placed fingertip; otherwise as
    /// [`Motion::tool_force`](crate::scene::Motion::tool_force).
    pub fn measure(&mut self, motion: &mut Motion, phase: &'static str) -> Result<PressSample> {
        let contact = self.contact.as_ref().ok_or_else(not_placed)?;
        let sample = PressSample {
            time_s: motion.time(),
            phase,
            depth_m: self.unit * contact.depth,
            force_n: motion
                .tool_force(self.setup.tool)?
                .dot(contact.site.outward),
        };
        if self.setup.quasi_static {
            self.static_time += motion.time() - contact.time;
        }
        self.samples.push(sample);
        Ok(sample)
    }

    /// Moves the fingertip to `depth`, in file units, and measures there; in several steps if one
    /// would invert tets. `None` if tets still invert: the fingertip is then where the last valid
    /// step took it.
    ///
    /// # Errors
    /// As a simulation step: the fingertip cannot advance where the body cannot yield.
    pub fn press_to(
        &mut self,
        motion: &mut Motion,
        depth: f64,
        phase: &'static str,
    ) -> Result<Option<PressSample>> {
        let (mut parts, mut done) = (1, 0);
        let mut start = self.depth().ok_or_else(not_placed)?;
        let mut reached = start;
        while done < parts {
            let next = match done + 1 == parts {
                true => depth,
                false => start + (depth - start) * f64::from(done + 1) / f64::from(parts),
            };
            self.set_target_depth(motion, next)?;
            match motion.run(1, &mut |_| {}) {
                Ok(()) => {
                    reached = next;
                    done += 1;
                }
                Err(Error::Solver {
                    cause: FailureCause::InvertedTets,
                    ..
                }) => {
                    if let Some(contact) = &mut self.contact {
                        contact.depth = reached;
                    }
                    if parts >= MAX_SUBSTEPS {
                        return Ok(None);
                    }
                    (parts, done, start) = (4 * parts, 0, reached);
                }
                Err(error) => return Err(error),
            }
        }
        self.measure(motion, phase).map(Some)
    }

    /// Takes one step of an interactive press towards the depth `goal`, in file units, and measures
    /// there. Returns false if the step failed: the fingertip is then where it was before.
    ///
    /// # Errors
    /// As a simulation step that fails although the fingertip does not advance.
    pub fn step_towards(
        &mut self,
        motion: &mut Motion,
        goal: f64,
        phase: &'static str,
    ) -> Result<bool> {
        let before = self.depth().ok_or_else(not_placed)?;
        let next = self.next_depth(goal);
        self.set_target_depth(motion, next)?;
        match motion.run(1, &mut |_| {}) {
            Ok(()) => self.measure(motion, phase).map(|_| true),
            Err(Error::Solver { .. }) if next > before => {
                self.set_target_depth(motion, before)?;
                Ok(false)
            }
            Err(error) => Err(error),
        }
    }

    /// Returns the depth of the next step of an interactive press towards `goal`, in file units.
    pub fn next_depth(&self, goal: f64) -> f64 {
        let depth = self.depth().unwrap_or(goal);
        // The first step takes a body with loads of its own to its equilibrium.
        if self
            .contact
            .as_ref()
            .is_some_and(|contact| !contact.is_settled)
        {
            return depth;
        }
        let radius = self.setup.radius;
        // Exactly `goal` within a step, so that equal goals have equal forces to the last digit.
        goal.clamp(
            depth - MAX_WITHDRAWAL * radius,
            depth + MAX_ADVANCE * radius,
        )
    }

    /// Takes the fingertip away from the body, at once. The curve is kept.
    ///
    /// # Errors
    /// As [`Motion::teleport_tool`](crate::scene::Motion::teleport_tool).
    pub fn park(&mut self, motion: &mut Motion) -> Result<()> {
        self.contact = None;
        motion.dt = self.idle_dt;
        motion.teleport_tool(self.setup.tool, self.setup.parking)
    }

    /// Returns what the session was created from.
    pub(crate) fn setup(&self) -> &PressSetup {
        &self.setup
    }

    /// Returns a warning if the body of `mesh` is in several pieces without contact.
    pub fn pieces_warning(&self, mesh: &TetMesh) -> Option<String> {
        self.setup.pieces_warning(mesh)
    }

    /// Returns the assumptions, as text.
    pub fn notes(&self) -> Vec<String> {
        self.setup.notes(self.press_dt)
    }

    /// Returns the radius of the fingertip, in file units.
    pub fn radius(&self) -> f64 {
        self.setup.radius
    }

    /// Returns metres per file unit.
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// Returns the time step of presses, s.
    pub fn step(&self) -> f64 {
        self.press_dt
    }

    /// Returns the time step between presses, s.
    pub fn idle_step(&self) -> f64 {
        self.idle_dt
    }

    /// Returns the site of the press, if the fingertip is placed.
    pub fn site(&self) -> Option<&PressSite> {
        self.contact.as_ref().map(|contact| &contact.site)
    }

    /// Returns the depth of the fingertip, in file units, if it is placed.
    pub fn depth(&self) -> Option<f64> {
        self.contact.as_ref().map(|contact| contact.depth)
    }

    /// Returns the number of the fingertip among the tools, and its position at a depth, both in file
    /// units.
    ///
    /// # Errors
    /// [`Error::Input`] without a placed fingertip.
    pub(super) fn fingertip_at(&self, depth: f64) -> Result<(usize, DVec3)> {
        let contact = self.contact.as_ref().ok_or_else(not_placed)?;
        Ok((self.setup.tool, contact.place(depth)))
    }

    /// Records that the fingertip is at a depth, in file units.
    pub(super) fn set_depth(&mut self, depth: f64) {
        if let Some(contact) = &mut self.contact {
            contact.depth = depth;
        }
    }

    /// Starts `motion` at rest from `positions`, with the fingertip at a depth in file units, and takes
    /// steps until the force has settled, with a call of `check` after each. Returns it and its last
    /// change, N.
    ///
    /// # Errors
    /// [`Error::Input`] without a placed fingertip; otherwise as a simulation step; errors of `check`.
    pub(super) fn settle_at(
        &self,
        motion: &mut Motion,
        positions: &[DVec3],
        depth: f64,
        check: &mut dyn FnMut() -> Result<()>,
    ) -> Result<[f64; 2]> {
        let (tool, place) = self.fingertip_at(depth)?;
        let outward = self.site().map_or(DVec3::Z, |site| site.outward);
        motion.teleport_tool(tool, place)?;
        let settled = settle(motion, (positions, self.step()), &mut |motion| {
            check()?;
            Ok(vec![motion.tool_force(tool)?.dot(outward)])
        })?;
        let only = |values: Vec<f64>| values.first().copied().unwrap_or(f64::NAN);
        Ok([only(settled.values), only(settled.changes)])
    }

    /// Returns the same press on another mesh of the same shape.
    ///
    /// # Errors
    /// As [`PressSetup::on_mesh`].
    pub(super) fn on_mesh(&self, mesh: &TetMesh) -> Result<PressSession> {
        Ok(PressSession {
            setup: self.setup.on_mesh(mesh)?,
            ..self.clone()
        })
    }

    /// Places the fingertip in front of its site again, and starts a new curve.
    ///
    /// # Errors
    /// [`Error::Input`] without a placed fingertip.
    pub(super) fn begin_again(&mut self, motion: &mut Motion) -> Result<()> {
        let contact = self.contact.as_mut().ok_or_else(not_placed)?;
        contact.depth = -INITIAL_CLEARANCE * self.setup.radius;
        motion.teleport_tool(self.setup.tool, contact.place(contact.depth))?;
        motion.dt = self.press_dt;
        self.samples.clear();
        Ok(())
    }

    /// Returns Poisson's ratio of the tissue at the site, if it is known.
    pub fn poisson(&self) -> Option<f64> {
        self.contact.as_ref().and_then(|contact| contact.poisson)
    }

    /// Returns the curve since the fingertip was placed last.
    pub fn samples(&self) -> &[PressSample] {
        &self.samples
    }

    /// Returns the time passed in quasi-static steps, which has no physical meaning, s.
    pub fn static_time(&self) -> f64 {
        self.static_time
    }

    /// Returns better and better estimates of the last force, for another thread; the body of `motion` is
    /// at rest. The first is the force with its error; it takes about as long as ten steps of a body of as
    /// many elements as the finer space has. Then the mesh is refined until the force is as exact as the
    /// scene asks for ([`Scene::accuracy`](crate::scene::Scene::accuracy), 5 % by default): each of these
    /// estimates is the force on one more mesh. None has more than `max_elements` elements.
    ///
    /// # Errors
    /// [`Error::Input`] without a press, for more elements in the finer space, or for a body whose error
    /// cannot be estimated; errors of reading the body back.
    pub fn force_estimates(
        &self,
        motion: &Motion,
        max_elements: usize,
    ) -> Result<impl FnOnce(&Gpu, OnEstimate<'_>, ProgressFn<'_>) -> Result<()> + Send + use<>>
    {
        let state = PressedState::new(self, motion)?;
        if state.finer_elements() > max_elements {
            return Err(Error::Input(
                "the body has too many tets for an estimate while it is pressed; use palpate press"
                    .into(),
            ));
        }
        let mut wanted = self.setup.accuracy.clone();
        wanted.within.get_or_insert(INTERACTIVE_SHARE);
        wanted.max_tets = Some(wanted.max_tets.unwrap_or(max_elements).min(max_elements));
        Ok(
            move |gpu: &Gpu, each: OnEstimate<'_>, progress: ProgressFn<'_>| {
                state.force_estimates(gpu, &wanted, each, progress)
            },
        )
    }

    /// Returns why presses at the site cannot be measured, one sentence each.
    pub fn site_warnings(&self) -> &[String] {
        self.contact.as_ref().map_or(&[], |c| c.warnings.as_slice())
    }

    /// Returns why the force of the last sample has no meaning, if so.
    pub fn problem(&self) -> Option<String> {
        let contact = self.contact.as_ref()?;
        let curve = self.samples.iter().map(|s| [s.depth_m, s.force_n]);
        let coarse = contact.is_coarse.then_some(ContactProblem::CoarseFaces);
        let pieces = contact.is_in_pieces.then_some(ContactProblem::Pieces);
        let problem = contact_problem(&curve.collect::<Vec<_>>());
        let held = contact.is_held.then_some(ContactProblem::Held);
        let problem = held.or(problem).or(coarse).or(pieces);
        problem.map(|problem| problem.to_string())
    }
}

impl Contact {
    /// Returns the position of the fingertip's centre at a depth.
    fn place(&self, depth: f64) -> DVec3 {
        self.site.point + (self.touch - depth) * self.site.outward
    }
}

/// Returns Poisson's ratio of a tet at small strain; `None` for springs and rigid regions.
fn poisson_of_tet(motion: &Motion, tet: u32) -> Option<f64> {
    let elements = motion.simulator.model()?.elements()?;
    let numbers = elements.of_tets(motion.simulator.mesh());
    let element = &elements.tets[(*numbers.get(tet as usize)?)?];
    let [mu, lambda] = element.small_strain(elements.law);
    // Without the rounding of λ and μ.
    Some((1e9 * lambda / (2.0 * (lambda + mu))).round() / 1e9)
}

pub(super) fn static_body() -> Error {
    Error::Input("a static body cannot be pressed; set [solver] name".into())
}

pub(super) fn not_placed() -> Error {
    Error::Input("the fingertip is not placed on the body; place it first".into())
}
