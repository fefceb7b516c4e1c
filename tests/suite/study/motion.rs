//! The reference solution of motions, and the convergence of solvers to it in float64.

use crate::support::gpu;
use glam::DVec3;
use palpate::generate::{self, Split};
use palpate::mesh::TetMesh;
use palpate::physics::{
    CpuTets, Damping, DiscreteModel, Discretisation, Edge, Material, MaterialModel, Precision,
    Simulator, SolverKind, SpringNetwork,
};
use palpate::study::reference_motion::{MotionState, ReferenceMotion};
use palpate::study::static_equilibrium::Cantilever;
use palpate::study::{Run, STUDIES};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Returns the paper's bar in float64, clamped at one end, and the rotated state from which it is
/// released.
fn bar(damping_time: f64) -> (CpuTets, MotionState) {
    let material = Material {
        damping_time,
        ..Material::uniform_springs(3_000.0, 0.0)
    };
    let mesh = generate::paper_bar().unwrap();
    let (kind, settings) = ReferenceMotion::converged_scheme(SolverKind::VelocityVerlet);
    let mut bar = CpuTets::new(
        &gpu(),
        mesh.clone(),
        &material,
        kind,
        settings,
        Precision::Double,
    )
    .unwrap();
    let nodes = (0u32..).zip(&mesh.nodes);
    let held: Vec<u32> = nodes.filter(|n| n.1.x < 1e-6).map(|n| n.0).collect();
    bar.pin_nodes(&held).unwrap();
    let gravity = DVec3::new(0.0, 3.0, -9.81);
    bar.loads_mut().set_gravity(gravity);
    let mut start = MotionState::rest(&bar);
    for (v, x) in start.v.iter_mut().zip(&mesh.nodes) {
        *v = DVec3::new(0.0, 0.03 - x.z, x.y - 0.03) * 20.0 * x.x / 0.12;
    }
    (bar, start)
}

const DURATION: f64 = 0.02;

fn swing(
    (bar, start): &mut (CpuTets, MotionState),
    kind: SolverKind,
    steps: u32,
) -> Vec<MotionState> {
    let found = ReferenceMotion::simulate(
        bar,
        start,
        ReferenceMotion::converged_scheme(kind),
        DURATION,
        [4, steps],
    );
    found.unwrap().unwrap()
}

fn exact(bar: &mut (CpuTets, MotionState)) -> Vec<MotionState> {
    let run = |steps| Ok(Some(swing(bar, SolverKind::VelocityVerlet, steps)));
    ReferenceMotion::new(32, 1 << 12, 1e-9, 0.01, run)
        .unwrap()
        .unwrap()
        .states
}

/// Returns the order of convergence of a solver, over steps well below the limit.
fn order(bar: &mut (CpuTets, MotionState), kind: SolverKind, truth: &[MotionState]) -> f64 {
    // Errors of an undamped explicit step in the fastest modes decay only over many steps.
    let first = match kind {
        SolverKind::Explicit => 1024,
        SolverKind::Implicit => 64,
        _ => 32,
    };
    let points = [first, 2 * first, 4 * first].map(|steps| {
        let found = swing(bar, kind, steps);
        [1.0 / f64::from(steps), MotionState::distance(&found, truth)]
    });
    ReferenceMotion::fitted_order(&points)
}

#[test]
fn convergence_orders_match_schemes() {
    for (damping_time, orders) in [
        (0.0, [1.0, 1.0, 2.0, 2.0, 1.0]),
        (5e-4, [1.0, 1.0, 1.0, 2.0, 1.0]),
    ] {
        let mut bar = bar(damping_time);
        let limit = bar.0.largest_stable_step();
        assert!(DURATION / 128.0 < limit.unwrap(), "{limit:?}");
        let truth = exact(&mut bar);
        for (kind, expected) in SolverKind::ALL.into_iter().zip(orders) {
            let found = order(&mut bar, kind, &truth);
            assert!(
                (found - expected).abs() < 0.2,
                "{kind}, damped by {damping_time} s: order {found}, not {expected}"
            );
        }
    }
    // The fit is effective: a second-order scheme compared with a slightly wrong reference shows no
    // order of convergence.
    let mut bar = bar(0.0);
    let mut off = exact(&mut bar);
    off.iter_mut()
        .flat_map(|s| &mut s.x)
        .for_each(|x| x.y += 1e-5);
    assert!(order(&mut bar, SolverKind::Verlet, &off) < 1.0);
}

#[test]
fn fit_exponent_recovers_power_law() {
    let line = [[1.0, 3.0], [2.0, 24.0], [4.0, 192.0]];
    assert!((ReferenceMotion::fitted_order(&line) - 3.0).abs() < 1e-12);
    assert!((ReferenceMotion::fitted_order(&[line[0], [0.0, 1.0], line[2]]) - 3.0).abs() < 1e-12);
    assert!(ReferenceMotion::fitted_order(&line[..1]).is_nan());
}

