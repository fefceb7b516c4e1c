//! Builds the simulator of a scene from its material, solver, supports and loads.

use super::element_order::{four_node_mesh, ten_node_mesh};
use super::even_traction::EvenTraction;
use super::reactions::NamedPins;
use super::time_dependent_loads::TimeDependentLoads;
use super::{FloorEntry, Scene};
use crate::cage::{CageKind, CageReport};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, TetMesh};
use crate::number_format::significant;
use crate::physics::grid::{GridModel, GridShape};
use crate::physics::{
    Capability, CgSettings, DiscreteModel, Discretisation, Elements, Engine, EngineChoice, Floor,
    Material, SelfContactSettings, Simulator, SolverKind, largest_stable_step, safe_step_ratio,
};
use crate::{Error, Result};
use glam::DVec3;
use std::sync::Arc;

/// Default time step of the implicit solver, s.
pub(super) const IMPLICIT_STEP: f64 = 0.01;
/// Body length in metres above which a note warns that the unit may be missing.
const SUSPICIOUS_LENGTH: f64 = 5.0;

/// Ratio of the largest to the smallest stiffness above which single-precision steps begin to lose
/// accuracy in soft tissue; at ten times this ratio they fail (`palpate study scaling`, the bar
/// with a rod).
const GPU_CONTRAST: f64 = 1e4;

/// A simulator and the settings chosen automatically.
pub(super) struct SimulatorSetup {
    pub simulator: Box<dyn Simulator>,
    /// Time step, s.
    pub dt: f64,
    pub cage: Option<CageReport>,
    /// Whether it is a grid body.
    pub grid: bool,
    /// Whether its load was chosen automatically.
    pub automatic_load: bool,
    /// Points, in file units, that the view of the whole run should contain.
    pub motion_envelope: Option<Vec<DVec3>>,
    /// Named pins.
    pub pins: Vec<NamedPins>,
    /// Time-dependent loads.
    pub actors: TimeDependentLoads,
}

impl SimulatorSetup {
    /// Creates the simulator of `scene` and `mesh`, and notes of the automatic choices; see
    /// [`Motion::new`](super::Motion::new).
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        kind: SolverKind,
        mesh: TetMesh,
        shape: Option<GridShape>,
    ) -> Result<(SimulatorSetup, Vec<String>)> {
        let mut notes = Vec::new();
        let unit = scene.length_unit(&mesh)?;
        let (low, high) = mesh.bounds();
        let length = (high - low).max_element();
        if unit.is_none() && length > SUSPICIOUS_LENGTH {
            notes.push(format!(
                "length unit of the mesh: m (assumed), so the body is {} m long; override with --unit mm (or cm)",
                significant(length)
            ));
        }
        let grid_cage = scene.cage.as_ref().and_then(|c| c.kind) == Some(CageKind::Grid);
        let of_tets = shape.is_none() && !grid_cage;
        let (mut material, tissue_notes) = scene.material.material(&mesh, of_tets)?;
        notes.extend(tissue_notes);
        material.length_unit = unit.unwrap_or(1.0);
        let (order, order_note) = scene.element_order(&mesh);
        notes.extend(order_note);
        material.order = order;
        let mesh = match order {
            ElementOrder::Linear => four_node_mesh(mesh),
            ElementOrder::Quadratic if shape.is_some() || scene.cage.is_some() => {
                return Err(Error::Input(
                    "[material] order = 2 (--order 2) requires a simulated tetrahedral body; remove [grid] and [cage], or use order 1".into(),
                ));
            }
            ElementOrder::Quadratic => ten_node_mesh(mesh, &material)?,
        };
        if let Some(entry) = scene.tets_only_entry()
            && (shape.is_some() || scene.cage.is_some())
        {
            return Err(Error::Input(format!(
                "{entry} requires a simulated tetrahedral body; remove [grid] and [cage]"
            )));
        }
        let grid = shape.clone();
        let mut setup = match (shape, &scene.cage) {
            (Some(_), Some(_)) => {
                return Err(Error::Input(
                    "the scene has both [grid] and [cage]; to embed the mesh in a cage of kind \"grid\", remove [grid]".into(),
                ));
            }
            (Some(_), None) | (None, Some(_)) if !material.rigid.is_empty() => {
                return Err(Error::Input(
                    "grids and cages do not support rigid regions; remove [grid] or [cage], or `rigid`"
                        .into(),
                ));
            }
            (Some(shape), None) => {
                scene.grid_simulator(gpu, kind, mesh, shape, &material, &mut notes)?
            }
            (None, Some(entry)) => {
                scene.caged_simulator(gpu, entry, kind, mesh, &material, &mut notes)?
            }
            (None, None) => scene.tet_simulator(gpu, kind, mesh, material, &mut notes)?,
        };
        // The load that is chosen for an unprepared mesh shows how it moves; poorly shaped tets
        // that invert under it are reported at the end.
        let allow = scene.solver.allow_inversion;
        let allow = allow.unwrap_or(setup.automatic_load);
        setup.simulator.set_inversion_allowed(allow);
        let setup = setup.with_resolved_loads(gpu, (scene, grid), kind, &mut notes)?;
        Ok((setup, notes))
    }
}

