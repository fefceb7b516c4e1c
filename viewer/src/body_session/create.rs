//! Creation of the session of a scene, with a finger, a solver and supports where it has none.

use super::press::{fitting_radius, put_away};
use super::{BodySession, STEP};
use crate::body_edits::BodyEditHistory;
use palpate::Result;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use palpate::physics::SolverKind;
use palpate::press::in_pieces;
use palpate::scene::{Axis, Motion, Region, Scene, SphereEntry, Stage, ToolEntry};
use std::sync::Arc;
use web_time::Instant;

/// Fraction of its height along gravity that rests on the table, for a body without other supports.
const TABLE_HEIGHT_FRACTION: f64 = 0.04;

impl BodySession {
    /// Creates the session of `scene` with `mesh`, with a finger of `radius` or of a default
    /// radius.
    ///
    /// # Errors
    /// The errors of [`Stage::with_mesh`].
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        mesh: Arc<TetMesh>,
        radius: Option<f64>,
    ) -> Result<BodySession> {
        let made = scene.clone();
        let (mut scene, touchable) = held(scene);
        let mut radius = radius;
        let (stage, finger) = match touchable {
            Ok(()) => {
                let radius = *radius.get_or_insert_with(|| fitting_radius(&mesh));
                let (away, number) = (put_away(mesh.bounds()), led(&scene));
                scene.tool.push(ToolEntry {
                    name: Some("finger".into()),
                    sphere: Some(SphereEntry { radius }),
                    at: away.to_array(),
                    colour: Some([0.87, 0.72, 0.62]),
                    ..ToolEntry::default()
                });
                match Stage::with_mesh(gpu, &scene, (*mesh).clone()) {
                    Ok(stage) => (stage, Ok(number)),
                    // Some bodies that move do not support tools.
                    Err(why) => {
                        scene.tool.pop();
                        let stage = Stage::with_mesh(gpu, &scene, (*mesh).clone())?;
                        (stage, Err(why.to_string()))
                    }
                }
            }
            Err(why) => {
                let stage = match scene.body.is_empty() && scene.grid.is_none() {
                    true => Stage::with_mesh(gpu, &scene, (*mesh).clone())?,
                    false => Stage::new(gpu, &scene)?,
                };
                (stage, Err(why))
            }
        };
        Ok(BodySession::on(stage, (&scene, made), mesh, radius, finger))
    }

    /// Creates the session of `scene` as a static body.
    pub(crate) fn static_body(gpu: &Gpu, scene: &Scene, mesh: Arc<TetMesh>) -> Result<BodySession> {
        let mut still = scene.clone();
        still.solver.name = None;
        let stage = Stage::with_mesh(gpu, &still, (*mesh).clone())?;
        let finger = Err("a recorded series is not simulated; open one frame".into());
        Ok(BodySession::on(
            stage,
            (&still, scene.clone()),
            mesh,
            None,
            finger,
        ))
    }

    /// Creates the session of a stage that was created from the completed scene `made`.
    fn on(
        stage: Stage,
        (scene, made): (&Scene, Scene),
        mesh: Arc<TetMesh>,
        radius: Option<f64>,
        finger: std::result::Result<usize, String>,
    ) -> BodySession {
        let mut stage = stage;
        let timed = !(scene.grab.is_empty()
            && scene.cut.is_empty()
            && scene.moves.is_empty()
            && scene.muscle.is_empty()
            && scene.pressure.is_empty())
            || scene
                .tool
                .iter()
                .any(|t| t.path.is_some() || t.file.is_some() || t.rotation.is_some());
        if stage.motion().is_some_and(Motion::has_state) {
            // Checkpoints are needed to undo cuts.
            stage.keep_checkpoints();
        }
        let now = Instant::now();
        let unit = stage.motion().map(|m| m.length_unit());
        // Scenes of several bodies and of grids generate their own mesh.
        let mesh = match mesh.tets.is_empty() {
            true => Arc::new(stage.mesh().clone()),
            false => mesh,
        };
        let radius = radius.unwrap_or_else(|| fitting_radius(&mesh));
        let pieces = finger.is_ok().then(|| in_pieces(&mesh)).flatten();
        BodySession {
            bounds: stage.mesh().bounds(),
            unit: unit.or(mesh.length_unit).unwrap_or(1.0),
            notes: stage.notes().iter().cloned().chain(pieces).collect(),
            playing: stage.motion().is_some(),
            stage,
            mesh,
            radius,
            finger,
            press: None,
            grab: None,
            blade: None,
            edits: BodyEditHistory::default(),
            read: (Vec::new(), made.skin.clone()),
            made,
            player: None,
            samples: Vec::new(),
            speed: 1.0,
            owed: 0.0,
            site_warning: None,
            timed,
            stirred: false,
            under_way: false,
            asked: [None; 2],
            shown: None,
            last: now,
            counted: (now, 0),
            steps: 0,
            rate: 0.0,
            failure: None,
            failed: false,
            remark: None,
            version: 0,
        }
    }
}

/// Returns the scene with a default solver and default supports if it has none, and whether it can
/// be pressed on, or why not.
fn held(scene: &Scene) -> (Scene, std::result::Result<(), String>) {
    let mut scene = scene.clone();
    if !scene.body.is_empty() || scene.grid.is_some() || scene.cage.is_some() {
        let why =
            "pressing requires one tet body; remove [[body]], [grid] and [cage] from the scene";
        return (scene, Err(why.into()));
    }
    if scene.mesh.rest.is_some() {
        return (
            scene,
            Err(
                "a deformed mesh ([mesh] rest) is not simulated; remove `rest` to press on it"
                    .into(),
            ),
        );
    }
    if scene.solver.name.is_none() {
        scene.solver.name = Some(SolverKind::Implicit.to_string());
        scene.solver.gravity.get_or_insert([0.0; 3]);
        scene.solver.dt.get_or_insert(STEP);
        scene.solver.tolerance.get_or_insert(0.01);
        if scene.pin.is_empty() && scene.moves.is_empty() {
            scene.pin.push(Region {
                name: Some("table".into()),
                axis: Some(Axis::Z),
                below: Some(TABLE_HEIGHT_FRACTION),
                ..Region::default()
            });
        }
    }
    (scene, Ok(()))
}

/// Returns the number of tools with prescribed motion; tools with a mass or a spring become regions
/// of the mesh.
fn led(scene: &Scene) -> usize {
    let carried = |t: &&ToolEntry| t.mass.is_some() || t.spring_stiffness.is_some();
    scene.tool.len() - scene.tool.iter().filter(carried).count()
}
