//! `study lumps`: which lumps a map of presses finds, by their size, depth and contrast.

use super::{Axis, Cell, Row, Run, StateMap};
use crate::mesh::{Location, TetMesh};
use crate::press::{MapWanted, PressMap};
use crate::scene::Scene;
use crate::{Error, Result};
use glam::DVec3;
use std::path::Path;

/// Over the median, what stands out from the rest.
const READS: f64 = 1.2;
const CONTRASTS: [f64; 3] = [2.0, 5.0, 10.0];
const WIDE_MM: [f64; 4] = [10.0, 15.0, 20.0, 25.0];
const DEEP_MM: [f64; 4] = [5.0, 10.0, 15.0, 20.0];
const STATES: [&str; 3] = [
    "found",
    "the stiffest point, but below 1.2 of the median",
    "another point is stiffer",
];

/// What is pressed, and at how many points.
struct Subject {
    tets: usize,
    points: u32,
}

/// The breast with such a lump.
fn breast(tets: usize, [contrast, wide, deep]: [f64; 3]) -> Result<Scene> {
    Scene::parse(&format!(
        "[mesh]\ngenerate = \"breast\"\ntets = {tets}\nlump_mm = {wide}\ndepth_mm = {deep}\ncontrast = {contrast}\n\
         [material]\nmodel = \"neo-hookean\"\nstiffness_field = \"stiffness\"\n\
         fat = {{}}\ngland = [\"gland\", \"lump\"]\nmuscle = {{}}"
    ))
}

/// The middle of the lump.
fn middle(mesh: &TetMesh) -> Result<DVec3> {
    let label = mesh.region_names.iter().find(|(_, name)| *name == "lump");
    let labels = mesh.field("label", Location::Cell);
    let (Some((label, _)), Some(labels)) = (label, labels) else {
        return Err(Error::Input("the breast has no lump".into()));
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

/// The largest stiffness over the median, that next to the lump over the median, how far from the
/// lump the stiffest point is, seen from above, mm, and which of [`STATES`] that makes.
fn pressed(run: &Run, subject: &Subject, lump: [f64; 3]) -> Result<Vec<Cell>> {
    let scene = breast(subject.tets, lump)?;
    let place = middle(&scene.mesh.load()?)?;
    let wanted = MapWanted {
        points: [subject.points; 2],
        radius: None,
        depth: None,
    };
    let mut map = PressMap::new(&scene, &wanted)?;
    map.measure(run.gpu, &mut |_| Ok(()))?;
    let aside = |p: DVec3| (p - place).truncate().length();
    let near = map.points().iter().filter(|p| p.stiffness().is_some());
    let near = near.min_by(|a, b| aside(a.point).total_cmp(&aside(b.point)));
    let (Some(median), Some(top), Some(near)) = (map.median(), map.stiffest(), near) else {
        return Err(Error::Input("no point of the map could be pressed".into()));
    };
    let over = |p: &crate::press::MapPoint| p.stiffness().unwrap_or(0.0) / median;
    let [radius, _] = map.radius_and_depth();
    let there = aside(top.point) <= 5e-4 * lump[1] + radius;
    let state = match (there, over(&top) >= READS) {
        (true, true) => 0,
        (true, false) => 1,
        _ => 2,
    };
    Ok(vec![
        over(&top).into(),
        over(near).into(),
        (1e3 * aside(top.point)).into(),
        STATES[state].into(),
    ])
}

/// Measures, draws and tells.
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
    let (contrasts, wides) = (some(&CONTRASTS), some(&WIDE_MM));
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
            "above_over_median",
            "off_mm",
            "state",
        ],
        &points,
        |point| {
            let lump = [1, 2, 3].map(|k: usize| point[k].number());
            pressed(run, &subject, lump)
        },
    )?;
    let mut charts = Vec::new();
    for contrast in &contrasts {
        let name = format!("lumps-{contrast}");
        chart(&rows, *contrast, &wides, &deeps).save(run.dir, &name)?;
        charts.push(name);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    run.tell("lumps", "Which lumps are found", &told(&rows), &charts)
}

fn chart(rows: &[Row], contrast: f64, wides: &[f64], deeps: &[f64]) -> StateMap {
    let state = |wide: f64, deep: f64| {
        let own = rows.iter().find(|r| {
            [
                r.number("contrast"),
                r.number("lump_mm"),
                r.number("depth_mm"),
            ] == [contrast, wide, deep]
        });
        let known = own.and_then(|r| STATES.iter().position(|s| *s == r.text("state")));
        known.unwrap_or(STATES.len())
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

fn told(rows: &[Row]) -> String {
    let lines = rows.iter().map(|r| {
        format!(
            "| {} | {} | {} | {:.2} | {:.2} | {:.0} | {} |",
            r.number("contrast"),
            r.number("lump_mm"),
            r.number("depth_mm"),
            r.number("largest_over_median"),
            r.number("above_over_median"),
            r.number("off_mm"),
            r.text("state")
        )
    });
    let found = rows.iter().filter(|r| r.text("state") == STATES[0]).count();
    format!(
        "A breast of fat and gland, pressed at the points of a grid from above (`palpate press --map`), with a lump below its upper outer quadrant. {found} of {} lumps are found: the stiffest point of the map lies over them, and reads at least {READS} times the median. Without a lump a map is not even: the body gives more where it is steep.\n\n\
         | contrast | diameter, mm | depth, mm | largest over median | above the lump | off, mm | |\n| --- | --- | --- | --- | --- | --- | --- |\n{}",
        rows.len(),
        lines.collect::<Vec<_>>().join("\n")
    )
}
