//! A floor as a term of the energy in addition to the springs.

use crate::support::gpu;
use glam::DVec3;
use palpate::generate;
use palpate::physics::{Engine, EngineChoice, Floor, Material, NodeTerm, Simulator, SolverKind};
use std::sync::Arc;

/// Drops a ball of 0.1 m from a hundredth of a metre onto a floor, or without one.
fn dropped(kind: SolverKind, engine: Engine, floor: bool) -> (Box<dyn Simulator>, Floor) {
    let mesh = generate::ball(0.05, 6).unwrap();
    let material = Material {
        damping_time: 8e-3,
        ..Material::from_young(1e4)
    };
    let choice = EngineChoice::Exactly(engine);
    let mut ball = choice.build_tets(&gpu(), mesh, &material, kind).unwrap();
    let term = Floor::new(DVec3::new(0.0, 0.0, -0.06), DVec3::Z, 500.0).unwrap();
    if floor {
        ball.add_term(Arc::new(term)).unwrap();
    }
    ball.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
    let dt = ball.largest_stable_step().map_or(0.005, |h| 0.9 * h);
    ball.run((1.5 / dt) as u32, dt).unwrap();
    (ball, term)
}

#[test]
fn ball_rests_on_floor() {
    for (kind, engine) in [
        (SolverKind::Implicit, Engine::Gpu),
        (SolverKind::Implicit, Engine::Cpu),
        (SolverKind::Symplectic, Engine::Gpu),
        (SolverKind::Symplectic, Engine::Cpu),
    ] {
        let (ball, floor) = dropped(kind, engine, true);
        let positions = ball.positions().unwrap();
        let lowest = positions.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        // The few supporting nodes penetrate by some millimetres, by g/ω² times the ratio of the
        // load to the node's mass.
        assert!((-0.068..-0.06).contains(&lowest), "{kind}: {lowest}");
        // The force on the floor equals the weight.
        let (frame, unit) = ball.loads().frame_and_unit();
        let nodes = positions.iter().zip(ball.masses());
        let borne: DVec3 = nodes
            .map(|(p, m)| floor.force(*m, (*p - frame.origin) * unit))
            .sum();
        let weight = 9.81 * ball.masses().iter().sum::<f64>();
        println!("{engine} {kind}: lowest {lowest:.5}, supported {borne} of {weight}");
        assert!((borne.z / weight - 1.0).abs() < 0.02, "{kind}: {borne}");
        assert!(borne.truncate().length() < 1e-3 * weight);
        assert_eq!(ball.report().unwrap().inverted_tets, 0);
    }
    // The check is effective: without a floor the ball falls.
    let (ball, _) = dropped(SolverKind::Implicit, Engine::Cpu, false);
    assert!(ball.positions().unwrap().iter().all(|p| p.z < -0.5));
}

#[test]
fn scene_floor_supports_body_and_rejects_zero_normal() {
    let scene = "[mesh]\ngenerate = \"bar\"\ntets = 300\n[solver]\nname = \"implicit\"\ndt = 0.01\n\
                 [floor]\npoint = [0, 0, -0.3]\n[picture]\nsize = [64, 64]\n";
    let stage = |text: &str| {
        let scene = palpate::scene::Scene::parse(text).unwrap();
        palpate::scene::Stage::new(&gpu(), &scene)
    };
    let mut stood = stage(scene).unwrap();
    assert!(!stood.notes().iter().any(|n| n.starts_with("clamped")));
    stood.run(80, &mut |_| {}).unwrap();
    let mesh = stood.deformed_mesh().unwrap();
    let lowest = mesh.nodes.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    assert!((-0.31..-0.29).contains(&lowest), "{lowest}");
    let flat = scene.replace("-0.3]", "-0.3]\nnormal = [0, 0, 0]");
    let wrong = stage(&flat).err().unwrap();
    assert!(wrong.to_string().contains("invalid floor"), "{wrong}");
}
