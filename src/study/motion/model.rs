//! The discretisation error of the material models: a bar that bends under its weight, by springs
//! and by finite elements on the same mesh, against Timoshenko beam theory.

use crate::Result;
use crate::generate::{self, Split};
use crate::mesh::ElementOrder;
use crate::study::static_equilibrium::{Cantilever, materials, poisson};
use crate::study::{Axis, Chart, Row, Run, Series, SeriesStyle};
use glam::DVec3;

/// The bar of the comparison with other physics programs.
const BEAM: Cantilever = Cantilever {
    length: 0.8,
    width: 0.2,
    young: 1e6,
    density: 1000.0,
    gravity: 9.81,
};

/// Ratio of the cells along its length to the cells across.
const SLENDER: usize = 4;

const SPLITS: [(&str, Split); 2] = [
    ("five tets a cell", Split::Five),
    ("six tets a cell", Split::Six),
];

/// Measures, draws charts and returns the findings.
pub fn run(run: &Run) -> Result<(String, Vec<String>)> {
    let cells: &[usize] = match run.quick {
        true => &[2, 4],
        false => &[1, 2, 3, 4, 6, 8, 12],
    };
    // `study elements` compares quadratic tets.
    let mut matters = materials(BEAM.young);
    matters.retain(|(_, material)| material.order == ElementOrder::Linear);
    let mut points = Vec::new();
    for (split, _) in SPLITS {
        for (matter, _) in &matters {
            let of = |n: &usize| vec![split.into(), matter.as_str().into(), (*n).into()];
            points.extend(cells.iter().map(of));
        }
    }
    let rows = run.measure(
        "motion_model",
        &["split", "matter", "cells_across"],
        &["tets", "nodes", "timoshenko_tip_m", "tip_m", "error"],
        &points,
        |point| {
            let split = SPLITS.iter().find(|s| s.0 == point[0].text());
            let split = split.map_or(Split::Five, |s| s.1);
            let Some((_, material)) = matters.iter().find(|m| m.0 == point[1].text()) else {
                return Ok(Vec::new());
            };
            let cells = point[2].number() as usize;
            let size = DVec3::new(BEAM.length, BEAM.width, BEAM.width);
            let mesh = generate::box_mesh([SLENDER * cells, cells, cells], size, split)?;
            let beam = BEAM.analytic_tip(poisson(material));
            let tip = BEAM.measured_tip(run.gpu, &mesh, material)?;
            let (tets, nodes) = (mesh.tets.len() as f64, mesh.nodes.len() as f64);
            let numbers = [tets, nodes, beam, tip, tip / beam - 1.0];
            Ok(numbers.map(super::rounded).to_vec())
        },
    )?;
    let mut charts = Vec::new();
    for (n, (split, _)) in SPLITS.iter().enumerate() {
        let name = format!("motion_model_{}", ["five", "six"][n]);
        draw(run, &rows, split, &name)?;
        charts.push(name);
    }
    Ok((tell(&rows), charts))
}

/// Returns the materials of `rows`, each once, in order.
fn names(rows: &[Row]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for name in rows.iter().map(|r| r.text("matter")) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

fn draw(run: &Run, rows: &[Row], split: &str, name: &str) -> Result<()> {
    let mut series = Vec::new();
    for matter in names(rows) {
        let own = |r: &&Row| r.text("split") == split && r.text("matter") == matter;
        let points = rows.iter().filter(own);
        let points = points.map(|r| [r.number("cells_across"), 1.0 + r.number("error")]);
        series.push(Series::new(
            matter,
            SeriesStyle::LineMarks,
            points.collect(),
        ));
    }
    let cells = rows.iter().map(|r| r.number("cells_across"));
    let beam = vec![[1.0, 1.0], [cells.fold(1.0, f64::max), 1.0]];
    series.push(Series::new("Timoshenko's beam", SeriesStyle::Dashed, beam));
    Chart {
        title: format!("A bar bends under its weight, {split}"),
        x: Axis::log("cells across the bar"),
        y: Axis::linear("tip's way / Timoshenko's"),
        series,
    }
    .save(run.dir, name)
}

fn tell(rows: &[Row]) -> String {
    let mut table = String::new();
    for matter in names(rows) {
        let finest = SPLITS.map(|(split, _)| {
            let mut own = rows.iter().rev();
            own.find(|r| r.text("split") == split && r.text("matter") == matter)
                .map_or(f64::NAN, |r| 100.0 * r.number("error"))
        });
        table += &format!("| {matter} | {:+.1} | {:+.1} |\n", finest[0], finest[1]);
    }
    let cells = rows.iter().map(|r| r.number("cells_across"));
    format!(
        "**Model error.** Excess tip deflection of a bar of {:.0} cells across under its weight, fully converged, over that of a Timoshenko beam of the same ν (springs: ¼), in percent, with five and six tets per cell.\n\n| matter, ν | five | six |\n| --- | --- | --- |\n{table}\nThis discretisation error does not depend on the time step or the solver: it comes from the springs, or from the excessive bending stiffness of linear tets. Finer meshes reduce it, and averaged volumes prevent locking.",
        cells.fold(1.0, f64::max),
    )
}
