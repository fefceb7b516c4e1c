//! Invalid meshes: repairs, counts, and rejected input.

use crate::mesh::support::check_topology;
use glam::DVec3;
use palpate::Error;
use palpate::generate::{Split, box_mesh};
use palpate::mesh::{Field, Location, TetMesh};

fn cube() -> TetMesh {
    box_mesh([2, 2, 2], DVec3::ONE, Split::Six).unwrap()
}

fn remade(mesh: TetMesh) -> palpate::Result<TetMesh> {
    TetMesh::new(mesh.nodes, mesh.tets, mesh.fields, vec![])
}

#[test]
fn inverted_tets_are_flipped_and_counted() {
    let mut mesh = cube();
    for tet in mesh.tets.iter_mut().step_by(3) {
        tet.swap(0, 1);
    }
    let mesh = remade(mesh).unwrap();
    assert_eq!(mesh.repairs.inverted_fixed, 16);
    assert_eq!(mesh.repairs.warnings.len(), 1);
    assert!((mesh.volume() - 1.0).abs() < 1e-12);
    check_topology(&mesh);
}

#[test]
fn duplicate_and_degenerate_tets_are_dropped_with_their_values() {
    let mut mesh = cube();
    let [a, b, c, d] = mesh.tets[5];
    // The lowest layer of nodes is flat: four of its nodes span no volume.
    mesh.tets.insert(7, [d, b, a, c]);
    mesh.tets.insert(9, [0, 1, 3, 4]);
    mesh.tets.insert(0, [a, b, a, d]);
    let label = (0..mesh.tets.len()).map(|t| t as f64).collect();
    mesh.set_field(Field::scalar("label", Location::Cell, label))
        .unwrap();
    let mesh = remade(mesh).unwrap();
    assert_eq!((mesh.repairs.repeated, mesh.repairs.degenerate), (1, 2));
    assert_eq!(mesh.repairs.warnings.len(), 2);
    let label = &mesh.field("label", Location::Cell).unwrap().values;
    let expected: Vec<f64> = (0..51)
        .filter(|t| ![0, 8, 10].contains(t))
        .map(f64::from)
        .collect();
    assert_eq!(*label, expected);
    check_topology(&mesh);
}

#[test]
fn unused_nodes_are_dropped_with_their_values() {
    let mut mesh = cube();
    mesh.nodes.insert(4, DVec3::NAN);
    mesh.nodes.push(DVec3::splat(1e9));
    for v in mesh.tets.iter_mut().flatten() {
        *v += u32::from(*v >= 4);
    }
    let place: Vec<f64> = mesh.nodes.iter().flat_map(|p| p.to_array()).collect();
    let mut field = Field::scalar("place", Location::Node, place);
    field.components = 3;
    mesh.set_field(field).unwrap();
    let mesh = remade(mesh).unwrap();
    assert_eq!((mesh.repairs.unused_nodes, mesh.nodes.len()), (2, 27));
    let place = &mesh.field("place", Location::Node).unwrap().values;
    let nodes: Vec<f64> = mesh.nodes.iter().flat_map(|p| p.to_array()).collect();
    assert_eq!(*place, nodes);
    check_topology(&mesh);
}

#[test]
fn faces_shared_by_three_tets_are_boundary() {
    let mut mesh = cube();
    let [a, b, c, _] = mesh.tets[0];
    let apex = mesh.nodes.len() as u32;
    mesh.nodes.push(DVec3::new(5.0, 4.0, 3.0));
    // Face abc of tet 0 may be boundary; it is shared by two more tets.
    mesh.nodes.push(DVec3::new(-5.0, 4.0, -3.0));
    mesh.tets.extend([[a, b, c, apex], [a, b, c, apex + 1]]);
    let mesh = remade(mesh).unwrap();
    assert_eq!(mesh.repairs.overshared_faces, 1);
    let topology = palpate::mesh::Topology::new(&mesh);
    let last = mesh.tets.len() - 1;
    assert_eq!(topology.neighbours[last], [u32::MAX; 4]);
}

#[test]
fn rejects_irreparable_mesh_and_names_defect() {
    let refused = |mesh: TetMesh, part: &str| match remade(mesh) {
        Err(Error::Mesh(text)) => assert!(text.contains(part), "{part} is missing in: {text}"),
        other => panic!("expected a mesh error naming {part}, got {other:?}"),
    };
    let mut mesh = cube();
    mesh.tets[3][2] = 27;
    refused(mesh, "tet 3 refers to node 27");
    let mut mesh = cube();
    mesh.tets[3][2] = u32::MAX;
    refused(mesh, "tet 3 refers to node 4294967295");
    for bad in [f64::NAN, f64::INFINITY] {
        let mut mesh = cube();
        mesh.nodes[13].y = bad;
        refused(mesh, "node 13");
    }
    let mut mesh = cube();
    mesh.tets.clear();
    refused(mesh, "no tetrahedron");
    let mut mesh = cube();
    mesh.nodes.iter_mut().for_each(|p| p.z = 0.25);
    refused(mesh, "no tetrahedron");
    let mut mesh = cube();
    mesh.fields
        .push(Field::scalar("short", Location::Node, vec![0.0; 26]));
    refused(mesh, "\"short\"");
}
