//! Scans warped to the bent body.

use super::{around, body, centres, grid, noise, scan, voxels};
use glam::{DAffine3, DMat3, DVec3};
use palpate::volume::{Grid, Raw, Volume};
use palpate::warp::{Warp, WarpOptions};
use std::collections::BTreeSet;

fn background(value: f64) -> WarpOptions {
    WarpOptions {
        background: Some(value),
        ..WarpOptions::default()
    }
}

#[test]
fn identity_warp_is_bitwise_exact() {
    let grid = grid();
    let values = noise(7680);
    let part = body(
        &grid,
        [5, 4, 3],
        DVec3::splat(1.7),
        DVec3::new(20.2, 15.1, 12.9),
    );
    let warp = Warp::new(&part, &part.nodes).unwrap();
    let of = |f: &dyn Fn(f64) -> u64| values.iter().map(|v| f(*v)).collect::<Vec<u64>>();
    let raws = [
        Raw::U8(
            of(&|v| (255.0 * v) as u64)
                .iter()
                .map(|v| *v as u8)
                .collect(),
        ),
        Raw::I16(values.iter().map(|v| (4e4 * (v - 0.5)) as i16).collect()),
        Raw::F32(
            values
                .iter()
                .map(|v| (1e-3 * v / (1.001 - v)) as f32)
                .collect(),
        ),
        Raw::F64(values.iter().map(|v| v / 3.0).collect()),
        // Beyond the resolution of float64.
        Raw::U64(of(&|v| u64::MAX - (1e6 * v) as u64)),
    ];
    for raw in raws {
        let scan = scan(grid, raw);
        for labels in [false, true] {
            let options = WarpOptions {
                labels,
                background: Some(0.0),
            };
            let warped = warp.image(&scan, &grid, &options).unwrap();
            let mut covered = 0;
            for (n, at) in voxels(&grid).into_iter().enumerate() {
                let [i, j, k] = at;
                let inside =
                    (2..=20).contains(&i) && (2..=15).contains(&j) && (2..=12).contains(&k);
                covered += usize::from(inside);
                let expected = if inside {
                    exact(&scan.raw, n)
                } else {
                    0u64.to_le_bytes()
                };
                assert_eq!(exact(&warped.volume.raw, n), expected, "{at:?}");
            }
            assert_eq!(warped.coverage.voxels - warped.coverage.uncovered, covered);
        }
    }
}

/// Returns the bits of a number.
fn exact(raw: &Raw, n: usize) -> [u8; 8] {
    match raw {
        Raw::U64(v) => v[n].to_le_bytes(),
        other => match other.get(n) {
            0.0 => [0; 8],
            value => value.to_le_bytes(),
        },
    }
}

fn motion() -> DAffine3 {
    let turn = DMat3::from_rotation_y(0.25);
    let middle = grid().centre(12, 10, 8);
    DAffine3::from_mat3_translation(turn, middle - turn * middle + DVec3::new(0.9, 0.4, -0.6))
}

/// A scan that is linear in the world, warped: the value at each voxel is known.
fn ramp(p: DVec3) -> f64 {
    3.0 * p.x - 2.0 * p.y + 0.7 * p.z
}