/// Two masses on a spring, pulled apart: x = L/2 + a cos ωt with ω² = 2κ/m, and with damping
/// e^(−γt) cos.
#[test]
fn single_spring_matches_exact_oscillation() {
    let (kappa, mass, length, pull) = (50.0, 0.1, 0.2, 0.02);
    for damping in [0.0, 0.4] {
        // From a mesh of one tet, whose other two nodes are not connected.
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| length * p);
        let mesh = TetMesh::new(corners.to_vec(), vec![[0, 1, 2, 3]], vec![], vec![]).unwrap();
        let material = Material::from_young(1.0);
        let discrete_model = DiscreteModel {
            masses: vec![mass; 4],
            edges: vec![Edge {
                nodes: [0, 1],
                stiffness: kappa,
                length,
            }],
            damping_time: 0.0,
            discretisation: Discretisation::Springs(SpringNetwork {
                damping,
                damping_kind: Damping::Axial,
            }),
            ..DiscreteModel::new(&mesh, &material).unwrap()
        };
        let scheme = ReferenceMotion::converged_scheme(SolverKind::VelocityVerlet);
        let (kind, settings) = scheme;
        let mut body = CpuTets::of_model(
            &gpu(),
            (mesh, discrete_model),
            &material,
            (kind, settings),
            Precision::Double,
        )
        .unwrap();
        let mut start = MotionState::rest(&body);
        start.x[0].x -= 0.5 * pull;
        start.x[1].x += 0.5 * pull;
        let decay = damping / mass;
        let omega = (2.0 * kappa / mass - decay * decay).sqrt();
        let stretch = |t: f64| {
            let phase = (omega * t).cos() + decay / omega * (omega * t).sin();
            pull * (-decay * t).exp() * phase
        };
        let run = |n| ReferenceMotion::simulate(&mut body, &start, scheme, 0.5, [5, n]);
        let found = ReferenceMotion::new(8, 1 << 12, 1e-9, pull, run)
            .unwrap()
            .unwrap();
        for (k, state) in found.states.iter().enumerate() {
            let t = 0.1 * (k + 1) as f64;
            let error = state.x[1].x - state.x[0].x - length - stretch(t);
            assert!(error.abs() < 1e-8 * pull, "{error} at {t} s");
        }
        // The extrapolated solution is far better than its inputs.
        let last = found.halvings.last().unwrap();
        assert!(
            last.extrapolated < 1e-9 && last.change > 100.0 * last.extrapolated,
            "{last:?}"
        );
    }
}

/// A reference solution needs a motion.
#[test]
fn divergent_body_is_rejected() {
    let (mut bar, start) = bar(0.0);
    let mut run = |duration, steps| {
        let scheme = ReferenceMotion::converged_scheme(SolverKind::Verlet);
        ReferenceMotion::simulate(&mut bar, &start, scheme, duration, [1, steps]).unwrap()
    };
    assert!(run(2.0, 200).is_none());
    assert!(run(0.2, 2000).is_some());
    assert!(
        ReferenceMotion::new(1, 8, 1e-9, 1.0, |_| Ok(None))
            .unwrap()
            .is_none()
    );
}

/// With refinement, the deflection of elements converges to Timoshenko's beam.
#[test]
fn cantilever_deflection_matches_timoshenko() {
    let beam = Cantilever {
        length: 1.0,
        width: 0.2,
        young: 1e6,
        density: 1000.0,
        gravity: 0.01,
    };
    let material = Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.25,
        ..Material::from_young(beam.young)
    };
    let tip = |cells: usize| {
        let size = DVec3::new(beam.length, beam.width, beam.width);
        let mesh = generate::box_mesh([5 * cells, cells, cells], size, Split::Five).unwrap();
        beam.measured_tip(&gpu(), &mesh, &material).unwrap() / beam.analytic_tip(0.25)
    };
    let [coarse, fine] = [tip(4), tip(8)];
    // Second order in the cell size.
    let limit = fine + (fine - coarse) / 3.0;
    println!("{coarse:?} {fine:?} {limit}");
    assert!(coarse < fine && fine < 0.99);
    assert!((limit - 1.0).abs() < 0.03, "{limit}");
    // The check is effective: the coarse bar alone is too stiff.
    assert!((coarse - 1.0).abs() > 0.03, "{coarse}");
}

/// Runs the quick study of motion, on a given or its default scene.
fn study(dir: &Path, scene: Option<&Path>) -> palpate::Result<()> {
    let (_, _, study) = STUDIES.iter().find(|s| s.0 == "motion").unwrap();
    let run = Run {
        gpu: &gpu(),
        dir,
        quick: true,
        progress: &|_, _| {},
        note: &|_| {},
        stop: &AtomicBool::new(false),
    };
    study(&run, scene)
}