impl FloorEntry {
    /// Returns the floor below the body of `simulator`.
    pub(super) fn term(&self, simulator: &dyn Simulator) -> Result<Floor> {
        let (frame, unit) = simulator.loads().frame_and_unit();
        let point = (DVec3::from(self.point) - frame.origin) * unit;
        let normal = self.normal.map_or(DVec3::Z, DVec3::from);
        Floor::new(
            point,
            normal,
            self.stiffness_rate.unwrap_or(Floor::DEFAULT_RATE),
        )
    }
}

/// Returns the scene's time step, or a fraction of the largest stable one, `limit`; without a limit
/// the default step of an implicit solver.
pub(super) fn choose_step(
    asked: Option<f64>,
    limit: Option<f64>,
    ratio: f64,
    notes: &mut Vec<String>,
) -> f64 {
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
    let dt = ratio * limit;
    notes.push(format!(
        "time step {dt:.3e} s, {ratio} of the largest stable one; override with --dt"
    ));
    dt
}

/// Returns a damping time that an explicit solver tolerates with these undamped springs, as damping
/// reduces the stable step, and a note.
pub(super) fn stable_damping(undamped: &DiscreteModel, kind: SolverKind) -> Option<(f64, String)> {
    let free = vec![false; undamped.rest_positions.len()];
    let limit = largest_stable_step(undamped, &free, SolverKind::Symplectic);
    let limit = limit.filter(|limit| limit.is_finite())?;
    // Explicit Euler is stable only with damping; the other schemes lose a twentieth of the step.
    let share = if kind == SolverKind::Explicit {
        0.5
    } else {
        0.05
    };
    let damping = share * limit;
    let flags = match undamped.discretisation {
        Discretisation::Springs(_) => "--damping",
        Discretisation::Elements(_) => "--damping-ratio and --damping-hz",
    };
    let note = format!(
        "damping {damping:.2e} s × stiffness, chosen for the stability of {kind}; override with {flags}"
    );
    Some((damping, note))
}

/// Returns notes of the rigid regions, and a warning of regions that form one rigid body only
/// because they share nodes.
fn rigid_notes(mesh: &TetMesh, discrete_model: &DiscreteModel) -> Vec<String> {
    let bodies = discrete_model.rigid_bodies();
    if bodies.is_empty() {
        return Vec::new();
    }
    let nodes: usize = bodies.iter().map(|b| b.nodes.len()).sum();
    let surface: usize = bodies.iter().map(|b| b.surface.len()).sum();
    let name = |label: &i64| match mesh.region_names.get(label) {
        Some(name) => name.clone(),
        None => format!("region {label}"),
    };
    let count = match bodies.len() {
        1 => "1 rigid body".to_owned(),
        n => format!("{n} rigid bodies"),
    };
    let mut notes = vec![format!(
        "{count} of {nodes} nodes, {surface} of them on the surface and simulated"
    )];
    let mut welded: Vec<String> = Vec::new();
    for body in bodies.iter().filter(|b| b.labels.len() > 1) {
        let names: Vec<String> = body.labels.iter().map(name).collect();
        let names = names.join(", ");
        if !welded.contains(&names) {
            welded.push(names);
        }
    }
    if !welded.is_empty() {
        notes.push(format!(
            "rigid regions that share nodes form one body: {}; separate two with [mesh] split = [[A, B]]",
            welded.join("; ")
        ));
    }
    notes
}

