//! Node smoothing that maximises the minimum quality of the incident tets.
//!
//! Boundary nodes slide along their boundary: each move is followed by a projection onto the points
//! of equal weights of the regions around the node.

use super::editable_mesh::EditableMesh;
use super::quality::quality;
use glam::{DMat3, DVec3};

/// Trial step lengths as fractions of the mean length of the edges at the node.
const STEPS: [f64; 4] = [0.3, 0.15, 0.06, 0.02];

/// Maximum distance of a boundary node from its boundary, as a fraction of the lattice's edge.
const MAX_BOUNDARY_DRIFT: f64 = 0.08;

/// Finite-difference step for gradients of weights, as a fraction of the lattice's edge.
const FINITE_DIFFERENCE_STEP: f64 = 0.02;

/// Minimum improvement of the quality by a move.
const MIN_IMPROVEMENT: f64 = 1e-3;

impl EditableMesh<'_> {
    /// Moves node `v` to the best of several trial positions, if one is an improvement.
    pub(super) fn smooth(&mut self, v: u32) -> bool {
        if self.is_fixed(v) {
            return false;
        }
        let regions = self.regions_at(v);
        if regions.len() > 4 {
            return false;
        }
        let star = self.star(v).to_vec();
        let here = self.nodes[v as usize];
        let mut length = 0.0;
        for t in &star {
            let edges = self.positions(self.corners(*t)).map(|p| p.distance(here));
            length += edges.into_iter().sum::<f64>() / 3.0;
        }
        length /= star.len().max(1) as f64;
        let boundary = match regions.len() {
            1 => None,
            _ => match self.boundary_at(here, &regions) {
                Some(boundary) => Some(boundary),
                None => return false,
            },
        };
        let mut best = (self.min_quality(&star) + MIN_IMPROVEMENT, None);
        for step in STEPS {
            for n in (0..27).filter(|n| *n != 13) {
                let direction = DVec3::from([n % 3, n / 3 % 3, n / 9].map(|c| f64::from(c) - 1.0));
                let to = here + direction.normalize() * (step * length);
                let to = match &boundary {
                    Some(boundary) => self.project_to_boundary(boundary, to, &regions),
                    None => Some(to),
                };
                let Some(to) = to else { continue };
                let min_quality = self.min_quality_with(v, to, &star, best.0);
                if min_quality > best.0 {
                    best = (min_quality, Some(to));
                }
            }
            if best.1.is_some() {
                break;
            }
        }
        if let Some(to) = best.1 {
            self.nodes[v as usize] = to;
            return true;
        }
        false
    }

    /// Returns the minimum quality around `v` if it were at `to`, or any number below `enough`.
    fn min_quality_with(&self, v: u32, to: DVec3, star: &[u32], enough: f64) -> f64 {
        let mut min_quality = f64::INFINITY;
        for t in star {
            let tet = self.corners(*t);
            let mut at = self.positions(tet);
            for (corner, position) in tet.iter().zip(&mut at) {
                if *corner == v {
                    *position = to;
                }
            }
            min_quality = min_quality.min(quality(at));
            if min_quality <= enough {
                break;
            }
        }
        min_quality
    }

    /// Returns the weight of the first region minus that of each other one at `p`; unused entries
    /// are 0.
    fn gaps(&mut self, p: DVec3, regions: &[u16]) -> DVec3 {
        let of = |i: usize| regions.get(i).copied().unwrap_or(regions[0]);
        let [a, b, c, d] = self
            .sampler
            .weights_of(p, [regions[0], of(1), of(2), of(3)]);
        DVec3::new(a - b, a - c, a - d)
    }

    /// Linearises the boundary between `regions` at `p`; `None` if the gradients vanish.
    fn boundary_at(&mut self, p: DVec3, regions: &[u16]) -> Option<Boundary> {
        let step = FINITE_DIFFERENCE_STEP * self.edge;
        let slope = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let ahead = self.gaps(p + step * axis, regions);
            (ahead - self.gaps(p - step * axis, regions)) / (2.0 * step)
        });
        // Rows are the gradients of the weight differences.
        let gradients = DMat3::from_cols(slope[0], slope[1], slope[2]);
        let rows = gradients.transpose();
        let mut square = gradients * rows;
        let scale = rows.x_axis.length_squared();
        // Unused differences, and linearly dependent ones, stay 0.
        for i in 0..3 {
            square.col_mut(i)[i] += 1e-6 * scale + f64::MIN_POSITIVE;
        }
        // Maps weight differences to the shortest step that cancels them (pseudo-inverse).
        let back = rows * square.inverse();
        let off = back.mul_vec3(self.gaps(p, regions)).length();
        off.is_finite().then_some(Boundary { back })
    }

    /// Projects `p` onto the boundary; `None` if the iteration does not converge.
    fn project_to_boundary(
        &mut self,
        boundary: &Boundary,
        mut p: DVec3,
        regions: &[u16],
    ) -> Option<DVec3> {
        let near = MAX_BOUNDARY_DRIFT * self.edge;
        for _ in 0..3 {
            let off = boundary.back.mul_vec3(self.gaps(p, regions));
            p -= off.clamp_length_max(0.5 * self.edge);
            if off.length() < 0.1 * near {
                break;
            }
        }
        let off = boundary.back.mul_vec3(self.gaps(p, regions));
        (off.length() < near).then_some(p)
    }
}

/// A linearised boundary near a node: maps weight differences to the step back onto it.
struct Boundary {
    back: DMat3,
}