#[test]
fn warped_values_match_rest_positions() {
    let grid = grid();
    let values: Vec<f64> = centres(&grid).into_iter().map(ramp).collect();
    let rest = around(&grid, [4, 4, 4]);
    let bent: Vec<DVec3> = rest
        .nodes
        .iter()
        .map(|p| motion().transform_point3(*p))
        .collect();
    let warp = Warp::new(&rest, &bent).unwrap();
    let to_index = grid.to_world.inverse();
    let last = DVec3::from(grid.size.map(|n| n as f64 - 1.0));
    // Stored unchanged, and as integers in steps of a tenth from −100.
    let mut tenths = scan(
        grid,
        Raw::I16(
            values
                .iter()
                .map(|v| (10.0 * (v + 100.0)).round() as i16)
                .collect(),
        ),
    );
    (tenths.slope, tenths.intercept) = (0.1, -100.0);
    for (scan, close) in [(scan(grid, Raw::F64(values)), 1e-9), (tenths, 0.11)] {
        let warped = warp.image(&scan, &grid, &background(-100.0)).unwrap();
        assert_eq!(
            (warped.volume.slope, warped.volume.intercept),
            (scan.slope, scan.intercept)
        );
        let mut beyond = 0;
        for (n, p) in centres(&grid).into_iter().enumerate() {
            let place = motion().inverse().transform_point3(p);
            let x = to_index.transform_point3(place);
            let value = warped.volume.value(n);
            if x.cmplt(DVec3::splat(-0.5)).any() || x.cmpgt(last + 0.5).any() {
                beyond += 1;
                assert!((value + 100.0).abs() < 1e-9, "{value} beyond the scan");
            } else if x.cmpge(DVec3::ZERO).all() && x.cmple(last).all() {
                assert!(
                    (value - ramp(place)).abs() < close,
                    "{value}, not {}",
                    ramp(place)
                );
            }
        }
        assert!(beyond > 100);
        assert_eq!(warped.coverage.beyond, beyond);
    }
}

#[test]
fn label_warp_uses_nearest_existing_label() {
    let grid = grid();
    let labels = [0u16, 7, 31, 900];
    let block = |[i, j, k]: [usize; 3]| labels[(i / 5 + j / 4 + k / 3) % 4];
    let mut scan = scan(
        grid,
        Raw::U16(voxels(&grid).into_iter().map(block).collect()),
    );
    scan.label_names.insert(7, "liver".into());
    let rest = around(&grid, [4, 4, 4]);
    let bent: Vec<DVec3> = rest
        .nodes
        .iter()
        .map(|p| motion().transform_point3(*p))
        .collect();
    let warp = Warp::new(&rest, &bent).unwrap();
    let options = WarpOptions {
        labels: true,
        background: None,
    };
    let warped = warp.image(&scan, &grid, &options).unwrap();
    let Raw::U16(found) = &warped.volume.raw else {
        panic!("{:?}", warped.volume.raw.scalar_type());
    };
    let set: BTreeSet<u16> = found.iter().copied().collect();
    assert_eq!(set, labels.into_iter().collect());
    assert_eq!(warped.volume.label_names[&7], "liver");
    let to_index = grid.to_world.inverse();
    let mut checked = 0;
    for (n, p) in centres(&grid).into_iter().enumerate() {
        let x = to_index.transform_point3(motion().inverse().transform_point3(p));
        let near = x.round();
        let within = near.cmpge(DVec3::ZERO).all()
            && near.cmplt(DVec3::from(grid.size.map(|n| n as f64))).all();
        // Half-way between two, either will do.
        if within && (x - near).abs().max_element() < 0.499_999 {
            assert_eq!(found[n], block(near.to_array().map(|x| x as usize)));
            checked += 1;
        }
    }
    assert!(checked > 5000, "{checked}");
}

#[test]
fn integer_values_are_rounded_and_clamped() {
    let grid = grid();
    let rest = around(&grid, [4, 4, 4]);
    // Half a voxel along the first axis: the mean of two.
    let push = grid.to_world.transform_vector3(DVec3::new(0.5, 0.0, 0.0));
    let bent: Vec<DVec3> = rest.nodes.iter().map(|p| *p + push).collect();
    let warp = Warp::new(&rest, &bent).unwrap();
    let of = |[i, _, _]: [usize; 3]| if i % 2 == 0 { i8::MIN } else { i8::MAX - 2 };
    let scan = scan(grid, Raw::I8(voxels(&grid).into_iter().map(of).collect()));
    let warped = warp.image(&scan, &grid, &WarpOptions::default()).unwrap();
    for (n, [i, _, _]) in voxels(&grid).into_iter().enumerate() {
        // −1.5 to −2; up to half a voxel outside the scan, the outermost value.
        let expected = if i == 0 { -128.0 } else { -2.0 };
        let found = warped.volume.raw.get(n);
        assert!(
            found == expected || (i > 0 && found == -1.0),
            "{found} at {i}"
        );
    }
    let wrong = warp
        .image(&scan, &grid, &background(200.0))
        .unwrap_err()
        .to_string();
    assert!(
        wrong.contains("200") && wrong.contains("-128 to 127"),
        "{wrong}"
    );
    assert!(warp.image(&scan, &grid, &background(0.5)).is_err());
    assert!(warp.image(&scan, &grid, &background(f64::NAN)).is_err());
}

