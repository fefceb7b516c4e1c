//! Geometry of the foot phantom: skin and bones as implicit solids.
//!
//! A right foot, standing, in metres: x runs from the heel to the toes, y towards the big toe,
//! z up from the sole.

use super::super::shapes::{LongBone, bent_chain, ellipsoid, rod, smooth_step, smooth_union};
use glam::{DVec3, dvec3};

/// The bones, in the order of their labels from 2 on: tarsus, metatarsus, toes.
pub(crate) const FOOT_BONES: [&str; 26] = [
    "calcaneus bone",
    "talus bone",
    "navicular bone",
    "cuboid bone",
    "medial cuneiform bone",
    "intermediate cuneiform bone",
    "lateral cuneiform bone",
    "first metatarsal bone",
    "second metatarsal bone",
    "third metatarsal bone",
    "fourth metatarsal bone",
    "fifth metatarsal bone",
    "first proximal phalanx bone",
    "first distal phalanx bone",
    "second proximal phalanx bone",
    "second middle phalanx bone",
    "second distal phalanx bone",
    "third proximal phalanx bone",
    "third middle phalanx bone",
    "third distal phalanx bone",
    "fourth proximal phalanx bone",
    "fourth middle phalanx bone",
    "fourth distal phalanx bone",
    "fifth proximal phalanx bone",
    "fifth middle phalanx bone",
    "fifth distal phalanx bone",
];

/// Minimum thickness of soft tissue over any bone.
const COVER: f64 = 0.0015;

/// Height of the cut through the leg.
const ANKLE: f64 = 0.102;

/// Height of the ground.
const SOLE: f64 = -0.002;

/// A rounded primitive of a bone or of the skin.
enum Part {
    Rod { ends: [DVec3; 2], radii: [f64; 2] },
    Round { centre: DVec3, radii: DVec3 },
    Long(LongBone),
}

use Part::{Rod, Round};

impl Part {
    fn distance(&self, p: DVec3) -> f64 {
        match self {
            Rod { ends, radii } => rod(p, *ends, *radii),
            Round { centre, radii } => ellipsoid(p, *centre, *radii),
            Part::Long(bone) => bone.distance(p),
        }
    }
}

/// A bone: the smooth union of its primitives.
struct Bone {
    parts: Vec<Part>,
    /// Width of the smooth union.
    blend: f64,
    /// Its bounding sphere.
    ball: (DVec3, f64),
}

impl Bone {
    fn new(parts: Vec<Part>, blend: f64) -> Bone {
        let points: Vec<(DVec3, f64)> = parts
            .iter()
            .flat_map(|part| match part {
                Rod { ends, radii } => vec![(ends[0], radii[0]), (ends[1], radii[1])],
                Round { centre, radii } => vec![(*centre, radii.max_element())],
                Part::Long(b) => vec![(b.ends[0], b.heads[0]), (b.ends[1], b.heads[1])],
            })
            .collect();
        let middle = points.iter().map(|p| p.0).sum::<DVec3>() / points.len() as f64;
        let reach = points.iter().map(|(p, r)| p.distance(middle) + r);
        let ball = (middle, reach.fold(0.0, f64::max));
        Bone { parts, blend, ball }
    }

    fn distance(&self, p: DVec3) -> f64 {
        let parts = self.parts.iter().map(|part| part.distance(p));
        parts
            .reduce(|a, b| smooth_union(a, b, self.blend))
            .unwrap_or(f64::INFINITY)
    }
}

/// A toe with its metatarsal.
struct Ray {
    /// The joints at either end of the metatarsal.
    metatarsal: [DVec3; 2],
    /// Its radii: shaft, base, head.
    radii: [f64; 3],
    /// Direction of the toe in the plane of the sole, in degrees from x towards y.
    spread: f64,
    /// Flexion of each phalanx, downwards, in degrees.
    flexion: &'static [f64],
    /// Lengths between joints, and radii of shaft and ends.
    phalanges: &'static [[f64; 3]],
    /// Radius of the skin at the root of the toe.
    skin: f64,
}

