//! `palpate-view`: press on a body in a window and see inside it while it gives.

use clap::Parser;
use palpate_view::{InitialFile, Options};
use std::path::PathBuf;
use std::process::ExitCode;

/// Press on a body in a window and see inside it while it gives
#[derive(Parser)]
#[command(name = "palpate-view", version)]
struct Arguments {
    /// A mesh, a volume, a closed surface or a scene (.toml) [default: the example limb]
    file: Option<PathBuf>,
    /// Open this example: limb, knee, heart, head, foot, breast
    #[arg(long, value_name = "NAME", conflicts_with = "file")]
    example: Option<String>,
    /// Size of the window, WIDTHxHEIGHT in points
    #[arg(long, value_name = "WxH", default_value = "1280x800", value_parser = size)]
    size: [u32; 2],
    /// Write what each frame took to this file, a line of JSON each
    #[arg(long, value_name = "FILE.jsonl")]
    log: Option<PathBuf>,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let numbers = text.split_once('x').map(|(w, h)| (w.parse(), h.parse()));
    match numbers {
        Some((Ok(width @ 200..=16384), Ok(height @ 200..=16384))) => Ok([width, height]),
        _ => Err(format!(
            "\"{text}\" is no size of a window; WIDTHxHEIGHT is expected, each from 200 to 16384"
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
