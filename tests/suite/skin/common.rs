//! Shared helpers of the skin tests: bodies, surfaces, and skinned bodies.

use glam::DVec3;
use palpate::generate;
use palpate::gpu::{Array, Gpu};
use palpate::mesh::{LocalFrame, TriMesh, unpack_normal};
use palpate::render::{Image, local_positions};
use palpate::skin::SkinBase;
use std::collections::HashMap;

pub use crate::support::gpu;

/// Returns a deterministic generator of numbers in −1..1.
pub fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }
}

/// Returns a sphere of `rings` rings of `around` vertices and two poles, each vertex mapped by
/// `place`.
pub fn sphere(rings: usize, around: usize, place: impl Fn(DVec3) -> DVec3) -> TriMesh {
    let mut vertices = vec![DVec3::Z];
    for r in 1..=rings {
        let tilt = std::f64::consts::PI * r as f64 / (rings + 1) as f64;
        for k in 0..around {
            let turn = std::f64::consts::TAU * k as f64 / around as f64;
            let ring = DVec3::new(turn.cos(), turn.sin(), 0.0);
            vertices.push(tilt.sin() * ring + tilt.cos() * DVec3::Z);
        }
    }
    vertices.push(DVec3::NEG_Z);
    let at = |r: usize, k: usize| (1 + r * around + k % around) as u32;
    let last = vertices.len() as u32 - 1;
    let mut triangles = Vec::new();
    for k in 0..around {
        triangles.push([0, at(0, k), at(0, k + 1)]);
        triangles.push([last, at(rings - 1, k + 1), at(rings - 1, k)]);
        for r in 0..rings - 1 {
            triangles.push([at(r, k), at(r + 1, k), at(r + 1, k + 1)]);
            triangles.push([at(r, k), at(r + 1, k + 1), at(r, k + 1)]);
        }
    }
    TriMesh {
        vertices: vertices.into_iter().map(place).collect(),
        triangles,
        ..TriMesh::default()
    }
}

/// Returns a surface with bumps, of radius about 1.1.
pub fn bumpy(rings: usize) -> TriMesh {
    sphere(rings, 2 * rings, |p| {
        let hills = (7.0 * p.x).sin() * (6.0 * p.y).cos() + (5.0 * p.z).sin();
        p * (1.1 + 0.04 * hills)
    })
}

/// Nodes, base triangles, and a skin for them.
pub struct Scene {
    pub name: &'static str,
    pub rest: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub skin: TriMesh,
}

/// Returns a ball of tets with a bumpy skin, 18 explicit nodes with the same skin, and a bar with a
/// rounded box.
pub fn scenes() -> Vec<Scene> {
    let ball = generate::ball(1.0, 8).unwrap();
    let surface = ball.boundary_surface(None).unwrap();
    // 4 rings of 4 and two poles.
    let hand = sphere(4, 4, |p| p);
    assert_eq!(hand.vertices.len(), 18);
    vec![
        Scene {
            name: "ball",
            rest: surface.vertices,
            triangles: surface.triangles,
            skin: bumpy(40),
        },
        Scene {
            name: "18 nodes",
            rest: hand.vertices,
            triangles: hand.triangles,
            skin: bumpy(40),
        },
        bar(),
    ]
}

/// Returns the surface of the unit cube with `cells` cells along each axis.
fn box_surface(cells: [u32; 3]) -> TriMesh {
    let mut surface = TriMesh::default();
    let mut known = HashMap::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (side, i, j) in (0..2)
            .flat_map(|s| (0..cells[u]).flat_map(move |i| (0..cells[v]).map(move |j| (s, i, j))))
        {
            let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[a, b]| {
                let mut at = [0; 3];
                (at[axis], at[u], at[v]) = (side * cells[axis], i + a, j + b);
                *known.entry(at).or_insert_with(|| {
                    let share = [0, 1, 2].map(|k| f64::from(at[k]) / f64::from(cells[k]));
                    surface.vertices.push(share.into());
                    surface.vertices.len() as u32 - 1
                })
            });
            let [a, b, c, d] = corners;
            let halves = [[a, b, c], [a, c, d]];
            let out = |t: [u32; 3]| if side == 1 { t } else { [t[0], t[2], t[1]] };
            surface.triangles.extend(halves.map(out));
        }
    }
    surface
}

/// Returns a bar of 8 × 1 × 1 cells with a fine surface 0.3 above it.
pub fn bar() -> Scene {
    let mesh = generate::bar([8, 1, 1], DVec3::new(8.0, 1.0, 1.0)).unwrap();
    let base = mesh.boundary_surface(None).unwrap();
    let mut skin = box_surface([172, 32, 32]);
    for p in &mut skin.vertices {
        *p *= DVec3::new(8.6, 1.6, 1.6);
    }
    for p in &mut skin.vertices {
        *p -= 0.3;
        let foot = p.clamp(DVec3::ZERO, DVec3::new(8.0, 1.0, 1.0));
        *p = foot + 0.3 * (*p - foot).normalize();
    }
    Scene {
        name: "bar",
        rest: base.vertices,
        triangles: base.triangles,
        skin,
    }
}

impl Scene {
    pub fn frame(&self) -> LocalFrame {
        let (low, high) = palpate::mesh::bounds(&self.rest);
        LocalFrame::from_bounds(low, high)
    }

    /// Returns its nodes at `positions`, on the GPU.
    pub fn carrier(&self, gpu: &Gpu, positions: &[DVec3]) -> (SkinBase, Array) {
        let array = local_positions(gpu, &self.frame(), positions).unwrap();
        let carrier =
            SkinBase::with_area_normals(gpu, &array, self.frame(), &self.rest, &self.triangles);
        (carrier.unwrap(), array)
    }
}

/// Unpacks normals.
pub fn unpacked(packed: &[u32]) -> Vec<Option<DVec3>> {
    packed.iter().map(|n| unpack_normal(*n)).collect()
}

/// Returns the largest distance between two lists of points; NaN if any is.
pub fn apart(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |worst: f64, (a, b)| {
        let d = a.distance(*b);
        if d.is_nan() || worst.is_nan() {
            f64::NAN
        } else {
            worst.max(d)
        }
    })
}

/// Returns the longest side of the bounds.
pub fn size(points: &[DVec3]) -> f64 {
    let (low, high) = palpate::mesh::bounds(points);
    (high - low).max_element()
}

/// Saves a picture for inspection.
pub fn keep(image: &Image, name: &str) {
    if let Ok(folder) = std::env::var("PALPATE_TEST_PICTURES") {
        let path = std::path::Path::new(&folder).join(name);
        image.save(path).unwrap();
    }
}
