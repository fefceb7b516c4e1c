//! Bitwise checkpoint and restore of grid bodies.

use super::body::GridBody;
use super::verlet::BufferIndices;
use crate::physics::gpu::state::restore_array;
use crate::physics::loads::LoadsState;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The state of a [`GridBody`]: see [`GridBody::state`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridState {
    positions: [Vec<[f32; 4]>; 3],
    normals: Vec<u32>,
    velocities: Vec<[f32; 4]>,
    external: Vec<[f32; 4]>,
    /// Indices of the arrays with the last and the previous positions.
    turn: [u8; 2],
    lag: Option<f64>,
    steps: u64,
    time: f64,
    changes: u64,
    speed: f64,
    loads: LoadsState,
}

impl GridBody {
    /// Reads back the complete state that steps and grabs change. Springs are not included.
    ///
    /// # Errors
    /// As [`Gpu::read_array`](crate::gpu::Gpu::read_array).
    pub fn state(&self) -> Result<GridState> {
        let gpu = &self.gpu;
        let [a, b, c] = &self.positions;
        Ok(GridState {
            positions: [gpu.read_array(a)?, gpu.read_array(b)?, gpu.read_array(c)?],
            normals: gpu.read_array(&self.normals)?,
            velocities: gpu.read_array(&self.velocities)?,
            external: gpu.read_array(&self.external)?,
            turn: [self.buffers.now as u8, self.buffers.before as u8],
            lag: self.previous_dt,
            steps: self.steps,
            time: self.time,
            changes: self.changes,
            speed: self.speed,
            loads: self.loads.state(),
        })
    }

    /// Restores a state from [`GridBody::state`] of this body, or of one with the same model and
    /// cuts.
    ///
    /// # Errors
    /// [`Error::Input`] if the state is of another body.
    pub fn set_state(&mut self, state: &GridState) -> Result<()> {
        let [now, before] = state.turn.map(usize::from);
        let sound = now < 3 && before < 3 && now != before;
        if !sound || state.lag.is_some_and(|lag| !(lag.is_finite() && lag > 0.0)) {
            return Err(Error::Input(
                "the saved state is of another body, or damaged".into(),
            ));
        }
        for (array, texels) in self.positions.iter().zip(&state.positions) {
            restore_array(&self.gpu, array, texels)?;
        }
        restore_array(&self.gpu, &self.normals, &state.normals)?;
        restore_array(&self.gpu, &self.velocities, &state.velocities)?;
        restore_array(&self.gpu, &self.external, &state.external)?;
        self.loads.set_state(&state.loads)?;
        self.written = None;
        self.buffers = BufferIndices { now, before };
        self.previous_dt = state.lag;
        (self.steps, self.time) = (state.steps, state.time);
        (self.changes, self.speed) = (state.changes, state.speed);
        self.dirty = true;
        self.pending_steps.clear();
        self.in_flight = None;
        self.ring.clear();
        Ok(())
    }

    /// Restores the positions and normals at the time of a cut.
    pub(crate) fn place_particles(&mut self, texels: &[[f32; 4]], normals: &[u32]) -> Result<()> {
        restore_array(&self.gpu, self.nodes.array(), texels)?;
        restore_array(&self.gpu, &self.normals, normals)?;
        Ok(())
    }
}
