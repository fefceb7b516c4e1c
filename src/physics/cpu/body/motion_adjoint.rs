//! The adjoint of a motion: its states, and the reverse of each of its steps
//! ([`step_adjoint`](super::step_adjoint)).

use super::CpuBody;
use crate::physics::cpu::implicit::contact_terms::{
    self_contact_mut, tool_contact, tool_contact_mut,
};
use crate::physics::cpu::implicit::schemes::ImplicitScheme;
use crate::physics::cpu::node_constraints::NodeConstraint;
use crate::physics::cpu::rigid::pose::Pose;
use crate::physics::cpu::runtime::energy_guard::StepFailure;
use crate::physics::cpu::runtime::motion_adjoint::{
    MotionAdjoint, MotionState, StateAdjoint, StepAdjoint, StepLoads, StepParts,
};
use crate::physics::cpu::runtime::static_adjoint::{AdjointSeed, AdjointSolution};
use crate::physics::cpu::runtime::steppable::{LoadUpdate, Steppable};
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::{V4, add, add_scaled, to_v4, zero};
use crate::physics::{DiscreteModel, NewtonSettings, StepRecord};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// Largest residual of a step, and the largest number of Newton iterations.
const STEP_TOLERANCE: f64 = 1e-10;
const STEP_ITERATIONS: u32 = 60;

/// Relative residual of the linear solves of a step.
const STEP_LINEAR_TOLERANCE: f64 = 1e-3;

impl MotionAdjoint for CpuBody<f64> {
    fn begin_motion(&mut self) -> Result<(MotionState, NewtonSettings)> {
        self.check_motion()?;
        self.prepare_outside_tools()?;
        let before = self.state.u.clone();
        // Contact at the start: an intersection would be separated in the first steps.
        let poses = self.rigid_poses();
        self.show_displacements((&before, &poses), &StepLoads::default())?;
        let mut own = NewtonSettings::default();
        if let Some(newton) = &mut self.newton {
            own = newton.settings;
            newton.settings = NewtonSettings {
                iterations: own.iterations.max(STEP_ITERATIONS),
                tolerance: match own.tolerance > 0.0 {
                    true => own.tolerance.min(STEP_TOLERANCE),
                    false => STEP_TOLERANCE,
                },
                linear_tolerance: own.linear_tolerance.min(STEP_LINEAR_TOLERANCE),
            };
        }
        Ok((self.motion_state(StepLoads::default()), own))
    }

    fn end_motion(&mut self, own: NewtonSettings) {
        if let Some(newton) = &mut self.newton {
            newton.settings = own;
        }
    }

    fn begin_step(&mut self, change: Option<LoadUpdate>) -> Result<StepLoads> {
        if let Some(change) = change {
            self.apply_loads(change)?;
        }
        self.prepare_outside_tools()?;
        let nodes = self.attachments.iter().map(NodeConstraint::node);
        let slots = nodes.map(|v| self.engine_index[v as usize] as usize);
        let fixed = slots.filter(|i| *i < self.soft_nodes() && self.free_mask[*i] == 0.0);
        let contact = tool_contact(&self.terms);
        let tools = contact.map_or(&[][..], |contact| &contact.tools);
        Ok(StepLoads {
            constrained: fixed
                .map(|i| (i, self.state.u[i], self.state.v[i]))
                .collect(),
            is_first: self.previous_dt == 0.0,
            tools: tools.iter().map(|tool| [tool.from, tool.to]).collect(),
            time: 0.0,
            levels: self
                .implicit
                .as_ref()
                .map_or(Vec::new(), |implicit| implicit.levels.clone()),
        })
    }

    fn motion_step(&mut self, dt: f64) -> std::result::Result<StepRecord, StepFailure> {
        self.run(1, dt)
    }

    fn motion_state(&self, mut step: StepLoads) -> MotionState {
        if let Some(contact) = tool_contact(&self.terms) {
            step.time = contact.time;
        }
        let is_bdf2 = self.scheme() == ImplicitScheme::Bdf2;
        let solver = self.implicit.as_ref().map(|implicit| &implicit.solver);
        let history = solver.filter(|s| is_bdf2 && s.count == 2 && self.previous_dt > 0.0);
        MotionState {
            u: self.state.u.clone(),
            v: self.state.v.clone(),
            change: history.map_or(Vec::new(), |s| self.extend_change(&s.previous_solutions[0])),
            last: history.map_or(0.0, |_| self.previous_dt),
            step,
            poses: self.rigid_poses(),
            torques: match &self.newton {
                // A first step forgets them.
                Some(newton) if self.previous_dt == 0.0 => {
                    vec![DVec3::ZERO; newton.rigid.torques.len()]
                }
                Some(newton) => newton.rigid.torques.clone(),
                None => Vec::new(),
            },
        }
    }

