//! From a scene's material, solver, pins and forces to a body that moves.

use super::Scene;
use super::touch::Hand;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::grid::{GridBody, GridModel, GridShape};
use crate::physics::{
    Body, ConjugateGradients, GrabId, Grip, ImplicitEuler, Material, Nodes, Progress, Report,
    Solver, SolverKind, SpringNetwork, largest_stable_step,
};
use crate::{Error, Result};
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
/// The same of a grid body, whose steps are short, free and held.
const STEPS_OF_A_GRID: u32 = 256;
const STEPS_OF_A_HELD_GRID: u32 = 16;

/// A body and what moves it.
pub enum Mover {
    /// A body of tets and its solver.
    Tets(Box<Body>, Box<dyn Solver>),
    /// A grid body, which is stepped by Verlet.
    Grid(Box<GridBody>),
}

/// A body that moves as its scene says.
pub struct Motion {
    /// The body.
    pub body: Mover,
    /// Step size, s.
    pub dt: f64,
    hands: Vec<Hand>,
    progress: Option<Progress>,
}

impl Motion {
    /// The body and solver of `scene`, and in words what was assumed where it is silent. With a
    /// `shape` it is a grid body, whose mesh is `mesh`.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for what makes no sense in the scene; otherwise as
    /// [`Body::new`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        kind: SolverKind,
        mesh: &TetMesh,
        shape: Option<GridShape>,
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
        let (body, dt) = match shape {
            Some(shape) => scene.grid_mover(gpu, kind, mesh, shape, &material, &mut notes)?,
            None => scene.tet_mover(gpu, kind, mesh, material, &mut notes)?,
        };
        let motion = Motion {
            body,
            dt,
            hands: scene.grab.iter().map(Hand::new).collect::<Result<_>>()?,
            progress: None,
        };
        Ok((motion, notes))
    }

    /// Runs `steps` steps, telling `progress` how many are done.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) when the simulation failed; the body stays in its
    /// last good state.
    pub fn run(&mut self, steps: u32, progress: &mut dyn FnMut(u32)) -> Result<()> {
        let mut done = 0;
        while done < steps {
            let some = self.steps_at_once().min(steps - done);
            let time = self.time() + f64::from(some) * self.dt;
            for hand in &mut self.hands {
                hand.act(&mut self.body, time)?;
            }
            self.progress = self.body.run(some, self.dt)?;
            done += some;
            progress(done);
        }
        Ok(())
    }

    /// Steps between two looks at whether all is well and where hands are.
    fn steps_at_once(&self) -> u32 {
        match (self.hands.is_empty(), &self.body) {
            (true, Mover::Tets(..)) => STEPS_A_LOOK,
            (true, Mover::Grid(_)) => STEPS_OF_A_GRID,
            (false, Mover::Tets(..)) => 1,
            (false, Mover::Grid(_)) => STEPS_OF_A_HELD_GRID,
        }
    }

    /// Simulated time, in seconds.
    pub fn time(&self) -> f64 {
        match &self.body {
            Mover::Tets(..) => self.progress.map_or(0.0, |p| p.time),
            Mover::Grid(body) => body.clock().1,
        }
    }

    /// Which solver it is.
    pub fn kind(&self) -> SolverKind {
        match &self.body {
            Mover::Tets(_, solver) => solver.kind(),
            Mover::Grid(_) => SolverKind::Verlet,
        }
    }

    /// How far the simulation of a tet body came, as of the last [`Motion::run`].
    pub fn progress(&self) -> Option<Progress> {
        self.progress
    }

    /// Energies, volume and displacement, read back.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn report(&self, mesh: &TetMesh) -> Result<Report> {
        match &self.body {
            Mover::Tets(body, _) => Report::new(body, mesh),
            Mover::Grid(body) => body.report(),
        }
    }
}

impl Mover {
    /// The positions, for drawing.
    pub fn nodes(&self) -> &Nodes {
        match self {
            Mover::Tets(body, _) => body.nodes(),
            Mover::Grid(body) => body.nodes(),
        }
    }

