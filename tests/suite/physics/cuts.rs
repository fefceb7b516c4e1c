//! Cuts of moving bodies.

use super::common::{Noise, Twins, solver, step_truth};
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, TetMesh, Topology, components};
use palpate::physics::reference::springs::ReferenceSprings;
use palpate::physics::{DiscreteModel, GpuBody, Material, Report, SolverKind, largest_stable_step};

/// Returns a square blade about `centre` perpendicular to `normal`, of half-width `half`.
fn across(centre: DVec3, normal: DVec3, half: f64) -> Blade {
    let u = half * normal.any_orthonormal_vector();
    let v = normal.cross(u);
    Blade::from_quad([
        centre - u - v,
        centre + u - v,
        centre + u + v,
        centre - u + v,
    ])
    .unwrap()
}

fn bar() -> (TetMesh, Topology) {
    let mesh = generate::bar([8, 4, 4], DVec3::new(0.12, 0.06, 0.06)).unwrap();
    let topology = Topology::new(&mesh);
    (mesh, topology)
}

fn mass_and_momentum(body: &GpuBody) -> (f64, DVec3) {
    let masses = &body.model().masses;
    let v = body.velocities().unwrap();
    let momentum = masses.iter().zip(&v).map(|(m, v)| *m * *v).sum();
    (masses.iter().sum(), momentum)
}

#[test]
fn bar_cut_through_separates() {
    let gpu = Gpu::new().unwrap();
    let (mut mesh, mut topology) = bar();
    let mut body = GpuBody::new(&gpu, &mesh, &Material::uniform_springs(3_000.0, 1.0)).unwrap();
    body.add_force(DVec3::new(-1.0, 0.0, 0.0), |p| p.x < 0.001)
        .unwrap();
    body.add_force(DVec3::new(1.0, 0.0, 0.0), |p| p.x > 0.119)
        .unwrap();
    let mut implicit = solver(&gpu, &body, SolverKind::Implicit);
    implicit.run(&mut body, 20, 0.005).unwrap();
    let stretched = body.positions().unwrap();
    let mut noise = Noise(2);
    let speeds = stretched
        .iter()
        .map(|_| 0.02 * (noise.vector() + 0.5))
        .collect::<Vec<_>>();
    body.set_velocities(&speeds).unwrap();
    let (mass, momentum) = mass_and_momentum(&body);

    let at = DVec3::new(0.06, 0.03, 0.03);
    let blade = across(at, DVec3::X, 0.2);
    let cut = body.cut(&mut mesh, &mut topology, &blade).unwrap();
    assert_eq!(
        (cut.opened_faces.len(), cut.duplicated_nodes.len()),
        (32, 25)
    );
    let (piece, pieces) = components(&topology);
    assert_eq!(pieces, 2);

    // Nothing has moved, and nothing is lost.
    let now = body.positions().unwrap();
    assert_eq!(now[..stretched.len()], stretched);
    for [new, old] in &cut.duplicated_nodes {
        assert_eq!(now[*new as usize], now[*old as usize]);
    }
    let (mass_now, momentum_now) = mass_and_momentum(&body);
    assert!((mass_now / mass - 1.0).abs() < 1e-12);
    assert!(momentum.length() > 1e-3 * mass);
    assert!(momentum_now.distance(momentum) < 1e-12 * mass);

    // No spring crosses the blade.
    let rest = &body.model().rest_positions;
    let whole = across(body.model().to_metres(at), DVec3::X, 0.2);
    let crossing = |model: &DiscreteModel| {
        let crosses = |s: &palpate::physics::Edge| {
            let [a, b] = s.nodes.map(|v| rest[v as usize]);
            // A node on the blade belongs to either side.
            a.x.abs().min(b.x.abs()) > 1e-9 && whole.separates(a, b)
        };
        let mut owner = vec![0; rest.len()];
        for (t, tet) in mesh.tets.iter().enumerate() {
            tet.iter().for_each(|v| owner[*v as usize] = piece[t]);
        }
        let links =
            |s: &palpate::physics::Edge| owner[s.nodes[0] as usize] != owner[s.nodes[1] as usize];
        model
            .edges
            .iter()
            .filter(|s| crosses(s) || links(s))
            .count()
    };
    assert_eq!(crossing(body.model()), 0);
    let (uncut, _) = bar();
    let before = DiscreteModel::new(&uncut, &Material::uniform_springs(3_000.0, 1.0)).unwrap();
    assert!(
        crossing(&before) > 20,
        "the check must be able to detect crossing springs"
    );

    // The same solver continues, and the halves move independently.
    let progress = implicit.run(&mut body, 40, 0.005).unwrap();
    assert_eq!(progress.steps, 60);
    let now = body.positions().unwrap();
    let mut ends = [f64::NEG_INFINITY, f64::INFINITY];
    for (t, tet) in mesh.tets.iter().enumerate() {
        for v in tet {
            let x = now[*v as usize].x;
            let left = mesh.tet_nodes(t).iter().map(|p| p.x).sum::<f64>() < 4.0 * at.x;
            match left {
                true => ends[0] = ends[0].max(x),
                false => ends[1] = ends[1].min(x),
            }
        }
    }
    assert!(ends[1] - ends[0] > 0.02, "{ends:?}");
    assert_eq!(Report::new(&body, &mesh).unwrap().inverted_tets, 0);
}

