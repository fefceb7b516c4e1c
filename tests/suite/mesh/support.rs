//! Invariants of all meshes.

use palpate::mesh::{NO_NEIGHBOUR, TetMesh, Topology};
use palpate::physics::{DiscreteModel, Material, MaterialModel};
use std::collections::{BTreeSet, HashMap};

/// Returns the number of nodes of each rigid body formed by the tets of `labels`.
pub fn rigid_pieces(mesh: &TetMesh, labels: BTreeSet<i64>) -> Vec<usize> {
    let material = Material {
        model: MaterialModel::NeoHookean,
        region_field: Some("label".into()),
        rigid: labels,
        ..Material::from_young(1e5)
    };
    let discrete_model = DiscreteModel::new(mesh, &material).unwrap();
    let bodies = discrete_model.rigid_bodies().iter();
    bodies.map(|b| b.nodes.len()).collect()
}

/// Returns the volume enclosed by the boundary, by the divergence theorem.
pub fn enclosed_volume(mesh: &TetMesh, topology: &Topology) -> f64 {
    let origin = mesh.bounds().0;
    topology
        .boundary
        .iter()
        .map(|b| {
            let [a, b, c] = topology
                .boundary_nodes(mesh, *b)
                .map(|v| mesh.nodes[v as usize] - origin);
            a.cross(b).dot(c) / 6.0
        })
        .sum()
}

/// Checks the invariants of every mesh of [`TetMesh::new`], with or without non-manifold boundary
/// edges.
pub fn check_topology(mesh: &TetMesh) -> Topology {
    let topology = Topology::new(mesh);
    for (t, neighbours) in topology.neighbours.iter().enumerate() {
        for (f, &n) in neighbours
            .iter()
            .enumerate()
            .filter(|n| *n.1 != NO_NEIGHBOUR)
        {
            let back = topology.neighbours[n as usize / 4][n as usize % 4];
            assert_eq!(back, (4 * t + f) as u32, "neighbour of neighbour is itself");
        }
    }
    let mut balance: HashMap<(u32, u32), i32> = HashMap::new();
    for b in &topology.boundary {
        let v = topology.boundary_nodes(mesh, *b);
        for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
            let sign = if a < b { 1 } else { -1 };
            *balance.entry((a.min(b), a.max(b))).or_default() += sign;
        }
    }
    assert!(
        balance.values().all(|n| *n == 0),
        "every boundary edge is run through as often one way as the other"
    );
    assert!(
        mesh.tets
            .iter()
            .enumerate()
            .all(|(t, _)| mesh.tet_volume(t) > 0.0)
    );
    let (sum, enclosed) = (mesh.volume(), enclosed_volume(mesh, &topology));
    assert!(
        (sum - enclosed).abs() <= 1e-9 * sum,
        "the tets hold {sum}, the boundary encloses {enclosed}"
    );
    topology
}

/// Checks a generated mesh: no repairs, valid topology; returns the Euler number of its boundary,
/// each edge of which must belong to exactly two faces.
pub fn check_generated(mesh: &TetMesh) -> i64 {
    assert_eq!(mesh.repairs, Default::default(), "nothing to repair");
    let topology = check_topology(mesh);
    let mut edges: HashMap<(u32, u32), usize> = HashMap::new();
    let mut nodes = std::collections::HashSet::new();
    for b in &topology.boundary {
        let v = topology.boundary_nodes(mesh, *b);
        nodes.extend(v);
        for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
            *edges.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    assert!(edges.values().all(|n| *n == 2), "edge-manifold boundary");
    nodes.len() as i64 - edges.len() as i64 + topology.boundary.len() as i64
}