#[test]
fn default_background_is_minimum_or_zero_for_labels() {
    let grid = grid();
    let part = body(&grid, [2, 2, 2], DVec3::splat(4.0), DVec3::splat(9.0));
    let warp = Warp::new(&part, &part.nodes).unwrap();
    let scan = scan(
        grid,
        Raw::I16(
            noise(7680)
                .iter()
                .map(|v| (v * 99.0) as i16 - 1024)
                .collect(),
        ),
    );
    let at_corner = |options: &WarpOptions| {
        let warped = warp.image(&scan, &grid, options).unwrap();
        warped.volume.value(0)
    };
    assert_eq!(at_corner(&WarpOptions::default()), -1024.0);
    assert_eq!(at_corner(&background(17.0)), 17.0);
    let labels = WarpOptions {
        labels: true,
        background: None,
    };
    assert_eq!(at_corner(&labels), 0.0);
}

#[test]
fn other_grid_resamples_same_body() {
    let grid = grid();
    let values: Vec<f64> = centres(&grid).into_iter().map(ramp).collect();
    let scan = scan(grid, Raw::F64(values));
    let rest = body(
        &grid,
        [6, 6, 6],
        DVec3::splat(2.0),
        DVec3::new(20.0, 16.0, 13.0),
    );
    let bent: Vec<DVec3> = rest
        .nodes
        .iter()
        .map(|p| motion().transform_point3(*p))
        .collect();
    let warp = Warp::new(&rest, &bent).unwrap();
    let other = Grid {
        size: [31, 17, 40],
        to_world: DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(-1.1, -0.9, 0.7)),
            grid.centre(12, 10, 8) + DVec3::new(17.0, 8.0, -14.0),
        ),
    };
    let warped = warp.image(&scan, &other, &background(-1e9)).unwrap();
    assert_eq!(warped.volume.grid(), other);
    let mut covered = 0;
    for (n, p) in centres(&other).into_iter().enumerate() {
        let value = warped.volume.value(n);
        match warp.map_inverse(p) {
            Some(place) => {
                covered += 1;
                assert!(
                    (value - ramp(place)).abs() < 1e-9,
                    "{value}, not {}",
                    ramp(place)
                );
            }
            None => assert_eq!(value, -1e9),
        }
    }
    assert!(covered > 1000, "{covered}");
    assert_eq!(warped.coverage.voxels - warped.coverage.uncovered, covered);
}

#[test]
fn rejects_scan_outside_body() {
    let grid = grid();
    let rest = around(&grid, [2, 2, 2]);
    let warp = Warp::new(&rest, &rest.nodes).unwrap();
    let refused = |scan: &Volume, grid: &Grid| {
        let refused = warp.image(scan, grid, &WarpOptions::default());
        refused.unwrap_err().to_string()
    };
    let mut away = scan(grid, Raw::U8(vec![1; 7680]));
    away.to_world.translation += 500.0;
    let message = refused(&away, &grid);
    assert!(
        message.contains("the body at rest does not overlap the scan"),
        "{message}"
    );
    let message = refused(&away, &away.grid());
    assert!(message.contains("no voxel is inside the body"), "{message}");
    away.raw = Raw::U8(vec![1; 12]);
    assert!(refused(&away, &grid).contains("12 values"));
}
