//! Builds a simulator of several bodies from a scene's `[[body]]` entries.

use super::reactions::NamedPins;
use super::simulator::SimulatorSetup;
use super::time_dependent_loads::TimeDependentLoads;
use super::{BodyEntry, MeshSource, Scene, SolverEntry};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::grid::GridShape;
use crate::physics::{Member, MultiBody, Simulator, SolverKind};
use crate::{Error, Result, no_progress};
use glam::DVec3;

/// A body of a scene, before its simulator is created.
pub(super) struct BodySource {
    name: String,
    /// Equivalent scene of this body alone.
    scene: Scene,
    mesh: TetMesh,
    /// Shape of a grid body.
    shape: Option<GridShape>,
    notes: Vec<String>,
}

impl Scene {
    /// Returns the mesh of a scene of one body, as it is simulated: of ten-node tets the corners only,
    /// unless the scene sets order 2.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene of several bodies; otherwise as [`MeshSource::load`].
    pub fn mesh_of_one(&self) -> Result<TetMesh> {
        self.check_single_body()?;
        self.load_simulated_mesh(&no_progress)
    }

    /// Returns the mesh of a scene of one body with all of its nodes, whatever the order of the scene.
    ///
    /// # Errors
    /// As [`Scene::mesh_of_one`].
    pub(crate) fn whole_mesh_of_one(&self) -> Result<TetMesh> {
        self.check_single_body()?;
        self.load_mesh(&no_progress)
    }

    /// Returns metres per unit of the coordinates of `mesh`: by the scene, or by the mesh; `None` if
    /// neither says.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid unit.
    pub(crate) fn length_unit(&self, mesh: &TetMesh) -> Result<Option<f64>> {
        let given = self.mesh.unit.as_ref().map(|u| u.metres()).transpose()?;
        Ok(given.or(mesh.length_unit))
    }

    fn check_single_body(&self) -> Result<()> {
        match self.body.is_empty() {
            true => Ok(()),
            false => Err(Error::Input(
                "a single body is required, but the scene has [[body]] entries; use a scene with the [mesh] of one of them".into(),
            )),
        }
    }

    /// Loads the bodies of [`Scene::body`], in the unit of the first and at their positions.
    pub(super) fn body_sources(&self) -> Result<Vec<BodySource>> {
        if self.mesh != MeshSource::default() || self.grid.is_some() || self.cage.is_some() {
            return Err(Error::Input(
                "[mesh], [grid] and [cage] are not allowed together with [[body]] entries; move them into each [[body]]".into(),
            ));
        }
        if !(self.pin.is_empty() && self.force.is_empty()) {
            return Err(Error::Input(
                "[[pin]] and [[force]] are not allowed together with [[body]] entries; use [[body.pin]] and [[body.force]]".into(),
            ));
        }
        if let Some(entry) = self.tets_only_entry() {
            return Err(Error::Input(format!(
                "{entry} requires a scene of one body, but the scene has [[body]] entries; remove it, or use a scene of that body"
            )));
        }
        let mut sources: Vec<BodySource> = Vec::new();
        for (i, entry) in self.body.iter().enumerate() {
            let name = entry.name.clone();
            let name = name.unwrap_or_else(|| format!("body {}", i + 1));
            if entry.mesh.rest.is_some() {
                return Err(Error::Input(format!(
                    "body \"{name}\": `rest` requires a scene of one static body; remove it"
                )));
            }
            if sources.iter().any(|s| s.name == name) {
                return Err(Error::Input(format!(
                    "two bodies have the name \"{name}\"; names must be unique"
                )));
            }
            let unit = sources.first().map(|s| s.mesh.length_unit);
            let source = self.body_source(entry, &name, unit);
            sources.push(source.map_err(|e| of_body(&name, e))?);
        }
        Ok(sources)
    }

    /// Loads a body, converted to `unit` if that is given.
    fn body_source(
        &self,
        entry: &BodyEntry,
        name: &str,
        unit: Option<Option<f64>>,
    ) -> Result<BodySource> {
        let scene = self.of_body(entry);
        let (mut mesh, mut shape, notes) = match &scene.grid {
            None => (scene.load_mesh(&no_progress)?, None, Vec::new()),
            Some(grid) => {
                let (shape, mesh, notes) = scene.carve(grid)?;
                (mesh, Some(shape), notes)
            }
        };
        let own = scene.length_unit(&mesh)?;
        let unit = unit.unwrap_or(own);
        let scale = own.unwrap_or(1.0) / unit.unwrap_or(1.0);
        let offset = DVec3::from(entry.offset.unwrap_or_default());
        if !offset.is_finite() {
            return Err(Error::Input(format!(
                "offset must be three finite numbers, got {offset}"
            )));
        }
        mesh.length_unit = unit;
        for p in &mut mesh.nodes {
            *p = scale * *p + offset;
        }
        if let Some(shape) = &mut shape {
            shape.origin = scale * shape.origin + offset;
            shape.spacing *= scale;
        }
        Ok(BodySource {
            name: name.into(),
            scene: Scene {
                // The unit is stored in the mesh from here on.
                mesh: MeshSource::default(),
                ..scene
            },
            mesh,
            shape,
            notes,
        })
    }

