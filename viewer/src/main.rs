//! `palpate-view`: interactive viewer for deformable tetrahedral bodies.

use clap::Parser;
use palpate_view::{InitialFile, Options};
use std::path::PathBuf;
use std::process::ExitCode;

/// Press on, cut and render deformable bodies interactively in a window
#[derive(Parser)]
#[command(name = "palpate-view", version)]
struct Arguments {
    /// Mesh, volume, closed surface, scene (.toml) or series (.pvd) to open [default: example limb]
    file: Option<PathBuf>,
    /// Open a bundled example: limb, knee, heart, head, foot, breast
    #[arg(long, value_name = "NAME", conflicts_with = "file")]
    example: Option<String>,
    /// Set the window size, WIDTHxHEIGHT in points
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = size)]
    size: [u32; 2],
    /// Leave out the error estimates of presses
    #[arg(long)]
    no_error: bool,
    /// Write timings and state of each frame to this file, one JSON object per line
    #[arg(long, value_name = "FILE.jsonl")]
    log: Option<PathBuf>,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let numbers = text.split_once('x').map(|(w, h)| (w.parse(), h.parse()));
    match numbers {
        Some((Ok(width @ 200..=16384), Ok(height @ 200..=16384))) => Ok([width, height]),
        _ => Err(format!(
            "window size must be WIDTHxHEIGHT, each from 200 to 16384, got \"{text}\""
        )),
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let options = Options {
        open: match (arguments.file, arguments.example) {
            (Some(file), _) => InitialFile::File(file),
            (None, name) => InitialFile::Example(name.unwrap_or_else(|| "limb".into())),
        },
        no_error: arguments.no_error,
        log: arguments.log,
    };
    match palpate_view::run(options, arguments.size) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("palpate-view: {why}");
            ExitCode::FAILURE
        }
    }
}
