//! Topology of random meshes.

use crate::mesh::support::check_topology;
use glam::DVec3;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::{Field, Location, TetMesh, Topology, components};
use proptest::prelude::*;

/// Returns a box with jittered nodes and some missing tets, with tets and corners in random order.
fn ragged() -> impl Strategy<Value = TetMesh> {
    let cells = (1..4usize, 1..4usize, 1..4usize);
    (cells, any::<bool>(), any::<u64>(), 0.0..0.9).prop_map(|((x, y, z), six, seed, missing)| {
        let split = if six { Split::Six } else { Split::Five };
        let mut mesh = box_mesh([x, y, z], DVec3::new(1.0, 2.0, 0.5), split).unwrap();
        let mut state = seed | 1;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for p in &mut mesh.nodes {
            *p += 0.02 * (DVec3::new(random(), random(), random()) - 0.5);
        }
        let mut tets: Vec<[u32; 4]> = mesh
            .tets
            .into_iter()
            .filter(|_| random() >= missing)
            .collect();
        for i in (1..tets.len()).rev() {
            tets.swap(i, (random() * (i + 1) as f64) as usize);
        }
        for tet in &mut tets {
            for i in (1..4).rev() {
                tet.swap(i, (random() * (i + 1) as f64) as usize);
            }
        }
        if tets.is_empty() {
            tets.push([0, 1, 2 + x as u32, 1 + (x as u32 + 1) * (y as u32 + 1)]);
        }
        let id = Field::scalar(
            "id",
            Location::Cell,
            (0..tets.len()).map(|i| i as f64).collect(),
        );
        TetMesh::new(mesh.nodes, tets, vec![id], vec![]).unwrap()
    })
}

proptest! {
    #[test]
    fn neighbours_boundary_and_volumes_are_consistent(mesh in ragged()) {
        let topology = check_topology(&mesh);
        let inner = topology.neighbours.iter().flatten().filter(|n| **n != u32::MAX).count();
        prop_assert_eq!(inner + topology.boundary.len(), 4 * mesh.tets.len());
        let (piece, pieces) = components(&topology);
        prop_assert_eq!(piece.iter().max().map(|p| *p as usize + 1), Some(pieces));
        for (t, neighbours) in topology.neighbours.iter().enumerate() {
            for n in neighbours.iter().filter(|n| **n != u32::MAX) {
                prop_assert_eq!(piece[t], piece[*n as usize / 4]);
            }
        }
    }

    #[test]
    fn mesh_edges_match_tet_edges(mesh in ragged()) {
        let mut expected = std::collections::BTreeSet::new();
        for tet in &mesh.tets {
            for a in tet {
                expected.extend(tet.iter().filter(|b| a < b).map(|b| [*a, *b]));
            }
        }
        prop_assert_eq!(mesh.edges(), expected.into_iter().collect::<Vec<_>>());
    }
}

#[test]
fn components_are_connected_through_faces_only() {
    // In a 5-tet cell without its central tet, the four corner tets touch along edges only.
    let mesh = box_mesh([1, 1, 1], DVec3::ONE, Split::Five).unwrap();
    let corners =
        TetMesh::new(mesh.nodes.clone(), mesh.tets[1..].to_vec(), vec![], vec![]).unwrap();
    assert_eq!(components(&Topology::new(&mesh)).1, 1);
    assert_eq!(components(&Topology::new(&corners)).1, 4);
}

#[test]
fn topology_is_built_without_nodes() {
    // Two tets with a common face whose nodes have large indices.
    let far = u32::MAX - 1;
    let mesh = TetMesh {
        tets: vec![[far, 7, 8, 9], [0, 8, 7, 9]],
        ..TetMesh::default()
    };
    let topology = Topology::new(&mesh);
    assert_eq!(topology.neighbours[0], [4, u32::MAX, u32::MAX, u32::MAX]);
    assert_eq!(topology.neighbours[1], [0, u32::MAX, u32::MAX, u32::MAX]);
    assert_eq!(topology.boundary.len(), 6);
}
