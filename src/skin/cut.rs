//! Updates skins after a cut of their body.

use super::base::SkinBase;
use super::binder::{Binder, BindingSite, Vertex};
use super::binding::{BaseMesh, Mapping, vertex_texels};
use super::draw::Skin;
use crate::mesh::Blade;
use crate::parallel;
use crate::skin::basis::VertexBinding;
use crate::{Error, Result};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Changes of a skin by a cut.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SkinCut {
    /// Vertices bound again because their base triangle or its normals changed.
    pub rebound_vertices: usize,
    /// Triangles across the cut, which are hidden.
    pub hidden: usize,
    /// Base triangles that did not exist before the first cut: the walls of this cut and of earlier
    /// ones, in nodes of the new base. [`Skin::body_surface`] draws them.
    pub walls: Vec<[u32; 3]>,
}

/// Rest positions of a triangle's corners as bits, independent of their order.
pub(super) type TriangleKey = [[u64; 3]; 3];

impl Skin {
    /// Applies a cut of the body by `blade` (file units, current state) and switches to `carrier`,
    /// created from the body after the cut. Vertices keep their base triangle if it still exists,
    /// on either side; the others are bound to the closest triangle on their side of the blade.
    /// Triangles across the cut, whose corners' base triangles are now disconnected, are hidden.
    /// Waits and reads back, as the cut itself does.
    ///
    /// # Errors
    /// [`Error::Input`] for a base with another local frame or without base triangles.
    pub fn apply_cut(&mut self, carrier: &SkinBase, blade: &Blade) -> Result<SkinCut> {
        if carrier.frame != self.carrier.frame {
            return Err(Error::Input(
                "the base after a cut must have the local frame of the skin; pass the base of the same body".into(),
            ));
        }
        // The arrays of the old base still hold the positions before the cut.
        let placed = self.skinned_vertices()?;
        let positions: Vec<[f32; 4]> = self.gpu.read_array(&carrier.positions)?;
        let place = |p: &[f32; 4]| carrier.frame.to_file(Vec3::new(p[0], p[1], p[2]));
        let nodes: Vec<DVec3> = positions.iter().map(place).collect();
        let (old, new) = (self.carrier.rest_mesh(), carrier.rest_mesh());
        let intact = self.uncut_triangles.take();
        let intact =
            intact.unwrap_or_else(|| old.triangles.iter().map(|t| key(old.nodes, *t)).collect());
        let after: HashMap<TriangleKey, [u32; 3]> = new
            .triangles
            .iter()
            .map(|t| (key(new.nodes, *t), *t))
            .collect();
        let binder = Binder::new(&new, self.mapping)?;
        // Not `self`: in a browser its device cannot be sent between threads.
        let (seats, vertices, mapping) = (&self.bound, &self.vertices, self.mapping);
        let (visible, frame) = (&self.visible, &carrier.frame);
        let follow = |v: usize| -> (VertexBinding, VertexChange) {
            let bound = seats[v];
            let vertex = Vertex::new(vertices, v, frame);
            let Some(left) = after.get(&key(old.nodes, bound.nodes)) else {
                let parted = |n: u32| blade.separates(placed[v].position, nodes[n as usize]);
                let accept = |t: [u32; 3]| !t.into_iter().any(parted);
                return (
                    binder.bind(&vertex, mapping, &accept).0,
                    VertexChange::Moved,
                );
            };
            keep_triangle(&binder, &vertex, mapping, (bound, *left), (&old, &new))
        };
        let followed = parallel::map(self.bound.len(), follow);
        let moved = FollowedVertices {
            before: seats,
            after: &followed,
            duplicates_nodes: new.nodes.len() != old.nodes.len(),
        };
        let apart = |v: u32, w: u32| {
            let (v, w) = (v as usize, w as usize);
            let separated = || blade.separates(placed[v].position, placed[w].position);
            moved.are_apart(v, w, separated)
        };
        let shown = parallel::map(visible.len(), |t| {
            let [a, b, c] = vertices.triangles[t];
            visible[t] && !(apart(a, b) || apart(b, c) || apart(c, a))
        });
        let cut = SkinCut {
            rebound_vertices: followed
                .iter()
                .filter(|f| f.1 != VertexChange::None)
                .count(),
            hidden: visible.iter().zip(&shown).filter(|(a, b)| a != b).count(),
            walls: new
                .triangles
                .iter()
                .filter(|t| !intact.contains(&key(new.nodes, **t)))
                .copied()
                .collect(),
        };
        self.uncut_triangles = Some(intact);
        self.bound = followed.into_iter().map(|f| f.0).collect();
        let records = vertex_texels(&self.bound, &self.vertices);
        self.gpu.write_array(&self.records, &records)?;
        self.carrier = carrier.clone();
        self.draws.clear();
        self.set_visible_triangles(&shown)?;
        Ok(cut)
    }
}

