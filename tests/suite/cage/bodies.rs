//! Cages made from fine bodies: mass, stiffness, and deflection.

use glam::{DQuat, DVec3};
use palpate::cage::{Cage, CageKind};
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use palpate::physics::grid::GridModel;
use palpate::physics::{
    DiscreteModel, GpuBody, GridBody, Material, MaterialModel, RegionMaterial, SolverKind,
};
use std::collections::BTreeMap;

/// Orientation of a bar: along the axes, or oblique to the cells of its cage.
fn bar(turned: bool) -> TetMesh {
    let mut mesh = generate::bar([20, 5, 5], DVec3::new(0.2, 0.05, 0.05)).unwrap();
    if turned {
        let turn = DQuat::from_rotation_y(0.35) * DQuat::from_rotation_z(0.5);
        mesh.nodes.iter_mut().for_each(|p| *p = turn * *p);
    }
    mesh
}

fn material() -> Material {
    Material {
        damping_time: 0.02,
        ..Material::from_young(2e5)
    }
}

fn elements() -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        ..material()
    }
}

/// Returns the nodes at the fixed end and at the tip of the bar, before its rotation.
fn ends() -> [Vec<u32>; 2] {
    let nodes = bar(false).nodes;
    let chosen = |f: &dyn Fn(&DVec3) -> bool| -> Vec<u32> {
        let all = (0..nodes.len() as u32).filter(|v| f(&nodes[*v as usize]));
        all.collect()
    };
    [chosen(&|p| p.x < 1e-6), chosen(&|p| p.x > 0.2 - 1e-6)]
}

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -1.0);

/// Returns the mean deflection of the tip for these positions of the fine mesh.
fn sunk(mesh: &TetMesh, positions: &[DVec3]) -> f64 {
    let [_, tip] = ends();
    let sum: f64 = tip
        .iter()
        .map(|v| (mesh.nodes[*v as usize] - positions[*v as usize]).z)
        .sum();
    sum / tip.len() as f64
}

/// Returns the body at rest under gravity.
fn settled(gpu: &Gpu, mut body: GpuBody, pinned: &[u32]) -> Vec<DVec3> {
    body.pin_nodes(pinned).unwrap();
    body.set_gravity(GRAVITY);
    let mut solver = SolverKind::Implicit.solver(gpu, &body).unwrap();
    solver.run(&mut body, 120, 0.05).unwrap();
    body.positions().unwrap()
}

fn settled_grid(gpu: &Gpu, cage: &Cage, pinned: &[u32]) -> Vec<DVec3> {
    let mut model = cage.grid.clone().unwrap();
    model.damping = 8.0;
    let h = 0.9 * model.conservative_step();
    let mut body = GridBody::new(gpu, model).unwrap();
    body.pin_nodes(pinned).unwrap();
    body.set_gravity(GRAVITY);
    body.run((3.0 / h) as u32, h).unwrap();
    body.positions().unwrap()
}

fn flags(nodes: &[u32], count: usize) -> Vec<bool> {
    let mut flags = vec![false; count];
    nodes.iter().for_each(|v| flags[*v as usize] = true);
    flags
}