    /// Moves the nodes to `positions`, in file units.
    ///
    /// # Errors
    /// As [`Nodes::set_positions`].
    pub fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        match self {
            Mover::Tets(body, _) => body.set_positions(positions),
            Mover::Grid(body) => body.set_positions(positions),
        }
    }

    /// Velocities in file units a second, read back.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn velocities(&self) -> Result<Vec<DVec3>> {
        match self {
            Mover::Tets(body, _) => body.velocities(),
            Mover::Grid(body) => body.velocities(),
        }
    }

    /// Grabs the nodes within `radius` of `centre`, in file units.
    ///
    /// # Errors
    /// As [`Body::grab`].
    pub fn grab(&mut self, centre: DVec3, radius: f64, grip: Grip) -> Result<GrabId> {
        match self {
            Mover::Tets(body, _) => body.grab(centre, radius, grip),
            Mover::Grid(body) => body.grab(centre, radius, grip),
        }
    }

    /// Moves the target of a grab, in file units.
    ///
    /// # Errors
    /// As [`Body::set_target`].
    pub fn set_target(&mut self, grab: GrabId, target: DVec3) -> Result<()> {
        match self {
            Mover::Tets(body, _) => body.set_target(grab, target),
            Mover::Grid(body) => body.set_target(grab, target),
        }
    }

    /// Lets go of a grab's nodes. Returns how many they are.
    ///
    /// # Errors
    /// As [`Body::release`].
    pub fn release(&mut self, grab: GrabId) -> Result<usize> {
        match self {
            Mover::Tets(body, _) => body.release(grab),
            Mover::Grid(body) => body.release(grab),
        }
    }

    fn run(&mut self, steps: u32, dt: f64) -> Result<Option<Progress>> {
        match self {
            Mover::Tets(body, solver) => solver.run(body, steps, dt).map(Some),
            Mover::Grid(body) => body.run(steps, dt).map(|()| None),
        }
    }
}

/// The step that is taken where the largest stable one is `limit`.
fn share_of(limit: f64, notes: &mut Vec<String>) -> f64 {
    let dt = EXPLICIT_SHARE * limit;
    notes.push(format!(
        "a step of {dt:.3e} s: {EXPLICIT_SHARE} of the largest stable one"
    ));
    dt
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
    fn tet_mover(
        &self,
        gpu: &Gpu,
        kind: SolverKind,
        mesh: &TetMesh,
        mut material: Material,
        notes: &mut Vec<String>,
    ) -> Result<(Mover, f64)> {
        if self.material.damping.is_none() && kind != SolverKind::Implicit {
            notes.extend(lighten_damping(&mut material, mesh, kind)?);
        }
        let mut body = Body::new(gpu, mesh, &material)?;
        notes.extend(self.hold_and_pull(mesh, &mut body)?);
        let dt = match (self.solver.dt, kind) {
            (Some(dt), _) => dt,
            (None, SolverKind::Implicit) => IMPLICIT_STEP,
            (None, _) => {
                let limit = largest_stable_step(body.network(), body.pinned(), kind)
                    .filter(|limit| limit.is_finite() && *limit > 0.0)
                    .unwrap_or(IMPLICIT_STEP);
                share_of(limit, notes)
            }
        };
        let solver = self.solver_of(gpu, kind, &body)?;
        Ok((Mover::Tets(Box::new(body), solver), dt))
    }

    fn grid_mover(
        &self,
        gpu: &Gpu,
        kind: SolverKind,
        mesh: &TetMesh,
        shape: GridShape,
        material: &Material,
        notes: &mut Vec<String>,
    ) -> Result<(Mover, f64)> {
        if kind != SolverKind::Verlet {
            return Err(Error::Input(format!(
                "a grid body is stepped by verlet, not by {kind}; name = \"verlet\", or leave [grid] out"
            )));
        }
        let mut model = GridModel::new(shape, material)?;
        if let Some(rate) = self.grid.as_ref().and_then(|g| g.damping) {
            model.damping = rate;
        }
        let rate = model.damping;
        let limit = model.stable_step();
        let mut body = GridBody::new(gpu, model)?;
        body.set_damping(rate)?;
        let mut gravity = GRAVITY * DVec3::NEG_Z;
        let mut pinned = Vec::new();
        for region in &self.pin {
            pinned.extend(region.nodes(mesh)?);
        }
        if self.pin.is_empty() && self.grab.is_empty() {
            let (low, high) = mesh.bounds();
            let axis = (high - low).max_position();
            let end = low[axis] + 0.05 * (high - low)[axis];
            pinned = (0..mesh.nodes.len() as u32)
                .filter(|v| mesh.nodes[*v as usize][axis] <= end)
                .collect();
            if axis == 2 {
                gravity = GRAVITY * DVec3::NEG_Y;
            }
            notes.push(format!(
                "pinned the particles in the lowest 5 % of {}, the longest axis; gravity of {GRAVITY} m/s² acts across it",
                ["x", "y", "z"][axis]
            ));
        }
        body.pin_nodes(&pinned);
        body.set_gravity(self.solver.gravity.map_or(gravity, DVec3::from));
        let has = |v: &u32| body.model().shape.regions[*v as usize] != 0;
        let mut forces = vec![DVec3::ZERO; mesh.nodes.len()];
        for entry in &self.force {
            let nodes = entry.on.nodes(mesh)?;
            let nodes: Vec<u32> = nodes.into_iter().filter(has).collect();
            for v in &nodes {
                forces[*v as usize] += DVec3::from(entry.total) / nodes.len() as f64;
            }
        }
        if !self.force.is_empty() {
            body.set_forces(&forces)?;
        }
        let dt = match self.solver.dt {
            Some(dt) => dt,
            None => share_of(limit, notes),
        };
        Ok((Mover::Grid(Box::new(body)), dt))
    }

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
