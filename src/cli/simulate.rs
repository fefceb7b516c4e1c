//! `palpate simulate`: renders and writes every frame of a simulation.

use super::film::{self, AnimationFlags};
use super::flags::SceneFlags;
use super::progress::ProgressReporter;
use super::{Outcome, print_json, progress, refinement};
use clap::Args;
use glam::DVec3;
use palpate::accuracy::{ForceError, RestErrors};
use palpate::annotate::FrameTime;
use palpate::gpu::Gpu;
use palpate::io::{self, PvdSeries};
use palpate::render::{Animation, Camera};
use palpate::scene::{Checkpoint, FieldRanges, Motion, PlannedRun, ReactionLog, Stage};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Forces up to this one are rounding, N.
const ROUNDING: f64 = 1e-9;

/// Arguments of `simulate`.
#[derive(Args)]
pub struct SimulateArguments {
    /// Scene (.toml), mesh with --solver, or series of frames (.pvd) to replay
    input: PathBuf,
    /// Set the number of frames after the first, which shows the initial state
    #[arg(long, default_value_t = 50)]
    frames: u32,
    /// Write pictures, meshes and the .pvd that lists them to this folder
    #[arg(long, short)]
    out: PathBuf,
    /// Render no pictures
    #[arg(long)]
    no_pictures: bool,
    /// Write no meshes
    #[arg(long)]
    no_meshes: bool,
    /// Write the forces (N) and moments about the origin (N·m) of the body on its pins, grabs and
    /// tools as CSV, one line each per frame
    #[arg(long, value_name = "FILE.csv")]
    reactions: Option<PathBuf>,
    /// Do not estimate the errors of the reactions in the last frame
    #[arg(long)]
    no_error: bool,
    /// Resume an interrupted run in the same folder, or extend it by more frames; a film takes the
    /// earlier frames from their pictures
    #[arg(long, conflicts_with = "orbit")]
    resume: bool,
    /// Print the report on standard output as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    film: AnimationFlags,
    #[command(flatten)]
    scene: SceneFlags,
}

