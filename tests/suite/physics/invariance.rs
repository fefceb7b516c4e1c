//! Invariance to node order, orientation, position and units; and conserved quantities.

use super::common::{Noise, Twins, solver};
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use palpate::physics::{Damping, GpuBody, Material, SolverKind};

fn material() -> Material {
    Material {
        damping_time: 2e-4,
        ..Material::from_young(1e5)
    }
}

/// Returns the positions after 40 steps of a bar bending under its weight, in file units.
fn bent(gpu: &Gpu, mesh: &TetMesh, material: &Material, kind: SolverKind) -> Vec<DVec3> {
    let mut body = GpuBody::new(gpu, mesh, material).unwrap();
    let (low, high) = mesh.bounds();
    let limit = low.x + 0.01 * (high.x - low.x);
    body.pin(|p| p.x < limit);
    body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    let h = if kind == SolverKind::Implicit {
        0.01
    } else {
        2e-4
    };
    let steps = if kind == SolverKind::Implicit {
        20
    } else {
        400
    };
    solver(gpu, &body, kind).run(&mut body, steps, h).unwrap();
    body.positions().unwrap()
}

fn largest(differences: impl Iterator<Item = DVec3>) -> f64 {
    differences.map(|d| d.length()).fold(0.0, f64::max)
}

fn beam() -> TetMesh {
    generate::bar([12, 3, 3], DVec3::new(0.4, 0.1, 0.1)).unwrap()
}

const KINDS: [SolverKind; 2] = [SolverKind::Implicit, SolverKind::VelocityVerlet];

