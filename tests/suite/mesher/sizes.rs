//! Meshes of wanted sizes.

use crate::mesher::support::{
    angles, euler_number, faults, filled, options, region_volume, solids, volume_of,
};
use glam::{DAffine3, DVec3};
use palpate::mesh::{Field, Location, TetMesh};
use palpate::mesher::{Domain, MeshOptions, MeshedDomain, SizeField};
use palpate::volume::{Raw, Volume};
use std::f64::consts::PI;
use std::sync::Arc;

/// A field on 24³ voxels over the cube from −1.2 to 1.2.
fn field(length: impl Fn(DVec3) -> f64) -> SizeField {
    let n = 24;
    let step = 2.4 / n as f64;
    let to_world = DAffine3::from_scale_rotation_translation(
        DVec3::splat(step),
        glam::DQuat::IDENTITY,
        DVec3::splat(-1.2 + 0.5 * step),
    );
    let at = |k: usize| {
        let index = [k % n, k / n % n, k / n / n].map(|i| i as f64);
        to_world.transform_point3(DVec3::from(index))
    };
    SizeField::of_volume(Volume {
        size: [n; 3],
        raw: Raw::F64((0..n * n * n).map(|k| length(at(k))).collect()),
        to_world,
        ..Volume::default()
    })
    .unwrap()
}

fn sized(domain: &dyn Domain, sizes: &SizeField) -> MeshedDomain {
    let own = MeshOptions {
        sizes: Some(Arc::new(sizes.clone())),
        ..options(sizes.smallest(), 1.0)
    };
    filled(domain, &own)
}

/// Returns the edge length of a lattice of as large tets as those with centroids in a ball.
fn length_within(f: &MeshedDomain, middle: DVec3, radius: f64) -> f64 {
    let volumes = f.tets.iter().filter_map(|tet| {
        let corners = tet.map(|v| f.nodes[v as usize]);
        let centre = corners.into_iter().sum::<DVec3>() / 4.0;
        (centre.distance(middle) < radius).then(|| palpate::mesh::signed_volume(corners))
    });
    let volumes: Vec<f64> = volumes.collect();
    (12.0 * volumes.iter().sum::<f64>() / volumes.len() as f64).cbrt()
}

#[test]
fn equal_sizes_give_equal_tets() {
    let ball = solids(1.0, |p| vec![(1, 0.97 - p.length())]);
    let by_field = sized(&ball, &field(|_| 0.15));
    let plain = filled(&ball, &options(0.15, 1.0));
    assert_eq!(by_field.nodes, plain.nodes);
    assert_eq!(by_field.tets, plain.tets);
}

#[test]
fn tets_have_wanted_sizes_at_boundaries_and_inside() {
    let ball = solids(1.0, |p| vec![(1, 0.97 - p.length())]);
    // Small on one side, large on the other.
    let length = |p: DVec3| (0.05 + 0.22 * (p - DVec3::X).length()).min(0.4);
    let f = sized(&ball, &field(length));
    assert_eq!(faults(&f), Vec::<String>::new());
    assert_eq!(euler_number(&f, 1), 2);
    for (place, radius) in [(0.95, 0.1), (0.5, 0.2), (-0.3, 0.3), (-0.8, 0.3)] {
        let middle = DVec3::new(place, 0.0, 0.0);
        let ratio = length_within(&f, middle, radius) / length(middle);
        println!("at {place}: {ratio:.2} of what is wanted");
        // Lengths are powers of two of the smallest; cut tets at the boundary are smaller.
        assert!((0.45..1.5).contains(&ratio), "at {place}: {ratio}");
    }
    let off = region_volume(&f, 1) / (4.0 / 3.0 * PI * 0.97f64.powi(3)) - 1.0;
    assert!(off.abs() < 0.05, "{off}");
    // As many tets everywhere as on the finer side would be ten times as many.
    let fine = filled(&ball, &options(f.report.edge, 1.0));
    assert!(fine.tets.len() > 10 * f.tets.len(), "{}", f.tets.len());
    let (low, high) = angles(&f);
    println!("{} tets, angles {low:.1}° to {high:.1}°", f.tets.len());
    assert!(low > 4.0 && high < 172.0, "{low}..{high}");
}

