//! The error of a press: its deepest state and one at about half of that depth are solved again in
//! the finer space.

use super::curve::{self, PressConditions, PressSample};
use super::refined::Refinement;
use super::session::PressSession;
use super::support_table::Table;
use crate::accuracy::{ErrorParts, FinerBody, RestBody, mesh_factor};
use crate::gpu::Gpu;
use crate::number_format::significant;
use crate::progress::ProgressScope;
use crate::scene::Motion;
use crate::{ProgressFn, Result};
use glam::DVec3;
use serde::Serialize;

/// Name of the estimate in progress reports.
pub(super) const WHAT: &str = "estimating the error";
/// Depth of the second state, relative to the deepest one.
const SECOND_DEPTH: f64 = 0.5;
/// Largest gap of the contact barrier over the radius of the fingertip.
const GAP_PER_RADIUS: f64 = 1.0 / 2000.0;
/// Largest mesh part of the error of the largest force, relative to it, with which the numbers of a
/// press have a meaning.
const MAX_RELATIVE_ERROR: f64 = 1.0;

/// A state of a press while loading.
#[derive(Clone, Debug)]
pub(super) struct LoadedState {
    /// Depth, in file units.
    pub depth: f64,
    /// Force, N.
    pub force: f64,
    /// Node positions, in file units.
    pub positions: Vec<DVec3>,
}

/// The states of a press that its error estimate starts from.
#[derive(Clone, Debug, Default)]
pub(super) struct LoadedStates(Vec<LoadedState>);

impl LoadedStates {
    /// Adds a state; drops those that are no longer needed.
    pub fn push(&mut self, state: LoadedState) {
        let shallow = |s: &LoadedState| s.depth <= SECOND_DEPTH * state.depth;
        let last_shallow = self.0.iter().rposition(shallow).unwrap_or(0);
        self.0.drain(..last_shallow);
        self.0.push(state);
    }

    /// Returns the state of the largest depth.
    pub fn deepest(&self) -> Option<&LoadedState> {
        self.0.last()
    }

    /// Returns the state of the largest depth, and that nearest to half of it.
    fn chosen(&self) -> Option<(&LoadedState, Option<&LoadedState>)> {
        let deepest = self.0.last()?;
        let off = |s: &LoadedState| (s.depth - SECOND_DEPTH * deepest.depth).abs();
        let others = self.0[..self.0.len() - 1]
            .iter()
            .filter(|s| s.depth > 0.0 && s.force > 0.0);
        Some((deepest, others.min_by(|a, b| off(a).total_cmp(&off(b)))))
    }
}

/// The estimated errors of the numbers of a press.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PressError {
    /// Parts of the error of the largest force, N.
    pub max_force_n: ErrorParts,
    /// Parts of the error of the stiffness, N/m.
    pub stiffness_n_per_m: ErrorParts,
    /// Parts of the error of the equivalent Young's modulus, Pa.
    pub hertz_young_pa: ErrorParts,
    /// The largest force in the finer space, N.
    pub finer_max_force_n: f64,
    /// Number of elements of the finer space.
    pub finer_elements: usize,
    /// Computing time of the estimate, s.
    pub seconds: f64,
    /// Depths (m) of the two states that were solved again, and the errors of their forces relative
    /// to these.
    #[serde(skip)]
    relative: [(f64, f64); 2],
    /// Share of each tet in the mesh part of the error of the largest force, %: in linear elasticity
    /// the error of the force at a given depth is twice that of the energy over the depth.
    #[serde(skip)]
    pub(super) tet_shares: Vec<f64>,
}

/// A force that was solved again.
pub(super) struct Correction {
    /// Depth, m.
    depth: f64,
    /// Force, N.
    force: f64,
    /// The same in the finer space, N.
    finer: f64,
    pub parts: ErrorParts,
}

/// The bodies in which states are solved again.
pub(super) struct ComparedBodies {
    same: Motion,
    finer: FinerBody,
    /// The same body on other faces.
    other: Option<OtherBody>,
    /// Safety factor of the mesh part.
    factor: f64,
}

/// A body that lies on other faces of its mesh.
struct OtherBody {
    motion: Motion,
    /// The fixed nodes on the table, and where they rest.
    fixed: Vec<(u32, DVec3)>,
    /// Share of the difference to it that is the error of the support.
    share: f64,
}

impl ComparedBodies {
    pub fn new(gpu: &Gpu, body: &RestBody, session: &PressSession) -> Result<ComparedBodies> {
        Ok(ComparedBodies {
            same: body.copy(gpu)?,
            finer: body.finer(gpu)?,
            other: OtherBody::new(gpu, body, session)?,
            factor: mesh_factor(body.order()),
        })
    }
}

impl OtherBody {
    /// Creates the body; `None` if its table has one choice of faces only.
    fn new(gpu: &Gpu, body: &RestBody, session: &PressSession) -> Result<Option<OtherBody>> {
        let table = session.setup().table.as_ref();
        let other = table.and_then(Table::other_support).map(|support| {
            let (other, nodes) = body.clone().with_last_pin(&support.nodes);
            let rest = |v: u32| (v, body.mesh().nodes[v as usize]);
            Ok(OtherBody {
                motion: other.copy(gpu)?,
                fixed: nodes.into_iter().map(rest).collect(),
                share: support.share,
            })
        });
        other.transpose()
    }
}