/// Returns a moving ball, partly cut by an oblique blade, and its reference.
fn cut_ball(gpu: &Gpu, material: &Material, kind: SolverKind) -> Twins {
    let mesh = generate::ball(0.05, 6).unwrap();
    let mut twins = Twins::new(gpu, &mesh, material);
    twins.pin(|p| p.z < -0.04);
    twins.gravity(DVec3::new(0.0, 0.0, -9.81));
    twins.disturb(0.004, 0.05, 3);
    let free = vec![false; mesh.nodes.len()];
    let step = largest_stable_step(twins.body.model(), &free, kind).unwrap_or(0.01);
    let mut stepper = solver(gpu, &twins.body, kind);
    stepper.run(&mut twins.body, 5, 0.4 * step).unwrap();
    let mut topology = Topology::new(&mesh);
    let normal = DVec3::new(1.0, 0.5, 0.2).normalize();
    let blade = across(DVec3::new(0.0, 0.02, 0.03), normal, 0.05);
    let cut = twins
        .body
        .cut(&mut twins.mesh, &mut topology, &blade)
        .unwrap();
    assert!(cut.duplicated_nodes.len() > 20 && components(&topology).1 == 1);
    let pinned = twins.body.pinned().to_vec();
    let gravity = twins.truth.gravity;
    twins.truth = ReferenceSprings::new(twins.body.model().clone());
    twins.truth.gravity = gravity;
    twins.truth.pinned = pinned;
    twins.take_over();
    stepper.run(&mut twins.body, 6, 0.4 * step).unwrap();
    step_truth(kind, &mut twins.truth, 6, 0.4 * step);
    twins
}

#[test]
fn cut_body_motion_matches_float64() {
    let gpu = Gpu::new().unwrap();
    // Explicit Euler needs damping.
    let material = Material {
        damping_time: 2e-4,
        ..Material::from_young(20_000.0)
    };
    for kind in SolverKind::ALL {
        let twins = cut_ball(&gpu, &material, kind);
        let (x, v) = twins.difference();
        println!("{kind:?}: {x:.1e} m, {v:.1e} m/s");
        // The tolerance of conjugate gradients is 10⁻³.
        let most = if kind == SolverKind::Implicit {
            5e-6
        } else {
            5e-8
        };
        assert!(x < most, "{kind:?}: {x}");
        // The model equals the one built from the current mesh.
        let fresh = DiscreteModel::new(&twins.mesh, &material).unwrap();
        let model = twins.body.model();
        assert_eq!(model.edges, fresh.edges);
        assert_eq!(model.masses, fresh.masses);
        assert_eq!(model.rest_positions, fresh.rest_positions);
    }
}

