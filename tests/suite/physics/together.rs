//! Several bodies as one simulator.

use super::simulators::{bar, carried, cpu_grid, hold, material};
use crate::support::gpu;
use glam::DVec3;
use palpate::Error;
use palpate::gpu::Gpu;
use palpate::mesh::Blade;
use palpate::physics::{
    CpuTets, EngineChoice, GpuTets, GrabMode, Member, MultiBody, Precision, Simulator, SolverKind,
};

/// Offset from one body to the next.
const APART: DVec3 = DVec3::new(0.0, 0.3, 0.0);

fn moved_bar(by: DVec3) -> palpate::mesh::TetMesh {
    let mut mesh = bar();
    mesh.nodes.iter_mut().for_each(|p| *p += by);
    mesh
}

/// Returns a body of each kind, pinned, under gravity, and the largest step of each.
fn members(gpu: &Gpu) -> Vec<Member> {
    let (soft, cg) = (material(), Default::default());
    let implicit = GpuTets::new(gpu, bar(), &soft, SolverKind::Implicit).unwrap();
    let verlet = moved_bar(APART);
    let verlet = CpuTets::new(
        gpu,
        verlet,
        &soft,
        SolverKind::VelocityVerlet,
        cg,
        Precision::Single,
    )
    .unwrap();
    let auto = EngineChoice::Auto;
    let all: [(&str, Box<dyn Simulator>); 4] = [
        ("implicit", Box::new(implicit)),
        ("verlet", Box::new(verlet)),
        ("grid", Box::new(cpu_grid(gpu))),
        ("carried", Box::new(carried(gpu, auto))),
    ];
    let members = all.into_iter().map(|(name, mut simulator)| {
        hold(simulator.as_mut());
        Member {
            name: name.into(),
            step: simulator.largest_stable_step().map_or(0.005, |h| 0.4 * h),
            simulator,
        }
    });
    members.collect()
}

fn drawn(bodies: &mut MultiBody, gpu: &Gpu) -> Vec<DVec3> {
    let mut work = gpu.start_recording();
    bodies.update_nodes(&mut work).unwrap();
    work.submit().unwrap();
    bodies.nodes().positions().unwrap()
}

fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    let apart = a.iter().zip(b).map(|(a, b)| a.distance(*b));
    apart.fold(0.0, f64::max)
}

#[test]
fn member_moves_as_alone_in_its_own_steps() {
    let gpu = gpu();
    let dt = 0.005;
    let mut bodies = MultiBody::new(&gpu, members(&gpu)).unwrap();
    let own: Vec<u32> = bodies
        .members()
        .iter()
        .map(|m| m.report(dt).steps)
        .collect();
    assert!(own[0] == 1 && own[1] > 1 && own[2] > 1, "{own:?}");
    bodies.run(10, dt).unwrap();
    let there = bodies.positions().unwrap();
    let mut first = 0;
    for (mut alone, steps) in members(&gpu).into_iter().zip(own) {
        let simulator = alone.simulator.as_mut();
        simulator.run(10 * steps, dt / f64::from(steps)).unwrap();
        let truth = simulator.positions().unwrap();
        let part = &there[first..first + truth.len()];
        assert_eq!(part, truth, "{}", alone.name);
        first += truth.len();
    }
    assert_eq!(first, there.len());
    // The pass that combines them agrees with its float64 form, and the comparison is effective.
    let seen = drawn(&mut bodies, &gpu);
    assert!(farthest(&seen, &there) < 1e-7);
    bodies.run(1, dt).unwrap();
    assert!(farthest(&seen, &bodies.positions().unwrap()) > 1e-5);
    assert!(farthest(&drawn(&mut bodies, &gpu), &bodies.positions().unwrap()) < 1e-7);
}

