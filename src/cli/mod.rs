//! The command line: one file a subcommand.

mod bake;
mod compare;
mod convert;
mod demo;
mod film;
mod flags;
mod frames;
mod info;
mod mesh;
mod presets;
mod press;
mod press_map;
mod progress;
mod render;
mod simulate;
#[cfg(feature = "study")]
mod study;
mod tune;
mod view;
mod warp;

use clap::{Parser, Subcommand};
use palpate::gpu::{ADAPTER_VARIABLE, Gpu};
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

/// Press on a body and see inside it while it gives.
#[derive(Parser)]
#[command(version, about, propagate_version = true)]
struct Arguments {
    /// The graphics adapter: part of its name, its index in `palpate adapters`, or cpu
    #[arg(long, global = true, env = ADAPTER_VARIABLE)]
    adapter: Option<String>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Say what is in a mesh, volume or surface file, and what is wrong with it
    Info(info::InfoArguments),
    /// Draw a picture of a mesh or scene, deformed if a solver is named
    Render(Box<render::RenderArguments>),
    /// Draw and write every frame of a simulation, or of a series recorded before
    Simulate(Box<simulate::SimulateArguments>),
    /// Press on a body with a fingertip and let go: pictures, a film, force against depth
    Press(Box<press::PressArguments>),
    /// Make a tetrahedral mesh of a scan, a segmentation or closed surfaces; or a surface of one
    Mesh(Box<mesh::MeshArguments>),
    /// Write a mesh or a surface in another format
    Convert(convert::ConvertArguments),
    /// Make the normal map of a coarse surface, which has texture coordinates, from a fine one
    Bake(bake::BakeArguments),
    /// Hold picture against picture; exit code 1 past the tolerance
    Compare(compare::CompareArguments),
    /// Bend the limb phantom and leave pictures, an animation and a series
    Demo(demo::DemoArguments),
    #[cfg(feature = "study")]
    /// Measure accuracy against speed, stability, cost against size; with charts
    Study(study::StudyArguments),
    /// Find the cheapest settings of a scene that are as accurate as asked for, on this machine
    Tune(tune::TuneArguments),
    /// Open a body in a window, to press on it and look into it
    View(view::ViewArguments),
    /// Bring a scan to where a body took it; write the motion as a displacement field
    Warp(warp::WarpArguments),
    /// List the presets of transfer functions by name, or draw them all on one sheet
    Presets(presets::PresetsArguments),
    /// List the graphics adapters, best first
    Adapters,
}

/// How a command ended, when nothing went wrong.
pub enum Outcome {
    /// All is well.
    Done,
    /// The question asked has the answer no: exit code 1, without an error message.
    Negative,
}

/// Parses the arguments, runs the command, and turns what happened into an exit code: 0 done,
/// 1 failed (or `compare` found a difference), 2 wrong arguments.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Negative) => ExitCode::FAILURE,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            // Nothing is left to tell it to if standard error is closed too.
            let _ = writeln!(std::io::stderr(), "palpate: {}", error_chain(&error));
            ExitCode::FAILURE
        }
    }
}

/// The error with its causes, each that is not said already by the one above it.
fn error_chain(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        let cause = cause.to_string();
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let adapter = arguments.adapter.as_deref();
    match &arguments.command {
        Command::Info(arguments) => info::run(arguments),
        Command::Render(arguments) => render::run(&Gpu::with_adapter(adapter)?, arguments),
        Command::Simulate(arguments) => simulate::run(&Gpu::with_adapter(adapter)?, arguments),
        Command::Press(arguments) => press::run(&Gpu::with_adapter(adapter)?, arguments),
        Command::Mesh(arguments) => mesh::run(arguments),
        Command::Convert(arguments) => convert::run(arguments),
        Command::Bake(arguments) => bake::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Demo(arguments) => demo::run(&Gpu::with_adapter(adapter)?, arguments),
        #[cfg(feature = "study")]
        Command::Study(arguments) => study::run(&Gpu::with_adapter(adapter)?, arguments),
        Command::Tune(arguments) => tune::run(&Gpu::with_adapter(adapter)?, arguments),
        Command::View(arguments) => view::run(arguments),
        Command::Warp(arguments) => warp::run(adapter, arguments),
        Command::Presets(arguments) => presets::run(arguments),
        Command::Adapters => adapters(adapter),
    }
}

fn adapters(wanted: Option<&str>) -> anyhow::Result<Outcome> {
    let mut out = std::io::stdout().lock();
    let chosen = Gpu::with_adapter(wanted)?.adapter_name();
    for (i, name) in Gpu::adapters().iter().enumerate() {
        let mark = if *name == chosen { "*" } else { " " };
        writeln!(out, "{mark} {i}: {name}")?;
    }
    Ok(Outcome::Done)
}

/// Tells the user something beside the result, on standard error.
fn print_notes(notes: &[String]) {
    let mut err = std::io::stderr().lock();
    for note in notes {
        // Nothing is left to tell it to if standard error is closed.
        let _ = writeln!(err, "palpate: {note}");
    }
}

/// Whether `path` names a series of frames.
fn is_series(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("pvd"))
}

/// Whether the reader of our output went away, which is its right.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause
            .downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    })
}
