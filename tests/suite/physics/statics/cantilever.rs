//! A cantilever under a shear load at its end, against Timoshenko's beam theory.

use super::{Setup, YOUNG, face_forces, nodes, order};
use glam::DVec3;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::ElementOrder;
use palpate::physics::VolumetricFormulation;

const SIZE: DVec3 = DVec3::new(1.0, 0.2, 0.2);

/// Returns the mean deflection of its end, relative to Timoshenko's, for n cells over its height.
fn sag(n: usize, poisson: f64, volume: VolumetricFormulation) -> f64 {
    let mesh = box_mesh([5 * n, n, n], SIZE, Split::Six).unwrap();
    let load = 1e-7 * YOUNG;
    let area = SIZE.y * SIZE.z;
    let end = |p: DVec3| p.x > SIZE.x - 1e-9;
    let shear = |a: DVec3| -load / area * a.length() * DVec3::Z;
    let forces = face_forces(&mesh, ElementOrder::Linear, end, shear);
    let rest = Setup {
        pinned: nodes(&mesh, |p| p.x < 1e-9),
        forces: forces.clone(),
        ..Setup::new(&mesh, poisson, volume)
    }
    .rest();
    let work: f64 = (0..forces.len())
        .map(|i| forces[i].dot(rest.moved(i)))
        .sum();
    let inertia = SIZE.y * SIZE.z.powi(3) / 12.0;
    let bending = load * SIZE.x.powi(3) / (3.0 * YOUNG * inertia);
    // Cowper's shear coefficient of the section.
    let cowper = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson);
    let shear = YOUNG / (2.0 * (1.0 + poisson));
    work / load / (bending + load * SIZE.x / (cowper * shear * area))
}

/// At ν = 0 only the beam theory differs: a clamped end prevents no contraction.
#[test]
#[ignore = "long: scripts/test --full"]
fn cantilever_converges_to_timoshenko() {
    for (poisson, volume) in [
        (0.0, VolumetricFormulation::PerTet),
        (0.3, VolumetricFormulation::PerTet),
        (0.3, VolumetricFormulation::NodalAveraged),
        (0.45, VolumetricFormulation::NodalAveraged),
    ] {
        let found = [2, 4, 8].map(|n| sag(n, poisson, volume));
        // The stiffness is too high, with an error of second order in the cell size.
        let (order, limit) = order(found.map(|sag| 1.0 / sag));
        println!(
            "ν = {poisson}, {volume}: {found:.4?}, order {order:.2}, stiffness {limit:.4} of a beam's"
        );
        assert!((order - 2.0).abs() < 0.25, "{order}");
        // A clamped end that cannot contract is stiffer than a beam's.
        let off = if poisson == 0.0 { 0.01 } else { 0.03 };
        assert!((limit - 1.0).abs() < off, "{limit}");
    }
}

#[test]
fn coarse_cantilever_is_too_stiff_by_known_fraction() {
    let found = sag(2, 0.0, VolumetricFormulation::PerTet);
    println!("{found:.4}");
    assert!((found - 0.5537).abs() < 1e-3, "{found}");
}
