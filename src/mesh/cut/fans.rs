//! Duplication of the nodes around which opened faces separate the tets into several fans.

use crate::mesh::{BoundaryFace, DisjointSets, FACES, Location, NO_NEIGHBOUR, TetMesh, Topology};
use crate::parallel;
use std::collections::HashMap;

/// Duplicated nodes, and the tets around the opened faces.
pub(super) struct SplitNodes {
    pub duplicated: Vec<[u32; 2]>,
    pub star: Vec<u32>,
    /// Nodes of the tets of `star` before the split.
    pub before: Vec<[u32; 4]>,
}

/// Duplicates every node around which the faces `opened`, whose links have been removed, separate a
/// fan of tets into several: the fan with the tet of lowest number keeps the node. Tets in `removed`
/// are ignored.
pub(super) fn split_nodes(
    mesh: &mut TetMesh,
    topology: &Topology,
    opened: &[[BoundaryFace; 2]],
    removed: &[bool],
) -> SplitNodes {
    let mut marked = vec![false; mesh.nodes.len()];
    for [face, _] in opened {
        for v in face_nodes(mesh, *face) {
            marked[v as usize] = true;
        }
    }
    let star = parallel::collect(mesh.tets.len(), |range, star| {
        let is_marked = |t: &usize| mesh.tets[*t].iter().any(|v| marked[*v as usize]);
        star.extend(range.filter(is_marked).map(|t| t as u32));
    });
    let before: Vec<[u32; 4]> = star.iter().map(|t| mesh.tets[*t as usize]).collect();
    let [mut after, mut whole] = join_corners(mesh, topology, opened, (&marked, &star));
    let mut fans: Vec<[u32; 3]> = Vec::new();
    for (s, tet) in before.iter().enumerate() {
        if removed.get(star[s] as usize) == Some(&true) {
            continue;
        }
        for (i, v) in tet.iter().enumerate().filter(|(_, v)| marked[**v as usize]) {
            let corner = (4 * s + i) as u32;
            fans.push([*v, whole.find(corner), after.find(corner)]);
        }
    }
    let corners = fans.clone();
    fans.sort_unstable();
    fans.dedup();
    let mut doubled = Vec::new();
    let mut name: HashMap<u32, u32> = HashMap::new();
    for same in fans.chunk_by(|a, b| a[..2] == b[..2]) {
        for [old, _, fan] in &same[1..] {
            let new = (mesh.nodes.len() + doubled.len()) as u32;
            name.insert(*fan, new);
            doubled.push([new, *old]);
        }
    }
    let mut fan_of = corners.iter();
    for (s, tet) in before.iter().enumerate() {
        if removed.get(star[s] as usize) == Some(&true) {
            continue;
        }
        for (i, _) in tet.iter().enumerate().filter(|(_, v)| marked[**v as usize]) {
            if let Some(new) = fan_of.next().and_then(|[_, _, fan]| name.get(fan)) {
                mesh.tets[star[s] as usize][i] = *new;
            }
        }
    }
    for [_, old] in &doubled {
        duplicate_node(mesh, *old);
    }
    SplitNodes {
        duplicated: doubled,
        star,
        before,
    }
}

/// Groups the corners of the tets of `star` that meet in a node of `marked`: as they are joined
/// after the faces `opened` are, and as they were before. Corner i of the s-th tet is item 4 s + i.
fn join_corners(
    mesh: &TetMesh,
    topology: &Topology,
    opened: &[[BoundaryFace; 2]],
    (marked, star): (&[bool], &[u32]),
) -> [DisjointSets; 2] {
    // One plus the index of each tet in the star; 0 for other tets.
    let mut place = vec![0u32; mesh.tets.len()];
    for (t, s) in star.iter().zip(1..) {
        place[*t as usize] = s;
    }
    let join = |groups: &mut DisjointSets, here: BoundaryFace, other: u32| {
        let (s, o) = (place[here.tet as usize], place[other as usize]);
        if s == 0 || o == 0 {
            return;
        }
        for v in face_nodes(mesh, here) {
            let corner = |s: u32| {
                let i = mesh.tets[star[s as usize] as usize]
                    .iter()
                    .position(|w| *w == v);
                i.map(|i| 4 * s + i as u32)
            };
            if let (true, Some(a), Some(b)) = (marked[v as usize], corner(s - 1), corner(o - 1)) {
                groups.union(a, b);
            }
        }
    };
    let mut after = DisjointSets::new(4 * star.len());
    let mut whole = DisjointSets::new(4 * star.len());
    for tet in star {
        for (face, code) in (0..).zip(topology.neighbours[*tet as usize]) {
            if code != NO_NEIGHBOUR && code / 4 > *tet {
                let here = BoundaryFace { tet: *tet, face };
                join(&mut after, here, code / 4);
                join(&mut whole, here, code / 4);
            }
        }
    }
    for [here, there] in opened {
        join(&mut whole, *here, there.tet);
    }
    [after, whole]
}

/// Adds a copy of a node with its fields.
fn duplicate_node(mesh: &mut TetMesh, node: u32) {
    mesh.nodes.push(mesh.nodes[node as usize]);
    for field in &mut mesh.fields {
        if field.location == Location::Node {
            let at = node as usize * field.components;
            field.values.extend_from_within(at..at + field.components);
        }
    }
}

fn face_nodes(mesh: &TetMesh, face: BoundaryFace) -> [u32; 3] {
    FACES[face.face as usize].map(|i| mesh.tets[face.tet as usize][i])
}

pub(super) fn sorted_face(mesh: &TetMesh, face: BoundaryFace) -> [u32; 3] {
    let mut nodes = face_nodes(mesh, face);
    nodes.sort_unstable();
    nodes
}
