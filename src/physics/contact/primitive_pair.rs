//! Vertex–face and edge–edge pairs of a boundary: closest points and continuous collision detection
//! (CCD).

use crate::mesh::closest_point_weights;
use glam::DVec3;

/// Maximum number of conservative advancement iterations per pair.
const MAX_PAIR_CCD_ITERATIONS: usize = 64;

/// Fraction of its distance that a pair keeps during a motion.
pub(in crate::physics) const MIN_DISTANCE_RATIO: f64 = 0.2;

/// Squared sine of the angle between two edges below which they are mollified as nearly parallel
/// (Li et al. 2020, equation 23).
const PARALLEL_SINE_SQUARED: f64 = 1e-3;

/// The kind of a pair of boundary features, given by four points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::physics) enum PrimitivePair {
    /// A vertex, then the three corners of a face.
    VertexFace,
    /// The two ends of an edge, then the two ends of another.
    EdgeEdge,
}

/// The closest points of two features.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::physics) struct ClosestPoints {
    /// Weights w: Σ w x over the four points is the vector from the second feature to the first.
    pub weights: [f64; 4],
    pub distance: f64,
    /// Unit vector from the second feature to the first; 0 where they touch.
    pub normal: DVec3,
}

impl PrimitivePair {
    /// Returns the closest points of the two features with the four points at `x`.
    pub fn closest_points(self, x: &[DVec3; 4]) -> ClosestPoints {
        let weights = match self {
            PrimitivePair::VertexFace => {
                let [a, b, c] = closest_point_weights(x[0], [x[1], x[2], x[3]]);
                [1.0, -a, -b, -c]
            }
            PrimitivePair::EdgeEdge => {
                let [s, t] = edge_edge_parameters(x);
                [1.0 - s, s, t - 1.0, -t]
            }
        };
        let apart: DVec3 = (0..4).map(|k| weights[k] * x[k]).sum();
        let distance = apart.length();
        ClosestPoints {
            weights,
            distance,
            normal: if distance > 0.0 {
                apart / distance
            } else {
                DVec3::ZERO
            },
        }
    }

    /// Upper bound of how much the features approach each other when the four points move by
    /// `moved`.
    pub fn max_approach(self, moved: &[DVec3; 4]) -> f64 {
        let mean = moved.iter().sum::<DVec3>() / 4.0;
        let [a, b, c, d] = moved.map(|by| (by - mean).length());
        match self {
            PrimitivePair::VertexFace => a + b.max(c).max(d),
            PrimitivePair::EdgeEdge => a.max(b) + c.max(d),
        }
    }

    /// Returns the fraction of the four points' linear motion for which the features keep the
    /// fraction `kept` of their distance. By additive CCD, a conservative advancement method (Li et
    /// al. 2021, "Codimensional incremental potential contact", section 5).
    pub fn collision_free_fraction(self, from: &[DVec3; 4], to: &[DVec3; 4], kept: f64) -> f64 {
        let moved = [0, 1, 2, 3].map(|k| to[k] - from[k]);
        let approach = self.max_approach(&moved);
        let distance = self.closest_points(from).distance;
        if distance <= 0.0 {
            // The features touch already: there is no distance to keep.
            return 1.0;
        }
        let least = kept * distance;
        let start = distance - least;
        let (mut t, mut free) = (0.0, start);
        for _ in 0..MAX_PAIR_CCD_ITERATIONS {
            if (1.0 - t) * approach <= free {
                return 1.0;
            }
            if free <= 1e-2 * start {
                break;
            }
            t += free / approach;
            let at = [0, 1, 2, 3].map(|k| from[k].lerp(to[k], t));
            free = self.closest_points(&at).distance - least;
        }
        t
    }

    /// Returns the mollifier of nearly parallel edges, whose distance is not smooth, and its
    /// gradient at the four points; `rest` are the edge lengths at rest. The mollifier of other
    /// pairs is 1.
    pub fn edge_edge_mollifier(self, x: &[DVec3; 4], rest: [f64; 2]) -> (f64, [DVec3; 4]) {
        let whole = (1.0, [DVec3::ZERO; 4]);
        if self == PrimitivePair::VertexFace {
            return whole;
        }
        let (a, b) = (x[1] - x[0], x[3] - x[2]);
        let across = a.cross(b);
        let least = PARALLEL_SINE_SQUARED * (rest[0] * rest[1]).powi(2);
        let part = across.length_squared() / least;
        if part >= 1.0 || least <= 0.0 {
            return whole;
        }
        let slope = 2.0 * (2.0 - 2.0 * part) / least;
        let (by_a, by_b) = (slope * b.cross(across), slope * across.cross(a));
        (part * (2.0 - part), [-by_a, by_a, -by_b, by_b])
    }
}

