//! `palpate render --frames-from`: renders a body that is moved by another program.

use super::Outcome;
use super::render::RenderArguments;
use anyhow::Context;
use palpate::annotate::FrameTime;
use palpate::gpu::Gpu;
use palpate::io::FrameStream;
use palpate::scene::Stage;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// Stands for standard input, and for a mesh in the stream of frames.
const DASH: &str = "-";

/// Renders every frame of `pipe` as soon as it has arrived.
pub fn run(gpu: &Gpu, arguments: &RenderArguments, pipe: &Path) -> anyhow::Result<Outcome> {
    let film = arguments.film_flags();
    film.check()?;
    if film.orbit.is_some() {
        anyhow::bail!(
            "--orbit requires a known number of frames, which a pipe does not provide; remove it"
        );
    }
    let name = match pipe.as_os_str() == DASH {
        true => Path::new("standard input"),
        false => pipe,
    };
    let (mut frames, mesh) = FrameStream::new(BufReader::new(open(pipe)?), name)?;
    let mut scene = arguments.scene.scene(arguments.input())?;
    // Only the frames move the body.
    scene.solver.name = None;
    let own = arguments.input().as_os_str() == DASH;
    let mut stage = match mesh {
        Some(mesh) if own => Stage::with_mesh(gpu, &scene, mesh)?,
        None if !own => Stage::new(gpu, &scene)?,
        Some(_) => anyhow::bail!(
            "{}: the stream contains a mesh, but {} is given as well; give - instead, or send frames without a mesh",
            name.display(),
            arguments.input().display()
        ),
        None => anyhow::bail!(
            "{}: the stream contains no mesh; give a mesh or scene instead of -",
            name.display()
        ),
    };
    let nodes = stage.mesh().nodes.len();
    if frames.nodes() != nodes {
        anyhow::bail!(
            "{}: the frames have {} nodes, but the mesh has {nodes}",
            name.display(),
            frames.nodes()
        );
    }
    super::print_notes(stage.notes());
    let mut film = film.start(&stage)?;
    let mut count = 0;
    let mut before = f64::NEG_INFINITY;
    let drawn = loop {
        let (time, places) = match frames.next_frame() {
            Ok(Some(frame)) => frame,
            Ok(None) => break Ok(()),
            // Completed output is kept.
            Err(e) => break Err(e),
        };
        stage.set_positions(&places)?;
        stage.set_displayed_time(FrameTime {
            seconds: time,
            resolution: time - before,
        });
        before = time;
        if let Some(out) = arguments.out() {
            stage.save(numbered(out, count))?;
        }
        if let Some(film) = &mut film {
            stage.film(film)?;
        }
        count += 1;
    };
    super::film::finish(film, count > 0)?;
    drawn?;
    if count == 0 {
        anyhow::bail!(
            "{}: the stream ended before the first frame",
            name.display()
        );
    }
    super::print_notes(&[format!("rendered {count} frames")]);
    if arguments.json() {
        super::print_json(&serde_json::json!({ "frames": count }))?;
    }
    Ok(Outcome::Done)
}

/// Opens a pipe or standard input.
fn open(pipe: &Path) -> anyhow::Result<Box<dyn Read>> {
    Ok(match pipe.as_os_str() == DASH {
        true => Box::new(io::stdin().lock()),
        false => Box::new(File::open(pipe).with_context(|| format!("{}", pipe.display()))?),
    })
}

/// Inserts the number of a frame into `out`.
fn numbered(out: &Path, frame: u32) -> PathBuf {
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let extension = out.extension().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!("{stem}_{frame:04}.{extension}"))
}