#[test]
fn motion_is_invariant_to_node_order_and_orientation() {
    let gpu = Gpu::new().unwrap();
    let mesh = beam();
    let nodes = mesh.nodes.len();
    // A permutation: multiplication by a number coprime to the count.
    let step = (nodes / 2..).find(|s| gcd(*s, nodes) == 1).unwrap();
    let place: Vec<usize> = (0..nodes).map(|i| (i * step + 3) % nodes).collect();
    let mut shuffled = vec![DVec3::ZERO; nodes];
    for (i, p) in mesh.nodes.iter().enumerate() {
        shuffled[place[i]] = *p;
    }
    let mut tets: Vec<[u32; 4]> = mesh
        .tets
        .iter()
        .map(|t| t.map(|v| place[v as usize] as u32))
        .collect();
    tets.reverse();
    for t in tets.iter_mut().step_by(2) {
        t.swap(0, 3);
    }
    let other = TetMesh::new(shuffled, tets, vec![], vec![]).unwrap();
    assert_eq!(other.repairs.inverted_fixed, mesh.tets.len().div_ceil(2));
    for kind in KINDS {
        let a = bent(&gpu, &mesh, &material(), kind);
        let b = bent(&gpu, &other, &material(), kind);
        let moved = largest(a.iter().zip(&mesh.nodes).map(|(a, m)| *a - *m));
        assert!(moved > 0.01 * 0.4, "{kind}: {moved}");
        let apart = largest((0..nodes).map(|i| a[i] - b[place[i]]));
        assert!(apart < 1e-4 * moved, "{kind}: {apart} of {moved}");
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[test]
fn motion_is_invariant_to_position_and_units() {
    let gpu = Gpu::new().unwrap();
    let mesh = beam();
    let away = DVec3::new(5e3, -2e4, 1e4);
    let moved_mesh = changed(&mesh, |p| p + away);
    let in_millimetres = changed(&mesh, |p| 1000.0 * p);
    let millimetres = Material {
        length_unit: 1e-3,
        ..material()
    };
    for kind in KINDS {
        let a = bent(&gpu, &mesh, &material(), kind);
        let moved = largest(a.iter().zip(&mesh.nodes).map(|(a, m)| *a - *m));
        let b = bent(&gpu, &moved_mesh, &material(), kind);
        let apart = largest(a.iter().zip(&b).map(|(a, b)| *a + away - *b));
        assert!(apart < 1e-4 * moved, "{kind}, moved: {apart} of {moved}");
        let c = bent(&gpu, &in_millimetres, &millimetres, kind);
        let apart = largest(a.iter().zip(&c).map(|(a, c)| 1000.0 * *a - *c)) / 1000.0;
        assert!(apart < 1e-4 * moved, "{kind}, in mm: {apart} of {moved}");
        // The comparison is effective: without the unit it is another, kilometre-sized body.
        let d = bent(&gpu, &in_millimetres, &material(), SolverKind::Implicit);
        let apart = largest(a.iter().zip(&d).map(|(a, d)| 1000.0 * *a - *d)) / 1000.0;
        assert!(apart > 0.1 * moved, "{kind}: {apart} of {moved}");
    }
}

fn changed(mesh: &TetMesh, change: impl Fn(DVec3) -> DVec3) -> TetMesh {
    let nodes = mesh.nodes.iter().map(|p| change(*p)).collect();
    TetMesh::new(nodes, mesh.tets.clone(), vec![], vec![]).unwrap()
}

#[test]
fn tiny_and_huge_bodies_stay_finite() {
    let gpu = Gpu::new().unwrap();
    let mesh = generate::paper_bar().unwrap();
    for unit in [1e-9, 1e-6, 1e6, 1e9] {
        let material = Material {
            length_unit: unit,
            ..Material::from_young(1e5)
        };
        let mut twins = Twins::new(&gpu, &mesh, &material);
        twins.pin(|p| p.x < 0.001);
        twins.disturb(0.02, 0.0, 4);
        let before = twins.body.positions().unwrap();
        let mut implicit = solver(&gpu, &twins.body, SolverKind::Implicit);
        // The oscillation period of such a body.
        let h = 5.0 * twins.body.units().time;
        implicit.run(&mut twins.body, 20, h).unwrap();
        let after = twins.body.positions().unwrap();
        assert!(after.iter().all(|p| p.is_finite()));
        let moved = largest(after.iter().zip(&before).map(|(a, b)| *a - *b));
        assert!(moved > 1e-4 && moved < 0.12, "unit {unit} m: {moved}");
        // And from rest with ordinary steps, which differ from the body's time scale by the same
        // ratio.
        twins.disturb(0.02, 0.0, 4);
        implicit.run(&mut twins.body, 5, 0.01).unwrap();
        assert!(
            twins
                .body
                .positions()
                .unwrap()
                .iter()
                .all(|p| p.is_finite())
        );
    }
}

#[test]
fn collapsed_springs_and_isolated_nodes_give_no_nan() {
    let gpu = Gpu::new().unwrap();
    let mut mesh = generate::paper_bar().unwrap();
    // A node that no tet uses, and a flat tet with two coincident corners.
    mesh.nodes.push(DVec3::new(0.01, 0.02, 0.2));
    let twin = mesh.nodes.len() as u32;
    mesh.nodes.push(mesh.nodes[0]);
    mesh.tets.push([0, twin, 1, 5]);
    for kind in SolverKind::ALL {
        let mut body = GpuBody::new(&gpu, &mesh, &material()).unwrap();
        body.set_gravity(DVec3::new(0.0, 0.0, -9.81));
        let mut stepper = solver(&gpu, &body, kind);
        stepper.run(&mut body, 20, 1e-4).unwrap();
        let x = body.positions().unwrap();
        assert!(x.iter().all(|p| p.is_finite()), "{kind}");
        let centre = body.nodes().frame().origin;
        body.set_positions(&vec![centre; mesh.nodes.len()]).unwrap();
        stepper.run(&mut body, 3, 1e-4).unwrap();
        let x = body.positions().unwrap();
        assert!(
            x.iter().all(|p| p.is_finite()),
            "{kind}, all nodes coincident"
        );
    }
}

#[test]
fn free_body_conserves_momentum_and_with_axial_damping_angular_momentum() {
    let gpu = Gpu::new().unwrap();
    for kind in SolverKind::ALL {
        let mut twins = Twins::new(&gpu, &beam(), &material());
        twins.disturb(0.005, 0.5, 21);
        let (momentum, spin, scale) = moments(&twins);
        let h = if kind == SolverKind::Implicit {
            2e-3
        } else {
            1e-4
        };
        let mut stepper = solver(&gpu, &twins.body, kind);
        stepper.run(&mut twins.body, 100, h).unwrap();
        twins.take_over();
        let (after, spin_after, _) = moments(&twins);
        let lost = (after - momentum).length() / scale;
        // Conserved up to the tolerance of conjugate gradients.
        let slack = if kind == SolverKind::Implicit {
            2e-3
        } else {
            2e-4
        };
        assert!(lost < slack, "{kind}: momentum changed by {lost}");
        // Angular momentum is conserved up to the order of the scheme, in metres of lever arm.
        let lost = (spin_after - spin).length() / (scale * 0.2);
        assert!(lost < 1e-3, "{kind}: angular momentum changed by {lost}");
    }
    // The paper's damping dissipates rotation: the comparison is effective.
    let braking = Material {
        damping: 0.05,
        damping_kind: Damping::Relative,
        ..material()
    };
    let mut twins = Twins::new(&gpu, &beam(), &braking);
    let spinning: Vec<DVec3> = twins
        .mesh
        .nodes
        .iter()
        .map(|p| DVec3::Z.cross(*p))
        .collect();
    twins.body.set_velocities(&spinning).unwrap();
    twins.take_over();
    let (_, before, scale) = moments(&twins);
    let mut stepper = solver(&gpu, &twins.body, SolverKind::Symplectic);
    stepper.run(&mut twins.body, 500, 1e-4).unwrap();
    twins.take_over();
    let (_, after, _) = moments(&twins);
    let lost = (after - before).length() / (scale * 0.2);
    assert!(lost > 1e-3, "{lost}");
}

/// Returns momentum, angular momentum, and Σm|v|.
fn moments(twins: &Twins) -> (DVec3, DVec3, f64) {
    let p = &twins.truth;
    let mut total = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for i in 0..p.x.len() {
        let momentum = p.model.masses[i] * p.v[i];
        total.0 += momentum;
        total.1 += p.x[i].cross(momentum);
        total.2 += momentum.length();
    }
    total
}

#[test]
fn undamped_symplectic_schemes_conserve_energy() {
    let gpu = Gpu::new().unwrap();
    for kind in [
        SolverKind::Symplectic,
        SolverKind::Verlet,
        SolverKind::VelocityVerlet,
    ] {
        let mut twins = Twins::new(&gpu, &beam(), &Material::from_young(1e5));
        twins.disturb(0.002, 0.0, Noise(3).0);
        let before = twins.truth.elastic_energy();
        let mut stepper = solver(&gpu, &twins.body, kind);
        stepper.run(&mut twins.body, 1000, 1e-4).unwrap();
        let history = stepper.history(&twins.body).unwrap();
        assert_eq!(history.len(), 1000);
        let mean = history.iter().map(|s| s.kinetic + s.elastic).sum::<f64>() / 1000.0;
        assert!(
            (mean / before - 1.0).abs() < 0.03,
            "{kind}: {mean} of {before} J"
        );
        // The energies of the last step are those of the state.
        twins.take_over();
        let last = history.last().unwrap();
        let elastic = twins.truth.elastic_energy();
        assert!((last.elastic / elastic - 1.0).abs() < 1e-3, "{kind}");
    }
}
