//! Time of finite element steps: by material law, integrator and engine against tets; and with an
//! increasingly stiff or rigid rod in the body.
//!
//! The engines use different preconditioners for conjugate gradients: block Jacobi on the GPU;
//! block Jacobi with an additive coarse correction on the CPU: rigid-body modes of node groups, or
//! for quadratic tets the linear tets within them.

use super::{Axis, CPU, Cell, Chart, GPU, Row, Run, Series, SeriesStyle, fit_exponent};
use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::physics::{
    Engine, EngineChoice, Material, MaterialModel, RegionMaterial, Simulator, SolverKind,
    VolumetricFormulation,
};
use crate::scene::median_ms;
use crate::{Error, Result};
use glam::DVec3;

const SETTINGS: [&str; 6] = ["against", "matter", "integrator", "on", "tets", "rod"];
const RESULTS: [&str; 4] = [
    "nodes",
    "iterations_a_step",
    "ms_a_step",
    "off_rigid_percent",
];

/// Size, material and density of the bar, in m, Pa and kg/m³.
const SIZE: DVec3 = DVec3::new(0.8, 0.2, 0.2);
const YOUNG: f64 = 1e6;
const DENSITY: f64 = 1000.0;
const POISSON: f64 = 0.3;
/// Time step of implicit integrators, s.
const STEP: f64 = 0.01;
/// Steps of the bar with a rod.
const STEPS: u32 = 20;

const QUADRATIC: &str = "quadratic tets";

/// Material models, volumetric formulations and orders.
const MATTERS: [(&str, MaterialModel, VolumetricFormulation, ElementOrder); 4] = [
    (
        "neo-hookean",
        MaterialModel::NeoHookean,
        VolumetricFormulation::PerTet,
        ElementOrder::Linear,
    ),
    (
        "corotated",
        MaterialModel::Corotated,
        VolumetricFormulation::PerTet,
        ElementOrder::Linear,
    ),
    (
        "averaged volumes",
        MaterialModel::NeoHookean,
        VolumetricFormulation::NodalAveraged,
        ElementOrder::Linear,
    ),
    (
        QUADRATIC,
        MaterialModel::NeoHookean,
        VolumetricFormulation::PerTet,
        ElementOrder::Quadratic,
    ),
];

/// Measured combinations of material, integrator and engine.
const KINDS: [(&str, SolverKind, &str); 9] = [
    ("neo-hookean", SolverKind::Implicit, CPU),
    ("neo-hookean", SolverKind::Implicit, GPU),
    ("neo-hookean", SolverKind::Bdf2, CPU),
    ("neo-hookean", SolverKind::Midpoint, CPU),
    ("corotated", SolverKind::Implicit, CPU),
    ("averaged volumes", SolverKind::Implicit, CPU),
    (QUADRATIC, SolverKind::Implicit, CPU),
    ("neo-hookean", SolverKind::Symplectic, CPU),
    ("neo-hookean", SolverKind::Symplectic, GPU),
];

/// A rigid rod.
const RIGID: &str = "rigid";

/// Measures the steps and describes the results. Returns the text and the charts' names.
pub(super) fn measure(run: &Run) -> Result<(String, Vec<String>)> {
    let tets: &[usize] = match run.quick {
        true => &[300, 1_000],
        false => &[1_000, 3_000, 10_000, 30_000, 100_000],
    };
    let most_on_gpu = 30_000;
    let mut points: Vec<Vec<Cell>> = Vec::new();
    for tets in tets {
        for (matter, kind, on) in KINDS {
            if matter != QUADRATIC && (on == CPU || *tets <= most_on_gpu) {
                points.push(cells("tets", (matter, kind, on), *tets, "none"));
            }
        }
    }
    // 10,000 to 1,000,000 unknowns.
    let quadratic: &[usize] = match run.quick {
        true => &[300, 1_000],
        false => &[1_800, 6_500, 23_000, 80_000, 225_000],
    };
    for tets in quadratic {
        let how = (QUADRATIC, SolverKind::Implicit, CPU);
        points.push(cells("tets", how, *tets, "none"));
    }
    let rods: &[&str] = match run.quick {
        true => &["1", "1000", RIGID],
        false => &["1", "10", "100", "1000", "10000", "100000", RIGID],
    };
    let size = if run.quick { 1_000 } else { 4_000 };
    for rod in rods {
        for on in [CPU, GPU] {
            let how = ("neo-hookean", SolverKind::Implicit, on);
            points.push(cells("rod", how, size, rod));
        }
    }
    let mut rigid: Option<Vec<DVec3>> = None;
    let rows = run.measure("scaling_steps", &SETTINGS, &RESULTS, &points, |point| {
        step(run.gpu, point, &mut rigid)
    })?;
    let charts = vec![against_tets(run, &rows)?, against_rod(run, &rows)?];
    Ok((finding(&rows), charts))
}

