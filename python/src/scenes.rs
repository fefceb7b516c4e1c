//! Scenes, which Python has as dictionaries and hands over as JSON.

use crate::errors::{Raise, input_error};
use palpate::Error;
use palpate::render::TransferFunction;
use palpate::scene::{PlannedRun, STEPS, Scene};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// The text of a scene file with these entries.
fn text(entries: &str) -> palpate::Result<String> {
    let wrong = |e: &dyn std::fmt::Display| Error::Input(format!("scene: {e}"));
    let entries: toml::Table = serde_json::from_str(entries).map_err(|e| wrong(&e))?;
    toml::to_string(&entries).map_err(|e| wrong(&e))
}

/// The scene of these entries, whose files are relative to `folder`.
pub fn scene(entries: &str, folder: &Path) -> palpate::Result<Scene> {
    Scene::parse_in(&text(entries)?, folder)
}

/// The same with the steps that `palpate render` would have ahead.
pub fn scene_to_draw(entries: &str, folder: &Path) -> palpate::Result<Scene> {
    let mut scene = scene(entries, folder)?;
    scene.solver.run = Some(PlannedRun {
        steps: scene.solver.steps.unwrap_or(STEPS),
        draws_frames: false,
    });
    Ok(scene)
}

/// The entries of a scene file, as JSON; that they make sense is seen where they are used.
#[pyfunction]
pub fn read_toml(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let text = std::fs::read_to_string(&path).map_err(Error::io(&path));
    let text = text.or_raise(py)?;
    // Its own words name the line of what is wrong.
    py.detach(|| Scene::read(&path)).or_raise(py)?;
    let entries: toml::Table = toml::from_str(&text).map_err(|e| input_error(py, e.to_string()))?;
    serde_json::to_string(&entries).map_err(|e| input_error(py, e.to_string()))
}

/// The text of a scene file of these entries.
#[pyfunction]
pub fn to_toml(py: Python<'_>, entries: &str) -> PyResult<String> {
    text(entries).or_raise(py)
}

/// Time and file of each frame of a series.
#[pyfunction]
pub fn read_series(py: Python<'_>, path: PathBuf) -> PyResult<Vec<(f64, PathBuf)>> {
    let frames = py.detach(|| palpate::io::read_pvd(&path)).or_raise(py)?;
    Ok(frames.into_iter().map(|f| (f.time, f.file)).collect())
}

/// The names of the transfer functions and colour maps that ship.
#[pyfunction]
pub fn presets() -> Vec<String> {
    TransferFunction::preset_names()
        .into_iter()
        .map(Into::into)
        .collect()
}