const RAYS: [Ray; 5] = [
    Ray {
        metatarsal: [dvec3(0.1620, 0.0250, 0.0400), dvec3(0.2210, 0.0340, 0.0160)],
        radii: [0.0074, 0.0112, 0.0112],
        spread: -1.0,
        flexion: &[-4.0, 10.0],
        phalanges: &[[0.0340, 0.0066, 0.0090], [0.0245, 0.0058, 0.0074]],
        skin: 0.0122,
    },
    Ray {
        metatarsal: [dvec3(0.1560, 0.0085, 0.0480), dvec3(0.2300, 0.0118, 0.0150)],
        radii: [0.0046, 0.0072, 0.0070],
        spread: 0.0,
        flexion: &[-6.0, 24.0, 8.0],
        phalanges: &[
            [0.0265, 0.0038, 0.0056],
            [0.0150, 0.0036, 0.0046],
            [0.0110, 0.0033, 0.0041],
        ],
        skin: 0.0086,
    },
    Ray {
        metatarsal: [
            dvec3(0.1585, -0.0065, 0.0430),
            dvec3(0.2240, -0.0060, 0.0145),
        ],
        radii: [0.0043, 0.0066, 0.0066],
        spread: -2.0,
        flexion: &[-6.0, 26.0, 8.0],
        phalanges: &[
            [0.0245, 0.0036, 0.0053],
            [0.0130, 0.0034, 0.0044],
            [0.0105, 0.0032, 0.0040],
        ],
        skin: 0.0081,
    },
    Ray {
        metatarsal: [
            dvec3(0.1370, -0.0195, 0.0325),
            dvec3(0.2145, -0.0230, 0.0135),
        ],
        radii: [0.0042, 0.0066, 0.0064],
        spread: -4.0,
        flexion: &[-6.0, 28.0, 8.0],
        phalanges: &[
            [0.0230, 0.0035, 0.0051],
            [0.0120, 0.0034, 0.0043],
            [0.0100, 0.0032, 0.0039],
        ],
        skin: 0.0079,
    },
    Ray {
        metatarsal: [
            dvec3(0.1345, -0.0335, 0.0230),
            dvec3(0.2010, -0.0390, 0.0130),
        ],
        radii: [0.0043, 0.0072, 0.0062],
        spread: -6.0,
        flexion: &[-6.0, 28.0, 8.0],
        phalanges: &[
            [0.0210, 0.0034, 0.0049],
            [0.0105, 0.0033, 0.0042],
            [0.0095, 0.0031, 0.0038],
        ],
        skin: 0.0077,
    },
];

/// Precomputed geometry of the phantom, independent of the query point.
pub(super) struct Anatomy {
    bones: Vec<Bone>,
    /// Skin of the heel, the ankle and the middle of the foot.
    back: Vec<Part>,
    /// Skin of each toe.
    toes: Vec<Vec<Part>>,
}

