//! Phantoms resembling scans and segmentations: the labels of a knee, a head in CT and in MRI, and
//! the surface of a lobe of a lung. World coordinates are RAS, in mm.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use palpate::mesh::TriMesh;
use palpate::volume::{Raw, Volume};
use std::collections::HashMap;

/// Labels of [`knee`], numbered as in the segmentations of the DESS knee data sets.
const KNEE: [(u8, &str); 10] = [
    (1, "femoral cartilage"),
    (2, "medial tibial cartilage"),
    (3, "lateral tibial cartilage"),
    (4, "patellar cartilage"),
    (5, "femur bone"),
    (6, "tibia bone"),
    (7, "patella bone"),
    (8, "fibula bone"),
    (9, "lateral meniscus"),
    (10, "medial meniscus"),
];

/// Smooth union of two solids.
pub fn blend(a: f64, b: f64, width: f64) -> f64 {
    let h = (width - (a - b).abs()).max(0.0) / width;
    a.min(b) - 0.25 * h * h * width
}

/// Returns the approximate signed distance to an ellipsoid, negative inside.
pub fn ellipsoid(p: DVec3, centre: DVec3, radii: DVec3) -> f64 {
    let q = (p - centre) / radii;
    let steepness = (q / radii).length().max(1e-12);
    q.length() * (q.length() - 1.0) / steepness
}

/// Returns the signed distance to a rod with round ends.
pub fn rod(p: DVec3, a: DVec3, b: DVec3, radius: f64) -> f64 {
    let along = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
    p.distance(a.lerp(b, along)) - radius
}

/// Returns the label at `p`: an extended knee with its joint near the origin and the lateral side
/// at +x.
fn knee_label(p: DVec3) -> u8 {
    let v = DVec3::new;
    let condyle = |side: f64| ellipsoid(p, v(21.0 * side, -4.0, 13.0), v(18.0, 27.0, 20.0));
    let shaft = rod(p, v(0.0, 2.0, 30.0), v(0.0, 4.0, 90.0), 14.0);
    let femur = blend(blend(condyle(-1.0), condyle(1.0), 8.0), shaft, 22.0);
    let plateau = ellipsoid(p, v(0.0, -3.0, -25.0), v(40.0, 27.0, 13.0)).max(p.z + 11.0);
    let tibia = blend(
        plateau,
        rod(p, v(0.0, 0.0, -30.0), v(0.0, 2.0, -90.0), 13.0),
        20.0,
    );
    let patella = ellipsoid(p, v(0.0, 39.0, 20.0), v(20.0, 9.0, 20.0));
    let fibula = rod(p, v(36.0, -22.0, -34.0), v(40.0, -20.0, -90.0), 7.0);
    let facing = p.z < 13.0 + 0.9 * p.y.max(0.0);
    let over_plateau = |side: f64| {
        let q = DVec2::new(p.x - 21.0 * side, p.y + 4.0);
        p.z > -14.0 && q.length() < 16.0
    };
    let wedge = |side: f64| {
        let around = DVec2::new((p.x - 21.0 * side) / 0.85, p.y + 4.0).length() - 17.0;
        // Open towards the centre of the joint, where its horns are attached.
        let open = side * p.x < 9.0 && (p.y + 4.0).abs() < 7.0;
        !open && around.hypot((p.z + 8.0) * 1.1) < 5.0
    };
    match () {
        () if femur < 0.0 => 5,
        () if tibia < 0.0 => 6,
        () if patella < 0.0 => 7,
        () if fibula < 0.0 => 8,
        () if femur < 2.8 && facing => 1,
        () if tibia < 2.6 && over_plateau(-1.0) => 2,
        () if tibia < 2.6 && over_plateau(1.0) => 3,
        () if patella < 3.0 && p.y < 36.0 && p.z < 36.0 => 4,
        () if wedge(1.0) => 9,
        () if wedge(-1.0) => 10,
        () => 0,
    }
}

/// Returns a segmented knee: labels 0 to 10, oblique voxels of 1.3 × 1.3 × 1.5 mm.
pub fn knee() -> Volume {
    let turn = DMat3::from_rotation_z(0.08) * DMat3::from_rotation_x(-0.05);
    // The voxel axes are those of a sagittal scan: anterior, inferior, left.
    let axes = DMat3::from_cols(DVec3::Y * 1.3, DVec3::NEG_Z * 1.3, DVec3::NEG_X * 1.5);
    let size = [78, 104, 64];
    let to_world = centred(turn * axes, size, DVec3::new(2.0, 4.0, 0.0));
    let names = KNEE.map(|(label, name)| (i64::from(label), name.to_owned()));
    Volume {
        label_names: names.into(),
        ..volume(size, to_world, knee_label, Raw::U8)
    }
}

