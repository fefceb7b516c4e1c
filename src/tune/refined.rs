//! Scenes with `[accuracy]`: the mesh is refined first, for a number at rest; then methods are chosen on
//! it by trial.

use super::{TuneTarget, Tuned, tune};
use crate::accuracy::{Round, refined_mesh};
use crate::gpu::Gpu;
use crate::physics::{Engine, EngineChoice, SolverKind};
use crate::scene::{AccuracyEntry, Scene};
use crate::{ProgressFn, Result, io};
use std::path::Path;

/// Tunes `scene`, the scene file `from`, and writes it with the chosen settings as `to`. If the scene has
/// `[accuracy] within`, its mesh is refined until its number is as exact ([`Stage::refined`]); `on_round` is
/// called after each mesh. The last mesh, beside `to` with the extension `.vtu`, is that of the tuned
/// scene, and its quadratic tets, if they are not too many, are the reference.
///
/// # Errors
/// As [`tune()`], [`Stage::refined`] and [`Tuned::write`].
///
/// [`Stage::refined`]: crate::scene::Stage::refined
pub fn tune_file(
    gpu: &Gpu,
    scene: &Scene,
    wanted: &TuneTarget,
    (from, to): (&Path, &Path),
    on_round: &mut dyn FnMut(&Round),
    progress: ProgressFn,
) -> Result<Tuned> {
    let tuned = match scene.accuracy.within {
        None => tune(gpu, scene, wanted, progress)?,
        Some(_) => tune_refined(
            gpu,
            scene,
            wanted,
            &to.with_extension("vtu"),
            on_round,
            progress,
        )?,
    };
    tuned.write(from, to)?;
    Ok(tuned)
}

fn tune_refined(
    gpu: &Gpu,
    scene: &Scene,
    wanted: &TuneTarget,
    file: &Path,
    on_round: &mut dyn FnMut(&Round),
    progress: ProgressFn,
) -> Result<Tuned> {
    // The equilibrium under the loads, whatever the steps of the motion.
    let mut at_rest = scene.clone();
    at_rest.solver.name = Some(SolverKind::Implicit.name().into());
    at_rest.solver.engine = Some(EngineChoice::Exactly(Engine::Cpu));
    at_rest.solver.steps = Some(0);
    let (_, mesh, missed) = refined_mesh(gpu, &at_rest, on_round, progress)?;
    let notes = io::write(file, &mesh)?;
    let mut refined = scene.with_mesh_file(file);
    refined.accuracy = AccuracyEntry::default();
    let mut tuned = tune(gpu, &refined, wanted, progress)?;
    tuned.notes.splice(0..0, notes);
    if let Some(why) = missed {
        tuned.target_met = false;
        tuned.notes.push(format!(
            "the number is not as exact as wanted ([accuracy] within): {why}"
        ));
    }
    tuned.has_refined_mesh = true;
    Ok(tuned)
}