impl Scene {
    fn tet_simulator(
        &self,
        gpu: &Gpu,
        kind: SolverKind,
        mesh: TetMesh,
        mut material: Material,
        notes: &mut Vec<String>,
    ) -> Result<SimulatorSetup> {
        if !self.material.says_damping() && !kind.is_implicit() {
            material.damping_time = 0.0;
            if let Some((damping, note)) =
                stable_damping(&DiscreteModel::new(&mesh, &material)?, kind)
            {
                material.damping_time = damping;
                notes.push(note);
            }
        }
        let mut discrete_model = DiscreteModel::new(&mesh, &material)?;
        self.add_masses(&mesh, &mut discrete_model)?;
        notes.extend(rigid_notes(&mesh, &discrete_model));
        let contrast = discrete_model
            .elements()
            .map_or(1.0, Elements::stiffness_ratio);
        let simulator = self.simulator_of(gpu, mesh, discrete_model, &material, kind)?;
        if kind.is_implicit() && simulator.engine() == Engine::Gpu && contrast >= GPU_CONTRAST {
            notes.push(format!(
                "the stiffest tissue is {contrast:.0} times as stiff as the softest, which exceeds the 32-bit precision of the GPU: soft tissue may not move; use --engine cpu, or rigid = true for stiff tissue"
            ));
        }
        self.set_up(simulator, notes)
    }

    /// Creates the simulator of the tetrahedral body `mesh`, `discrete_model` on the chosen engine.
    pub(super) fn simulator_of(
        &self,
        gpu: &Gpu,
        mesh: TetMesh,
        discrete_model: DiscreteModel,
        material: &Material,
        kind: SolverKind,
    ) -> Result<Box<dyn Simulator>> {
        let mut engine = self.solver.engine.unwrap_or_default();
        if let Some(entry) = self.cpu_only_entry() {
            engine = match engine {
                EngineChoice::Exactly(Engine::Gpu) => {
                    return Err(Error::Input(format!(
                        "{entry} requires the CPU engine; set --engine cpu or auto"
                    )));
                }
                // Rapier supports some of these entries and rejects the others itself.
                EngineChoice::Exactly(Engine::Rapier) => engine,
                _ => EngineChoice::Exactly(Engine::Cpu),
            };
        } else if engine == EngineChoice::Auto && !self.tool.is_empty() {
            // The CPU engine supports tools on any finite-element body, the GPU not on all.
            engine = EngineChoice::Exactly(Engine::Cpu);
        }
        let how = (kind, self.conjugate_gradients());
        engine.build_tets_from_model(gpu, (mesh, discrete_model), material, how)
    }

    fn grid_simulator(
        &self,
        gpu: &Gpu,
        kind: SolverKind,
        mesh: TetMesh,
        shape: GridShape,
        material: &Material,
        notes: &mut Vec<String>,
    ) -> Result<SimulatorSetup> {
        if kind != SolverKind::Verlet {
            return Err(Error::Input(format!(
                "a grid body requires the solver verlet, got {kind}; set name = \"verlet\", or remove [grid]"
            )));
        }
        let mut model = GridModel::new(shape, material)?;
        if let Some(rate) = self.grid.as_ref().and_then(|g| g.damping) {
            model.damping = rate;
        }
        let engine = self.solver.engine.unwrap_or_default();
        let simulator = engine.build_grid(gpu, mesh, model)?;
        let setup = self.set_up(simulator, notes)?;
        Ok(SimulatorSetup {
            grid: true,
            ..setup
        })
    }

