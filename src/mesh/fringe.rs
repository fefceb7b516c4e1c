//! Tets around a mesh, for pictures: the parts of a label volume that the mesh leaves out, because they
//! are thinner than its tets, or because its faces are chords of a curved boundary.

use super::smooth_regions::{Carriers, Divided, LabelShares, barycentric, mix_all};
use super::{Location, Topology, TriangleBvh, signed_volume};
use crate::parallel;
use glam::DVec3;

/// Height up to which a layer is looked for, relative to the mean length of the edges at a node.
const REACH: f64 = 2.0;
/// Distance of the places where it is looked for, and the height of the thinnest layer, in voxels.
const STEP: f64 = 0.25;
const THINNEST: f64 = 0.25;
/// A place is between two parts of the body if its distance from the body is below this part of its
/// height; the layer then ends half-way between them.
const BETWEEN: f64 = 0.6;
const HALF_WAY: f64 = 0.5 * (1.0 + BETWEEN);
/// Rounds in which heights at tets that would be inverted are halved; what is left then is left out.
const ROUNDS: usize = 6;
/// Least volume of a tet, relative to that of one on its base of the least height above it.
const FLATTEST: f64 = 0.02;

/// A face of the boundary, counter-clockwise seen from outside, and its tet.
type Face = ([u32; 3], u32);

impl Divided {
    /// Adds the tets of the regions `values` of a label volume just outside the mesh. Each face of the
    /// boundary becomes the base of a prism, as high at each node as the volume has labels along the
    /// normal there. The nodes above move with the tets below.
    pub(super) fn add_fringe(&mut self, volume: &LabelShares, values: &[i64]) {
        let topology = Topology::new(&self.mesh);
        let faces = topology.boundary.iter();
        let faces: Vec<Face> = faces
            .map(|b| (topology.boundary_nodes(&self.mesh, *b), b.tet))
            .collect();
        let normals = self.normals(&faces);
        let mut heights = self.heights(&faces, &normals, volume, values);
        for round in 0..=ROUNDS {
            let flat: Vec<[u32; 3]> = faces
                .iter()
                .filter(|(face, _)| self.is_flat(*face, &normals, &heights))
                .map(|(face, _)| *face)
                .collect();
            if flat.is_empty() {
                break;
            }
            let factor = if round < ROUNDS { 0.5 } else { 0.0 };
            let mut nodes = flat.into_flattened();
            nodes.sort_unstable();
            nodes.dedup();
            for v in nodes {
                heights[v as usize] *= factor;
                if heights[v as usize] < THINNEST * volume.voxel {
                    heights[v as usize] = 0.0;
                }
            }
        }
        let tops = self.add_tops(&faces, &normals, &heights);
        let mut parents = Vec::new();
        for (face, tet) in faces {
            for above in prism(face, |v| tops[v as usize]) {
                self.mesh.tets.push(above);
                self.regions.push(self.regions[tet as usize]);
                parents.push(tet as usize);
            }
        }
        for field in &mut self.mesh.fields {
            let n = field.components;
            if field.location == Location::Cell {
                for t in &parents {
                    field.values.extend_from_within(n * t..n * (t + 1));
                }
            }
        }
    }

