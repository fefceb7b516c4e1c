//! Second part of `study lumps`: which lumps a stiffness map determines, by the intervals of place, size and
//! contrast that `palpate identify` is expected to give.

use super::lumps::{breast, middle};
use super::{Axis, Cell, Row, Run, StateMap};
use crate::Result;
use crate::identify::{Experiment, Unknown, expected_intervals};
use crate::press::{MapOptions, PressMap};
use crate::scene::OrderChoice;

/// Standard deviations of the noise over each stiffness, per cent.
const NOISES: [f64; 3] = [1.0, 2.0, 5.0];
/// Largest halves of the intervals of place and diameter of a lump that is determined, mm.
const PLACE_ERROR: f64 = 3.0;
const DIAMETER_ERROR: f64 = 4.0;
const STATES: [&str; 3] = [
    "place, size, and that it is stiffer",
    "that it is stiffer",
    "nothing",
];
const CONTRASTS: [f64; 2] = [2.0, 5.0];
const WIDE_MM: [f64; 3] = [10.0, 15.0, 20.0];
const DEEP_MM: [f64; 3] = [5.0, 10.0, 15.0];
/// Quadratic tets, points of the map along a side, radius and depth of the presses, m.
const TETS: usize = 4_000;
const POINTS: u32 = 7;
const RADIUS: f64 = 0.012;
const DEPTH: f64 = 0.006;

/// Measures and draws charts; returns the findings and the names of the charts.
pub(super) fn run(run: &Run) -> Result<(String, Vec<String>)> {
    let some = |all: &[f64]| match run.quick {
        true => all[1..2].to_vec(),
        false => all.to_vec(),
    };
    let (contrasts, wides, deeps) = (some(&CONTRASTS), some(&WIDE_MM), some(&DEEP_MM));
    let mut points: Vec<Vec<Cell>> = Vec::new();
    for contrast in &contrasts {
        for wide in &wides {
            for deep in &deeps {
                points.push(vec![(*contrast).into(), (*wide).into(), (*deep).into()]);
            }
        }
    }
    let results: Vec<String> = NOISES
        .iter()
        .flat_map(|noise| {
            ["place_mm", "diameter_mm", "contrast_low"].map(|name| column(name, *noise))
        })
        .collect();
    let results: Vec<&str> = results.iter().map(String::as_str).collect();
    let rows = run.measure(
        "lump_intervals",
        &["contrast", "lump_mm", "depth_mm"],
        &results,
        &points,
        |point| intervals(run, [0, 1, 2].map(|k: usize| point[k].number())),
    )?;
    let mut charts = Vec::new();
    for contrast in &contrasts {
        for noise in NOISES {
            let name = format!("lumps-intervals-{contrast}-{noise}");
            chart((&rows, &wides, &deeps), *contrast, noise).save(run.dir, &name)?;
            charts.push(name);
        }
    }
    Ok((describe(&rows), charts))
}

fn column(name: &str, noise: f64) -> String {
    format!("{name}_{noise}")
}

/// Returns for each noise half of the widest interval of a coordinate and of the diameter, mm, and the lower
/// end of the contrast.
fn intervals(run: &Run, [contrast, wide, deep]: [f64; 3]) -> Result<Vec<Cell>> {
    // The lump of the mesh is as soft as the rest: that of the unknowns takes its place.
    let mut scene = breast(TETS, [1.0, wide, deep])?;
    scene.material.order = Some(OrderChoice::Exactly(crate::mesh::ElementOrder::Quadratic));
    let place = middle(&scene.mesh.load()?)?;
    let options = MapOptions {
        points: [POINTS; 2],
        radius: Some(RADIUS),
        depth: Some(DEPTH),
    };
    let map = PressMap::new(&scene, &options)?;
    let places: Vec<_> = map.points().iter().map(|p| (p.point, 1.0)).collect();
    let data = Experiment::map("map", (map.direction(), RADIUS, DEPTH), &places)?;
    let values = [place.x, place.y, place.z, 1e-3 * wide, contrast];
    let noises = NOISES.map(|noise| 1e-2 * noise);
    let found = expected_intervals(
        (run.gpu, &scene, &[data]),
        (Unknown::parse("lump")?, &values),
        &noises,
    )?;
    let half = |[low, high]: [f64; 2]| 500.0 * (high - low);
    let cells = found.iter().flat_map(|ends| {
        let widest = ends[..3].iter().map(|own| half(*own)).fold(0.0, f64::max);
        [widest, half(ends[3]), ends[4][0]]
    });
    Ok(cells
        .map(|x| Cell::from(super::csv_table::significant(x, 4)))
        .collect())
}

/// Returns the state of a lump: index into [`STATES`].
fn state(row: &Row, noise: f64) -> usize {
    let number = |name: &str| row.number(&column(name, noise));
    let is_stiffer = number("contrast_low") > 1.0;
    let is_placed = number("place_mm") <= PLACE_ERROR && number("diameter_mm") <= DIAMETER_ERROR;
    match (is_stiffer, is_placed) {
        (true, true) => 0,
        (true, false) => 1,
        (false, _) => 2,
    }
}

fn chart((rows, wides, deeps): (&[Row], &[f64], &[f64]), contrast: f64, noise: f64) -> StateMap {
    let of = |wide: f64, deep: f64| {
        let lump = [contrast, wide, deep];
        let own = |r: &&Row| ["contrast", "lump_mm", "depth_mm"].map(|name| r.number(name)) == lump;
        let row = rows.iter().find(own);
        row.map_or(STATES.len(), |row| state(row, noise))
    };
    let cells = wides.iter().flat_map(|w| deeps.iter().map(|d| of(*w, *d)));
    StateMap {
        title: format!("What a map with {noise} % noise tells of lumps {contrast} times as stiff"),
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
    let mut text = format!(
        "\n\n## What a map tells of a lump\n\nThe same breast, of {TETS} quadratic tets, is pressed at the points of a grid of {POINTS} × {POINTS} with a fingertip of {:.0} mm to {:.0} mm. The intervals of 90 % that `palpate identify --unknown lump` is expected to give (Laplace's approximation at the true values, the errors of the mesh apart) say what each noise leaves: half of the widest interval of the place, of the diameter, and the lower end of the contrast. A lump is determined if its place is within {PLACE_ERROR} mm, its diameter within {DIAMETER_ERROR} mm, and the contrast is above 1.\n\n| contrast | diameter, mm | depth, mm |",
        1e3 * RADIUS,
        1e3 * DEPTH,
    );
    for noise in NOISES {
        text += &format!(" noise {noise} %: place, diameter, mm; contrast | |");
    }
    text += &format!(
        "\n| --- | --- | --- |{}",
        " --- | --- |".repeat(NOISES.len())
    );
    for row in rows {
        let [contrast, wide, deep] =
            ["contrast", "lump_mm", "depth_mm"].map(|name| row.number(name));
        text += &format!("\n| {contrast} | {wide} | {deep} |");
        for noise in NOISES {
            let number = |name: &str| row.number(&column(name, noise));
            text += &format!(
                " {:.1}, {:.1}; {:.1} | {} |",
                number("place_mm"),
                number("diameter_mm"),
                number("contrast_low"),
                STATES[state(row, noise)]
            );
        }
    }
    text
}
