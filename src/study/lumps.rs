//! `study lumps`: which lumps a stiffness map detects, by size, depth and contrast.

use super::{Axis, Cell, Row, Run, StateMap};
use crate::mesh::{Location, TetMesh};
use crate::press::{MapOptions, PressMap};
use crate::scene::Scene;
use crate::{Error, Result};
use glam::DVec3;
use std::path::Path;

/// Ratio to the median stiffness from which a point stands out.
const STANDOUT_RATIO: f64 = 1.2;
const CONTRASTS: [f64; 4] = [1.0, 2.0, 5.0, 10.0];
/// Ratio to the stiffness of the same breast with a lump of contrast 1 from which a lump is
/// palpable.
const PALPABLE_RATIO: f64 = 1.1;
const WIDE_MM: [f64; 4] = [10.0, 15.0, 20.0, 25.0];
const DEEP_MM: [f64; 4] = [5.0, 10.0, 15.0, 20.0];
const STATES: [&str; 3] = ["found", "felt beside another", "missed"];

/// Resolution of the mesh and of the map.
struct Subject {
    tets: usize,
    points: u32,
}

/// Returns the breast scene with this lump.
fn breast(tets: usize, [contrast, wide, deep]: [f64; 3]) -> Result<Scene> {
    Scene::parse(&format!(
        "[mesh]\ngenerate = \"breast\"\ntets = {tets}\nlump_mm = {wide}\ndepth_mm = {deep}\ncontrast = {contrast}\n\
         [material]\nmodel = \"neo-hookean\"\nstiffness_field = \"stiffness\"\n\
         fat = {{}}\ngland = [\"gland\", \"lump\"]\nmuscle = {{}}"
    ))
}

/// Returns the centre of the lump.
fn middle(mesh: &TetMesh) -> Result<DVec3> {
    let label = mesh.region_names.iter().find(|(_, name)| *name == "lump");
    let labels = mesh.field("label", Location::Cell);
    let (Some((label, _)), Some(labels)) = (label, labels) else {
        return Err(Error::Input(
            "the generated breast has no lump region".into(),
        ));
    };
    let (mut sum, mut volume) = (DVec3::ZERO, 0.0);
    for (t, own) in labels.values.iter().enumerate() {
        if own.round() as i64 == *label {
            let v = mesh.tet_volume(t);
            sum += v * mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
            volume += v;
        }
    }
    Ok(sum / volume)
}

/// Returns the largest stiffness over the median, the stiffness above the lump (N/m), the
/// horizontal distance of the stiffest point from the lump (mm), and whether that point is above
/// the lump.
fn pressed(run: &Run, subject: &Subject, lump: [f64; 3]) -> Result<Vec<Cell>> {
    let scene = breast(subject.tets, lump)?;
    let place = middle(&scene.mesh.load()?)?;
    let wanted = MapOptions {
        points: [subject.points; 2],
        ..MapOptions::default()
    };
    let mut map = PressMap::new(&scene, &wanted)?;
    map.measure(run.gpu, &mut |_| Ok(()))?;
    let aside = |p: DVec3| (p - place).truncate().length();
    let near = map.points().iter().filter(|p| p.stiffness().is_some());
    let near = near.min_by(|a, b| aside(a.point).total_cmp(&aside(b.point)));
    let (Some(median), Some(top), Some(near)) = (map.median(), map.stiffest(), near) else {
        return Err(Error::Input("every press of the map failed".into()));
    };
    let over = |p: &crate::press::MapPoint| p.stiffness().unwrap_or(0.0) / median;
    let [radius, _] = map.radius_and_depth();
    let there = aside(top.point) <= 5e-4 * lump[1] + radius;
    Ok(vec![
        over(&top).into(),
        near.stiffness().unwrap_or(0.0).into(),
        (1e3 * aside(top.point)).into(),
        f64::from(u8::from(there)).into(),
    ])
}

