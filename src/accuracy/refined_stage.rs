//! `palpate render --within` and `simulate --within`: the mesh of a scene whose body comes to rest,
//! refined until a number is as exact as wanted.

use super::refinement::{Refinable, Refined, Round, Solution, refine};
use super::rest::{MAX_KINETIC_SHARE, kinetic_share};
use super::{RestBody, quasi_static_step, recovery_errors, settle};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, TetMesh};
use crate::scene::{AccuracyEntry, Motion, OrderChoice, Scene, Stage};
use crate::{Error, ProgressFn, Result, no_progress};
use glam::DVec3;

/// Largest number of tets of order 1 whose order may be raised.
pub(crate) const MAX_RAISED_TETS: usize = 150_000;

/// The number that is refined for.
#[derive(Clone, Debug, PartialEq)]
enum Number {
    Displacement,
    Energy,
    Volume,
    /// The force on the pin or tool of this name.
    Force(String),
}

impl Stage {
    /// As [`Stage::new`], on a mesh that is refined until a number of the body at rest is as exact as
    /// [`Scene::accuracy`] asks for: on each mesh the body runs the steps of the scene (on finer ones
    /// from the solution before) and comes to rest under the loads of that moment. Pins and loads are
    /// regions of the shape. Calls `on_round` after each mesh with the number: a displacement in file
    /// units, an energy (J), a ratio of volumes, or a force (N).
    ///
    /// Also returns why the number is not as exact as wanted, and what it would take, if so.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene of several bodies, a body in fast motion, one whose error cannot be
    /// estimated, or an unknown number; as [`Stage::new`] and a simulation step.
    pub fn refined(
        gpu: &Gpu,
        scene: &Scene,
        on_round: &mut dyn FnMut(&Round),
        progress: ProgressFn,
    ) -> Result<(Stage, Option<String>)> {
        let (scene, mesh, missed) = refined_mesh(gpu, scene, on_round, progress)?;
        Ok((Stage::with_mesh(gpu, &scene, mesh)?, missed))
    }
}

/// Returns the scene of the last mesh of [`Stage::refined`], this mesh, and why its number is not as exact
/// as wanted, if so.
///
/// # Errors
/// As [`Stage::refined`].
pub(crate) fn refined_mesh(
    gpu: &Gpu,
    scene: &Scene,
    on_round: &mut dyn FnMut(&Round),
    progress: ProgressFn,
) -> Result<(Scene, TetMesh, Option<String>)> {
    if !scene.body.is_empty() || scene.grid.is_some() || scene.cage.is_some() {
        return Err(Error::Input(
            "a refined scene needs a single tetrahedral body; remove [[body]], [grid] and [cage], or --within".into(),
        ));
    }
    if scene.solver.name.is_none() {
        return Err(Error::Input(
            "a static body has no number to refine for; set a solver ([solver] name = \"implicit\"), or remove --within".into(),
        ));
    }
    let number = match scene.accuracy.of.as_deref() {
        None | Some("displacement") => Number::Displacement,
        Some("energy") => Number::Energy,
        Some("volume") => Number::Volume,
        Some(name) => Number::Force(name.to_owned()),
    };
    let (scene, mesh, may_raise) = first_mesh(scene)?;
    let mut body = RestingBody {
        gpu,
        scene: &scene,
        number,
        may_raise,
        on_round,
    };
    let Refined { mesh, missed, .. } = refine(&mut body, mesh, &scene.accuracy, progress)?;
    let mut scene = of_order(&scene, mesh.order);
    scene.accuracy = AccuracyEntry::default();
    Ok((scene, mesh, missed))
}

/// Returns a scene with the order of the elements of its first mesh, this mesh, and whether the order may
/// be raised: linear tets, unless the order is set; curved ten-node tets of a file keep their shape.
///
/// # Errors
/// As [`Scene::load_mesh`].
pub(crate) fn first_mesh(scene: &Scene) -> Result<(Scene, TetMesh, bool)> {
    if let Some(OrderChoice::Exactly(order)) = scene.material.order {
        let mut mesh = scene.load_simulated_mesh(&no_progress)?;
        if order == ElementOrder::Quadratic && mesh.order == ElementOrder::Linear {
            mesh = mesh.with_mid_edge_nodes()?;
        }
        return Ok((of_order(scene, order), mesh, false));
    }
    let mesh = scene.load_mesh(&no_progress)?;
    let mut any = scene.clone();
    any.material.order = Some(OrderChoice::Auto);
    let is_curved = mesh.order == ElementOrder::Quadratic;
    match is_curved && any.supports_order_2(&mesh, MAX_RAISED_TETS) {
        true => Ok((of_order(scene, ElementOrder::Quadratic), mesh, false)),
        false => {
            let scene = of_order(scene, ElementOrder::Linear);
            let mesh = scene.as_simulated(mesh);
            Ok((scene, mesh, true))
        }
    }
}

