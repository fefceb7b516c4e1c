//! Robustness of the defaults: undamped neo-Hookean elements by implicit Euler at default settings,
//! against the same steps with converged solves, over step size and stiffness; also by BDF2, for a
//! bar with a rigid rod, and each by quadratic tets.

use crate::Result;
use crate::generate;
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::physics::{
    CgSettings, CpuTets, DiscreteModel, EngineChoice, Material, MaterialModel, Precision,
    Simulator, SolverKind,
};
use crate::study::{Axis, Cell, Row, Run, StateMap, bodies};
use crate::{Error, gpu::Gpu};
use glam::DVec3;

const SETTINGS: [&str; 4] = ["body", "poisson", "young_pa", "step_s"];
const RESULTS: [&str; 4] = [
    "state",
    "off_converged_percent",
    "inverted",
    "iterations_a_step",
];

/// States of a cell: the third to the fifth are failures, the last is unknown.
const STATES: [&str; 6] = [
    "within 1 %",
    "within 20 %",
    "farther off",
    "inverted at the end",
    "broke off",
    "no truth",
];

/// Steps of each cell, and number of comparisons.
const STEPS: u32 = 40;
const SAMPLES: u32 = 8;

/// Poisson's ratios.
const POISSONS: [f64; 2] = [0.3, 0.49];

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// A body that is clamped at its left end and released.
struct Subject {
    name: String,
    mesh: TetMesh,
    kind: SolverKind,
    /// Whether the region of its cell field `rod` is rigid.
    rod: bool,
    order: ElementOrder,
}

/// End of the names of bodies of quadratic tets, which otherwise equal those of linear ones.
const QUADRATIC: &str = "-quadratic";

/// Returns the bodies, of linear tets, then of quadratic ones.
fn subjects() -> Result<Vec<Subject>> {
    let linear = |name: &str, mesh, kind, rod| Subject {
        name: name.to_owned(),
        mesh,
        kind,
        rod,
        order: ElementOrder::Linear,
    };
    let (bar, hollow) = (generate::paper_bar()?, bodies::hollow()?);
    let rod = with_rod(generate::bar([12, 6, 6], generate::PAPER_BAR_SIZE)?);
    let (euler, bdf2) = (SolverKind::Implicit, SolverKind::Bdf2);
    let mut all = vec![
        linear("hollow", hollow, euler, false),
        linear("bar-bdf2", bar.clone(), bdf2, false),
        linear("bar-rod", rod, euler, true),
        linear("bar", bar, euler, false),
    ];
    // With as many nodes as the one of linear tets, which is fine enough for the rod.
    let coarse_rod = with_rod(generate::bar([6, 3, 3], generate::PAPER_BAR_SIZE)?);
    let coarse_rod = linear("bar-rod", coarse_rod, euler, true);
    let quadratic = [&all[3], &all[1], &coarse_rod, &all[0]];
    let quadratic: Result<Vec<Subject>> = quadratic
        .into_iter()
        .map(Subject::of_quadratic_tets)
        .collect();
    all.extend(quadratic?);
    Ok(all)
}

/// Labels the core of a bar, from a fifth of its length on.
fn with_rod(mut mesh: TetMesh) -> TetMesh {
    let (low, high) = mesh.bounds();
    let inside = |t: usize| {
        let middle = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        let at = (middle - low) / (high - low);
        let off = (at - 0.5).abs();
        at.x > 0.2 && off.y < 0.18 && off.z < 0.18
    };
    let labels = (0..mesh.tets.len()).map(|t| f64::from(u8::from(inside(t))));
    let field = Field::scalar("rod", Location::Cell, labels.collect());
    mesh.fields.push(field);
    mesh
}

impl Subject {
    /// Returns this body with quadratic tets.
    fn of_quadratic_tets(&self) -> Result<Subject> {
        Ok(Subject {
            name: format!("{}{QUADRATIC}", self.name),
            mesh: self.mesh.with_mid_edge_nodes()?,
            order: ElementOrder::Quadratic,
            ..*self
        })
    }

