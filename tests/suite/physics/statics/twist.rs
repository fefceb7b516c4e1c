//! A beam with one end rotated by 90°: large strains.

use super::{Setup, VOLUMES, YOUNG, nodes, order};
use glam::{DMat3, DVec3};
use palpate::generate::{Split, box_mesh};
use palpate::mesh::TetMesh;
use palpate::physics::VolumetricFormulation;
use std::f64::consts::FRAC_PI_2;

const SIZE: DVec3 = DVec3::new(0.2, 0.2, 0.6);

/// Poisson's ratios, and the energy over E V: the limits of the lines of
/// `benches/peers/reference_statics.py twist`.
pub const REFERENCE: [(f64, f64); 2] = [(0.3, 7.50e-3), (0.49, 6.60e-3)];

/// Returns the beam of n cells across.
pub fn beam(n: usize) -> TetMesh {
    box_mesh([n, n, 3 * n], SIZE, Split::Six).unwrap()
}

/// Returns the energy over E V of the beam of this setup.
pub fn energy_of(beam: Setup) -> f64 {
    let mesh = beam.mesh;
    let middle = 0.5 * DVec3::new(SIZE.x, SIZE.y, 0.0);
    let turned = mesh
        .nodes
        .iter()
        .map(|p| middle + DMat3::from_rotation_z(FRAC_PI_2 * p.z / SIZE.z) * (*p - middle));
    let rest = Setup {
        pinned: nodes(mesh, |p| p.z < 1e-9 || p.z > SIZE.z - 1e-9),
        start: Some(turned.collect()),
        ..beam
    }
    .rest();
    rest.energy() / (YOUNG * SIZE.element_product())
}

/// Returns the energy over E V for n cells across.
fn energy(n: usize, poisson: f64, volume: VolumetricFormulation) -> f64 {
    energy_of(Setup::new(&beam(n), poisson, volume))
}

#[test]
fn twisted_beam_matches_quadratic_tets() {
    // With volumes per tet the excess grows with ν, with averaged ones it does not.
    let expected = [
        [[1.3141, 0.3660], [1.3088, 0.3644]],
        [[1.6615, 0.4252], [1.3276, 0.3687]],
    ];
    for ((poisson, truth), expected) in REFERENCE.into_iter().zip(expected) {
        let energies = |v| [2, 4].map(|n| energy(n, poisson, v) / truth - 1.0);
        let found = VOLUMES.map(energies);
        println!("ν = {poisson}: excess energy per tet and averaged {found:+.4?}");
        let pairs = found.iter().flatten().zip(expected.iter().flatten());
        let off = pairs.map(|(found, expected)| (found - expected).abs());
        assert!(off.fold(0.0, f64::max) < 1e-3, "{found:?}");
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn twisted_beam_converges_to_quadratic_tets() {
    for (poisson, truth) in REFERENCE {
        for volume in VOLUMES {
            let found = [2, 4, 8].map(|n| energy(n, poisson, volume));
            let (order, limit) = order(found);
            println!(
                "ν = {poisson}, {volume}: {found:.6?}, order {order:.2}, limit {limit:.6}, reference {truth}"
            );
            if volume == VolumetricFormulation::NodalAveraged {
                assert!((limit / truth - 1.0).abs() < 0.01, "{limit}");
            }
        }
    }
}
