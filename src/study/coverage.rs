//! `study coverage`: whether the intervals of `palpate identify` hold the true values, for twins: bodies on
//! another mesh whose displacements are measured with noise, from fixed seeds.

use super::{Axis, Cell, Chart, Row, Run, Series, SeriesStyle};
use crate::identify::{Experiment, IdentifyOptions, Unknown, identify, predicted};
use crate::random::Random;
use crate::scene::Scene;
use crate::{Result, no_progress};
use glam::DVec3;
use statrs::distribution::{ContinuousCDF, Normal};
use std::path::Path;

/// Twins with the same body, which differ in their noise.
const DRAWS: usize = 5;
/// Quadratic tets of twins and of the body that is identified.
const TWIN_TETS: usize = 1_500;
const BODY_TETS: usize = 300;
/// Poisson's ratio of both.
const POISSON: f64 = 0.4;
/// Bounds of the sideways gravity of twins, m/s²; the other component is that of the scene.
const SIDEWAYS: [f64; 2] = [1.0, 3.0];
/// Points that are measured.
const POINTS: usize = 12;

/// The law of twins, and how exactly they are measured.
struct Subject {
    name: &'static str,
    model: &'static str,
    /// Bounds of Young's modulus, Pa.
    young: [f64; 2],
    /// The weight at the lower end of the bar, kg.
    weight: f64,
    /// Standard deviation of the noise over the largest displacement, as stated.
    noise: f64,
}

/// Noise larger than the errors of the meshes, by the law of the scene; and a weight and a noise that let another
/// law be seen.
const SUBJECTS: [Subject; 2] = [
    Subject {
        name: "same law",
        model: "neo-hookean",
        young: [3e4, 1e5],
        weight: 1.0,
        noise: 0.1,
    },
    Subject {
        name: "other law",
        model: "corotated",
        young: [3e4, 6e4],
        weight: 3.0,
        noise: 0.005,
    },
];

/// A bar that hangs from its upper end and leans.
struct Twin {
    /// Young's modulus, Pa, and the sideways gravity, m/s².
    truth: [f64; 2],
    /// Points and displacements without noise, m, of the bare bar and of that with a weight.
    points: [Vec<(DVec3, DVec3)>; 2],
}

fn bar(tets: usize, model: &str, [young, sideways]: [f64; 2]) -> Result<Scene> {
    Scene::parse(&format!(
        "[mesh]\ngenerate = \"bar\"\ntets = {tets}\n[material]\nmodel = \"{model}\"\nyoung = {young}\n\
         poisson = {POISSON}\ndensity = 1000\norder = 2\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\n\
         gravity = [9.81, {sideways}, 0.0]\n[[pin]]\naxis = \"x\"\nbelow = 0.001"
    ))
}

/// Returns twin `number` of a subject.
fn twin(run: &Run, subject: &Subject, number: usize) -> Result<Twin> {
    let mut random = Random::new(1000 + number as u64);
    let [low, high] = subject.young.map(f64::ln);
    let young = (low + (high - low) * random.next()).exp();
    let sideways = SIDEWAYS[0] + (SIDEWAYS[1] - SIDEWAYS[0]) * random.next();
    let scene = bar(TWIN_TETS, subject.model, [young, sideways])?;
    let (low, high) = scene.mesh.load()?.bounds();
    let place = |random: &mut Random| {
        let share = 0.5 + 0.45 * random.point();
        low + share * (high - low)
    };
    let points: Vec<(DVec3, DVec3)> = (0..POINTS)
        .map(|_| (place(&mut random), DVec3::X))
        .collect();
    let numbers = predicted(
        run.gpu,
        &scene,
        &experiments(&[points.clone(), points.clone()], subject.weight)?,
    )?;
    let mut moved = numbers.as_chunks::<3>().0.iter();
    let points = [&points, &points].map(|points| {
        let own = points.iter().zip(moved.by_ref());
        own.map(|((at, _), u)| (*at, DVec3::from(*u))).collect()
    });
    Ok(Twin {
        truth: [young, sideways],
        points,
    })
}

/// Returns the measurements of a bare bar and of one with a weight.
fn experiments([bare, loaded]: &[Vec<(DVec3, DVec3)>; 2], weight: f64) -> Result<Vec<Experiment>> {
    let weight = format!("[[mass]]\non = {{ x_above = 0.119 }}\nkg = {weight}");
    let weight = Scene::parse(&format!("[mesh]\ngenerate = \"bar\"\n{weight}"))?.mass;
    Ok(vec![
        Experiment::displacements("bare", bare)?,
        Experiment::displacements("with a weight", loaded)?.with_masses(&weight),
    ])
}