fn cells(
    against: &str,
    (matter, kind, on): (&str, SolverKind, &str),
    tets: usize,
    rod: &str,
) -> Vec<Cell> {
    let names = [against, matter, kind.name(), on].map(Cell::from);
    let mut cells = names.to_vec();
    cells.extend([Cell::from(tets), Cell::from(rod)]);
    cells
}

/// Returns the bar of the point's number of tets, material and integrator, clamped at one end.
fn body(gpu: &Gpu, point: &[Cell], rod: &str, on: &str) -> Result<Box<dyn Simulator>> {
    let mut mesh = with_rod(generate::bar_of_about(point[4].number() as usize, SIZE)?);
    let named = MATTERS.iter().find(|m| m.0 == point[1].text());
    let Some((_, model, volume, order)) = named else {
        return Err(Error::Input(format!(
            "unknown material {} in scaling_steps.csv; use an empty --out folder",
            point[1].text()
        )));
    };
    if *order == ElementOrder::Quadratic {
        mesh = mesh.with_mid_edge_nodes()?;
    }
    let mut material = Material {
        model: *model,
        volume: *volume,
        order: *order,
        poisson: POISSON,
        density: DENSITY,
        region_field: Some("rod".into()),
        ..Material::from_young(YOUNG)
    };
    match rod.parse::<f64>() {
        Ok(factor) => {
            let stiffer = RegionMaterial {
                stiffness: factor * YOUNG,
                density: DENSITY,
                poisson: POISSON,
            };
            material.regions.insert(1, stiffer);
        }
        Err(_) if rod == RIGID => drop(material.rigid.insert(1)),
        Err(_) => material.region_field = None,
    }
    let kind: SolverKind = point[2].text().parse()?;
    let engine = if on == GPU { Engine::Gpu } else { Engine::Cpu };
    let mut body = EngineChoice::Exactly(engine).build_tets(gpu, mesh, &material, kind)?;
    let nodes = (0u32..).zip(&body.mesh().nodes);
    let held: Vec<u32> = nodes.filter(|(_, p)| p.x < 1e-9).map(|(v, _)| v).collect();
    body.pin_nodes(&held)?;
    body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
    Ok(body)
}

/// Labels the core of the bar, from a tenth of its length on, with a quarter of its width and
/// height.
fn with_rod(mut mesh: TetMesh) -> TetMesh {
    let inside = |t: usize| {
        let p = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0 / SIZE;
        let off = (p - 0.5).abs();
        p.x > 0.1 && off.y < 0.25 && off.z < 0.25
    };
    let labels = (0..mesh.tets.len()).map(|t| f64::from(u8::from(inside(t))));
    let field = Field::scalar("rod", Location::Cell, labels.collect());
    mesh.fields.push(field);
    mesh
}

fn step(gpu: &Gpu, point: &[Cell], rigid: &mut Option<Vec<DVec3>>) -> Result<Vec<Cell>> {
    let rod = point[5].text();
    let mut simulator = body(gpu, point, rod, point[3].text())?;
    let limit = simulator.largest_stable_step();
    let h = limit.map_or(STEP, |limit| 0.5 * limit);
    let with_rod = point[0].text() == "rod";
    if !with_rod {
        // The first steps are not representative: the body has hardly deformed.
        simulator.run(3, h)?;
    }
    let repeats = if with_rod { STEPS - 1 } else { 7 };
    let ms = median_ms(repeats, || simulator.run(1, h).map(drop))?;
    let counts = simulator.iterations()?;
    let last = &counts[counts.len().saturating_sub(repeats as usize)..];
    let sum: f64 = last.iter().map(|n| f64::from(*n)).sum();
    let mut off = f64::NAN;
    if with_rod {
        let there = match rigid {
            Some(there) => there,
            None => {
                let mut truth = body(gpu, point, RIGID, CPU)?;
                truth.run(STEPS, STEP)?;
                rigid.insert(truth.positions()?)
            }
        };
        off = 100.0 * l2_distance(&simulator.positions()?, there)
            / l2_distance(&simulator.mesh().nodes, there);
    }
    Ok(vec![
        simulator.mesh().nodes.len().into(),
        (sum / last.len().max(1) as f64).into(),
        ms.into(),
        off.into(),
    ])
}

