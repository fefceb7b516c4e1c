//! Exact ray integral through a piecewise linear field, in float64.
//!
//! Every tet hit by a ray is found by a bounding-volume hierarchy and clipped separately, so the
//! result does not depend on neighbours, traversal or the order of tets.

use crate::mesh::{FACES, TetMesh};
use crate::parallel;
use crate::render::scan::{Scan, ScanReference};
use crate::render::{AbsoluteTransferFunction, Camera, Ray};
use glam::{DVec2, DVec3};

/// Segment of a ray in one tet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Distances along the ray at entry and exit.
    pub t: [f64; 2],
    /// Scalars at entry and exit.
    pub s: [f64; 2],
    /// Index of the tet.
    pub tet: u32,
}

/// Reference raycaster: a mesh prepared for exact ray integrals.
pub struct ReferenceRaycaster {
    corners: Vec<[DVec3; 4]>,
    scalars: Vec<[f64; 4]>,
    boxes: Vec<BoxNode>,
    order: Vec<u32>,
    extent: f64,
    /// Scan used instead of the scalars.
    scan: Option<ScanReference>,
}

/// Node of the bounding-volume hierarchy: a leaf contains `order[first..first + count]`; the
/// children of an inner node (count 0) are at `first` and `first + 1`.
struct BoxNode {
    low: DVec3,
    high: DVec3,
    first: usize,
    count: usize,
}

const LEAF_TETS: usize = 4;
/// Lateral offset of rays, relative to the extent of the mesh, so that no ray lies exactly in a
/// face shared by two tets, where it would be counted twice.
const RAY_PERTURBATION: f64 = 1e-12;

impl ReferenceRaycaster {
    /// Prepares `mesh` with node positions `positions` and `scalars` at the nodes.
    pub fn new(mesh: &TetMesh, positions: &[DVec3], scalars: &[f64]) -> ReferenceRaycaster {
        let corners = mesh.tets.iter().map(|t| t.map(|v| scalars[v as usize]));
        ReferenceRaycaster::with_corner_scalars(mesh, positions, corners.collect())
    }

    /// As [`ReferenceRaycaster::new`], with one constant scalar per tet.
    pub fn from_cell_scalars(
        mesh: &TetMesh,
        positions: &[DVec3],
        scalars: &[f64],
    ) -> ReferenceRaycaster {
        let corners = scalars.iter().map(|s| [*s; 4]);
        ReferenceRaycaster::with_corner_scalars(mesh, positions, corners.collect())
    }

    /// As [`ReferenceRaycaster::new`], with a scan of values attached to the mesh: the segment of
    /// each tet is split into sub-segments of one voxel divided by `fine`, along which the scan is
    /// linear.
    pub fn from_scan(
        mesh: &TetMesh,
        positions: &[DVec3],
        scan: &Scan,
        fine: f64,
    ) -> ReferenceRaycaster {
        ReferenceRaycaster {
            scan: Some(ScanReference::new(mesh, scan, fine)),
            ..ReferenceRaycaster::from_cell_scalars(mesh, positions, &vec![0.0; mesh.tets.len()])
        }
    }

    fn with_corner_scalars(
        mesh: &TetMesh,
        positions: &[DVec3],
        scalars: Vec<[f64; 4]>,
    ) -> ReferenceRaycaster {
        let corners: Vec<[DVec3; 4]> = mesh
            .tets
            .iter()
            .map(|t| t.map(|v| positions[v as usize]))
            .collect();
        let (low, high) = crate::mesh::bounds(positions);
        let mut reference = ReferenceRaycaster {
            order: (0..corners.len() as u32).collect(),
            corners,
            scalars,
            boxes: Vec::new(),
            extent: (high - low).max_element(),
            scan: None,
        };
        reference.build_boxes();
        reference
    }

