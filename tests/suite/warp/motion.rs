//! Displacement fields against known motions.

use super::{around, body, centres, grid, voxels};
use glam::{DAffine3, DMat3, DVec3};
use palpate::mesh::TetMesh;
use palpate::volume::Grid;
use palpate::warp::{DisplacementField, Warp};

/// The smallest distance between voxels of this grid, in mm.
const VOXEL: f64 = 0.75;

fn affine() -> DAffine3 {
    let stretch = DMat3::from_cols(
        DVec3::new(1.1, 0.2, 0.0),
        DVec3::new(-0.1, 0.9, 0.3),
        DVec3::new(0.05, -0.2, 1.2),
    );
    // About the centre of the grid, so that all of it stays within the body.
    let grid = grid();
    let middle = grid
        .to_world
        .transform_point3(0.5 * DVec3::from(grid.size.map(|n| n as f64)));
    DAffine3::from_mat3_translation(
        stretch,
        middle - stretch * middle + DVec3::new(1.0, -2.0, 3.0),
    )
}

fn vector([x, y, z]: [f32; 3]) -> DVec3 {
    DVec3::new(x.into(), y.into(), z.into())
}

fn is(field: &DisplacementField, of: impl Fn(DVec3) -> DVec3) -> usize {
    let mut covered = 0;
    for (p, u) in centres(&field.grid).into_iter().zip(&field.vectors) {
        if *u != [0.0; 3] {
            covered += 1;
            let off = (vector(*u) - (of(p) - p)).length();
            assert!(off < 1e-4 * VOXEL, "{off} mm at {p}");
        }
    }
    covered
}

#[test]
fn affine_motion_is_exact_in_both_directions() {
    let (grid, motion) = (grid(), affine());
    let rest = around(&grid, [5, 4, 3]);
    let bent: Vec<DVec3> = rest
        .nodes
        .iter()
        .map(|p| motion.transform_point3(*p))
        .collect();
    let warp = Warp::new(&rest, &bent).unwrap();
    assert_eq!(warp.inverted(), 0);
    let forward = warp.displacement(&grid).unwrap();
    assert_eq!(
        (forward.coverage.voxels, forward.coverage.uncovered),
        (7680, 0)
    );
    assert_eq!(is(&forward, |p| motion.transform_point3(p)), 7680);
    let back = motion.inverse();
    let inverse = warp.inverse(&grid).unwrap();
    assert_eq!(inverse.coverage.overlapping, 0);
    let covered = is(&inverse, |p| back.transform_point3(p));
    assert_eq!(covered, 7680 - inverse.coverage.uncovered);
    assert!(covered > 7000, "{covered}");
    for p in centres(&grid) {
        let there = warp.map_forward(p).unwrap();
        assert!(there.abs_diff_eq(motion.transform_point3(p), 1e-9));
        assert!(warp.map_inverse(there).unwrap().abs_diff_eq(p, 1e-9));
    }
}

/// A motion that bends and shears by about a voxel.
fn wave(p: DVec3) -> DVec3 {
    let q = 0.12 * p;
    p + DVec3::new(
        q.y.sin() + 0.5 * q.z.sin(),
        0.8 * q.x.cos(),
        0.7 * (q.x + q.y).sin(),
    )
}

fn waved(grid: &Grid) -> (TetMesh, Vec<DVec3>) {
    let rest = around(grid, [14, 12, 11]);
    let bent = rest.nodes.iter().map(|p| wave(*p)).collect();
    (rest, bent)
}

#[test]
fn forward_and_inverse_maps_round_trip() {
    let grid = grid();
    let (rest, bent) = waved(&grid);
    let warp = Warp::new(&rest, &bent).unwrap();
    assert_eq!(warp.inverted(), 0);
    // As points, by the same tets in both directions.
    for p in centres(&grid) {
        let back = warp.map_inverse(warp.map_forward(p).unwrap()).unwrap();
        assert!(back.abs_diff_eq(p, 1e-9), "{back} is not {p}");
    }
    // As fields, one of which is sampled between its voxels.
    let [there, back] = [warp.displacement(&grid), warp.inverse(&grid)].map(|f| f.unwrap());
    assert_eq!(back.coverage.uncovered, 0);
    let to_index = grid.to_world.inverse();
    let mut off: Vec<f64> = Vec::new();
    for (p, u) in centres(&grid).into_iter().zip(&there.vectors) {
        let q = p + vector(*u);
        if let Some(v) = between(&back, to_index.transform_point3(q)) {
            off.push(to_index.transform_vector3(q + v - p).length());
        }
    }
    off.sort_by(f64::total_cmp);
    let (median, most) = (off[off.len() / 2], off[off.len() - 1]);
    assert!(off.len() > 5000, "{}", off.len());
    assert!(
        median <= 0.01 && most <= 0.1,
        "median {median}, most {most} voxels"
    );
    // And not because nothing moves.
    assert!(back.vectors.iter().any(|v| vector(*v).length() > 0.5));
}

