//! From a scene's material, solver, pins and forces to a body that moves.

use super::Scene;
use super::cage::Caged;
use super::load::{Response, said, weight};
use super::sleep::Sleep;
use super::touch::Hand;
use crate::cage::CageReport;
use crate::gpu::{Gpu, Recorder};
use crate::mesh::TetMesh;
use crate::physics::grid::{GridBody, GridModel, GridShape};
use crate::physics::{
    Body, ConjugateGradients, GrabId, Grip, HeldEnd, ImplicitEuler, Material, Nodes, Progress,
    Report, Solver, SolverKind, SpringNetwork, largest_stable_step,
};
use crate::{Error, Result};
use glam::DVec3;

/// Gravity where a scene does not say, in m/s².
pub(super) const GRAVITY: f64 = 9.81;
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
    pub(super) hands: Vec<Hand>,
    pub(super) progress: Option<Progress>,
    pub(super) sleep: Sleep,
    pub(super) caged: Option<Box<Caged>>,
    /// Points, in file units, that pictures of the whole run should show.
    pub(super) reach: Option<Vec<DVec3>>,
}

/// What pulls a body, by which step it is followed, and how far it will go.
pub(super) struct Pull {
    /// m/s².
    pub gravity: DVec3,
    /// s.
    pub dt: f64,
    /// Points, in file units, that pictures of the whole run should show.
    pub reach: Option<Vec<DVec3>>,
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
        let mut caged = None;
        let mut reach = None;
        let (body, dt) = match (shape, &scene.cage) {
            (Some(_), Some(_)) => {
                return Err(Error::Input(
                    "the scene has both [grid] and [cage]; a cage of kind \"grid\" carries the mesh, leave [grid] out".into(),
                ));
            }
            (Some(shape), None) => {
                scene.grid_mover(gpu, kind, mesh, shape, &material, &mut notes)?
            }
            (None, Some(entry)) => {
                let (body, pull, carried) =
                    scene.caged_mover(gpu, entry, kind, mesh, &material, &mut notes)?;
                caged = Some(Box::new(carried));
                reach = pull.reach;
                (body, pull.dt)
            }
            (None, None) => {
                let (body, pull) = scene.tet_mover(gpu, kind, mesh, material, &mut notes)?;
                reach = pull.reach;
                (body, pull.dt)
            }
        };
        let motion = Motion {
            body,
            dt,
            hands: scene.grab.iter().map(Hand::new).collect::<Result<_>>()?,
            progress: None,
            sleep: Sleep::new(scene.solver.sleep.unwrap_or(true)),
            caged,
            reach,
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
            let reach = self.caged.as_ref().map_or(0.0, |c| c.reach());
            for hand in &mut self.hands {
                hand.act(&mut self.body, time, reach)?;
            }
            match self.sleep.holds(self.body.touched()) {
                true => self.sleep.pass(some, self.dt),
                false => {
                    self.progress = self.body.run(some, self.dt)?;
                    let speed = self.speed();
                    let touched = self.body.touched();
                    self.sleep.look(speed, some, self.dt, touched);
                }
            }
            done += some;
            progress(done);
        }
        Ok(())
    }

    /// Root mean square speed, in sizes of the body a second, as the last run tells it.
    fn speed(&self) -> f64 {
        match (&self.body, self.progress) {
            (Mover::Grid(body), _) => body.speed(),
            (Mover::Tets(body, _), Some(progress)) => {
                let network = body.network();
                let mass: f64 = network.masses.iter().sum();
                let speed = (2.0 * progress.last.kinetic.max(0.0) / mass).sqrt();
                speed / body.units().length
            }
            (Mover::Tets(..), None) => f64::INFINITY,
        }
    }

    /// Whether the body is at rest and sleeps: time goes by, but nothing is simulated until it is
    /// touched. It falls asleep when its mean speed stays below a ten-thousandth of its size a
    /// second.
    pub fn asleep(&self) -> bool {
        self.sleep.asleep()
    }

    /// Steps that were not simulated because the body slept.
    pub fn steps_slept(&self) -> u64 {
        self.sleep.slept.0
    }

    /// Wakes the body: needed after what no count of its own tells of, such as forces written on
    /// the GPU.
    pub fn wake(&mut self) {
        self.sleep.wake();
    }

    /// Whether the body may fall asleep.
    pub fn may_sleep(&self) -> bool {
        self.sleep.allowed()
    }

    /// Lets the body fall asleep from now on, or not.
    pub fn let_sleep(&mut self, allowed: bool) {
        let slept = self.sleep.slept;
        self.sleep = Sleep::new(allowed);
        self.sleep.slept = slept;
    }

    /// How the cage turned out, where one carries the mesh.
    pub fn cage(&self) -> Option<CageReport> {
        self.caged.as_ref().map(|c| c.report)
    }

    /// The nodes of the mesh, for drawing: the body's own, or those that its cage carries.
    pub(super) fn drawn_nodes(&self) -> &Nodes {
        match &self.caged {
            Some(caged) => caged.nodes(),
            None => self.body.nodes(),
        }
    }

    /// Brings the mesh to where its cage is.
    pub(super) fn carry(&mut self, work: &mut Recorder) {
        if let Some(caged) = &mut self.caged {
            caged.carry(work, self.body.nodes());
        }
    }

    /// Where the nodes of the mesh are, in file units, read back.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn positions(&self) -> Result<Vec<DVec3>> {
        self.carried(self.body.nodes().positions()?)
    }

    /// Puts a body of tets back to where it rested, with the step and the tolerance of `scene`,
    /// which is otherwise the one it was made for.
    ///
    /// # Errors
    /// As [`Motion::new`].
    pub(crate) fn restart(&mut self, gpu: &Gpu, scene: &Scene) -> Result<()> {
        for hand in &mut self.hands {
            hand.let_go(&mut self.body)?;
        }
        self.hands = scene.grab.iter().map(Hand::new).collect::<Result<_>>()?;
        self.dt = scene.solver.dt.unwrap_or(self.dt);
        self.progress = None;
        self.sleep = Sleep::new(scene.solver.sleep.unwrap_or(true));
        if let Mover::Tets(body, solver) = &mut self.body {
            let network = body.network();
            let rest = network.rest.iter().map(|x| network.to_file(*x));
            let rest: Vec<DVec3> = rest.collect();
            body.set_positions(&rest)?;
            body.set_velocities(&vec![DVec3::ZERO; rest.len()])?;
            *solver = scene.solver_of(gpu, solver.kind(), body)?;
        }
        Ok(())
    }

    /// Vectors at the nodes of the mesh, of those at the nodes of the body.
    pub(super) fn carried(&self, vectors: Vec<DVec3>) -> Result<Vec<DVec3>> {
        match &self.caged {
            Some(caged) => caged.carried(&vectors),
            None => Ok(vectors),
        }
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
            Mover::Tets(..) => self.progress.map_or(0.0, |p| p.time) + self.sleep.slept.1,
            Mover::Grid(body) => body.clock().1 + self.sleep.slept.1,
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
        let own = self.caged.as_ref().map_or(mesh, |c| &c.mesh);
        let report = match &self.body {
            Mover::Tets(body, _) => Report::new(body, own)?,
            Mover::Grid(body) => body.report()?,
        };
        Ok(match &self.caged {
            None => report,
            Some(caged) => {
                let positions = caged.carried(&self.body.nodes().positions()?)?;
                Report::of_positions(report.energy, mesh, &positions)
            }
        })
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

    /// A number that changes whenever the body is changed from outside.
    pub fn touched(&self) -> u64 {
        match self {
            Mover::Tets(body, _) => body.touched(),
            Mover::Grid(body) => body.touched(),
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

/// The step that the scene asks for, or a share of the largest stable one, `limit`; without a
/// limit the step of an implicit solver.
pub(super) fn step_of(asked: Option<f64>, limit: Option<f64>, notes: &mut Vec<String>) -> f64 {
    if let Some(dt) = asked {
        return dt;
    }
    let Some(limit) = limit else {
        return IMPLICIT_STEP;
    };
    let limit = match limit.is_finite() && limit > 0.0 {
        true => limit,
        false => IMPLICIT_STEP,
    };
    let dt = EXPLICIT_SHARE * limit;
    notes.push(format!(
        "a step of {dt:.3e} s: {EXPLICIT_SHARE} of the largest stable one"
    ));
    dt
}

/// A damping time that an explicit solver can bear with these springs, undamped as they are given,
/// for damping costs it step size; and a sentence that says so.
pub(super) fn damping_to_bear(undamped: &SpringNetwork, kind: SolverKind) -> Option<(f64, String)> {
    let free = vec![false; undamped.rest.len()];
    let limit = largest_stable_step(undamped, &free, SolverKind::Symplectic);
    let limit = limit.filter(|limit| limit.is_finite())?;
    // Explicit Euler is stable through damping alone; the others give up a twentieth of a step.
    let share = if kind == SolverKind::Explicit {
        0.5
    } else {
        0.05
    };
    let damping = share * limit;
    let said = format!(
        "damping of {damping:.2e} s times the stiffness, which {kind} can bear; --damping says otherwise"
    );
    Some((damping, said))
}

impl Scene {
    fn tet_mover(
        &self,
        gpu: &Gpu,
        kind: SolverKind,
        mesh: &TetMesh,
        mut material: Material,
        notes: &mut Vec<String>,
    ) -> Result<(Mover, Pull)> {
        if self.material.damping.is_none() && kind != SolverKind::Implicit {
            material.damping_time = 0.0;
            if let Some((damping, said)) =
                damping_to_bear(&SpringNetwork::new(mesh, &material)?, kind)
            {
                material.damping_time = damping;
                notes.push(said);
            }
        }
        let mut body = Body::new(gpu, mesh, &material)?;
        for region in &self.pin {
            body.pin_nodes(&region.nodes(mesh)?)?;
        }
        let end = match self.pin.is_empty() {
            true => Some(self.held_end(body.network())),
            false => None,
        };
        if let Some((end, _)) = &end {
            body.pin_nodes(&end.nodes)?;
        }
        let forces = self.forces(mesh)?;
        if let Some(forces) = &forces {
            body.set_forces(forces)?;
        }
        let limit = match self.solver.dt {
            Some(_) => None,
            None => largest_stable_step(body.network(), body.pinned(), kind),
        };
        let dt = step_of(self.solver.dt, limit, notes);
        let (network, pinned) = (body.network(), body.pinned());
        let pull = self.pull(kind, (network, pinned), end, forces.as_deref(), dt, notes);
        body.set_gravity(pull.gravity);
        let solver = self.solver_of(gpu, kind, &body)?;
        Ok((Mover::Tets(Box::new(body), solver), pull))
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
            let has = |v: &u32| body.model().shape.regions[*v as usize] != 0;
            let there: Vec<u32> = (0..mesh.nodes.len() as u32).filter(has).collect();
            let masses = vec![1.0; mesh.nodes.len()];
            let end = HeldEnd::among(&mesh.nodes, &masses, &there, self.down());
            gravity = GRAVITY * end.across();
            notes.push(format!(
                "held {end}; gravity of {GRAVITY} m/s² acts across it"
            ));
            pinned = end.nodes;
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
        let dt = step_of(self.solver.dt, Some(limit), notes);
        Ok((Mover::Grid(Box::new(body)), dt))
    }

    pub(super) fn solver_of(
        &self,
        gpu: &Gpu,
        kind: SolverKind,
        body: &Body,
    ) -> Result<Box<dyn Solver>> {
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

    /// The way loads go: that of the scene's gravity, or −z.
    fn down(&self) -> DVec3 {
        let given = self.solver.gravity.map(DVec3::from);
        given.map_or(DVec3::NEG_Z, |g| match g.length() > 0.0 {
            true => g.normalize(),
            false => DVec3::NEG_Z,
        })
    }

    /// The end by which a body is held that the scene does not pin, and the number of its pieces.
    pub(super) fn held_end(&self, network: &SpringNetwork) -> (HeldEnd, usize) {
        network.held_end(self.down())
    }

    /// Gravity and step: those of the scene; where it is silent and a run is ahead, such as suit
    /// the body's stiffness. `held` are the springs and which nodes are pinned, `end` says which
    /// end was chosen for that, if one was.
    pub(super) fn pull(
        &self,
        kind: SolverKind,
        held: (&SpringNetwork, &[bool]),
        end: Option<(HeldEnd, usize)>,
        forces: Option<&[DVec3]>,
        dt: f64,
        notes: &mut Vec<String>,
    ) -> Pull {
        let (network, pinned) = held;
        let across = end.as_ref().map_or(DVec3::NEG_Z, |(end, _)| end.across());
        let given = self.solver.gravity.map(DVec3::from);
        let mut pull = Pull {
            gravity: given.unwrap_or(GRAVITY * across),
            dt,
            reach: None,
        };
        let silent = given.is_none()
            && forces.is_none()
            && self.grab.is_empty()
            && self.cut.is_empty()
            && end.is_some();
        let ahead = self.solver.run.filter(|run| run.steps > 0);
        let mut how = format!("gravity of {} acts", said(pull.gravity.length()));
        if let (true, Some(run)) = (silent, ahead)
            && let Some(response) = Response::new(network, pinned, &weight(network, across))
        {
            if self.solver.dt.is_none() && kind == SolverKind::Implicit {
                pull.dt = response.step(run.steps, IMPLICIT_STEP);
            }
            let factor = response.factor(kind, run.steps, pull.dt);
            pull.gravity = factor * across;
            pull.reach = Some(response.reach(network, pinned, factor, (kind, run.steps, pull.dt)));
            how = format!(
                "a load of {}, by which it gives about a tenth of its size, acts",
                said(factor)
            );
        } else if let Some(run) = ahead.filter(|run| run.drawn && self.camera.is_unset()) {
            let mut load = weight(network, pull.gravity);
            for (load, force) in load.iter_mut().zip(forces.unwrap_or_default()) {
                *load += *force;
            }
            let response = Response::new(network, pinned, &load);
            pull.reach = response.map(|r| r.reach(network, pinned, 1.0, (kind, run.steps, dt)));
        }
        for point in pull.reach.iter_mut().flatten() {
            *point = network.to_file(*point);
        }
        if let Some((end, pieces)) = end {
            let pieces = match pieces {
                1 => String::new(),
                n => format!(" and an end of each of its {n} pieces"),
            };
            let along = along(pull.gravity);
            notes.push(format!(
                "held {end}{pieces}; {how} along {along} ([[pin]] and --gravity say otherwise)"
            ));
        }
        if pull.dt != dt {
            notes.push(format!(
                "steps of {:.3} s, in which the run takes in half a swing (--dt says otherwise)",
                pull.dt
            ));
        }
        pull
    }

    /// The force on each node of `mesh`, if there are any.
    pub(super) fn forces(&self, mesh: &TetMesh) -> Result<Option<Vec<DVec3>>> {
        let mut forces = vec![DVec3::ZERO; mesh.nodes.len()];
        for entry in &self.force {
            let nodes = entry.on.nodes(mesh)?;
            for v in &nodes {
                forces[*v as usize] += DVec3::from(entry.total) / nodes.len() as f64;
            }
        }
        Ok((!self.force.is_empty()).then_some(forces))
    }
}

/// A direction in words.
fn along(vector: DVec3) -> String {
    let unit = vector.normalize_or_zero();
    let axis = unit.abs().max_position();
    match unit[axis].abs() > 0.999 {
        true => format!(
            "{}{}",
            if unit[axis] < 0.0 { "-" } else { "+" },
            ["x", "y", "z"][axis]
        ),
        false => format!("({:.3}, {:.3}, {:.3})", unit.x, unit.y, unit.z),
    }
}