/// Measures, draws charts and reports.
pub(super) fn run(run: &Run, _: Option<&Path>) -> Result<()> {
    let quick = run.quick;
    let subject = match quick {
        true => Subject {
            tets: 5_000,
            points: 4,
        },
        false => Subject {
            tets: 20_000,
            points: 8,
        },
    };
    let some = |all: &[f64]| match quick {
        true => all[1..2].to_vec(),
        false => all.to_vec(),
    };
    let wides = some(&WIDE_MM);
    let contrasts = match quick {
        true => vec![1.0, 5.0],
        false => CONTRASTS.to_vec(),
    };
    let deeps = match quick {
        true => vec![5.0, 20.0],
        false => DEEP_MM.to_vec(),
    };
    let mut points: Vec<Vec<Cell>> = Vec::new();
    for contrast in &contrasts {
        for wide in &wides {
            for deep in &deeps {
                points.push(vec![
                    subject.tets.into(),
                    (*contrast).into(),
                    (*wide).into(),
                    (*deep).into(),
                ]);
            }
        }
    }
    let rows = run.measure(
        "lumps",
        &["tets", "contrast", "lump_mm", "depth_mm"],
        &[
            "largest_over_median",
            "above_n_per_m",
            "off_mm",
            "stiffest_there",
        ],
        &points,
        |point| {
            let lump = [1, 2, 3].map(|k: usize| point[k].number());
            pressed(run, &subject, lump)
        },
    )?;
    let mut charts = Vec::new();
    for contrast in contrasts.iter().filter(|c| **c != 1.0) {
        let name = format!("lumps-{contrast}");
        chart(&rows, *contrast, &wides, &deeps).save(run.dir, &name)?;
        charts.push(name);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    run.write_findings(
        "lumps",
        "Lumps found by stiffness maps",
        &describe(&rows),
        &charts,
    )
}

/// The results for one lump.
#[derive(Clone, Copy)]
struct Reading {
    /// Largest stiffness over the median.
    stands_out: f64,
    /// Stiffness above the lump over the stiffness there without contrast.
    raised: f64,
    off_mm: f64,
    /// Index into [`STATES`].
    state: usize,
}

fn row(rows: &[Row], lump: [f64; 3]) -> Option<&Row> {
    let of = |r: &Row| ["contrast", "lump_mm", "depth_mm"].map(|name| r.number(name));
    rows.iter().find(|r| of(r) == lump)
}

fn reading(rows: &[Row], [contrast, wide, deep]: [f64; 3]) -> Option<Reading> {
    let own = row(rows, [contrast, wide, deep])?;
    let plain = row(rows, [1.0, wide, deep])?;
    let raised = own.number("above_n_per_m") / plain.number("above_n_per_m");
    let stands_out = own.number("largest_over_median");
    let there = own.number("stiffest_there") == 1.0;
    Some(Reading {
        stands_out,
        raised,
        off_mm: own.number("off_mm"),
        state: match (
            there && stands_out >= STANDOUT_RATIO,
            raised >= PALPABLE_RATIO,
        ) {
            (true, true) => 0,
            (_, true) => 1,
            _ => 2,
        },
    })
}

fn chart(rows: &[Row], contrast: f64, wides: &[f64], deeps: &[f64]) -> StateMap {
    let state = |wide: f64, deep: f64| {
        let known = reading(rows, [contrast, wide, deep]);
        known.map_or(STATES.len(), |r| r.state)
    };
    let cells = wides
        .iter()
        .flat_map(|w| deeps.iter().map(|d| state(*w, *d)));
    StateMap {
        title: format!("Lumps {contrast} times as stiff as the breast"),
        x: Axis::linear("depth of its nearest point (mm)"),
        y: Axis::linear("diameter (mm)"),
        xs: deeps.to_vec(),
        ys: wides.to_vec(),
        states: STATES.map(str::to_owned).into(),
        cells: cells.collect(),
        curves: Vec::new(),
    }
}

fn describe(rows: &[Row]) -> String {
    let lumps = rows.iter().filter_map(|r| {
        let lump = ["contrast", "lump_mm", "depth_mm"].map(|name| r.number(name));
        Some((lump, reading(rows, lump).filter(|_| lump[0] != 1.0)?))
    });
    let lumps: Vec<([f64; 3], Reading)> = lumps.collect();
    let lines = lumps.iter().map(|([contrast, wide, deep], r)| {
        format!(
            "| {contrast} | {wide} | {deep} | {:.2} | {:.2} | {:.0} | {} |",
            r.raised, r.stands_out, r.off_mm, STATES[r.state]
        )
    });
    let count = |state: usize| lumps.iter().filter(|(_, r)| r.state == state).count();
    let healthy = rows.iter().filter(|r| r.number("contrast") == 1.0);
    let uneven = healthy.map(|r| r.number("largest_over_median"));
    format!(
        "A breast of fat and gland with a lump below its upper outer quadrant is pressed from above at the points of a grid (`palpate press --map`). Of {} lumps, {} are found: the stiffest point of the map lies above the lump and is at least {STANDOUT_RATIO} times the median, and the stiffness above the lump is at least {PALPABLE_RATIO} times that without contrast. {} more are felt only in comparison with a breast without contrast, because another point of the map is stiffer: a map without contrast reaches {:.2} times its median, since steep parts of the surface yield more.\n\n\
         | contrast | diameter, mm | depth, mm | above it, over no contrast | largest over median | off, mm | |\n| --- | --- | --- | --- | --- | --- | --- |\n{}",
        lumps.len(),
        count(0),
        count(1),
        uneven.fold(0.0, f64::max),
        lines.collect::<Vec<_>>().join("\n")
    )
}
