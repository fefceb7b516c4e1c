//! Bitwise checkpoint and restore of a body and its solver on the GPU: a resumed run takes the same
//! steps as an uninterrupted one.
//!
//! The state excludes quantities that follow from the mesh, the material and the cuts (masses,
//! springs, pins), and those that every recording of steps recomputes (forces, candidates, the
//! vectors of conjugate gradients).

use super::grab_lists::GrabLists;
use super::integrator::{Integrator, Timing};
use super::status::gpu_data::Status;
use super::status::{Clock, HISTORY};
use super::stepper::Stepper;
use crate::gpu::{Array, Gpu};
use crate::physics::GpuBody;
use crate::physics::loads::{LoadVersions, LoadsState};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Grabbed nodes in [`BodyState`].
/// The state of a [`GpuBody`]: see [`GpuBody::state`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyState {
    positions: Vec<[f32; 4]>,
    velocities: Vec<[f32; 4]>,
    external: Vec<[f32; 4]>,
    /// Number of cuts.
    generation: u64,
    /// Number of external changes of positions and velocities.
    moves: u64,
    loads: LoadsState,
    /// Versions of the loads on the GPU.
    written: Option<LoadVersions>,
}

/// The state of a [`Solver`](crate::physics::Solver): see [`Solver::state`](crate::physics::Solver::state).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolverState {
    kind: String,
    status: Vec<u32>,
    history: Vec<[f32; 4]>,
    clock: Clock,
    /// Number of iterations given to a step.
    iterations: u32,
    /// Number of cuts applied to the solver.
    generation: u64,
    /// Step size, and revisions of the body, from which the next step continues; `None` if it
    /// restarts.
    prepared: Option<(f64, [u64; 2])>,
    /// The arrays that the scheme carries from step to step.
    integrator_history: Vec<Vec<[f32; 4]>>,
}

/// Writes `texels` into `array`; fails if their number does not match its length.
pub(in crate::physics) fn restore_array<T: bytemuck::Pod>(
    gpu: &Gpu,
    array: &Array,
    texels: &[T],
) -> Result<()> {
    if texels.len() == array.len() as usize {
        return gpu.write_array(array, texels);
    }
    Err(Error::Input(format!(
        "the saved state is of {} nodes, but the body has {}",
        texels.len(),
        array.len()
    )))
}

impl GpuBody {
    /// Reads back everything that steps, grabs and cuts change; of its topology only the number of
    /// cuts.
    ///
    /// # Errors
    /// As [`Gpu::read_array`].
    pub fn state(&self) -> Result<BodyState> {
        Ok(BodyState {
            positions: self.nodes.local()?,
            velocities: self.gpu.read_array(&self.velocities)?,
            external: self.gpu.read_array(&self.external)?,
            generation: self.generation,
            moves: self.state_changes,
            loads: self.loads.state(),
            written: self.uploaded_loads,
        })
    }

    /// Restores a state from [`GpuBody::state`] of this body, or of one created and cut in the same
    /// manner. Restore the state of its solver afterwards with
    /// [`Solver::set_state`](crate::physics::Solver::set_state).
    ///
    /// # Errors
    /// [`Error::Input`] if the state is of another body, or of one with other cuts.
    pub fn set_state(&mut self, state: &BodyState) -> Result<()> {
        if state.generation != self.generation {
            return Err(Error::Input(format!(
                "the saved state is of a body with {} cuts or added terms, but this body has {}",
                state.generation, self.generation
            )));
        }
        restore_array(&self.gpu, &self.velocities, &state.velocities)?;
        restore_array(&self.gpu, &self.external, &state.external)?;
        restore_array(&self.gpu, self.nodes.array(), &state.positions)?;
        self.loads.set_state(&state.loads)?;
        // Everything is recomputed except the external forces, which grabs and callers write on the
        // GPU.
        self.grabs = GrabLists::new(&self.gpu, &self.loads, |_| 1.0)?;
        self.upload_masses_and_fixed_nodes()?;
        if let Some(contact) = &mut self.contact {
            contact.reset_tools(&self.loads);
        }
        self.uploaded_loads = state.written;
        self.state_changes = state.moves;
        Ok(())
    }

