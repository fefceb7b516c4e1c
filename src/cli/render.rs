//! `palpate render`: deforms a body and renders one image.

use super::film::AnimationFlags;
use super::flags::SceneFlags;
use super::mesh::write_report;
use super::{Outcome, print_json, progress, refinement};
use clap::Args;
use glam::DVec2;
use palpate::accuracy::RestErrors;
use palpate::annotate::FrameTime;
use palpate::gpu::Gpu;
use palpate::io::{self, MeshFormat};
use palpate::mesh::Location;
use palpate::physics::BodyField;
use palpate::scene::{ERROR_FIELD, PlannedRun, Scene, Stage, StageReport};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Flags of the performance report of a picture.
#[derive(Args, Clone, Debug, Default)]
pub struct MeasureFlags {
    /// Render N frames after a warm-up and report the median time
    #[arg(long, help_heading = "Measuring")]
    pub repeat: Option<u32>,
    /// Write the measurements as JSON
    #[arg(long, help_heading = "Measuring")]
    pub report: Option<PathBuf>,
    /// Print the measurements on standard output as JSON
    #[arg(long, help_heading = "Measuring", conflicts_with = "pick")]
    pub json: bool,
}

/// Arguments of `render`.
#[derive(Args)]
pub struct RenderArguments {
    /// Mesh, scene (.toml), or series of frames (.pvd), of which the last is rendered; - for the mesh
    /// in the stream of --frames-from
    input: PathBuf,
    /// Write the picture to this file: .png, or .exr for the raw values
    #[arg(long, short, required_unless_present_any = ["pick", "film"])]
    out: Option<PathBuf>,
    /// Print the node, tet, point and region visible at the centre of pixel X,Y as JSON, or null;
    /// pixels are counted from 0 at the upper left
    #[arg(long, value_parser = pixel)]
    pick: Option<DVec2>,
    /// Write the deformed mesh, too (.vtu, .vtk, .msh, .mesh, .node with .ele, .inp)
    #[arg(long)]
    mesh_out: Option<PathBuf>,
    /// Render the frames that another program writes to this file or named pipe (- for standard
    /// input), each as soon as it arrives, as numbered pictures OUT_0000.png and so on, or as a film;
    /// docs/how-to/frames.md describes the format
    #[arg(long, value_name = "PIPE", conflicts_with_all = ["pick", "mesh_out", "repeat", "report"])]
    frames_from: Option<PathBuf>,
    #[command(flatten)]
    film: AnimationFlags,
    /// Set the number of frames of the film
    #[arg(
        long,
        value_name = "N",
        default_value_t = 36,
        help_heading = "Film",
        requires = "film",
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    frames: u32,
    #[command(flatten)]
    pub scene: SceneFlags,
    #[command(flatten)]
    measure: MeasureFlags,
}

impl RenderArguments {
    /// Returns the input.
    pub fn input(&self) -> &Path {
        &self.input
    }

    /// Returns the image file, if requested.
    pub fn out(&self) -> Option<&Path> {
        self.out.as_deref()
    }

    /// Whether to print the report as JSON.
    pub fn json(&self) -> bool {
        self.measure.json
    }

    /// Returns the flags of the animation.
    pub fn film_flags(&self) -> &AnimationFlags {
        &self.film
    }
}

