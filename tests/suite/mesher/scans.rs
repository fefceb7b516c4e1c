//! Real scans and surfaces of people.

use crate::mesher::support::{angles, faults, filled, region_volume};
use crate::support::real_data;
use palpate::mesher::{
    ClosedSurface, LabelDomain, MeshOptions, Spacing, SurfaceDomain, ThresholdDomain,
};

fn about(tets: usize) -> MeshOptions {
    MeshOptions {
        spacing: Spacing::Tets(tets),
        ..MeshOptions::default()
    }
}

#[test]
fn segmented_knee_meshes_validly() {
    let Some(path) = real_data("volumes/knee_labels_dess_384x384x160.nrrd") else {
        return;
    };
    let volume = palpate::io::read_volume(path).unwrap();
    let domain = LabelDomain::new(&volume, None).unwrap();
    let f = filled(&domain, &about(150_000));
    println!("{:?}", f.report);
    assert_eq!(faults(&f), Vec::<String>::new());
    let off = f.tets.len() as f64 / 150_000.0 - 1.0;
    assert!(off.abs() < 0.15, "{} tets", f.tets.len());
    assert!(angles(&f).0 > 4.0 && f.report.first_percentile > 15.0);
    assert_eq!(f.report.regions.len(), 10);
    // Edges are eight voxels long here. The bones, 5 and 6, are large.
    for region in [5, 6] {
        let true_volume = domain.voxel_volumes()[usize::from(region) - 1];
        let off = region_volume(&f, region) / true_volume - 1.0;
        assert!(off.abs() < 0.03, "region {region}: {off}");
    }
}

#[test]
fn head_meshes_from_threshold_range() {
    let Some(path) = real_data("volumes/headsq_ct_64x64x93.mhd") else {
        return;
    };
    let volume = palpate::io::read_volume(path).unwrap();
    let windows = ["500..1150", "1150"].map(|w| w.parse().unwrap());
    let domain = ThresholdDomain::new(&volume, &windows).unwrap();
    let options = MeshOptions {
        min_island: 500.0,
        ..about(100_000)
    };
    let f = filled(&domain, &options);
    println!("{:?}", f.report);
    assert_eq!(faults(&f), Vec::<String>::new());
    assert!(angles(&f).0 > 4.0);
    let islands: Vec<usize> = f.report.islands.iter().map(|i| i.islands).collect();
    assert_eq!(islands, [110, 27], "specks of each range");
    // In mm³; voxels have 1.70e6 and 0.53e6, of which the thin bones take up some of the first.
    let volumes: Vec<f64> = f.report.regions.iter().map(|r| r.volume).collect();
    for (volume, expected) in volumes.iter().zip([1.6226e6, 5.978e5]) {
        assert!((volume / expected - 1.0).abs() < 2e-3, "{volumes:?}");
    }
}

#[test]
fn lung_meshes_from_surface() {
    let Some(path) = real_data("surfaces/chaste_lung_lul.stl") else {
        return;
    };
    let surface = palpate::io::read_surface(path).unwrap();
    let domain = SurfaceDomain::new(vec![ClosedSurface::new(&surface).unwrap()]).unwrap();
    let f = filled(&domain, &about(30_000));
    println!("{:?}", f.report);
    assert_eq!(faults(&f), Vec::<String>::new());
    assert!(angles(&f).0 > 10.7);
    let off = region_volume(&f, 1) / 2.134e6 - 1.0;
    assert!(off.abs() < 0.03, "{off}");
}
