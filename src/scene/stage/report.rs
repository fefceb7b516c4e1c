//! Costs and results of a picture and a step: the content of `--report`.

use super::{Motion, Stage};
use crate::Result;
use crate::cage::CageReport;
use crate::gpu::{Gpu, Shaders};
use crate::physics::{Energy, Engine, MemberReport, Reaction, Report};
use serde::Serialize;
use std::collections::BTreeMap;
use web_time::Instant;

/// Report of `palpate render --report`; its JSON keys are the names of the fields.
#[derive(Clone, Debug, Serialize)]
pub struct StageReport {
    /// The graphics adapter.
    pub adapter: String,
    /// Engine of the steps, `gpu` or `cpu`; `None` for a static body.
    pub engine: Option<Engine>,
    /// Reports of the bodies, if the scene has several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<MemberReport>,
    /// Number of tetrahedra.
    pub tets: usize,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of rigid bodies.
    pub rigid_bodies: usize,
    /// Median wall time of a fully redrawn frame, from recording to an idle GPU, ms.
    pub frame_ms: f64,
    /// Number of measured frames.
    pub frames: u32,
    /// Median wall time of a step, ms; `None` for a static body.
    pub step_ms: Option<f64>,
    /// Dispatches of one step on the GPU, by shader; empty for the CPU engine.
    pub step_dispatches: BTreeMap<String, u64>,
    /// Texture loads of each of these shaders: outside its loops, per iteration of an outer loop,
    /// and of a nested loop.
    #[serde(rename = "step_loads")]
    pub step_texture_loads: BTreeMap<String, Vec<u32>>,
    /// GPU time of each pass in one frame (and step), ms; empty if the adapter has no timestamps.
    pub passes: BTreeMap<String, f64>,
    /// Number of rays that hit the mesh.
    pub rays: u64,
    /// Number of rays that were not traced to their end: see
    /// [`RaycastReport`](crate::render::RaycastReport).
    pub lost_rays: u64,
    /// Mean number of tetrahedra per ray.
    pub tets_per_ray: f64,
    /// Largest number of entries of a ray into the mesh.
    pub peel_layers: u32,
    /// Number of read-backs between a step and its picture.
    pub readbacks: u64,
    /// Conjugate gradients in the last step; `None` for other solvers.
    pub cg: Option<CgReport>,
    /// Energies, J; `None` for a static body.
    pub energy: Option<Energy>,
    /// Reactions of the body on each tool in contact with it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tools: Vec<ToolReport>,
    /// Ratio of the current volume to that at rest.
    pub volume_ratio: f64,
    /// Largest nodal displacement, in file units.
    pub max_displacement: f64,
    /// Diagonal of the bounding box at rest, in file units, as a reference length.
    pub diagonal: f64,
    /// Root mean square and maximum of the distances between the boundary at rest and that of the scan
    /// or surface that it was meshed from, in file units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_distance: Option<[f64; 2]>,
    /// Number of inverted tetrahedra.
    pub inverted: u64,
    /// Simulated time, s.
    pub time: f64,
    /// The cage in which the mesh is embedded, if any.
    pub cage: Option<CageReport>,
    /// Whether the body is at rest and sleeps.
    pub asleep: bool,
    /// Number of steps skipped while it slept.
    #[serde(rename = "steps_slept")]
    pub steps_skipped: u64,
    /// Number of pictures drawn before the measurement.
    pub pictures_drawn: u64,
    /// Number of pictures reused because nothing had changed.
    #[serde(rename = "pictures_kept")]
    pub frames_reused: u64,
    /// Number of times that each pass was recorded on the device before the measurement, by its
    /// shader: `render/refresh_geometry` computes normals and gradients, `render/table_slice` or
    /// `render/table_volume` a table, `skin/node_normals` and `render/surface_normals` normals for
    /// lighting, `cage/embedding` the nodes in a cage.
    pub passes_recorded: BTreeMap<String, u64>,
}

/// Conjugate gradients in one step.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CgReport {
    /// Iterations.
    pub iterations: u32,
    /// Relative residual.
    pub residual: f64,
}

/// Reaction of a body on a tool.
#[derive(Clone, Debug, Serialize)]
pub struct ToolReport {
    /// The tool's name.
    pub name: String,
    /// Force, N.
    pub force: [f64; 3],
    /// Moment about the tool's centre, or for a dynamic tool about its centre of mass, N·m.
    pub moment: [f64; 3],
}

impl Stage {
    /// Returns the reaction of the body on each tool in the current state.
    ///
    /// # Errors
    /// As [`Contact::tool_forces`](crate::physics::Contact::tool_forces).
    fn tool_reports(&mut self) -> Result<Vec<ToolReport>> {
        let Some(motion) = self.motion_mut() else {
            return Ok(Vec::new());
        };
        let report = |(name, on): (String, Reaction)| ToolReport {
            name,
            force: on.force.to_array(),
            moment: on.moment.to_array(),
        };
        Ok(motion.tool_reactions()?.into_iter().map(report).collect())
    }