    /// Applies the supports and loads of the scene to `simulator`, or chooses a clamped end.
    fn set_up(
        &self,
        mut simulator: Box<dyn Simulator>,
        notes: &mut Vec<String>,
    ) -> Result<SimulatorSetup> {
        let mut pins = Vec::new();
        for (i, region) in self.pin.iter().enumerate() {
            let nodes = region.nodes(simulator.mesh())?;
            simulator.pin_nodes(&nodes)?;
            let name = region.name.clone();
            let name = name.unwrap_or_else(|| format!("pin{}", i + 1));
            pins.push(NamedPins { name, nodes });
        }
        let actors = TimeDependentLoads::new(self, simulator.as_mut(), notes)?;
        for entry in &self.joint {
            let joint = entry.joint(simulator.mesh())?;
            let joints = Capability::Joints.require(simulator.joints())?;
            joints.add_joint(joint)?;
        }
        if let Some(entry) = &self.contact {
            let contact = Capability::SelfContact.require(simulator.contact())?;
            let through = contact.set_self_contact(SelfContactSettings {
                friction: entry.friction.unwrap_or(0.0),
                gap: entry.gap,
            })?;
            if through > 0 {
                notes.push(format!(
                    "{through} boundary faces intersect others or lie inside the body initially; [contact] separates them by 0.1 mean edge lengths per step"
                ));
            }
        }
        if let Some(floor) = &self.floor {
            simulator.add_term(Arc::new(floor.term(simulator.as_ref())?))?;
        }
        let held = !(self.pin.is_empty() && self.moves.is_empty()) || self.floor.is_some();
        let loose = !(held || self.supports_body());
        let end = match loose {
            true => Some(self.held_end(simulator.as_ref())),
            false => None,
        };
        if let Some((end, _)) = &end {
            simulator.pin_nodes(&end.nodes)?;
            pins.push(NamedPins {
                name: "held".into(),
                nodes: end.nodes.clone(),
            });
        }
        let forces = self.forces(simulator.mesh(), simulator.masses())?;
        if let Some(forces) = &forces {
            simulator.set_forces(forces)?;
        }
        let limit = match self.solver.dt {
            Some(_) => None,
            None => simulator.largest_stable_step(),
        };
        let ratio = safe_step_ratio(simulator.model());
        let dt = choose_step(self.solver.dt, limit, ratio, notes);
        let held = simulator.model().zip(Some(simulator.loads().pinned()));
        let kind = simulator.integrator();
        let pull = self.default_load(kind, held, end, forces.as_deref(), dt, notes);
        simulator.loads_mut().set_gravity(pull.gravity);
        Ok(SimulatorSetup {
            simulator,
            dt: pull.dt,
            cage: None,
            grid: false,
            automatic_load: pull.automatic,
            motion_envelope: pull.reach,
            pins,
            actors,
        })
    }

    /// Adds the masses of `[[mass]]` to the nodes of the body `mesh`.
    fn add_masses(&self, mesh: &TetMesh, model: &mut DiscreteModel) -> Result<()> {
        if self.mass.is_empty() {
            return Ok(());
        }
        let traction = EvenTraction::new(mesh);
        for entry in &self.mass {
            if !(entry.kg.is_finite() && entry.kg > 0.0) {
                return Err(Error::Input(format!(
                    "kg of a [[mass]] must be a finite positive number, got {}",
                    entry.kg
                )));
            }
            let nodes = entry.on.nodes(mesh)?;
            let shares = traction.shares(&nodes).into_iter();
            model.add_masses(nodes.into_iter().zip(shares.map(|share| share * entry.kg)));
        }
        Ok(())
    }

    /// Returns the stopping criterion of conjugate gradients.
    pub(super) fn conjugate_gradients(&self) -> CgSettings {
        let mut settings = CgSettings::default();
        if let Some(tolerance) = self.solver.tolerance {
            settings.tolerance = tolerance;
            settings.acceptable = settings.acceptable.max(tolerance);
        }
        if let Some(iterations) = self.solver.iterations {
            settings.max_iterations = iterations;
        }
        settings
    }

    /// Returns the force on each node of `mesh`, if there are forces; massless nodes get none.
    pub(super) fn forces(&self, mesh: &TetMesh, masses: &[f64]) -> Result<Option<Vec<DVec3>>> {
        if self.force.is_empty() {
            return Ok(None);
        }
        let mut forces = vec![DVec3::ZERO; mesh.nodes.len()];
        let traction = EvenTraction::new(mesh);
        let has = |v: &u32| masses.get(*v as usize).is_some_and(|m| *m > 0.0);
        for entry in &self.force {
            let nodes = entry.on.nodes(mesh)?.into_iter();
            let nodes: Vec<u32> = nodes.filter(has).collect();
            if nodes.is_empty() {
                return Err(Error::Input(
                    "all nodes of a [[force]] are massless; select others with `on`".into(),
                ));
            }
            for (v, share) in nodes.iter().zip(traction.shares(&nodes)) {
                forces[*v as usize] += DVec3::from(entry.total) * share;
            }
        }
        Ok(Some(forces))
    }
}
