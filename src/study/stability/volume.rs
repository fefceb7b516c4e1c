//! Volume preservation of the material models: a stretched bar and a randomly perturbed one.

use crate::Result;
use crate::generate;
use crate::mesh::signed_volume;
use crate::physics::{
    Capability, CpuTets, DiscreteModel, Material, Precision, Simulator, SolverKind,
    largest_stable_step,
};
use crate::study::reference_motion::ReferenceMotion;
use crate::study::static_equilibrium::{Convergence, at_rest, materials, mesh_of_order, poisson};
use crate::study::{Cell, Run};
use glam::DVec3;

/// Young's modulus, Pa.
const YOUNG: f64 = 1e5;

/// Elongation of the bar, relative to its length.
const STRETCH: f64 = 0.1;

/// Amplitude of the perturbation of a node along each axis, m.
const PERTURBATION: f64 = 0.02;

/// Number and length (s) of the steps in which a perturbed bar settles.
const SETTLING_STEPS: (u32, f64) = (300, 0.01);

const RESULTS: [&str; 6] = [
    "volume_change_percent",
    "free_change_percent",
    "pull_n",
    "largest_step_s",
    "inverted_at_start",
    "inverted_left",
];

/// A reproducible pseudo-random sequence in −1..1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Stretches and perturbs the paper's bar of `material` and measures the results.
fn measure(run: &Run, material: &Material) -> Result<Vec<Cell>> {
    let mesh = mesh_of_order(generate::paper_bar()?, material.order)?;
    let model = DiscreteModel::new(&mesh, material)?;
    let free = vec![false; mesh.nodes.len()];
    let largest = largest_stable_step(&model, &free, SolverKind::Symplectic);

    let (low, high) = mesh.bounds();
    let along = |x: &DVec3| (x.x - low.x) / (high.x - low.x);
    let drawn: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|x| *x + STRETCH * (high.x - low.x) * along(x) * DVec3::X)
        .collect();
    let at_end = |x: &DVec3| !(1e-6..=1.0 - 1e-6).contains(&along(x));
    let nodes = (0u32..).zip(&mesh.nodes);
    let held: Vec<u32> = nodes.filter(|n| at_end(n.1)).map(|n| n.0).collect();
    let (start, exact) = ((drawn.as_slice(), held.as_slice()), Convergence::exact());
    let mut body = at_rest(run.gpu, &mesh, material, start, DVec3::ZERO, exact)?;
    let volume = |nodes: &[DVec3]| -> f64 {
        let tets = mesh.tets.iter();
        tets.map(|t| signed_volume(t.map(|v| nodes[v as usize])))
            .sum()
    };
    let change = volume(&body.positions()?) / volume(&mesh.nodes) - 1.0;
    let forces = Capability::NodalForces.require(body.reactions())?;
    let forces = forces.nodal_forces()?;
    let pull: f64 = forces
        .iter()
        .zip(&mesh.nodes)
        .filter(|(_, x)| along(x) > 0.5 && at_end(x))
        .map(|(f, _)| -f.x)
        .sum();

    let (kind, settings) = ReferenceMotion::converged_scheme(SolverKind::Implicit);
    let mut body = CpuTets::new(
        run.gpu,
        mesh.clone(),
        material,
        kind,
        settings,
        Precision::Double,
    )?;
    let mut noise = Noise(11);
    let thrown: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|x| *x + PERTURBATION * noise.vector())
        .collect();
    body.set_positions(&thrown)?;
    let at_start = body.report()?.inverted_tets;
    let (steps, h) = SETTLING_STEPS;
    body.run(steps, h)?;
    let sideways = (1.0 + STRETCH).powf(-poisson(material));
    Ok(vec![
        (100.0 * change).into(),
        (100.0 * ((1.0 + STRETCH) * sideways * sideways - 1.0)).into(),
        pull.into(),
        largest.unwrap_or(f64::NAN).into(),
        at_start.into(),
        body.report()?.inverted_tets.into(),
    ])
}

/// Measures every material and reports the results.
pub fn run(run: &Run) -> Result<()> {
    let mut matters = materials(YOUNG);
    if run.quick {
        matters.truncate(2);
    }
    let points: Vec<Vec<Cell>> = matters.iter().map(|m| vec![m.0.as_str().into()]).collect();
    let rows = run.measure(
        "stability_volume",
        &["matter"],
        &RESULTS,
        &points,
        |point| match matters.iter().find(|m| m.0 == point[0].text()) {
            Some((_, material)) => measure(run, material),
            None => Ok(Vec::new()),
        },
    )?;
    let lines: String = rows
        .iter()
        .map(|r| {
            format!(
                "| {} | {:+.2} | {:+.2} | {:.1} | {:.2e} | {} of {} |\n",
                r.text("matter"),
                r.number("volume_change_percent"),
                r.number("free_change_percent"),
                r.number("pull_n"),
                r.number("largest_step_s"),
                r.number("inverted_left"),
                r.number("inverted_at_start"),
            )
        })
        .collect();
    let text = format!(
        "Springs do not preserve volume. The paper tried and dropped a force that preserves the volume of each tet, because it shortens the stable step and stiffens the body. Finite elements use a Poisson's ratio instead. The paper's bar of {:.0} kPa, in float64: stretched by {:.0} % between clamped ends, compared with the volume change with free ends (1.1^(1 − 2ν) − 1); the largest stable step of symplectic Euler; and perturbed by up to {:.0} mm per node, after {} converged steps of implicit Euler of {} s.\n\n| material, ν | volume change (%) | with free ends (%) | force (N) | largest explicit step (s) | inverted tets left |\n| --- | --- | --- | --- | --- | --- |\n{lines}",
        YOUNG / 1e3,
        100.0 * STRETCH,
        1e3 * PERTURBATION,
        SETTLING_STEPS.0,
        SETTLING_STEPS.1,
    );
    run.write_findings("stability_volume", "Volume preservation", &text, &[])
}