    /// Sets the exact positions at the time of a cut, without velocities.
    pub(crate) fn set_exact_positions(&mut self, texels: &[[f32; 4]]) -> Result<()> {
        restore_array(&self.gpu, self.nodes.array(), texels)?;
        Ok(())
    }
}

impl<S: Integrator> Stepper<S> {
    pub(in crate::physics) fn read_state(&self) -> Result<SolverState> {
        let gpu = &self.core.gpu;
        let status: Vec<Status> = gpu.read_buffer(&self.core.status)?;
        let carried = self.scheme.history_arrays().into_iter();
        Ok(SolverState {
            kind: S::NAME.to_owned(),
            status: bytemuck::cast_slice(&status).to_vec(),
            history: gpu.read_buffer(&self.core.history)?,
            clock: self.clock.clone(),
            iterations: self.iterations,
            generation: self.core.generation,
            prepared: self.prepared.as_ref().map(|p| {
                let super::body::ChangeCounter { state, any } = p.revision;
                (p.dt, [state, any])
            }),
            integrator_history: carried
                .map(|array| gpu.read_array(array))
                .collect::<Result<_>>()?,
        })
    }

    pub(in crate::physics) fn write_state(
        &mut self,
        body: &GpuBody,
        state: &SolverState,
    ) -> Result<()> {
        let words = size_of::<Status>() / size_of::<u32>();
        let wrong = |what: String| Err(Error::Input(what));
        if state.kind != S::NAME {
            return wrong(format!(
                "the saved state is of the solver {}, not {}",
                state.kind,
                S::NAME
            ));
        }
        let sound = state.status.len() == words
            && state.history.len() == HISTORY as usize
            && state.iterations >= self.iterations.min(1)
            && state.iterations <= S::max_iterations(&self.scheme)
            && state.generation <= body.generation
            && state.clock.is_valid();
        if body.id != self.core.body || !sound {
            return wrong("the saved state is of another solver, or damaged".to_owned());
        }
        let gpu = self.core.gpu.clone();
        let queue = gpu.queue();
        queue.write_buffer(&self.core.status, 0, bytemuck::cast_slice(&state.status));
        queue.write_buffer(&self.core.history, 0, bytemuck::cast_slice(&state.history));
        self.clock = state.clock.clone();
        self.iterations = state.iterations;
        self.clear_pending();
        self.status_stale = false;
        self.prepared = None;
        if state.generation != body.generation {
            // The body was cut after the last step, so the next step restarts anyway.
            return Ok(());
        }
        self.core.follow(body)?;
        self.scheme.apply_cut(&self.core, body)?;
        let arrays = self.scheme.history_arrays();
        if arrays.len() != state.integrator_history.len() {
            return wrong("the saved state is of another solver, or damaged".to_owned());
        }
        for (array, texels) in arrays.into_iter().zip(&state.integrator_history) {
            restore_array(&gpu, array, texels)?;
        }
        let Some((dt, [state, any])) = state.prepared else {
            return Ok(());
        };
        let local_dt = (dt / body.units.time) as f32;
        if !(dt > 0.0 && dt.is_finite() && local_dt.is_normal()) {
            return wrong(format!("the saved state is damaged: time step {dt} s"));
        }
        let timing = Timing {
            dt: local_dt,
            previous_dt: local_dt,
        };
        let step = self.scheme.step(&self.core, body, timing)?;
        let mut prepared = self.core.prepare(body, step, dt, local_dt)?;
        prepared.revision = super::body::ChangeCounter { state, any };
        self.prepared = Some(prepared);
        Ok(())
    }
}
