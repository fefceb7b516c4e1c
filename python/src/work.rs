//! Long operations: they detach from the interpreter so that other Python threads continue, report
//! progress, and stop on Ctrl-C.

use crate::arrays::to_points;
use crate::devices::device;
use crate::errors::{Raise, input_error, to_py_err};
use crate::mesh::Mesh;
use crate::volume::Volume;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use palpate::mesh::TetMesh;
use palpate::scene::Scene;
use palpate::study::{Run, STUDIES};
use palpate::tune::TuneTarget;
use palpate::warp::{Warp, WarpOptions};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Interval between checks for Python signals.
const INTERVAL: Duration = Duration::from_millis(50);
/// Metres in a millimetre, the unit of scans.
const MILLIMETRE: f64 = 1e-3;

/// A long operation and its progress callback.
pub struct LongTask {
    progress: Option<Py<PyAny>>,
    /// When progress was last reported; `None` before the first time.
    looked: Mutex<Option<Instant>>,
    /// Why it has to stop: Ctrl-C, or an exception raised by `progress`.
    ended: Mutex<Option<PyErr>>,
}

impl LongTask {
    pub fn new(progress: Option<Py<PyAny>>) -> LongTask {
        LongTask {
            progress,
            looked: Mutex::new(None),
            ended: Mutex::new(None),
        }
    }

    /// Checks for Python signals and reports the completed fraction. Returns whether to continue.
    pub fn should_continue(&self, what: &str, done: f64) -> bool {
        let mut looked = self.looked.lock().unwrap_or_else(PoisonError::into_inner);
        if looked.is_some_and(|at| at.elapsed() < INTERVAL) && done < 1.0 {
            return true;
        }
        *looked = Some(Instant::now());
        drop(looked);
        let result = Python::attach(|py| {
            py.check_signals()?;
            match &self.progress {
                Some(progress) => progress.call1(py, (what, done)).map(|_| ()),
                None => Ok(()),
            }
        });
        match result {
            Ok(()) => true,
            Err(why) => {
                let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
                ended.get_or_insert(why);
                false
            }
        }
    }

    /// Returns the exception that interrupted it, if any.
    pub fn interrupt_error(&self) -> Option<PyErr> {
        let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        ended.take()
    }

    /// Runs `work` detached from the interpreter. Its progress reports stop it on an interrupt.
    pub fn run<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(palpate::ProgressFn) -> palpate::Result<T> + Send,
    ) -> PyResult<T> {
        let tell = |what: &str, done: f64| match self.should_continue(what, done) {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        };
        let done = py.detach(|| work(&tell));
        match self.interrupt_error() {
            Some(why) => Err(why),
            None => done.or_raise(py),
        }
    }
}

/// Returns width, height and bytes of an RGBA image, row by row from the top.
fn picture(py: Python<'_>, pixels: &PyReadonlyArray3<'_, u8>) -> PyResult<(u32, u32, Vec<u8>)> {
    let pixels = pixels.as_array();
    let (height, width, channels) = pixels.dim();
    let sides = [width, height].map(u32::try_from);
    let ([Ok(width), Ok(height)], 4) = (sides, channels) else {
        return Err(input_error(
            py,
            format!(
                "a picture must have shape (height, width, 4), got {:?}",
                pixels.shape()
            ),
        ));
    };
    Ok((width, height, pixels.iter().copied().collect()))
}

/// Writes an image as a PNG.
#[pyfunction]
pub fn write_png(py: Python<'_>, path: PathBuf, pixels: PyReadonlyArray3<'_, u8>) -> PyResult<()> {
    let (width, height, bytes) = picture(py, &pixels)?;
    let written = palpate::io::atomic_write(&path, |file| {
        let encoder = PngEncoder::new(file);
        let done = encoder.write_image(&bytes, width, height, ExtendedColorType::Rgba8);
        done.map_err(|e| palpate::Error::format(&path, format!("cannot be encoded: {e}")))
    });
    written.or_raise(py)
}

