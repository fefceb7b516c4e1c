//! Creation of a stage from a scene.

use super::{NodeSource, Stage};
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::physics::SolverKind;
use crate::physics::grid::GridShape;
use crate::scene::active_blade::ActiveBlade;
use crate::scene::appearance::SceneAppearance;
use crate::scene::simulator::SimulatorSetup;
use crate::scene::{Motion, PlannedRun, Scene, ToolEntry, bodies};
use crate::{Error, Result, no_progress};

impl Stage {
    /// Loads the mesh of `scene` and prepares everything on `gpu`.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an invalid scene, an error of reading the mesh, or
    /// [`Error::Gpu`](crate::Error::Gpu) if it exceeds the limits of the device.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Stage> {
        if !scene.body.is_empty() {
            return Stage::with_bodies(gpu, scene);
        }
        let Some(grid) = &scene.grid else {
            return Stage::with_mesh(gpu, scene, scene.load_mesh(&no_progress)?);
        };
        let (shape, mesh, notes) = scene.carve(grid)?;
        let mut stage = Stage::assemble(gpu, scene, mesh, Some(shape))?;
        stage.notes.splice(0..0, notes);
        Ok(stage)
    }

    /// Creates the stage of a scene of several bodies.
    fn with_bodies(gpu: &Gpu, scene: &Scene) -> Result<Stage> {
        let sources = scene.body_sources()?;
        if !bodies::any_dynamic(&sources) {
            let (mesh, setup_notes) = bodies::merge_static(sources)?;
            let drive = NodeSource::posed(gpu, mesh)?;
            return Stage::with_drive(gpu, scene, drive, setup_notes);
        }
        let (setup, setup_notes) = bodies::setup(gpu, scene, sources)?;
        let motion = Motion::of_setup(scene, setup)?;
        Stage::with_drive(
            gpu,
            scene,
            NodeSource::Simulated(Box::new(motion)),
            setup_notes,
        )
    }

    /// As [`Stage::new`], with a mesh that is loaded already.
    ///
    /// # Errors
    /// As [`Stage::new`].
    pub fn with_mesh(gpu: &Gpu, scene: &Scene, mesh: TetMesh) -> Result<Stage> {
        Stage::assemble(gpu, scene, mesh, None)
    }

    fn assemble(
        gpu: &Gpu,
        scene: &Scene,
        mesh: TetMesh,
        shape: Option<GridShape>,
    ) -> Result<Stage> {
        let solver = scene.solver.name.as_deref().map(str::parse::<SolverKind>);
        if solver.is_some() && scene.mesh.rest.is_some() {
            return Err(Error::Input(
                "[mesh] rest (--rest) requires a static body: a solver starts from the positions in the mesh file; remove one of them".into(),
            ));
        }
        let carried = scene.tool.iter().any(ToolEntry::is_dynamic) && solver.is_some();
        let (held, mut mesh) = match carried {
            true => scene.with_dynamic_tools(mesh)?,
            false => (scene.clone(), mesh),
        };
        let scene = &held;
        let Some(kind) = solver.transpose()? else {
            let Some((now, note)) = scene.move_to_rest(&mut mesh)? else {
                return Stage::with_drive(gpu, scene, NodeSource::posed(gpu, mesh)?, Vec::new());
            };
            let drive = NodeSource::posed(gpu, mesh)?;
            let mut stage = Stage::with_drive(gpu, scene, drive, note.into_iter().collect())?;
            stage.set_positions(&now)?;
            stage.fit_view(&[])?;
            return Ok(stage);
        };
        let (setup, setup_notes) = SimulatorSetup::new(gpu, scene, kind, mesh, shape)?;
        let motion = Motion::of_setup(scene, setup)?;
        Stage::with_drive(
            gpu,
            scene,
            NodeSource::Simulated(Box::new(motion)),
            setup_notes,
        )
    }

    /// Creates the stage of one or several bodies moved by `drive`; `setup_notes` are the notes so far.
    fn with_drive(
        gpu: &Gpu,
        scene: &Scene,
        mut drive: NodeSource,
        setup_notes: Vec<String>,
    ) -> Result<Stage> {
        let cutters = scene
            .cut
            .iter()
            .map(ActiveBlade::new)
            .collect::<Result<_>>()?;
        let mut notes = scene.notes.clone();
        notes.extend(drive.mesh().repairs.warnings.iter().cloned());
        let asked = !(scene.grab.is_empty() && scene.cut.is_empty() && scene.tool.is_empty())
            || scene.floor.is_some();
        if matches!(drive, NodeSource::Posed(_)) && asked {
            let still = "the body is static, so grabs, cuts, floors and tools are ignored; set [solver] name";
            notes.push(still.into());
        }
        if scene.accuracy.within.is_some() {
            let coarse = "the mesh is not refined here, whatever [accuracy] says: palpate press, render and simulate do that";
            notes.push(coarse.into());
        }
        let mut looks = SceneAppearance::new(gpu, scene, &mut drive)?;
        notes.extend(setup_notes);
        notes.append(&mut looks.notes);
        Ok(Stage {
            gpu: gpu.clone(),
            drive,
            looks,
            scene: scene.clone(),
            cutters,
            journal: None,
            backdrop: [0.0, 0.0, 0.0, 1.0],
            steps: scene.solver.steps.unwrap_or(PlannedRun::DEFAULT_STEPS),
            cached: None,
            path_report: None,
            path_tracer: None,
            starting_paths: None,
            pictures: [0; 2],
            depth: None,
            notes,
        })
    }
}