    /// Returns the equivalent scene of `entry` alone.
    fn of_body(&self, entry: &BodyEntry) -> Scene {
        let material = entry.material.clone();
        let name = entry.solver.clone().or(self.solver.name.clone());
        // The common step is divided into as many substeps as an explicit scheme needs.
        let kind = name.as_deref().and_then(|name| name.parse().ok());
        let implicit = kind.is_some_and(SolverKind::is_implicit);
        Scene {
            mesh: entry.mesh.clone(),
            material: material.unwrap_or_else(|| self.material.clone()),
            solver: SolverEntry {
                name,
                engine: entry.engine.or(self.solver.engine),
                dt: entry.dt.or(self.solver.dt.filter(|_| implicit)),
                ..self.solver.clone()
            },
            pin: entry.pin.clone(),
            force: entry.force.clone(),
            grid: entry.grid.clone(),
            cage: entry.cage.clone(),
            body: Vec::new(),
            ..self.clone()
        }
    }
}

/// Merges the meshes of `sources` into one static mesh, and returns it with their notes.
pub(super) fn merge_static(sources: Vec<BodySource>) -> Result<(TetMesh, Vec<String>)> {
    let parts: Vec<_> = sources.iter().map(|s| (s.name.clone(), &s.mesh)).collect();
    let mesh = TetMesh::merge_meshes(&parts)?;
    let notes = sources.into_iter();
    let notes = notes.flat_map(|s| s.notes.into_iter().map(move |n| format!("{}: {n}", s.name)));
    Ok((mesh, notes.collect()))
}

/// Whether any of `sources` has a solver.
pub(super) fn any_dynamic(sources: &[BodySource]) -> bool {
    sources.iter().any(|s| s.scene.solver.name.is_some())
}

/// Creates the simulator of all `sources`, and notes of the automatic choices.
pub(super) fn setup(
    gpu: &Gpu,
    scene: &Scene,
    sources: Vec<BodySource>,
) -> Result<(SimulatorSetup, Vec<String>)> {
    let (mut members, mut notes) = (Vec::new(), Vec::new());
    let (mut reach, mut moves, mut grids) = (Vec::new(), false, 0);
    let (mut pins, mut first) = (Vec::new(), 0);
    for source in sources {
        let name = source.name;
        let kind = source.scene.solver.name.as_deref();
        let kind = kind.map(str::parse::<SolverKind>).transpose()?;
        let kind = kind.ok_or_else(|| {
            Error::Input(format!(
                "body \"{name}\" has no solver, but others have one; set a solver for all bodies with [solver] name = \"implicit\""
            ))
        })?;
        let own = SimulatorSetup::new(gpu, &source.scene, kind, source.mesh, source.shape);
        let (own, own_notes) = own.map_err(|e| of_body(&name, e))?;
        let own_notes = source.notes.into_iter().chain(own_notes);
        notes.extend(own_notes.map(|note| format!("{name}: {note}")));
        grids += usize::from(own.grid);
        match own.motion_envelope {
            Some(points) => {
                moves = true;
                reach.extend(points);
            }
            None => reach.extend(&own.simulator.mesh().nodes),
        }
        pins.extend(own.pins.into_iter().map(|pin| NamedPins {
            name: format!("{name}/{}", pin.name),
            nodes: pin.nodes.iter().map(|v| v + first).collect(),
        }));
        first += own.simulator.mesh().nodes.len() as u32;
        members.push(Member {
            name,
            simulator: own.simulator,
            step: own.dt,
        });
    }
    let longest = members.iter().map(|m| m.step).fold(0.0, f64::max);
    let dt = scene.solver.dt.unwrap_or(longest);
    let grid = grids == members.len();
    let bodies = MultiBody::new(gpu, members)?;
    for member in bodies.members().iter().map(|m| m.report(dt)) {
        if member.steps > 1 {
            notes.push(format!(
                "{}: {} substeps per common time step of {dt:.3e} s",
                member.name, member.steps
            ));
        }
    }
    let setup = SimulatorSetup {
        simulator: Box::new(bodies),
        dt,
        cage: None,
        grid,
        automatic_load: false,
        motion_envelope: moves.then_some(reach),
        pins,
        actors: TimeDependentLoads::default(),
    };
    Ok((setup, notes))
}

/// Prefixes an error with the name of the body.
fn of_body(name: &str, error: Error) -> Error {
    match error {
        Error::Input(what) => Error::Input(format!("body \"{name}\": {what}")),
        other => other,
    }
}
