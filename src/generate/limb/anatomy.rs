//! Geometry of the limb phantom: skin, muscles, tendons, bones and joints as implicit solids.
//!
//! A forearm and hand, palm down, in metres: x runs from the cut through the forearm to the
//! fingertips, y towards the thumb, z towards the back of the hand.

use super::super::shapes::{
    LongBone, bent_chain, ellipse, ellipsoid, rod, smooth_step, smooth_union,
};
use glam::{DVec2, DVec3, dvec2, dvec3};

/// Position of the wrist along x; the forearm is cut at x = 0.
const WRIST: f64 = 0.141;

/// Minimum thickness of skin and fat over any muscle.
const COVER: f64 = 0.0036;

/// Distance from the bone up to which a joint is filled with cartilage.
const CARTILAGE: f64 = 0.0024;

/// Signed distances of a point to the tissues, in metres: negative inside.
pub(super) struct Distances {
    /// To the outside.
    pub skin: f64,
    pub muscle: f64,
    pub tendon: f64,
    pub cartilage: f64,
    /// To the outer surface of the nearest bone.
    pub bone: f64,
    /// The number of that bone.
    pub nearest: usize,
    /// To its marrow.
    pub marrow: f64,
}

/// A bone and the thickness of its cortical shell.
struct Bone {
    shape: BoneShape,
    cortex: f64,
}

enum BoneShape {
    Long(LongBone),
    Round { centre: DVec3, radii: DVec3 },
}

/// A straight segment of a finger between two joints.
struct Segment {
    ends: [DVec3; 2],
    radii: [f64; 2],
}

/// A muscle belly of the forearm with a circular section: centre and radius in the plane of the
/// cut.
struct Belly {
    centre: DVec2,
    radius: f64,
}

/// Precomputed geometry of the phantom, independent of the query point.
pub(super) struct Anatomy {
    /// Skin around the fingers, distal of the knuckles.
    fingers: Vec<Segment>,
    /// Skin around the metacarpals.
    palm: Vec<Segment>,
    bones: Vec<Bone>,
    /// Spheres in which cartilage covers the bones.
    joints: Vec<(DVec3, f64)>,
    tendons: Vec<Segment>,
    bellies: Vec<Belly>,
    /// Muscles of the hand.
    hand_muscles: Vec<Segment>,
}

/// Parameters of a digit.
struct Digit {
    /// Base of the metacarpal, and the knuckle at its other end.
    metacarpal: [DVec3; 2],
    /// Direction in the plane of the hand, in degrees from x towards y.
    spread: f64,
    /// Flexion of each phalanx towards the palm, in degrees.
    flexion: &'static [f64],
    /// Lengths between joints.
    phalanges: &'static [f64],
    /// Radius of the skin at the knuckle.
    radius: f64,
}

const DIGITS: [Digit; 5] = [
    Digit {
        metacarpal: [dvec3(0.1665, 0.0255, -0.005), dvec3(0.199, 0.0500, -0.013)],
        spread: 36.0,
        flexion: &[6.0, 8.0],
        phalanges: &[0.034, 0.027],
        radius: 0.0112,
    },
    Digit {
        metacarpal: [dvec3(0.1775, 0.0170, 0.002), dvec3(0.2370, 0.0290, 0.003)],
        spread: 14.0,
        flexion: &[7.0, 13.0, 9.0],
        phalanges: &[0.041, 0.025, 0.020],
        radius: 0.0104,
    },
    Digit {
        metacarpal: [dvec3(0.1795, 0.0040, 0.003), dvec3(0.2415, 0.0062, 0.005)],
        spread: 3.0,
        flexion: &[6.0, 12.0, 9.0],
        phalanges: &[0.045, 0.028, 0.021],
        radius: 0.0106,
    },
    Digit {
        metacarpal: [dvec3(0.1775, -0.0085, 0.002), dvec3(0.2350, -0.0165, 0.003)],
        spread: -9.0,
        flexion: &[8.0, 13.0, 9.0],
        phalanges: &[0.041, 0.026, 0.020],
        radius: 0.0102,
    },
    Digit {
        metacarpal: [
            dvec3(0.1735, -0.0190, 0.000),
            dvec3(0.2230, -0.0365, -0.001),
        ],
        spread: -23.0,
        flexion: &[9.0, 12.0, 8.0],
        phalanges: &[0.033, 0.020, 0.018],
        radius: 0.0092,
    },
];

