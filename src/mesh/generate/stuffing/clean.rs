//! Leaves the part of a filling whose boundary is a manifold.

use super::Filled;
use crate::mesh::boundary::{BoundaryShape, Groups, components};
use crate::mesh::{FACES, TetMesh, Topology};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::HashMap;

/// Rounds of removing tets that meet in an edge or a point only.
const MAX_CLEANING_ROUNDS: usize = 50;

/// Keeps the largest piece of a mesh, and of tets that meet in an edge or a node only the larger
/// part, until the boundary is a manifold.
pub(super) fn keep_sound_part(nodes: Vec<DVec3>, tets: Vec<[u32; 4]>) -> Result<Filled> {
    let mut mesh = TetMesh {
        nodes,
        tets,
        ..TetMesh::default()
    };
    for _ in 0..MAX_CLEANING_ROUNDS {
        let topology = Topology::new(&mesh);
        let (piece, pieces) = components(&topology);
        let shape = BoundaryShape::new(&mesh, &topology);
        let mut keep = vec![true; mesh.tets.len()];
        if pieces > 1 {
            let mut sizes = vec![0usize; pieces];
            for p in &piece {
                sizes[*p as usize] += 1;
            }
            let largest = (0..pieces).max_by_key(|p| (sizes[*p], pieces - p));
            for (keep, p) in keep.iter_mut().zip(&piece) {
                *keep = Some(*p as usize) == largest;
            }
        } else if !shape.is_vertex_manifold() {
            drop_loose_fans(&mesh, &shape, &mut keep);
        } else {
            return Ok(without_unused_nodes(mesh));
        }
        let mut flag = keep.iter();
        mesh.tets.retain(|_| flag.next().copied().unwrap_or(true));
        if mesh.tets.is_empty() {
            break;
        }
    }
    Err(Error::Input(
        "the shape is too thin for this resolution: no sound mesh is left of it; ask for more tets"
            .into(),
    ))
}

fn without_unused_nodes(mut mesh: TetMesh) -> Filled {
    let mut new_index = vec![u32::MAX; mesh.nodes.len()];
    for v in mesh.tets.iter().flatten() {
        new_index[*v as usize] = 0;
    }
    let mut nodes = Vec::with_capacity(mesh.nodes.len());
    for (index, node) in new_index.iter_mut().zip(&mesh.nodes).filter(|n| *n.0 == 0) {
        *index = nodes.len() as u32;
        nodes.push(*node);
    }
    for v in mesh.tets.iter_mut().flatten() {
        *v = new_index[*v as usize];
    }
    Filled {
        nodes,
        tets: mesh.tets,
    }
}

/// Unsets the flag of every tet at an odd node that is not face-connected, around that node, to
/// most others there (all of them where the tets form a ring around a tunnel).
fn drop_loose_fans(mesh: &TetMesh, shape: &BoundaryShape, keep: &mut [bool]) {
    let mut odd: HashMap<u32, Vec<u32>> = HashMap::new();
    let ends = shape.odd_edges.iter().flatten();
    for node in shape.odd_nodes.iter().chain(ends) {
        odd.insert(*node, Vec::new());
    }
    for (t, tet) in mesh.tets.iter().enumerate() {
        for v in tet {
            if let Some(around) = odd.get_mut(v) {
                around.push(t as u32);
            }
        }
    }
    for (node, around) in odd {
        let mut groups = Groups::new(around.len());
        let mut first_with: HashMap<[u32; 3], u32> = HashMap::new();
        for (n, t) in around.iter().enumerate() {
            let tet = mesh.tets[*t as usize];
            for face in FACES.map(|f| f.map(|i| tet[i])).iter_mut() {
                face.sort_unstable();
                if face.contains(&node) {
                    let other = *first_with.entry(*face).or_insert(n as u32);
                    groups.join(other, n as u32);
                }
            }
        }
        let group: Vec<u32> = (0..around.len() as u32)
            .map(|n| groups.representative(n))
            .collect();
        let size = |g: u32| group.iter().filter(|h| **h == g).count();
        let largest = group
            .iter()
            .copied()
            .max_by_key(|g| (size(*g), u32::MAX - g));
        let ring = largest.is_some_and(|g| size(g) == group.len());
        for (g, t) in group.iter().zip(&around) {
            if ring || Some(*g) != largest {
                keep[*t as usize] = false;
            }
        }
    }
}
