//! The limb phantom: one valid component at every resolution, with all of its tissues and digits.

use crate::mesh::support::{check_generated, rigid_pieces};
use glam::DVec3;
use palpate::generate::{TISSUES, limb};
use palpate::mesh::{Location, QualityReport, TetMesh, Topology, components};

fn centroid(mesh: &TetMesh, t: usize) -> DVec3 {
    mesh.tet_nodes(t).into_iter().sum::<DVec3>() / 4.0
}

/// Returns the number of components of the part of `mesh` beyond `x`.
fn pieces_beyond(mesh: &TetMesh, x: f64) -> usize {
    let tets = (0..mesh.tets.len())
        .filter(|t| centroid(mesh, *t).x > x)
        .map(|t| mesh.tets[t]);
    let part = TetMesh::new(mesh.nodes.clone(), tets.collect(), vec![], vec![]).unwrap();
    components(&Topology::new(&part)).1
}

#[test]
#[ignore = "long: scripts/test --full"]
fn limb_is_one_valid_component_with_all_tissues() {
    for wanted in [2_000, 3_000, 20_000, 100_000] {
        let mesh = limb(wanted).unwrap();
        let off = mesh.tets.len() as f64 / wanted as f64 - 1.0;
        assert!(off.abs() < 0.1, "{wanted}: {} tets", mesh.tets.len());
        let euler = check_generated(&mesh);
        assert_eq!(components(&Topology::new(&mesh)).1, 1);
        let quality = QualityReport::new(&mesh);
        assert!(
            quality.min_dihedral > 5.0,
            "{wanted}: {}°",
            quality.min_dihedral
        );
        let label = &mesh.field("label", Location::Cell).unwrap().values;
        let count = |l: u8| label.iter().filter(|x| **x == f64::from(l)).count();
        let counts = TISSUES.map(|t| count(t.label));
        println!(
            "{wanted}: {} tets, {:.2}°, chi {euler}, tissues {counts:?}",
            mesh.tets.len(),
            quality.min_dihedral
        );
        assert!(counts.iter().all(|n| *n > 0), "{wanted}: {counts:?}");
        assert_eq!(counts.iter().sum::<usize>(), mesh.tets.len());
        if wanted >= 20_000 {
            assert_eq!(euler, 2, "no handle");
            assert_eq!(pieces_beyond(&mesh, 0.27), 4, "four fingers");
            assert!(pieces_beyond(&mesh, 0.225) > 1, "the thumb stands apart");
            assert!(
                (mesh.volume() / 0.79e-3 - 1.0).abs() < 0.02,
                "{}",
                mesh.volume()
            );
        }
    }
}

/// Two of the forearm, seven of the wrist, nineteen of the digits.
#[test]
fn limb_bones_are_disjoint() {
    let mesh = limb(30_000).unwrap();
    let bones = TISSUES[5..].iter().map(|t| i64::from(t.label));
    let bones = rigid_pieces(&mesh, bones.collect());
    assert!(bones.iter().filter(|n| **n > 8).count() == 28, "{bones:?}");
    // The check is effective: with cartilage the number is smaller.
    assert!(rigid_pieces(&mesh, [5, 6, 7].into()).len() < 10);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn limb_intensities_match_surrounding_labels() {
    let mesh = limb(60_000).unwrap();
    let label = &mesh.field("label", Location::Cell).unwrap().values;
    let intensity = &mesh.field("intensity", Location::Node).unwrap().values;
    let median = |name: &str| {
        let wanted = TISSUES.iter().find(|t| t.name == name).unwrap().label;
        let of = (0..mesh.tets.len()).filter(|t| label[*t] == f64::from(wanted));
        let mut corners: Vec<f64> = of
            .flat_map(|t| mesh.tets[t].map(|v| intensity[v as usize]))
            .collect();
        corners.sort_by(f64::total_cmp);
        corners[corners.len() / 2]
    };
    let medians = ["fat", "muscle", "cartilage", "cortical bone"].map(median);
    assert!(medians.is_sorted(), "{medians:?}");
    assert!(medians[0] < 0.0 && medians[3] > 500.0, "{medians:?}");
}

#[test]
#[ignore = "long: scripts/test --full"]
fn limb_is_deterministic() {
    let (a, b) = (limb(8_000).unwrap(), limb(8_000).unwrap());
    assert_eq!((a.nodes, a.tets, a.fields), (b.nodes, b.tets, b.fields));
}

#[test]
fn limb_rejects_invalid_tet_counts() {
    assert!(limb(0).is_err() && limb(1_999).is_err() && limb(usize::MAX).is_err());
}