/// Solves the states of a press again.
pub(super) struct ErrorEstimator<'a> {
    pub session: &'a PressSession,
    pub samples: &'a [PressSample],
    pub conditions: &'a PressConditions,
}

impl ErrorEstimator<'_> {
    /// Estimates the errors of the press of `body`, which was in `states`. `None` without a contact
    /// force.
    ///
    /// # Errors
    /// [`Error::Input`] for a body whose error cannot be estimated; [`Error::Solver`] if the finer
    /// body has no equilibrium near a state.
    pub fn run(
        &self,
        gpu: &Gpu,
        (body, states): (&RestBody, &LoadedStates),
        progress: ProgressFn,
    ) -> Result<Option<PressError>> {
        let report = |share: f64| ProgressScope::begin(progress, WHAT, share).map(drop);
        report(0.0)?;
        let Some((deepest, second)) = states.chosen().filter(|(s, _)| s.force > 0.0) else {
            return Ok(None);
        };
        let mut bodies = ComparedBodies::new(gpu, body, self.session)?;
        report(0.1)?;
        let slope = self.slope(deepest);
        let second =
            second.map(|state| self.correct(&mut bodies, (state, slope), &mut || report(0.3)));
        let second = second.transpose()?;
        report(0.5)?;
        let start = deepest;
        let deepest = self.correct(&mut bodies, (deepest, slope), &mut || report(0.7))?;
        let mut error = self.errors(&deepest, second.as_ref());
        error.finer_elements = bodies.finer.elements();
        let before = bodies.finer.positions_from(&start.positions);
        error.tet_shares = bodies.finer.shares_of_difference(&before)?;
        report(1.0)?;
        Ok(Some(error))
    }

    /// Solves a state again; `slope` is that of the curve there, N/m. Calls `check` after each step.
    pub fn correct(
        &self,
        bodies: &mut ComparedBodies,
        (state, slope): (&LoadedState, f64),
        check: &mut dyn FnMut() -> Result<()>,
    ) -> Result<Correction> {
        let own = (state.positions.as_slice(), state.depth);
        let [same_force, own_change] = self.solve(&mut bodies.same, own, check)?;
        let support = self.support_part(&mut bodies.other, (state, same_force), check)?;
        let positions = bodies.finer.positions_from(&state.positions);
        let finer = &mut bodies.finer.motion;
        let [finer, change] = self.solve(finer, (&positions, state.depth), check)?;
        Ok(Correction {
            depth: self.session.unit() * state.depth,
            force: state.force,
            finer,
            parts: ErrorParts {
                mesh: bodies.factor * (state.force - finer).abs(),
                time: (state.force - same_force).abs(),
                solver: own_change + change,
                contact: self.contact_part(slope),
                support,
            },
        })
    }

    /// Returns the part of the gap of contact, N, for a curve of `slope` (N/m).
    fn contact_part(&self, slope: f64) -> f64 {
        slope * GAP_PER_RADIUS * self.session.radius() * self.session.unit()
    }

    /// Returns the part of the support, N, in a state of the given force.
    fn support_part(
        &self,
        other: &mut Option<OtherBody>,
        (state, force): (&LoadedState, f64),
        check: &mut dyn FnMut() -> Result<()>,
    ) -> Result<f64> {
        let Some(other) = other else {
            return Ok(0.0);
        };
        let mut positions = state.positions.clone();
        for (v, rest) in &other.fixed {
            positions[*v as usize] = *rest;
        }
        let [moved, _] = self.solve(&mut other.motion, (&positions, state.depth), check)?;
        Ok(other.share * (moved - force).abs())
    }

    /// Returns the errors of a press on a refined body, whose force in the last round has the error
    /// `error_n` (N) by the mesh. `None` without a contact force.
    ///
    /// # Errors
    /// As [`ErrorEstimator::run`].
    pub fn of_refined(
        &self,
        gpu: &Gpu,
        (body, states): (&RestBody, &LoadedStates),
        (refinement, error_n): (&Refinement, f64),
    ) -> Result<Option<PressError>> {
        let Some((deepest, _)) = states.chosen().filter(|(s, _)| s.force > 0.0) else {
            return Ok(None);
        };
        // A press to a force ends deeper than on the first mesh.
        let is_same_state = deepest.depth == refinement.depth;
        let force = if is_same_state {
            refinement.force
        } else {
            deepest.force
        };
        let mut other = OtherBody::new(gpu, body, self.session)?;
        let correction = Correction {
            depth: self.session.unit() * deepest.depth,
            force: deepest.force,
            finer: force,
            parts: ErrorParts {
                mesh: error_n / refinement.force * deepest.force,
                time: (deepest.force - force).abs(),
                solver: refinement.change,
                contact: self.contact_part(self.slope(deepest)),
                support: self.support_part(&mut other, (deepest, force), &mut || Ok(()))?,
            },
        };
        let mut error = self.errors(&correction, None);
        error.finer_elements = body.mesh().element_count();
        error.tet_shares = refinement.tet_shares(body.mesh());
        Ok(Some(error))
    }

    /// Returns the force of the deepest state in each of `levels` spaces, each finer than the one
    /// before.
    ///
    /// # Errors
    /// As [`ErrorEstimator::run`].
    #[cfg(feature = "study")]
    pub fn finer_forces(
        &self,
        gpu: &Gpu,
        (body, states): (RestBody, &LoadedStates),
        levels: usize,
    ) -> Result<Vec<f64>> {
        let Some((deepest, _)) = states.chosen() else {
            return Ok(Vec::new());
        };
        let mut positions = deepest.positions.clone();
        let (mut coarser, mut forces) = (body, Vec::new());
        for _ in 0..levels {
            let mut finer = coarser.finer(gpu)?;
            positions = finer.positions_from(&positions);
            let from = (positions.as_slice(), deepest.depth);
            forces.push(self.solve(&mut finer.motion, from, &mut || Ok(()))?[0]);
            positions = finer.motion.positions()?;
            coarser = RestBody::new(&self.session.setup().scene, &finer.motion)?;
        }
        Ok(forces)
    }

    /// Returns the force in a state at a depth, solved again, and its last change.
    fn solve(
        &self,
        motion: &mut Motion,
        (positions, depth): (&[DVec3], f64),
        check: &mut dyn FnMut() -> Result<()>,
    ) -> Result<[f64; 2]> {
        self.session.settle_at(motion, positions, depth, check)
    }

    /// Returns the slope of the curve at its deepest state, N/m.
    pub fn slope(&self, deepest: &LoadedState) -> f64 {
        let depth = self.session.unit() * deepest.depth;
        let mut load = self.samples.iter().filter(|s| s.phase == "load");
        let before = load.rfind(|s| s.depth_m < depth);
        before.map_or(deepest.force / depth, |s| {
            ((deepest.force - s.force_n) / (depth - s.depth_m)).abs()
        })
    }

    /// Returns the errors, given the corrections of two states.
    fn errors(&self, deepest: &Correction, second: Option<&Correction>) -> PressError {
        let second = second.unwrap_or(deepest);
        // The numbers of a curve with each of these parts subtracted.
        let fit = |part: &dyn Fn(&Correction) -> f64| {
            let shares = [second, deepest].map(|c| (c.depth, part(c) / c.force));
            let corrected: Vec<PressSample> = self
                .samples
                .iter()
                .map(|s| PressSample {
                    force_n: s.force_n * (1.0 - interpolate(&shares, s.depth_m)),
                    ..*s
                })
                .collect();
            let report = curve::report(&corrected, self.conditions.clone(), 0.0, Vec::new());
            [
                report.stiffness_n_per_m.unwrap_or_default(),
                report.hertz_young_pa.unwrap_or_default(),
            ]
        };
        let own = fit(&|_| 0.0);
        let change = |part: &dyn Fn(&Correction) -> f64| {
            let other = fit(part);
            [0, 1].map(|k| (own[k] - other[k]).abs())
        };
        let signed = |c: &Correction| (c.force - c.finer).signum() * c.parts.mesh;
        let [mesh, time, solver, contact, support] = [
            change(&signed),
            change(&|c| c.parts.time),
            change(&|c| c.parts.solver),
            change(&|c| c.parts.contact),
            change(&|c| c.parts.support),
        ];
        let [stiffness, young] = [0, 1].map(|k| ErrorParts {
            mesh: mesh[k],
            time: time[k],
            solver: solver[k],
            contact: contact[k],
            support: support[k],
        });
        PressError {
            max_force_n: deepest.parts,
            stiffness_n_per_m: stiffness,
            hertz_young_pa: young,
            finer_max_force_n: deepest.finer,
            finer_elements: 0,
            seconds: 0.0,
            tet_shares: Vec::new(),
            relative: [second, deepest].map(|c| (c.depth, c.parts.total() / c.force)),
        }
    }
}

impl PressError {
    /// Returns the error of the force of a sample, N.
    pub fn of_sample(&self, sample: &PressSample) -> f64 {
        (sample.force_n * interpolate(&self.relative, sample.depth_m)).abs()
    }

    /// Returns why the numbers of the press have no meaning, if so.
    pub(super) fn warning(&self, max_force: f64) -> Option<String> {
        let share = self.max_force_n.mesh / max_force.max(f64::MIN_POSITIVE);
        (share > MAX_RELATIVE_ERROR).then(|| {
            format!(
                "the mesh is too coarse for this press: its force is {} N, and {} N in a space of {} elements; use a finer mesh (--tets), --order 2, or a larger --radius",
                significant(max_force),
                significant(self.finer_max_force_n),
                self.finer_elements
            )
        })
    }
}

/// Interpolates linearly between two points, constant beyond them.
fn interpolate([(x0, y0), (x1, y1)]: &[(f64, f64); 2], x: f64) -> f64 {
    if x >= *x1 {
        return *y1;
    }
    if x <= *x0 {
        return *y0;
    }
    y0 + (y1 - y0) * (x - x0) / (x1 - x0)
}