/// Returns `scene` with elements of `order`.
pub(crate) fn of_order(scene: &Scene, order: ElementOrder) -> Scene {
    let mut scene = scene.clone();
    scene.material.order = Some(OrderChoice::Exactly(order));
    if order == ElementOrder::Quadratic {
        scene.material.volume = None;
    }
    scene
}

/// A body that comes to rest, on one mesh after the other.
struct RestingBody<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    number: Number,
    may_raise: bool,
    on_round: &'a mut dyn FnMut(&Round),
}

impl RestingBody<'_> {
    /// Returns the number of a body.
    fn measure(&self, motion: &mut Motion) -> Result<f64> {
        match &self.number {
            Number::Displacement => {
                let (x, rest) = (motion.positions()?, &motion.simulator.mesh().nodes);
                let moved = x.iter().zip(rest).map(|(x, rest)| x.distance(*rest));
                Ok(moved.fold(0.0, f64::max))
            }
            Number::Energy => Ok(motion.report()?.energy.elastic),
            Number::Volume => {
                let mut mesh = motion.simulator.mesh().clone();
                let rest = mesh.volume();
                mesh.nodes = motion.positions()?;
                Ok(mesh.volume() / rest)
            }
            Number::Force(name) => {
                let forces = motion.reactions()?;
                let found = forces.iter().find(|(own, _)| own == name);
                let names = forces.iter().map(|(own, _)| own.as_str());
                let found = found.ok_or_else(|| {
                    Error::Input(format!(
                        "unknown number \"{name}\" ([accuracy] of, --of); expected displacement, energy, volume or one of the pins and tools: {}",
                        names.collect::<Vec<_>>().join(", ")
                    ))
                });
                Ok(found?.1.force.length())
            }
        }
    }
}

impl Refinable for RestingBody<'_> {
    fn solve(&mut self, mesh: &TetMesh, start: Option<&[DVec3]>) -> Result<Solution> {
        let mut scene = of_order(self.scene, mesh.order);
        scene.accuracy = AccuracyEntry::default();
        let mut stage = Stage::with_mesh(self.gpu, &scene, mesh.clone())?;
        let steps = stage.steps();
        let motion = stage.motion_mut().ok_or_else(|| {
            Error::Input("a static body has no number to refine for; remove --within".into())
        })?;
        // Bodies without an estimate are refused before any work.
        RestBody::new(&scene, motion)?;
        if let Some(start) = start {
            motion.simulator.set_positions(start)?;
        }
        motion.run(steps, &mut |_| {})?;
        if kinetic_share(motion)? > MAX_KINETIC_SHARE {
            return Err(Error::Input(
                "the body is in fast motion: a mesh is refined for bodies at rest or in slow motion, which more steps may reach (--steps)".into(),
            ));
        }
        let positions = motion.positions()?;
        let dt = quasi_static_step(motion);
        motion.set_sleep_allowed(false);
        let settled = settle(motion, (&positions, dt), &mut |motion| {
            Ok(vec![self.measure(motion)?])
        })?;
        let positions = motion.positions()?;
        Ok(Solution {
            value: settled.values.first().copied().unwrap_or(f64::NAN),
            errors: recovery_errors(motion, &positions)?,
            positions,
            stopped: None,
        })
    }

    fn may_raise_order(&self, mesh: &TetMesh) -> bool {
        let mut scene = self.scene.clone();
        scene.material.order = Some(OrderChoice::Auto);
        self.may_raise && scene.supports_order_2(mesh, MAX_RAISED_TETS)
    }

    fn after(&mut self, round: &Round, _: &TetMesh) -> Result<()> {
        (self.on_round)(round);
        Ok(())
    }
}