/// Deforms the body if a solver is given, and renders it.
/// Long because it follows the course of the command, one output after another.
pub fn run(gpu: &Gpu, arguments: &RenderArguments) -> anyhow::Result<Outcome> {
    if let Some(pipe) = &arguments.frames_from {
        return super::frames::run(gpu, arguments, pipe);
    }
    if let Some(path) = &arguments.mesh_out {
        // Checked before the work: the extension must be supported.
        MeshFormat::from_extension(path)?;
    }
    let film = arguments.film.with_full_orbit()?;
    film.check()?;
    let series = super::is_series(&arguments.input)
        .then(|| io::read_pvd(&arguments.input))
        .transpose()?;
    let last = series.as_ref().and_then(|frames| frames.last());
    let input = last.map_or(arguments.input.as_path(), io::Frame::file);
    let mut scene = arguments.scene.scene(input)?;
    scene.solver.run = Some(PlannedRun {
        steps: scene.solver.steps.unwrap_or(PlannedRun::DEFAULT_STEPS),
        draws_frames: false,
    });
    let shows_error = take_error_field(&mut scene);
    let parts = last.filter(|frame| frame.single_file().is_none());
    let (mut stage, missed) = match parts {
        None => refinement::stage(gpu, &scene)?,
        Some(frame) => (Stage::with_mesh(gpu, &scene, frame.read()?)?, None),
    };
    super::print_notes(stage.notes());
    if let Some(frame) = last {
        let frames = series.iter().flatten();
        let before = frames.map(|f| f.time).filter(|time| *time < frame.time);
        stage.set_displayed_time(FrameTime {
            seconds: frame.time,
            resolution: frame.time - before.fold(f64::NEG_INFINITY, f64::max),
        });
    }
    let steps = stage.steps();
    let outcome = progress::with_bar("steps", u64::from(steps), |bar| {
        progress::run(&mut stage, steps, &mut |done, iterations| {
            bar.set_position(u64::from(done));
            bar.detail(progress::iterations(iterations));
        })
    });
    if steps > 0 {
        stage.fit_view(&[])?;
    }
    if outcome.is_ok() {
        super::print_notes(&stage.end_notes()?);
    }
    let errors = match shows_error && outcome.is_ok() {
        true => Some(progress::with_stages(|progress| {
            RestErrors::estimate(&mut stage, progress)
        })?),
        false => None,
    };
    let mut of_error = match &errors {
        Some(Ok(errors)) => Some(errors.picture(&mut stage)?),
        Some(Err(why)) => anyhow::bail!("no error to draw: {why}"),
        None => None,
    };
    // Rendered even if the simulation failed: its last valid state is informative.
    if let Some(out) = &arguments.out {
        let stage = of_error.as_mut().unwrap_or(&mut stage);
        match stage.draws_paths() {
            true => progress::with_stages(|progress| stage.save_with_progress(out, progress))?,
            false => progress::with_message("drawing", || stage.save(out))?,
        }
        let notes = stage.field_note().into_iter();
        let notes = notes.chain(stage.annotation_note(out));
        super::print_notes(&notes.chain(stage.path_note()).collect::<Vec<_>>());
    }
    if film.is_requested() {
        let stage = of_error.as_mut().unwrap_or(&mut stage);
        render_turntable(stage, &film, arguments.frames)?;
    }
    if let Some(path) = &arguments.mesh_out {
        let mesh = match &errors {
            Some(Ok(errors)) => errors.mesh(&stage)?,
            _ => stage.deformed_mesh()?,
        };
        super::print_notes(&io::write(path, &mesh)?);
    }
    if let (Err(_), Some(out)) = (&outcome, &arguments.out) {
        super::print_notes(&[format!("{} shows the last valid state", out.display())]);
    }
    outcome?;
    if let Some(pixel) = arguments.pick {
        print_json(&pick_json(&mut stage, pixel)?)?;
    }
    let measure = &arguments.measure;
    if measure.repeat.is_some() || measure.report.is_some() || measure.json {
        let frames = measure.repeat.unwrap_or(1);
        let report = self::measure(&mut stage, (frames, errors))?;
        if measure.json {
            print_json(&report)?;
        }
        match &measure.report {
            Some(path) => write_report(path, &report)?,
            None if measure.json => {}
            None => super::print_notes(&[format!(
                "{:.2} ms per frame, {:.2} ms per step on {}",
                report.report.frame_ms,
                report.report.step_ms.unwrap_or(0.0),
                report.report.adapter
            )]),
        }
    }
    refinement::check(missed)?;
    Ok(Outcome::Done)
}

