//! What springs get wrong however well they are solved: a bar that bends under its weight, by
//! springs, by finite elements on the same mesh, and by Timoshenko's beam.

use crate::Result;
use crate::mesh::generate::{self, Split};
use crate::physics::plain::springs::Particles;
use crate::physics::{Material, SpringNetwork};
use crate::study::elements::{Cantilever, Elements, spring_equilibrium};
use crate::study::{Axis, Chart, Look, Row, Run, Series};
use glam::DVec3;

/// The bar of the physics peers.
const BEAM: Cantilever = Cantilever {
    length: 0.8,
    width: 0.2,
    young: 1e6,
    poisson: 0.25,
    density: 1000.0,
    gravity: 9.81,
};

/// Cells along its length for one across.
const SLENDER: usize = 4;

const SPLITS: [(&str, Split); 2] = [
    ("five tets a cell", Split::Five),
    ("six tets a cell", Split::Six),
];

/// Measures, draws a chart and returns what was found.
pub fn run(run: &Run) -> Result<(String, String)> {
    let cells: &[usize] = match run.quick {
        true => &[2, 4],
        false => &[1, 2, 3, 4, 6, 8, 12],
    };
    let mut points = Vec::new();
    for (name, _) in SPLITS {
        points.extend(cells.iter().map(|n| vec![name.into(), (*n).into()]));
    }
    let rows = run.measure(
        "motion_model",
        &["split", "cells_across"],
        &[
            "tets",
            "nodes",
            "timoshenko_tip_m",
            "elements_tip_m",
            "springs_tip_m",
            "elements_against_timoshenko",
            "springs_against_timoshenko",
            "springs_against_elements",
        ],
        &points,
        |point| {
            let split = SPLITS.iter().find(|s| s.0 == point[0].text());
            let split = split.map_or(Split::Five, |s| s.1);
            let [tets, nodes, elements, springs] = tips(split, point[1].number() as usize)?;
            let beam = BEAM.tip();
            let numbers = [
                tets,
                nodes,
                beam,
                elements,
                springs,
                elements / beam - 1.0,
                springs / beam - 1.0,
                springs / elements - 1.0,
            ];
            Ok(numbers.map(super::rounded).to_vec())
        },
    )?;
    let chart = "motion_model";
    draw(run, &rows)?;
    Ok((tell(&rows), chart.to_owned()))
}

/// Tets, nodes, and how far the tip sinks by elements and by springs, m.
fn tips(split: Split, cells: usize) -> Result<[f64; 4]> {
    let size = DVec3::new(BEAM.length, BEAM.width, BEAM.width);
    let mesh = generate::box_mesh([SLENDER * cells, cells, cells], size, split)?;
    let network = SpringNetwork::new(&mesh, &Material::young(BEAM.young))?;
    let held: Vec<bool> = mesh.nodes.iter().map(|x| x.x < 1e-9).collect();
    let weight = network.masses.iter();
    let weight: Vec<DVec3> = weight.map(|m| *m * BEAM.gravity * DVec3::NEG_Z).collect();
    let elements = Elements::new(&mesh, BEAM.young, BEAM.poisson);
    let end: Vec<usize> = (0..mesh.nodes.len())
        .filter(|i| mesh.nodes[*i].x > BEAM.length - 1e-9)
        .collect();
    let tip = |u: &[DVec3]| end.iter().map(|i| -u[*i].z).sum::<f64>() / end.len() as f64;
    Ok([
        mesh.tets.len() as f64,
        mesh.nodes.len() as f64,
        tip(&elements.equilibrium(&weight, &held, 1e-9).x),
        tip(&spring_equilibrium(&Particles::new(network), &weight, &held, 1e-9).x),
    ])
}

fn draw(run: &Run, rows: &[Row]) -> Result<()> {
    let mut series = Vec::new();
    for (split, _) in SPLITS {
        for (what, column) in [("elements", "elements_tip_m"), ("springs", "springs_tip_m")] {
            let rows = rows.iter().filter(|r| r.text("split") == split);
            let points = rows.map(|r| {
                let tip = r.number(column) / r.number("timoshenko_tip_m");
                [r.number("cells_across"), tip]
            });
            let name = format!("{what}, {split}");
            series.push(Series::new(name, Look::LineMarks, points.collect()));
        }
    }
    let last = rows
        .iter()
        .map(|r| r.number("cells_across"))
        .fold(1.0, f64::max);
    let beam = vec![[1.0, 1.0], [last, 1.0]];
    series.push(Series::new("Timoshenko's beam", Look::Dashed, beam));
    Chart {
        title: "A bar bends under its weight: springs against a continuum".into(),
        x: Axis::log("cells across the bar"),
        y: Axis::linear("tip's way / Timoshenko's"),
        series,
    }
    .save(run.dir, "motion_model")
}

fn tell(rows: &[Row]) -> String {
    let finest = |split: &str| {
        let mut finest = rows.iter().rev().filter(|r| r.text("split") == split);
        finest.next().map(|r| {
            let percent = |column: &str| 100.0 * r.number(column);
            format!(
                "with {split} ({} tets) the springs' tip sinks {:+.1} % against Timoshenko's beam and {:+.1} % against linear elements of ν = ¼ on the same mesh, which themselves are {:+.1} % off the beam",
                r.number("tets"),
                percent("springs_against_timoshenko"),
                percent("springs_against_elements"),
                percent("elements_against_timoshenko"),
            )
        })
    };
    let found: Vec<String> = SPLITS.iter().filter_map(|s| finest(s.0)).collect();
    format!(
        "**The error of the model.** A bar of springs, solved exactly, is still not the continuum: {}. No step or solver mends that, nor is any Poisson's ratio but ¼ to be had; only another material model would.",
        found.join("; ")
    )
}