/// Returns the base of the names of output files.
fn output_name(arguments: &SimulateArguments) -> String {
    let stem = arguments.input.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Simulates, or plays back a series, and renders every frame.
pub fn run(gpu: &Gpu, arguments: &SimulateArguments) -> anyhow::Result<Outcome> {
    check_outputs(arguments)?;
    std::fs::create_dir_all(&arguments.out).map_err(palpate::Error::io(&arguments.out))?;
    if super::is_series(&arguments.input) {
        check_replay(arguments)?;
        return replay_series(gpu, arguments);
    }
    let name = output_name(arguments);
    let kept = arguments.out.join(format!("{name}.checkpoint"));
    let checkpoint = match arguments.resume {
        true => read_checkpoint(&kept)?,
        false => None,
    };
    let mut scene = arguments.scene.scene(&arguments.input)?;
    let steps = scene.solver.steps.unwrap_or(1);
    let ahead = PlannedRun {
        steps: steps.saturating_mul(arguments.frames),
        draws_frames: !arguments.no_pictures || arguments.film.is_requested(),
    };
    // The settings of the resumed run are kept, whatever the new number of frames.
    scene.solver.run = checkpoint.as_ref().map_or(Some(ahead), |kept| kept.run());
    if arguments.resume && scene.accuracy.within.is_some() {
        anyhow::bail!("a run with --within begins anew on its refined mesh; remove --resume");
    }
    let (mut stage, missed) = refinement::stage(gpu, &scene)?;
    super::print_notes(stage.notes());
    let resumable = stage.motion().is_some_and(Motion::has_state);
    check_motion(arguments, &stage)?;
    arguments.film.frame(&mut stage, &[])?;
    let mut times = Vec::new();
    if let Some(checkpoint) = checkpoint {
        resume_from(&mut stage, &kept, &checkpoint, gpu)?;
        times = checkpoint.times().to_vec();
    } else {
        if resumable {
            stage.keep_checkpoints();
        }
        remove_checkpoint(&kept)?;
    }
    let series = match arguments.no_meshes {
        true => None,
        false if !times.is_empty() => Some(PvdSeries::resume(&arguments.out, &name, &times)?),
        false => Some(PvdSeries::create(&arguments.out, &name)?),
    };
    let reactions = arguments.reactions.clone();
    let reactions = reactions.or(scene.output.reactions.map(|file| arguments.out.join(file)));
    let mut frames = Frames {
        steps,
        last: arguments.frames,
        series,
        reactions: match reactions {
            Some(path) => Some(start_reactions(&mut stage, path, &times)?),
            None => None,
        },
        pictures: Pictures::begin(arguments, &mut stage, &name)?.with_earlier(times.len())?,
        checkpoint: resumable.then_some(kept),
        times,
    };
    let done = progress::with_bar("frames", u64::from(arguments.frames), |bar| {
        frames.run(&mut stage, bar)
    });
    let film = frames.pictures.end();
    done?;
    film?;
    let notes = stage.field_note().into_iter();
    super::print_notes(&notes.chain(stage.end_notes()?).collect::<Vec<_>>());
    if let Some(log) = frames.reactions.as_mut().filter(|_| !arguments.no_error) {
        let notes = estimate_errors(log, &mut stage)?;
        super::print_notes(&notes);
    }
    report(arguments, &stage, gpu, frames.times.len(), stage.time())?;
    refinement::check(missed)?;
    Ok(Outcome::Done)
}

/// Rejects combinations of outputs that write nothing, or a film without its earlier frames.
fn check_outputs(arguments: &SimulateArguments) -> anyhow::Result<()> {
    arguments.film.check()?;
    if arguments.no_pictures && arguments.no_meshes && !arguments.film.is_requested() {
        anyhow::bail!(
            "--no-pictures and --no-meshes leave nothing to write; remove one of them, or write a film (--film FILE.gif)"
        );
    }
    if arguments.resume && arguments.no_pictures && arguments.film.is_requested() {
        anyhow::bail!(
            "a resumed film takes its earlier frames from their pictures; remove --no-pictures, or --resume"
        );
    }
    Ok(())
}

/// The outputs of a run, and the times of the frames so far.
struct Frames<'a> {
    /// Steps from a frame to the next.
    steps: u32,
    /// Number of the last frame.
    last: u32,
    series: Option<PvdSeries>,
    reactions: Option<ReactionLog>,
    pictures: Pictures<'a>,
    /// The file of the checkpoint, if there is one.
    checkpoint: Option<PathBuf>,
    times: Vec<f64>,
}

impl Frames<'_> {
    /// Simulates and writes the remaining frames.
    fn run(&mut self, stage: &mut Stage, bar: &ProgressReporter) -> palpate::Result<()> {
        let steps = self.steps;
        for frame in self.times.len() as u32..=self.last {
            let moved = match frame {
                0 => Ok(()),
                _ => progress::run(stage, steps, &mut |done, iterations| {
                    let iterations = progress::iterations(iterations);
                    bar.detail(match iterations.is_empty() {
                        true => format!("step {done} of {steps}"),
                        false => format!("step {done} of {steps}, {iterations}"),
                    });
                }),
            };
            // Rendered even if the simulation failed: its last valid state is the last frame.
            self.pictures.draw(stage, frame, self.last)?;
            if let Some(series) = &mut self.series {
                stage.write_frame(series)?;
            }
            if let Some(reactions) = &mut self.reactions {
                reactions.push(stage)?;
            }
            moved?;
            self.times.push(stage.time());
            if let Some(file) = &self.checkpoint {
                stage.checkpoint(&self.times)?.write(file)?;
            }
            bar.set_position(u64::from(frame));
        }
        Ok(())
    }
}

/// Checks that the arguments suit the playback of a series.
fn check_replay(arguments: &SimulateArguments) -> anyhow::Result<()> {
    if arguments.resume {
        anyhow::bail!(
            "{}: --resume requires a simulation, not a recorded series; remove it",
            arguments.input.display()
        );
    }
    if arguments.reactions.is_some() {
        anyhow::bail!(
            "{}: --reactions requires a simulation, not a recorded series; remove it",
            arguments.input.display()
        );
    }
    Ok(())
}