    /// Returns the mean normal of the faces at each node, zero inside.
    fn normals(&self, faces: &[Face]) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.mesh.nodes.len()];
        for (face, _) in faces {
            let [a, b, c] = face.map(|v| self.mesh.nodes[v as usize]);
            let normal = (b - a).cross(c - a);
            face.iter().for_each(|v| normals[*v as usize] += normal);
        }
        normals.iter().map(|n| n.normalize_or_zero()).collect()
    }

    /// Returns how far the volume has labels of the mesh above each node of the boundary, in the unit of
    /// the mesh.
    fn heights(
        &self,
        faces: &[Face],
        normals: &[DVec3],
        volume: &LabelShares,
        values: &[i64],
    ) -> Vec<f64> {
        let corners = |face: &Face| face.0.map(|v| self.mesh.nodes[v as usize]);
        let tree = TriangleBvh::new(faces.iter().map(corners).collect());
        let edges = self.mean_edges();
        let is_inside = |p: DVec3| {
            let shares = (volume.shares)(p, volume.voxel);
            let known = shares.iter().filter(|s| values.binary_search(&s.0).is_ok());
            known.map(|s| s.1).sum::<f64>() >= 0.5
        };
        let step = STEP * volume.voxel;
        parallel::map(self.mesh.nodes.len(), |v| {
            let (foot, normal) = (self.mesh.nodes[v], normals[v]);
            if normal == DVec3::ZERO {
                return 0.0;
            }
            let steps = (REACH * edges[v] / step) as usize;
            let mut height = 0.0;
            for k in 1..=steps {
                let next = k as f64 * step;
                let p = foot + next * normal;
                if !is_inside(p) {
                    break;
                }
                if tree.distance(p) < BETWEEN * next {
                    height *= HALF_WAY;
                    break;
                }
                height = next;
            }
            if height < THINNEST * volume.voxel {
                0.0
            } else {
                height
            }
        })
    }

    /// Whether a tet above a face would be inverted or nearly so.
    fn is_flat(&self, face: [u32; 3], normals: &[DVec3], heights: &[f64]) -> bool {
        let at = |v: u32| self.mesh.nodes[v as usize];
        let above = |v: u32| at(v) + heights[v as usize] * normals[v as usize];
        let [a, b, c] = face.map(at);
        let area = 0.5 * (b - a).cross(c - a).length();
        let above_face = face.iter().map(|v| heights[*v as usize]);
        let least = above_face
            .filter(|h| *h > 0.0)
            .fold(f64::INFINITY, f64::min);
        // Tops are numbered after all nodes here.
        let count = self.mesh.nodes.len() as u32;
        let top = |v: u32| (heights[v as usize] > 0.0).then_some(count + v);
        prism(face, top).iter().any(|tet| {
            let x = tet.map(|v| if v < count { at(v) } else { above(v - count) });
            signed_volume(x) < FLATTEST * area * least / 3.0
        })
    }

    /// Adds the nodes above those of the boundary, and returns their numbers.
    fn add_tops(&mut self, faces: &[Face], normals: &[DVec3], heights: &[f64]) -> Vec<Option<u32>> {
        let mut best: Vec<Option<(f64, DVec3, Carriers)>> = vec![None; self.mesh.nodes.len()];
        for (face, tet) in faces {
            for v in face
                .map(|v| v as usize)
                .into_iter()
                .filter(|v| heights[*v] > 0.0)
            {
                let place = self.mesh.nodes[v] + heights[v] * normals[v];
                let Some(carried) = self.carried_by(*tet, place) else {
                    continue;
                };
                // The largest weight says how far the deformation is extrapolated.
                let reach = carried.1.iter().fold(0.0f64, |most, w| most.max(w.abs()));
                if best[v].as_ref().is_none_or(|(least, ..)| reach < *least) {
                    best[v] = Some((reach, place, carried));
                }
            }
        }
        let mut tops = vec![None; best.len()];
        for (v, best) in best.into_iter().enumerate() {
            if let Some((_, place, carried)) = best {
                tops[v] = Some(self.push(place, carried));
                self.shares.push(self.shares[v].clone());
            }
        }
        tops
    }

    /// Returns the nodes that carry a point together with a tet, inside or outside of it: those of one tet
    /// of the mesh before its division.
    fn carried_by(&self, tet: u32, place: DVec3) -> Option<Carriers> {
        let corners = self.mesh.tets[tet as usize];
        let weights = barycentric(corners.map(|v| self.mesh.nodes[v as usize]), place);
        let of: [(&Carriers, f64); 4] =
            std::array::from_fn(|k| (&self.weights[corners[k] as usize], weights[k]));
        mix_all(&of)
    }
}

