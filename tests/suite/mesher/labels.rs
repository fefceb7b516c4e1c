//! Label volumes, thresholds, and tests of the checks themselves.

use crate::mesher::support::{
    angles, euler_number, farthest_from_labels, faults, filled, options, region_volume, volume_of,
};
use glam::{DAffine3, DMat3, DVec3};
use palpate::mesher::{LabelDomain, MeshOptions, MeshedDomain, ThresholdDomain};
use palpate::volume::Volume;
use proptest::prelude::*;

fn noise(seed: u64, n: usize) -> u64 {
    let mut x = seed ^ (n as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 64,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]
    #[test]
    #[ignore = "long: scripts/test --full"]
    fn random_label_maps_mesh_validly(
        seed: u64,
        labels in 2u64..=6,
        block in 1usize..=4,
        edge in 0.6f64..3.0,
        grading in 0u32..3,
    ) {
        let volume = volume_of([10; 3], |[i, j, k]| {
            let cell = i / block + 100 * (j / block) + 10_000 * (k / block);
            (noise(seed, cell) % labels) as u8
        });
        let Ok(domain) = LabelDomain::new(&volume, None) else { return Ok(()) };
        let wanted = options(edge, f64::from(1 << grading));
        let f = filled(&domain, &wanted);
        prop_assert_eq!(faults(&f), Vec::<String>::new());
        prop_assert!(angles(&f).0 > 4.0, "{}", angles(&f).0);
        // Deterministic, alone or in parallel with others.
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let again = alone.install(|| filled(&domain, &wanted));
        prop_assert_eq!(bits(&f.nodes), bits(&again.nodes));
        prop_assert!(f.tets == again.tets && f.regions == again.regions);
    }
}

fn bits(nodes: &[DVec3]) -> Vec<[u64; 3]> {
    nodes
        .iter()
        .map(|p| p.to_array().map(f64::to_bits))
        .collect()
}

#[test]
fn checkerboards_mesh_validly() {
    for (block, labels, edge) in [(1, 2, 1.0), (2, 2, 1.1), (2, 3, 0.7), (3, 4, 2.0)] {
        let volume = volume_of([8; 3], |c| {
            (c.map(|i| i / block).iter().sum::<usize>() % labels) as u8
        });
        let domain = LabelDomain::new(&volume, None).unwrap();
        let f = filled(&domain, &options(edge, 2.0));
        assert_eq!(faults(&f), Vec::<String>::new(), "{block} {labels} {edge}");
        assert!(angles(&f).0 > 4.0);
    }
}

/// Returns a ball around another, off-centre, and a rod with round ends through both, in 32³
/// voxels.
fn phantom() -> Volume {
    volume_of([32; 3], |c| {
        let p = DVec3::from(c.map(|i| i as f64 + 0.5));
        let along = (p.x - 15.3).clamp(-9.5, 9.5);
        let bar = p.distance(DVec3::new(15.3 + along, 17.0, 15.0));
        match () {
            _ if bar < 3.5 => 3,
            _ if p.distance(DVec3::new(17.0, 15.0, 16.0)) < 7.0 => 2,
            _ if p.distance(DVec3::splat(15.6)) < 12.0 => 1,
            _ => 0,
        }
    })
}

#[test]
#[ignore = "long: scripts/test --full"]
fn regions_match_voxel_volume_and_surface() {
    let volume = phantom();
    let domain = LabelDomain::new(&volume, None).unwrap();
    let mut errors = Vec::new();
    for edge in [2.0, 1.0] {
        let f = filled(&domain, &options(edge, 4.0));
        assert_eq!(faults(&f), Vec::<String>::new());
        let (there, back) = farthest_from_labels(&f, &volume);
        let off: Vec<f64> = (1..)
            .zip(domain.voxel_volumes())
            .map(|(r, v)| region_volume(&f, r) / v - 1.0)
            .collect();
        println!("{edge}: volumes {off:.4?}, Hausdorff {there:.3} {back:.3}");
        assert!(off.iter().all(|o| o.abs() < 0.03), "{off:?}");
        assert!(there < 1.0 + 1e-9 && back < 1.0, "{there} {back}");
        assert_eq!(euler_number(&f, 3), 2);
        errors.push(off.iter().map(|o| o.abs()).sum::<f64>());
    }
    assert!(errors[1] < 0.6 * errors[0], "{errors:?}");
}

