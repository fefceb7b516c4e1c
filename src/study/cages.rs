//! `study cages`: accuracy and cost of a motion when a coarse cage carries the mesh.

use super::{Axis, Cell, Chart, Row, Run, Series, SeriesStyle};
use crate::cage::CageKind;
use crate::mesh::{TetMesh, bounds};
use crate::physics::{MaterialModel, SolverKind};
use crate::scene::{CageEntry, Motion, Scene, TissueEntry};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;
use std::time::Instant;

/// Material models, each with the cages that support it.
const MATERIALS: &[(MaterialModel, &[CageKind])] = &[
    (MaterialModel::NeoHookean, &[CageKind::Lattice]),
    (MaterialModel::Springs, &[CageKind::Lattice, CageKind::Grid]),
];

/// Simulated duration, s, and number of comparisons.
const SECONDS: f64 = 2.0;
const COMPARISONS: u32 = 8;
/// Number of cage nodes relative to the mesh.
const NODE_FRACTIONS: [f64; 7] = [0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6];
const QUICK_SHARES: [f64; 3] = [0.04, 0.1, 0.25];

/// Returns the limb scene, clamped at the elbow and pulled at the fingers.
fn limb(tets: usize) -> Result<Scene> {
    Scene::parse(&format!(
        "[mesh]\ngenerate = \"limb\"\ntets = {tets}\n\
         [material]\nyoung = 1e5\ndensity = 1060\nskin = {{ young = 2e5 }}\nfat = {{ young = 3e4 }}\n\
         tendon = {{ young = 2e5 }}\nbone = {{ young = 1e6 }}\nmarrow = {{ young = 2e5 }}\n\
         [solver]\nname = \"implicit\"\ndt = 0.0125\ntolerance = 0.01\ngravity = [0, 0, 0]\n\
         [[pin]]\naxis = \"x\"\nbelow = 0.04\n\
         [[force]]\non = {{ axis = \"x\", above = 0.85 }}\ntotal = [0, 0, -0.2]"
    ))
}

/// A motion: node positions at each comparison, and its cost.
struct Moved {
    places: Vec<Vec<DVec3>>,
    /// Milliseconds per simulated second.
    cost: f64,
    nodes: usize,
    fitted: f64,
    /// Seconds until the first step.
    prepared: f64,
}

fn moved(run: &Run, scene: &Scene, kind: SolverKind, mesh: &TetMesh) -> Result<Moved> {
    let start = Instant::now();
    let (mut motion, _) = Motion::new(run.gpu, scene, kind, mesh.clone(), None)?;
    motion.set_sleep_allowed(false);
    let prepared = start.elapsed().as_secs_f64();
    let pace = SECONDS / f64::from(COMPARISONS);
    let steps = (pace / motion.dt).ceil().max(1.0) as u32;
    motion.dt = pace / f64::from(steps);
    let (mut places, mut taken) = (Vec::new(), 0.0);
    for look in 0..COMPARISONS {
        let start = Instant::now();
        motion.run(steps, &mut |_| {})?;
        // The first interval includes pipeline creation and is not timed.
        if look > 0 {
            taken += start.elapsed().as_secs_f64();
        }
        places.push(motion.positions()?);
    }
    let cage = motion.cage();
    Ok(Moved {
        places,
        cost: 1e3 * taken / (SECONDS - pace),
        nodes: cage.map_or(mesh.nodes.len(), |c| c.nodes),
        fitted: cage.map_or(1.0, |c| c.stiffness_scale),
        prepared,
    })
}

/// Measures the motion of `scene` by a cage of `kind` with about `nodes` nodes.
fn caged(run: &Run, mut scene: Scene, kind: &str, nodes: usize, mesh: &TetMesh) -> Result<Moved> {
    let kind: CageKind = kind.parse()?;
    scene.cage = Some(CageEntry {
        nodes: Some(nodes),
        kind: Some(kind),
        damping: None,
    });
    let solver = match kind {
        CageKind::Lattice => SolverKind::Implicit,
        CageKind::Grid => {
            scene.solver.dt = None;
            SolverKind::Verlet
        }
    };
    moved(run, &scene, solver, mesh)
}

