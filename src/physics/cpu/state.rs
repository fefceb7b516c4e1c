//! The whole state of a body, to the bit: a run that goes on from it takes the same steps as one
//! that was never left, on as many threads.
//!
//! What is set from outside (pins, loads, attachments) and what follows from the network is not
//! part of it.

use super::body::{CpuBody, Start};
use super::guard::Guard;
use super::implicit::{Basis, Scene};
use super::real::Real;
use super::rigid_pose::Pose;
use super::terms::At;
use super::vectors::V4;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// What [`CpuBody::state`] gives: vectors in local units, nodes in the engine's order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct BodyState<T> {
    /// Displacements from the rest positions.
    pub u: Vec<V4<T>>,
    /// Velocities.
    pub v: Vec<V4<T>>,
    /// Of velocity Verlet: the velocities that the last forces saw; else none.
    pub seen: Vec<V4<T>>,
    /// Of implicit Euler: the last solutions, newest first.
    pub solutions: Vec<Vec<V4<T>>>,
    /// Of implicit Euler: what its coarse space was built from.
    pub basis: Option<Basis<T>>,
    /// What the rule against runaways remembers.
    pub guard: Guard,
    /// Length of the last step, local units; 0 where the next is a first one.
    pub lag: f64,
    /// Steps taken.
    pub steps: u64,
    /// Where rigid bodies are: shift and turn.
    pub poses: Vec<[f64; 7]>,
    /// And the torque on each in the last step, of the midpoint rule.
    pub torques: Vec<[f64; 3]>,
    /// Where tools are.
    pub tools: Vec<[f64; 7]>,
    /// Whether forces are as old as the state, only older than what acts, or of no use.
    pub begin: u8,
}

impl<T: Real> CpuBody<T> {
    /// The state.
    pub fn state(&self) -> BodyState<T> {
        let implicit = self.implicit.as_ref();
        BodyState {
            u: self.now.u.clone(),
            v: self.now.v.clone(),
            seen: self.now.seen.clone(),
            solutions: implicit.map_or(Vec::new(), |i| i.solver.known[..i.solver.count].to_vec()),
            basis: implicit.map(|i| Basis {
                left: self.newton.as_ref().map_or(0, |n| n.projected),
                ..i.basis.clone()
            }),
            guard: self.guard,
            lag: self.lag,
            steps: self.steps,
            poses: self.newton.as_ref().map_or(Vec::new(), |n| {
                n.rigid.now.iter().map(Pose::numbers).collect()
            }),
            torques: self.newton.as_ref().map_or(Vec::new(), |n| {
                n.rigid.torques.iter().map(|t| t.to_array()).collect()
            }),
            tools: self.tool_places(),
            begin: match self.start {
                Start::Ready => 0,
                Start::Resume => 1,
                Start::Restart => 2,
            },
        }
    }

    /// Goes on from a state that [`CpuBody::state`] gave of this body or of one made in the same
    /// way, which had the same pins, loads and attachments: set those before.
    ///
    /// # Errors
    /// [`Error::Input`] for the state of another body.
    pub fn resume(&mut self, state: &BodyState<T>) -> Result<()> {
        let (slots, nodes) = (self.now.u.len(), self.plan.nodes());
        let bodies = self.newton.as_ref().map_or(0, |n| n.rigid.bodies.len());
        let fits = state.u.len() == slots
            && state.v.len() == slots
            && state.poses.len() == bodies
            && state.torques.len() == bodies
            && state.tools.len() == self.tool_places().len()
            && state.seen.len() == self.now.seen.len()
            && state.solutions.len() <= 2
            && state.solutions.iter().all(|s| s.len() == nodes)
            && state.basis.is_some() == self.implicit.is_some()
            && state.basis.as_ref().is_none_or(|b| b.u.len() == nodes)
            && state
                .basis
                .as_ref()
                .is_none_or(|b| [0, slots].contains(&b.lagged.len()))
            && state
                .basis
                .as_ref()
                .is_none_or(|b| [0, bodies].contains(&b.poses.len()))
            && state.begin <= 2;
        if !fits {
            return Err(Error::Input(
                "the state of another body, or a damaged one".into(),
            ));
        }
        self.now.u.copy_from_slice(&state.u);
        self.now.v.copy_from_slice(&state.v);
        self.now.seen.copy_from_slice(&state.seen);
        self.guard = state.guard;
        self.lag = state.lag;
        self.steps = state.steps;
        if let Some(newton) = &mut self.newton {
            for (pose, numbers) in newton.rigid.now.iter_mut().zip(&state.poses) {
                *pose = Pose::of_numbers(*numbers);
            }
            for (torque, numbers) in newton.rigid.torques.iter_mut().zip(&state.torques) {
                *torque = (*numbers).into();
            }
        }
        self.resume_tools(&state.tools);
        // Forces are made anew in any case, from the same numbers.
        self.start = match state.begin {
            2 => Start::Restart,
            _ => Start::Resume,
        };
        if let (Some(implicit), Some(basis)) = (&mut self.implicit, &state.basis) {
            implicit.solver.count = state.solutions.len();
            for (known, s) in implicit.solver.known.iter_mut().zip(&state.solutions) {
                known.copy_from_slice(s);
            }
            let scene = Scene {
                plan: &self.plan,
                masses: &self.masses,
                free: &self.free,
                rest: &self.rest_local,
                at: At {
                    u: &self.now.u,
                    v: &self.now.v,
                },
                f: &self.now.f,
            };
            // The coarse space is of the levels that it was built at.
            let terms = &mut self.terms;
            terms.iter_mut().for_each(|t| t.set_levels(&basis.levels));
            match &mut self.newton {
                Some(newton) => newton.resume(implicit, &scene, terms, basis.clone()),
                None => implicit.resume(&scene, terms, basis.clone()),
            }
            let levels = &implicit.levels;
            terms.iter_mut().for_each(|t| t.set_levels(levels));
        }
        Ok(())
    }
}