#[test]
fn comparison_detects_uncut_reference() {
    let gpu = Gpu::new().unwrap();
    let kind = SolverKind::Symplectic;
    let mut twins = cut_ball(&gpu, &Material::from_young(20_000.0), kind);
    let spring = &mut twins.truth.model.edges[100];
    spring.stiffness *= 0.5;
    let step = largest_stable_step(
        twins.body.model(),
        &vec![false; twins.mesh.nodes.len()],
        kind,
    );
    let mut stepper = solver(&gpu, &twins.body, kind);
    twins.take_over();
    stepper
        .run(&mut twins.body, 20, 0.4 * step.unwrap())
        .unwrap();
    step_truth(kind, &mut twins.truth, 20, 0.4 * step.unwrap());
    assert!(twins.difference().0 > 2e-6, "{:?}", twins.difference());
}

#[test]
fn cuts_continue_when_capacity_is_exceeded() {
    let gpu = Gpu::new().unwrap();
    let mut mesh = generate::ball(0.05, 8).unwrap();
    let material = Material::from_young(20_000.0);
    let mut twins = Twins::new(&gpu, &mesh, &material);
    let nodes = mesh.nodes.len();
    let mut topology = Topology::new(&mesh);
    let mut stepper = solver(&gpu, &twins.body, SolverKind::Implicit);
    let kind = SolverKind::Symplectic;
    // It sleeps throughout all cuts.
    let mut sleeper = solver(&gpu, &twins.body, kind);
    let (mut noise, mut last) = (Noise(5), 0);
    let (mass, _) = mass_and_momentum(&twins.body);
    for round in 0..24 {
        let blade = across(0.04 * noise.vector(), noise.vector().normalize(), 0.2);
        let cut = twins.body.cut(&mut mesh, &mut topology, &blade).unwrap();
        assert!(!cut.is_empty());
        let steps = stepper.run(&mut twins.body, 2, 0.001).unwrap().steps;
        assert_eq!(steps, last + 2, "round {round}");
        last = steps;
    }
    // The initial capacity of the arrays is below 4,096.
    assert!(
        nodes < 2_500 && mesh.nodes.len() > 4_096,
        "{nodes}, {}",
        mesh.nodes.len()
    );
    assert!((mass_and_momentum(&twins.body).0 / mass - 1.0).abs() < 1e-12);
    twins.truth = ReferenceSprings::new(twins.body.model().clone());
    twins.mesh = mesh;
    twins.disturb(0.001, 0.05, 4);
    let free = vec![false; twins.mesh.nodes.len()];
    let step = 0.4 * largest_stable_step(twins.body.model(), &free, kind).unwrap();
    sleeper.run(&mut twins.body, 4, step).unwrap();
    step_truth(kind, &mut twins.truth, 4, step);
    assert!(twins.difference().0 < 5e-8, "{:?}", twins.difference());
}

#[test]
fn duplicated_nodes_share_pins_loads_and_mass() {
    let gpu = Gpu::new().unwrap();
    let (mut mesh, mut topology) = bar();
    let mut body = GpuBody::new(&gpu, &mesh, &Material::uniform_springs(3_000.0, 1.0)).unwrap();
    body.pin(|p| p.z < 0.001);
    body.add_force(DVec3::new(3.0, 2.0, 1.0), |p| p.z > 0.059)
        .unwrap();
    let masses = body.model().masses.clone();
    let total = |body: &GpuBody| -> DVec3 {
        let forces: Vec<[f32; 4]> = gpu.read_array(body.force_array()).unwrap();
        assert_eq!(forces.len(), body.node_count());
        forces
            .iter()
            .map(|f| DVec3::new(f[0].into(), f[1].into(), f[2].into()))
            .sum()
    };
    assert!(total(&body).distance(DVec3::new(3.0, 2.0, 1.0)) < 1e-5);
    let blade = across(
        DVec3::new(0.052, 0.03, 0.03),
        DVec3::new(1.0, 0.3, 0.2).normalize(),
        0.2,
    );
    let cut = body.cut(&mut mesh, &mut topology, &blade).unwrap();
    assert!(total(&body).distance(DVec3::new(3.0, 2.0, 1.0)) < 1e-5);
    let mut shared = masses.clone();
    for [new, old] in &cut.duplicated_nodes {
        assert_eq!(body.pinned()[*new as usize], body.pinned()[*old as usize]);
        shared[*old as usize] -= body.model().masses[*new as usize];
    }
    for (v, mass) in shared.iter().enumerate() {
        assert!((mass - body.model().masses[v]).abs() < 1e-15, "{v}");
    }
    assert!(
        cut.duplicated_nodes
            .iter()
            .any(|[new, _]| body.pinned()[*new as usize])
    );
    // Loads on all nodes use their new number.
    assert!(body.set_forces(&vec![DVec3::ZERO; masses.len()]).is_err());
    body.set_forces(&vec![DVec3::ZERO; mesh.nodes.len()])
        .unwrap();
}