fn l2_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum();
    sum.sqrt()
}

/// Returns the rows of one combination, or those with a rod.
fn of<'a>(
    rows: &'a [Row],
    against: &'a str,
    (matter, kind, on): (&'a str, SolverKind, &'a str),
) -> impl Iterator<Item = &'a Row> {
    rows.iter().filter(move |r| {
        r.text("against") == against
            && r.text("matter") == matter
            && r.text("integrator") == kind.name()
            && r.text("on") == on
    })
}

fn curve(rows: &[Row], how: (&str, SolverKind, &str)) -> Vec<[f64; 2]> {
    let own = of(rows, "tets", how);
    own.map(|r| [r.number("tets"), r.number("ms_a_step")])
        .collect()
}

fn against_tets(run: &Run, rows: &[Row]) -> Result<String> {
    let mut series = Vec::new();
    for how in KINDS {
        let points = curve(rows, how);
        if let Some(p) = fit_exponent(&points) {
            let name = format!("{}, {}, {}: x^{p:.2}", how.0, how.1, how.2);
            series.push(Series::new(name, SeriesStyle::LineMarks, points));
        }
    }
    let file = "scaling-elements";
    Chart {
        title: "Time of a step of elements against tets".into(),
        x: Axis::log("tets"),
        y: Axis::log("time (ms)"),
        series,
    }
    .save(run.dir, file)?;
    Ok(file.into())
}

fn against_rod(run: &Run, rows: &[Row]) -> Result<String> {
    let mut series = Vec::new();
    for (on, name) in [
        (GPU, "GPU: blocks of the diagonal"),
        (CPU, "CPU: these and rigid motions of groups"),
    ] {
        let how = ("neo-hookean", SolverKind::Implicit, on);
        let mut points = Vec::new();
        let mut rigid = None;
        for row in of(rows, "rod", how) {
            let count = row.number("iterations_a_step");
            // Numeric texts are read back from the CSV as numbers.
            match row.number("rod") {
                factor if factor.is_finite() => points.push([factor, count]),
                _ => rigid = Some(count),
            }
        }
        let ends = points.first().zip(points.last()).map(|(a, b)| [a[0], b[0]]);
        series.push(Series::new(name, SeriesStyle::LineMarks, points));
        if let (Some(count), Some(ends)) = (rigid, ends) {
            let line = ends.map(|x| [x, count]).to_vec();
            series.push(Series::new(
                format!("{on}, rigid"),
                SeriesStyle::Dashed,
                line,
            ));
        }
    }
    let file = "scaling-rod";
    Chart {
        title: "Iterations of a step against the stiffness of a rod".into(),
        x: Axis::log("stiffness of the rod over that around it"),
        y: Axis::log("iterations of conjugate gradients"),
        series,
    }
    .save(run.dir, file)?;
    Ok(file.into())
}

fn finding(rows: &[Row]) -> String {
    let mut text = "Steps of a bar of finite elements (1 MPa, ν = 0.3) that is clamped at one end and bends under its weight; time step 0.01 s, explicit solvers with half their largest stable step:\n\n| material | integrator | on | exponent | tets | nodes | iterations | ms per step |\n|---|---|---|---|---|---|---|---|\n".to_owned();
    for how in KINDS {
        let points = curve(rows, how);
        if let (Some(p), Some(last)) = (fit_exponent(&points), of(rows, "tets", how).last()) {
            let iterations = match how.1.is_implicit() {
                true => format!("{:.0}", last.number("iterations_a_step")),
                false => "none".to_owned(),
            };
            text += &format!(
                "| {} | {} | {} | {p:.2} | {:.0} | {:.0} | {iterations} | {:.2} |\n",
                how.0,
                how.1,
                how.2,
                last.number("tets"),
                last.number("nodes"),
                last.number("ms_a_step")
            );
        }
    }
    text += "\nThe same bar with a rod inside, stiffer than its surroundings by the given factor, or rigid; the deviation is the distance from the bar with the rigid rod after 20 steps, relative to its displacement:\n\n| rod | on | iterations | ms per step | deviation |\n|---|---|---|---|---|\n";
    for row in rows.iter().filter(|r| r.text("against") == "rod") {
        let rod = match row.number("rod") {
            factor if factor.is_finite() => format!("{factor} times"),
            _ => row.text("rod").to_owned(),
        };
        text += &format!(
            "| {rod} | {} | {:.0} | {:.2} | {:.2} % |\n",
            row.text("on"),
            row.number("iterations_a_step"),
            row.number("ms_a_step"),
            row.number("off_rigid_percent")
        );
    }
    text
}