/// Returns the RMS position error relative to the RMS displacement, over the motion and at its end.
fn errors(found: &Moved, truth: &Moved, rest: &[DVec3]) -> [f64; 2] {
    let apart = |a: &[DVec3], b: &[DVec3]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum()
    };
    let share = |looks: std::ops::Range<usize>| {
        let (mut off, mut moved) = (0.0, 0.0);
        for look in looks {
            let there = &truth.places[look];
            off += apart(&found.places[look], there);
            moved += apart(there, rest);
        }
        (off / moved).sqrt()
    };
    let last = COMPARISONS as usize;
    [share(0..last), share(last - 1..last)]
}

/// Runs the study on the limb or on the user's scene.
///
/// # Errors
/// As [`Motion::new`], [`Motion::run`] and [`Run::measure`].
pub fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    let tets = if run.quick { 4_000 } else { 40_000 };
    let mut scene = match scene {
        Some(path) => Scene::read(path)?,
        None => limb(tets)?,
    };
    check_scene(&scene)?;
    scene.cage = None;
    scene.solver.name = Some("implicit".into());
    let mesh = scene.mesh_of_one()?;
    let name = match (&scene.mesh.generate, &scene.mesh.file) {
        (Some(name), _) => name.clone(),
        (None, Some(file)) => file
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into(),
        (None, None) => "mesh".to_owned(),
    };
    // Finite elements have neither.
    let of_springs = scene.material.stiffness.is_some() || scene.material.damping.is_some();
    if of_springs {
        run.report_note(
            "skipping finite elements, because the scene sets a stiffness or damping of springs",
        );
    }
    let matters = if of_springs {
        &MATERIALS[1..]
    } else {
        MATERIALS
    };
    let points = points(run.quick, &mesh, matters, &name);
    let mut truths: BTreeMap<&str, Moved> = BTreeMap::new();
    let rows = run.measure(
        "cages",
        &["mesh", "tets", "matter", "body", "nodes wanted", "seconds"],
        &[
            "nodes",
            "path error",
            "end error",
            "ms a second",
            "stiffness factor",
            "prepared s",
        ],
        &points,
        |point| {
            let Some((model, _)) = MATERIALS.iter().find(|m| m.0.name() == point[2].text()) else {
                return Ok(Vec::new());
            };
            let mut own = scene.clone();
            // Same material model as the carried mesh, so that the error comes from the coarser
            // nodes only.
            own.material.model = Some(*model);
            let truth = match truths.entry(model.name()) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => new.insert(moved(run, &own, SolverKind::Implicit, &mesh)?),
            };
            let found = match point[3].text() {
                "own" => None,
                kind => Some(caged(run, own, kind, point[4].number() as usize, &mesh)?),
            };
            let found = found.as_ref().unwrap_or(truth);
            let [path, end] = errors(found, truth, &mesh.nodes);
            let numbers = [
                found.nodes as f64,
                path,
                end,
                found.cost,
                found.fitted,
                found.prepared,
            ];
            Ok(numbers.map(Cell::from).to_vec())
        },
    )?;
    draw(run, &rows, &name)?;
    tell(run, &rows, &mesh, &name)
}

/// Checks that cages can carry the body of `scene`.
fn check_scene(scene: &Scene) -> Result<()> {
    if scene.grid.is_some() || !scene.cut.is_empty() {
        return Err(Error::Input(
            "a cage needs a tetrahedral body without cuts; remove [grid] and [[cut]]".into(),
        ));
    }
    if let Some(entry) = scene.tets_only_entry() {
        return Err(Error::Input(format!(
            "a cage does not support {entry}; remove it"
        )));
    }
    let rigid = |tissue: &TissueEntry| tissue.is_rigid();
    if scene.material.tissues.values().any(rigid) {
        return Err(Error::Input(
            "a cage does not support rigid regions; remove `rigid`".into(),
        ));
    }
    Ok(())
}

