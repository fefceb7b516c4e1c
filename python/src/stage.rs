//! A scene that is ready for simulation and rendering.

use crate::arrays::{from_points, to_points};
use crate::body::{Body, Exerted, Picked, PressCurve, View, motion, simulator};
use crate::devices::device;
use crate::errors::{Raise, input_error};
use crate::mesh::Mesh;
use crate::scenes;
use crate::work::LongTask;
use glam::{DVec2, DVec3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2};
use palpate::annotate::FrameTime;
use palpate::mesh::{Blade, TetMesh};
use palpate::physics::{BodyField, Capability, GrabId, GrabMode};
use palpate::press::{InteractiveStage, PressSession};
use palpate::render::{Camera, Projection};
use palpate::scene::FieldRanges;
use palpate::{Error, Result};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Target duration of a group of steps; Python signals are handled between groups.
const GROUP: Duration = Duration::from_millis(50);
/// Maximum number of steps in a group.
const MAX_STEPS_PER_GROUP: u32 = 64;

/// A scene that is ready for simulation and rendering, used by one thread at a time.
#[pyclass(frozen, module = "palpate._palpate")]
pub struct Stage(Mutex<Body>);

impl Stage {
    /// Runs `work` on the stage with the Python thread state detached, so that other Python threads
    /// continue.
    pub fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut palpate::scene::Stage) -> Result<T> + Send,
    ) -> PyResult<T> {
        py.detach(|| work(&mut self.lock().stage)).or_raise(py)
    }

    /// As [`Stage::with`], with the fingertip.
    fn with_fingertip<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut palpate::scene::Stage, &mut PressSession) -> Result<T> + Send,
    ) -> PyResult<T> {
        let done = py.detach(|| {
            let Body { stage, fingertip } = &mut *self.lock();
            let none = || Error::Input("this body cannot be pressed on".into());
            work(stage, fingertip.as_mut().ok_or_else(none)?)
        });
        done.or_raise(py)
    }

    pub fn lock(&self) -> MutexGuard<'_, Body> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Identifier of a grab.
#[pyclass(frozen, module = "palpate._palpate")]
pub struct Grab(GrabId);

#[pymethods]
impl Stage {
    /// Creates the stage of the scene of these entries, optionally with a mesh instead of the
    /// scene's own.
    #[new]
    fn new(
        py: Python<'_>,
        entries: &str,
        folder: PathBuf,
        mesh: Option<&Mesh>,
        adapter: Option<String>,
    ) -> PyResult<Stage> {
        let gpu = device(py, adapter)?;
        let stage = LongTask::new(None).run(py, |progress| {
            let scene = scenes::scene_to_draw(entries, &folder)?;
            match mesh {
                Some(mesh) => palpate::scene::Stage::with_mesh(&gpu, &scene, (*mesh.0).clone()),
                None => scenes::stage(&gpu, &scene, progress),
            }
        });
        Ok(Stage(Mutex::new(Body {
            stage: stage?,
            fingertip: None,
        })))
    }