/// Parameters from 0 to 1 of the closest points of two edges (Ericson, *Real-Time Collision
/// Detection*, 5.1.9).
fn edge_edge_parameters([a, b, c, d]: &[DVec3; 4]) -> [f64; 2] {
    let (u, v, w) = (*b - *a, *d - *c, *a - *c);
    let (uu, vv, uv) = (u.length_squared(), v.length_squared(), u.dot(v));
    let (uw, vw) = (u.dot(w), v.dot(w));
    if uu <= 0.0 && vv <= 0.0 {
        return [0.0; 2];
    }
    if uu <= 0.0 {
        return [0.0, (vw / vv).clamp(0.0, 1.0)];
    }
    if vv <= 0.0 {
        return [(-uw / uu).clamp(0.0, 1.0), 0.0];
    }
    let across = uu * vv - uv * uv;
    let s = match across > 1e-12 * uu * vv {
        true => ((uv * vw - uw * vv) / across).clamp(0.0, 1.0),
        // Parallel edges: any point is a closest point.
        false => 0.0,
    };
    let t = (uv * s + vw) / vv;
    match t {
        t if t < 0.0 => [(-uw / uu).clamp(0.0, 1.0), 0.0],
        t if t > 1.0 => [((uv - uw) / uu).clamp(0.0, 1.0), 1.0],
        t => [s, t],
    }
}

/// Pseudo-random points in the cube from −1 to 1, by a linear congruential generator.
#[cfg(test)]
pub(crate) fn pseudo_random_points(count: usize, seed: u64) -> Vec<DVec3> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let mut point = || DVec3::new(next(), next(), next());
    (0..count).map(|_| point()).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const ALL: [PrimitivePair; 2] = [PrimitivePair::VertexFace, PrimitivePair::EdgeEdge];

    /// `count` sets of four pseudo-random points.
    fn points(count: usize, seed: u64) -> Vec<[DVec3; 4]> {
        let all = pseudo_random_points(4 * count, seed);
        let fours = all.chunks_exact(4);
        fours.map(|x| [x[0], x[1], x[2], x[3]]).collect()
    }

    /// Minimum distance over a lattice of points on both features.
    fn searched(features: PrimitivePair, x: &[DVec3; 4]) -> f64 {
        let n = 60;
        let part = |k: i32| f64::from(k) / f64::from(n);
        let mut least = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=n {
                let (p, q) = match features {
                    PrimitivePair::VertexFace if i + j <= n => {
                        let along = part(i) * (x[2] - x[1]) + part(j) * (x[3] - x[1]);
                        (x[0], x[1] + along)
                    }
                    PrimitivePair::VertexFace => continue,
                    PrimitivePair::EdgeEdge => (x[0].lerp(x[1], part(i)), x[2].lerp(x[3], part(j))),
                };
                least = least.min(p.distance(q));
            }
        }
        least
    }

    #[test]
    fn closest_points_match_search() {
        for features in ALL {
            for x in points(200, 1) {
                let found = features.closest_points(&x);
                let sum: f64 = found.weights.iter().sum();
                assert!(sum.abs() < 1e-12);
                let least = searched(features, &x);
                assert!(found.distance <= least + 1e-12);
                assert!(
                    least - found.distance < 0.05,
                    "{features:?} {least} {found:?}"
                );
            }
        }
    }

    #[test]
    fn collision_free_fraction_is_safe_and_tight() {
        let mut stopped = 0;
        for features in ALL {
            for (from, to) in points(500, 2).into_iter().zip(points(500, 3)) {
                let way = features.collision_free_fraction(&from, &to, MIN_DISTANCE_RATIO);
                let at = |t: f64| {
                    let x = [0, 1, 2, 3].map(|k| from[k].lerp(to[k], t));
                    features.closest_points(&x).distance
                };
                let start = at(0.0);
                for k in 0..=200 {
                    let t = way * f64::from(k) / 200.0;
                    assert!(
                        at(t) >= 0.99 * MIN_DISTANCE_RATIO * start,
                        "{features:?} {way} {t}"
                    );
                }
                if way < 1.0 {
                    // The motion was stopped by the other feature.
                    stopped += 1;
                    assert!(
                        at(way) <= 0.3 * start,
                        "{features:?} {way} {}",
                        at(way) / start
                    );
                }
            }
        }
        assert!(stopped > 50, "{stopped}");
    }

    #[test]
    fn edge_edge_mollifier_gradient_matches_finite_differences() {
        let mut some = 0;
        for mut x in points(200, 4) {
            // Makes the edges nearly parallel.
            x[3] = x[2] + (x[1] - x[0]) + 0.02 * (x[3] - x[2]);
            let rest = [x[0].distance(x[1]), x[2].distance(x[3])];
            let (share, slope) = PrimitivePair::EdgeEdge.edge_edge_mollifier(&x, rest);
            assert!((0.0..=1.0).contains(&share));
            some += u32::from(share < 1.0);
            for k in 0..4 {
                for axis in DVec3::AXES {
                    let e = 1e-7;
                    let moved = |by: f64| {
                        let mut y = x;
                        y[k] += by * axis;
                        PrimitivePair::EdgeEdge.edge_edge_mollifier(&y, rest).0
                    };
                    let found = (moved(e) - moved(-e)) / (2.0 * e);
                    let own = slope[k].dot(axis);
                    assert!(
                        (found - own).abs() < 1e-3 * (1.0 + own.abs()),
                        "{found} {own}"
                    );
                }
            }
        }
        assert!(some > 50);
    }
}
