//! `palpate identify`: material parameters from measurements.

#[cfg(feature = "study")]
mod chart;
mod files;

use super::{Outcome, print_json, print_notes, progress};
use clap::Args;
use files::Steps;
use palpate::gpu::Gpu;
use palpate::identify::{Experiment, IdentifyOptions, IdentifyStep, Unknown, identify};
use palpate::number_format::rounded;
use palpate::scene::Scene;
use palpate::{Error, Result};
use std::path::PathBuf;

/// Arguments of `identify`.
#[derive(Args)]
pub struct IdentifyArguments {
    /// Scene (.toml) of the body, or a mesh
    scene: PathBuf,
    /// Read measurements: the folder of `palpate press`, press.csv with press.json, map.csv with map.json,
    /// a recording of markers, or displacements, reactions and volumes at rest (.toml, docs/how-to/identify.md), a
    /// displacement field (.vtu, .nii.gz); several for several experiments
    #[arg(long, required = true, num_args = 1.., value_name = "DATA")]
    data: Vec<PathBuf>,
    /// Name the unknowns: material.young, material.TISSUE.young, material.poisson,
    /// material.TISSUE.poisson, material.density, material.TISSUE.density, material.damping_ratio,
    /// gravity.x (y, z), pressure.N, tool.NAME.friction, finger.x (y, z: how far the fingertip was from the
    /// stated places), lump, a ball with another stiffness, or stiffness:cage:LENGTH, a stiffness that varies on
    /// a grid of that cell size (8mm; with :piecewise for sharp edges). Without any, measured and predicted numbers are compared
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    unknown: Vec<String>,
    /// Set the standard deviation of the measured numbers, such as 2%: of a curve relative to its largest
    /// force, of a map relative to each stiffness, of displacements relative to the largest [default: estimated from the residuals]
    #[arg(long, value_parser = share, value_name = "PERCENT")]
    noise: Option<f64>,
    /// Set the bounds of an unknown: NAME=LOW..HIGH
    #[arg(long, value_delimiter = ',', value_name = "NAME=LOW..HIGH")]
    bounds: Vec<String>,
    /// Set the first value of an unknown [default: that of the scene]: NAME=VALUE
    #[arg(long, value_delimiter = ',', value_name = "NAME=VALUE")]
    first: Vec<String>,
    /// Start from so many values, because there may be several optima
    #[arg(long, default_value_t = 1)]
    starts: u32,
    /// Correct the forces of linear tets by those of quadratic ones, so many times: at the first values, then at
    /// those found. Each costs one prediction by quadratic tets, instead of all
    #[arg(long, default_value_t = 0, value_name = "TIMES")]
    correct: u32,
    /// Find the intervals of these unknowns by profile likelihood, for skewed ones; it takes several
    /// predictions for each end. all: of all but the places of a grid
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    profile: Vec<String>,
    /// Do not look for the further press that would tell most
    #[arg(long)]
    no_advice: bool,
    /// Write the results to this folder
    #[arg(long, short, default_value = "identified")]
    out: PathBuf,
    /// Print identified.json on standard output
    #[arg(long)]
    json: bool,
}

/// Identifies unknowns; exit code 1 if the scene does not explain the data.
pub fn run(gpu: &Gpu, arguments: &IdentifyArguments) -> anyhow::Result<Outcome> {
    let scene = Scene::read(&arguments.scene)?;
    print_notes(scene.notes());
    let data = arguments.data.iter().map(Experiment::read);
    let data = data.collect::<Result<Vec<_>>>()?.concat();
    let mut options = IdentifyOptions {
        unknowns: unknowns(arguments)?,
        noise: arguments.noise,
        starts: arguments.starts,
        profiled: arguments.profile.clone(),
        advise: !arguments.no_advice,
        corrections: arguments.correct,
        ..IdentifyOptions::default()
    };
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let mut steps = Steps::open(out, (&scene, &data), &options);
    options.earlier = steps.last().to_vec();
    if let Some(last) = options.earlier.last() {
        print_notes(&[format!(
            "going on from step {} of start {} in {}",
            last.step,
            last.start,
            out.display()
        )]);
    }
    let wanted = options.clone();
    let mut on_step = |step: &IdentifyStep| {
        print_notes(&[in_words(step, &wanted)]);
        steps.keep(step)
    };
    let found = progress::with_stages(|progress| {
        identify(gpu, &scene, &data, &options, &mut on_step, progress)
    })?;
    found.write(&arguments.scene, &out.join("identified.toml"))?;
    files::write_json(out, &found)?;
    files::write_residuals(out, &found.residuals)?;
    #[cfg(feature = "study")]
    chart::draw_chart(out, &found)?;
    let mut written = vec!["identified.toml", "identified.json", "residuals.csv"];
    written.extend(cfg!(feature = "study").then_some("residuals.svg"));
    let images = found.field_images(gpu)?;
    let mut names: Vec<String> = written.into_iter().map(str::to_owned).collect();
    for (name, image) in &images {
        let file = format!("{name}.png");
        image.save(out.join(&file))?;
        names.push(file);
    }
    steps.remove()?;
    print_notes(&found.sentences);
    print_notes(&[format!("wrote {} to {}", names.join(", "), out.display())]);
    if arguments.json {
        print_json(&serde_json::to_value(&found)?)?;
    }
    Ok(match found.is_misfit || !found.converged {
        true => Outcome::Negative,
        false => Outcome::Done,
    })
}

