//! Labels, surfaces and numbers of tets of which little or nothing would be left.

use crate::mesher::support::{faults, filled, options, volume_of};
use palpate::mesher::{
    ClosedSurface, Domain, LabelDomain, MeshOptions, Spacing, SurfaceDomain, mesh_domain,
    two_digits,
};
use palpate::{generate, no_progress};

/// A lone voxel, a pair, a diagonal line, and an L of diagonal voxels.
fn is_thin(kind: usize, [i, j, k]: [usize; 3]) -> bool {
    match kind {
        0 => [i, j, k] == [3, 3, 3],
        1 => (3..5).contains(&i) && [j, k] == [3, 3],
        2 => i == j && j == k && (1..7).contains(&i),
        _ => k == 3 && i == j && (1..7).contains(&i),
    }
}

#[test]
fn thin_labels_keep_about_their_volume() {
    for kind in 0..4 {
        let volume = volume_of([8; 3], |c| u8::from(is_thin(kind, c)));
        let domain = LabelDomain::new(&volume, None).unwrap();
        let wanted = domain.voxel_volumes()[0];
        assert_eq!(domain.thin_regions().len(), 1, "{kind}");
        for spacing in [Spacing::Edge(0.25), Spacing::Tets(5000)] {
            let f = filled(
                &domain,
                &MeshOptions {
                    spacing,
                    ..MeshOptions::default()
                },
            );
            assert_eq!(faults(&f), Vec::<String>::new());
            let made = f.report.regions[0].volume;
            assert!(
                (made / wanted - 1.0).abs() < 0.1,
                "{kind} {spacing:?}: {made}"
            );
        }
    }
}

#[test]
fn thick_labels_are_not_changed_by_thin_ones() {
    let ball = |[i, j, k]: [usize; 3]| {
        let r = [i, j, k]
            .map(|x| (x as f64 - 8.0).powi(2))
            .iter()
            .sum::<f64>();
        r < 25.0
    };
    let with = volume_of([16; 3], |c| match c {
        [1, 1, 1] => 2,
        _ => u8::from(ball(c)),
    });
    let without = volume_of([16; 3], |c| u8::from(ball(c)));
    let volumes = [with, without].map(|volume| {
        let domain = LabelDomain::new(&volume, None).unwrap();
        let f = filled(&domain, &options(1.0, 4.0));
        assert!(domain.smoothed_fractions().iter().all(|f| *f == 0.0));
        f.report.regions[0].volume
    });
    assert!((volumes[0] / volumes[1] - 1.0).abs() < 0.01, "{volumes:?}");
}

#[test]
fn advised_edge_length_keeps_every_region() {
    let volume = volume_of([12; 3], |c| match c {
        [2, 2, 2] => 3,
        [2..=7, 9, 9] => 2,
        [4..=9, 4..=9, 4..=7] => 1,
        _ => 0,
    });
    let domain = LabelDomain::new(&volume, None).unwrap();
    // Too coarse: regions 2 and 3 fall between the points of the lattice, or the body does.
    let coarse = mesh_domain(&domain, &options(40.0, 1.0), &no_progress);
    let error = coarse.unwrap_err().to_string();
    let edge = domain.resolving_edge().unwrap();
    assert!(
        error.contains(&format!("to {}", two_digits(edge))),
        "{error}"
    );
    let f = filled(&domain, &options(edge, 4.0));
    assert_eq!(f.report.regions.len(), 3);
    let regions = f.report.regions.iter().zip(domain.voxel_volumes());
    let shares: Vec<f64> = regions.map(|(r, wanted)| r.volume / wanted).collect();
    for (share, expected) in shares.iter().zip([1.0, 0.53, 1.0]) {
        assert!((share - expected).abs() < 0.02, "{shares:?}");
    }
}

#[test]
fn fraction_smoothed_away_counts_spikes_of_thick_regions() {
    let volume = volume_of([12; 3], |c| match c {
        [4..=7, 4..=7, 4..=7] => 1,
        [9, 9, 9] | [1, 1, 1] => 1,
        _ => 0,
    });
    let domain = LabelDomain::new(&volume, None).unwrap();
    assert_eq!(domain.thin_regions(), []);
    let fraction = domain.smoothed_fractions()[0];
    assert!((fraction - 2.0 / 66.0).abs() < 1e-12, "{fraction}");
    // The advice of the command line: voxels of half the size keep them.
    let finer = volume_of([24; 3], |c| {
        let [i, j, k] = c.map(|x| x / 2);
        volume.value(i + 12 * (j + 12 * k)) as u8
    });
    let finer = LabelDomain::new(&finer, None).unwrap();
    assert_eq!(finer.smoothed_fractions(), [0.0]);
}

#[test]
fn body_too_thin_for_the_number_of_tets_is_reported_at_once() {
    // A plate of a ten-thousandth of its width.
    let plate = generate::bar([12, 12, 1], [1.0, 1.0, 1e-4].into()).unwrap();
    let surface = plate.boundary_surface(None).unwrap();
    let domain = SurfaceDomain::new(vec![ClosedSurface::new(&surface).unwrap()]).unwrap();
    let options = MeshOptions {
        spacing: Spacing::Tets(2000),
        ..MeshOptions::default()
    };
    let error = mesh_domain(&domain, &options, &no_progress).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("too thin for about 2000 tets"), "{error}");
}

#[test]
fn advice_has_two_digits_and_is_never_larger() {
    for (length, text) in [
        (0.0613, "0.061"),
        (0.1, "0.1"),
        (1.0, "1"),
        (12.9, "12"),
        (0.000_35, "0.00035"),
        (1234.0, "1200"),
    ] {
        assert_eq!(two_digits(length).to_string(), text);
        assert!(two_digits(length) <= length * (1.0 + 1e-6));
    }
}
