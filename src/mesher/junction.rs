//! Points at junctions of three or four regions: one in each face of the lattice with three
//! regions, one in each tet with three or more.

use super::cut::{CutLattice, ON_BOUNDARY};
use super::domain::{OffsetDomain, Sampler};
use super::lattice::LatticeMesh;
use super::stencil::Corners;
use crate::Result;
use crate::mesh::FACES;
use crate::parallel;
use crate::progress::ProgressScope;
use glam::DVec3;
use rayon::slice::ParallelSliceMut;

/// Minimum barycentric coordinates of the points in faces and in tets: their clearance from the
/// sides.
const FACE_MARGIN: f64 = 0.14;
const TET_MARGIN: f64 = 0.1;

/// The points inside faces and tets.
pub(super) struct Junctions {
    /// Faces with three regions, their points ascending; sorted.
    faces: Vec<[u32; 3]>,
    /// Lattice tets with an interior point, ascending.
    tets: Vec<u32>,
    /// The points: of faces, then of tets.
    pub points: Vec<DVec3>,
    /// The number of the first junction node, after lattice points and cuts.
    first: usize,
}

/// Sorts the points of a face.
pub(super) fn face_key(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

impl Junctions {
    pub(super) fn new(
        domain: OffsetDomain,
        lattice: &LatticeMesh,
        cut: &CutLattice,
        part: &ProgressScope,
    ) -> Result<Junctions> {
        let region = |p: u32| cut.region[p as usize];
        let tets = parallel::collect(lattice.tets.len(), |range, tets| {
            let has_middle = |t: &usize| {
                let tet = lattice.tets[*t];
                let first = region(tet[0]);
                tet.iter().any(|p| region(*p) != first)
                    && Corners::of(cut, tet).needs_interior_point(lattice)
            };
            tets.extend(range.filter(has_middle).map(|t| t as u32));
        });
        let mut faces = parallel::collect(lattice.tets.len(), |range, faces| {
            for tet in &lattice.tets[range] {
                let around = FACES.map(|f| f.map(|i| tet[i]));
                faces.extend(around.into_iter().filter_map(|face| {
                    let [a, b, c] = face.map(region);
                    let differ = a != b && b != c && c != a;
                    (differ && ![a, b, c].contains(&ON_BOUNDARY)).then(|| face_key(face))
                }));
            }
        });
        faces.par_sort_unstable();
        faces.dedup();
        part.check_cancelled()?;
        let mut whole = Junctions {
            points: parallel::collect(faces.len(), |range, points| {
                if !part.should_continue() {
                    return;
                }
                let mut sampler = Sampler::new(domain);
                points.extend(faces[range].iter().map(|face| {
                    let corners = face.map(|p| cut.positions[p as usize]);
                    meeting_point(&mut sampler, corners, face.map(region))
                }));
            }),
            faces,
            tets,
            first: cut.positions.len() + cut.cuts.len(),
        };
        part.check_cancelled()?;
        let inside = parallel::map(whole.tets.len(), |n| {
            whole.inside(lattice, cut, lattice.tets[whole.tets[n] as usize])
        });
        whole.points.extend(inside);
        Ok(whole)
    }

    /// Returns the number of faces and of tets with a point.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.faces.len(), self.tets.len()]
    }

    /// Returns the node inside a face with three regions.
    pub(super) fn face_point(&self, key: [u32; 3]) -> u32 {
        // Every such face is listed, so the search cannot fail.
        let place = self.faces.binary_search(&key).unwrap_or_else(|p| p);
        (self.first + place) as u32
    }

    /// Returns the node inside a tet with three or more regions.
    pub(super) fn tet_point(&self, t: u32) -> u32 {
        let place = self.tets.binary_search(&t).unwrap_or_else(|p| p);
        (self.first + self.faces.len() + place) as u32
    }

    /// Returns the mean of the junctions on the faces of a tet, or of its cuts.
    fn inside(&self, lattice: &LatticeMesh, cut: &CutLattice, tet: [u32; 4]) -> DVec3 {
        let faces = FACES.map(|f| face_key(f.map(|i| tet[i])));
        let mut around: Vec<DVec3> = faces
            .iter()
            .filter_map(|face| Some(self.points[self.faces.binary_search(face).ok()?]))
            .collect();
        if around.is_empty() {
            let corners = tet.map(|p| lattice.positions[p as usize]);
            around.extend(corners);
        }
        let corners = tet.map(|p| cut.positions[p as usize]);
        let centre = corners.into_iter().sum::<DVec3>() / 4.0;
        let point = around.iter().sum::<DVec3>() / around.len() as f64;
        // Moved towards the centroid until the clearance from every face suffices.
        let volume = |[a, b, c, d]: [DVec3; 4]| (b - a).cross(c - a).dot(d - a);
        let all = volume(corners);
        let least = (0..4)
            .map(|i| {
                let mut part = corners;
                part[i] = point;
                volume(part) / all
            })
            .fold(f64::INFINITY, f64::min);
        let pull = match least < TET_MARGIN {
            true => (TET_MARGIN - least) / (0.25 - least),
            false => 0.0,
        };
        point.lerp(centre, pull)
    }
}

/// Returns the point of a triangle at which the regions of its three corners have equal weights,
/// with a clearance from the sides.
fn meeting_point(sampler: &mut Sampler, corners: [DVec3; 3], regions: [u16; 3]) -> DVec3 {
    let [a, b, c] = corners;
    let at = |[u, v]: [f64; 2]| a + u * (b - a) + v * (c - a);
    let mut gap = |x: [f64; 2]| {
        let [wa, wb, wc] = sampler.weights_of(at(x), regions);
        [wa - wb, wa - wc]
    };
    let mut x = [1.0 / 3.0; 2];
    let mut f = gap(x);
    const STEP: f64 = 0.02;
    for _ in 0..4 {
        let fu = gap([x[0] + STEP, x[1]]).map(|f| f / STEP);
        let fv = gap([x[0], x[1] + STEP]).map(|f| f / STEP);
        let slope = [
            [fu[0] - f[0] / STEP, fv[0] - f[0] / STEP],
            [fu[1] - f[1] / STEP, fv[1] - f[1] / STEP],
        ];
        let determinant = slope[0][0] * slope[1][1] - slope[0][1] * slope[1][0];
        let next = kept_inside([
            x[0] - (slope[1][1] * f[0] - slope[0][1] * f[1]) / determinant,
            x[1] - (slope[0][0] * f[1] - slope[1][0] * f[0]) / determinant,
        ]);
        let Some(next) = next else { break };
        let g = gap(next);
        if g[0].hypot(g[1]) >= f[0].hypot(f[1]) {
            break;
        }
        (x, f) = (next, g);
    }
    at(x)
}

/// Returns the point of the triangle u, v, 1 − u − v ≥ margin on the segment from its centroid to
/// `x`.
fn kept_inside(x: [f64; 2]) -> Option<[f64; 2]> {
    let [u, v] = x;
    if !(u.is_finite() && v.is_finite()) {
        return None;
    }
    let middle = 1.0 / 3.0;
    let least = u.min(v).min(1.0 - u - v);
    let part = match least < FACE_MARGIN {
        true => (middle - FACE_MARGIN) / (middle - least),
        false => 1.0,
    };
    Some([middle + part * (u - middle), middle + part * (v - middle)])
}
