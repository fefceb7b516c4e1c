//! Phantom of a chest in CT with contrast agent: lungs with their vessels, ribs, heart, and the
//! organs below the diaphragm. World coordinates are RAS, in mm; values are Hounsfield units.

use super::phantoms::{blend, centred, ellipsoid, over, rod, volume};
use glam::{DMat3, DVec2, DVec3};
use palpate::volume::{Raw, Volume};

const SIZE: [usize; 3] = [110, 76, 112];
/// The edge of a voxel, mm.
const VOXEL: f64 = 3.2;
/// Values are rounded to multiples of this, which reduces the size of the file.
const GREYS: f64 = 20.0;

const AIR: f64 = -1000.0;
const LUNG: f64 = -850.0;
const FAT: f64 = -100.0;
const MUSCLE: f64 = 50.0;
const BLOOD: f64 = 260.0;
const CARTILAGE: f64 = 120.0;
const SPONGY: f64 = 250.0;
const CORTICAL: f64 = 700.0;

/// A vessel of a lung: its two ends and its radius.
type Vessel = (DVec3, DVec3, f64);

/// Returns the vessel tree of the lung on a side, from its hilum outwards.
fn vessels(side: f64) -> Vec<Vessel> {
    let mut made = Vec::new();
    let ways = [
        [0.5, 0.1, 0.9],
        [0.9, 0.5, 0.1],
        [0.8, -0.6, -0.2],
        [0.4, 0.1, -1.0],
    ];
    for way in ways {
        let way = DVec3::new(side * way[0], way[1], way[2]).normalize();
        branch(
            &mut made,
            (DVec3::new(side * 34.0, -10.0, 30.0), way),
            42.0,
            6.5,
            4,
        );
    }
    made
}

fn branch(
    made: &mut Vec<Vessel>,
    (from, way): (DVec3, DVec3),
    length: f64,
    radius: f64,
    more: u32,
) {
    let to = from + length * way;
    made.push((from, to, radius));
    if more == 0 {
        return;
    }
    // Each fork is perpendicular to the previous one.
    let across = way.cross(if more.is_multiple_of(2) {
        DVec3::Y
    } else {
        DVec3::Z
    });
    let across = across.normalize_or(DVec3::X);
    for turn in [-0.45, 0.65] {
        let way = (way + turn * across).normalize();
        branch(made, (to, way), 0.75 * length, 0.78 * radius, more - 1);
    }
}

/// Returns the height of the diaphragm: two domes.
fn diaphragm(p: DVec3) -> f64 {
    let dome = |side: f64, top: f64| {
        let q = DVec2::new(p.x - side * 68.0, p.y);
        top - 0.009 * q.length_squared()
    };
    dome(1.0, -28.0).max(dome(-1.0, -40.0))
}

fn lung(p: DVec3, side: f64) -> f64 {
    let whole = ellipsoid(
        p,
        DVec3::new(side * 70.0, -4.0, 10.0),
        DVec3::new(58.0, 78.0, 142.0),
    );
    whole.max(diaphragm(p) - p.z)
}

/// Returns the approximate distance to a rib, and the position around the chest, from −1 (back) to
/// 1 (front).
fn rib(p: DVec3, number: usize) -> (f64, f64) {
    let n = number as f64;
    let wide = (0.55 + 0.13 * n).min(1.0);
    let [a, b] = [136.0 * wide, 90.0 * wide.sqrt()];
    let q = DVec2::new(p.x / a, p.y / b);
    let r = q.length().max(1e-9);
    let front = q.y / r;
    let height = 128.0 - 27.0 * n - 24.0 * (1.0 + front);
    let off = DVec2::new(
        (r - 1.0) * DVec2::new(p.x, p.y).length() / r,
        0.7 * (p.z - height),
    );
    (off.length() - 4.5, front)
}