/// Centres and radii of the carpal bones, the row next to the forearm first.
const CARPALS: [(DVec3, DVec3); 7] = [
    (dvec3(0.1515, 0.0145, -0.001), dvec3(0.0072, 0.0078, 0.0080)),
    (dvec3(0.1500, -0.0005, 0.000), dvec3(0.0070, 0.0066, 0.0080)),
    (dvec3(0.1520, -0.0145, 0.000), dvec3(0.0066, 0.0066, 0.0072)),
    (dvec3(0.1600, 0.0220, -0.004), dvec3(0.0056, 0.0060, 0.0066)),
    (dvec3(0.1675, 0.0115, 0.001), dvec3(0.0064, 0.0056, 0.0070)),
    (dvec3(0.1670, -0.0010, 0.001), dvec3(0.0088, 0.0062, 0.0078)),
    (dvec3(0.1665, -0.0140, 0.000), dvec3(0.0076, 0.0066, 0.0074)),
];

/// Muscles at the cut through the forearm: the flexors below, the extensors above.
const BELLIES: [Belly; 8] = [
    belly(0.0205, -0.0150, 0.0105),
    belly(0.0000, -0.0185, 0.0105),
    belly(-0.0205, -0.0150, 0.0105),
    belly(-0.0270, -0.0005, 0.0080),
    belly(-0.0180, 0.0150, 0.0095),
    belly(0.0005, 0.0190, 0.0095),
    belly(0.0185, 0.0155, 0.0095),
    belly(0.0275, 0.0010, 0.0085),
];

const fn belly(y: f64, z: f64, radius: f64) -> Belly {
    Belly {
        centre: dvec2(y, z),
        radius,
    }
}

impl Anatomy {
    pub(super) fn new() -> Anatomy {
        let mut anatomy = Anatomy {
            fingers: Vec::new(),
            palm: Vec::new(),
            bones: Vec::new(),
            joints: vec![(dvec3(0.1575, 0.002, 0.0), 0.0265)],
            tendons: Vec::new(),
            bellies: BELLIES.into(),
            hand_muscles: Vec::new(),
        };
        anatomy.forearm_bones();
        for (centre, radii) in CARPALS {
            anatomy.bones.push(Bone {
                shape: BoneShape::Round { centre, radii },
                cortex: 0.0030,
            });
        }
        for digit in &DIGITS {
            anatomy.digit(digit);
        }
        // Between the metacarpals, and the pads of the thumb and of the little finger.
        for pair in DIGITS[1..].windows(2) {
            let middle = |end: usize| {
                pair[0].metacarpal[end].midpoint(pair[1].metacarpal[end]) - DVec3::Z * 0.003
            };
            anatomy.hand_muscles.push(Segment {
                ends: [middle(0), middle(0).lerp(middle(1), 0.85)],
                radii: [0.0050, 0.0062],
            });
        }
        anatomy.hand_muscles.push(Segment {
            ends: [dvec3(0.166, 0.020, -0.012), dvec3(0.194, 0.036, -0.014)],
            radii: [0.0085, 0.0100],
        });
        anatomy.hand_muscles.push(Segment {
            ends: [dvec3(0.166, -0.021, -0.010), dvec3(0.209, -0.033, -0.009)],
            radii: [0.0080, 0.0072],
        });
        anatomy
    }