/// Returns the field between its voxels, trilinear, if there are eight around `x`.
fn between(field: &DisplacementField, x: DVec3) -> Option<DVec3> {
    let low = x.floor();
    let part = x - low;
    let mut sum = DVec3::ZERO;
    for corner in 0..8 {
        let mut weight = 1.0;
        let mut at = [0; 3];
        for axis in 0..3 {
            let up = corner >> axis & 1;
            at[axis] = low[axis] as i64 + up;
            weight *= if up == 1 {
                part[axis]
            } else {
                1.0 - part[axis]
            };
            if !(0..field.grid.size[axis] as i64).contains(&at[axis]) {
                return None;
            }
        }
        let [i, j, k] = at.map(|n| n as usize);
        let n = i + field.grid.size[0] * (j + field.grid.size[1] * k);
        sum += weight * vector(field.vectors[n]);
    }
    Some(sum)
}

#[test]
fn fields_match_points_for_any_thread_count() {
    let grid = grid();
    let (rest, bent) = waved(&grid);
    let warp = Warp::new(&rest, &bent).unwrap();
    let on = |threads: usize| {
        let pool = rayon_pool(threads);
        pool.install(|| warp.inverse(&grid).unwrap())
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.vectors, three.vectors);
    assert_eq!(one.coverage, three.coverage);
    for (p, u) in centres(&grid).into_iter().zip(&one.vectors) {
        let rest = warp.map_inverse(p).unwrap();
        assert!((p + vector(*u)).abs_diff_eq(rest, 1e-4));
    }
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap()
}

#[test]
fn voxels_on_shared_faces_do_not_overlap() {
    let grid = grid();
    // Nodes on voxel centres: most voxels lie on faces, edges or nodes.
    let rest = body(
        &grid,
        [5, 4, 3],
        DVec3::splat(2.0),
        DVec3::new(12.0, 10.0, 8.0),
    );
    let warp = Warp::new(&rest, &rest.nodes).unwrap();
    for field in [warp.displacement(&grid), warp.inverse(&grid)] {
        let coverage = field.unwrap().coverage;
        assert_eq!(coverage.voxels - coverage.uncovered, 11 * 9 * 7);
        assert_eq!(coverage.overlapping, 0);
    }
}

#[test]
fn overlapping_tets_use_lowest_index_and_are_counted() {
    let grid = grid();
    let [a, b] = [(1.53, 8.47), (9.53, 16.47)].map(|(low, high)| {
        let (low, high) = (DVec3::new(low, 3.52, 3.57), DVec3::new(high, 9.46, 8.41));
        body(&grid, [3, 2, 2], low, high)
    });
    let offset = a.nodes.len() as u32;
    let nodes = [a.nodes.clone(), b.nodes].concat();
    let second = b.tets.iter().map(|t| t.map(|v| v + offset));
    let tets: Vec<[u32; 4]> = a.tets.iter().copied().chain(second).collect();
    let rest = TetMesh::new(nodes, tets, Vec::new(), Vec::new()).unwrap();
    // The second piece moves four voxels into the gap and the first piece.
    let push = grid.to_world.transform_vector3(DVec3::new(-4.0, 0.0, 0.0));
    let moved = |(v, p): (usize, &DVec3)| {
        *p + if v >= offset as usize {
            push
        } else {
            DVec3::ZERO
        }
    };
    let bent: Vec<DVec3> = rest.nodes.iter().enumerate().map(moved).collect();
    let warp = Warp::new(&rest, &bent).unwrap();
    let inverse = warp.inverse(&grid).unwrap();
    // Voxels 6, 7 and 8 of the first axis are in both, 4 to 9 and 4 to 8 of the others.
    assert_eq!(inverse.coverage.overlapping, 3 * 6 * 5);
    assert_eq!(warp.displacement(&grid).unwrap().coverage.overlapping, 0);
    for ([i, j, k], u) in voxels(&grid).into_iter().zip(&inverse.vectors) {
        let within = (4..=9).contains(&j) && (4..=8).contains(&k);
        let back = match (within, i) {
            (true, 9..=12) => -push,
            _ => DVec3::ZERO,
        };
        assert!(vector(*u).abs_diff_eq(back, 1e-5), "{i} {j} {k}");
    }
}