/// Tissue of a point of the head, from outside in.
struct Head {
    skin: f64,
    skull: f64,
    brain: f64,
    white: f64,
    ventricles: f64,
    airway: f64,
}

fn head(p: DVec3) -> Head {
    let v = DVec3::new;
    let cranium = ellipsoid(p, v(0.0, -6.0, 30.0), v(72.0, 90.0, 72.0));
    let face = ellipsoid(p, v(0.0, 34.0, -28.0), v(56.0, 52.0, 62.0));
    let nose = rod(p, v(0.0, 80.0, 0.0), v(0.0, 94.0, -22.0), 9.0);
    let neck = rod(p, v(0.0, -18.0, -40.0), v(0.0, -26.0, -140.0), 46.0);
    let skin = blend(blend(blend(cranium, face, 30.0), neck, 30.0), nose, 12.0);
    let vault = ellipsoid(p, v(0.0, -6.0, 30.0), v(66.0, 84.0, 66.0));
    let brain = ellipsoid(p, v(0.0, -6.0, 30.0), v(58.0, 76.0, 58.0));
    let cheek = |side: f64| {
        rod(
            p,
            v(side * 42.0, 52.0, -12.0),
            v(side * 58.0, 6.0, -2.0),
            6.5,
        )
    };
    let jaw = |side: f64| {
        let chin = rod(p, v(0.0, 74.0, -72.0), v(side * 38.0, 44.0, -66.0), 8.5);
        chin.min(rod(
            p,
            v(side * 38.0, 44.0, -66.0),
            v(side * 48.0, 6.0, -18.0),
            8.0,
        ))
    };
    let maxilla = ellipsoid(p, v(0.0, 58.0, -24.0), v(30.0, 22.0, 22.0));
    let spine = rod(p, v(0.0, -26.0, -42.0), v(0.0, -34.0, -140.0), 15.0);
    let eyes = |side: f64| ellipsoid(p, v(side * 30.0, 66.0, 8.0), v(15.0, 20.0, 14.0));
    let bones = [cheek(-1.0), cheek(1.0), jaw(-1.0), jaw(1.0), maxilla, spine];
    let solid = bones.into_iter().fold(vault, |a, b| blend(a, b, 8.0));
    let hollows = brain.min(eyes(-1.0)).min(eyes(1.0));
    let ripple = 3.0 * ((0.19 * p.x).sin() * (0.17 * p.y).sin() * (0.18 * p.z).sin());
    let airway = rod(p, v(0.0, 20.0, -30.0), v(0.0, 6.0, -140.0), 8.0);
    Head {
        skin,
        skull: solid.max(-hollows),
        brain: brain + 1.0,
        white: ellipsoid(p, v(0.0, -6.0, 30.0), v(46.0, 64.0, 46.0)) + 2.0 * ripple,
        ventricles: ellipsoid(p, v(9.0, -8.0, 32.0), v(6.0, 26.0, 10.0)).min(ellipsoid(
            p,
            v(-9.0, -8.0, 32.0),
            v(6.0, 26.0, 10.0),
        )),
        airway,
    }
}

/// Blends from `outside` to `inside` over the width of a voxel at the surface.
pub fn over(outside: f64, inside: f64, distance: f64, width: f64) -> f64 {
    outside + (inside - outside) * (0.5 - distance / width).clamp(0.0, 1.0)
}

/// Returns a head in CT: values are Hounsfield units + 1,024, voxels of 3.2 × 3.2 × 3 mm.
pub fn head_ct() -> Volume {
    let size = [56, 70, 78];
    let axes = DMat3::from_diagonal(DVec3::new(-3.2, -3.2, 3.0));
    let to_world = centred(axes, size, DVec3::new(0.0, 0.0, -8.0));
    let value = |p: DVec3| {
        let head = head(p);
        let soft = over(0.0, 1064.0, head.skin, 3.2);
        let bone = over(soft, 2100.0, head.skull.max(head.skin + 4.0), 3.2);
        over(bone, 0.0, head.airway, 3.2).round() as i16
    };
    volume(size, to_world, value, Raw::I16)
}

