//! Presses, which indent a body with a fingertip and release it, and stiffness maps made of them.

use crate::arrays::from_points;
use crate::devices::device;
use crate::errors::{Raise, input_error};
use crate::mesh::Mesh;
use crate::scenes;
use crate::work::LongTask;
use glam::{DVec2, DVec3};
use numpy::{IntoPyArray, PyArray1, PyArray2};
use palpate::Error;
use palpate::gpu::Gpu;
use palpate::press::{MapOptions, MapPoint, PointResult, PressOptions};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Bytes of a picture, RGBA, and its width and height.
type Pixels<'py> = (Bound<'py, PyArray1<u8>>, [u32; 2]);

/// A press, simulated step by step.
#[pyclass(frozen, module = "palpate._palpate")]
pub struct Press(Mutex<palpate::press::Press>);

impl Press {
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut palpate::press::Press) -> palpate::Result<T> + Send,
    ) -> PyResult<T> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        py.detach(|| work(&mut lock())).or_raise(py)
    }
}

#[pymethods]
impl Press {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        entries: &str,
        folder: PathBuf,
        at: Option<[f64; 3]>,
        pick: Option<[f64; 2]>,
        radius: Option<f64>,
        depth: Option<f64>,
        force: Option<f64>,
        adapter: Option<String>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Press> {
        let gpu = device(py, adapter)?;
        let wanted = PressOptions {
            at: at.map(DVec3::from),
            pick: pick.map(DVec2::from),
            radius,
            depth,
            force,
        };
        let press = LongTask::new(progress).run(py, |progress| {
            let scene = scenes::scene(entries, &folder)?;
            match scene.accuracy.within {
                Some(_) => {
                    let wanted = (&scene, &wanted);
                    palpate::press::Press::refined(&gpu, wanted, &mut |_, _| Ok(()), progress)
                }
                None => palpate::press::Press::new(&gpu, &scene, &wanted),
            }
        });
        Ok(Press(Mutex::new(press?)))
    }

    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |press| Ok(press.notes().to_vec()))
    }

    /// Returns the press point, the outward normal there, the thickness of the body there, and the
    /// radius.
    fn spot(&self, py: Python<'_>) -> PyResult<([f64; 3], [f64; 3], f64, f64)> {
        self.with(py, |press| {
            let spot = press.site();
            let (point, out) = (spot.point.to_array(), spot.outward.to_array());
            Ok((point, out, spot.thickness, press.radius()))
        })
    }

    fn steps(&self, py: Python<'_>) -> PyResult<u32> {
        self.with(py, |press| Ok(press.steps()))
    }

    /// Clips the images that follow at the press, to show the interior.
    fn cut_through(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |press| press.clip_at_press())
    }

    /// Does one step. Returns time, phase, depth and force; none after the last step.
    fn advance(&self, py: Python<'_>) -> PyResult<Option<(f64, &'static str, f64, f64)>> {
        self.with(py, |press| {
            let sample = press.advance()?;
            Ok(sample.map(|s| (s.time_s, s.phase, s.depth_m, s.force_n)))
        })
    }

    fn is_deepest(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |press| Ok(press.at_max_depth()))
    }

    fn falls_short(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |press| Ok(press.force_not_reached()))
    }

    /// Estimates the errors of the measured numbers, for the report. Ctrl-C cancels it.
    fn estimate_error(&self, py: Python<'_>, progress: Option<Py<PyAny>>) -> PyResult<()> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        LongTask::new(progress).run(py, |progress| lock().estimate_error(progress))
    }

    /// Returns the error of the force of each sample, N; none without an estimate.
    fn force_errors(&self, py: Python<'_>) -> PyResult<Option<Vec<f64>>> {
        self.with(py, |press| {
            let errors = press.samples().iter().map(|s| press.force_error(s));
            Ok(errors.collect())
        })
    }

    fn report(&self, py: Python<'_>, seconds: f64) -> PyResult<String> {
        let report = self.with(py, |press| Ok(press.report(seconds)))?;
        serde_json::to_string(&report).map_err(|e| input_error(py, e.to_string()))
    }

    fn rgba<'py>(&self, py: Python<'py>) -> PyResult<Pixels<'py>> {
        let (bytes, size) = self.with(py, |press| {
            Ok((press.stage().rgba()?, press.stage().size()))
        })?;
        Ok((bytes.into_pyarray(py), size))
    }

    /// Keeps the present state for `deepest_picture`, with isolines of a field.
    fn keep_picture(&self, py: Python<'_>, show: Option<&str>) -> PyResult<()> {
        self.with(py, |press| {
            press.keep_picture(show.map(palpate::press::PressPicture::field).transpose()?)
        })
    }

    /// Returns the picture of the press at the largest depth, cut through the fingertip.
    fn deepest_picture<'py>(&self, py: Python<'py>) -> PyResult<Pixels<'py>> {
        let (bytes, size) = self.with(py, |press| {
            let (size, background) = (press.stage().size(), press.stage().picture_background());
            Ok((press.deepest_picture(size)?.rgba8(background), size))
        })?;
        Ok((bytes.into_pyarray(py), size))
    }

    fn has_error(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |press| Ok(press.has_error()))
    }

    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        self.with(py, |press| Ok(press.stage().deformed_mesh()?.into()))
    }
}