impl Twin {
    /// Returns its measurements with noise of a standard deviation relative to the largest displacement.
    fn measured(&self, subject: &Subject, random: &mut Random) -> Result<Vec<Experiment>> {
        let normal = Normal::standard();
        let mut draw = || normal.inverse_cdf(random.next().clamp(1e-12, 1.0 - 1e-12));
        let noisy = self.points.each_ref().map(|points| {
            let lengths = points.iter().map(|(_, u)| u.length());
            let deviation = subject.noise * lengths.fold(0.0, f64::max);
            let points = points.iter().map(|(at, u)| {
                let noise = DVec3::new(draw(), draw(), draw());
                (*at, *u + deviation * noise)
            });
            points.collect()
        });
        experiments(&noisy, subject.weight)
    }
}

/// Returns for the modulus and the sideways gravity the value and its interval over the true one, and whether
/// the interval and a tenth of it hold the true one; the misfit, whether it is flagged, and the error of the mesh.
fn identified(run: &Run, subject: &Subject, twin: &Twin, seed: u64) -> Result<Vec<Cell>> {
    let data = twin.measured(subject, &mut Random::new(seed))?;
    let names = ["material.young", "gravity.y"].map(Unknown::parse);
    let options = IdentifyOptions {
        unknowns: names.into_iter().collect::<Result<Vec<_>>>()?.concat(),
        noise: Some(subject.noise),
        ..IdentifyOptions::default()
    };
    let first = bar(BODY_TETS, "neo-hookean", [subject.young[1], SIDEWAYS[0]])?;
    let found = identify(
        run.gpu,
        &first,
        &data,
        &options,
        &mut |_| Ok(()),
        &no_progress,
    )?;
    let mut numbers = Vec::new();
    for (own, truth) in found.unknowns.iter().zip(twin.truth) {
        let holds = |part: f64| {
            let [low, high] = [own.low, own.high].map(|end| own.value + part * (end - own.value));
            f64::from(u8::from((low..=high).contains(&truth)))
        };
        let over = [own.value, own.low, own.high].map(|x| x / truth);
        numbers.extend(over);
        numbers.extend([holds(1.0), holds(0.1)]);
    }
    let errors = found.discretisation_errors.iter().flatten();
    numbers.extend([
        found.misfit,
        f64::from(u8::from(found.is_misfit)),
        errors.fold(0.0, |most: f64, error| most.max(*error)),
    ]);
    let rounded = numbers.into_iter();
    let rounded = rounded.map(|x| Cell::from(super::csv_table::significant(x, 6)));
    Ok(rounded.collect())
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
            "young",
            "young_low",
            "young_high",
            "young_holds",
            "young_tenth_holds",
            "gravity",
            "gravity_low",
            "gravity_high",
            "gravity_holds",
            "gravity_tenth_holds",
            "misfit",
            "flagged",
            "mesh_error",
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
    sorted.sort_by(|a, b| a.number("young").total_cmp(&b.number("young")));
    let points = |what: &str| -> Vec<[f64; 2]> {
        let numbers = sorted.iter().enumerate();
        numbers
            .map(|(n, row)| [n as f64, row.number(what)])
            .collect()
    };
    let band: Vec<[f64; 2]> = points("young_low")
        .into_iter()
        .chain(points("young_high").into_iter().rev())
        .collect();
    let most = sorted.len().saturating_sub(1) as f64;
    Chart {
        title: format!("Modulus over the true one, {}", subject.name),
        x: Axis::linear("twin, in the order of the modulus found"),
        y: Axis::linear("over the true modulus"),
        series: vec![
            Series::new("90 % interval", SeriesStyle::Band, band),
            Series::new("found", SeriesStyle::Marks, points("young")),
            Series::new("true", SeriesStyle::Line, vec![[0.0, 1.0], [most, 1.0]]),
        ],
    }
}

fn describe(rows: &[Row]) -> String {
    let mut text = format!(
        "Bars that hang from one end and lean, of {TWIN_TETS} quadratic tets, are measured: the displacements of {POINTS} points, bare and with a weight at the lower end, with noise relative to the largest. `palpate identify` finds Young's modulus and the sideways component of gravity with bars of {BODY_TETS} quadratic tets and the Neo-Hookean law. {DRAWS} twins each share a body and differ in their noise. Intervals are of 90 %; a tenth as wide they must fail.\n\n\
         | twins | law | moduli, kPa | weight, kg | noise | number | misfit flagged | hold the modulus | hold gravity | a tenth as wide |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
    );
    for subject in &SUBJECTS {
        let own = of(rows, subject);
        let sum = |what: &str| own.iter().map(|row| row.number(what)).sum::<f64>();
        text += &format!(
            "| {} | {} | {} to {} | {} | {} % | {} | {} | {} | {} | {}, {} |\n",
            subject.name,
            subject.model,
            1e-3 * subject.young[0],
            1e-3 * subject.young[1],
            subject.weight,
            100.0 * subject.noise,
            own.len(),
            sum("flagged"),
            sum("young_holds"),
            sum("gravity_holds"),
            sum("young_tenth_holds"),
            sum("gravity_tenth_holds"),
        );
    }
    text
}
