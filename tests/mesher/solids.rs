//! Solids with smooth surfaces, whose volume and topology are known.

use crate::support::{angles, euler_number, faults, filled, options, quiet, region_volume, solids};
use glam::DVec3;
use palpate::mesher::{MeshOptions, Spacing, fill};
use std::f64::consts::PI;

#[test]
fn a_ball_keeps_the_published_bound_and_its_volume() {
    let ball = solids(1.0, |p| vec![(1, 0.97 - p.length())]);
    for (edge, grading) in [(0.3, 1.0), (0.11, 1.0), (0.11, 8.0)] {
        let f = filled(&ball, &options(edge, grading));
        assert_eq!(faults(&f), Vec::<String>::new());
        let (low, high) = angles(&f);
        println!(
            "{edge} {grading}: {} tets, {low:.2}..{high:.2}, {:?}",
            f.tets.len(),
            f.report
        );
        assert!(low >= 10.7 && high <= 164.8, "{low}..{high}");
        assert_eq!(euler_number(&f, 1), 2);
        let off = region_volume(&f, 1) / (4.0 / 3.0 * PI * 0.97f64.powi(3)) - 1.0;
        assert!(off.abs() < edge * edge, "{off}");
    }
}

#[test]
fn regions_that_meet_in_lines_and_points_are_filled() {
    let centres = [
        [-0.4, -0.3, 0.0],
        [0.4, -0.3, 0.05],
        [0.0, 0.4, 0.0],
        [0.0, 0.0, 0.5],
    ]
    .map(DVec3::from);
    let balls = solids(1.2, |p| {
        let weight = |(n, c): (u16, DVec3)| (n, 0.6 - p.distance(c));
        (1..).zip(centres).map(weight).collect()
    });
    for (edge, grading) in [(0.2, 1.0), (0.1, 4.0), (0.05, 4.0)] {
        let f = filled(&balls, &options(edge, grading));
        println!("{edge} {grading}: {:?}", f.report);
        assert_eq!(faults(&f), Vec::<String>::new());
        for region in 1..=4 {
            assert_eq!(euler_number(&f, region), 2);
        }
        assert!(angles(&f).0 > 4.0);
    }
}

#[test]
fn the_edge_for_a_number_of_tets_is_found() {
    let shell = solids(1.0, |p| {
        let r = p.length();
        vec![(1, (0.9 - r).min(r - 0.7)), (2, 0.7 - r)]
    });
    for wanted in [3_000, 30_000, 100_000] {
        let f = filled(
            &shell,
            &MeshOptions {
                spacing: Spacing::Tets(wanted),
                ..MeshOptions::default()
            },
        );
        let off = f.tets.len() as f64 / wanted as f64 - 1.0;
        assert!(off.abs() < 0.15, "{wanted}: {}", f.tets.len());
    }
    let tiny = MeshOptions {
        spacing: Spacing::Tets(3),
        ..MeshOptions::default()
    };
    assert!(fill(&shell, &tiny, &quiet).is_err());
}
