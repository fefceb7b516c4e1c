//! `palpate study`: measurements, charts and findings.

use super::{Outcome, print_json, progress};
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use palpate::gpu::Gpu;
use palpate::study::{Run, STUDIES};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Arguments of `study`.
#[derive(Args)]
pub struct StudyArguments {
    /// Study to run
    #[arg(value_parser = PossibleValuesParser::new(
        STUDIES.iter().map(|(name, help, _)| PossibleValue::new(name).help(help))
    ))]
    what: String,
    /// Scene to study, if the study accepts one; pictures and stability also accept a mesh file
    scene: Option<PathBuf>,
    /// Write the CSV, charts and findings to this folder; existing measurements are kept
    #[arg(long, short)]
    out: PathBuf,
    /// Measure few and small points: seconds instead of minutes
    #[arg(long)]
    quick: bool,
    /// Print the list of files on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Runs a study; Ctrl-C ends it early and keeps the measurements, a second one aborts.
pub fn run(gpu: &Gpu, arguments: &StudyArguments) -> anyhow::Result<Outcome> {
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(palpate::Error::io(out))?;
    let stop = Arc::new(AtomicBool::new(false));
    let pressed = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if pressed.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        super::print_notes(&["stopping after this point; the measurements are kept".to_owned()]);
    })?;
    let studies = STUDIES.iter().filter(|(name, ..)| *name == arguments.what);
    for (_, _, study) in studies {
        progress::with_stages(|progress| {
            study(
                &Run {
                    gpu,
                    dir: out,
                    quick: arguments.quick,
                    // It is cancelled by `stop`.
                    progress: &|what, share| {
                        let _ = progress(what, share);
                    },
                    note: &|text| super::print_notes(&[text.to_owned()]),
                    stop: &stop,
                },
                arguments.scene.as_deref(),
            )
        })?;
    }
    if arguments.json {
        print_json(&json!({
            "study": arguments.what,
            "adapter": gpu.adapter_name(),
            "ended_early": stop.load(Ordering::Relaxed),
            "files": files(out)?,
        }))?;
    }
    Ok(Outcome::Done)
}

/// Returns the sorted names of the files in a folder.
fn files(folder: &Path) -> palpate::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(palpate::Error::io(folder))? {
        let name = entry.map_err(palpate::Error::io(folder))?.file_name();
        names.push(name.to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}