    fn motion_state_bytes(&self) -> usize {
        let vectors = match self.scheme() {
            ImplicitScheme::Bdf2 => 3,
            _ => 2,
        };
        vectors * self.state.u.len() * size_of::<V4<f64>>()
    }

    fn show_state(&mut self, state: &MotionState) -> Result<()> {
        self.state.v.copy_from_slice(&state.v);
        self.show_displacements((&state.u, &state.poses), &state.step)
    }

    fn add_quantity(
        &mut self,
        seed: &AdjointSeed,
        weight: f64,
        adjoint: &mut StateAdjoint,
    ) -> AdjointSolution {
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| {
            let sums_forces = seed.reaction.is_some() || seed.region.is_some();
            let tangent = sums_forces.then(|| self.linearise_static(seed.parts));
            let vectors = self.seed_vectors(tangent.as_ref(), seed);
            adjoint.u.resize(self.state.u.len(), zero());
            for (to, g) in adjoint.u.iter_mut().zip(&vectors.by_position) {
                *to = add_scaled(*to, weight, *g);
            }
            let none = vec![zero(); self.state.u.len()];
            self.add_friction_gradient(seed, weight, adjoint);
            self.derivatives_of_seed(&vectors, (&none, Some(&self.state.v)), seed)
        })
    }

    fn reverse_step(
        &mut self,
        [from, to]: [&MotionState; 2],
        dt: f64,
        (network, seed, parts): (&DiscreteModel, &AdjointSeed, StepParts),
        adjoints: &mut [&mut StateAdjoint],
    ) -> Result<Vec<StepAdjoint>> {
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| {
            let from = &from.with_constraints(&to.step);
            let step = self.step_between([from, to], dt / self.units.time);
            self.show_displacements((&step.u, &step.poses), &to.step)?;
            for term in &mut self.terms {
                term.freeze_damping(&plan, &step.lagged);
            }
            let forces = self.net_forces(&step, &from.u);
            let mut tangent = self.linearise_step(&step, parts, &forces);
            let mut all = Vec::new();
            for adjoint in adjoints.iter_mut() {
                let before = tangent.iterations;
                let (solved, ends) = self.solve_step((&step, to), &mut tangent, adjoint)?;
                all.push((solved, ends, tangent.iterations - before));
            }
            let at = (&step, &from.u[..]);
            let mut found = Vec::new();
            for (adjoint, (solved, _, iterations)) in adjoints.iter_mut().zip(&all) {
                let z = &solved[0];
                let mut own = self.step_derivatives(at, (z, &forces), seed);
                own.solution.iterations = *iterations;
                own.solution.damping = self.damping_slopes(&step, network, z);
                self.pull_back(at, solved, parts, adjoint);
                found.push(own);
            }
            if parts.damping && network.damping_time > 0.0 {
                let solved: Vec<&[V4<f64>]> =
                    all.iter().map(|(solved, ..)| &solved[0][..]).collect();
                let lame = self.pull_back_damping(&step, network, &solved, adjoints);
                for (own, lame) in found.iter_mut().zip(lame) {
                    own.solution.lame = lame;
                }
            }
            let start = (&from.poses[..], &from.v[..]);
            let each = adjoints.iter_mut().zip(&all).zip(&mut found);
            for ((adjoint, (solved, ends, _)), own) in each {
                self.pull_back_rigid(start, (&step, &solved[0]), ends, adjoint);
                own.solution.supports = self.drop_constrained(&to.step, adjoint);
            }
            Ok(found)
        })
    }

    fn by_state(&self, adjoint: &StateAdjoint) -> [Vec<DVec3>; 2] {
        let units = self.units;
        [
            self.to_network(&adjoint.u, 1.0 / units.length),
            self.to_network(&adjoint.v, 1.0 / units.velocity()),
        ]
    }
}

/// Returns the error for a body whose steps have no adjoint.
fn refused(what: &str) -> Error {
    Error::Input(format!("there is no gradient of a motion {what}"))
}

impl CpuBody<f64> {
    pub(super) fn scheme(&self) -> ImplicitScheme {
        self.newton
            .as_ref()
            .map_or_else(Default::default, |n| n.rule)
    }