impl Anatomy {
    /// Long because it lists the bones and the skin of the foot.
    pub(super) fn new() -> Anatomy {
        let v = dvec3;
        let rod = |a: DVec3, b: DVec3, from: f64, to: f64| Rod {
            ends: [a, b],
            radii: [from, to],
        };
        let round = |centre: DVec3, radii: DVec3| Round { centre, radii };
        let calcaneus = vec![
            round(v(0.0230, -0.0010, 0.0300), v(0.0200, 0.0165, 0.0225)),
            rod(
                v(0.0350, -0.0030, 0.0310),
                v(0.0740, -0.0130, 0.0310),
                0.0165,
                0.0125,
            ),
            // The sustentaculum, which carries the talus.
            rod(
                v(0.0600, -0.0020, 0.0370),
                v(0.0660, 0.0100, 0.0400),
                0.0080,
                0.0060,
            ),
        ];
        let talus = vec![
            round(v(0.0660, 0.0005, 0.0705), v(0.0230, 0.0165, 0.0135)),
            rod(
                v(0.0800, 0.0030, 0.0640),
                v(0.1035, 0.0100, 0.0540),
                0.0110,
                0.0125,
            ),
        ];
        let navicular = vec![
            round(v(0.1255, 0.0125, 0.0500), v(0.0068, 0.0175, 0.0135)),
            round(v(0.1230, 0.0260, 0.0430), v(0.0060, 0.0060, 0.0075)),
        ];
        let cuboid = vec![
            rod(
                v(0.1020, -0.0205, 0.0300),
                v(0.1200, -0.0240, 0.0290),
                0.0120,
                0.0122,
            ),
            round(v(0.1120, -0.0130, 0.0320), v(0.0120, 0.0080, 0.0090)),
        ];
        let cuneiforms = [
            round(v(0.1485, 0.0240, 0.0440), v(0.0122, 0.0090, 0.0145)),
            round(v(0.1440, 0.0085, 0.0530), v(0.0090, 0.0068, 0.0105)),
            round(v(0.1460, -0.0055, 0.0475), v(0.0105, 0.0072, 0.0120)),
        ];
        let mut bones: Vec<Bone> = [calcaneus, talus, navicular, cuboid]
            .into_iter()
            .map(|parts| Bone::new(parts, 0.010))
            .collect();
        bones.extend(cuneiforms.map(|part| Bone::new(vec![part], 0.0)));
        let mut phalanges = Vec::new();
        let mut toes = Vec::new();
        for ray in &RAYS {
            let [metatarsal, rest, skin] = ray.parts();
            bones.extend(metatarsal.into_iter().map(|p| Bone::new(vec![p], 0.0)));
            phalanges.extend(rest.into_iter().map(|p| Bone::new(vec![p], 0.0)));
            toes.push(skin);
        }
        bones.extend(phalanges);
        let mut back = vec![
            round(v(0.0250, -0.0010, 0.0260), v(0.0320, 0.0300, 0.0320)),
            rod(
                v(0.0280, -0.0010, 0.0300),
                v(0.0900, -0.0090, 0.0390),
                0.0290,
                0.0290,
            ),
            // The Achilles tendon, and the leg.
            rod(
                v(0.0210, -0.0005, 0.0400),
                v(0.0350, 0.0000, 0.1400),
                0.0170,
                0.0150,
            ),
            rod(
                v(0.0660, 0.0005, 0.0620),
                v(0.0560, 0.0000, 0.1500),
                0.0315,
                0.0300,
            ),
            // The malleoli on either side.
            round(v(0.0640, 0.0265, 0.0800), v(0.0130, 0.0090, 0.0150)),
            round(v(0.0560, -0.0270, 0.0740), v(0.0120, 0.0085, 0.0150)),
            // The instep below the leg.
            rod(
                v(0.0800, 0.0030, 0.0660),
                v(0.1450, 0.0110, 0.0470),
                0.0230,
                0.0180,
            ),
        ];
        for (ray, [from, to]) in RAYS.iter().zip([
            [0.0200, 0.0185],
            [0.0190, 0.0150],
            [0.0190, 0.0145],
            [0.0190, 0.0140],
            [0.0170, 0.0140],
        ]) {
            let [base, head] = ray.metatarsal;
            // It extends backwards below the tarsus, and ends slightly above the centre of the
            // head.
            let start = base.lerp(head, -0.45) - DVec3::Z * 0.008;
            back.push(rod(start, head + DVec3::Z * 0.0005, from, to));
        }
        Anatomy { bones, back, toes }
    }

    /// Returns the number of bones.
    pub(super) fn bones(&self) -> usize {
        self.bones.len()
    }