    /// Draws `frames` frames after a warm-up, runs as many steps if there is a solver, and reports
    /// the times and results.
    ///
    /// # Errors
    /// As [`Stage::image`] and [`Stage::run`].
    pub fn measure(&mut self, frames: u32) -> Result<StageReport> {
        let frames = frames.max(1);
        self.publish_now()?;
        let passes_recorded = self.gpu.passes_recorded();
        let [pictures_drawn, pictures_kept] = self.pictures;
        let state = self.motion().map(Motion::report).transpose()?;
        let tools = self.tool_reports()?;
        let picture = self
            .looks
            .raycaster
            .report(&self.looks.camera, self.looks.size)?;
        let cg = self.motion().and_then(|m| m.progress()).and_then(|p| {
            (p.last.iterations > 0).then_some(CgReport {
                iterations: p.last.iterations,
                residual: p.last.residual,
            })
        });
        let time = self.time();
        let bounds = self.mesh().bounds();
        let asleep = self.motion().is_some_and(Motion::asleep);
        let steps_slept = self.motion().map_or(0, Motion::steps_slept);
        // A sleeping body must still be stepped for the measurement.
        let sleeps = self.motion().is_some_and(Motion::may_sleep);
        if let Some(motion) = self.motion_mut() {
            motion.set_sleep_allowed(false);
        }
        let before = self.gpu.readbacks();
        let frame_ms = self.frame_ms(frames)?;
        let readbacks = self.gpu.readbacks() - before;
        let passes = self.time_passes()?;
        let step_ms = self.time_steps(frames)?;
        let step_dispatches = self.count_step()?;
        // The device may have been used meanwhile by passes that are not shaders of that name.
        let loads = |name: &String| Some((name.clone(), Shaders::texture_loads(name).ok()?));
        let step_loads = step_dispatches.keys().filter_map(loads).collect();
        if let Some(motion) = self.motion_mut() {
            motion.set_sleep_allowed(sleeps);
        }
        Ok(StageReport {
            adapter: self.gpu.adapter_name(),
            engine: self.motion().map(Motion::engine),
            bodies: self.motion().map_or_else(Vec::new, Motion::bodies),
            tets: self.mesh().tets.len(),
            nodes: self.mesh().nodes.len(),
            rigid_bodies: self.motion().map_or(0, Motion::rigid_bodies),
            frame_ms,
            frames,
            step_ms,
            step_dispatches,
            step_texture_loads: step_loads,
            passes,
            rays: picture.rays,
            lost_rays: picture.lost_rays,
            tets_per_ray: picture.tets_per_ray,
            peel_layers: picture.peel_layers,
            readbacks,
            cg,
            energy: state.map(|s: Report| s.energy),
            tools,
            volume_ratio: state.map_or(1.0, |s| s.volume_ratio),
            max_displacement: state.map_or(0.0, |s| s.max_displacement),
            diagonal: (bounds.1 - bounds.0).length(),
            surface_distance: self.mesh().repairs.surface_distance,
            inverted: picture.inverted.into(),
            time,
            cage: self.motion().and_then(Motion::cage),
            asleep,
            steps_skipped: steps_slept,
            pictures_drawn,
            frames_reused: pictures_kept,
            passes_recorded,
        })
    }

    /// Measures the median wall time of a fully redrawn frame over `frames` frames after a warm-up,
    /// ms.
    ///
    /// # Errors
    /// As [`Stage::record`].
    pub fn frame_ms(&mut self, frames: u32) -> Result<f64> {
        let target = self.target()?;
        let gpu = self.gpu.clone();
        median_ms(frames, || {
            self.record_frame(&target)?;
            gpu.wait()
        })
    }

    /// Measures the GPU time of each pass of a frame and, for a simulated body, of a step, ms.
    fn time_passes(&mut self) -> Result<BTreeMap<String, f64>> {
        let target = self.target()?;
        self.gpu.timings()?;
        self.gpu.time_passes(true);
        let done = self
            .run(1, &mut |_| {})
            .and_then(|()| self.record_frame(&target));
        self.gpu.time_passes(false);
        done?;
        self.gpu.timings()
    }

    /// Counts the dispatches of one step.
    fn count_step(&mut self) -> Result<BTreeMap<String, u64>> {
        let before = self.gpu.passes_recorded();
        self.run(1, &mut |_| {})?;
        let after = self.gpu.passes_recorded().into_iter();
        let more = after.map(|(name, n)| {
            let before = before.get(&name).copied().unwrap_or(0);
            (name, n - before)
        });
        Ok(more.filter(|(_, n)| *n > 0).collect())
    }

    fn time_steps(&mut self, steps: u32) -> Result<Option<f64>> {
        if self.motion().is_none() {
            return Ok(None);
        }
        median_ms(steps, || self.run(1, &mut |_| {})).map(Some)
    }

    fn target(&self) -> Result<wgpu::TextureView> {
        self.gpu.target(
            "measured picture",
            self.looks.size,
            wgpu::TextureFormat::Rgba8Unorm,
            wgpu::TextureUsages::RENDER_ATTACHMENT,
        )
    }

    /// Submits one frame as if everything had changed since the last one.
    fn record_frame(&mut self, target: &wgpu::TextureView) -> Result<()> {
        let gpu: Gpu = self.gpu.clone();
        let mut work = gpu.start_recording();
        self.looks.raycaster.geometry().positions().mark_written();
        self.record(&mut work, target)?;
        work.submit()
    }
}

/// Returns the median time of `work` over `times` calls after a warm-up, ms.
pub(crate) fn median_ms(times: u32, mut work: impl FnMut() -> Result<()>) -> Result<f64> {
    work()?;
    let mut taken = Vec::new();
    for _ in 0..times {
        let start = Instant::now();
        work()?;
        taken.push(start.elapsed().as_secs_f64() * 1e3);
    }
    taken.sort_by(f64::total_cmp);
    Ok(taken.get(taken.len() / 2).copied().unwrap_or(0.0))
}