/// Returns the value at `p`. Long because it lists the organs in the order in which they cover each
/// other. `trees` are the vessels of the left and the right lung.
fn value(p: DVec3, trees: &[Vec<Vessel>; 2]) -> f64 {
    let v = DVec3::new;
    let narrow = 1.0 - 0.0035 * (p.z - 100.0).max(0.0);
    let skin = {
        let q = DVec2::new(p.x / (158.0 * narrow), p.y / (112.0 * narrow));
        (q.length() - 1.0) * DVec2::new(p.x, p.y).length() / q.length().max(1e-9)
    };
    let put = |below: f64, number: f64, distance: f64| over(below, number, distance, VOXEL);
    let mut x = put(AIR, FAT, skin);
    x = put(x, MUSCLE, skin + 10.0);

    // Below the diaphragm.
    let under = p.z - diaphragm(p) + 5.0;
    let organ = |p, at, radii| ellipsoid(p, at, radii).max(under);
    let cavity = organ(p, v(0.0, 0.0, -120.0), v(128.0, 82.0, 110.0));
    x = put(x, -60.0, cavity);
    x = put(x, 110.0, organ(p, v(62.0, 6.0, -78.0), v(74.0, 70.0, 56.0)));
    x = put(
        x,
        130.0,
        organ(p, v(-88.0, -34.0, -84.0), v(30.0, 30.0, 42.0)),
    );
    let stomach = organ(p, v(-52.0, 26.0, -88.0), v(40.0, 34.0, 36.0));
    x = put(x, 30.0, stomach);
    x = put(x, AIR, (stomach + 4.0).max(42.0 - p.y));
    for side in [-1.0, 1.0] {
        let kidney = ellipsoid(p, v(side * 56.0, -48.0, -142.0), v(22.0, 22.0, 40.0));
        x = put(x, 190.0, kidney);
    }

    // The lungs, and the mediastinum.
    let heart = ellipsoid(p, v(-20.0, 20.0, -14.0), v(50.0, 44.0, 48.0));
    let heart = heart.max(diaphragm(p) - p.z - 2.0);
    for (side, tree) in [-1.0, 1.0].into_iter().zip(trees) {
        let lung = lung(p, side).max(6.0 - heart);
        x = put(x, LUNG, lung);
        if lung < 0.0 {
            let nearest = tree.iter().map(|(a, b, r)| rod(p, *a, *b, *r));
            x = put(
                x,
                BLOOD,
                nearest.fold(f64::INFINITY, f64::min).max(lung + 3.0),
            );
        }
        let bronchus = rod(p, v(0.0, -16.0, 58.0), v(side * 40.0, -14.0, 36.0), 6.0);
        x = put(x, AIR, bronchus);
    }
    x = put(x, 100.0, heart);
    let left = ellipsoid(p, v(-34.0, 14.0, -18.0), v(22.0, 26.0, 30.0));
    let right = ellipsoid(p, v(4.0, 28.0, -8.0), v(18.0, 20.0, 32.0));
    x = put(x, BLOOD, left.min(right).max(heart + 6.0));
    let arch = [
        v(-4.0, 14.0, 20.0),
        v(4.0, 8.0, 66.0),
        v(-4.0, -12.0, 80.0),
        v(-16.0, -44.0, 66.0),
    ];
    let aorta = arch.windows(2).map(|w| rod(p, w[0], w[1], 11.0));
    let down = rod(p, arch[3], v(-12.0, -46.0, -180.0), 10.0);
    x = put(x, BLOOD, aorta.fold(down, |a, b| blend(a, b, 8.0)));
    x = put(
        x,
        AIR,
        rod(p, v(0.0, -10.0, 190.0), v(0.0, -16.0, 58.0), 8.0),
    );

    // Bones: cancellous inside, cortical outside.
    let bone = |x: f64, d: f64| put(put(x, CORTICAL, d), SPONGY, d + 3.5);
    let along = (p.z / 28.0).rem_euclid(1.0) * 28.0;
    let spine = rod(p, v(0.0, -68.0, -200.0), v(0.0, -68.0, 200.0), 17.0);
    x = bone(x, spine.max((along - 14.0).abs() - 11.0));
    let arch = rod(p, v(0.0, -92.0, -200.0), v(0.0, -92.0, 200.0), 12.0);
    x = bone(x, arch.max((along - 14.0).abs() - 8.0));
    x = bone(x, ellipsoid(p, v(0.0, 88.0, 42.0), v(15.0, 5.0, 72.0)));
    for side in [-1.0, 1.0] {
        x = bone(
            x,
            rod(
                p,
                v(side * 14.0, 76.0, 128.0),
                v(side * 112.0, 8.0, 146.0),
                6.5,
            ),
        );
    }
    for number in 0..11 {
        let (distance, front) = rib(p, number);
        // The lowest two end at the sides, the others in cartilage in front.
        let floats = number > 8;
        x = bone(
            x,
            distance.max(40.0 * (front - if floats { 0.2 } else { 0.8 })),
        );
        if !floats {
            x = put(x, CARTILAGE, distance.max(40.0 * (0.8 - front)));
        }
    }
    put(
        x,
        20.0,
        rod(p, v(0.0, -84.0, -200.0), v(0.0, -84.0, 200.0), 7.0),
    )
}

/// Returns the CT of a chest: Hounsfield units, voxels of 3.2 mm.
pub fn chest_ct() -> Volume {
    let axes = DMat3::from_diagonal(DVec3::new(-VOXEL, -VOXEL, VOXEL));
    let to_world = centred(axes, SIZE, DVec3::new(0.0, 0.0, -6.0));
    let trees = [-1.0, 1.0].map(vessels);
    let number = |p: DVec3| ((value(p, &trees) / GREYS).round() * GREYS) as i16;
    volume(SIZE, to_world, number, Raw::I16)
}