    fn build_boxes(&mut self) {
        let tet_box = |t: u32| crate::mesh::bounds(&self.corners[t as usize]);
        let mut pending = vec![(0, 0, self.order.len())];
        self.boxes.push(BoxNode {
            low: DVec3::ZERO,
            high: DVec3::ZERO,
            first: 0,
            count: 0,
        });
        while let Some((node, start, end)) = pending.pop() {
            let tets = &mut self.order[start..end];
            let (low, high) = tets.iter().map(|t| tet_box(*t)).fold(
                (DVec3::INFINITY, DVec3::NEG_INFINITY),
                |(low, high), (l, h)| (low.min(l), high.max(h)),
            );
            let leaf = tets.len() <= LEAF_TETS;
            let first = if leaf { start } else { self.boxes.len() };
            let count = if leaf { tets.len() } else { 0 };
            self.boxes[node] = BoxNode {
                low,
                high,
                first,
                count,
            };
            if leaf {
                continue;
            }
            let axis = (high - low).max_position();
            let half = tets.len() / 2;
            let middle = |t: &u32| {
                self.corners[*t as usize]
                    .iter()
                    .map(|p| p[axis])
                    .sum::<f64>()
            };
            tets.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
            for (child, from, to) in [(first, start, start + half), (first + 1, start + half, end)]
            {
                self.boxes.push(BoxNode {
                    low,
                    high,
                    first: 0,
                    count: 0,
                });
                pending.push((child, from, to));
            }
        }
    }

    /// Returns the segments of `ray` in the tets, in order of entry; none behind the origin.
    pub fn segments(&self, ray: Ray) -> Vec<Segment> {
        let aside = ray.direction.any_orthonormal_vector();
        let aside = aside + 0.618 * ray.direction.cross(aside);
        let ray = Ray {
            origin: ray.origin + aside * (RAY_PERTURBATION * self.extent),
            ..ray
        };
        let mut found = Vec::new();
        let mut pending = vec![0];
        while let Some(node) = pending.pop() {
            let node = &self.boxes[node];
            if !meets_box(ray, node.low, node.high) {
                continue;
            }
            if node.count == 0 && node.first > 0 {
                pending.extend([node.first, node.first + 1]);
            }
            for t in &self.order[node.first..node.first + node.count] {
                found.extend(self.clip(ray, *t));
            }
        }
        found.sort_by(|a: &Segment, b| a.t[0].total_cmp(&b.t[0]).then(a.t[1].total_cmp(&b.t[1])));
        let Some(scan) = &self.scan else {
            return found;
        };
        let weights = |tet, t: f64| self.barycentric_weights(tet, ray.origin + ray.direction * t);
        let parts = found.into_iter().flat_map(|whole| {
            let ends = whole.t.map(|t| weights(whole.tet, t));
            scan.split(whole, ends)
        });
        parts.collect()
    }

    /// Clips `ray` to tet `t`: from the last plane entered to the first plane left.
    fn clip(&self, ray: Ray, t: u32) -> Option<Segment> {
        let v = self.corners[t as usize];
        let outward = crate::mesh::signed_volume(v).signum();
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for [a, b, c] in FACES {
            let normal = (v[b] - v[a]).cross(v[c] - v[a]) * outward;
            let slope = ray.direction.dot(normal);
            let distance = (v[a] - ray.origin).dot(normal);
            if slope < 0.0 {
                enter = enter.max(distance / slope);
            } else if slope > 0.0 {
                leave = leave.min(distance / slope);
            } else if distance < 0.0 {
                return None;
            }
        }
        let scalar = |t_ray: f64| self.scalar_in(t, ray.origin + ray.direction * t_ray);
        (enter < leave && leave.is_finite()).then(|| Segment {
            t: [enter, leave],
            s: [scalar(enter), scalar(leave)],
            tet: t,
        })
    }

