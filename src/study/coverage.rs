//! `study coverage`: whether the intervals of `palpate identify` hold the true values, for twins: bodies on
//! another mesh that are pressed, with noise, from fixed seeds.

use super::random::Random;
use super::{Axis, Cell, Chart, Row, Run, Series, SeriesStyle};
use crate::identify::{Experiment, IdentifyOptions, Unknown, identify, predicted};
use crate::scene::Scene;
use crate::{Result, no_progress};
use glam::DVec3;
use statrs::distribution::{ContinuousCDF, Normal};
use std::path::Path;

/// Twins with the same body, which differ in their noise.
const DRAWS: usize = 5;
/// Quadratic tets of twins and of the body that is identified.
const TWIN_TETS: usize = 4_000;
const BODY_TETS: usize = 1_000;
/// Poisson's ratio of both, and bounds of the modulus of twins, Pa.
const POISSON: f64 = 0.4;
const YOUNG: [f64; 2] = [5e3, 5e4];
/// Edge of the block, m.
const EDGE: f64 = 0.1;
/// Depths of a curve over the largest.
const STEPS: usize = 8;

/// The law of twins, and what is measured of them.
struct Subject {
    name: &'static str,
    model: &'static str,
    /// Standard deviation of the noise over the largest force, as stated.
    noise: f64,
    /// Largest depth, m.
    depth: f64,
}

/// Noise larger than the errors of the meshes, by the law of the scene; and a noise that lets another law be
/// seen.
const SUBJECTS: [Subject; 2] = [
    Subject {
        name: "same law",
        model: "neo-hookean",
        noise: 0.1,
        depth: 0.01,
    },
    Subject {
        name: "other law",
        model: "corotated",
        noise: 0.01,
        depth: 0.025,
    },
];

/// A pressed block.
struct Twin {
    young: f64,
    curves: Vec<Curve>,
}

struct Curve {
    at: DVec3,
    radius: f64,
    /// Depths and forces without noise, m and N.
    samples: Vec<[f64; 2]>,
}

fn block(tets: usize, (model, young): (&str, f64)) -> Result<Scene> {
    Scene::parse(&format!(
        "[mesh]\ngenerate = \"box\"\ntets = {tets}\n[material]\nmodel = \"{model}\"\nyoung = {young}\n\
         poisson = {POISSON}\norder = 2\n[solver]\nengine = \"cpu\""
    ))
}

/// Returns twin `number`, pressed at two places.
fn twin(run: &Run, subject: &Subject, number: usize) -> Result<Twin> {
    let mut random = Random::new(1000 + number as u64);
    let [low, high] = YOUNG.map(f64::ln);
    let young = (low + (high - low) * random.next()).exp();
    let mut curves = Vec::new();
    for _ in 0..2 {
        let aside = 0.2 * EDGE * random.point();
        let depth = subject.depth * (0.7 + 0.3 * random.next());
        let depths = (1..=STEPS).map(|k| depth * k as f64 / STEPS as f64);
        curves.push(Curve {
            at: DVec3::new(0.5 * EDGE + aside.x, 0.5 * EDGE + aside.y, EDGE),
            radius: EDGE * random.pick(&[0.25, 0.3, 0.35]),
            samples: depths.map(|depth| [depth, 1.0]).collect(),
        });
    }
    let scene = block(TWIN_TETS, (subject.model, young))?;
    let data: Vec<Experiment> = curves
        .iter()
        .map(Curve::experiment)
        .collect::<Result<_>>()?;
    let mut forces = predicted(run.gpu, &scene, &data)?.into_iter();
    for sample in curves.iter_mut().flat_map(|curve| &mut curve.samples) {
        sample[1] = forces.next().unwrap_or(f64::NAN);
    }
    Ok(Twin { young, curves })
}

impl Curve {
    fn experiment(&self) -> Result<Experiment> {
        Experiment::curve("twin", (self.at, DVec3::NEG_Z, self.radius), &self.samples)
    }

    /// Returns the curve with noise of a standard deviation relative to its largest force.
    fn with_noise(&self, noise: f64, random: &mut Random) -> Curve {
        let largest = self.samples.iter().map(|s| s[1]).fold(0.0, f64::max);
        let normal = Normal::standard();
        let samples = self.samples.iter().map(|[depth, force]| {
            let deviation = normal.inverse_cdf(random.next().clamp(1e-12, 1.0 - 1e-12));
            [*depth, force + noise * largest * deviation]
        });
        Curve {
            samples: samples.collect(),
            ..*self
        }
    }
}