/// Checks that the body moves, and that its run can be resumed if that is asked for.
fn check_motion(arguments: &SimulateArguments, stage: &Stage) -> anyhow::Result<()> {
    let Some(motion) = stage.motion() else {
        anyhow::bail!(
            "the body is static: set a solver in the scene or with --solver, such as implicit; film a static body with palpate render {0} --film FILE.gif",
            arguments.input.display()
        );
    };
    if !motion.has_state() && arguments.resume {
        anyhow::bail!(
            "the engine rapier cannot save its state, so its runs cannot be resumed; remove --resume, or use --engine cpu"
        );
    }
    Ok(())
}

/// Removes the checkpoint of another run, which would be mistaken for one of this run.
fn remove_checkpoint(kept: &Path) -> palpate::Result<()> {
    match std::fs::remove_file(kept) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(palpate::Error::io(kept)(e)),
        _ => Ok(()),
    }
}

/// Starts the file of reactions, or goes on with it after the frames at `times`.
fn start_reactions(
    stage: &mut Stage,
    path: PathBuf,
    times: &[f64],
) -> palpate::Result<ReactionLog> {
    // Checked before the work: the body must support reactions.
    stage.reactions()?;
    match times.is_empty() {
        false => ReactionLog::resume(path, times),
        true => ReactionLog::create(path),
    }
}

/// Estimates the errors of the reactions, and adds them to the last frame of `log`.
/// Returns notes: the forces with their errors, or why there are none.
fn estimate_errors(log: &mut ReactionLog, stage: &mut Stage) -> palpate::Result<Vec<String>> {
    let found = progress::with_stages(|progress| RestErrors::estimate(stage, progress))?;
    let errors = match found {
        Ok(errors) => errors,
        Err(why) => return Ok(vec![format!("no errors of the reactions: {why}")]),
    };
    let totals = errors.forces.iter();
    let totals = totals.map(|force| (force.name.clone(), force.error_n.total()));
    log.set_errors(&totals.collect::<Vec<_>>())?;
    let note = |force: &ForceError| {
        let size = force.error_n.around(force.force_n, "N");
        let parts = match force.error_n.in_words() {
            parts if parts.is_empty() => parts,
            parts => format!(" ({parts})"),
        };
        let is_unknown = force.force_n > ROUNDING && force.error_n.mesh > force.force_n;
        let advice = match is_unknown {
            true => "; the mesh is too coarse for it: use a finer mesh (--tets) or --order 2",
            false => "",
        };
        format!("force on {} at the end: {size}{parts}{advice}", force.name)
    };
    Ok(errors.forces.iter().map(note).collect())
}

/// Reads the checkpoint of an earlier run, if there is one.
fn read_checkpoint(kept: &Path) -> palpate::Result<Option<Checkpoint>> {
    if kept.exists() {
        return Checkpoint::read(kept).map(Some);
    }
    super::print_notes(&[format!(
        "no checkpoint {}; starting with the first frame",
        kept.display()
    )]);
    Ok(None)
}

/// Restores the state of `checkpoint`, read from the file `kept`.
fn resume_from(
    stage: &mut Stage,
    kept: &Path,
    checkpoint: &Checkpoint,
    gpu: &Gpu,
) -> palpate::Result<()> {
    let named = |e: palpate::Error| palpate::Error::format(kept, e.to_string());
    stage.resume(checkpoint).map_err(named)?;
    let mut notes = vec![format!(
        "resuming after frame {}, at {:.6} s",
        checkpoint.times().len().saturating_sub(1),
        stage.time()
    )];
    if checkpoint.adapter() != gpu.adapter_name() {
        notes.push(format!(
            "the earlier frames were computed on {}; the following ones may differ in the last digits",
            checkpoint.adapter()
        ));
    }
    super::print_notes(&notes);
    Ok(())
}

