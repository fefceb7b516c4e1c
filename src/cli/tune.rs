//! `palpate tune`: searches for the cheapest settings of a scene within an error tolerance.

use super::refinement::{WithinFlags, in_words};
use super::{Outcome, print_json, progress};
use clap::Args;
use palpate::accuracy::Round;
use palpate::gpu::Gpu;
use palpate::scene::Scene;
use palpate::tune::{SearchResult, TuneTarget, tune_file};
use serde_json::{Value, json};
use std::fmt::Display;
use std::path::PathBuf;

/// Arguments of `tune`.
#[derive(Args)]
pub struct TuneArguments {
    /// Scene (.toml) with a tetrahedral body
    scene: PathBuf,
    /// Set the largest error of motion and of picture: 1%, or 0.01
    #[arg(long, value_parser = share, default_value = "1%")]
    error: f64,
    /// Set the frame rate at which the simulation runs in real time, 1/s
    #[arg(long)]
    fps: Option<f64>,
    /// Set the simulated duration compared with the reference solution, s
    #[arg(long, default_value_t = 0.5)]
    seconds: f64,
    /// Write the scene with the chosen settings to this file; with --within, its mesh beside it (.vtu)
    #[arg(long, short)]
    out: PathBuf,
    #[command(flatten)]
    accuracy: WithinFlags,
    /// Print the report on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Tunes a scene; exit code 1 if no settings meet the target, and the best ones are written.
pub fn run(gpu: &Gpu, arguments: &TuneArguments) -> anyhow::Result<Outcome> {
    let mut scene = Scene::read(&arguments.scene)?;
    arguments.accuracy.apply_to(&mut scene)?;
    super::print_notes(scene.notes());
    let wanted = TuneTarget {
        error: arguments.error,
        fps: arguments.fps,
        seconds: arguments.seconds,
    };
    let unit = super::refinement::unit(&scene);
    let mut on_round = |round: &Round| super::print_notes(&[in_words(round, unit)]);
    let files = (arguments.scene.as_path(), arguments.out.as_path());
    let tuned = progress::with_stages(|progress| {
        tune_file(gpu, &scene, &wanted, files, &mut on_round, progress)
    })?;
    super::print_notes(&tuned.notes);
    if arguments.json {
        print_json(&json!({
            "met": tuned.target_met,
            "motion": tuned.motion.as_ref().map(found),
            "picture": found(&tuned.picture),
            "notes": tuned.notes,
        }))?;
    }
    Ok(match tuned.target_met {
        true => Outcome::Done,
        false => Outcome::Negative,
    })
}

/// Formats the result of a search for the report.
fn found<P: Display>(found: &SearchResult<P>) -> Value {
    json!({
        "choice": found.point.to_string(),
        "cost_ms": found.cost,
        "error": found.error,
        "met": found.met,
        "candidates": found.tried[0],
        "tried": found.tried[1],
    })
}

/// Parses a fraction as a number, or in per cent.
fn share(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.trim().strip_suffix('%') {
        Some(number) => (number.trim_end(), 0.01),
        None => (text.trim(), 1.0),
    };
    let expected = || format!("expected an error such as 1% or 0.01, got \"{text}\"");
    let number: f64 = number.parse().map_err(|_| expected())?;
    match number.is_finite() && number > 0.0 {
        true => Ok(unit * number),
        false => Err(expected()),
    }
}