/// Returns the modulus with its interval over the true one, the misfit, whether it is flagged, the
/// discretisation error, and whether the interval and a tenth of it hold the true one.
fn identified(run: &Run, subject: &Subject, twin: &Twin, seed: u64) -> Result<Vec<Cell>> {
    let mut random = Random::new(seed);
    let data = twin.curves.iter();
    let data = data.map(|curve| curve.with_noise(subject.noise, &mut random).experiment());
    let data: Vec<Experiment> = data.collect::<Result<_>>()?;
    let options = IdentifyOptions {
        unknowns: Unknown::parse("material.young")?,
        noise: Some(subject.noise),
        ..IdentifyOptions::default()
    };
    let scene = block(BODY_TETS, ("neo-hookean", 1e4))?;
    let found = identify(
        run.gpu,
        &scene,
        &data,
        &options,
        &mut |_| Ok(()),
        &no_progress,
    )?;
    let young = &found.unknowns[0];
    let [value, low, high] = [young.value, young.low, young.high].map(|x| x / twin.young);
    let tenth = [low, high].map(|end| value * (end / value).powf(0.1));
    let holds = |low: f64, high: f64| f64::from(u8::from((low..=high).contains(&1.0)));
    let errors = found.discretisation_errors.iter().flatten();
    let error = errors.fold(0.0, |most: f64, error| most.max(*error));
    let numbers = [
        value,
        low,
        high,
        found.misfit,
        f64::from(u8::from(found.is_misfit)),
        error,
        holds(low, high),
        holds(tenth[0], tenth[1]),
    ];
    Ok(numbers
        .map(|x| Cell::from(super::csv_table::significant(x, 6)))
        .to_vec())
}

/// Measures, draws charts and reports.
pub(super) fn run(run: &Run, _: Option<&Path>) -> Result<()> {
    let count = match run.quick {
        true => 10,
        false => 100,
    };
    let names: Vec<usize> = (0..SUBJECTS.len()).collect();
    let points = names
        .iter()
        .flat_map(|k| (0..count).map(move |n| vec![Cell::from(SUBJECTS[*k].name), n.into()]));
    let points: Vec<Vec<Cell>> = points.collect();
    let mut made: Option<(&str, usize, Twin)> = None;
    let rows = run.measure(
        "coverage",
        &["twins", "number"],
        &[
            "value",
            "low",
            "high",
            "misfit",
            "flagged",
            "mesh_error",
            "holds",
            "tenth_holds",
        ],
        &points,
        |point| {
            let subject = SUBJECTS.iter().find(|own| own.name == point[0].text());
            let subject = subject.unwrap_or(&SUBJECTS[0]);
            let number = point[1].number() as usize;
            let body = number / DRAWS;
            if made
                .as_ref()
                .is_none_or(|(name, n, _)| (*name, *n) != (subject.name, body))
            {
                made = Some((subject.name, body, twin(run, subject, body)?));
            }
            match &made {
                Some((.., twin)) => identified(run, subject, twin, 5000 + number as u64),
                None => Ok(Vec::new()),
            }
        },
    )?;
    let mut charts = Vec::new();
    for subject in &SUBJECTS {
        let name = format!("coverage-{}", subject.name.replace(' ', "-"));
        chart(&of(&rows, subject), subject).save(run.dir, &name)?;
        charts.push(name);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    run.write_findings(
        "coverage",
        "Intervals of identified moduli",
        &describe(&rows),
        &charts,
    )
}

fn of<'a>(rows: &'a [Row], subject: &Subject) -> Vec<&'a Row> {
    let own = rows.iter().filter(|row| row.text("twins") == subject.name);
    own.collect()
}

/// Charts the intervals over the true values, in the order of the values.
fn chart(rows: &[&Row], subject: &Subject) -> Chart {
    let mut sorted = rows.to_vec();
    sorted.sort_by(|a, b| a.number("value").total_cmp(&b.number("value")));
    let points = |what: &str| -> Vec<[f64; 2]> {
        let numbers = sorted.iter().enumerate();
        numbers
            .map(|(n, row)| [n as f64, row.number(what)])
            .collect()
    };
    let band: Vec<[f64; 2]> = points("low")
        .into_iter()
        .chain(points("high").into_iter().rev())
        .collect();
    let most = sorted.len().saturating_sub(1) as f64;
    Chart {
        title: format!("Modulus over the true one, {}", subject.name),
        x: Axis::linear("twin, in the order of the modulus found"),
        y: Axis::linear("over the true modulus"),
        series: vec![
            Series::new("90 % interval", SeriesStyle::Band, band),
            Series::new("found", SeriesStyle::Marks, points("value")),
            Series::new("true", SeriesStyle::Line, vec![[0.0, 1.0], [most, 1.0]]),
        ],
    }
}

fn describe(rows: &[Row]) -> String {
    let mut text = format!(
        "Blocks of {:.0} cm with moduli of {} to {} kPa, of {TWIN_TETS} quadratic tets, are pressed at two places with fingertips of 25 to 35 mm; the forces at {STEPS} depths of each get noise. `palpate identify` finds the modulus with a block of {BODY_TETS} quadratic tets and the Neo-Hookean law. {DRAWS} twins each share a body and differ in their noise.\n\n\
         | twins | law | noise | depth, mm | number | misfit flagged | intervals that hold the true modulus | a tenth as wide |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n",
        100.0 * EDGE,
        1e-3 * YOUNG[0],
        1e-3 * YOUNG[1],
    );
    for subject in &SUBJECTS {
        let own = of(rows, subject);
        let sum = |what: &str| own.iter().map(|row| row.number(what)).sum::<f64>();
        text += &format!(
            "| {} | {} | {} % | {} | {} | {} | {} | {} |\n",
            subject.name,
            subject.model,
            100.0 * subject.noise,
            1e3 * subject.depth,
            own.len(),
            sum("flagged"),
            sum("holds"),
            sum("tenth_holds"),
        );
    }
    text
}
