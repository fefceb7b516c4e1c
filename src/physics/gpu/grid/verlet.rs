//! Verlet integration of grid bodies, cycling through three position arrays: previous, last and
//! next step.

use super::body::GridBody;
use crate::gpu::{Array, Gpu, Pass, Recorder};
use crate::physics::gpu::grab_lists::GrabLists;
use crate::physics::grid::shape::MIN_NORMAL_SUM;
use crate::physics::simulator::time_step::check_time_step;
use crate::{Error, FailureCause, Result};
use glam::DVec3;

mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/physics/grid_verlet.wgsl`.
        pub struct GridParams {
            pub springs: [[f32; 4]; 9],
            pub pull: [f32; 4],
            pub count: u32,
            pub damping_factor: f32,
            pub acceleration_scale: f32,
            pub least_normal: f32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/grid_start.wgsl`.
        pub struct StartParams {
            pub count: u32,
            pub ratio: f32,
            pub h: f32,
            pub _pad0: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/grid_check.wgsl`.
        pub struct GridCheckParams {
            pub count: u32,
        }
    }
    crate::gpu_struct! {
        /// See `shaders/physics/grid_check.wgsl`.
        pub struct GridStatus {
            pub out_of_range: f32,
            pub motion: f32,
            pub reach: f32,
            pub _pad0: u32,
        }
    }
}
use gpu_data::{GridCheckParams, GridParams, GridStatus, StartParams};

/// Maximum distance from the frame's centre, in body sizes; beyond it the body counts as diverged.
const MAX_DISTANCE: f32 = 1e4;

/// Maximum number of steps per submit.
const STEPS_A_SUBMIT: u32 = 256;

/// Indices of the position arrays that hold the last and the previous step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::physics) struct BufferIndices {
    pub now: usize,
    pub before: usize,
}

impl BufferIndices {
    pub const FIRST: BufferIndices = BufferIndices { now: 0, before: 1 };

    /// Index of the free array.
    fn next(self) -> usize {
        3 - self.now - self.before
    }

    fn step(self) -> BufferIndices {
        BufferIndices {
            now: self.next(),
            before: self.now,
        }
    }
}

/// The dependencies of the prepared passes.
#[derive(Debug)]
pub(in crate::physics) struct Prepared {
    dt: f64,
    gravity: DVec3,
    /// For each assignment of the arrays: the step pass, and the step pass that writes normals too.
    steps: Vec<(BufferIndices, [Pass; 2])>,
}

/// The grab passes, for each position array: one that sets the positions of followed particles, and
/// one that computes spring forces.
#[derive(Debug, Default)]
pub(in crate::physics) struct GrabPasses {
    hold: Vec<Option<Pass>>,
    draw: Vec<Option<Pass>>,
}

impl GrabPasses {
    pub fn new(
        gpu: &Gpu,
        grabs: &GrabLists,
        positions: &[Array; 3],
        external: &Array,
    ) -> Result<GrabPasses> {
        let hold = positions
            .iter()
            .map(|p| grabs.prescribed_positions_pass(gpu, p));
        let draw = positions
            .iter()
            .map(|p| grabs.grab_springs_pass(gpu, p, external));
        Ok(GrabPasses {
            hold: hold.collect::<Result<_>>()?,
            draw: draw.collect::<Result<_>>()?,
        })
    }
}

/// Submitted steps, and what to restore if they fail.
#[derive(Debug)]
pub(in crate::physics) struct InFlightSteps {
    turn: BufferIndices,
    lag: Option<f64>,
    /// Number of steps and time before them.
    pub clock: (u64, f64),
    steps: u32,
    dt: f64,
}

/// Size of the status, in bytes.
pub(in crate::physics) const STATUS: u64 = size_of::<GridStatus>() as u64;

fn record(passes: &[Option<Pass>], n: usize, work: &mut Recorder) {
    if let Some(Some(pass)) = passes.get(n) {
        pass.record(work);
    }
}

impl GridBody {
    /// Runs `steps` Verlet steps of `dt` seconds and checks the result.
    ///
    /// # Errors
    /// As [`GridBody::advance`] and [`GridBody::finish`].
    pub fn run(&mut self, steps: u32, dt: f64) -> Result<()> {
        self.advance(steps, dt)?;
        self.finish()
    }

    /// Requests `steps` more steps of `dt` seconds and submits the first of them, without waiting.
    ///
    /// # Errors
    /// [`Error::Input`] if the step is invalid, [`Error::Gpu`] if the device rejects the work.
    pub fn advance(&mut self, steps: u32, dt: f64) -> Result<()> {
        check_time_step(dt)?;
        if steps > 0 {
            self.pending_steps.push_back((steps, dt));
        }
        self.submit_pending()
    }

    /// Waits for all requested steps.
    ///
    /// # Errors
    /// As [`GridBody::poll`].
    pub fn finish(&mut self) -> Result<()> {
        while self.ring.in_flight() > 0 || !self.pending_steps.is_empty() {
            self.submit_pending()?;
            self.poll(true)?;
        }
        Ok(())
    }

    /// Polls, or waits for, the submitted steps, and submits more.
    ///
    /// # Errors
    /// [`Error::Solver`] if particles diverged: the body is restored to the state before the last
    /// submit of at most 256 steps, and the remaining steps are dropped.
    pub fn poll(&mut self, wait: bool) -> Result<()> {
        let Some(status) = self.ring.next_completed::<GridStatus>(wait)? else {
            return Ok(());
        };
        if let (Some(flight), Some(status)) = (self.in_flight.take(), status.first()) {
            let dt = flight.dt;
            let sound = status.out_of_range == 0.0 && status.reach < MAX_DISTANCE * MAX_DISTANCE;
            if !sound {
                self.pending_steps.clear();
                self.restore_backup(&flight)?;
                return Err(self.failure(flight.steps, dt));
            }
            let mean = f64::from(status.motion) / f64::from(self.particles.len());
            self.speed = mean.sqrt() / dt;
        }
        self.submit_pending()
    }

    /// Submits requested steps if none are in flight.
    fn submit_pending(&mut self) -> Result<()> {
        if self.ring.in_flight() > 0 {
            return Ok(());
        }
        let Some((left, dt)) = self.pending_steps.pop_front() else {
            return Ok(());
        };
        let some = left.min(STEPS_A_SUBMIT);
        if left > some {
            self.pending_steps.push_front((left - some, dt));
        }
        let flight = InFlightSteps {
            turn: self.buffers,
            lag: self.previous_dt,
            clock: (self.steps, self.time),
            steps: some,
            dt,
        };
        let mut work = self.gpu.start_recording();
        for (backup, n) in self
            .backup
            .iter()
            .zip([flight.turn.now, flight.turn.before])
        {
            work.copy_array(&self.positions[n], backup);
        }
        self.record(&mut work, some, dt)?;
        self.check(&mut work)?;
        self.in_flight = Some(flight);
        self.ring.submit(work, &self.status)
    }

    /// Restores the body to the state before `flight`.
    fn restore_backup(&mut self, flight: &InFlightSteps) -> Result<()> {
        let mut work = self.gpu.start_recording();
        (self.buffers, self.previous_dt) = (flight.turn, flight.lag);
        (self.steps, self.time) = flight.clock;
        for (backup, n) in self
            .backup
            .iter()
            .zip([flight.turn.now, flight.turn.before])
        {
            work.copy_array(backup, &self.positions[n]);
        }
        work.submit()?;
        self.refresh_normals()
    }

    /// Records `steps` Verlet steps of `dt` seconds; the last writes the normals. Nothing is
    /// checked or read back.
    ///
    /// # Errors
    /// [`Error::Input`] if the step is invalid, [`Error::Gpu`] if the device rejects the work.
    pub fn record(&mut self, work: &mut Recorder, steps: u32, dt: f64) -> Result<()> {
        check_time_step(dt)?;
        if steps == 0 {
            return Ok(());
        }
        self.upload_changes()?;
        let gravity = self.loads.gravity();
        let known = self.prepared.take();
        let known = known.filter(|p| p.dt == dt && p.gravity == gravity);
        let prepared = match known {
            Some(prepared) => prepared,
            None => self.prepare(dt)?,
        };
        let mut first = false;
        if self.previous_dt != Some(dt) {
            first = self.previous_dt.is_none();
            self.start(dt)?.record(work);
            // The start pass writes the previous positions into the free array.
            self.buffers.before = self.buffers.next();
        }
        self.previous_dt = Some(dt);
        for step in 0..steps {
            let turn = self.buffers;
            record(&self.grab_passes.draw, turn.now, work);
            if first && step == 0 {
                // A pass for this step only, in which half of the acceleration acts.
                self.step_pass(dt, turn, steps == 1, 0.5)?.record(work);
            } else if let Some((_, passes)) = prepared.steps.iter().find(|s| s.0 == turn) {
                passes[usize::from(step + 1 == steps)].record(work);
            }
            self.buffers = turn.step();
            record(&self.grab_passes.hold, self.buffers.now, work);
        }
        self.copy_to_public_array(work);
        self.prepared = Some(prepared);
        self.steps += u64::from(steps);
        self.time += f64::from(steps) * dt;
        Ok(())
    }

    /// Copies the last positions into the public array.
    fn copy_to_public_array(&mut self, work: &mut Recorder) {
        let BufferIndices { now, before } = self.buffers;
        if now == 0 {
            return;
        }
        if before == 0 {
            let free = self.buffers.next();
            work.copy_array(&self.positions[0], &self.positions[free]);
            self.buffers.before = free;
        }
        work.copy_array(&self.positions[now], &self.positions[0]);
        self.buffers.now = 0;
    }

    fn prepare(&self, dt: f64) -> Result<Prepared> {
        let turns = (0..3).flat_map(|now| {
            let others = (0..3).filter(move |before| *before != now);
            others.map(move |before| BufferIndices { now, before })
        });
        let steps = turns
            .map(|turn| {
                let pass = |normals| self.step_pass(dt, turn, normals, 1.0);
                Ok((turn, [pass(false)?, pass(true)?]))
            })
            .collect::<Result<_>>()?;
        Ok(Prepared {
            dt,
            gravity: self.loads.gravity(),
            steps,
        })
    }

    /// Builds the pass of a step in which the fraction `share` of the acceleration acts.
    fn step_pass(&self, dt: f64, turn: BufferIndices, normals: bool, share: f64) -> Result<Pass> {
        let model = &self.model;
        let length = model.frame.scale * model.length_unit;
        let gain = 1.0 / (1.0 + 0.5 * model.damping * dt);
        let rate = share * dt * dt / self.mean_mass;
        let offsets = model.shape.offsets();
        let lengths = model.shape.rest_lengths();
        let springs = std::array::from_fn(|k| {
            [
                f32::from_bits(offsets[k] as i32 as u32),
                (lengths[k] / model.frame.scale) as f32,
                (rate * model.stiffness[k]) as f32,
                0.0,
            ]
        });
        let gravity = (share * dt * dt / length * self.loads.gravity()).as_vec3();
        let params = GridParams {
            springs,
            pull: gravity.extend((rate / length) as f32).to_array(),
            count: self.particles.len(),
            damping_factor: ((1.0 - 0.5 * model.damping * dt) * gain) as f32,
            acceleration_scale: gain as f32,
            least_normal: MIN_NORMAL_SUM as f32,
        };
        let flag = |on: bool| f64::from(u8::from(on));
        self.gpu
            .pass("physics/grid_verlet")
            .constant("NORMALS", flag(normals))
            .constant("EXTERNAL", flag(self.has_forces))
            .read(&self.positions[turn.now])
            .read(&self.positions[turn.before])
            .read(&self.particles)
            .read(&self.external)
            .write(&self.positions[turn.next()])
            .write(&self.normals)
            .params(&params)
            .dispatch_items(self.particles.len())
    }

    /// Recomputes the normals at the present positions and springs; steps write them themselves.
    pub(in crate::physics) fn refresh_normals(&mut self) -> Result<()> {
        self.upload_changes()?;
        // The next step overwrites the free array.
        let free = &self.positions[self.buffers.next()];
        let pass = self.normals_pass(&self.positions[self.buffers.now], free, &self.normals)?;
        let mut work = self.gpu.start_recording();
        pass.record(&mut work);
        work.submit()
    }

    /// Builds the pass that computes the normals at given positions and moves nothing.
    pub(in crate::physics) fn normals_pass(
        &self,
        positions: &Array,
        unused: &Array,
        normals: &Array,
    ) -> Result<Pass> {
        let offsets = self.model.shape.offsets();
        let offset = |k: usize| f32::from_bits(offsets[k] as i32 as u32);
        let params = GridParams {
            springs: std::array::from_fn(|k| [offset(k), 0.0, 0.0, 0.0]),
            pull: [0.0; 4],
            count: self.particles.len(),
            damping_factor: 0.0,
            acceleration_scale: 0.0,
            least_normal: MIN_NORMAL_SUM as f32,
        };
        self.gpu
            .pass("physics/grid_verlet")
            .constant("NORMALS", 1.0)
            .constant("EXTERNAL", 0.0)
            .read(positions)
            .read(positions)
            .read(&self.particles)
            .read(&self.external)
            .write(unused)
            .write(normals)
            .params(&params)
            .dispatch_items(self.particles.len())
    }

    /// Builds the pass that computes the previous positions for a first step of `dt`.
    fn start(&self, dt: f64) -> Result<Pass> {
        let params = StartParams {
            count: self.particles.len(),
            ratio: self.previous_dt.map_or(0.0, |lag| dt / lag) as f32,
            // Chosen such that the first damped step is exact to second order.
            h: match self.previous_dt {
                None => (dt * (1.0 + 0.5 * self.model.damping * dt)) as f32,
                Some(_) => 0.0,
            },
            _pad0: 0,
        };
        self.gpu
            .pass("physics/grid_start")
            .read(&self.positions[self.buffers.now])
            .read(&self.positions[self.buffers.before])
            .read(&self.velocities)
            .read(&self.particles)
            .write(&self.positions[self.buffers.next()])
            .params(&params)
            .dispatch_items(self.particles.len())
    }

    fn check(&self, work: &mut Recorder) -> Result<()> {
        let params = GridCheckParams {
            count: self.particles.len(),
        };
        self.gpu
            .pass("physics/grid_check")
            .read(&self.positions[self.buffers.now])
            .read(&self.positions[self.buffers.before])
            .read(&self.particles)
            .write(&self.status)
            .params(&params)
            .dispatch_workgroups([1, 1, 1])?
            .record(work);
        Ok(())
    }

    fn failure(&self, steps: u32, dt: f64) -> Error {
        let stable = self.model.conservative_step();
        let advice = match dt > stable {
            true => format!("use --dt {stable:.3e} or less"),
            false => "reduce the forces, or move the particles less far".into(),
        };
        Error::Solver {
            solver: "verlet on the grid",
            step: self.steps + u64::from(steps),
            time: self.time,
            cause: FailureCause::FlownApart,
            what: "particles diverged in the preceding steps".into(),
            advice,
        }
    }
}