#[test]
fn oblique_anisotropic_voxels_mesh_at_world_positions() {
    let straight = phantom();
    let placed = Volume {
        to_world: DAffine3::from_mat3_translation(
            DMat3::from_rotation_z(0.4) * DMat3::from_diagonal(DVec3::new(0.5, 0.5, -1.2)),
            DVec3::new(100.0, -50.0, 7.0),
        ),
        ..straight
    };
    let domain = LabelDomain::new(&placed, None).unwrap();
    let f = filled(&domain, &options(0.9, 4.0));
    assert_eq!(faults(&f), Vec::<String>::new());
    for (r, v) in (1..).zip(domain.voxel_volumes()) {
        let off = region_volume(&f, r) / v - 1.0;
        assert!(off.abs() < 0.03, "region {r}: {off}");
    }
}

#[test]
fn fully_labelled_volume_meshes_to_box() {
    let volume = volume_of([19, 17, 15], |_| 4);
    let domain = LabelDomain::new(&volume, None).unwrap();
    let windows = ["0.5".parse().unwrap()];
    let threshold = ThresholdDomain::new(&volume, &windows).unwrap();
    let of = |domain: &dyn palpate::mesher::Domain| filled(domain, &options(1.0, 1.0));
    for f in [of(&domain), of(&threshold)] {
        assert_eq!(faults(&f), Vec::<String>::new());
        assert_eq!(euler_number(&f, 1), 2);
        let off = region_volume(&f, 1) / 4845.0 - 1.0;
        assert!(off.abs() < 0.03, "{off}");
    }
}

#[test]
fn selected_labels_are_regions_and_others_outside() {
    let volume = phantom();
    let domain = LabelDomain::new(&volume, Some(&[3, 2])).unwrap();
    assert_eq!(domain.labels(), [3, 2]);
    let f = filled(&domain, &options(2.0, 2.0));
    assert_eq!(f.report.regions.len(), 2);
    let off = region_volume(&f, 1) / domain.voxel_volumes()[0] - 1.0;
    assert!(off.abs() < 0.05, "{off}");
    for wrong in [vec![9], vec![1, 9]] {
        let error = LabelDomain::new(&volume, Some(&wrong)).unwrap_err();
        assert!(error.to_string().contains("label 9"), "{error}");
    }
    assert!(LabelDomain::new(&volume_of([3; 3], |_| 0), None).is_err());
    assert!(
        LabelDomain::new(
            &Volume {
                slope: 0.3,
                ..volume
            },
            None
        )
        .is_err()
    );
}

#[test]
fn adjacent_thresholds_share_boundary() {
    // Values decrease with the distance from the centre: nested balls.
    let volume = volume_of([24; 3], |c| {
        let p = DVec3::from(c.map(|i| i as f64 + 0.5));
        (250.0 - 20.0 * p.distance(DVec3::splat(12.0))).max(0.0) as u8
    });
    let windows = ["100..170", "170"].map(|w| w.parse().unwrap());
    let domain = ThresholdDomain::new(&volume, &windows).unwrap();
    let f = filled(&domain, &options(1.0, 4.0));
    assert_eq!(faults(&f), Vec::<String>::new());
    assert_eq!((euler_number(&f, 1), euler_number(&f, 2)), (4, 2));
    let ball = |r: f64| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
    let (inner, outer) = (region_volume(&f, 2), region_volume(&f, 1));
    assert!((inner / ball(4.0) - 1.0).abs() < 0.06, "{inner}");
    assert!(
        (outer / (ball(7.5) - ball(4.0)) - 1.0).abs() < 0.05,
        "{outer}"
    );
    let wrong = ["251".parse().unwrap()];
    assert!(ThresholdDomain::new(&volume, &wrong).is_err());
    assert!(ThresholdDomain::new(&volume, &[]).is_err());
}

