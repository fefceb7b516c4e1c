//! The command line, one file per subcommand.

mod adapters;
mod bake;
#[cfg(feature = "study")]
mod bench;
mod compare;
mod convert;
mod demo;
mod driver;
mod film;
mod flag_values;
mod flags;
mod frames;
#[cfg(feature = "identify")]
mod identify;
mod info;
mod mesh;
mod path_flags;
mod presets;
mod press;
mod press_map;
mod progress;
pub mod reference_pages;
mod refinement;
mod render;
pub mod schema;
mod shell;
mod simulate;
#[cfg(feature = "study")]
mod study;
mod tune;
mod view;
mod volume_flag;
mod warp;

use clap::{CommandFactory, Parser, Subcommand};
use palpate::gpu::Gpu;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Simulate deformable tetrahedral meshes with contact, and render their interior.
#[derive(Parser)]
#[command(version, about, propagate_version = true)]
struct Arguments {
    /// Select the graphics adapter: part of its name, its index in `palpate adapters`, or cpu
    #[arg(long, global = true, env = Gpu::ADAPTER_VARIABLE)]
    adapter: Option<String>,
    /// Print only errors on standard error: no progress, no notes
    #[arg(long, short, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Print statistics and problems of a mesh, volume or surface file
    Info(info::InfoArguments),
    /// Render a picture of a mesh or scene, simulated first if a solver is set
    Render(Box<render::RenderArguments>),
    /// Simulate a scene, or replay a recorded series, and write every frame
    Simulate(Box<simulate::SimulateArguments>),
    /// Press on a body with a fingertip and release it: pictures, an animation, force against depth
    Press(Box<press::PressArguments>),
    /// Mesh a scan, a segmentation or closed surfaces with tetrahedra, or extract a surface
    Mesh(Box<mesh::MeshArguments>),
    /// Convert a mesh or a surface to another format
    Convert(convert::ConvertArguments),
    /// Bake the normal map of a coarse surface with texture coordinates from a fine surface
    Bake(bake::BakeArguments),
    /// Compare two images; exit with code 1 if they differ by more than the tolerances
    Compare(compare::CompareArguments),
    /// Bend the limb phantom and write pictures, an animation and a series
    Demo(demo::DemoArguments),
    #[cfg(feature = "study")]
    /// Measure accuracy against speed, stability, and cost against size, with charts
    Study(study::StudyArguments),
    #[cfg(feature = "study")]
    /// Compare this machine's pictures and motions with golden ones, and measure its speed
    Bench(bench::BenchArguments),
    /// Find the cheapest settings of a scene that meet a target accuracy on this machine
    Tune(tune::TuneArguments),
    /// Find the stiffness of a body from measured presses, with intervals
    #[cfg(feature = "identify")]
    Identify(identify::IdentifyArguments),
    /// Open the interactive viewer
    View(view::ViewArguments),
    /// Warp a scan by the deformation of a body; write the motion as a displacement field
    Warp(warp::WarpArguments),
    /// List the presets of transfer functions, or render them all on one sheet
    Presets(presets::PresetsArguments),
    /// List the graphics adapters, best first
    Adapters(adapters::AdaptersArguments),
    /// Print the JSON Schema of scene files, for completion and errors in editors
    Schema(schema::SchemaArguments),
    /// Print the completion script of a shell
    Completions(shell::CompletionsArguments),
    /// Write a manual page for each command
    Man(shell::ManArguments),
}

/// Whether only errors are printed on standard error.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Whether only errors are printed on standard error (`--quiet`).
fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Result of a command that did not fail.
pub enum Outcome {
    /// Success.
    Done,
    /// A negative answer: exit code 1, without an error message.
    Negative,
}

/// Returns the command with all subcommands and flags.
pub fn command() -> clap::Command {
    Arguments::command()
}

/// Parses the arguments, runs the command, and returns the exit code: 0 success, 1 failure (or
/// `compare` found a difference), 2 wrong arguments.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    QUIET.store(arguments.quiet, Ordering::Relaxed);
    match run(&arguments) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Negative) => ExitCode::FAILURE,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            // If standard error is closed, the error cannot be reported.
            let _ = writeln!(std::io::stderr(), "palpate: {}", error_chain(&error));
            ExitCode::FAILURE
        }
    }
}

/// Formats the error with its causes, without those already contained in the one above.
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
        Command::Render(arguments) => render::run(&driver::gpu(adapter)?, arguments),
        Command::Simulate(arguments) => simulate::run(&driver::gpu(adapter)?, arguments),
        Command::Press(arguments) => press::run(&driver::gpu(adapter)?, arguments),
        Command::Mesh(arguments) => mesh::run(arguments),
        Command::Convert(arguments) => convert::run(arguments),
        Command::Bake(arguments) => bake::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Demo(arguments) => demo::run(&driver::gpu(adapter)?, arguments),
        #[cfg(feature = "study")]
        Command::Study(arguments) => study::run(&driver::gpu(adapter)?, arguments),
        #[cfg(feature = "study")]
        Command::Bench(arguments) => bench::run(adapter, arguments),
        Command::Tune(arguments) => tune::run(&driver::gpu(adapter)?, arguments),
        #[cfg(feature = "identify")]
        Command::Identify(arguments) => identify::run(&driver::gpu(adapter)?, arguments),
        Command::View(arguments) => view::run(arguments),
        Command::Warp(arguments) => warp::run(adapter, arguments),
        Command::Presets(arguments) => presets::run(arguments),
        Command::Adapters(arguments) => adapters::run(adapter, arguments),
        Command::Schema(arguments) => schema::run(arguments),
        Command::Completions(arguments) => shell::completions(arguments),
        Command::Man(arguments) => shell::man(arguments),
    }
}

/// Prints a report on standard output as one JSON object.
fn print_json(report: &impl serde::Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(report)?;
    writeln!(std::io::stdout().lock(), "{text}")?;
    Ok(())
}

/// Prints notes on standard error, unless `--quiet` is given.
fn print_notes(notes: &[String]) {
    if is_quiet() {
        return;
    }
    let mut err = std::io::stderr().lock();
    for note in notes {
        // If standard error is closed, the note cannot be printed.
        let _ = writeln!(err, "palpate: {note}");
    }
}

/// Whether `path` is a series of frames.
fn is_series(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("pvd"))
}

/// Whether the reader of the output has closed the pipe, which is not an error.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause
            .downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    })
}
