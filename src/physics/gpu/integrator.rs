//! What a step on the GPU is made of: a short list of stages.
//!
//! An [`Integrator`] says which passes propose the next state; [`Stepper`](crate::physics::Stepper) puts
//! them into the chain that every step is: propose, weigh, check, commit. A step that is found
//! unsound, or comes after one, changes nothing. Stages are passes over whatever arrays the
//! integrator keeps, written in WGSL that is the library's or the caller's own
//! ([`add_shader`](crate::gpu::add_shader)).

pub use super::step_resources::StepResources;
use crate::gpu::{Array, Pass};
use crate::physics::{GpuBody, SolverKind};
use crate::{Error, Result};

/// A scheme that steps a [`GpuBody`] on the GPU.
pub trait Integrator: Sized + Send {
    /// Which one it is; of one of the caller's own: that whose stable step and advice are its own.
    const KIND: SolverKind;

    /// What tells its states from those of others.
    const NAME: &'static str = Self::KIND.name();

    /// Whether it moves rigid regions as one body; others are given no body that has any.
    const SUPPORTS_RIGID: bool = false;

    /// What it keeps on the GPU.
    ///
    /// # Errors
    /// What the device refuses.
    fn new(core: &StepResources, body: &GpuBody) -> Result<Self>;

    /// Makes what it keeps as long as a cut has made the body; the steps that follow start
    /// afresh.
    ///
    /// # Errors
    /// What the device refuses.
    fn apply_cut(&mut self, core: &StepResources, body: &GpuBody) -> Result<()> {
        *self = Self::new(core, body)?;
        Ok(())
    }

    /// What its step is made of.
    ///
    /// # Errors
    /// What the device refuses.
    fn step(&self, core: &StepResources, body: &GpuBody, timing: Timing) -> Result<Step>;

    /// What it carries from one step to the next, apart from the state of the body.
    fn history_arrays(&self) -> Vec<&Array> {
        Vec::new()
    }

    /// Rounds of its loops at most, 0 where it has none.
    fn max_iterations(&self) -> u32 {
        0
    }
}

/// The length of a step, in local units (see [`LocalUnits`](crate::physics::LocalUnits)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// This step's.
    pub dt: f32,
    /// The step before's.
    pub previous_dt: f32,
}

/// A step from one state to the next.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Before anything else after a change of positions or velocities from outside: makes what was
    /// set a state that the scheme can step from.
    pub on_external_change: Vec<Pass>,
    /// In their order. One of them is [`Stage::Forces`], at the candidate state.
    pub stages: Vec<Stage>,
    /// In place of the first stage in a first step, and in one after a change from outside.
    pub first_stage_on_restart: Option<Stage>,
    /// In place of the first stage in the first step after a change of its length.
    pub after_change: Option<Stage>,
}

/// A part of a step.
#[derive(Clone, Debug)]
pub enum Stage {
    /// Passes, one after the other.
    Passes(Vec<Pass>),
    /// Rounds of a solve that stops on the GPU.
    Loop {
        /// Before every few rounds: sets the workgroups of their indirect dispatches, to 0 when the
        /// solve is done.
        gate: Pass,
        /// Two rounds, from one slot of ping-pong to the other and back; each takes half of them.
        rounds: Vec<Pass>,
        /// After every few rounds: what looks whether they are done, and goes on from there.
        between: Vec<Pass>,
    },
    /// The forces and energies of the candidate state, those of all terms in one pass a node. They
    /// are seen with these velocities, where not with the candidate's.
    Forces(Option<Array>),
}

impl Step {
    /// One pass, and the forces after it: what most explicit schemes are.
    pub fn explicit(pass: Pass) -> Step {
        Step {
            stages: vec![Stage::Passes(vec![pass]), Stage::Forces(None)],
            ..Step::default()
        }
    }

    /// The velocities that the candidate's forces see, where not the candidate's.
    ///
    /// # Errors
    /// [`Error::Input`] for a step that does not weigh its candidate exactly once, or whose forces
    /// are exchanged for something else in a first step.
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
                "a step of an integrator has exactly one stage of forces, which weighs the candidate state, and not as its first stage if that is exchanged; add Stage::Forces after the passes that write the candidate".into(),
            )),
        }
    }
}
