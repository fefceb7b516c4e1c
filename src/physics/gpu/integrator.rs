//! The stages of a step on the GPU.
//!
//! An [`Integrator`] defines the passes that propose the next state; [`Stepper`](super::Stepper)
//! embeds them in the chain of every step: propose, evaluate, check, commit. A rejected step, and
//! every step after it, changes nothing. Stages are passes over arrays of the integrator, written
//! in WGSL of this library or of the caller ([`Shaders::add`](crate::gpu::Shaders::add)).

pub use super::step_resources::StepResources;
use crate::gpu::{Array, Pass};
use crate::physics::{GpuBody, SolverKind};
use crate::{Error, Result};

/// A scheme that steps a [`GpuBody`] on the GPU.
pub trait Integrator: Sized + Send {
    /// The solver kind; for a custom scheme, the kind with the same stable step and advice.
    const KIND: SolverKind;

    /// Identifies its saved states.
    const NAME: &'static str = Self::KIND.name();

    /// Whether it supports rigid regions; others reject bodies that have any.
    const SUPPORTS_RIGID: bool = false;

    /// Creates its data on the GPU.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn new(core: &StepResources, body: &GpuBody) -> Result<Self>;

    /// Resizes its data after a cut of the body; the following steps restart.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn apply_cut(&mut self, core: &StepResources, body: &GpuBody) -> Result<()> {
        *self = Self::new(core, body)?;
        Ok(())
    }

    /// The passes of a step.
    ///
    /// # Errors
    /// An error if the device rejects the work.
    fn step(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Step>;

    /// The arrays that it carries from step to step, besides the state of the body.
    fn history_arrays(&self) -> Vec<&Array> {
        Vec::new()
    }

    /// Maximum number of loop iterations; 0 without a loop.
    fn max_iterations(&self) -> u32 {
        0
    }
}

/// Time steps, in local units (see [`LocalUnits`](crate::physics::LocalUnits)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// The present step.
    pub dt: f32,
    /// The previous step.
    pub previous_dt: f32,
}

/// The passes of a step from one state to the next.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Run first after an external change of positions or velocities: passes that convert the new
    /// state to one that the scheme can step from.
    pub on_external_change: Vec<Pass>,
    /// The stages in order. One of them is [`Stage::Forces`], at the candidate state.
    pub stages: Vec<Stage>,
    /// Replaces the first stage in a first step, and in a step after an external change.
    pub first_stage_on_restart: Option<Stage>,
    /// Replaces the first stage in the first step after a change of the step length.
    pub after_change: Option<Stage>,
}

/// A stage of a step.
#[derive(Clone, Debug)]
pub enum Stage {
    /// Passes in order.
    Passes(Vec<Pass>),
    /// Iterations of a solve that stops on the GPU.
    Loop {
        /// Before every few iterations: sets the workgroups of their indirect dispatches, to 0 once
        /// the solve has converged.
        gate: Pass,
        /// Two iterations, from one buffer of the ping-pong pair to the other and back; each takes
        /// half of the passes.
        rounds: Vec<Pass>,
        /// After every few iterations: passes that check for convergence and continue from there.
        between: Vec<Pass>,
    },
    /// The forces and energies of the candidate state, of all terms in one pass over the nodes;
    /// evaluated with these velocities instead of the candidate's, if given.
    Forces(Option<Array>),
}

impl Step {
    /// A step of one pass followed by the forces, as in most explicit schemes.
    pub fn explicit(pass: Pass) -> Step {
        Step {
            stages: vec![Stage::Passes(vec![pass]), Stage::Forces(None)],
            ..Step::default()
        }
    }

    /// The velocities at which the candidate's forces are evaluated, if not the candidate's own.
    ///
    /// # Errors
    /// [`Error::Input`] for a step that does not have exactly one forces stage, or replaces it in a
    /// first step.
    pub(in crate::physics) fn velocities(&self) -> Result<Option<&Array>> {
        let replaced = self.first_stage_on_restart.is_some() || self.after_change.is_some();
        let kept = self.stages.iter().skip(usize::from(replaced));
        let mut forces = kept.filter_map(|stage| match stage {
            Stage::Forces(velocities) => Some(velocities.as_ref()),
            _ => None,
        });
        match (forces.next(), forces.next()) {
            (Some(velocities), None) => Ok(velocities),
            _ => Err(Error::Input(
                "a step of an integrator must have exactly one stage of forces, which evaluates the candidate state and is not a first stage that is replaced; add Stage::Forces after the passes that write the candidate".into(),
            )),
        }
    }
}