/// Returns a head in MRI (T1-like): values of 0 to 500 with a slope of 2.5, voxels of 3.4 mm.
pub fn head_mri() -> Volume {
    let size = [52, 66, 72];
    let axes = DMat3::from_diagonal(DVec3::splat(3.4));
    let to_world = centred(axes, size, DVec3::new(0.0, 0.0, -8.0));
    let value = |p: DVec3| {
        let head = head(p);
        let mut value = over(0.0, 430.0, head.skin, 3.4);
        value = over(value, 210.0, head.skin + 7.0, 3.4);
        value = over(value, 60.0, head.skull.max(head.skin + 4.0), 3.4);
        value = over(value, 90.0, head.brain - 3.0, 3.4);
        value = over(value, 250.0, head.brain, 3.4);
        value = over(value, 360.0, head.white, 3.4);
        value = over(value, 80.0, head.ventricles, 3.4);
        (over(value, 0.0, head.airway, 3.4) / 2.5).round() as u8
    };
    Volume {
        slope: 2.5,
        ..volume(size, to_world, value, Raw::U8)
    }
}

/// Returns the transform that moves the centre of a grid to `middle`.
pub fn centred(axes: DMat3, size: [usize; 3], middle: DVec3) -> DAffine3 {
    let half = DVec3::from(size.map(|n| (n as f64 - 1.0) / 2.0));
    DAffine3::from_mat3_translation(axes, middle - axes * half)
}

pub fn volume<T>(
    size: [usize; 3],
    to_world: DAffine3,
    value: impl Fn(DVec3) -> T,
    raw: impl Fn(Vec<T>) -> Raw,
) -> Volume {
    let [ni, nj, nk] = size;
    let mut values = Vec::with_capacity(ni * nj * nk);
    for k in 0..nk {
        for j in 0..nj {
            for i in 0..ni {
                let index = DVec3::new(i as f64, j as f64, k as f64);
                values.push(value(to_world.transform_point3(index)));
            }
        }
    }
    Volume {
        size,
        raw: raw(values),
        to_world,
        ..Volume::default()
    }
}

/// Returns the surface of a lobe of a lung, in mm: a deformed sphere of 1,280 triangles.
pub fn lobe() -> TriMesh {
    let (directions, triangles) = sphere(3);
    let shape = |d: DVec3| {
        let outer = DVec3::new(48.0, 62.0, 88.0);
        let r = (d / outer).length().recip();
        // Concave towards the heart, cut off at the fissure below.
        let heart = 1.0 - 0.35 * (-4.0 * (1.0 - d.dot(DVec3::new(-0.8, 0.5, -0.33)))).exp();
        let bumps = 1.0 + 0.02 * ((5.0 * d.x).sin() + (6.0 * d.y).cos() * (4.0 * d.z).sin());
        let mut p = d * r * heart * bumps;
        let fissure = -38.0 + 0.35 * p.y;
        p.z = if p.z < fissure {
            fissure + 0.25 * (p.z - fissure)
        } else {
            p.z
        };
        p + DVec3::new(70.0, 0.0, 120.0)
    };
    TriMesh {
        vertices: directions.into_iter().map(shape).collect(),
        triangles,
        ..TriMesh::default()
    }
}

/// Returns a unit icosahedron subdivided `times` times.
fn sphere(times: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut vertices: Vec<DVec3> = [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)]
        .iter()
        .flat_map(|(a, b)| {
            [
                DVec3::new(*a, *b, 0.0),
                DVec3::new(0.0, *a, *b),
                DVec3::new(*b, 0.0, *a),
            ]
        })
        .map(DVec3::normalize)
        .collect();
    // The faces of the hull: three vertices, each pair an edge of the icosahedron.
    let near = |a: usize, b: usize| vertices[a].dot(vertices[b]) > 0.4;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let outward = (vertices[b] - vertices[a])
                        .cross(vertices[c] - vertices[a])
                        .dot(vertices[a])
                        > 0.0;
                    let (b, c) = if outward { (b, c) } else { (c, b) };
                    triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    for _ in 0..times {
        let mut middles = HashMap::new();
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for [a, b, c] in triangles {
            let mut middle = |p: u32, q: u32| {
                *middles.entry([p.min(q), p.max(q)]).or_insert_with(|| {
                    vertices.push((vertices[p as usize] + vertices[q as usize]).normalize());
                    vertices.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (vertices, triangles)
}