#[test]
fn inverted_tets_are_counted_and_contain_no_voxels() {
    let grid = grid();
    let rest = body(&grid, [4, 4, 4], DVec3::splat(1.5), DVec3::splat(13.5));
    // A central node moves far through its neighbours.
    let middle = grid.to_world.transform_point3(DVec3::splat(7.5));
    let mut bent = rest.nodes.clone();
    let v = (0..bent.len()).min_by(|a, b| {
        let far = |v: usize| rest.nodes[v].distance(middle);
        far(*a).total_cmp(&far(*b))
    });
    bent[v.unwrap()] += grid.to_world.transform_vector3(DVec3::new(5.0, 0.5, 0.2));
    let turned = |t: &[u32; 4]| {
        let [a, b, c, d] = t.map(|v| bent[v as usize]);
        (b - a).cross(c - a).dot(d - a) <= 0.0
    };
    let inverted = rest.tets.iter().filter(|t| turned(t)).count();
    let warp = Warp::new(&rest, &bent).unwrap();
    assert!(inverted > 0);
    assert_eq!(warp.inverted(), inverted);
    // The remaining tets overlap where folded, and still cover the whole box.
    let coverage = warp.inverse(&grid).unwrap().coverage;
    assert_eq!(coverage.voxels - coverage.uncovered, 12 * 12 * 12);
    let strictly_inside = |t: &[u32; 4], p: DVec3| {
        let corners = t.map(|v| bent[v as usize]);
        let whole = palpate::mesh::signed_volume(corners);
        (0..4).all(|k| {
            let mut part = corners;
            part[k] = p;
            palpate::mesh::signed_volume(part) > 1e-9 * whole
        })
    };
    let upright: Vec<&[u32; 4]> = rest.tets.iter().filter(|t| !turned(t)).collect();
    let in_several = |p: &DVec3| upright.iter().filter(|t| strictly_inside(t, *p)).count() > 1;
    let overlapping = centres(&grid).iter().filter(|p| in_several(p)).count();
    assert!(overlapping > 0);
    assert_eq!(coverage.overlapping, overlapping);
}

#[test]
fn rejects_invalid_motion() {
    let grid = grid();
    let rest = around(&grid, [3, 3, 3]);
    let refused = |bent: &[DVec3]| Warp::new(&rest, bent).unwrap_err().to_string();
    let message = refused(&rest.nodes[1..]);
    assert!(
        message.contains("nodes of the mesh at rest") && message.contains("got 63 and 64"),
        "{message}"
    );
    let mut bent = rest.nodes.clone();
    bent[7].y = f64::NAN;
    assert!(refused(&bent).contains("node 7"), "{}", refused(&bent));
    let mirrored: Vec<DVec3> = rest
        .nodes
        .iter()
        .map(|p| DVec3::new(-p.x, p.y, p.z))
        .collect();
    assert!(refused(&mirrored).contains("inverted"));
    let flat: Vec<DVec3> = rest
        .nodes
        .iter()
        .map(|p| DVec3::new(p.x, p.y, 0.0))
        .collect();
    assert!(refused(&flat).contains("degenerate"));
    let far: Vec<DVec3> = rest.nodes.iter().map(|p| *p + 1000.0).collect();
    let warp = Warp::new(&rest, &far).unwrap();
    let message = warp.inverse(&grid).unwrap_err().to_string();
    assert!(
        message.contains("no voxel is inside the body") && message.contains("RAS"),
        "{message}"
    );
    assert!(warp.displacement(&grid).is_ok());
    assert_eq!(warp.map_forward(DVec3::splat(f64::NAN)), None);
    assert_eq!(warp.map_inverse(DVec3::ZERO), None);
}