/// Returns the binding of a vertex whose base triangle still exists, with the nodes `left`: as
/// before, unless the normals of its nodes changed.
fn keep_triangle(
    binder: &Binder,
    vertex: &Vertex,
    mapping: Mapping,
    (bound, left): (VertexBinding, [u32; 3]),
    (old, new): (&BaseMesh, &BaseMesh),
) -> (VertexBinding, VertexChange) {
    let same = |n: u32| {
        let at = bits(old.nodes[n as usize]);
        let found = left.iter().find(|m| bits(new.nodes[**m as usize]) == at);
        found.copied().unwrap_or(n)
    };
    let seat = BindingSite {
        nodes: bound.nodes.map(same),
        weights: bound.weights,
    };
    let normal = |list: &[u32], n: u32| list[n as usize];
    let turned =
        (0..3).any(|k| normal(old.normals, bound.nodes[k]) != normal(new.normals, seat.nodes[k]));
    let nodes = seat.nodes;
    match turned && bound.interpolated && mapping != Mapping::OneToOne {
        true => {
            let smooth = binder.is_smooth(seat);
            (binder.bind_at(vertex, seat, smooth), VertexChange::Turned)
        }
        false => (VertexBinding { nodes, ..bound }, VertexChange::None),
    }
}

/// The vertices of a skin, bound before and after a cut.
struct FollowedVertices<'a> {
    before: &'a [VertexBinding],
    after: &'a [(VertexBinding, VertexChange)],
    /// Whether the cut duplicated nodes; cuts of grid bodies do not. There, edges are open if the
    /// blade separates their ends, and near the border of the blade if their vertices were bound to
    /// disjoint triangles.
    duplicates_nodes: bool,
}

impl FollowedVertices<'_> {
    /// Whether the cut parts the vertices `v` and `w` of an edge; `separated` is whether the blade
    /// passes between them.
    fn are_apart(&self, v: usize, w: usize, separated: impl Fn() -> bool) -> bool {
        let (before, after) = (self.before, self.after);
        let touch = || {
            let others = after[w].0.nodes;
            after[v].0.nodes.iter().any(|n| others.contains(n))
        };
        let moved = [v, w].iter().any(|v| after[*v].1 == VertexChange::Moved);
        let shared: Vec<(u32, u32)> = (0..9)
            .map(|k| (k / 3, k % 3))
            .filter(|(i, j)| before[v].nodes[*i] == before[w].nodes[*j])
            .map(|(i, j)| (after[v].0.nodes[i], after[w].0.nodes[j]))
            .collect();
        match !self.duplicates_nodes || moved || shared.is_empty() {
            true => (moved && !shared.is_empty() && !touch()) || separated(),
            false => shared.iter().any(|(a, b)| a != b),
        }
    }
}

/// Returns the key of a triangle of the nodes at `rest`.
fn key(rest: &[DVec3], triangle: [u32; 3]) -> TriangleKey {
    let mut key = triangle.map(|v| bits(rest[v as usize]));
    key.sort_unstable();
    key
}

/// Change of a vertex.
#[derive(Clone, Copy, PartialEq, Eq)]
enum VertexChange {
    /// Only its node indices.
    None,
    /// The normals of its nodes.
    Turned,
    /// Its base triangle.
    Moved,
}

/// Exact bits of a position; −0 is treated as 0.
fn bits(p: DVec3) -> [u64; 3] {
    (p + DVec3::ZERO).to_array().map(f64::to_bits)
}
