//! A thick-walled cylinder under internal pressure, in plane strain, against Lamé's solution.

use super::{Setup, Slides, YOUNG, face_forces, relative_error};
use glam::DVec3;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::{ElementOrder, TetMesh};
use palpate::physics::VolumetricFormulation;
use std::f64::consts::TAU;

/// Radii, m.
pub const RADII: [f64; 2] = [1.0, 2.0];

fn radius(p: DVec3) -> f64 {
    p.truncate().length()
}

/// Returns a ring one cell thick, of n cells from inside to outside and 6n around, and its
/// thickness.
pub fn ring(n: usize) -> (TetMesh, f64) {
    let [a, b] = RADII;
    let (around, thickness) = (6 * n, (b - a) / n as f64);
    let sheet = box_mesh([n, around, 1], DVec3::new(1.0, 1.0, 1.0), Split::Six).unwrap();
    // The last row of cells ends where the first begins.
    let key = |p: DVec3| {
        let near = |x: f64, cells: usize| (x * cells as f64).round() as usize;
        [near(p.x, n), near(p.y, around) % around, near(p.z, 1)]
    };
    let index = |[i, j, k]: [usize; 3]| (i + (n + 1) * (j + around * k)) as u32;
    let mut places = vec![DVec3::ZERO; 2 * around * (n + 1)];
    for p in &sheet.nodes {
        let [i, j, k] = key(*p);
        let r = a + (b - a) * i as f64 / n as f64;
        let (sin, cos) = (TAU * j as f64 / around as f64).sin_cos();
        places[index([i, j, k]) as usize] = DVec3::new(r * cos, r * sin, k as f64 * thickness);
    }
    let tets = sheet.tets.iter();
    let tets = tets.map(|t| t.map(|v| index(key(sheet.nodes[v as usize]))));
    let mesh = TetMesh::new(places, tets.collect(), Vec::new(), Vec::new()).unwrap();
    assert!(
        mesh.repairs.warnings.is_empty(),
        "{:?}",
        mesh.repairs.warnings
    );
    (mesh, thickness)
}

/// Returns Lamé's displacements, m, for a pressure p inside: a²p(1+ν)/(E(b²−a²)) ((1−2ν) r + b²/r)
/// at radius r.
pub fn lame(mesh: &TetMesh, pressure: f64, poisson: f64) -> impl Iterator<Item = DVec3> {
    let [a, b] = RADII;
    let front = a * a * pressure * (1.0 + poisson) / (YOUNG * (b * b - a * a));
    mesh.nodes.iter().map(move |p| {
        let r = radius(*p);
        let outwards = front * ((1.0 - 2.0 * poisson) * r + b * b / r);
        outwards / r * DVec3::new(p.x, p.y, 0.0)
    })
}

/// Returns the relative root mean square error of the displacements for n cells through the wall.
fn error(n: usize, poisson: f64, volume: VolumetricFormulation, compared: f64) -> f64 {
    let (mesh, thickness) = ring(n);
    let pressure = 1e-5 * YOUNG;
    let inside = |p: DVec3| radius(p) < RADII[0] + 1e-9;
    let rest = Setup {
        forces: face_forces(&mesh, ElementOrder::Linear, inside, |area| -pressure * area),
        slides: Some(Slides::of(thickness)),
        ..Setup::new(&mesh, poisson, volume)
    }
    .rest();
    relative_error(&rest, lame(&mesh, pressure, compared))
}

#[test]
fn pressurised_cylinder_matches_lame() {
    for (poisson, volume, expected) in [
        (0.3, VolumetricFormulation::PerTet, 0.0138),
        (0.3, VolumetricFormulation::NodalAveraged, 0.0121),
        (0.49, VolumetricFormulation::NodalAveraged, 0.0163),
        // Volumes per tet lock.
        (0.49, VolumetricFormulation::PerTet, 0.1824),
    ] {
        let found = error(8, poisson, volume, poisson);
        println!("ν = {poisson}, {volume}: {found:.4}");
        assert!((found - expected).abs() < 5e-4, "{found}");
    }
    // The result of another ratio is detected.
    let other = error(8, 0.3, VolumetricFormulation::PerTet, 0.4);
    assert!(other > 0.03, "{other}");
}

#[test]
#[ignore = "long: scripts/test --full"]
fn cylinder_converges_at_second_order() {
    for (poisson, volume) in [
        (0.3, VolumetricFormulation::PerTet),
        (0.3, VolumetricFormulation::NodalAveraged),
        (0.49, VolumetricFormulation::NodalAveraged),
    ] {
        let errors = [2, 4, 8, 16].map(|n| error(n, poisson, volume, poisson));
        let order = (errors[2] / errors[3]).log2();
        let formatted = errors.map(|e| format!("{e:.1e}"));
        println!("ν = {poisson}, {volume}: {formatted:?}, order {order:.2}");
        assert!(order > 1.8 && errors[3] < 6e-3, "{errors:?}");
    }
}
