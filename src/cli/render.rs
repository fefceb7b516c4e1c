//! `palpate render`: deform, draw one picture.

use super::flags::{MeasureFlags, SceneFlags};
use super::{Outcome, progress};
use clap::Args;
use palpate::gpu::Gpu;
use palpate::io;
use palpate::scene::Stage;
use std::path::PathBuf;

/// Arguments of `render`.
#[derive(Args)]
pub struct RenderArguments {
    /// A mesh, a scene (.toml), or a series of frames (.pvd), of which the last is drawn
    input: PathBuf,
    /// The picture: .png, or .exr for the raw values
    #[arg(long, short)]
    out: PathBuf,
    /// Also write the deformed mesh (.vtu)
    #[arg(long)]
    mesh_out: Option<PathBuf>,
    #[command(flatten)]
    scene: SceneFlags,
    #[command(flatten)]
    measure: MeasureFlags,
}

/// Deforms the body if a solver is named, and draws it.
pub fn run(gpu: &Gpu, arguments: &RenderArguments) -> anyhow::Result<Outcome> {
    let series = super::is_series(&arguments.input)
        .then(|| io::read_pvd(&arguments.input))
        .transpose()?;
    let last = series.as_ref().and_then(|frames| frames.last());
    let input = last.map_or(&arguments.input, |frame| &frame.file);
    let mut stage = Stage::new(gpu, &arguments.scene.scene(input)?)?;
    super::tell(stage.notes());
    let steps = stage.steps();
    let outcome = progress::over("steps", u64::from(steps), |bar| {
        stage.run(steps, &mut |done| bar.set_position(u64::from(done)))
    });
    // Also when the simulation failed: its last good state is worth a look.
    stage.save(&arguments.out)?;
    if let Some(path) = &arguments.mesh_out {
        io::write(path, &stage.deformed_mesh()?)?;
    }
    if outcome.is_err() {
        super::tell(&[format!(
            "{} shows the last good state",
            arguments.out.display()
        )]);
    }
    outcome?;
    if arguments.measure.repeat.is_some() || arguments.measure.report.is_some() {
        let report = stage.measure(arguments.measure.repeat.unwrap_or(1))?;
        match &arguments.measure.report {
            Some(path) => io::atomic_write(path, |file| {
                serde_json::to_writer_pretty(file, &report)
                    .map_err(|e| palpate::Error::io(path)(e.into()))
            })?,
            None => super::tell(&[format!(
                "{:.2} ms a frame, {:.2} ms a step on {}",
                report.frame_ms,
                report.step_ms.unwrap_or(0.0),
                report.adapter
            )]),
        }
    }
    Ok(Outcome::Done)
}