/// Regions that meet along lines, boundaries of all sizes, and a field that jumps.
#[test]
fn junctions_of_unequal_tets_conform() {
    for turn in 0..6 {
        let axis = DVec3::new(1.0, 0.3 * f64::from(turn), 0.2).normalize();
        let parts = solids(1.0, move |p| {
            let outer = 0.93 - p.length();
            let (s, t) = (p.dot(axis), p.z - 0.1 * p.x);
            vec![
                (1, outer.min(s)),
                (2, outer.min(-s).min(t)),
                (3, outer.min(-s).min(-t)),
            ]
        });
        let sizes = field(move |p| match p.dot(DVec3::new(0.4, 1.0, -0.3)) > 0.2 {
            true => 0.06,
            false => 0.06 * f64::from(1 << (turn % 3 + 1)),
        });
        let f = sized(&parts, &sizes);
        assert_eq!(faults(&f), Vec::<String>::new(), "turn {turn}");
        let all: f64 = (1..=3).map(|region| region_volume(&f, region)).sum();
        let off = all / (4.0 / 3.0 * PI * 0.93f64.powi(3)) - 1.0;
        assert!(off.abs() < 0.05, "turn {turn}: {off}");
        let (low, high) = angles(&f);
        println!(
            "turn {turn}: {} tets, angles {low:.1}° to {high:.1}°, {:?}",
            f.tets.len(),
            f.report.optimiser
        );
    }
}

/// A mesh gives its own sizes, or those of a field of lengths; with an error only in one half there are
/// more tets there and fewer in the other, as many in sum.
#[test]
fn sizes_of_meshes_follow_lengths_and_errors() {
    let ball = solids(1.0, |p| vec![(1, 0.97 - p.length())]);
    let first = filled(&ball, &options(0.2, 1.0));
    let mesh = TetMesh::new(first.nodes.clone(), first.tets.clone(), vec![], vec![]).unwrap();
    let again = sized(&ball, &SizeField::of_mesh(&mesh).unwrap());
    let ratio = again.tets.len() as f64 / first.tets.len() as f64;
    println!("own sizes: {ratio:.2} times as many tets");
    let at = |x: f64| DVec3::new(x, 0.0, 0.0);
    let centres = mesh.tets.iter().map(|tet| {
        let corners = tet.map(|v| mesh.nodes[v as usize]);
        corners.into_iter().sum::<DVec3>() / 4.0
    });
    let errors: Vec<f64> = centres
        .map(|c| if c.x > 0.3 { 1.0 } else { 1e-3 })
        .collect();
    let with = |name: &str, values: Vec<f64>| {
        let mut own = mesh.clone();
        own.set_field(Field::scalar(name, Location::Cell, values))
            .unwrap();
        SizeField::of_mesh(&own).unwrap()
    };
    let f = sized(&ball, &with("error", errors));
    assert_eq!(faults(&f), Vec::<String>::new());
    let [right, left] = [0.6, -0.6].map(|x| length_within(&f, at(x), 0.3));
    println!(
        "errors: {} tets for {}, lengths {right:.3}, {left:.3}",
        f.tets.len(),
        first.tets.len()
    );
    assert!(right < 0.17 && left > 0.23, "{right}, {left}");
    let many = f.tets.len() as f64 / first.tets.len() as f64;
    assert!((0.4..2.5).contains(&many), "{many}");
    let lengths = with("edge_length", vec![0.1; mesh.tets.len()]);
    assert_eq!(lengths.smallest(), 0.1);
}

#[test]
fn sizes_without_lengths_are_refused() {
    let empty = volume_of([3, 3, 3], |_| 0);
    let why = SizeField::of_volume(empty).unwrap_err().to_string();
    assert!(why.contains("no positive edge length"), "{why}");
}