    fn material(&self, poisson: f64, young: f64) -> Material {
        Material {
            model: MaterialModel::NeoHookean,
            poisson,
            order: self.order,
            length_unit: self.mesh.length_unit.unwrap_or(1.0),
            region_field: self.rod.then(|| "rod".into()),
            rigid: if self.rod {
                [1].into()
            } else {
                Default::default()
            },
            ..Material::from_young(young)
        }
    }

    fn hold(&self, body: &mut dyn Simulator) -> Result<()> {
        let (low, high) = self.mesh.bounds();
        let end = low.x + 0.05 * (high.x - low.x);
        body.pin(|p| p.x <= end)?;
        body.loads_mut().set_gravity(GRAVITY);
        Ok(())
    }

    /// Compares default steps with converged steps of the same length.
    fn measure(
        &self,
        gpu: &Gpu,
        (material, h): (&Material, f64),
        note: &dyn Fn(&str),
    ) -> Result<Vec<Cell>> {
        let kind = self.kind;
        let mut body = EngineChoice::Auto.build_tets(gpu, self.mesh.clone(), material, kind)?;
        let settings = CgSettings {
            tolerance: 1e-8,
            acceptable: 1e-2,
            max_iterations: 20_000,
        };
        let own = (self.mesh.clone(), DiscreteModel::new(&self.mesh, material)?);
        let how = (kind, settings);
        let mut exact = CpuTets::of_model(gpu, own, material, how, Precision::Double)?;
        self.hold(body.as_mut())?;
        self.hold(&mut exact)?;
        let mut exact = Some(exact);
        let (mut off, mut way, mut iterations) = (0.0f64, 0.0f64, 0);
        for _ in 0..SAMPLES {
            // Without a reference the cell can still fail.
            match exact.as_mut().map(|exact| exact.run(STEPS / SAMPLES, h)) {
                None | Some(Ok(_)) => {}
                Some(Err(error @ Error::Solver { .. })) => {
                    let (name, poisson) = (&self.name, material.poisson);
                    note(&format!("{name}, ν = {poisson}, {h} s: no truth: {error}"));
                    exact = None;
                }
                Some(Err(other)) => return Err(other),
            }
            match body.run(STEPS / SAMPLES, h) {
                Ok(_) => {}
                Err(Error::Solver { .. }) => {
                    return Ok(cells(4, 100.0 * off / way, 0, f64::NAN));
                }
                Err(other) => return Err(other),
            }
            iterations += body.iterations()?.iter().rev().take(5).sum::<u32>();
            if let Some(exact) = &mut exact {
                let truth = exact.positions()?;
                off = off.max(rms_distance(&body.positions()?, &truth));
                way = way.max(rms_distance(&self.mesh.nodes, &truth));
            }
        }
        let inverted = inverted_elements(body.as_mut())?;
        let share = off / way;
        let state = match (inverted, share) {
            (1.., _) => 3,
            _ if exact.is_none() => 5,
            (_, ..=0.01) => 0,
            (_, ..=0.2) => 1,
            // Includes NaN.
            _ => 2,
        };
        let each = f64::from(iterations) / f64::from(STEPS);
        let share = exact.map_or(f64::NAN, |_| share);
        Ok(cells(state, 100.0 * share, inverted, each))
    }
}

fn cells(state: usize, off: f64, inverted: usize, iterations: f64) -> Vec<Cell> {
    vec![
        STATES[state].into(),
        off.into(),
        inverted.into(),
        iterations.into(),
    ]
}