/// Returns the tets of the prism over a face, counter-clockwise seen from above, whose corners have a
/// node above or not. Prisms over faces that share an edge share the diagonal above it.
fn prism(face: [u32; 3], top: impl Fn(u32) -> Option<u32>) -> Vec<[u32; 4]> {
    let first = (0..3).min_by_key(|k| face[*k]).unwrap_or(0);
    let [a, mut b, mut c] = [0, 1, 2].map(|k| face[(first + k) % 3]);
    let is_mirrored = b > c;
    if is_mirrored {
        (b, c) = (c, b);
    }
    let [on_b, on_c] = [b, c].map(|v| top(v).unwrap_or(v));
    let mut tets = Vec::with_capacity(3);
    if on_c != c {
        tets.push([a, b, c, on_c]);
    }
    if on_b != b {
        tets.push([a, b, on_c, on_b]);
    }
    if let Some(on_a) = top(a) {
        tets.push([a, on_b, on_c, on_a]);
    }
    if is_mirrored {
        tets.iter_mut().for_each(|tet| tet.swap(1, 2));
    }
    tets
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use crate::generate;
    use crate::mesh::{Field, LabelShares, Location, SmoothRegions, TetMesh, Topology};
    use glam::{DMat3, DVec3};

    const HIGH: DVec3 = DVec3::new(1.0, 0.6, 0.6);
    const VOXEL: f64 = 0.02;

    /// Boxes of region 3, and the same drawn with a volume of labels.
    fn drawn(boxes: &TetMesh, label: &(dyn Fn(DVec3) -> i64 + Sync)) -> SmoothRegions {
        let mut mesh = boxes.clone();
        let field = Field::scalar("label", Location::Cell, vec![3.0; mesh.tets.len()]);
        mesh.set_field(field).unwrap();
        // A second region, which is not drawn over.
        let last = mesh.tets.len() - 1;
        let mut field = mesh.field("label", Location::Cell).unwrap().clone();
        field.values[last] = 7.0;
        mesh.set_field(field.clone()).unwrap();
        let shares = |p: DVec3, _: f64| vec![(label(p), 1.0)];
        let volume = LabelShares {
            shares: &shares,
            voxel: VOXEL,
        };
        mesh.with_smooth_regions(&field, Some(volume)).unwrap()
    }

    fn is_within(p: DVec3, low: DVec3, high: DVec3) -> bool {
        p.cmpge(low - 1e-9).all() && p.cmple(high + 1e-9).all()
    }

    fn volume_of(mesh: &TetMesh, label: f64) -> f64 {
        let labels = &mesh.field("label", Location::Cell).unwrap().values;
        let tets = (0..mesh.tets.len()).filter(|t| labels[*t] == label);
        tets.map(|t| mesh.tet_volume(t)).sum()
    }

    /// Checks that tets are positive and closed, and that an affine motion carries all nodes.
    fn check(drawn: &SmoothRegions, of: &TetMesh) {
        let mesh = &drawn.mesh;
        assert!((0..mesh.tets.len()).all(|t| mesh.tet_volume(t) > 0.0));
        let faces = Topology::new(mesh).boundary_triangles(mesh);
        let inwards: f64 = faces
            .iter()
            .map(|f| {
                let [a, b, c] = f.map(|v| mesh.nodes[v as usize]);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        // The divergence theorem holds for a closed boundary.
        assert!((inwards / mesh.volume() - 1.0).abs() < 1e-9);
        let turn = DMat3::from_cols_array(&[1.1, 0.2, 0.0, -0.3, 0.9, 0.1, 0.0, 0.2, 1.2]);
        let moved: Vec<DVec3> = of.nodes.iter().map(|p| turn * *p + 0.3).collect();
        for (p, carried) in mesh.nodes.iter().zip(drawn.vectors(&moved)) {
            assert!(carried.distance(turn * *p + 0.3) < 1e-9);
        }
    }

    #[test]
    fn layer_that_the_mesh_leaves_out_is_drawn() {
        let mesh = generate::bar([8, 5, 5], HIGH).unwrap();
        // On a half of the upper side.
        let thickness = 0.05;
        let label = |p: DVec3| match is_within(p, DVec3::ZERO, HIGH) {
            true => 3,
            false
                if is_within(
                    p,
                    DVec3::new(0.5, 0.0, 0.6),
                    HIGH + DVec3::new(0.0, 0.0, thickness),
                ) =>
            {
                7
            }
            false => 0,
        };
        let with = drawn(&mesh, &label);
        check(&with, &mesh);
        let added = with.mesh.volume() - mesh.volume();
        let layer = 0.5 * 0.6 * thickness;
        // The rim is a slope of the width of a drawn tet.
        assert!((added / layer - 1.0).abs() < 0.3, "{added} {layer}");
        let highest = with.mesh.nodes.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!((highest - 0.6 - thickness).abs() < 0.3 * VOXEL, "{highest}");
        // The lower half of an edge between two labels has the lower one.
        assert!(volume_of(&with.mesh, 7.0) > 0.3 * layer);
        // Without the layer nothing is added.
        let bare = |p: DVec3| 3 * i64::from(is_within(p, DVec3::ZERO, HIGH));
        let without = drawn(&mesh, &bare);
        assert!((without.mesh.volume() / mesh.volume() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn layers_between_two_parts_end_half_way() {
        let low = generate::bar([8, 5, 5], HIGH).unwrap();
        let mut both = low.clone();
        let gap = DVec3::new(0.0, 0.0, 0.7);
        let count = low.nodes.len() as u32;
        both.nodes.extend(low.nodes.iter().map(|p| *p + gap));
        both.tets
            .extend(low.tets.iter().map(|t| t.map(|v| v + count)));
        let high = DVec3::new(1.0, 0.6, 1.3);
        let filled = drawn(&both, &|p| 3 * i64::from(is_within(p, DVec3::ZERO, high)));
        check(&filled, &both);
        let added = filled.mesh.volume() - both.volume();
        // All of it but slopes at its rim, and not twice, as by an overlap.
        let between = 0.1 * 0.6;
        assert!((0.6..1.1).contains(&(added / between)), "{added} {between}");
    }

    #[test]
    fn curved_layer_has_no_inverted_tets() {
        let mut mesh = generate::bar([8, 5, 5], HIGH).unwrap();
        for p in &mut mesh.nodes {
            // A bend whose inner side is narrower than the layer is high.
            let (radius, angle) = (0.08 + 0.6 - p.z, 3.0 * p.x);
            *p = DVec3::new(radius * angle.sin(), p.y, -radius * angle.cos());
        }
        let everywhere = |_: DVec3| 3;
        let with = drawn(&mesh, &everywhere);
        check(&with, &mesh);
        assert!(with.mesh.volume() > 1.2 * mesh.volume());
    }
}
