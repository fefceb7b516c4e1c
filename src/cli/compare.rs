//! `palpate compare A B`: compares two images, for regression tests of renderings.

use super::{Outcome, print_json};
use clap::Args;
use palpate::render::{Image, ImageDifference};
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `compare`. Tolerances are in steps of an 8-bit channel, 1/255.
#[derive(Args)]
pub struct CompareArguments {
    /// First picture (PNG or EXR)
    a: PathBuf,
    /// Second picture, of the same size
    b: PathBuf,
    /// Set the largest root mean square difference, in 1/255
    #[arg(long, default_value_t = 0.5)]
    rmse: f64,
    /// Set the largest 99.9th percentile of the differences, in 1/255
    #[arg(long, default_value_t = 2.0)]
    percentile: f64,
    /// Write a picture of the differences, amplified 16 times
    #[arg(long)]
    diff: Option<PathBuf>,
    /// Print the differences on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Compares two images: exit code 0 within the tolerances, 1 otherwise.
pub fn run(arguments: &CompareArguments) -> anyhow::Result<Outcome> {
    let a = Image::read_for_comparison(&arguments.a)?;
    let b = Image::read_for_comparison(&arguments.b)?;
    let difference = ImageDifference::between(&a, &b)?;
    if let Some(path) = &arguments.diff {
        ImageDifference::difference_image(&a, &b, 16.0)?.save(path)?;
    }
    let same = difference.within(arguments.rmse / 255.0, arguments.percentile / 255.0);
    if arguments.json {
        print_json(&difference)?;
    } else {
        writeln!(
            std::io::stdout().lock(),
            "{difference}: {}",
            if same { "same" } else { "different" }
        )?;
    }
    Ok(if same {
        Outcome::Done
    } else {
        Outcome::Negative
    })
}