/// Counts the inverted elements: as the engine does, quadratic tets with J ≤ 0 at a quadrature point.
fn inverted_elements(body: &mut dyn Simulator) -> Result<usize> {
    let elements = body.model().and_then(DiscreteModel::elements);
    let quadratic = elements.filter(|elements| elements.order() == 2).cloned();
    let Some(elements) = quadratic else {
        return Ok(body.report()?.inverted_tets);
    };
    let unit = body.mesh().length_unit.unwrap_or(1.0);
    let positions = body.positions()?;
    let is_inverted = |t: &usize| {
        let shape = elements.quadratic_shape(*t);
        shape
            .zip(elements.quadratic_nodes(*t))
            .is_some_and(|(shape, nodes)| {
                let strains =
                    shape.deformation_gradients(&nodes.map(|v| unit * positions[v as usize]));
                strains.iter().any(|f| f.determinant() <= 0.0)
            })
    };
    Ok((0..elements.tets.len()).filter(is_inverted).count())
}

/// Returns the RMS distance.
fn rms_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

/// Draws the map of the defaults and lists the failed cells.
pub fn run(run: &Run) -> Result<()> {
    let subjects = subjects()?;
    let (youngs, steps): (Vec<f64>, Vec<f64>) = match run.quick {
        true => (vec![1e3, 1e6], vec![1e-2, 1e-1]),
        false => (
            (2..=9).map(|d| 10f64.powi(d)).collect(),
            vec![1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1],
        ),
    };
    let mut points = Vec::new();
    for subject in &subjects {
        for poisson in POISSONS {
            for young in &youngs {
                for h in &steps {
                    points.push(vec![
                        subject.name.as_str().into(),
                        poisson.into(),
                        (*young).into(),
                        (*h).into(),
                    ]);
                }
            }
        }
    }
    let rows =
        run.measure(
            "stability_default",
            &SETTINGS,
            &RESULTS,
            &points,
            |point| match subjects.iter().find(|s| s.name == point[0].text()) {
                Some(subject) => {
                    let material = subject.material(point[1].number(), point[2].number());
                    subject.measure(run.gpu, (&material, point[3].number()), run.note)
                }
                None => Ok(Vec::new()),
            },
        )?;
    let charts = draw_maps(run, &rows, &subjects, (&youngs, &steps))?;
    write_text(run, &rows, &charts)
}

/// Draws a map of step and stiffness for each body and ν. Returns their names.
fn draw_maps(
    run: &Run,
    rows: &[Row],
    subjects: &[Subject],
    (youngs, steps): (&[f64], &[f64]),
) -> Result<Vec<String>> {
    let mut charts = Vec::new();
    for subject in subjects {
        for poisson in POISSONS {
            let name = format!("stability-default-{}-{}", subject.name, 100.0 * poisson);
            let own = |r: &&Row| r.text("body") == subject.name && r.number("poisson") == poisson;
            let state = |young: f64, h: f64| {
                let mut own = rows.iter().filter(own);
                let row = own.find(|r| r.number("young_pa") == young && r.number("step_s") == h);
                let known = row.and_then(|r| STATES.iter().position(|s| *s == r.text("state")));
                known.unwrap_or(STATES.len()).min(5)
            };
            StateMap {
                title: format!(
                    "{}: elements of ν = {poisson} at default settings",
                    subject.name
                ),
                x: Axis::log("step (s)"),
                y: Axis::log("Young's modulus (Pa)"),
                xs: steps.to_vec(),
                ys: youngs.to_vec(),
                states: STATES[..5].iter().map(|s| (*s).to_owned()).collect(),
                cells: youngs
                    .iter()
                    .flat_map(|e| steps.iter().map(|h| state(*e, *h)).collect::<Vec<_>>())
                    .collect(),
                curves: Vec::new(),
            }
            .save(run.dir, &name)?;
            charts.push(name);
        }
    }
    Ok(charts)
}

fn has_failed(row: &Row) -> bool {
    STATES[2..5].contains(&row.text("state"))
}

/// Names a cell and its state.
fn cell_name(row: &Row) -> String {
    format!(
        "{}, ν = {}, {:.0e} Pa, {} s: {} ({:.0} %)",
        row.text("body"),
        row.number("poisson"),
        row.number("young_pa"),
        row.number("step_s"),
        row.text("state"),
        row.number("off_converged_percent")
    )
}

