//! Cells of all types are subdivided into conforming tets.

use crate::io::sample::Bench;
use glam::DVec3;
use palpate::mesh::{Location, TetMesh, Topology};
use proptest::prelude::*;
use std::fmt::Write as _;

/// Returns cells as a legacy VTK file with the cell field "cell" (its index).
fn file(nodes: &[DVec3], cells: &[(u8, Vec<usize>)]) -> String {
    let mut text = format!(
        "# vtk DataFile Version 3.0\ncells\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n",
        nodes.len()
    );
    for p in nodes {
        let _ = writeln!(text, "{} {} {}", p.x, p.y, p.z);
    }
    let size: usize = cells.iter().map(|c| 1 + c.1.len()).sum();
    let _ = writeln!(text, "CELLS {} {size}", cells.len());
    for (_, nodes) in cells {
        let list: Vec<String> = nodes.iter().map(usize::to_string).collect();
        let _ = writeln!(text, "{} {}", nodes.len(), list.join(" "));
    }
    let _ = writeln!(text, "CELL_TYPES {}", cells.len());
    for (kind, _) in cells {
        let _ = writeln!(text, "{kind}");
    }
    let _ = writeln!(
        text,
        "CELL_DATA {}\nSCALARS cell int\nLOOKUP_TABLE default",
        cells.len()
    );
    for c in 0..cells.len() {
        let _ = writeln!(text, "{c}");
    }
    text
}

fn read(nodes: &[DVec3], cells: &[(u8, Vec<usize>)]) -> palpate::Result<TetMesh> {
    Bench::new().read("cells.vtk", file(nodes, cells).as_bytes())
}

/// Returns the volume of the tets of each cell, by the cell field.
fn volumes(mesh: &TetMesh, cells: usize) -> Vec<f64> {
    let mut volumes = vec![0.0; cells];
    let cell = mesh.field("cell", Location::Cell).unwrap();
    for (t, c) in cell.values.iter().enumerate() {
        volumes[*c as usize] += mesh.tet_volume(t);
    }
    volumes
}

fn unit_hexahedron() -> Vec<DVec3> {
    let corners = [
        [0, 0, 0],
        [1, 0, 0],
        [1, 1, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 0, 1],
        [1, 1, 1],
        [0, 1, 1],
    ];
    corners
        .map(|c| DVec3::from_array(c.map(f64::from)))
        .to_vec()
}

proptest! {
    /// A block of cells (each cube a hexahedron, a voxel, two wedges, six pyramids or six tets),
    /// with random node numbers: adjacent cells share complete triangles.
    #[test]
    fn subdivided_cells_conform_at_shared_faces(
        kinds in prop::collection::vec(0..5usize, 27),
        order in Just((0..64 + 27).collect::<Vec<usize>>()).prop_shuffle(),
        flip in any::<bool>(),
    ) {
        let side = 3;
        let corner = |x: usize, y: usize, z: usize| order[x + 4 * (y + 4 * z)];
        let mut nodes = vec![DVec3::ZERO; order.len()];
        for i in 0..64 {
            let p = DVec3::new((i % 4) as f64, (i / 4 % 4) as f64, (i / 16) as f64);
            nodes[order[i]] = p;
        }
        let mut cells = Vec::new();
        let mut cubes = Vec::new();
        for i in 0..27 {
            let (x, y, z) = (i % side, i / side % side, i / 9);
            let h: Vec<usize> = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
                .map(|(a, b, c)| corner(x + a, y + b, z + c))
                .to_vec();
            let centre = order[64 + i];
            nodes[centre] = DVec3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5);
            let pick = |list: &[usize]| list.iter().map(|k| h[*k]).collect::<Vec<_>>();
            let first = cells.len();
            match kinds[i] {
                0 => cells.push((12, h.clone())),
                1 => cells.push((11, pick(&[0, 1, 3, 2, 4, 5, 7, 6]))),
                2 | 3 => {
                    // Wedges along z, with the diagonals of their triangles determined by the lower
                    // and upper neighbour: from the smallest number. Only used if both agree.
                    let fan = |q: [usize; 4]| (0..4).min_by_key(|k| h[q[*k]]).unwrap() % 2;
                    if fan([0, 1, 2, 3]) == fan([4, 5, 6, 7]) {
                        let (a, b) = if fan([0, 1, 2, 3]) == 0 {
                            ([0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7])
                        } else {
                            ([1, 2, 3, 5, 6, 7], [1, 3, 0, 5, 7, 4])
                        };
                        let turned = |w: [usize; 6]| if flip { [w[0], w[2], w[1], w[3], w[5], w[4]] } else { w };
                        cells.push((13, pick(&turned(a))));
                        cells.push((13, pick(&turned(b))));
                    } else {
                        cells.push((12, h.clone()));
                    }
                }
                _ => {
                    for q in [[0, 1, 2, 3], [4, 7, 6, 5], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]] {
                        let mut pyramid = pick(&q);
                        pyramid.push(centre);
                        cells.push((14, pyramid));
                    }
                }
            }
            cubes.extend(std::iter::repeat_n(i, cells.len() - first));
        }
        let mesh = read(&nodes, &cells).unwrap();
        // Six sides of nine squares, two triangles each; any mismatch inside increases the number.
        prop_assert_eq!(Topology::new(&mesh).boundary.len(), 6 * 9 * 2);
        prop_assert_eq!(mesh.repairs.inverted_fixed, 0, "cells preserve their orientation");
        prop_assert_eq!(mesh.repairs.degenerate, 0);
        let mut of_cube = [0.0; 27];
        for (volume, cube) in volumes(&mesh, cells.len()).iter().zip(&cubes) {
            of_cube[*cube] += volume;
        }
        for volume in of_cube {
            prop_assert!((volume - 1.0).abs() < 1e-12, "volume {}", volume);
        }
    }
}