/// Encodes an image over black as JPEG; `quality` is from 1 to 100.
#[pyfunction]
pub fn jpeg<'py>(
    py: Python<'py>,
    pixels: PyReadonlyArray3<'_, u8>,
    quality: u8,
) -> PyResult<Bound<'py, PyBytes>> {
    let (width, height, bytes) = picture(py, &pixels)?;
    let encoded = py.detach(|| {
        let over = |p: &[u8], c: usize| (u32::from(p[c]) * u32::from(p[3]) / 255) as u8;
        let rgb = bytes
            .chunks_exact(4)
            .flat_map(|p| [0, 1, 2].map(|c| over(p, c)));
        let rgb: Vec<u8> = rgb.collect();
        let mut file = Vec::new();
        JpegEncoder::new_with_quality(&mut file, quality.clamp(1, 100))
            .write_image(&rgb, width, height, ExtendedColorType::Rgb8)
            .map(|()| file)
    });
    let encoded =
        encoded.map_err(|e| input_error(py, format!("cannot encode the picture: {e}")))?;
    Ok(PyBytes::new(py, &encoded))
}

/// Warps a scan into the deformed body. Returns the result and the counts of all voxels and of
/// those outside every tet.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn warp(
    py: Python<'_>,
    scan: &Volume,
    rest: &Mesh,
    bent: PyReadonlyArray2<'_, f64>,
    labels: bool,
    background: Option<f64>,
    like: Option<&Volume>,
) -> PyResult<(Volume, usize, usize)> {
    let mut bent = to_points(py, &bent, "bent")?;
    let mut mesh = TetMesh::clone(&rest.0);
    let scale = mesh.length_unit.map_or(1.0, |metres| metres / MILLIMETRE);
    for p in mesh.nodes.iter_mut().chain(&mut bent) {
        *p *= scale;
    }
    let options = WarpOptions { labels, background };
    let image = py.detach(|| {
        let grid = like.unwrap_or(scan).0.grid();
        Warp::new(&mesh, &bent)?.image(&scan.0, &grid, &options)
    });
    let image = image.or_raise(py)?;
    let coverage = image.coverage;
    let volume = Volume(image.volume.into());
    Ok((volume, coverage.voxels, coverage.uncovered))
}

/// Tunes a scene file and writes the chosen settings, and a refined mesh beside them. Returns whether they meet the requirements, a
/// description, and the milliseconds per simulated second and per image.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn tune(
    py: Python<'_>,
    scene: PathBuf,
    out: PathBuf,
    error: f64,
    fps: Option<f64>,
    seconds: f64,
    adapter: Option<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(bool, Vec<String>, [f64; 2])> {
    let gpu = device(py, adapter)?;
    let wanted = TuneTarget {
        error,
        fps,
        seconds,
    };
    let tuned = LongTask::new(progress).run(py, |on_progress| {
        let own = Scene::read(&scene)?;
        let files = (scene.as_path(), out.as_path());
        palpate::tune::tune_file(&gpu, &own, &wanted, files, &mut |_| {}, on_progress)
    })?;
    Ok((tuned.target_met, tuned.notes, tuned.cost))
}

/// Runs a study and returns its notes. Points measured before an interruption are kept.
#[pyfunction]
pub fn study(
    py: Python<'_>,
    what: &str,
    scene: Option<PathBuf>,
    out: PathBuf,
    quick: bool,
    adapter: Option<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<String>> {
    let Some((_, _, study)) = STUDIES.iter().find(|(name, ..)| *name == what) else {
        let names = studies().join(", ");
        return Err(input_error(
            py,
            format!("unknown study \"{what}\"; available: {names}"),
        ));
    };
    let gpu = device(py, adapter)?;
    std::fs::create_dir_all(&out).map_err(|e| to_py_err(py, palpate::Error::io(&out)(e)))?;
    let long = LongTask::new(progress);
    let stop = AtomicBool::new(false);
    let notes = Mutex::new(Vec::new());
    let done = py.detach(|| {
        let on_progress = |what: &str, done: f64| {
            if !long.should_continue(what, done) {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let note = |text: &str| {
            let mut notes = notes.lock().unwrap_or_else(PoisonError::into_inner);
            notes.push(text.to_owned());
        };
        let run = Run {
            gpu: &gpu,
            dir: &out,
            quick,
            progress: &on_progress,
            note: &note,
            stop: &stop,
        };
        study(&run, scene.as_deref())
    });
    match long.interrupt_error() {
        Some(why) => Err(why),
        None => done.or_raise(py),
    }?;
    Ok(notes.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Returns the names of the studies.
#[pyfunction]
pub fn studies() -> Vec<&'static str> {
    STUDIES.iter().map(|(name, ..)| *name).collect()
}
