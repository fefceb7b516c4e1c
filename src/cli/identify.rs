//! `palpate identify`: material parameters from measurements.

use super::{Outcome, print_json, print_notes, progress};
use clap::Args;
use palpate::gpu::Gpu;
use palpate::identify::{
    Experiment, Identified, IdentifyOptions, IdentifyStep, Residual, Unknown, identify,
};
use palpate::io::atomic_write;
use palpate::number_format::rounded;
use palpate::scene::Scene;
use palpate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `identify`.
#[derive(Args)]
pub struct IdentifyArguments {
    /// Scene (.toml) of the body, or a mesh
    scene: PathBuf,
    /// Read measurements: the folder of `palpate press`, press.csv with press.json, map.csv with map.json,
    /// a recording of markers (.toml, docs/identify.md); several for several experiments
    #[arg(long, required = true, num_args = 1.., value_name = "DATA")]
    data: Vec<PathBuf>,
    /// Name the unknowns: material.young, material.TISSUE.young, material.poisson,
    /// material.TISSUE.poisson, material.density, material.TISSUE.density, material.damping_ratio, or lump,
    /// a ball with another stiffness. Without any, measured and predicted numbers are compared
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
    let options = IdentifyOptions {
        unknowns: unknowns(arguments)?,
        noise: arguments.noise,
        starts: arguments.starts,
        advise: !arguments.no_advice,
    };
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let mut on_step = |step: &IdentifyStep| {
        print_notes(&[in_words(step, &options)]);
        Ok(())
    };
    let found = progress::with_stages(|progress| {
        identify(gpu, &scene, &data, &options, &mut on_step, progress)
    })?;
    found.write(&arguments.scene, &out.join("identified.toml"))?;
    write_json(out, &found)?;
    write_residuals(out, &found.residuals)?;
    draw_chart(out, &found)?;
    print_notes(&found.sentences);
    print_notes(&[format!(
        "wrote {0}/identified.toml, {0}/identified.json, {0}/residuals.csv and {0}/residuals.svg",
        out.display()
    )]);
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
    format!(
        "{start}step {}: misfit {misfit}; {}",
        step.step,
        values.join(", ")
    )
}

fn write_json(out: &Path, found: &Identified) -> Result<()> {
    let path = out.join("identified.json");
    atomic_write(&path, |file| {
        let text = serde_json::to_string_pretty(found);
        let text = text.map_err(|e| Error::Input(format!("identified.json: {e}")))?;
        writeln!(file, "{text}").map_err(Error::io(&path))
    })
}

fn write_residuals(out: &Path, residuals: &[Residual]) -> Result<()> {
    let path = out.join("residuals.csv");
    atomic_write(&path, |file| {
        let mut text =
            String::from("experiment,quantity,x,y,z,depth_m,measured,predicted,residual\n");
        for row in residuals {
            let [x, y, z] = row.at;
            text += &format!(
                "\"{}\",{},{x},{y},{z},{},{},{},{}\n",
                row.experiment.replace('"', "\"\""),
                row.quantity,
                row.depth_m,
                row.measured,
                row.predicted,
                row.residual
            );
        }
        file.write_all(text.as_bytes()).map_err(Error::io(&path))
    })
}

/// Draws measured and predicted forces against depth; where there are none, predicted against measured
/// numbers.
#[cfg(feature = "study")]
fn draw_chart(out: &Path, found: &Identified) -> Result<()> {
    use palpate::study::{Axis, Chart, Series, SeriesStyle};
    let are_forces = |row: &&Residual| row.quantity == "force";
    let has_curve = found.residuals.iter().any(|row| are_forces(&row));
    let mut series = Vec::new();
    let mut names: Vec<&str> = found
        .residuals
        .iter()
        .map(|row| row.experiment.as_str())
        .collect();
    names.dedup();
    for (k, name) in names.iter().enumerate() {
        let own = || found.residuals.iter().filter(|row| row.experiment == *name);
        if !has_curve {
            series.push(Series::new(
                format!("experiment {}", k + 1),
                SeriesStyle::Marks,
                own().map(|row| [row.measured, row.predicted]).collect(),
            ));
            continue;
        }
        let rows = || own().filter(are_forces);
        let measured = rows()
            .map(|row| [1e3 * row.depth_m, row.measured])
            .collect();
        let predicted = rows()
            .map(|row| [1e3 * row.depth_m, row.predicted])
            .collect();
        series.push(Series::new(
            format!("measured {}", k + 1),
            SeriesStyle::Marks,
            measured,
        ));
        series.push(Series::new(
            format!("predicted {}", k + 1),
            SeriesStyle::Line,
            predicted,
        ));
    }
    if !has_curve {
        let measured = found.residuals.iter().map(|row| row.measured);
        let [low, high] = measured.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
            [low.min(x), high.max(x)]
        });
        let equal = vec![[low, low], [high, high]];
        series.push(Series::new("equal".to_owned(), SeriesStyle::Line, equal));
    }
    let values = found.unknowns.iter();
    let values: Vec<String> = values
        .map(|value| {
            let number = rounded(value.value, 4);
            format!("{} = {number} {}", value.name, value.unit)
        })
        .collect();
    let is_map = |row: &Residual| row.quantity == "stiffness";
    let [x, y] = match has_curve {
        true => ["depth, mm", "force, N"],
        false if found.residuals.iter().all(is_map) => {
            ["measured stiffness, N/m", "predicted stiffness, N/m"]
        }
        false => ["measured", "predicted"],
    };
    Chart {
        title: match values.is_empty() {
            true => "measured and predicted numbers".to_owned(),
            false => values.join(", "),
        },
        x: Axis::linear(x),
        y: Axis::linear(y),
        series,
    }
    .save(out, "residuals")
}

/// Charts need the feature `study`.
#[cfg(not(feature = "study"))]
fn draw_chart(_: &Path, _: &Identified) -> Result<()> {
    Ok(())
}