#[test]
fn small_islands_are_merged_or_removed() {
    // A ball with a speck of another label inside, and another speck outside.
    let volume = volume_of([30; 3], |c| {
        let p = DVec3::from(c.map(|i| i as f64 + 0.5));
        let near = |q: [f64; 3], r: f64| p.distance(q.into()) < r;
        match () {
            _ if near([12.0; 3], 2.0) => 2,
            _ if near([12.0; 3], 9.0) => 1,
            _ if near([26.0; 3], 2.5) => 1,
            _ => 0,
        }
    });
    let domain = LabelDomain::new(&volume, None).unwrap();
    let all = filled(&domain, &options(1.0, 2.0));
    assert_eq!(all.report.islands, []);
    let least = MeshOptions {
        min_island: 100.0,
        ..options(1.0, 2.0)
    };
    let f = filled(&domain, &least);
    assert_eq!(faults(&f), Vec::<String>::new());
    let islands: Vec<(u16, usize)> = f
        .report
        .islands
        .iter()
        .map(|i| (i.region, i.islands))
        .collect();
    assert_eq!(islands, [(1, 1), (2, 1)]);
    assert_eq!(f.report.regions.len(), 1);
    assert_eq!(euler_number(&f, 1), 2);
    let gone = f.report.islands[0].volume;
    let both = region_volume(&all, 1) + region_volume(&all, 2);
    assert!((region_volume(&f, 1) - (both - gone)).abs() < 1e-9);
}

#[test]
fn checks_detect_invalid_meshes() {
    let domain = LabelDomain::new(&phantom(), None).unwrap();
    let sound = filled(&domain, &options(3.0, 2.0));
    assert_eq!(faults(&sound), Vec::<String>::new());
    // Half a tet replaced by two: a node in the middle of an edge that its neighbours lack.
    let mut hanging = sound.clone();
    let [a, b, c, d] = hanging.tets[0];
    let middle = 0.5 * (hanging.nodes[a as usize] + hanging.nodes[b as usize]);
    hanging.nodes.push(middle);
    let m = hanging.nodes.len() as u32 - 1;
    hanging.tets[0] = [a, m, c, d];
    hanging.tets.push([m, b, c, d]);
    hanging.regions.push(hanging.regions[0]);
    let find = |filling: &MeshedDomain, fault: &str| {
        let all = faults(filling);
        assert!(all.iter().any(|f| f.contains(fault)), "{fault}: {all:?}");
    };
    find(&hanging, "hanging nodes");
    let mut turned = sound.clone();
    turned.tets[7].swap(0, 1);
    find(&turned, "needs repair");
    let mut holed = sound.clone();
    holed.regions[11] = 0;
    find(&holed, "not one region per tet");
    // Two separate tets that share an edge.
    let mut pinched = sound.clone();
    let n = pinched.nodes.len() as u32;
    let far = DVec3::splat(100.0);
    let corners = [
        DVec3::ZERO,
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        -DVec3::Y,
        -DVec3::Z,
    ];
    pinched.nodes.extend(corners.map(|p| far + p));
    pinched
        .tets
        .extend([[0, 1, 2, 3], [0, 1, 4, 5]].map(|t: [u32; 4]| t.map(|v| v + n)));
    pinched.regions.extend([1, 1]);
    find(&pinched, "1 non-manifold edges");
    let mut flat = sound.clone();
    let [a, b, c, d] = flat.tets[0].map(|v| v as usize);
    flat.nodes[a] = (flat.nodes[b] + flat.nodes[c] + flat.nodes[d]) / 3.0 + 1e-3;
    assert!(angles(&flat).0 < 4.0);
}