#[test]
fn removed_slab_leaves_two_halves() {
    let gpu = Gpu::new().unwrap();
    let (mesh, mut topology) = bar();
    let material = Material::from_young(20_000.0);
    let mut twins = Twins::new(&gpu, &mesh, &material);
    twins.disturb(0.002, 0.1, 9);
    let mut stepper = solver(&gpu, &twins.body, SolverKind::Symplectic);
    stepper.run(&mut twins.body, 3, 1e-4).unwrap();
    let middle = |t: &u32| {
        let x = mesh.tet_nodes(*t as usize).iter().map(|p| p.x).sum::<f64>() / 4.0;
        (x - 0.06).abs() < 0.015
    };
    let chosen: Vec<u32> = (0..mesh.tets.len() as u32).filter(middle).collect();
    let before = mass_and_momentum(&twins.body).0;
    let cut = twins
        .body
        .remove(&mut twins.mesh, &mut topology, &chosen)
        .unwrap();
    assert_eq!((cut.removed.len(), twins.mesh.tets.len()), (160, 480));
    assert_eq!(components(&topology).1, 2);
    let (mass, _) = mass_and_momentum(&twins.body);
    assert!((mass / before - 0.75).abs() < 1e-12);
    twins.truth = ReferenceSprings::new(DiscreteModel::new(&twins.mesh, &material).unwrap());
    assert_eq!(twins.truth.model.edges, twins.body.model().edges);
    twins.take_over();
    stepper.run(&mut twins.body, 6, 1e-4).unwrap();
    step_truth(SolverKind::Symplectic, &mut twins.truth, 6, 1e-4);
    assert!(twins.difference().0 < 2e-7, "{:?}", twins.difference());
}

#[test]
fn missing_cut_is_harmless_and_wrong_mesh_is_rejected() {
    let gpu = Gpu::new().unwrap();
    let (mut mesh, mut topology) = bar();
    let mut body = GpuBody::new(&gpu, &mesh, &Material::uniform_springs(3_000.0, 1.0)).unwrap();
    let mut stepper = solver(&gpu, &body, SolverKind::Verlet);
    body.add_force(DVec3::X, |p| p.x > 0.1).unwrap();
    stepper.run(&mut body, 5, 1e-4).unwrap();
    let x = body.positions().unwrap();
    let far = across(DVec3::new(5.0, 0.0, 0.0), DVec3::X, 0.2);
    let cut = body.cut(&mut mesh, &mut topology, &far).unwrap();
    assert!(cut.is_empty() && cut.duplicated_nodes.is_empty());
    assert_eq!(body.positions().unwrap(), x);
    // Verlet continues with its last step, without a restart.
    let mut other = GpuBody::new(&gpu, &mesh, &Material::uniform_springs(3_000.0, 1.0)).unwrap();
    let mut same = solver(&gpu, &other, SolverKind::Verlet);
    other.add_force(DVec3::X, |p| p.x > 0.1).unwrap();
    same.run(&mut other, 10, 1e-4).unwrap();
    stepper.run(&mut body, 5, 1e-4).unwrap();
    assert_eq!(body.positions().unwrap(), other.positions().unwrap());

    let mut small = generate::paper_bar().unwrap();
    let mut its_topology = Topology::new(&small);
    let blade = across(DVec3::new(0.05, 0.0, 0.0), DVec3::X, 0.2);
    let error = body.cut(&mut small, &mut its_topology, &blade).unwrap_err();
    assert!(
        error.to_string().contains("the mesh it was created from"),
        "{error}"
    );
    assert!(body.remove(&mut small, &mut its_topology, &[0]).is_err());
}
