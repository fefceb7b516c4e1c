//! Checkpoints of a body, bitwise exact: a resumed run takes the same steps as an uninterrupted one
//! with the same number of threads.
//!
//! External settings (pins, loads, attachments) and data derived from the network are not included.

use super::{CpuBody, ForceStatus};
use crate::physics::cpu::implicit::linear_step::{CoarseSpaceState, StepContext};
use crate::physics::cpu::rigid::pose::Pose;
use crate::physics::cpu::runtime::energy_guard::EnergyGuard;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::V4;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// State from [`CpuBody::state`]: vectors in local units, nodes in the engine's order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::physics::cpu) struct BodyState<T> {
    /// Displacements from the rest positions.
    pub u: Vec<V4<T>>,
    /// Velocities.
    pub v: Vec<V4<T>>,
    /// For velocity Verlet: the velocities at which the last forces were evaluated; otherwise
    /// empty.
    pub damping_velocities: Vec<V4<T>>,
    /// For implicit Euler: the last solutions, newest first.
    pub solutions: Vec<Vec<V4<T>>>,
    /// For implicit Euler: the state from which its coarse space was built.
    pub basis: Option<CoarseSpaceState<T>>,
    /// Energy balance of the runaway check.
    pub guard: EnergyGuard,
    /// Length of the last step, local units; 0 if the scheme restarts.
    pub previous_dt: f64,
    /// Number of steps taken.
    pub steps: u64,
    /// Poses of rigid bodies: translation and rotation.
    pub poses: Vec<[f64; 7]>,
    /// Torque on each rigid body in the last step, for the midpoint rule.
    pub torques: Vec<[f64; 3]>,
    /// Poses of tools.
    pub tools: Vec<[f64; 7]>,
    /// Whether the forces match the state, predate the loads, or are invalid.
    pub force_status: u8,
}

impl<T: Real> CpuBody<T> {
    /// The state.
    pub(in crate::physics::cpu) fn state(&self) -> BodyState<T> {
        let implicit = self.implicit.as_ref();
        BodyState {
            u: self.state.u.clone(),
            v: self.state.v.clone(),
            damping_velocities: self.state.damping_velocities.clone(),
            solutions: implicit.map_or(Vec::new(), |i| {
                i.solver.previous_solutions[..i.solver.count].to_vec()
            }),
            basis: implicit.map(|i| CoarseSpaceState {
                projected_solves_left: self.newton.as_ref().map_or(0, |n| n.projected),
                ..i.coarse_state.clone()
            }),
            guard: self.guard,
            previous_dt: self.previous_dt,
            steps: self.steps,
            poses: self.newton.as_ref().map_or(Vec::new(), |n| {
                n.rigid.now.iter().map(|pose| pose.to_array()).collect()
            }),
            torques: self.newton.as_ref().map_or(Vec::new(), |n| {
                n.rigid.torques.iter().map(|t| t.to_array()).collect()
            }),
            tools: self.tool_places(),
            force_status: match self.start {
                ForceStatus::Ready => 0,
                ForceStatus::Resume => 1,
                ForceStatus::Restart => 2,
            },
        }
    }

    /// Restores a state from [`CpuBody::state`] of this body or of one made in the same way with
    /// the same pins, loads and attachments, which must be set before.
    ///
    /// # Errors
    /// [`Error::Input`] for the state of another body.
    pub(in crate::physics::cpu) fn resume(&mut self, state: &BodyState<T>) -> Result<()> {
        if !self.fits(state) {
            return Err(Error::Input(
                "the saved state is of another body, or damaged".into(),
            ));
        }
        self.state.u.copy_from_slice(&state.u);
        self.state.v.copy_from_slice(&state.v);
        self.state
            .damping_velocities
            .copy_from_slice(&state.damping_velocities);
        self.guard = state.guard;
        self.previous_dt = state.previous_dt;
        self.steps = state.steps;
        if let Some(newton) = &mut self.newton {
            for (pose, numbers) in newton.rigid.now.iter_mut().zip(&state.poses) {
                *pose = Pose::from_array(*numbers);
            }
            for (torque, numbers) in newton.rigid.torques.iter_mut().zip(&state.torques) {
                *torque = (*numbers).into();
            }
        }
        self.resume_tools(&state.tools);
        // Forces are recomputed in any case, from the same numbers.
        self.start = match state.force_status {
            2 => ForceStatus::Restart,
            _ => ForceStatus::Resume,
        };
        if let (Some(implicit), Some(basis)) = (&mut self.implicit, &state.basis) {
            implicit.solver.count = state.solutions.len();
            for (known, s) in implicit
                .solver
                .previous_solutions
                .iter_mut()
                .zip(&state.solutions)
            {
                known.copy_from_slice(s);
            }
            let scene = StepContext {
                plan: &self.plan,
                masses: &self.masses,
                free: &self.free_mask,
                rest: &self.rest_local,
                at: StateRef {
                    u: &self.state.u,
                    v: &self.state.v,
                },
                f: &self.state.f,
            };
            // The coarse space is rebuilt with the amplitudes it was built at.
            let terms = &mut self.terms;
            terms
                .iter_mut()
                .for_each(|t| t.set_amplitudes(&basis.levels));
            match &mut self.newton {
                Some(newton) => newton.resume(implicit, &scene, terms, basis.clone()),
                None => implicit.resume(&scene, terms, basis.clone()),
            }
            let levels = &implicit.levels;
            terms.iter_mut().for_each(|t| t.set_amplitudes(levels));
        }
        Ok(())
    }

    /// Whether a state has the sizes of this body's.
    fn fits(&self, state: &BodyState<T>) -> bool {
        let (slots, nodes) = (self.state.u.len(), self.plan.nodes());
        let bodies = self.newton.as_ref().map_or(0, |n| n.rigid.bodies.len());
        state.u.len() == slots
            && state.v.len() == slots
            && state.poses.len() == bodies
            && state.torques.len() == bodies
            && state.tools.len() == self.tool_places().len()
            && state.damping_velocities.len() == self.state.damping_velocities.len()
            && state.solutions.len() <= 2
            && state.solutions.iter().all(|s| s.len() == nodes)
            && state.basis.is_some() == self.implicit.is_some()
            && state.basis.as_ref().is_none_or(|b| b.u.len() == nodes)
            && state
                .basis
                .as_ref()
                .is_none_or(|b| [0, slots].contains(&b.damping_displacements.len()))
            && state
                .basis
                .as_ref()
                .is_none_or(|b| [0, bodies].contains(&b.poses.len()))
            && state.force_status <= 2
    }
}