#[test]
fn pentagonal_and_hexagonal_prisms_are_subdivided() {
    for (kind, sides) in [(15u8, 5usize), (16, 6)] {
        let ring = |z: f64| {
            (0..sides).map(move |i| {
                let angle = std::f64::consts::TAU * i as f64 / sides as f64;
                DVec3::new(angle.cos(), angle.sin(), z)
            })
        };
        let nodes: Vec<DVec3> = ring(0.0).chain(ring(2.0)).collect();
        let mesh = read(&nodes, &[(kind, (0..2 * sides).collect())]).unwrap();
        let area = sides as f64 / 2.0 * (std::f64::consts::TAU / sides as f64).sin();
        assert!((mesh.volume() - 2.0 * area).abs() < 1e-12);
        assert_eq!(mesh.repairs.inverted_fixed, 0);
        assert_eq!(
            Topology::new(&mesh).boundary.len(),
            2 * (sides - 2) + 2 * sides
        );
    }
}

#[test]
fn inverted_hexahedron_is_flipped_and_counted() {
    let cell = vec![4, 5, 6, 7, 0, 1, 2, 3];
    let mesh = read(&unit_hexahedron(), &[(12, cell)]).unwrap();
    assert!((mesh.volume() - 1.0).abs() < 1e-12);
    assert_eq!(mesh.repairs.inverted_fixed, mesh.tets.len());
}

#[test]
fn collapsed_hexahedron_equals_wedge() {
    // Edges 3-2 and 7-6 collapsed: a wedge.
    let cell = vec![0, 1, 2, 2, 4, 5, 6, 6];
    let mesh = read(&unit_hexahedron(), &[(12, cell)]).unwrap();
    assert!((mesh.volume() - 0.5).abs() < 1e-12);
    assert_eq!(Topology::new(&mesh).boundary.len(), 8);
}

#[test]
fn second_order_cells_reduce_to_corners_with_warning() {
    let mut nodes = unit_hexahedron();
    let middle = nodes.len();
    nodes.extend((0..19).map(|i| DVec3::splat(0.3 + 0.01 * f64::from(i))));
    let with_middles = |corners: &[usize], extra: usize| -> Vec<usize> {
        corners
            .iter()
            .copied()
            .chain(middle..middle + extra)
            .collect()
    };
    for (kind, corners, extra, volume) in [
        (71u8, &[0, 1, 3, 4][..], 16, 1.0 / 6.0),
        (25, &[0, 1, 2, 3, 4, 5, 6, 7], 12, 1.0),
        (29, &[0, 1, 2, 3, 4, 5, 6, 7], 19, 1.0),
        (26, &[0, 1, 3, 4, 5, 7], 9, 0.5),
        (27, &[0, 1, 2, 3, 4], 8, 1.0 / 3.0),
    ] {
        let mesh = read(&nodes, &[(kind, with_middles(corners, extra))]).unwrap();
        assert!((mesh.volume() - volume).abs() < 1e-12, "kind {kind}");
        assert_eq!(mesh.nodes.len(), corners.len());
        let reported = mesh.repairs.warnings.iter().any(|w| {
            w.starts_with("1 ") && w.contains("-order") && w.contains("reduced to their corners")
        });
        assert!(reported, "{:?}", mesh.repairs.warnings);
    }
}

#[test]
fn cells_without_volume_are_reported() {
    let cells = [
        (10, vec![0, 1, 3, 4]),
        (5, vec![0, 1, 3]),
        (5, vec![0, 1, 4]),
        (3, vec![0, 1]),
        (42, vec![1, 3, 0, 1, 3]),
    ];
    let mesh = read(&unit_hexahedron(), &cells).unwrap();
    assert_eq!(mesh.tets.len(), 1);
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(
        warnings.contains("1 line, 2 triangles dropped"),
        "{warnings}"
    );
    assert!(
        warnings.contains("1 polyhedron") && warnings.contains("holes"),
        "{warnings}"
    );
    let error = read(&unit_hexahedron(), &cells[1..4])
        .unwrap_err()
        .to_string();
    assert!(error.contains("only 1 line, 2 triangles"), "{error}");
}