/// Returns the unknowns with their bounds and first values.
fn unknowns(arguments: &IdentifyArguments) -> Result<Vec<Unknown>> {
    let parsed = arguments.unknown.iter().map(|name| Unknown::parse(name));
    let mut all = parsed.collect::<Result<Vec<_>>>()?.concat();
    let named = |flag: &str, text: &str| -> Result<(usize, String)> {
        let (name, value) = text.split_once('=').ok_or_else(|| {
            Error::Input(format!("{flag} needs a name and a value, got \"{text}\""))
        })?;
        let found = all.iter().position(|unknown| unknown.name == name.trim());
        let k = found.ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|unknown| unknown.name.as_str()).collect();
            Error::Input(format!(
                "{flag} {name} is no unknown; they are {}",
                names.join(", ")
            ))
        })?;
        Ok((k, value.trim().to_owned()))
    };
    let mut bounds = Vec::new();
    for text in &arguments.bounds {
        bounds.push(named("--bounds", text)?);
    }
    let mut firsts = Vec::new();
    for text in &arguments.first {
        firsts.push(named("--first", text)?);
    }
    let number = |text: &str| -> Result<f64> {
        let wrong = |_| Error::Input(format!("expected a number, got \"{text}\""));
        text.trim().parse().map_err(wrong)
    };
    for (k, text) in bounds {
        let (low, high) = text.split_once("..").ok_or_else(|| {
            Error::Input(format!(
                "--bounds needs LOW..HIGH, such as 1e3..1e5, got \"{text}\""
            ))
        })?;
        all[k].bounds = Some([number(low)?, number(high)?]);
    }
    for (k, text) in firsts {
        all[k].first = Some(number(&text)?);
    }
    Ok(all)
}

/// Parses a fraction as a number, or in per cent.
fn share(text: &str) -> std::result::Result<f64, String> {
    palpate::scene::AccuracyEntry::parse_share(text).map_err(|e| e.to_string())
}

/// Says a step in a line.
fn in_words(step: &IdentifyStep, options: &IdentifyOptions) -> String {
    let (nodes, others): (Vec<_>, Vec<_>) = step
        .values
        .iter()
        .partition(|(name, _)| name.starts_with("stiffness."));
    let mut values: Vec<String> = others
        .iter()
        .map(|(name, value)| format!("{name} {}", rounded(*value, 5)))
        .collect();
    let factors = || nodes.iter().map(|(_, factor)| *factor);
    if let (Some(least), Some(most)) = (
        factors().min_by(f64::total_cmp),
        factors().max_by(f64::total_cmp),
    ) {
        let (least, most) = (rounded(least, 3), rounded(most, 3));
        values.push(format!("stiffness {least} to {most} times"));
    }
    let start = match options.starts > 1 {
        true => format!("start {}, ", step.start),
        false => String::new(),
    };
    let misfit = match options.noise {
        Some(_) => format!("{} times the noise", rounded(step.misfit, 3)),
        None => format!("{} %", rounded(step.misfit, 3)),
    };
    let correction = match step.corrections {
        0 => String::new(),
        times => format!("correction {times}, "),
    };
    format!(
        "{start}{correction}step {}: misfit {misfit}; {}",
        step.step,
        values.join(", ")
    )
}
