//! Dihedral angles and quality of tets with known values.

use approx::assert_relative_eq;
use glam::{DQuat, DVec3};
use palpate::generate::{Split, ball, box_mesh};
use palpate::mesh::{QualityReport, TetMesh, TetQuality};

fn regular() -> [DVec3; 4] {
    [
        DVec3::new(1.0, 1.0, 1.0),
        DVec3::new(-1.0, 1.0, -1.0),
        DVec3::new(1.0, -1.0, -1.0),
        DVec3::new(-1.0, -1.0, 1.0),
    ]
}

#[test]
fn regular_tet_has_highest_quality() {
    let q = TetQuality::new(regular().map(|p| 1e-3 * p + DVec3::splat(7.0)));
    assert_relative_eq!(q.mean_ratio, 1.0, epsilon = 1e-9);
    assert_relative_eq!(
        q.min_dihedral,
        (1.0f64 / 3.0).acos().to_degrees(),
        epsilon = 1e-9
    );
    assert_relative_eq!(q.max_dihedral, q.min_dihedral, epsilon = 1e-9);
}

#[test]
fn dihedral_angles_are_per_edge_and_similarity_invariant() {
    // The corner of a cube: 90° at the three edges from the corner, 54.7° at the others.
    let corner = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let other = 3.0f64.sqrt().recip().acos().to_degrees();
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0);
    for v in [corner, corner.map(|p| turn * p * 1e-4 - DVec3::ONE)] {
        let angles = TetQuality::dihedral_angles(v);
        for (angle, exact) in angles.iter().zip([90.0, 90.0, 90.0, other, other, other]) {
            assert_relative_eq!(*angle, exact, epsilon = 1e-6);
        }
    }
}

#[test]
fn quality_distinguishes_flat_inverted_and_collapsed_tets() {
    let [a, b, c, d] = regular();
    assert_relative_eq!(
        TetQuality::new([a, b, c, d]).mean_ratio,
        -TetQuality::new([b, a, c, d]).mean_ratio
    );
    let flat = TetQuality::new([DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y]);
    assert_eq!(flat.mean_ratio, 0.0);
    assert_relative_eq!(flat.max_dihedral, 180.0);
    let point = TetQuality::new([DVec3::ONE; 4]);
    assert_eq!((point.mean_ratio, point.min_dihedral), (0.0, 0.0));
}

#[test]
fn quality_report_counts_angles_and_lists_worst_first() {
    let mut mesh = box_mesh([20, 20, 20], DVec3::ONE, Split::Five).unwrap();
    let q = QualityReport::new(&mesh);
    assert_eq!(
        q.dihedral_histogram.iter().sum::<usize>(),
        6 * mesh.tets.len()
    );
    // Of each cell's 30 angles 12 are right, 6 are those of the regular tet, 12 are 54.7°.
    assert_eq!(q.dihedral_histogram[5], 8_000 * 12);
    assert_eq!(q.dihedral_histogram[7], 8_000 * 6);
    assert_eq!(q.slivers, 0);
    assert_relative_eq!(q.max_dihedral, 90.0, epsilon = 1e-9);
    let mean =
        (1.0 + 4.0 * TetQuality::new([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]).mean_ratio) / 5.0;
    assert_relative_eq!(q.mean, mean, epsilon = 1e-9);

    // Moves a corner nearly into the opposite face of its tet.
    let [_, b, c, d] = mesh.tet_nodes(12_345);
    mesh.nodes[mesh.tets[12_345][0] as usize] = (b + c + d) / 3.0;
    let q = QualityReport::new(&mesh);
    let ordered = q.worst.windows(2).all(|w| w[0].quality <= w[1].quality);
    assert!(ordered && q.worst.len() == 10);
    assert!(q.slivers >= 1 && q.min == q.worst[0].quality);
    assert!(q.worst.iter().any(|w| w.tet == 12_345));
    assert!((0..mesh.tets.len()).all(|t| TetQuality::new(mesh.tet_nodes(t)).mean_ratio >= q.min));
}

#[test]
fn quality_report_is_deterministic_and_accepts_empty_mesh() {
    let mesh = ball(1.0, 12).unwrap();
    assert_eq!(QualityReport::new(&mesh), QualityReport::new(&mesh));
    assert!(QualityReport::new(&TetMesh::default()).worst.is_empty());
}