/// A stiffness map.
#[pyclass(frozen, module = "palpate._palpate")]
pub struct PressMap {
    map: Mutex<palpate::press::PressMap>,
    /// The results so far, readable while the map is measured.
    found: Mutex<Vec<Found>>,
    gpu: Gpu,
}

/// Stiffness of a point and its error, N/m: none if not pressed yet; NaN if a step failed, or if the
/// error is not known.
type Found = Option<(f64, f64)>;

/// Returns the result of each point.
fn found(map: &palpate::press::PressMap) -> Vec<Found> {
    let of = |p: &MapPoint| {
        p.pressed.map(|pressed| match pressed {
            PointResult::Stiffness { n_per_m, error } => (n_per_m, error.unwrap_or(f64::NAN)),
            PointResult::Failed => (f64::NAN, f64::NAN),
        })
    };
    map.points().iter().map(of).collect()
}

impl PressMap {
    fn found_so_far(&self) -> MutexGuard<'_, Vec<Found>> {
        self.found.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut palpate::press::PressMap) -> palpate::Result<T> + Send,
    ) -> PyResult<T> {
        let lock = || self.map.lock().unwrap_or_else(PoisonError::into_inner);
        py.detach(|| work(&mut lock())).or_raise(py)
    }
}

#[pymethods]
impl PressMap {
    #[new]
    fn new(
        py: Python<'_>,
        entries: &str,
        folder: PathBuf,
        points: [u32; 2],
        area: (Option<[f64; 3]>, Option<f64>),
        radius_and_depth: (Option<f64>, Option<f64>),
        adapter: Option<String>,
    ) -> PyResult<PressMap> {
        let gpu = device(py, adapter)?;
        let ((at, side), (radius, depth)) = (area, radius_and_depth);
        let wanted = MapOptions {
            points,
            at: at.map(Into::into),
            side,
            radius,
            depth,
        };
        let map = py.detach(|| {
            let scene = scenes::scene(entries, &folder)?;
            palpate::press::PressMap::new(&scene, &wanted)
        });
        let map = map.or_raise(py)?;
        Ok(PressMap {
            found: Mutex::new(found(&map)),
            map: Mutex::new(map),
            gpu,
        })
    }

    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |map| Ok(map.notes().to_vec()))
    }

    /// Returns a fingerprint of the body, the scene and the press settings.
    fn mark(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |map| Ok(format!("{:016x}", map.fingerprint())))
    }

    fn places<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let places: Vec<DVec3> =
            self.with(py, |map| Ok(map.points().iter().map(|p| p.point).collect()))?;
        Ok(from_points(py, &places))
    }

    /// Returns the stiffness of each point and its error, N/m: none if not pressed yet; NaN if a step
    /// failed, or if the error is not known.
    fn found(&self) -> Vec<Found> {
        self.found_so_far().clone()
    }

    /// Restores earlier results.
    fn take_over(&self, py: Python<'_>, found: Vec<Found>) -> PyResult<()> {
        let result = |(n_per_m, error): (f64, f64)| match n_per_m.is_nan() {
            true => PointResult::Failed,
            false => PointResult::Stiffness {
                n_per_m,
                error: (!error.is_nan()).then_some(error),
            },
        };
        let found: Vec<Option<PointResult>> =
            found.into_iter().map(|found| found.map(result)).collect();
        self.with(py, |map| {
            map.restore(&found)?;
            *self.found_so_far() = self::found(map);
            Ok(())
        })
    }

    /// Presses the remaining points.
    fn measure(&self, py: Python<'_>, progress: Option<Py<PyAny>>) -> PyResult<()> {
        let long = LongTask::new(progress);
        let measured = self.with(py, |map| {
            map.measure(&self.gpu, &mut |map| {
                let found = self::found(map);
                let done = found.iter().flatten().count() as f64 / found.len() as f64;
                *self.found_so_far() = found;
                match long.should_continue("pressing", done) {
                    true => Ok(()),
                    false => Err(Error::Input("ended".into())),
                }
            })
        });
        match long.interrupt_error() {
            Some(why) => Err(why),
            None => measured,
        }
    }

    fn rgba<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyArray1<u8>>, [u32; 2])> {
        let image = self.with(py, |map| map.image(&self.gpu))?;
        let size = image.size;
        let bytes = image.rgba8(palpate::render::Background::Black);
        Ok((bytes.into_pyarray(py), size))
    }
}
