//! The CPU engine in float64 against motions computed independently.

use crate::support::gpu;
use glam::DVec3;
use palpate::generate;
use palpate::physics::{
    CgSettings, CpuTets, Material, MaterialModel, Precision, Simulator, SolverKind,
};

/// The material of `benches/peers/reference_dynamics.py`.
fn material() -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        ..Material::from_young(1e6)
    }
}

/// Returns the deflection of the end of that bar after each of `steps` steps, m.
fn sunk(kind: SolverKind, dt: f64, steps: u32) -> Vec<f64> {
    falling(&material(), 9.81, kind, (dt, steps))
}

/// The same for another material and `gravity`, m/s².
fn falling(
    material: &Material,
    gravity: f64,
    kind: SolverKind,
    (dt, steps): (f64, u32),
) -> Vec<f64> {
    let mesh = generate::bar([8, 2, 2], DVec3::new(0.8, 0.2, 0.2)).unwrap();
    let end: Vec<usize> = (0..mesh.nodes.len())
        .filter(|v| mesh.nodes[*v].x > 0.8 - 1e-9)
        .collect();
    let settings = CgSettings {
        tolerance: 1e-10,
        ..CgSettings::default()
    };
    let mut bar = CpuTets::new(&gpu(), mesh, material, kind, settings, Precision::Double).unwrap();
    let fixed: Vec<u32> = (0..bar.mesh().nodes.len() as u32)
        .filter(|v| bar.mesh().nodes[*v as usize].x < 1e-9)
        .collect();
    bar.pin_nodes(&fixed).unwrap();
    bar.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -gravity));
    let depth = |bar: &CpuTets| {
        let (now, rest) = (bar.positions().unwrap(), &bar.mesh().nodes);
        let all = end.iter().map(|v| rest[*v].z - now[*v].z);
        all.sum::<f64>() / end.len() as f64
    };
    (0..steps)
        .map(|_| {
            bar.run(1, dt).unwrap();
            depth(&bar)
        })
        .collect()
}

/// Returns the maximum deflection, m, and the number of its step.
fn deepest(sunk: &[f64]) -> (f64, usize) {
    let steps = sunk.iter().copied().zip(1..);
    steps.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

#[test]
fn implicit_euler_matches_sparse_newton_reference() {
    let found = sunk(SolverKind::Implicit, 0.01, 100);
    // python benches/peers/reference_dynamics.py
    let known = [
        (10, 0.06563740),
        (25, 0.18845778),
        (50, 0.03523243),
        (100, 0.06730689),
    ];
    for (step, there) in known {
        let here: f64 = found[step - 1];
        assert!((here - there).abs() < 2e-8, "step {step}: {here}, {there}");
    }
    let (depth, step) = deepest(&found);
    assert!((depth - 0.18929358).abs() < 2e-8 && step == 26, "{depth}");
    // The comparison is effective: another scheme gives another motion.
    let other = sunk(SolverKind::Bdf2, 0.01, 26);
    assert!((other[25] - depth).abs() > 1e-3);
}

#[test]
fn second_order_schemes_match_trapezoidal_rule() {
    // python benches/peers/reference_dynamics.py
    let known = [(125, 0.09514070), (250, 0.20468867)];
    for (kind, within) in [(SolverKind::Midpoint, 2e-5), (SolverKind::Bdf2, 1e-4)] {
        let found = sunk(kind, 0.001, 270);
        for (step, there) in known {
            let here: f64 = found[step - 1];
            println!("{kind} {step}: {here} {there} {:.1e}", here - there);
            assert!((here - there).abs() < within, "{kind} {step}: {here}");
        }
        let (depth, step) = deepest(&found);
        assert!((depth - 0.20527739).abs() < within, "{kind}: {depth}");
        assert!(step.abs_diff(262) <= 1, "{kind}: {step}");
    }
    // Implicit Euler, of first order, has a larger error.
    let euler = sunk(SolverKind::Implicit, 0.001, 270);
    assert!((euler[249] - 0.20468867).abs() > 1e-3);
}

/// In an oscillation of a single mode with damping ratio ζ, the deviation from equilibrium
/// decreases by the factor e^(−πζ/√(1−ζ²)) from one extremum to the next.
#[test]
fn damping_ratio_equals_decrement_of_oscillation() {
    let hertz = 1.0 / (2.0 * 0.262);
    for (ratio, kind) in [
        (0.05, SolverKind::Midpoint),
        (0.2, SolverKind::Midpoint),
        (0.05, SolverKind::Bdf2),
    ] {
        let damped = material().with_damping_ratio(ratio, hertz);
        let way = falling(&damped, 0.05, kind, (0.002, 900));
        let turns = way.windows(3).filter_map(|w| {
            let turns = (w[1] - w[0]) * (w[2] - w[1]) < 0.0;
            turns.then_some(w[1])
        });
        let turns: Vec<f64> = turns.collect();
        let found = ((turns[1] - turns[2]) / (turns[1] - turns[0])).abs().ln();
        let expected = -std::f64::consts::PI * ratio / (1.0 - ratio * ratio).sqrt();
        println!("{kind} {ratio}: {found:.4}, {expected:.4}");
        assert!(
            (found / expected - 1.0).abs() < 0.05,
            "{kind} {ratio}: {found}"
        );
    }
    // Without damping it returns to its release position.
    let free = falling(&material(), 0.05, SolverKind::Midpoint, (0.002, 300));
    let (depth, step) = deepest(&free);
    let back = free[step..].iter().copied().fold(f64::INFINITY, f64::min);
    assert!(back.abs() < 0.05 * depth, "{back} of {depth}");
}
