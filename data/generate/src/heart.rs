//! Heart-like phantom: muscle around two chambers of blood, and its detailed surface; in mm.

use glam::{DAffine3, DMat3, DVec3};
use palpate::Result;
use palpate::mesh::{Field, Location, ScalarType, TriMesh};
use palpate::skin::{Map, bake};
use palpate::volume::{Raw, Volume};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

/// Number of voxels along an axis, and their spacing.
const VOXELS: usize = 60;
const VOXEL: f64 = 2.0;

/// Returns the distance from the centre to the outer wall in a direction; the apex is at the
/// bottom.
fn wall(d: DVec3) -> f64 {
    let taper = 1.0 + 0.28 * d.z - 0.1 * d.x;
    let radii = DVec3::new(40.0 * taper, 35.0 * taper, 52.0);
    (d / radii).length().recip()
}

/// Returns the height of vessels and folds on the wall, which only the normal map shows.
fn relief(longitude: f64, latitude: f64) -> f64 {
    let vessels = (0..5).map(|n| {
        let n = f64::from(n);
        let middle =
            TAU * n / 5.0 + 0.5 * (2.0 * latitude + n).sin() + 0.12 * (9.0 * latitude).sin();
        let off = (longitude - middle + PI).rem_euclid(TAU) - PI;
        let width = 0.05 + 0.03 * latitude.sin();
        1.5 * (-(off * latitude.cos() / width).powi(2)).exp()
    });
    let folds = 0.12 * (31.0 * longitude + 6.0 * (5.0 * latitude).sin()).sin() * latitude.cos();
    vessels.sum::<f64>() + folds
}

fn chamber(p: DVec3, centre: DVec3, radii: DVec3) -> bool {
    ((p - centre) / radii).length_squared() < 1.0
}

fn label(p: DVec3) -> u8 {
    let left = chamber(p, DVec3::new(11.0, 0.0, 4.0), DVec3::new(13.0, 13.0, 33.0));
    let right = chamber(p, DVec3::new(-19.0, 3.0, 9.0), DVec3::new(9.0, 16.0, 26.0));
    match p.length() < wall(p.normalize_or(DVec3::Z)) {
        false => 0,
        true if left => 2,
        true if right => 3,
        true => 1,
    }
}

/// Returns the label map: 1 muscle, 2 and 3 the chambers.
pub fn labels() -> Volume {
    let first = DVec3::splat(-0.5 * VOXEL * (VOXELS as f64 - 1.0));
    let at = |i: usize| {
        let index = [i % VOXELS, i / VOXELS % VOXELS, i / VOXELS / VOXELS];
        first + VOXEL * DVec3::from(index.map(|n| n as f64))
    };
    let names = [(1, "muscle"), (2, "left ventricle"), (3, "right ventricle")];
    Volume {
        size: [VOXELS; 3],
        raw: Raw::U8((0..VOXELS.pow(3)).map(|i| label(at(i))).collect()),
        to_world: DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(VOXEL)), first),
        label_names: BTreeMap::from(names.map(|(label, name)| (label, name.to_owned()))),
        ..Volume::default()
    }
}

/// Returns the wall as rings of longitude and latitude, with texture coordinates; with its relief
/// or without.
pub fn surface(around: usize, along: usize, detailed: bool) -> TriMesh {
    let mut vertices = Vec::new();
    let mut uvs = Vec::new();
    // The seam has two vertices at each position, the poles one for each column.
    for j in 0..=along {
        for i in 0..=around {
            let (u, v) = (i as f64 / around as f64, j as f64 / along as f64);
            let (longitude, latitude) = (TAU * u, PI * (v - 0.5));
            let d = DVec3::new(
                (TAU * (i % around) as f64 / around as f64).cos() * latitude.cos(),
                (TAU * (i % around) as f64 / around as f64).sin() * latitude.cos(),
                latitude.sin(),
            );
            let out = if detailed {
                relief(longitude, latitude)
            } else {
                0.0
            };
            vertices.push(d * (wall(d) + out));
            uvs.push([u, v]);
        }
    }
    let at = |i: usize, j: usize| j * (around + 1) + i;
    let mut corners: Vec<[usize; 3]> = Vec::new();
    for j in 0..along {
        for i in 0..around {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            corners.extend([[a, b, c], [a, c, d]]);
        }
    }
    // One vertex per position; attributes that differ there are stored at the corners.
    let place = |n: usize| {
        let (i, j) = (n % (around + 1), n / (around + 1));
        match j {
            0 => 0,
            j if j == along => 1 + (along - 1) * around,
            j => 1 + (j - 1) * around + i % around,
        }
    };
    let mut merged = vec![DVec3::ZERO; 2 + (along - 1) * around];
    for (n, p) in vertices.iter().enumerate() {
        merged[place(n)] = *p;
    }
    corners.retain(|t| {
        let [a, b, c] = t.map(place);
        a != b && b != c && c != a
    });
    let values = corners.iter().flatten().flat_map(|n| uvs[*n]).collect();
    TriMesh {
        vertices: merged,
        triangles: corners.iter().map(|t| t.map(|n| place(n) as u32)).collect(),
        fields: vec![Field {
            name: "uv".into(),
            location: Location::Cell,
            components: 6,
            values,
            scalar_type: ScalarType::F32,
        }],
        frame: None,
        notes: Vec::new(),
    }
}

/// Returns the normal map of the relief for the smooth surface.
pub fn normals() -> Result<Map> {
    let (map, _) = bake(
        &surface(64, 40, false),
        &surface(720, 360, true),
        [768, 384],
    )?;
    Ok(map)
}