#[test]
fn loads_on_all_bodies_act_on_each() {
    let gpu = gpu();
    let dt = 0.005;
    let mut bodies = MultiBody::new(&gpu, members(&gpu)).unwrap();
    // Without gravity, with forces and pins on some nodes of the second.
    let first = bodies.members()[0].simulator.mesh().nodes.len() as u32;
    let count = bodies.mesh().nodes.len();
    let loads = bodies.loads_mut();
    loads.set_gravity(DVec3::ZERO);
    loads.unpin_all();
    loads.pin_nodes(&[first, first + 1, first + 2]).unwrap();
    let mut forces = vec![DVec3::ZERO; count];
    forces[first as usize + 40] = DVec3::new(0.0, 0.0, 1e-3);
    loads.set_forces(&forces).unwrap();
    bodies.run(10, dt).unwrap();
    let moved = |bodies: &MultiBody, i: usize| {
        let own = bodies.members()[i].simulator.as_ref();
        farthest(&own.positions().unwrap(), &own.mesh().nodes)
    };
    let still = |i: usize| moved(&bodies, i) < 1e-7;
    assert!(still(0) && still(2) && still(3));
    assert!(moved(&bodies, 1) > 1e-6);
    let held = &bodies.positions().unwrap()[first as usize..][..3];
    assert!(farthest(held, &bodies.mesh().nodes[first as usize..][..3]) < 1e-9);
    // A grab takes nodes of existing bodies only.
    let at = DVec3::new(0.2, 0.025, 0.025) + APART;
    let grab = bodies.grab(at, 0.02, GrabMode::Follow).unwrap();
    let target = at + DVec3::Z * 0.01;
    bodies.set_target(grab, target).unwrap();
    bodies.run(1, dt).unwrap();
    assert!(moved(&bodies, 1) > 5e-3 && moved(&bodies, 0) < 1e-7);
    let near = |p: &&DVec3| p.distance(at) <= 0.02;
    let rest = &bodies.mesh().nodes[first as usize..];
    let grabbed = rest.iter().filter(near).count();
    assert_eq!(bodies.release(grab).unwrap(), grabbed);
    assert!(bodies.release(grab).is_err());
    let nowhere = bodies.grab(DVec3::splat(9.0), 0.01, GrabMode::Follow);
    assert!(
        nowhere
            .unwrap_err()
            .to_string()
            .contains("body \"implicit\"")
    );
    // Back to the initial state.
    bodies.restart().unwrap();
    assert!(farthest(&bodies.positions().unwrap(), &bodies.mesh().nodes) < 1e-7);
}

#[test]
fn cut_applies_to_all_intersected_bodies() {
    let gpu = gpu();
    let dt = 0.005;
    let mut three = members(&gpu);
    let caged = three.pop().unwrap();
    let mut bodies = MultiBody::new(&gpu, three).unwrap();
    bodies.run(4, dt).unwrap();
    let nodes = bodies.mesh().nodes.len();
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let blade = |x: f64| Blade::from_quad(corners.map(|[y, z]| DVec3::new(x, y, z))).unwrap();
    let change = bodies.cut(&blade(0.101)).unwrap();
    // Tet bodies duplicate nodes, particle bodies lose tets.
    assert!(!change.mesh.duplicated_nodes.is_empty() && !change.mesh.removed.is_empty());
    assert_eq!(
        bodies.mesh().nodes.len(),
        nodes + change.mesh.duplicated_nodes.len()
    );
    for _ in 0..2 {
        bodies.run(6, dt).unwrap();
        let there = bodies.positions().unwrap();
        assert!(farthest(&drawn(&mut bodies, &gpu), &there) < 1e-7);
        let own: f64 = bodies
            .members()
            .iter()
            .map(|m| m.simulator.report().unwrap().energy.total)
            .sum();
        let whole = bodies.report().unwrap();
        assert!((whole.energy.total / own - 1.0).abs() < 1e-9);
        assert_eq!(whole.inverted_tets, 0);
        bodies.cut(&blade(0.051)).unwrap();
    }
    assert!(bodies.cut(&blade(9.0)).unwrap().is_empty());
    let mut with_cage = MultiBody::new(&gpu, vec![caged]).unwrap();
    let refused = with_cage.cut(&blade(0.101)).unwrap_err().to_string();
    assert!(refused.contains("\"carried\""), "{refused}");
}

#[test]
fn failure_names_its_body() {
    let gpu = gpu();
    let mut members = members(&gpu);
    // Far beyond the stability limit of its scheme.
    members[1].step = 1.0;
    let mut bodies = MultiBody::new(&gpu, members).unwrap();
    let error = bodies.run(10, 0.05).unwrap_err();
    assert!(matches!(error, Error::Solver { .. }), "{error}");
    let error = error.to_string();
    assert!(
        error.contains("body \"verlet\"") && error.contains("velocity-verlet"),
        "{error}"
    );
    assert!(MultiBody::new(&gpu, Vec::new()).is_err());
}
