//! The foot phantom: one valid component at every resolution, with 26 separate bones in soft
//! tissue, and the surfaces of these bones.

use crate::mesh::support::{check_generated, rigid_pieces};
use glam::DVec3;
use palpate::generate::{foot, foot_bones};
use palpate::mesh::{Location, QualityReport, Topology, components};
use std::collections::{BTreeMap, HashMap};

#[test]
#[ignore = "long: scripts/test --full"]
fn foot_is_one_valid_component_at_any_resolution() {
    for wanted in [2_000, 10_000, 30_000] {
        let mesh = foot(wanted).unwrap();
        let off = mesh.tets.len() as f64 / wanted as f64 - 1.0;
        assert!(off.abs() < 0.1, "{wanted}: {} tets", mesh.tets.len());
        check_generated(&mesh);
        assert_eq!(components(&Topology::new(&mesh)).1, 1);
        let quality = QualityReport::new(&mesh);
        assert!(quality.min_dihedral > 5.0, "{}°", quality.min_dihedral);
        let (low, high) = mesh.bounds();
        let size = high - low;
        // Length and aspect ratio of a foot.
        assert!((0.24..0.31).contains(&size.x), "{size}");
        assert!((0.3..0.45).contains(&(size.y / size.x)), "{size}");
        assert_eq!(mesh.length_unit, Some(1.0));
    }
}

#[test]
fn foot_bones_are_named_enclosed_in_flesh_and_disjoint() {
    let mesh = foot(60_000).unwrap();
    let label = &mesh.field("label", Location::Cell).unwrap().values;
    let mut count: BTreeMap<i64, usize> = BTreeMap::new();
    for l in label {
        *count.entry(*l as i64).or_default() += 1;
    }
    assert_eq!(mesh.region_names.len(), 27);
    for (l, name) in &mesh.region_names {
        assert!(count.get(l).is_some_and(|n| *n >= 6), "{name}: {count:?}");
    }
    assert_eq!(count.len(), 27);
    let bones = rigid_pieces(&mesh, (2..=27).collect());
    assert_eq!(bones.len(), 26, "no two share a node: {bones:?}");
    let names: Vec<&String> = mesh.region_names.range(2..).map(|(_, name)| name).collect();
    assert_eq!(names.len(), 26, "{names:?}");
    assert!(names.iter().all(|b| b.ends_with(" bone")));
    assert_eq!(names.iter().filter(|b| b.contains("phalanx")).count(), 14);
    let metatarsal = names.iter().filter(|b| b.contains("metatarsal"));
    assert_eq!(metatarsal.count(), 5);
    // Soft tissue covers them: no corner of a bone's tet is far outside, none of its faces is on
    // the skin.
    let topology = Topology::new(&mesh);
    let bare = topology
        .boundary
        .iter()
        .filter(|f| label[f.tet as usize] > 1.0);
    let bare = bare.count();
    assert!(bare * 50 < topology.boundary.len(), "{bare} bare faces");
    // Bones have higher intensities than soft tissue.
    let intensity = &mesh.field("intensity", Location::Node).unwrap().values;
    let mean = |bone: bool| {
        let tets = (0..mesh.tets.len()).filter(|t| (label[*t] > 1.0) == bone);
        let values: Vec<f64> = tets
            .flat_map(|t| mesh.tets[t].map(|v| intensity[v as usize]))
            .collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    assert!(
        mean(true) > 300.0 && mean(false) < 200.0,
        "{} {}",
        mean(true),
        mean(false)
    );
    let heel = |p: &DVec3| p.x < 0.05;
    assert!(mesh.nodes.iter().any(heel));
}

#[test]
fn foot_bones_are_26_closed_surfaces() {
    let bones = foot_bones(0.003).unwrap();
    let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
    let mut piece: Vec<u32> = (0..bones.vertices.len() as u32).collect();
    fn root(piece: &mut [u32], v: u32) -> u32 {
        let mut v = v;
        while piece[v as usize] != v {
            piece[v as usize] = piece[piece[v as usize] as usize];
            v = piece[v as usize];
        }
        v
    }
    for [a, b, c] in &bones.triangles {
        for [p, q] in [[*a, *b], [*b, *c], [*c, *a]] {
            *edges.entry([p.min(q), p.max(q)]).or_default() += if p < q { 1 } else { -1 };
            let (r, s) = (root(&mut piece, p), root(&mut piece, q));
            piece[r as usize] = s;
        }
    }
    assert!(
        edges.values().all(|n| *n == 0),
        "closed, and turned one way"
    );
    let pieces = (0..piece.len() as u32).filter(|v| piece[*v as usize] == *v);
    assert_eq!(pieces.count(), 26);
    // They face outward and enclose the volume of the bones of a foot.
    assert!((5e-5..4e-4).contains(&bones.volume()), "{}", bones.volume());
    assert!(foot_bones(0.01).is_err() && foot_bones(f64::NAN).is_err());
}

#[test]
#[ignore = "long: scripts/test --full"]
fn foot_is_deterministic_and_rejects_invalid_tet_counts() {
    let (a, b) = (foot(4_000).unwrap(), foot(4_000).unwrap());
    assert_eq!((a.nodes, a.tets, a.fields), (b.nodes, b.tets, b.fields));
    assert!(foot(1_999).is_err() && foot(usize::MAX).is_err());
}