/// Returns the named columns of a CSV, row by row.
fn read(path: &Path, columns: &[&str]) -> Vec<Vec<String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let headers = reader.headers().unwrap().clone();
    let places: Vec<usize> = columns
        .iter()
        .map(|c| headers.iter().position(|h| h == *c).unwrap())
        .collect();
    let rows = reader.records().map(Result::unwrap);
    rows.map(|r| places.iter().map(|k| r[*k].to_owned()).collect())
        .collect()
}

#[test]
#[ignore = "long: scripts/test --full"]
fn quick_motion_study_separates_errors_and_survives_failure() {
    let dir = tempfile::tempdir().unwrap();
    study(dir.path(), None).unwrap();
    let columns = [
        "scene",
        "stiffness",
        "solver",
        "h_s",
        "state",
        "error",
        "time_error",
        "solver_error",
        "f32_error",
        "ms_per_simulated_s",
        "cg_iterations",
        "iterations_a_step",
    ];
    let rows = read(&dir.path().join("motion.csv"), &columns);
    let released = || rows.iter().filter(|r| r[0] == "released");
    let several = |k: usize| released().map(|r| &r[k]).collect::<BTreeSet<_>>().len();
    assert!(several(1) >= 2 && several(2) >= 3 && several(3) >= 4);
    assert!(released().any(|r| r[4] == "diverged" && r[5] == "NaN"));
    let number = |r: &[String], k: usize| r[k].parse::<f64>().unwrap();
    // For rapier only the total is known.
    let (other, ours): (Vec<_>, Vec<_>) = rows.iter().partition(|r| r[2] == "rapier");
    for r in &other {
        assert!(r[4] == "diverged" || number(r, 5) < 1.0, "{r:?}");
    }
    for r in ours.into_iter().filter(|r| r[4] != "diverged") {
        let [error, time, solver, single] = [5, 6, 7, 8].map(|k| number(r, k));
        // The parts sum to the total, and only time can exceed its bound.
        assert!(error <= 1.001 * (time + solver + single) + 1e-9, "{r:?}");
        assert!(time <= 1.001 * (error + solver + single) + 1e-9, "{r:?}");
        // If the solve is truncated, its residual may amplify rounding errors.
        assert!(single < 1e-3 || r[10] == "5", "{r:?}");
        assert!(number(r, 9) > 0.0, "{r:?}");
        if !["implicit", "bdf2", "midpoint"].contains(&r[2].as_str()) {
            assert_eq!(solver, 0.0, "{r:?}");
        }
    }
    // If every step used up its five iterations, the solve was truncated, with a visible error.
    let cut_off = || released().filter(|r| r[10] == "5" && r[11] == "5");
    assert!(cut_off().count() >= 2);
    for r in cut_off() {
        assert!(number(r, 7) > 2e-5, "{r:?}");
    }
    // The reference is invariant to halving the step; it is of second order.
    let truths = read(
        &dir.path().join("motion_truth.csv"),
        &["truth", "order_of_change", "change_of_extrapolation"],
    );
    let found = truths.iter().filter(|r| r[0] != "exact");
    for r in found {
        assert!(
            (number(r, 1) - 2.0).abs() < 0.2 && number(r, 2) < 1e-6,
            "{r:?}"
        );
    }
    assert_eq!(truths.iter().filter(|r| r[0] == "exact").count(), 2);
    // Coarser elements are stiffer, and the springs' own error is stated.
    let text = std::fs::read_to_string(dir.path().join("motion.md")).unwrap();
    assert!(
        text.contains("Model error") && text.contains("order of convergence"),
        "{text}"
    );
    for chart in [
        "motion_released_3000",
        "motion_model_five",
        "motion_model_six",
        "motion_swinging_50000",
        "motion_orders_damped",
    ] {
        assert!(dir.path().join(format!("{chart}.svg")).exists(), "{chart}");
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn motion_study_accepts_or_rejects_scenes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("own.toml");
    let scene = |more: &str| {
        let text = format!(
            "[mesh]\ngenerate = \"bar\"\n[material]\nstiffness = 3000\ndamping = 0.1\n[solver]\nname = \"implicit\"\ndt = 0.004\nsteps = 8\n{more}"
        );
        std::fs::write(&path, text).unwrap();
        study(dir.path(), Some(&path))
    };
    let pin = "[[pin]]\naxis = \"x\"\nbelow = 0.0\n";
    let refused = scene("[grid]\nnodes = 100\n").unwrap_err().to_string();
    assert!(
        refused.contains("own.toml") && refused.contains("grids"),
        "{refused}"
    );
    let long = scene(pin).and_then(|()| {
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace("steps = 8", "steps = 2000000")).unwrap();
        study(dir.path(), Some(&path))
    });
    assert!(long.unwrap_err().to_string().contains("too long"));
    let rows = read(
        &dir.path().join("motion.csv"),
        &["scene", "solver", "state"],
    );
    assert!(rows.iter().all(|r| r[0] == "own"));
    for kind in ["symplectic", "velocity-verlet", "implicit"] {
        assert!(
            rows.iter().any(|r| r[1] == kind && r[2] != "diverged"),
            "{kind}"
        );
    }
}