    fn rigid_poses(&self) -> Vec<Pose> {
        self.newton
            .as_ref()
            .map_or(Vec::new(), |n| n.rigid.now.clone())
    }

    /// Returns changes of velocities of the nodes of the plan with those of interior nodes of rigid
    /// bodies.
    fn extend_change(&self, change: &[V4<f64>]) -> Vec<V4<f64>> {
        let mut all = change.to_vec();
        all.resize(self.state.u.len(), zero());
        if let Some(newton) = &self.newton {
            for b in 0..newton.rigid.bodies.len() {
                newton.rigid.write_velocities(b, false, &mut all);
            }
        }
        all
    }

    /// Prepares the forces of a state.
    ///
    /// # Errors
    /// [`Error::Input`] if nodes are inside a tool, which a step pushes out.
    fn prepare_outside_tools(&mut self) -> Result<()> {
        let before = self.state.u.clone();
        let plan = Arc::clone(&self.plan);
        plan.in_pool(|| self.prepare_forces())
            .map_err(|failure| Error::Input(failure.to_string()))?;
        match self.state.u == before {
            true => Ok(()),
            false => Err(refused(
                "of a body whose nodes begin inside a tool; begin without contact",
            )),
        }
    }

    /// Checks that the steps of the body have an adjoint.
    fn check_motion(&self) -> Result<()> {
        if self.newton.is_none() {
            return Err(refused(
                "of springs, whose steps are linearised; use --material neo-hookean (or corotated)",
            ));
        }
        if !self.moving_constraints.is_empty() {
            return Err(refused(
                "of a body with self-contact whose grabbed nodes still have to arrive; take a step first",
            ));
        }
        Ok(())
    }

    /// Removes the derivatives by what a step does not have from the state before it. Returns those
    /// by the positions of its constrained nodes, 1/m.
    fn drop_constrained(&self, step: &StepLoads, adjoint: &mut StateAdjoint) -> Vec<DVec3> {
        let mut by_position = vec![zero(); self.state.u.len()];
        for (i, ..) in &step.constrained {
            by_position[*i] = std::mem::take(&mut adjoint.u[*i]);
            adjoint.v[*i] = zero();
        }
        if step.is_first {
            adjoint.torques.clear();
        }
        self.to_network(&by_position, 1.0 / self.units.length)
    }

    /// Adds `weight` times the derivatives of a force on a tool through friction, by the shown
    /// state.
    fn add_friction_gradient(&self, seed: &AdjointSeed, weight: f64, adjoint: &mut StateAdjoint) {
        let (Some((tool, direction)), Some(contact)) = (seed.tool, tool_contact(&self.terms))
        else {
            return;
        };
        let at = StateRef {
            u: &self.state.u[..],
            v: &self.state.v,
        };
        adjoint.v.resize(self.state.u.len(), zero());
        let direction = self.units.force() * weight * direction;
        for (i, [by_u, by_v]) in contact.tool_friction_gradient(at, (tool, direction)) {
            adjoint.u[i] = add(adjoint.u[i], to_v4(by_u));
            adjoint.v[i] = add(adjoint.v[i], to_v4(by_v));
        }
    }

    /// Moves all nodes to the displacements `u` and rigid bodies to `poses`, and selects the contact
    /// there, with the tools, the friction and the amplitudes of a step.
    fn show_displacements(
        &mut self,
        (u, poses): (&[V4<f64>], &[Pose]),
        step: &StepLoads,
    ) -> Result<()> {
        if !step.levels.is_empty() {
            self.set_levels(&step.levels);
        }
        self.state.u.copy_from_slice(u);
        if let Some(newton) = &mut self.newton {
            newton.rigid.now.copy_from_slice(poses);
        }
        let nodes = (&self.free_mask[..], &*self.plan);
        if let Some(contact) = tool_contact_mut(&mut self.terms) {
            for (tool, [from, to]) in contact.tools.iter_mut().zip(&step.tools) {
                (tool.from, tool.to) = (*from, *to);
            }
            contact.begin(u, nodes, (step.time, 0.0));
            contact.set_tool_fraction(1.0);
            contact.update_lagged_friction(u);
        }
        if let (Some(newton), Some(term)) = (&self.newton, self_contact_mut(&mut self.terms)) {
            let still = |_: usize| DVec3::ZERO;
            term.begin((u, nodes.0, nodes.1), &newton.rigid, &still);
            if term.is_separating() {
                return Err(refused(
                    "of a body that intersects itself; begin without intersections",
                ));
            }
        }
        Ok(())
    }
}