/// Deflections of the tip of the fine bar, of its cage, and of the same tets of the same material
/// without homogenisation.
#[test]
#[ignore = "long: scripts/test --full"]
fn cage_bending_matches_fine_body() {
    let gpu = Gpu::new().unwrap();
    let mut wrong = Vec::new();
    for turned in [false, true] {
        let mesh = bar(turned);
        let [held, _] = ends();
        for (material, kind, nodes, tolerance) in [
            (material(), CageKind::Lattice, 60, 0.15),
            (material(), CageKind::Lattice, 200, 0.05),
            (material(), CageKind::Grid, 200, 0.05),
            (elements(), CageKind::Lattice, 60, 0.2),
            (elements(), CageKind::Lattice, 200, 0.05),
        ] {
            let discrete_model = DiscreteModel::new(&mesh, &material).unwrap();
            let fine = GpuBody::new(&gpu, &mesh, &material).unwrap();
            let truth = sunk(&mesh, &settled(&gpu, fine, &held));
            assert!(truth > 1e-4 && truth < 0.02, "{truth}");
            let mut cage = Cage::new(&mesh, &discrete_model, kind, nodes).unwrap();
            let own = cage.coarse_nodes_for(&held);
            let pinned = flags(&own, cage.model.rest_positions.len());
            cage.fit_stiffness(
                &discrete_model,
                &flags(&held, mesh.nodes.len()),
                &pinned,
                None,
            )
            .unwrap();
            let found = match kind {
                CageKind::Grid => settled_grid(&gpu, &cage, &own),
                CageKind::Lattice => {
                    let discrete_model = cage.model.clone();
                    let body =
                        GpuBody::from_model(&gpu, &cage.mesh, discrete_model, &material).unwrap();
                    settled(&gpu, body, &own)
                }
            };
            let off = sunk(&mesh, &cage.transfer().apply(&found).unwrap()) / truth - 1.0;
            let control = match &mut cage.grid {
                None => {
                    let plain = GpuBody::new(&gpu, &cage.mesh, &material).unwrap();
                    settled(&gpu, plain, &own)
                }
                Some(model) => {
                    *model = GridModel::new(model.shape.clone(), &material).unwrap();
                    settled_grid(&gpu, &cage, &own)
                }
            };
            let control = sunk(&mesh, &cage.transfer().apply(&control).unwrap()) / truth - 1.0;
            let report = cage.report();
            println!(
                "{turned} {kind} of {} {report:?}: {:.4}, without homogenisation {:.4}",
                material.model, off, control
            );
            let fine_enough = off.abs() < tolerance && control.abs() > (2.0 * off.abs()).max(0.05);
            if report.nodes_outside > 0 || !fine_enough {
                wrong.push((turned, kind, nodes, off, control));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn cage_preserves_mass_and_region_stiffness() {
    // The upper half is a hundred times as stiff and twice as dense.
    let mut mesh = bar(false);
    let upper: Vec<bool> = (0..mesh.tets.len())
        .map(|t| mesh.tet_nodes(t).iter().sum::<DVec3>().x / 4.0 > 0.1)
        .collect();
    let label = upper.iter().map(|u| f64::from(u8::from(*u))).collect();
    let field = palpate::mesh::Field::scalar("label", palpate::mesh::Location::Cell, label);
    mesh.set_field(field).unwrap();
    let region = RegionMaterial {
        stiffness: 2e7,
        density: 2000.0,
        poisson: 0.4,
    };
    let material = Material {
        region_field: Some("label".into()),
        regions: BTreeMap::from([(1, region)]),
        ..material()
    };
    let discrete_model = DiscreteModel::new(&mesh, &material).unwrap();
    let total: f64 = discrete_model.masses.iter().sum();
    let centre = |n: &DiscreteModel| {
        let moment: DVec3 = n
            .rest_positions
            .iter()
            .zip(&n.masses)
            .map(|(x, m)| *x * *m)
            .sum();
        n.to_file(moment / n.masses.iter().sum::<f64>())
    };
    for kind in [CageKind::Lattice, CageKind::Grid] {
        let cage = Cage::new(&mesh, &discrete_model, kind, 300).unwrap();
        let own: f64 = cage.model.masses.iter().sum();
        assert!((own / total - 1.0).abs() < 1e-9, "{kind}: {own} {total}");
        let apart = centre(&cage.model).distance(centre(&discrete_model));
        assert!(apart < 0.003, "{kind}: {apart}");
        let [soft, stiff] = [0.02..0.08, 0.12..0.18].map(|range| {
            let inside = cage.model.edges.iter().filter(|s| {
                let ends = s
                    .nodes
                    .map(|v| cage.model.to_file(cage.model.rest_positions[v as usize]));
                ends.iter().all(|p| range.contains(&p.x))
            });
            inside.map(|s| s.stiffness).fold(0.0, f64::max)
        });
        assert!(
            (stiff / soft / 100.0 - 1.0).abs() < 0.02,
            "{kind}: {stiff} {soft}"
        );
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn cage_covers_embedded_mesh() {
    for (name, tets) in [("limb", 8_000), ("duct", 6_000), ("ball", 3_000)] {
        let mesh = generate::by_name(name, Some(tets)).unwrap();
        let discrete_model = DiscreteModel::new(&mesh, &Material::soft_tissue()).unwrap();
        for kind in [CageKind::Lattice, CageKind::Grid] {
            for wanted in [60, 1_000] {
                let cage = Cage::new(&mesh, &discrete_model, kind, wanted).unwrap();
                let report = cage.report();
                println!("{name} {kind} {wanted}: {report:?}");
                assert_eq!(report.nodes_outside, 0, "{name} {kind} {wanted}");
                let ratio = report.nodes as f64 / wanted as f64;
                assert!(
                    (0.6..1.6).contains(&ratio),
                    "{name} {kind} {wanted}: {report:?}"
                );
                // Partly filled cells are lighter, none is massless.
                let least = cage.model.masses.iter().filter(|m| **m > 0.0);
                let mean = discrete_model.masses.iter().sum::<f64>() / report.nodes as f64;
                let least = least.copied().fold(f64::INFINITY, f64::min);
                assert!(least < 0.6 * mean, "{name}: {least} {mean}");
            }
        }
    }
    let mesh = bar(false);
    let discrete_model = DiscreteModel::new(&mesh, &material()).unwrap();
    for nodes in [0, 3, 100_000_000] {
        assert!(Cage::new(&mesh, &discrete_model, CageKind::Lattice, nodes).is_err());
    }
}