    /// Returns the barycentric coordinates of point `p` in tet `t`, clamped to the tet.
    pub fn barycentric_weights(&self, t: u32, p: DVec3) -> [f64; 4] {
        let v = self.corners[t as usize];
        let w: [f64; 4] = std::array::from_fn(|i| {
            let mut part = v;
            part[i] = p;
            (crate::mesh::signed_volume(part) / crate::mesh::signed_volume(v)).clamp(0.0, 1.0)
        });
        let sum: f64 = w.iter().sum();
        w.map(|w| w / sum)
    }

    /// Returns the scalar at point `p` of tet `t`.
    fn scalar_in(&self, t: u32, p: DVec3) -> f64 {
        let (w, s) = (self.barycentric_weights(t, p), self.scalars[t as usize]);
        (0..4).map(|i| w[i] * s[i]).sum()
    }

    /// Returns the length of `ray` in the mesh; overlapping tets count separately.
    pub fn thickness(&self, ray: Ray) -> f64 {
        self.segments(ray).iter().map(|s| s.t[1] - s.t[0]).sum()
    }

    /// Returns emission and absorption along `ray`: premultiplied colour and opacity.
    ///
    /// I = ∫ c(s(t)) τ(s(t)) exp(−∫₀ᵗ τ) dt and α = 1 − exp(−∫ τ).
    pub fn composite(&self, ray: Ray, transfer: &AbsoluteTransferFunction) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for segment in self.segments(ray) {
            let [enter, leave] = segment.t;
            let part = transfer.segment_integral(segment.s[0], segment.s[1], leave - enter);
            let clear = 1.0 - sum[3];
            for k in 0..4 {
                sum[k] += clear * part[k];
            }
        }
        sum
    }

    /// As [`ReferenceRaycaster::composite`], with lighting: `shade` maps a tet, a point in it and
    /// the ray direction to the factor on colours and the term added in proportion to opacity. It
    /// is evaluated at the midpoint of each segment, as in the shaders.
    pub fn composite_lit(
        &self,
        ray: Ray,
        transfer: &AbsoluteTransferFunction,
        shade: impl Fn(u32, DVec3, DVec3) -> [f64; 2],
    ) -> [f64; 4] {
        let mut sum = [0.0; 4];
        let way = ray.direction.normalize_or_zero();
        for segment in self.segments(ray) {
            let [enter, leave] = segment.t;
            let part = transfer.segment_integral(segment.s[0], segment.s[1], leave - enter);
            let middle = ray.origin + ray.direction * (0.5 * (enter + leave));
            let [factor, shine] = shade(segment.tet, middle, way);
            let clear = 1.0 - sum[3];
            for k in 0..3 {
                sum[k] += clear * (factor * part[k] + shine * part[3]).min(part[3]);
            }
            sum[3] += clear * part[3];
        }
        sum
    }

    /// Returns the values of `of` for the ray of each pixel, row by row from the top.
    pub fn render<T: Send>(
        &self,
        camera: &Camera,
        size: [u32; 2],
        of: impl Fn(&Self, Ray) -> T + Sync,
    ) -> Vec<T> {
        let [width, height] = size.map(|n| n as usize);
        parallel::map_coarse(width * height, |i| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            of(self, camera.ray(DVec2::new(x + 0.5, y + 0.5), size))
        })
    }
}

