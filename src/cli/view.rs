//! `palpate view`: starts the viewer, which is a separate program.

use super::Outcome;
use clap::Args;
use palpate::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Name of the viewer program.
const NAME: &str = "palpate-view";

/// Arguments of `view`.
#[derive(Args)]
pub struct ViewArguments {
    /// Mesh, volume, closed surface or scene (.toml) [default: the example limb]
    file: Option<PathBuf>,
    /// Additional arguments passed to palpate-view; `palpate-view --help` lists them
    #[arg(last = true, value_name = "ARGUMENTS")]
    others: Vec<String>,
}

/// Starts the viewer from the folder of this program, or from the search path, and waits for its
/// end.
pub fn run(arguments: &ViewArguments) -> anyhow::Result<Outcome> {
    let own = std::env::current_exe().ok();
    let beside = own.as_deref().and_then(Path::parent).map(|folder| {
        let name = format!("{NAME}{}", std::env::consts::EXE_SUFFIX);
        folder.join(name)
    });
    let program = beside.filter(|file| file.is_file());
    let program = program.unwrap_or_else(|| PathBuf::from(NAME));
    let ended = Command::new(&program)
        .args(&arguments.file)
        .args(&arguments.others)
        .status()
        .map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::Input(format!(
                "the viewer {NAME} was not found in the folder of this program or in PATH; install it with `cargo install --path viewer` in the source folder of Palpate"
            )),
            _ => Error::io(&program)(e),
        })?;
    Ok(match ended.success() {
        true => Outcome::Done,
        // It has printed the reason.
        false => Outcome::Negative,
    })
}
