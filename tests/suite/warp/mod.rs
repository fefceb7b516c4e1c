//! Scans warped by the deformation of a body.

mod files;
mod images;
mod motion;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use palpate::generate::{Split, box_mesh};
use palpate::mesh::TetMesh;
use palpate::volume::{Grid, Raw, Volume};

/// Returns a typical scanner grid: rotated, anisotropic, left-handed.
fn grid() -> Grid {
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.2, -0.4, 0.3));
    let scaled = DMat3::from_diagonal(DVec3::new(-1.5, 0.75, 2.0));
    Grid {
        size: [24, 20, 16],
        to_world: DAffine3::from_mat3_translation(turn * scaled, DVec3::new(-30.0, 11.0, 400.0)),
    }
}

/// Returns a scan on `grid` with the voxels `raw`, i running fastest.
fn scan(grid: Grid, raw: Raw) -> Volume {
    Volume {
        size: grid.size,
        raw,
        to_world: grid.to_world,
        ..Volume::default()
    }
}

/// Returns all voxel indices of `grid`, i running fastest.
fn voxels(grid: &Grid) -> Vec<[usize; 3]> {
    let [nx, ny, nz] = grid.size;
    let all = (0..nx * ny * nz).map(|n| [n % nx, n / nx % ny, n / nx / ny]);
    all.collect()
}

/// Returns the centres of the voxels, in that order.
fn centres(grid: &Grid) -> Vec<DVec3> {
    let all = voxels(grid).into_iter();
    all.map(|[i, j, k]| grid.centre(i, j, k)).collect()
}

/// Returns a box of `cells` between two corners in voxel coordinates of `grid`, in the world.
fn body(grid: &Grid, cells: [usize; 3], low: DVec3, high: DVec3) -> TetMesh {
    let mesh = box_mesh(cells, high - low, Split::Five).unwrap();
    let least = mesh.bounds().0;
    let place = |p: &DVec3| grid.to_world.transform_point3(*p - least + low);
    let nodes = mesh.nodes.iter().map(place).collect();
    // If the grid is left-handed, its tets are flipped.
    TetMesh::new(nodes, mesh.tets, Vec::new(), Vec::new()).unwrap()
}

/// Returns a box that contains all of `grid`.
fn around(grid: &Grid, cells: [usize; 3]) -> TetMesh {
    let far = DVec3::from(grid.size.map(|n| n as f64));
    body(grid, cells, DVec3::splat(-6.3), far + 5.3)
}

/// Returns `n` pseudorandom numbers in 0..1.
fn noise(n: usize) -> Vec<f64> {
    let mut seed = 3u64;
    let mut next = || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..n).map(|_| next()).collect()
}