/// Returns the points of the study: of each material the mesh itself, and cages of several sizes.
fn points(
    quick: bool,
    mesh: &TetMesh,
    matters: &[(MaterialModel, &[CageKind])],
    name: &str,
) -> Vec<Vec<Cell>> {
    let shares: &[f64] = if quick {
        &QUICK_SHARES
    } else {
        &NODE_FRACTIONS
    };
    let count = mesh.nodes.len();
    let mut points: Vec<Vec<Cell>> = Vec::new();
    for (model, kinds) in matters {
        points.push(point(name, mesh, (model, "own"), count));
        for kind in *kinds {
            let wanted = shares.iter().map(|s| (s * count as f64).round().max(20.0));
            let kind = (model, kind.name());
            points.extend(wanted.map(|n| point(name, mesh, kind, n as usize)));
        }
    }
    points
}

fn point(
    name: &str,
    mesh: &TetMesh,
    (model, body): (&MaterialModel, &str),
    nodes: usize,
) -> Vec<Cell> {
    vec![
        name.into(),
        mesh.tets.len().into(),
        model.name().into(),
        body.into(),
        nodes.into(),
        SECONDS.into(),
    ]
}

fn draw(run: &Run, rows: &[Row], name: &str) -> Result<()> {
    let lines = |x: &str| {
        let mut lines = Vec::new();
        for (model, kinds) in MATERIALS {
            for kind in *kinds {
                let own = rows
                    .iter()
                    .filter(|r| r.text("matter") == model.name() && r.text("body") == kind.name());
                let points = own.map(|r| [r.number(x), r.number("path error")]).collect();
                lines.push(Series::new(
                    format!("{kind} of {model}"),
                    SeriesStyle::LineMarks,
                    points,
                ));
            }
        }
        lines
    };
    let percent = "error of displacement along the way, share of its size";
    Chart {
        title: format!("Cages around the {name}: error against nodes"),
        x: Axis::log("nodes of the cage"),
        y: Axis::log(percent),
        series: lines("nodes"),
    }
    .save(run.dir, "cages_nodes")?;
    let mut series = lines("ms a second");
    let least = rows
        .iter()
        .map(|r| r.number("path error"))
        .filter(|e| *e > 0.0)
        .fold(f64::INFINITY, f64::min);
    for own in rows.iter().filter(|r| r.text("body") == "own") {
        let cost = own.number("ms a second");
        series.push(Series::new(
            format!("the mesh itself, of {}", own.text("matter")),
            SeriesStyle::Dashed,
            vec![[cost, least], [cost, 1.0]],
        ));
    }
    Chart {
        title: format!("Cages around the {name}: error against time"),
        x: Axis::log("time for a second of motion (ms)"),
        y: Axis::log(percent),
        series,
    }
    .save(run.dir, "cages_time")
}

fn tell(run: &Run, rows: &[Row], mesh: &TetMesh, name: &str) -> Result<()> {
    let (low, high) = bounds(&mesh.nodes);
    let mut text = format!(
        "The {name} ({} nodes, {} tets, length {:.3}) is simulated for {SECONDS} s by implicit Euler, directly and in cages of the same material. The error is the RMS distance of the nodes from those of the direct simulation, relative to their RMS displacement: over the whole motion, and at its end. Grids are integrated by Verlet, which lacks the numerical damping of implicit Euler; over the whole motion, this difference counts as error.\n",
        mesh.nodes.len(),
        mesh.tets.len(),
        (high - low).max_element()
    );
    for row in rows.iter().filter(|r| r.text("body") != "own") {
        let matter = row.text("matter");
        let mut all = rows.iter();
        let own = all.find(|r| r.text("body") == "own" && r.text("matter") == matter);
        let faster = own.map_or(f64::NAN, |o| {
            o.number("ms a second") / row.number("ms a second")
        });
        text += &format!(
            "\n- {} with {} nodes, {matter}: error {:.1} % over the motion, {:.1} % at the end; {:.0} ms per simulated second, {faster:.1} times as fast as the direct simulation; stiffness factor {:.2}.",
            row.text("body"),
            row.number("nodes"),
            100.0 * row.number("path error"),
            100.0 * row.number("end error"),
            row.number("ms a second"),
            row.number("stiffness factor")
        );
    }
    run.write_findings(
        "cages",
        "Cages that embed a fine mesh",
        &text,
        &["cages_nodes", "cages_time"],
    )
}