    /// Creates the stage of a scene whose body is pressed on interactively, and returns it with the
    /// reason why it cannot be, if so. Scenes of several bodies and grids need no mesh.
    #[staticmethod]
    fn interactive(
        py: Python<'_>,
        entries: &str,
        folder: PathBuf,
        mesh: Option<&Mesh>,
        adapter: Option<String>,
    ) -> PyResult<(Stage, Option<String>)> {
        let gpu = device(py, adapter)?;
        let none = TetMesh::default();
        let mesh = mesh.map_or(&none, |mesh| &*mesh.0);
        let made = py.detach(|| {
            let scene = scenes::scene_to_draw(entries, &folder)?;
            InteractiveStage::new(&gpu, &scene, mesh, None)
        });
        let InteractiveStage {
            stage, fingertip, ..
        } = made.or_raise(py)?;
        let (fingertip, why) = match fingertip {
            Ok(session) => (Some(session), None),
            Err(why) => (None, Some(why)),
        };
        Ok((Stage(Mutex::new(Body { stage, fingertip })), why))
    }

    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |stage| Ok(stage.notes().to_vec()))
    }

    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        self.with(py, |stage| Ok(stage.mesh().clone().into()))
    }

    fn deformed_mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        self.with(py, |stage| Ok(stage.deformed_mesh()?.into()))
    }

    /// Returns the name and range of the rendered scalar field.
    fn shown(&self, py: Python<'_>) -> PyResult<(String, (f64, f64))> {
        self.with(py, |stage| {
            let field = stage.scalar_field();
            Ok((field.name.clone(), field.range))
        })
    }

    fn steps(&self, py: Python<'_>) -> PyResult<u32> {
        self.with(py, |stage| Ok(stage.steps()))
    }

    /// Returns the simulated time and the time step, s; the step is none for a static body.
    fn time(&self, py: Python<'_>) -> PyResult<(f64, Option<f64>)> {
        self.with(py, |stage| {
            let dt = stage.motion().map(|motion| motion.dt);
            Ok((stage.time(), dt))
        })
    }

    /// Returns the names of the engine and of the solver.
    fn engine(&self, py: Python<'_>) -> PyResult<(String, String)> {
        self.with(py, |stage| {
            let motion = motion(stage)?;
            Ok((motion.engine().to_string(), motion.kind().to_string()))
        })
    }

    /// Does `steps` steps, unless Python interrupts them.
    fn run(&self, py: Python<'_>, steps: u32, progress: Option<Py<PyAny>>) -> PyResult<()> {
        let long = LongTask::new(progress);
        let (mut done, mut group) = (0, 1);
        while done < steps {
            let some = group.min(steps - done);
            let start = Instant::now();
            self.with(py, |stage| stage.run(some, &mut |_| {}))?;
            done += some;
            group = match start.elapsed() < GROUP {
                true => (2 * group).min(MAX_STEPS_PER_GROUP),
                false => (group / 2).max(1),
            };
            // The stage is unlocked here: the progress callback may use it.
            if !long.should_continue("steps", f64::from(done) / f64::from(steps)) {
                return long.interrupt_error().map_or(Ok(()), Err);
            }
        }
        Ok(())
    }

    /// Fits the view to the body and to the points `also`, unless the scene sets a view.
    fn frame(&self, py: Python<'_>, also: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let also = to_points(py, &also, "also")?;
        self.with(py, |stage| stage.fit_view(&also))
    }

    /// Sets the time of a recorded frame, s, that pictures display.
    fn set_displayed_time(&self, py: Python<'_>, seconds: f64, resolution: f64) -> PyResult<()> {
        self.with(py, |stage| {
            stage.set_displayed_time(FrameTime {
                seconds,
                resolution,
            });
            Ok(())
        })
    }

    fn camera(&self, py: Python<'_>) -> PyResult<View> {
        self.with(py, |stage| {
            let camera = *stage.camera_mut();
            let [fov, height] = match camera.projection {
                Projection::Perspective { fov } => [Some(fov), None],
                Projection::Orthographic { height } => [None, Some(height)],
            };
            let places = [camera.eye, camera.look_at, camera.up].map(|p| p.to_array());
            Ok((places[0], places[1], places[2], fov, height))
        })
    }

    fn set_camera(&self, py: Python<'_>, view: View) -> PyResult<()> {
        let (eye, look_at, up, fov, height) = view;
        let [eye, look_at, up] = [eye, look_at, up].map(DVec3::from);
        let camera = match (fov, height) {
            (Some(fov), None) => Camera::perspective(eye, look_at, up, fov),
            (None, Some(height)) => Camera::orthographic(eye, look_at, up, height),
            _ => {
                return Err(input_error(
                    py,
                    "a camera must have exactly one of fov and orthographic",
                ));
            }
        };
        camera.check().or_raise(py)?;
        self.with(py, |stage| {
            *stage.camera_mut() = camera;
            Ok(())
        })
    }

    fn size(&self, py: Python<'_>) -> PyResult<[u32; 2]> {
        self.with(py, |stage| Ok(stage.size()))
    }

    fn set_size(&self, py: Python<'_>, size: [u32; 2]) -> PyResult<()> {
        if size.contains(&0) || size.iter().any(|n| *n > 16_384) {
            return Err(input_error(
                py,
                format!(
                    "the picture size must be 1 to 16384 pixels per axis, got {} by {}",
                    size[0], size[1]
                ),
            ));
        }
        self.with(py, |stage| {
            stage.set_size(size);
            Ok(())
        })
    }

    fn set_looks(&self, py: Python<'_>, entries: &str, folder: PathBuf) -> PyResult<Vec<String>> {
        self.with(py, |stage| {
            stage.set_appearance(&scenes::scene_to_draw(entries, &folder)?)
        })
    }

    /// Returns the image as 8-bit RGBA, as in a PNG; on demand without light paths.
    #[pyo3(signature = (local_light=false))]
    fn rgba<'py>(&self, py: Python<'py>, local_light: bool) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let bytes = self.with(py, |stage| match local_light {
            true => stage.rgba_in_local_light(),
            false => stage.rgba(),
        })?;
        Ok(bytes.into_pyarray(py))
    }

    /// Adds samples to the image by light paths, or begins a fresh one; none if it has them all.
    fn refine_paths<'py>(
        &self,
        py: Python<'py>,
        more: u32,
        fresh: bool,
    ) -> PyResult<Option<Bound<'py, PyArray1<u8>>>> {
        let bytes = self.with(py, |stage| stage.refine_paths(more, fresh))?;
        Ok(bytes.map(|bytes| bytes.into_pyarray(py)))
    }

    /// Returns the image as 32-bit floats, as in an EXR, and the number of channels.
    fn raw<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyArray1<f32>>, usize)> {
        let image = self.with(py, |stage| stage.image())?;
        Ok((image.values.into_pyarray(py), image.channels))
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.with(py, |stage| stage.save(&path))
    }

    fn pose(&self, py: Python<'_>, positions: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let positions = to_points(py, &positions, "positions")?;
        self.with(py, |stage| stage.set_positions(&positions))
    }

    /// Shows a frame of a series: its own nodes, fields and tets.
    fn show(&self, py: Python<'_>, mesh: PyRef<'_, Mesh>) -> PyResult<()> {
        let mesh = mesh.0.clone();
        self.with(py, |stage| {
            stage.show_mesh(TetMesh::clone(&mesh)).map(|_| ())
        })
    }

    /// Displays the field in its range over a series, unless the scene sets one.
    fn use_ranges(&self, py: Python<'_>, ranges: BTreeMap<String, (f64, f64)>) -> PyResult<()> {
        let mut all = FieldRanges::default();
        for (name, range) in &ranges {
            all.extend(name, *range);
        }
        self.with(py, |stage| stage.use_series_range(&all))
    }

    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = self.with(py, |stage| match stage.motion() {
            Some(motion) => motion.positions(),
            None => stage.drawn_positions(),
        })?;
        Ok(from_points(py, &points))
    }

    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = self.with(py, |stage| simulator(stage)?.velocities())?;
        Ok(from_points(py, &points))
    }

    fn set_velocities(
        &self,
        py: Python<'_>,
        velocities: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<()> {
        let velocities = to_points(py, &velocities, "velocities")?;
        self.with(py, |stage| simulator(stage)?.set_velocities(&velocities))
    }

    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = self.with(py, |stage| {
            let forces = simulator(stage)?.reactions();
            Capability::NodalForces.require(forces)?.nodal_forces()
        })?;
        Ok(from_points(py, &points))
    }

    fn set_forces(&self, py: Python<'_>, forces: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let forces = to_points(py, &forces, "forces")?;
        self.with(py, |stage| simulator(stage)?.set_forces(&forces))
    }

    fn masses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let masses = self.with(py, |stage| Ok(simulator(stage)?.masses().to_vec()))?;
        Ok(masses.into_pyarray(py))
    }

    fn set_gravity(&self, py: Python<'_>, gravity: [f64; 3]) -> PyResult<()> {
        self.with(py, |stage| {
            simulator(stage)?.loads_mut().set_gravity(gravity.into());
            Ok(())
        })
    }

    fn restart(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |stage| simulator(stage)?.restart())
    }

    fn pin(&self, py: Python<'_>, nodes: Vec<u32>) -> PyResult<()> {
        self.with(py, |stage| simulator(stage)?.pin_nodes(&nodes))
    }

    /// Computes a derived field of the deformed body, per tet or per node.
    fn field<'py>(
        &self,
        py: Python<'py>,
        name: &str,
        at_nodes: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let Some(field) = BodyField::ALL.into_iter().find(|f| f.name() == name) else {
            let names = BodyField::ALL.map(BodyField::name).join(", ");
            return Err(input_error(
                py,
                format!("unknown computed field \"{name}\"; available: {names}"),
            ));
        };
        let values = self.with(py, |stage| {
            let body = simulator(stage)?;
            field.check(body)?;
            match at_nodes {
                true => field.per_node(body),
                false => field.per_tet(body),
            }
        })?;
        Ok(values.into_pyarray(py))
    }

    /// Grabs the nodes around a point; with a spring and its maximum force they are pulled by the
    /// spring.
    fn grab(
        &self,
        py: Python<'_>,
        centre: [f64; 3],
        radius: f64,
        spring: Option<(f64, f64)>,
    ) -> PyResult<Grab> {
        let grip = match spring {
            None => GrabMode::Follow,
            Some((stiffness, limit)) => GrabMode::Spring { stiffness, limit },
        };
        self.with(py, |stage| {
            let id = simulator(stage)?.grab(centre.into(), radius, grip)?;
            Ok(Grab(id))
        })
    }

    fn set_target(&self, py: Python<'_>, grab: &Grab, target: [f64; 3]) -> PyResult<()> {
        self.with(py, |stage| {
            simulator(stage)?.set_target(grab.0, target.into())
        })
    }

    fn release(&self, py: Python<'_>, grab: &Grab) -> PyResult<usize> {
        self.with(py, |stage| simulator(stage)?.release(grab.0))
    }

    /// Places the fingertip on the body at the boundary point nearest to `point`; returns its
    /// radius.
    fn touch(&self, py: Python<'_>, point: [f64; 3]) -> PyResult<f64> {
        self.with_fingertip(py, |stage, fingertip| {
            fingertip.touch(stage, point.into())?;
            Ok(fingertip.radius())
        })
    }

    /// Takes one step towards `depth` with the fingertip. Returns the depth that it reached, and
    /// whether the step succeeded.
    fn press_towards(&self, py: Python<'_>, depth: f64, withdraws: bool) -> PyResult<(f64, bool)> {
        self.with_fingertip(py, |stage, fingertip| {
            let phase = if withdraws { "unload" } else { "load" };
            let done = fingertip.step_towards(motion(stage)?, depth, phase)?;
            Ok((fingertip.depth().unwrap_or(depth), done))
        })
    }

    /// Takes the fingertip away.
    fn park(&self, py: Python<'_>) -> PyResult<()> {
        self.with_fingertip(py, |stage, fingertip| fingertip.park(motion(stage)?))
    }

    /// Returns the radius of the fingertip, and the time that passed in quasi-static steps; none if
    /// the body cannot be pressed on.
    fn fingertip(&self, py: Python<'_>) -> Option<(f64, f64)> {
        py.detach(|| {
            let body = self.lock();
            let fingertip = body.fingertip.as_ref()?;
            Some((fingertip.radius(), fingertip.static_time()))
        })
    }

    /// Returns time, depth and force of each step of the last press, and why the last force has no
    /// meaning, if so.
    fn press_curve(&self, py: Python<'_>) -> PyResult<PressCurve> {
        self.with_fingertip(py, |_, fingertip| {
            let curve = fingertip.samples().iter();
            let curve = curve.map(|s| (s.time_s, s.depth_m, s.force_n)).collect();
            Ok((curve, fingertip.problem()))
        })
    }

    /// Returns the transfer function of the images as JSON, in absolute scalars, with extinctions
    /// multiplied by `denser`.
    fn transfer(&self, py: Python<'_>, denser: f64) -> PyResult<String> {
        let transfer = self.with(py, |stage| Ok(stage.transfer()))?;
        let nodes = transfer.extinction_nodes().iter();
        let extinction: Vec<[f64; 2]> = nodes.map(|[s, e]| [*s, denser * e]).collect();
        let colour = transfer.colour_nodes();
        Ok(serde_json::json!({"colour": colour, "extinction": extinction}).to_string())
    }

    /// Cuts along the surface that a straight edge sweeps. Returns whether anything was cut.
    fn cut(&self, py: Python<'_>, edges: Vec<[[f64; 3]; 2]>) -> PyResult<bool> {
        let edges: Vec<[DVec3; 2]> = edges.iter().map(|e| e.map(DVec3::from)).collect();
        self.with(py, |stage| stage.cut(&Blade::from_sweep(&edges)?))
    }

    /// Picks the boundary at a pixel: node, tet, face, point and distance.
    fn pick(&self, py: Python<'_>, x: f64, y: f64) -> PyResult<Option<Picked>> {
        let pick = self.with(py, |stage| stage.pick(DVec2::new(x, y)))?;
        Ok(pick.map(|p| (p.node, p.tet, p.face, p.point.to_array(), p.distance)))
    }

    /// Returns energies and shape quantities as JSON.
    fn report(&self, py: Python<'_>) -> PyResult<String> {
        let report = self.with(py, |stage| motion(stage)?.report())?;
        serde_json::to_string(&report).map_err(|e| input_error(py, e.to_string()))
    }

    /// Returns the reactions on pins, moves, grabs and tools: name, force and moment.
    fn reactions(&self, py: Python<'_>) -> PyResult<Vec<Exerted>> {
        let all = self.with(py, |stage| stage.reactions())?;
        let convert = |(name, on): (String, palpate::physics::Reaction)| {
            (name, on.force.to_array(), on.moment.to_array())
        };
        Ok(all.into_iter().map(convert).collect())
    }
}
