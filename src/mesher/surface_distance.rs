//! Distance of the boundary of a mesh from that of its domain.

use super::domain::{OffsetDomain, Sampler};
use super::{Domain, MeshedDomain};
use crate::mesh::{TetMesh, Topology};
use crate::parallel;
use glam::DVec3;

/// Largest number of boundary faces that are measured; of more an even selection.
const MAX_FACES: usize = 20_000;
/// Points of a face, by barycentric coordinates: the midpoints of its edges and its centroid.
const POINTS: [[f64; 3]; 4] = [
    [0.5, 0.5, 0.0],
    [0.0, 0.5, 0.5],
    [0.5, 0.0, 0.5],
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
];
/// Steps of the search along a normal, and bisections of the step that crosses the boundary.
const STEPS: u32 = 8;
const BISECTIONS: u32 = 12;

impl MeshedDomain {
    /// Measures the root mean square and the maximum of the distances between the boundary of the mesh
    /// and that of `domain`, along the normals of faces and up to the length of an edge.
    pub(crate) fn measure_surface_distance(&mut self, domain: &dyn Domain) {
        let mesh = TetMesh {
            nodes: std::mem::take(&mut self.nodes),
            tets: std::mem::take(&mut self.tets),
            ..TetMesh::default()
        };
        let faces = Topology::new(&mesh).boundary_triangles(&mesh);
        let stride = faces.len().div_ceil(MAX_FACES).max(1);
        let chosen: Vec<[u32; 3]> = faces.into_iter().step_by(stride).collect();
        let of_faces = parallel::collect(chosen.len(), |range, found| {
            let domain = OffsetDomain { domain, added: &[] };
            let mut sampler = Sampler::new(domain);
            for face in &chosen[range] {
                let corners = face.map(|v| mesh.nodes[v as usize]);
                found.push(of_face(&mut sampler, corners));
            }
        });
        let area: f64 = of_faces.iter().map(|[area, ..]| area).sum();
        let squares: f64 = of_faces.iter().map(|[area, square, _]| area * square).sum();
        let largest = of_faces
            .iter()
            .fold(0.0, |max: f64, [.., most]| max.max(*most));
        self.report.surface_distance = (area > 0.0).then(|| [(squares / area).sqrt(), largest]);
        (self.nodes, self.tets) = (mesh.nodes, mesh.tets);
    }
}

/// Returns the area of a face, the mean square of its distances, and the largest.
fn of_face(sampler: &mut Sampler<'_>, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let cross = (b - a).cross(c - a);
    let normal = cross.normalize_or_zero();
    let reach = ((b - a).length() + (c - b).length() + (a - c).length()) / 3.0;
    let distances =
        POINTS.map(|[x, y, z]| distance(sampler, x * a + y * b + z * c, normal * reach));
    let distances = distances.map(|share| share * reach);
    let squares: f64 = distances.iter().map(|d| d * d).sum();
    let largest = distances.into_iter().fold(0.0, f64::max);
    [0.5 * cross.length(), squares / POINTS.len() as f64, largest]
}

/// Returns how much of `way` lies between the point `p` of the boundary of a mesh and the boundary of
/// the domain: outwards from a point in the domain, inwards from another; at most 1.
fn distance(sampler: &mut Sampler<'_>, p: DVec3, way: DVec3) -> f64 {
    let is_inside = sampler.region(p) != 0;
    let way = if is_inside { way } else { -way };
    let mut has_crossed = |t: f64| (sampler.region(p + t * way) != 0) != is_inside;
    let step = 1.0 / f64::from(STEPS);
    let Some(end) = (1..=STEPS)
        .map(|k| f64::from(k) * step)
        .find(|t| has_crossed(*t))
    else {
        return 1.0;
    };
    let (mut low, mut high) = (end - step, end);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        match has_crossed(middle) {
            true => high = middle,
            false => low = middle,
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::mesher::{Domain, MeshOptions, Spacing, mesh_domain};
    use crate::progress::no_progress;
    use glam::DVec3;

    struct Ball;

    impl Domain for Ball {
        fn bounds(&self) -> (DVec3, DVec3) {
            (DVec3::splat(-1.0), DVec3::splat(1.0))
        }

        fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
            weights.clear();
            weights.push((1, 1.0 - p.length()));
        }
    }

    /// Returns the root mean square and the largest distance of a ball meshed with an edge length, and
    /// those of its faces from the sphere.
    fn of_ball(edge: f64) -> [[f64; 2]; 2] {
        let options = MeshOptions {
            spacing: Spacing::Edge(edge),
            grading: 1.0,
            ..MeshOptions::default()
        };
        let mesh = mesh_domain(&Ball, &options, &no_progress).unwrap();
        let radii = mesh.nodes.iter().map(|p| p.length());
        let furthest = radii.fold(0.0, f64::max);
        assert!((furthest - 1.0).abs() < 1e-3, "{furthest}");
        let found = mesh.report.surface_distance.unwrap();
        let corners = |tet: &[u32; 4]| tet.map(|v| mesh.nodes[v as usize]);
        // A face of the boundary: three corners on the sphere.
        let mut most: f64 = 0.0;
        let mut sums = [0.0; 2];
        for tet in &mesh.tets {
            let all = corners(tet);
            for k in 0..4 {
                let face: Vec<DVec3> = (0..4).filter(|i| *i != k).map(|i| all[i]).collect();
                if face.iter().all(|p| (p.length() - 1.0).abs() < 1e-3) && all[k].length() < 0.999 {
                    let area = (face[1] - face[0]).cross(face[2] - face[0]).length();
                    let depth = |p: DVec3| 1.0 - p.length();
                    let points = [
                        depth((face[0] + face[1]) / 2.0),
                        depth((face[1] + face[2]) / 2.0),
                        depth((face[0] + face[2]) / 2.0),
                        depth((face[0] + face[1] + face[2]) / 3.0),
                    ];
                    most = points.into_iter().fold(most, f64::max);
                    sums[0] += area;
                    sums[1] += area * points.iter().map(|d| d * d).sum::<f64>() / 4.0;
                }
            }
        }
        [found, [(sums[1] / sums[0]).sqrt(), most]]
    }

    #[test]
    fn distance_of_ball_is_that_of_its_faces_from_the_sphere() {
        let [coarse, expected] = of_ball(0.5);
        for (found, expected) in coarse.iter().zip(&expected) {
            assert!(
                (found / expected - 1.0).abs() < 0.05,
                "{coarse:?} {expected:?}"
            );
        }
        // The faces of half the size are a quarter as far off.
        let [fine, _] = of_ball(0.25);
        let ratio = coarse[0] / fine[0];
        assert!((3.0..5.0).contains(&ratio), "{coarse:?} {fine:?}");
    }
}
