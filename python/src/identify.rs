//! Identification of material parameters from measured presses.

use crate::devices::device;
use crate::errors::input_error;
use crate::mesh::Mesh;
use crate::scenes;
use crate::work::LongTask;
use palpate::Error;
use palpate::identify::{Experiment, IdentifyOptions, Unknown};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Identifies unknowns of a scene from files of measured presses. Returns the content of
/// `identified.json` and the rows of `residuals.csv`, both as JSON, and the mesh with the stiffness of a
/// lump, if that is an unknown.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn identify(
    py: Python<'_>,
    entries: &str,
    folder: PathBuf,
    data: Vec<PathBuf>,
    unknown: Vec<String>,
    noise: Option<f64>,
    bounds: Vec<(String, [f64; 2])>,
    first: Vec<(String, f64)>,
    starts: u32,
    first_start: u32,
    profiled: Vec<String>,
    advise: bool,
    corrections: u32,
    adapter: Option<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String, Option<Mesh>)> {
    let gpu = device(py, adapter)?;
    let found = LongTask::new(progress).run(py, |progress| {
        let scene = scenes::scene(entries, &folder)?;
        let data = data.iter().map(Experiment::read);
        let data = data.collect::<palpate::Result<Vec<_>>>()?.concat();
        let options = IdentifyOptions {
            unknowns: unknowns(&unknown, &bounds, &first)?,
            noise,
            starts,
            first_start,
            profiled,
            advise,
            corrections,
            earlier: Vec::new(),
        };
        palpate::identify::identify(&gpu, &scene, &data, &options, &mut |_| Ok(()), progress)
    })?;
    let wrong = |e: serde_json::Error| input_error(py, e.to_string());
    Ok((
        serde_json::to_string(&found).map_err(wrong)?,
        serde_json::to_string(&found.residuals).map_err(wrong)?,
        found.mesh_with_field().cloned().map(Mesh::from),
    ))
}

/// Returns the unknowns of these names, with bounds and first values.
fn unknowns(
    names: &[String],
    bounds: &[(String, [f64; 2])],
    first: &[(String, f64)],
) -> palpate::Result<Vec<Unknown>> {
    let parsed = names.iter().map(|name| Unknown::parse(name));
    let mut all = parsed.collect::<palpate::Result<Vec<_>>>()?.concat();
    let named = |all: &[Unknown], name: &str| {
        let found = all.iter().position(|unknown| unknown.name == name);
        found.ok_or_else(|| {
            Error::Input(format!(
                "\"{name}\" is no unknown; add it, or remove its bounds and first value"
            ))
        })
    };
    for (name, ends) in bounds {
        let k = named(&all, name)?;
        all[k].bounds = Some(*ends);
    }
    for (name, value) in first {
        let k = named(&all, name)?;
        all[k].first = Some(*value);
    }
    Ok(all)
}
