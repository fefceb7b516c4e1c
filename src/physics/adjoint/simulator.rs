//! Gradients of tetrahedral bodies on the CPU.

use super::equilibrium::{Equilibrium, MeasuredForces, check_balance, elements_of_tets};
use super::motion::{MotionQuantity, MotionTask, STATE_MEMORY, gradients_of_motion};
use super::parameters::gradient;
use crate::mesh::TetMesh;
use crate::physics::cpu::{BodyModel, CpuTetModel, StepFailure, StepParts, step_load_update};
use crate::physics::simulator::time_step::check_time_step;
use crate::physics::{
    CpuTets, Gradient, Gradients, LoadSchedule, Loads, Parameter, Precision, Quantity, ScaledLoad,
    SeriesReader, Simulator,
};
use crate::progress::ProgressFn;
use crate::{Error, Result};
use glam::DVec3;

impl Gradients for CpuTets {
    fn gradient(&mut self, quantity: &Quantity, parameters: &[Parameter]) -> Result<Gradient> {
        prepare(self, "a gradient")?;
        let stiffness = self.model.network.nodal_stiffness();
        let faces = self.boundary();
        let mut body = self.worker.body();
        let imbalance = check_balance(&body.force_balance(&stiffness))?;
        let forces = MeasuredForces {
            tools: body.tool_forces(),
            nodes: body.forces(),
            rigid: body.rigid_forces(),
        };
        let of = (&self.model, &self.mesh, &self.loads);
        let equilibrium = equilibrium(of, &faces, (body.positions(), forces));
        let adjoint = body.static_adjoint().ok_or_else(single_precision)?;
        let found = gradient(&equilibrium, adjoint, quantity, parameters)?;
        Ok(Gradient { imbalance, ..found })
    }

    fn gradient_of_motion(
        &mut self,
        steps: (u32, f64),
        quantity: &Quantity,
        integral: bool,
        parameters: &[Parameter],
        schedule: Option<LoadSchedule<'_>>,
        progress: ProgressFn<'_>,
    ) -> Result<Gradient> {
        let quantity = match integral {
            true => MotionQuantity::Integral(quantity.clone()),
            false => MotionQuantity::AtEnd(quantity.clone()),
        };
        let by = (parameters, progress);
        let found =
            self.gradients_over_steps(steps, &quantity, (schedule, &mut |_| Ok(None)), by)?;
        Ok(found.into_iter().next().unwrap_or_default())
    }

    fn gradients_of_series(
        &mut self,
        steps: (u32, f64),
        quantity: &Quantity,
        read: SeriesReader<'_>,
        parameters: &[Parameter],
        progress: ProgressFn<'_>,
    ) -> Result<Vec<Gradient>> {
        let quantity = MotionQuantity::Series(quantity.clone());
        self.gradients_over_steps(steps, &quantity, (None, read), (parameters, progress))
    }

    fn use_double_precision(&mut self) -> Result<()> {
        self.finish()?;
        if self.model.precision == Precision::Double {
            return Ok(());
        }
        let (positions, velocities) = (self.positions()?, self.velocities()?);
        self.model.precision = Precision::Double;
        self.rebuild_body(&positions, &velocities)
    }
}

impl CpuTets {
    /// Takes steps and returns the gradients of the numbers of a quantity.
    fn gradients_over_steps(
        &mut self,
        (steps, dt): (u32, f64),
        quantity: &MotionQuantity,
        (schedule, read): (Option<LoadSchedule<'_>>, SeriesReader<'_>),
        (parameters, progress): (&[Parameter], ProgressFn<'_>),
    ) -> Result<Vec<Gradient>> {
        check_time_step(dt)?;
        prepare(self, "a gradient of a motion")?;
        let faces = self.boundary();
        let before = self.progress;
        let error = |failure: StepFailure, taken: u32| {
            let (cause, what) = self.model.describe_failure(&failure);
            Error::Solver {
                solver: self.model.solver_name(),
                step: before.steps + u64::from(taken) + 1,
                time: before.time + f64::from(taken) * dt,
                cause,
                what,
                advice: self.model.failure_advice(dt, &self.loads),
            }
        };
        let mut loads = self.loads.clone();
        let constant = |loads: &Loads| {
            let versions = loads.versions;
            (versions.constraints, versions.forces, loads.gravity())
        };
        let unchanged = constant(&loads);
        let mut schedule = schedule;
        let mut of_step = |step: u32| {
            let Some(schedule) = &mut schedule else {
                return Ok(None);
            };
            schedule(step, &mut loads)?;
            match constant(&loads) == unchanged {
                true => Ok(Some(step_load_update(&loads))),
                false => Err(Error::Input(
                    "a gradient of a motion requires constant forces, gravity and supports: only the paths of supports and tools, pressures and activations may change".into(),
                )),
            }
        };
        let done = {
            let mut body = self.worker.body();
            let forces = MeasuredForces {
                tools: body.tool_forces(),
                nodes: body.forces(),
                rigid: body.rigid_forces(),
            };
            let of = (&self.model, &self.mesh, &self.loads);
            let moving = equilibrium(of, &faces, (body.positions(), forces));
            let task = MotionTask {
                steps,
                dt,
                scheme: self.model.kind,
                quantity,
                parameters,
                memory: STATE_MEMORY,
                parts: StepParts::default(),
                progress,
                error: &error,
            };
            let adjoint = body.motion_adjoint().ok_or_else(single_precision)?;
            gradients_of_motion(moving, adjoint, &task, &mut of_step, read)
        };
        self.loads = loads;
        // After an error the body may have some of the loads of the next step only.
        self.synced_loads = done.gradients.is_ok().then_some(self.loads.versions);
        self.progress = self.worker.count_steps(done.taken, dt, done.last);
        self.changes += 1;
        self.upload_now()?;
        done.gradients
    }
}

/// Checks that a body has gradients, and waits for it.
fn prepare(body: &mut CpuTets, what: &str) -> Result<()> {
    if !body.model.kind.is_implicit() {
        return Err(Error::Input(format!(
            "{what} requires an implicit scheme, not {}; use --solver implicit",
            body.model.kind
        )));
    }
    if body.model.precision != Precision::Double {
        return Err(single_precision());
    }
    body.sync_loads()?;
    body.finish()?;
    Ok(())
}

/// Returns the body of a model with loads, at positions (m) with forces.
fn equilibrium<'a>(
    (model, mesh, loads): (&'a CpuTetModel, &'a TetMesh, &'a Loads),
    faces: &'a [[u32; 3]],
    (x, forces): (Vec<DVec3>, MeasuredForces),
) -> Equilibrium<'a> {
    let all = model.scaled_loads.iter().zip(0..);
    let muscles = all.filter_map(|(load, level)| match load {
        ScaledLoad::Muscle(muscle) => Some((muscle, level)),
        ScaledLoad::Pressure(_) => None,
    });
    Equilibrium {
        mesh,
        material: &model.material,
        network: &model.network,
        terms: &model.terms,
        tools: &model.tools,
        faces,
        muscles: muscles.collect(),
        self_contact: model.self_contact.as_ref(),
        amplitudes: loads.amplitudes().to_vec(),
        gravity: loads.gravity(),
        pinned: loads.pinned(),
        fixed: loads.fixed_nodes(),
        element_of_tet: elements_of_tets(&model.network, mesh),
        x,
        inertia: Vec::new(),
        forces,
    }
}

fn single_precision() -> Error {
    Error::Input(
        "a gradient requires double precision; create the body with Precision::Double, or change it by Gradients::use_double_precision".into(),
    )
}
