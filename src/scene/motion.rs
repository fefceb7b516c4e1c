//! From a scene's material, solver, pins and forces to a body that moves.

use super::Scene;
use crate::Result;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::{
    Body, ConjugateGradients, ImplicitEuler, Material, Progress, Report, Solver, SolverKind,
    SpringNetwork, largest_stable_step,
};
use glam::DVec3;

/// Gravity where a scene does not say, in m/s².
const GRAVITY: f64 = 9.81;
/// Step of the implicit solver where a scene does not say, in s; explicit solvers take a share
/// of their largest stable step.
const IMPLICIT_STEP: f64 = 0.01;
const EXPLICIT_SHARE: f64 = 0.9;
/// A body longer than this, in metres, is remarked upon: its unit was probably forgotten.
const REMARKABLE_LENGTH: f64 = 5.0;
/// Steps between two looks at whether all is well, so that progress can be shown.
const STEPS_A_LOOK: u32 = 10;

/// A body and the solver that moves it.
pub struct Motion {
    /// The body.
    pub body: Body,
    /// Step size, s.
    pub dt: f64,
    solver: Box<dyn Solver>,
    progress: Option<Progress>,
}

impl Motion {
    /// The body and solver of `scene`, and in words what was assumed where it is silent.
    ///
    /// # Errors
    /// [`Error::Input`] for what makes no sense in the scene; otherwise as [`Body::new`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        kind: SolverKind,
        mesh: &TetMesh,
    ) -> Result<(Motion, Vec<String>)> {
        let mut notes = Vec::new();
        let unit = scene.mesh.unit.as_ref().map(|u| u.metres()).transpose()?;
        let unit = unit.or(mesh.length_unit);
        let (low, high) = mesh.bounds();
        let length = (high - low).max_element();
        if unit.is_none() && length > REMARKABLE_LENGTH {
            notes.push(format!(
                "one unit of the mesh is taken to be a metre, so the body is {length:.3} m long; --unit mm (or cm) says otherwise"
            ));
        }
        let (mut material, said) = scene.material.material(mesh)?;
        notes.extend(said);
        material.length_unit = unit.unwrap_or(1.0);
        if scene.material.damping.is_none() && kind != SolverKind::Implicit {
            notes.extend(lighten_damping(&mut material, mesh, kind)?);
        }
        let mut body = Body::new(gpu, mesh, &material)?;
        notes.extend(scene.hold_and_pull(mesh, &mut body)?);
        let dt = match (scene.solver.dt, kind) {
            (Some(dt), _) => dt,
            (None, SolverKind::Implicit) => IMPLICIT_STEP,
            (None, _) => {
                let limit = largest_stable_step(body.network(), body.pinned(), kind)
                    .filter(|limit| limit.is_finite() && *limit > 0.0)
                    .unwrap_or(IMPLICIT_STEP);
                let dt = EXPLICIT_SHARE * limit;
                notes.push(format!(
                    "a step of {dt:.3e} s: {EXPLICIT_SHARE} of the largest stable one"
                ));
                dt
            }
        };
        let solver = scene.solver_of(gpu, kind, &body)?;
        let motion = Motion {
            body,
            dt,
            solver,
            progress: None,
        };
        Ok((motion, notes))
    }

    /// Runs `steps` steps, telling `progress` how many are done.
    ///
    /// # Errors
    /// [`Error::Solver`] when the simulation failed; the body stays in its last good state.
    pub fn run(&mut self, steps: u32, progress: &mut dyn FnMut(u32)) -> Result<()> {
        let mut done = 0;
        while done < steps {
            let some = STEPS_A_LOOK.min(steps - done);
            self.progress = Some(self.solver.run(&mut self.body, some, self.dt)?);
            done += some;
            progress(done);
        }
        Ok(())
    }

    /// Which solver it is.
    pub fn kind(&self) -> SolverKind {
        self.solver.kind()
    }

    /// How far the simulation came, as of the last [`Motion::run`].
    pub fn progress(&self) -> Option<Progress> {
        self.progress
    }

    /// Energies, volume and displacement, read back.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn report(&self, mesh: &TetMesh) -> Result<Report> {
        Report::new(&self.body, mesh)
    }
}

/// Chooses a damping that an explicit solver can bear, for damping costs it step size.
fn lighten_damping(
    material: &mut Material,
    mesh: &TetMesh,
    kind: SolverKind,
) -> Result<Option<String>> {
    material.damping_time = 0.0;
    let network = SpringNetwork::new(mesh, material)?;
    let undamped = largest_stable_step(
        &network,
        &vec![false; mesh.nodes.len()],
        SolverKind::Symplectic,
    );
    let Some(limit) = undamped.filter(|limit| limit.is_finite()) else {
        return Ok(None);
    };
    // Explicit Euler is stable through damping alone; the others give up a twentieth of a step.
    let share = if kind == SolverKind::Explicit {
        0.5
    } else {
        0.05
    };
    material.damping_time = share * limit;
    Ok(Some(format!(
        "damping of {:.2e} s times the stiffness, which {kind} can bear; --damping says otherwise",
        material.damping_time
    )))
}

impl Scene {
    fn solver_of(&self, gpu: &Gpu, kind: SolverKind, body: &Body) -> Result<Box<dyn Solver>> {
        let mut settings = ConjugateGradients::default();
        if let Some(tolerance) = self.solver.tolerance {
            settings.tolerance = tolerance;
            settings.acceptable = settings.acceptable.max(tolerance);
        }
        if let Some(iterations) = self.solver.iterations {
            settings.max_iterations = iterations;
        }
        if kind == SolverKind::Implicit && settings != ConjugateGradients::default() {
            return Ok(Box::new(ImplicitEuler::with(gpu, body, settings)?));
        }
        kind.solver(gpu, body)
    }

    /// Applies pins, gravity and forces; without any pin, holds the body at one end.
    fn hold_and_pull(&self, mesh: &TetMesh, body: &mut Body) -> Result<Vec<String>> {
        let mut notes = Vec::new();
        if self.pin.is_empty() {
            notes.push(body.pin_lowest_end(GRAVITY));
        } else {
            body.set_gravity(GRAVITY * DVec3::NEG_Z);
        }
        for region in &self.pin {
            body.pin_nodes(&region.nodes(mesh)?)?;
        }
        if let Some(gravity) = self.solver.gravity {
            body.set_gravity(gravity.into());
        }
        let mut forces = vec![DVec3::ZERO; mesh.nodes.len()];
        for entry in &self.force {
            let nodes = entry.on.nodes(mesh)?;
            for v in &nodes {
                forces[*v as usize] += DVec3::from(entry.total) / nodes.len() as f64;
            }
        }
        if !self.force.is_empty() {
            body.set_forces(&forces)?;
        }
        Ok(notes)
    }
}