/// The content of `--report`.
#[derive(serde::Serialize)]
struct ReportWithErrors {
    #[serde(flatten)]
    report: StageReport,
    /// Estimated errors of a body at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    errors: Option<RestErrors>,
    /// Why there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    no_errors_because: Option<String>,
}

/// Replaces the field `error` of a simulated body, which is estimated after the run, and returns
/// whether it was there.
fn take_error_field(scene: &mut Scene) -> bool {
    let field = &mut scene.picture.field;
    let shows_error = scene.solver.name.is_some() && field.as_deref() == Some(ERROR_FIELD);
    if shows_error {
        *field = Some(BodyField::Displacement.name().into());
        // It is not drawn, so its range needs no note.
        scene.picture.range = Some([0.0, 1.0]);
    }
    shows_error
}

/// Measures `frames` frames, and estimates the errors of a body at rest unless they are known.
fn measure(
    stage: &mut Stage,
    (frames, known): (u32, Option<Result<RestErrors, String>>),
) -> palpate::Result<ReportWithErrors> {
    let is_simulated = stage.motion().is_some();
    let estimated = match known {
        Some(known) => known,
        None if is_simulated => {
            progress::with_stages(|progress| RestErrors::estimate(stage, progress))?
        }
        None => Err(String::new()),
    };
    let report = progress::with_message("measuring", || stage.measure(frames))?;
    let (errors, why) = match estimated {
        Ok(errors) => (Some(errors), None),
        Err(why) => (None, Some(why).filter(|_| is_simulated)),
    };
    Ok(ReportWithErrors {
        report,
        errors,
        no_errors_because: why,
    })
}

/// Renders an animation with the camera orbiting the body.
fn render_turntable(stage: &mut Stage, film: &AnimationFlags, frames: u32) -> palpate::Result<()> {
    let before = *stage.camera_mut();
    film.frame(stage, &[])?;
    let starts = *stage.camera_mut();
    let Some(mut file) = film.start(stage)? else {
        return Ok(());
    };
    progress::with_bar("frames", u64::from(frames), |bar| -> palpate::Result<()> {
        for frame in 0..frames {
            // The last frame is one step before the first, so the animation loops.
            let share = f64::from(frame) / f64::from(frames);
            *stage.camera_mut() = film.camera(&starts, share);
            stage.film(&mut file)?;
            bar.inc(1);
        }
        Ok(())
    })?;
    *stage.camera_mut() = before;
    file.finish()
}

/// Returns the pick at `pixel`, or null.
fn pick_json(stage: &mut Stage, pixel: DVec2) -> palpate::Result<Value> {
    let Some(pick) = stage.pick(pixel)? else {
        return Ok(Value::Null);
    };
    let mesh = stage.mesh();
    let field = mesh.region_field();
    let label = field
        .or_else(|| mesh.field("label", Location::Cell))
        .and_then(|field| field.values.get(pick.tet as usize))
        .map(|label| *label as i64);
    let name = label.and_then(|label| mesh.region_names.get(&label));
    Ok(json!({
        "node": pick.node,
        "tet": pick.tet,
        "face": pick.face,
        "point": pick.point.to_array(),
        "distance": pick.distance,
        "label": label,
        "region": name,
    }))
}

/// Parses a pixel and returns its centre.
fn pixel(text: &str) -> Result<DVec2, String> {
    let expected = || "expected X,Y in pixels, such as 512,384".to_owned();
    let (x, y) = text.split_once(',').ok_or_else(expected)?;
    let (x, y): (u32, u32) = match (x.trim().parse(), y.trim().parse()) {
        (Ok(x), Ok(y)) => (x, y),
        _ => return Err(expected()),
    };
    Ok(DVec2::new(f64::from(x), f64::from(y)) + 0.5)
}
