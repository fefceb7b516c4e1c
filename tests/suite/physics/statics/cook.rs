//! Cook's membrane in plane strain: a tapered panel clamped at its left and sheared at its right,
//! dominated by bending, which causes volumetric locking in nearly incompressible material.

use super::{Setup, Slides, VOLUMES, YOUNG, face_forces, nodes, order};
use glam::DVec3;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::TetMesh;
use palpate::physics::VolumetricFormulation;

/// Poisson's ratios, and the mean rise of the right face times E t / F:
/// `benches/peers/reference_statics.py cook`, to three digits.
const REFERENCE: [(f64, f64); 3] = [(0.3, 22.0), (0.45, 19.6), (0.49, 18.8)];

/// Returns the panel of n × n cells of six tets, and its thickness.
pub fn panel(n: usize) -> (TetMesh, f64) {
    let thickness = 48.0 / n as f64;
    let mut mesh = box_mesh([n, n, 1], DVec3::new(1.0, 1.0, thickness), Split::Six).unwrap();
    for p in &mut mesh.nodes {
        *p = DVec3::new(48.0 * p.x, 44.0 * p.x + p.y * (44.0 - 28.0 * p.x), p.z);
    }
    (mesh, thickness)
}

/// Returns the mean rise of the panel of this setup.
pub fn rise_of(panel: Setup, thickness: f64) -> f64 {
    let mesh = panel.mesh;
    // Small enough for the linear regime.
    let load = 1e-5 * YOUNG * thickness;
    let right = |p: DVec3| p.x > 48.0 - 1e-9;
    let shear = |area: DVec3| load / (16.0 * thickness) * area.length() * DVec3::Y;
    let forces = face_forces(mesh, panel.material.order, right, shear);
    let rest = Setup {
        pinned: nodes(mesh, |p| p.x < 1e-9),
        forces: forces.clone(),
        slides: Some(Slides::of(thickness)),
        ..panel
    }
    .rest();
    let total: f64 = forces.iter().map(|f| f.y).sum();
    assert!((total / load - 1.0).abs() < 1e-12);
    let work: f64 = (0..forces.len())
        .map(|i| forces[i].dot(rest.moved(i)))
        .sum();
    work / load * YOUNG * thickness / load
}

/// Returns the mean rise for n × n cells.
fn rise(n: usize, poisson: f64, volume: VolumetricFormulation, kept: Option<f64>) -> f64 {
    let (mesh, thickness) = panel(n);
    let setup = Setup {
        kept,
        ..Setup::new(&mesh, poisson, volume)
    };
    rise_of(setup, thickness)
}

/// Linear tets bend too little on so coarse a mesh. With averaged volumes, the error at ν = 0.49 is
/// no larger than at 0.3; with volumes per tet it is.
#[test]
fn averaged_volumes_do_not_lock() {
    let found = |poisson, volume| rise(16, poisson, volume, None);
    for ((poisson, truth), expected) in [
        (REFERENCE[0], [0.1067, 0.0969]),
        (REFERENCE[2], [0.4228, 0.1128]),
    ] {
        let stiff = VOLUMES.map(|v| 1.0 - found(poisson, v) / truth);
        println!("ν = {poisson}: per tet and averaged {stiff:.4?} too stiff");
        let off = |k: usize| (stiff[k] - expected[k]).abs();
        assert!(off(0) < 1e-3 && off(1) < 1e-3, "{stiff:?}");
    }
}

/// Prints both over refinement, and with other fractions that each tet keeps.
#[test]
#[ignore = "long: scripts/test --full"]
fn cook_converges_to_quadratic_tets() {
    println!("| ν | cells | per tet | averaged | reference |");
    println!("| --- | --- | --- | --- | --- |");
    for (poisson, truth) in REFERENCE {
        let mut all = [Vec::new(), Vec::new()];
        for n in [8, 16, 32, 64] {
            for (found, volume) in all.iter_mut().zip(VOLUMES) {
                found.push(rise(n, poisson, volume, None));
            }
            let [a, b] = [0, 1].map(|k| all[k].last().unwrap());
            let off = |x: &f64| 100.0 * (x / truth - 1.0);
            println!(
                "| {poisson} | {n} × {n} | {a:.2} ({:+.1} %) | {b:.2} ({:+.1} %) | {truth} |",
                off(a),
                off(b)
            );
        }
        let last = |k: usize| -> [f64; 3] { all[k][1..].try_into().unwrap() };
        let (per_tet, averaged) = (order(last(0)), order(last(1)));
        println!("ν = {poisson}: order and limit per tet {per_tet:?}, averaged {averaged:?}");
        let error = (all[1][3] / truth - 1.0).abs();
        assert!(
            error < 0.02,
            "ν = {poisson}: relative error of averaged volumes {error}"
        );
        assert!((averaged.1 / truth - 1.0).abs() < 0.01, "{averaged:?}");
        if poisson > 0.48 {
            let locked = (all[0][3] / truth - 1.0).abs();
            assert!(locked > 4.0 * error, "{locked} {error}");
        }
    }
    for kept in [0.0, 0.3, 1.0, 1.5, 3.0, 10.0] {
        let found = [8, 16].map(|n| {
            100.0 * (rise(n, 0.49, VolumetricFormulation::NodalAveraged, Some(kept)) / 18.8 - 1.0)
        });
        println!("ν = 0.49, λ of {kept} μ kept: {found:.2?} %");
    }
}