/// Renders every frame of a series with its own nodes, fields and tets, whatever its origin.
fn replay_series(gpu: &Gpu, arguments: &SimulateArguments) -> anyhow::Result<Outcome> {
    let frames = io::read_pvd(&arguments.input)?;
    let Some(first) = frames.first() else {
        anyhow::bail!("{}: the series has no frames", arguments.input.display());
    };
    let scene = arguments.scene.scene(first.file())?;
    let mut stage = match first.single_file() {
        Some(_) => Stage::new(gpu, &scene)?,
        None => Stage::with_mesh(gpu, &scene, first.read()?)?,
    };
    // All frames fit the image and the range: the corners of the bounds of each.
    let mut reach = Vec::new();
    let mut ranges = FieldRanges::default();
    for frame in &frames {
        let mesh = frame.read()?;
        ranges.add(&mesh.fields);
        let (low, high) = mesh.bounds();
        reach.extend((0..8).map(|i| {
            let pick = |axis: usize| {
                if i >> axis & 1 == 0 {
                    low[axis]
                } else {
                    high[axis]
                }
            };
            DVec3::new(pick(0), pick(1), pick(2))
        }));
    }
    super::print_notes(stage.notes());
    stage.use_series_range(&ranges)?;
    arguments.film.frame(&mut stage, &reach)?;
    let name = output_name(arguments);
    let last = frames.len().saturating_sub(1) as u32;
    let resolution = frames.windows(2).map(|two| two[1].time - two[0].time);
    let resolution = resolution.fold(f64::INFINITY, f64::min);
    let mut pictures = Pictures::begin(arguments, &mut stage, &name)?;
    let mut others = 0;
    progress::with_bar(
        "frames",
        frames.len() as u64,
        |bar| -> palpate::Result<()> {
            for (i, frame) in frames.iter().enumerate() {
                let named = |e: palpate::Error| palpate::Error::format(frame.file(), e.to_string());
                if !stage.show_mesh(frame.read()?).map_err(named)? {
                    others += 1;
                }
                stage.set_displayed_time(FrameTime {
                    seconds: frame.time,
                    resolution,
                });
                pictures.draw(&mut stage, i as u32, last)?;
                bar.inc(1);
            }
            Ok(())
        },
    )?;
    pictures.end()?;
    if others > 0 {
        super::print_notes(&[format!(
            "{others} of {} frames have other tets or regions than the frame before; each is rendered as its own mesh",
            frames.len()
        )]);
    }
    let end = frames.last().map_or(0.0, |frame| frame.time);
    report(arguments, &stage, gpu, frames.len(), end)?;
    Ok(Outcome::Done)
}

/// Prints a report on `frames` frames, including the first, the last of which is at `time`, as
/// JSON, if requested.
fn report(
    arguments: &SimulateArguments,
    stage: &Stage,
    gpu: &Gpu,
    frames: usize,
    time: f64,
) -> anyhow::Result<()> {
    if !arguments.json {
        return Ok(());
    }
    print_json(&json!({
        "adapter": gpu.adapter_name(),
        "tets": stage.mesh().tets.len(),
        "nodes": stage.mesh().nodes.len(),
        "frames": frames,
        "time_s": time,
    }))
}

/// The images of a run, as files and as an animation.
struct Pictures<'a> {
    arguments: &'a SimulateArguments,
    name: &'a str,
    film: Option<Animation>,
    /// The camera of the first frame.
    starts: Camera,
    filmed: bool,
}

impl<'a> Pictures<'a> {
    fn begin(
        arguments: &'a SimulateArguments,
        stage: &mut Stage,
        name: &'a str,
    ) -> palpate::Result<Pictures<'a>> {
        Ok(Pictures {
            arguments,
            name,
            film: arguments.film.start(stage)?,
            starts: *stage.camera_mut(),
            filmed: false,
        })
    }

    /// Adds the pictures of the first `frames` frames to the film.
    fn with_earlier(mut self, frames: usize) -> palpate::Result<Pictures<'a>> {
        if let Some(film) = &mut self.film {
            for frame in 0..frames {
                film.push_file(
                    self.arguments
                        .out
                        .join(format!("{}_{frame:04}.png", self.name)),
                )?;
                self.filmed = true;
            }
        }
        Ok(self)
    }

    /// Renders `frame` of a run with the last frame `last`.
    fn draw(&mut self, stage: &mut Stage, frame: u32, last: u32) -> palpate::Result<()> {
        let share = f64::from(frame) / f64::from(last.max(1));
        *stage.camera_mut() = self.arguments.film.camera(&self.starts, share);
        if !self.arguments.no_pictures {
            let extension = stage.picture_extension();
            let file = format!("{}_{frame:04}.{extension}", self.name);
            stage.save(self.arguments.out.join(file))?;
        }
        if let Some(film) = &mut self.film {
            stage.film(film)?;
            self.filmed = true;
        }
        Ok(())
    }

    /// Ends the animation, also after a failed run.
    fn end(self) -> palpate::Result<()> {
        film::finish(self.film, self.filmed)
    }
}