    fn forearm_bones(&mut self) {
        // The radius is thick at the wrist, the ulna at the elbow.
        let radius = [dvec3(-0.03, 0.0125, 0.002), dvec3(0.1315, 0.0085, 0.000)];
        let ulna = [dvec3(-0.03, -0.0130, -0.002), dvec3(0.1330, -0.0162, 0.002)];
        for (ends, shaft, heads) in [
            (radius, 0.0074, [0.0080, 0.0115]),
            (ulna, 0.0068, [0.0088, 0.0074]),
        ] {
            self.bones.push(Bone {
                shape: BoneShape::Long(LongBone { ends, shaft, heads }),
                cortex: 0.0024,
            });
        }
    }

    /// Adds the bones, skin, joints and tendons of one digit.
    fn digit(&mut self, digit: &Digit) {
        let [base, knuckle] = digit.metacarpal;
        self.palm.push(Segment {
            ends: [base.lerp(knuckle, 0.1), knuckle],
            radii: [0.0150, digit.radius + 0.0022],
        });
        let lengths = digit.phalanges.iter().copied();
        let mut joints = vec![base];
        joints.extend(bent_chain(
            knuckle,
            digit.spread,
            lengths.zip(digit.flexion),
        ));
        let last = joints.len() - 2;
        for (n, ends) in joints.windows(2).enumerate() {
            let axis = (ends[1] - ends[0]).normalize_or_zero();
            // Bones taper from the palm to the tip.
            let size = digit.radius * (0.96 - 0.10 * n as f64);
            let (shaft, head) = (0.47 * size, 0.58 * size);
            let heads = [head, if n == last { 0.48 * size } else { head * 0.95 }];
            // A joint is a gap of 2 mm between the surfaces.
            let near = if n == 0 { 0.0035 } else { head + 0.0010 };
            let far = heads[1] + 0.0010;
            let bone = LongBone {
                ends: [ends[0] + axis * near, ends[1] - axis * far],
                shaft,
                heads,
            };
            self.bones.push(Bone {
                shape: BoneShape::Long(bone),
                cortex: 0.65 * shaft,
            });
            if n > 0 {
                self.joints.push((ends[0], 0.0078));
                let radius = |k: usize| digit.radius * (1.0 - 0.085 * k as f64);
                let tip = if n == last {
                    axis * 0.0035
                } else {
                    DVec3::ZERO
                };
                self.fingers.push(Segment {
                    ends: [ends[0], ends[1] - tip],
                    radii: [radius(n - 1), radius(n)],
                });
            }
        }
        self.digit_tendons(digit, &joints);
    }

    /// Adds one tendon along the palm side and one along the back, from the forearm to the last
    /// joint.
    fn digit_tendons(&mut self, digit: &Digit, joints: &[DVec3]) {
        let base = joints[0];
        for (side, offset, radius) in [(-1.0, 0.0068, 0.0024), (1.0, 0.0072, 0.0017)] {
            // Bundled at the wrist.
            let bundle = if side < 0.0 { -0.0125 } else { 0.0125 };
            let mut path = vec![
                dvec3(0.080, 0.7 * base.y, bundle * 1.15),
                dvec3(0.142, 0.45 * base.y, bundle),
                dvec3(0.172, 0.75 * base.y, bundle + 0.3 * base.z),
            ];
            let end = joints.len() - 1;
            for (n, joint) in joints.iter().enumerate().take(end).skip(1) {
                let scale = digit.radius / 0.0104 * (1.0 - 0.08 * n as f64);
                path.push(*joint + DVec3::Z * (side * offset * scale));
            }
            for ends in path.windows(2) {
                self.tendons.push(Segment {
                    ends: [ends[0], ends[1]],
                    radii: [radius; 2],
                });
            }
        }
    }

    /// Returns the distance to the outside of the phantom: its skin, and the cut through the
    /// forearm.
    pub(super) fn outside(&self, p: DVec3) -> f64 {
        // A rounded edge: the lattice cannot resolve a sharp one.
        -smooth_union(-self.skin(p), p.x, 0.008)
    }