/// Whether `ray` intersects the box (slab test); a ray parallel to a slab intersects it if inside.
fn meets_box(ray: Ray, low: DVec3, high: DVec3) -> bool {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for k in 0..3 {
        let (o, d) = (ray.origin[k], ray.direction[k]);
        if d == 0.0 {
            if o < low[k] || o > high[k] {
                return false;
            }
            continue;
        }
        let (a, b) = ((low[k] - o) / d, (high[k] - o) / d);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    // Tolerance: box planes and tet planes are rounded differently.
    enter <= leave * (1.0 + 1e-12) + 1e-300
}

/// Tolerance and maximum depth of the adaptive quadrature, for colours of order 1.
const QUADRATURE_TOLERANCE: f64 = 1e-11;
const QUADRATURE_DEPTH: u32 = 40;

impl AbsoluteTransferFunction {
    /// Returns emission and absorption along a segment of length `d` with a scalar that is linear from
    /// `s_front` to `s_back`: premultiplied colour and opacity.
    ///
    /// The segment is split at the breakpoints of the self function. In each part the extinction is
    /// linear, so that the opacity is exact and the colour is a smooth integral (adaptive Gauss
    /// quadrature).
    pub fn segment_integral(&self, s_front: f64, s_back: f64, d: f64) -> [f64; 4] {
        let mut cuts = vec![0.0];
        if s_front != s_back {
            let at = |node: &f64| (node - s_front) / (s_back - s_front);
            let mut inner: Vec<f64> = self.breakpoints().iter().map(at).collect();
            inner.retain(|u| *u > 0.0 && *u < 1.0);
            inner.sort_by(f64::total_cmp);
            cuts.extend(inner);
        }
        cuts.push(1.0);
        let mut sum = [0.0; 4];
        for pair in cuts.windows(2) {
            let (u, width) = (pair[0], pair[1] - pair[0]);
            // Colour and extinction are linear in a part: two inner points determine both, including
            // jumps.
            let inner = |w: f64| s_front + (s_back - s_front) * (u + w * width);
            let piece = Piece::through(self, inner(0.25), inner(0.75), d * width);
            let part = piece.integral();
            let clear = 1.0 - sum[3];
            for k in 0..4 {
                sum[k] += clear * part[k];
            }
        }
        sum
    }
}

/// Part of a segment with linear colour and extinction: value at 0 and slope, u from 0 to 1.
struct Piece {
    length: f64,
    extinction: [f64; 2],
    colour: [[f64; 2]; 3],
}

impl Piece {
    /// Creates a piece from the values at u = ¼ and u = ¾.
    fn through(transfer: &AbsoluteTransferFunction, quarter: f64, rest: f64, length: f64) -> Piece {
        let line = |a: f64, b: f64| [1.5 * a - 0.5 * b, 2.0 * (b - a)];
        let (a, b) = (transfer.colour(quarter), transfer.colour(rest));
        Piece {
            length,
            extinction: line(transfer.extinction(quarter), transfer.extinction(rest)),
            colour: std::array::from_fn(|k| line(a[k], b[k])),
        }
    }

    /// Returns the optical depth from 0 to u.
    fn depth(&self, u: f64) -> f64 {
        self.length * u * (self.extinction[0] + 0.5 * self.extinction[1] * u)
    }

    fn integral(&self) -> [f64; 4] {
        let [r, g, b] = self.adaptive(0.0, 1.0, self.gauss(0.0, 1.0), QUADRATURE_DEPTH);
        [r, g, b, -(-self.depth(1.0)).exp_m1()]
    }

    fn adaptive(&self, a: f64, b: f64, whole: [f64; 3], depth: u32) -> [f64; 3] {
        let m = 0.5 * (a + b);
        let (left, right) = (self.gauss(a, m), self.gauss(m, b));
        let halves: [f64; 3] = std::array::from_fn(|k| left[k] + right[k]);
        let error = (0..3)
            .map(|k| (halves[k] - whole[k]).abs())
            .fold(0.0, f64::max);
        if error < QUADRATURE_TOLERANCE || depth == 0 {
            return halves;
        }
        let left = self.adaptive(a, m, left, depth - 1);
        let right = self.adaptive(m, b, right, depth - 1);
        std::array::from_fn(|k| left[k] + right[k])
    }

    /// Five-point Gauss quadrature of ∫ c τ exp(−depth) over [a, b].
    fn gauss(&self, a: f64, b: f64) -> [f64; 3] {
        const POINTS: [[f64; 2]; 5] = [
            [-0.906_179_845_938_664, 0.236_926_885_056_189_1],
            [-0.538_469_310_105_683_1, 0.478_628_670_499_366_5],
            [0.0, 0.568_888_888_888_888_9],
            [0.538_469_310_105_683_1, 0.478_628_670_499_366_5],
            [0.906_179_845_938_664, 0.236_926_885_056_189_1],
        ];
        let half = 0.5 * (b - a);
        let mut sum = [0.0; 3];
        for [x, weight] in POINTS {
            let u = 0.5 * (a + b) + half * x;
            let extinction = self.extinction[0] + self.extinction[1] * u;
            let emitted = weight * half * self.length * extinction * (-self.depth(u)).exp();
            for (sum, [start, slope]) in sum.iter_mut().zip(self.colour) {
                *sum += emitted * (start + slope * u);
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;
    use crate::render::TransferFunction;

    fn two_colours() -> AbsoluteTransferFunction {
        TransferFunction::new(
            vec![
                [0.0, 1.0, 0.0, 0.2],
                [0.4, 0.1, 0.9, 0.2],
                [1.0, 0.0, 0.3, 1.0],
            ],
            vec![[0.1, 0.0], [0.35, 9.0], [0.5, 1.0], [0.5, 6.0], [0.9, 0.0]],
        )
        .unwrap()
        .to_absolute((0.0, 1.0), 1.0)
    }

    #[test]
    fn segment_integral_matches_fine_riemann_sum() {
        let tf = two_colours();
        for (s0, s1, d) in [
            (0.0, 1.0, 1.0),
            (0.9, 0.2, 3.0),
            (0.42, 0.44, 0.5),
            (0.3, 0.3, 0.2),
        ] {
            let steps = 400_000;
            let mut sum = [0.0; 4];
            for i in 0..steps {
                let s = s0 + (s1 - s0) * (f64::from(i) + 0.5) / f64::from(steps);
                let alpha = -(-tf.extinction(s) * d / f64::from(steps)).exp_m1();
                let [r, g, b] = tf.colour(s);
                let clear = 1.0 - sum[3];
                for (k, c) in [r, g, b, 1.0].into_iter().enumerate() {
                    sum[k] += clear * alpha * c;
                }
            }
            let exact = tf.segment_integral(s0, s1, d);
            for k in 0..4 {
                assert!(
                    (exact[k] - sum[k]).abs() < 2e-5,
                    "{s0} {s1} {d}: {exact:?} {sum:?}"
                );
            }
        }
    }

    #[test]
    fn constant_medium_matches_closed_form() {
        let tf = TransferFunction::new(vec![[0.0, 0.5, 0.25, 1.0]], vec![[0.0, 7.0]])
            .unwrap()
            .to_absolute((0.0, 1.0), 1.0);
        let alpha = 1.0 - (-7.0f64 * 0.3).exp();
        let got = tf.segment_integral(0.1, 0.8, 0.3);
        for (got, expected) in got
            .into_iter()
            .zip([0.5 * alpha, 0.25 * alpha, alpha, alpha])
        {
            assert!((got - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn ray_length_in_box_equals_box_thickness() {
        let mesh = generate::benchmark_cube(5, false).unwrap();
        let scalars = vec![0.0; mesh.nodes.len()];
        let reference = ReferenceRaycaster::new(&mesh, &mesh.nodes, &scalars);
        // Along an axis, through nodes, edges and faces: the worst case for double counting.
        let ray = |x: f64, y: f64| Ray {
            origin: DVec3::new(x, y, -1.0),
            direction: DVec3::Z,
        };
        for (x, y) in [
            (0.2, 0.4),
            (0.5, 0.5),
            (0.3, 0.4),
            (0.311, 0.77),
            (0.25, 0.25),
        ] {
            assert!(
                (reference.thickness(ray(x, y)) - 1.0).abs() < 1e-9,
                "{x} {y}"
            );
        }
        assert_eq!(reference.thickness(ray(1.2, 0.5)), 0.0);
        let inside = Ray {
            origin: DVec3::new(0.31, 0.42, 0.25),
            direction: DVec3::Z,
        };
        assert!((reference.thickness(inside) - 0.75).abs() < 1e-9);
    }
}
