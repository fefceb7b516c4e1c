//! Two coarse bars next to each other with a round skin each: figure 5 of Mosegaard & Sørensen
//! (2005), both mappings in one picture; in m.

use glam::DVec3;
use palpate::Result;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::{TetMesh, TriMesh};
use std::f64::consts::TAU;

const SIZE: DVec3 = DVec3::new(0.24, 0.03, 0.03);
/// Offset between the bars.
const APART: DVec3 = DVec3::new(0.0, 0.09, 0.0);

/// Returns both bars, of eight cells each.
pub fn bodies() -> Result<TetMesh> {
    let bar = box_mesh([8, 1, 1], SIZE, Split::Six)?;
    let count = bar.nodes.len() as u32;
    let nodes = bar.nodes.iter().copied();
    let nodes = nodes.chain(bar.nodes.iter().map(|p| *p + APART)).collect();
    let others = bar.tets.iter().map(|t| t.map(|v| v + count));
    let tets = bar.tets.iter().copied().chain(others).collect();
    TetMesh::new(nodes, tets, Vec::new(), Vec::new())
}

/// Returns a tube around bar `n`, with open ends.
pub fn tube(n: usize) -> TriMesh {
    let (along, around, radius) = (72usize, 32usize, 0.026);
    let middle = 0.5 * SIZE * DVec3::new(0.0, 1.0, 1.0) + n as f64 * APART;
    let vertices = (0..=along)
        .flat_map(|i| (0..around).map(move |j| (i, j)))
        .map(|(i, j)| {
            let turn = TAU * j as f64 / around as f64;
            let x = SIZE.x * i as f64 / along as f64;
            middle + DVec3::new(x, radius * turn.cos(), radius * turn.sin())
        })
        .collect();
    let at = |i: usize, j: usize| (i * around + j % around) as u32;
    let triangles = (0..along)
        .flat_map(|i| (0..around).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    TriMesh {
        vertices,
        triangles,
        ..TriMesh::default()
    }
}