/// Returns the names of the cells that hold with linear tets and fail with quadratic ones.
fn failed_by_order_2_only(rows: &[Row]) -> Vec<String> {
    let holds = |quadratic: &&Row| {
        let name = quadratic.text("body").strip_suffix(QUADRATIC);
        let mut linear = rows.iter().filter(|r| name == Some(r.text("body")));
        linear.any(|r| {
            let is_same = |column: &str| r.number(column) == quadratic.number(column);
            SETTINGS[1..].iter().all(|column| is_same(column))
                && STATES[..2].contains(&r.text("state"))
        })
    };
    let failed = rows.iter().filter(|r| has_failed(r));
    failed.filter(holds).map(cell_name).collect()
}

/// Writes the findings with a list of the failed cells.
fn write_text(run: &Run, rows: &[Row], charts: &[String]) -> Result<()> {
    let failed = rows.iter().filter(|r| has_failed(r)).map(cell_name);
    let failed: Vec<String> = failed.collect();
    let off = rows.iter().map(|r| r.number("off_converged_percent"));
    let worse = failed_by_order_2_only(rows);
    let text = format!(
        "A bar (also with BDF2 and with a rigid rod inside) and a hollow body with slivers, of neo-Hookean elements, linear and quadratic tets, are clamped at one end and released under their weight: {STEPS} steps of implicit Euler (or BDF2) at default settings on the engine chosen by `auto`, compared with the same steps fully converged in float64. Of {} cells, {} fail{} The largest error is {:.1} %. Cells that hold with linear tets and fail with quadratic ones: {}.",
        rows.len(),
        failed.len(),
        match failed.is_empty() {
            true => ".".to_owned(),
            false => format!(": {}.", failed.join("; ")),
        },
        off.fold(0.0, f64::max),
        match worse.is_empty() {
            true => "none".to_owned(),
            false => worse.join("; "),
        },
    );
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    run.write_findings(
        "stability_default",
        "Default settings over time step and stiffness",
        &text,
        &charts,
    )
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A part of the map on a coarse bar.
    #[test]
    fn no_cell_fails_with_quadratic_tets_only() {
        let gpu = Gpu::new().unwrap();
        let mesh = generate::bar([4, 2, 2], generate::PAPER_BAR_SIZE).unwrap();
        let (mut held, mut compared) = (0, 0);
        for kind in [SolverKind::Implicit, SolverKind::Bdf2] {
            let linear = Subject {
                name: kind.name().to_owned(),
                mesh: mesh.clone(),
                kind,
                rod: false,
                order: ElementOrder::Linear,
            };
            let quadratic = linear.of_quadratic_tets().unwrap();
            for (poisson, young, h) in [
                (0.3, 1e3, 1e-2),
                (0.3, 1e4, 1e-1),
                (0.3, 1e8, 1e-3),
                (0.49, 1e3, 1e-2),
                (0.49, 1e5, 1e-1),
                (0.49, 1e6, 1e-2),
            ] {
                let [first, second] = [&linear, &quadratic].map(|subject| {
                    let material = subject.material(poisson, young);
                    let cells = subject.measure(&gpu, (&material, h), &|_| {}).unwrap();
                    let state = STATES.iter().position(|s| *s == cells[0].text());
                    (state.unwrap(), cells[1].number())
                });
                println!("{kind} ν {poisson}, {young:e} Pa, {h} s: {first:?} {second:?}");
                compared += 1;
                held += usize::from(first.0 < 2);
                assert!(
                    second.0 < 2 || first.0 >= 2,
                    "{kind}, ν = {poisson}, {young} Pa, {h} s: {}",
                    STATES[second.0]
                );
            }
        }
        // The comparison needs cells that hold with linear tets.
        assert!(held >= compared - 2, "{held} of {compared}");
    }
}