    /// Returns the distance to the skin, without the cut through the forearm.
    fn skin(&self, p: DVec3) -> f64 {
        // The forearm, thickest at a third of its length, flat at the wrist.
        let t = smooth_step(0.02, 0.135, p.x);
        let swell = 0.0022 * smooth_step(0.0, 0.035, p.x) * (1.0 - t);
        let half = dvec2(0.0385 - 0.0110 * t + swell, 0.0310 - 0.0115 * t + swell);
        // It tapers into the palm and ends there.
        let past = smooth_step(0.125, 0.205, p.x);
        let forearm = ellipse(dvec2(p.y, p.z), half - dvec2(0.0060, 0.0085) * past);
        let forearm = forearm.max(p.x - 0.195);
        let carpus = ellipsoid(p, dvec3(0.170, 0.0, -0.001), dvec3(0.034, 0.0300, 0.0175));
        let mut hand = smooth_union(forearm, carpus, 0.020);
        for s in &self.palm {
            hand = smooth_union(hand, s.distance(p), 0.011);
        }
        for m in &self.hand_muscles {
            hand = smooth_union(hand, m.distance(p) - COVER, 0.009);
        }
        let mut fingers = f64::INFINITY;
        for s in &self.fingers {
            fingers = smooth_union(fingers.min(1.0), s.distance(p), 0.0028);
        }
        smooth_union(hand, fingers, 0.006)
    }

    /// Returns the distances to all tissues.
    pub(super) fn distances(&self, p: DVec3) -> Distances {
        let skin = self.skin(p);
        let nearest = |segments: &[Segment]| {
            segments
                .iter()
                .map(|s| s.distance(p))
                .fold(f64::INFINITY, f64::min)
        };
        let (mut bone, mut marrow) = (f64::INFINITY, f64::INFINITY);
        let mut nearest_bone = 0;
        for (n, b) in self.bones.iter().enumerate() {
            let distance = match &b.shape {
                BoneShape::Long(long) => long.distance(p),
                BoneShape::Round { centre, radii } => ellipsoid(p, *centre, *radii),
            };
            if distance < bone {
                (bone, nearest_bone) = (distance, n);
            }
            marrow = marrow.min(distance + b.cortex);
        }
        let joint = self
            .joints
            .iter()
            .map(|(centre, radius)| p.distance(*centre) - radius)
            .fold(f64::INFINITY, f64::min);
        let muscle = self.forearm_muscles(p).min(nearest(&self.hand_muscles));
        Distances {
            skin,
            muscle: muscle.max(skin + COVER),
            tendon: nearest(&self.tendons).max(skin + 0.0024),
            cartilage: (bone - CARTILAGE).max(joint),
            bone,
            nearest: nearest_bone,
            marrow,
        }
    }

    fn forearm_muscles(&self, p: DVec3) -> f64 {
        // They converge towards the wrist and end as tendons.
        let t = smooth_step(0.030, WRIST - 0.006, p.x);
        let gather = 1.0 - 0.36 * t;
        let plane = dvec2(p.y, p.z);
        let deep = ellipse(plane, dvec2(0.0255, 0.0125) * (1.0 - 0.30 * t));
        let swell = 1.0 + 0.06 * smooth_step(0.0, 0.035, p.x);
        let bellies = self.bellies.iter().map(|b| {
            let centre = b.centre * gather * (1.0 + 0.03 * swell);
            plane.distance(centre) - b.radius * swell * (1.0 - 0.72 * t)
        });
        let muscle = bellies.fold(deep, |a, b| smooth_union(a, b, 0.0016));
        muscle.max(p.x - (WRIST - 0.010))
    }
}

impl Segment {
    fn distance(&self, p: DVec3) -> f64 {
        rod(p, self.ends, self.radii)
    }
}