    /// Returns the distance to the outside of the phantom: its skin, the ground, and the cut
    /// through the leg.
    pub(super) fn outside(&self, p: DVec3) -> f64 {
        // Rounded edges: the lattice cannot resolve sharp ones.
        let ground = -smooth_union(-self.skin(p), p.z - SOLE, 0.006);
        -smooth_union(-ground, ANKLE - p.z, 0.008)
    }

    /// Returns the distance to the skin, without the cut through the leg and the ground.
    fn skin(&self, p: DVec3) -> f64 {
        let width = 0.012 + 0.008 * smooth_step(0.14, 0.08, p.x);
        let back = self.back.iter().map(|part| part.distance(p));
        let back = back.fold(1.0, |a, b| smooth_union(a, b, width));
        let toes = self.toes.iter().map(|toe| {
            let parts = toe.iter().map(|part| part.distance(p));
            parts.fold(1.0, |a, b| smooth_union(a, b, 0.004))
        });
        let toes = toes.fold(1.0, |a: f64, b| smooth_union(a, b, 0.0012));
        smooth_union(back, toes, 0.007)
    }

    /// Returns the distance to the outside, the nearest bone, and the distance to it.
    pub(super) fn distances(&self, p: DVec3) -> (f64, usize, f64) {
        let outside = self.outside(p);
        let mut nearest = (0, f64::INFINITY);
        for (n, bone) in self.bones.iter().enumerate() {
            let (middle, reach) = bone.ball;
            // The bounding sphere is a lower bound of the distance.
            if p.distance(middle) - reach - bone.blend < nearest.1 {
                let distance = bone.distance(p);
                if distance < nearest.1 {
                    nearest = (n, distance);
                }
            }
        }
        (outside, nearest.0, nearest.1.max(outside + COVER))
    }

    /// Returns the bounding box of a bone and its distance function.
    pub(super) fn bone(&self, n: usize) -> ((DVec3, DVec3), impl Fn(DVec3) -> f64 + '_) {
        let bone = &self.bones[n];
        let (middle, reach) = bone.ball;
        let half = DVec3::splat(reach + bone.blend);
        let distance = |p: DVec3| bone.distance(p).max(self.outside(p) + COVER);
        ((middle - half, middle + half), distance)
    }
}

impl Ray {
    /// Returns the metatarsal, the phalanges, and the skin around the phalanges.
    fn parts(&self) -> [Vec<Part>; 3] {
        let [base, head] = self.metatarsal;
        let lengths = self.phalanges.iter().map(|[length, ..]| *length);
        let mut joints = vec![base];
        joints.extend(bent_chain(head, self.spread, lengths.zip(self.flexion)));
        // A joint is a gap of 2 mm between the surfaces.
        let bone = |ends: &[DVec3], shaft: f64, heads: [f64; 2]| {
            let axis = (ends[1] - ends[0]).normalize_or_zero();
            let inset = heads.map(|r| r + 0.0009);
            Part::Long(LongBone {
                ends: [ends[0] + axis * inset[0], ends[1] - axis * inset[1]],
                shaft,
                heads,
            })
        };
        let [shaft, first, last] = self.radii;
        let metatarsal = vec![bone(&joints[..2], shaft, [first, last])];
        let (mut phalanges, mut skin) = (Vec::new(), Vec::new());
        let tip = self.phalanges.len() - 1;
        for (n, ([_, shaft, end], ends)) in self
            .phalanges
            .iter()
            .zip(joints[1..].windows(2))
            .enumerate()
        {
            let slim = |n: usize| self.skin * (1.0 - 0.05 * n as f64);
            phalanges.push(bone(ends, *shaft, [*end, 0.88 * end]));
            let axis = (ends[1] - ends[0]).normalize_or_zero();
            let short = if n == tip { 0.5 * slim(n) } else { 0.0 };
            skin.push(Rod {
                ends: [ends[0], ends[1] - axis * short],
                radii: [slim(n), slim(n + 1)],
            });
        }
        [metatarsal, phalanges, skin]
    }
}
