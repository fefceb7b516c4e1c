//! Scenes: dictionaries in Python, passed to Rust as JSON.

use crate::errors::{Raise, input_error};
use palpate::gpu::Gpu;
use palpate::render::TransferFunction;
use palpate::scene::{PlannedRun, Scene, Stage};
use palpate::{Error, ProgressFn};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// Returns the text of a scene file with these entries.
fn text(entries: &str) -> palpate::Result<String> {
    let wrong = |e: &dyn std::fmt::Display| Error::Input(format!("scene: {e}"));
    let entries: toml::Table = serde_json::from_str(entries).map_err(|e| wrong(&e))?;
    toml::to_string(&entries).map_err(|e| wrong(&e))
}

/// Parses the scene of these entries; file paths are relative to `folder`.
pub fn scene(entries: &str, folder: &Path) -> palpate::Result<Scene> {
    Scene::parse_in(&text(entries)?, folder)
}

/// Parses the scene, with the planned steps that `palpate render` uses.
pub fn scene_to_draw(entries: &str, folder: &Path) -> palpate::Result<Scene> {
    let mut scene = scene(entries, folder)?;
    scene.solver.run = Some(PlannedRun {
        steps: scene.solver.steps.unwrap_or(PlannedRun::DEFAULT_STEPS),
        draws_frames: false,
    });
    Ok(scene)
}

/// Creates the stage of a scene; on a refined mesh if it asks for that, with a note if the number is not
/// as exact as wanted.
pub fn stage(gpu: &Gpu, scene: &Scene, progress: ProgressFn) -> palpate::Result<Stage> {
    if scene.accuracy.within.is_none() {
        return Stage::new(gpu, scene);
    }
    let (mut stage, missed) = Stage::refined(gpu, scene, &mut |_| {}, progress)?;
    if let Some(why) = missed {
        stage.add_note(format!(
            "the number is not as exact as wanted ([accuracy]): {why}"
        ));
    }
    Ok(stage)
}

/// Returns the entries of a scene file as JSON; most values are validated when they are used.
#[pyfunction]
pub fn read_toml(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let text = std::fs::read_to_string(&path).map_err(Error::io(&path));
    let text = text.or_raise(py)?;
    // This error message contains the line of the mistake.
    py.detach(|| Scene::read(&path)).or_raise(py)?;
    let entries: toml::Table = toml::from_str(&text).map_err(|e| input_error(py, e.to_string()))?;
    serde_json::to_string(&entries).map_err(|e| input_error(py, e.to_string()))
}

/// Returns the text of a scene file with these entries.
#[pyfunction]
pub fn to_toml(py: Python<'_>, entries: &str) -> PyResult<String> {
    text(entries).or_raise(py)
}

/// Returns the time and the files of each frame of a series.
#[pyfunction]
pub fn read_series(py: Python<'_>, path: PathBuf) -> PyResult<Vec<(f64, Vec<PathBuf>)>> {
    let frames = py.detach(|| palpate::io::read_pvd(&path)).or_raise(py)?;
    Ok(frames.into_iter().map(|f| (f.time, f.files)).collect())
}

/// Returns the names of the built-in transfer functions and colour maps.
#[pyfunction]
pub fn presets() -> Vec<String> {
    TransferFunction::preset_names()
        .into_iter()
        .map(Into::into)
        .collect()
}
