//! Quadratic tets against the same references as linear ones.

use super::{Setup, Slides, YOUNG, cook, cylinder, order, relative_error, twist};
use crate::support::gpu;
use glam::DVec3;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::{BoundaryFace, TET_EDGES, TetMesh, Topology};
use palpate::physics::{DiscreteModel, Material, ScaledLoad, VolumetricFormulation};

/// As `cook::rise`.
fn rise(n: usize, poisson: f64) -> f64 {
    let (mesh, thickness) = cook::panel(n);
    let mesh = mesh.with_mid_edge_nodes().unwrap();
    cook::rise_of(Setup::quadratic(&mesh, poisson), thickness)
}

/// Quadratic tets of scikit-fem on increasingly fine meshes, extrapolated (docs/explanation/locking.md).
const COOK: [(f64, f64); 3] = [(0.3, 22.01), (0.45, 19.64), (0.49, 18.79)];

#[test]
fn quadratic_tets_do_not_lock_in_cooks_membrane() {
    // Linear tets of the same mesh: −28 % and −59 %.
    for ((poisson, truth), error) in [COOK[0], COOK[2]].into_iter().zip([-0.0073, -0.0375]) {
        let found = rise(8, poisson) / truth - 1.0;
        println!("ν = {poisson}: {found:+.4}");
        assert!((found - error).abs() < 5e-4, "{found}");
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn quadratic_cook_converges() {
    for (poisson, truth) in COOK {
        let found = [4, 8, 16, 32].map(|n| rise(n, poisson));
        let errors = found.map(|rise| 100.0 * (rise / truth - 1.0));
        println!("ν = {poisson}: {found:.3?}, {errors:+.3?} %");
        // The corners at the clamp are singular, which limits the order.
        assert!(errors.is_sorted() && errors[3].abs() < 0.6, "{errors:?}");
    }
}

/// As `twist::energy`.
fn twisted_energy(n: usize, poisson: f64) -> f64 {
    let mesh = twist::beam(n).with_mid_edge_nodes().unwrap();
    twist::energy_of(Setup::quadratic(&mesh, poisson))
}

#[test]
fn quadratic_twisted_beam_matches_reference() {
    // Linear tets of the same mesh: +131 % and +166 %.
    for ((poisson, truth), error) in twist::REFERENCE.into_iter().zip([0.0447, 0.0602]) {
        let excess = twisted_energy(2, poisson) / truth - 1.0;
        println!("ν = {poisson}: {excess:+.4} excess energy");
        assert!((excess - error).abs() < 1e-3, "{excess}");
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn quadratic_twisted_beam_converges() {
    for (poisson, truth) in twist::REFERENCE {
        let found = [2, 4, 8].map(|n| twisted_energy(n, poisson));
        let (order, limit) = order(found);
        println!(
            "ν = {poisson}: {found:.6?}, order {order:.2}, limit {limit:.6}, reference {truth}"
        );
        assert!((limit / truth - 1.0).abs() < 0.01, "{limit}");
    }
}

/// The ring of `cylinder` with curved edges: mid-edge nodes have the mean radius of their ends.
fn curved_ring(n: usize) -> (TetMesh, f64) {
    let (mesh, thickness) = cylinder::ring(n);
    let radii: Vec<f64> = mesh.nodes.iter().map(|p| p.truncate().length()).collect();
    let mut refined = mesh.with_mid_edge_nodes().unwrap();
    for (edge, v) in mesh.edges().iter().zip(mesh.nodes.len()..) {
        let radius = 0.5 * (radii[edge[0] as usize] + radii[edge[1] as usize]);
        let p = &mut refined.nodes[v];
        let scale = radius / p.truncate().length();
        *p = DVec3::new(scale * p.x, scale * p.y, p.z);
    }
    (refined, thickness)
}

/// Returns −p ∫ N n dA over the curved faces inside the ring, by a rule of degree 4 (Dunavant 1985).
fn pressure_forces(mesh: &TetMesh, pressure: f64) -> Vec<DVec3> {
    const RULE: [(f64, f64); 2] = [
        (0.445_948_490_915_965, 0.223_381_589_678_011),
        (0.091_576_213_509_771, 0.109_951_743_655_322),
    ];
    let mut forces = vec![DVec3::ZERO; mesh.nodes.len()];
    for element in mesh.ten_node_tets().unwrap() {
        for opposite in 0..4 {
            let corners: Vec<usize> = (0..4).filter(|a| *a != opposite).collect();
            let at = |i: usize| mesh.nodes[element[i] as usize];
            let is_inside = |a: &usize| at(*a).truncate().length() < cylinder::RADII[0] + 1e-9;
            if !corners.iter().all(is_inside) {
                continue;
            }
            let middle = |a: usize, b: usize| {
                let ends = [corners[a].min(corners[b]), corners[a].max(corners[b])];
                4 + TET_EDGES.iter().position(|edge| *edge == ends).unwrap()
            };
            let [a, b, c] = [corners[0], corners[1], corners[2]];
            let nodes = [a, b, c, middle(0, 1), middle(1, 2), middle(2, 0)];
            let x = nodes.map(at);
            let inwards = at(opposite) - x[0];
            for (far, weight) in RULE {
                for k in 0..3 {
                    let mut l = [far; 3];
                    l[k] = 1.0 - 2.0 * far;
                    let [p, q, r] = l;
                    let shape = [
                        p * (2.0 * p - 1.0),
                        q * (2.0 * q - 1.0),
                        r * (2.0 * r - 1.0),
                        4.0 * p * q,
                        4.0 * q * r,
                        4.0 * r * p,
                    ];
                    // Derivatives by q and r, with p = 1 − q − r.
                    let by_q = [
                        1.0 - 4.0 * p,
                        4.0 * q - 1.0,
                        0.0,
                        4.0 * (p - q),
                        4.0 * r,
                        -4.0 * r,
                    ];
                    let by_r = [
                        1.0 - 4.0 * p,
                        0.0,
                        4.0 * r - 1.0,
                        -4.0 * q,
                        4.0 * q,
                        4.0 * (p - r),
                    ];
                    let along =
                        |d: [f64; 6]| -> DVec3 { x.iter().zip(d).map(|(x, d)| *x * d).sum() };
                    let normal = 0.5 * along(by_q).cross(along(by_r));
                    let normal = if normal.dot(inwards) > 0.0 {
                        -normal
                    } else {
                        normal
                    };
                    for (node, n) in nodes.iter().zip(shape) {
                        forces[element[*node] as usize] -= pressure * weight * n * normal;
                    }
                }
            }
        }
    }
    forces
}

/// Returns the forces of a pressure on the flat pieces of the faces inside the ring: a third of each in
/// each of its middles, or half in both.
fn pressure_forces_of_pieces(mesh: &TetMesh, pressure: f64) -> Vec<DVec3> {
    let middles = mesh.mid_edge_nodes();
    let mut forces = vec![DVec3::ZERO; mesh.nodes.len()];
    for face in inner_faces(mesh) {
        let [a, b, c] = face.map(|v| mesh.nodes[v as usize]);
        let loaded = || face.iter().filter(|v| middles[**v as usize]);
        let share = -pressure / loaded().count() as f64;
        for v in loaded() {
            forces[*v as usize] += share * 0.5 * (b - a).cross(c - a);
        }
    }
    forces
}

/// Whether a face is inside the ring.
fn is_inner(mesh: &TetMesh, face: [u32; 3]) -> bool {
    let radius = |v: u32| mesh.nodes[v as usize].truncate().length();
    face.into_iter()
        .all(|v| radius(v) < cylinder::RADII[0] + 1e-9)
}

fn inner_faces(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let mut faces = Topology::new(mesh).boundary_triangles(mesh);
    faces.retain(|face| is_inner(mesh, *face));
    faces
}

/// The pressure inside the ring.
#[derive(Clone, Copy, Debug)]
enum PressureForm {
    /// As the engine does it.
    Engine,
    /// As forces: the exact integrals.
    Integrals,
    /// As forces on the flat pieces of its faces.
    Pieces,
}

/// Returns the relative root mean square error against Lamé's displacements.
fn cylinder_error(n: usize, poisson: f64, form: PressureForm) -> f64 {
    let (mesh, thickness) = curved_ring(n);
    let pressure = 1e-5 * YOUNG;
    let topology = Topology::new(&mesh);
    let is_loaded = |b: &&BoundaryFace| is_inner(&mesh, topology.boundary_nodes(&mesh, **b));
    let faces = topology.boundary.iter().filter(is_loaded).copied();
    let (forces, scaled_load) = match form {
        PressureForm::Integrals => (pressure_forces(&mesh, pressure), None),
        PressureForm::Pieces => (pressure_forces_of_pieces(&mesh, pressure), None),
        PressureForm::Engine => {
            let load = ScaledLoad::Pressure(faces.collect());
            (Vec::new(), Some((load, pressure)))
        }
    };
    let rest = Setup {
        forces,
        scaled_load,
        slides: Some(Slides::of(thickness)),
        ..Setup::quadratic(&mesh, poisson)
    }
    .rest();
    relative_error(&rest, cylinder::lame(&mesh, pressure, poisson))
}

/// A smooth solution on curved elements: third order in the displacement.
#[test]
fn quadratic_cylinder_converges_at_third_order() {
    for poisson in [0.3, 0.45, 0.49] {
        let errors = [2, 4, 8].map(|n| cylinder_error(n, poisson, PressureForm::Engine));
        let order = (errors[1] / errors[2]).log2();
        let formatted = errors.map(|e| format!("{e:.2e}"));
        println!("ν = {poisson}: {formatted:?}, order {order:.2}");
        assert!((order - 3.0).abs() < 0.4, "{errors:?}");
    }
}

/// The engine's pressure on curved faces is the exact integral of it, that on their flat pieces is not.
#[test]
fn pressure_on_curved_faces_is_exact() {
    let poisson = 0.3;
    let errors = |form| [2, 4, 8].map(|n| cylinder_error(n, poisson, form));
    let [engine, exact, pieces] = [
        PressureForm::Engine,
        PressureForm::Integrals,
        PressureForm::Pieces,
    ]
    .map(errors);
    for (form, errors) in [("engine", engine), ("exact", exact), ("pieces", pieces)] {
        let order = (errors[1] / errors[2]).log2();
        println!("{form}: {errors:.6?}, order {order:.2}");
    }
    for ((engine, exact), pieces) in engine.into_iter().zip(exact).zip(pieces) {
        assert!((engine - exact).abs() < 0.2 * exact, "{engine} {exact}");
        assert!(pieces > 2.0 * exact, "{pieces} {exact}");
    }
}

/// A mesh without mid-edge nodes, the GPU and averaged volumes are refused in words.
#[test]
fn unsupported_quadratic_bodies_are_refused() {
    use palpate::physics::{Engine, EngineChoice, SolverKind};
    let mesh = box_mesh([2, 1, 1], DVec3::new(0.2, 0.1, 0.1), Split::Six).unwrap();
    let material = Setup::quadratic(&mesh, 0.3).material;
    let linear = DiscreteModel::new(&mesh, &material).unwrap_err();
    assert!(
        linear.to_string().contains("with_mid_edge_nodes"),
        "{linear}"
    );
    let mesh = mesh.with_mid_edge_nodes().unwrap();
    let kind = SolverKind::Implicit;
    let on = |engine: EngineChoice| engine.build_tets(&gpu(), mesh.clone(), &material, kind);
    let refused = on(EngineChoice::Exactly(Engine::Gpu))
        .map(|_| ())
        .unwrap_err();
    assert!(refused.to_string().contains("--engine cpu"), "{refused}");
    assert_eq!(on(EngineChoice::Auto).unwrap().engine(), Engine::Cpu);
    let averaged = Material {
        volume: VolumetricFormulation::NodalAveraged,
        ..material.clone()
    };
    let refused = DiscreteModel::new(&mesh, &averaged).unwrap_err();
    assert!(refused.to_string().contains("order 1"), "{refused}");
}

/// A body of order 2 that was cut between its elements equals the one made of the cut mesh.
#[test]
fn quadratic_body_is_cut_between_its_elements() {
    use palpate::mesh::{Blade, components};
    use palpate::physics::{CgSettings, CpuTets, Precision, Simulator, SolverKind};
    let mesh = box_mesh([6, 2, 2], DVec3::new(0.6, 0.2, 0.2), Split::Six).unwrap();
    let mesh = mesh.with_mid_edge_nodes().unwrap();
    let material = Setup::quadratic(&mesh, 0.3).material;
    let (kind, settings) = (SolverKind::Implicit, CgSettings::default());
    let made = CpuTets::new(
        &gpu(),
        mesh.clone(),
        &material,
        kind,
        settings,
        Precision::Double,
    );
    let mut body = made.unwrap();
    let corner = |y: f64, z: f64| DVec3::new(0.27, y, z);
    let blade = Blade::from_quad([
        corner(-0.1, -0.1),
        corner(0.3, -0.1),
        corner(0.3, 0.3),
        corner(-0.1, 0.3),
    ]);
    let change = body.cut(&blade.unwrap()).unwrap();
    assert!(!change.mesh.duplicated_nodes.is_empty());
    let cut = body.mesh().clone();
    assert_eq!(cut.ten_node_tets().unwrap().len(), mesh.tets.len() / 8);
    let topology = Topology::new(&cut);
    assert_eq!(components(&topology).1, 2);
    let anew = DiscreteModel::new(&cut, &material).unwrap();
    let bent: Vec<DVec3> = anew
        .rest_positions
        .iter()
        .map(|x| *x + 0.1 * DVec3::new(x.y, x.x * x.z, x.x * x.x))
        .collect();
    let model = body.model().unwrap();
    let [of_cut, of_new] = [model, &anew].map(|m| m.elements().unwrap().energy(&bent));
    assert!((of_cut / of_new - 1.0).abs() < 1e-12);
    let total: f64 = model.masses.iter().sum();
    assert!((total / anew.masses.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    assert_eq!(topology.boundary.len(), body.topology().boundary.len());
    body.run(5, 0.01).unwrap();
}
