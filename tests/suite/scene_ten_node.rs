//! Scenes whose mesh file has ten-node tets.

use crate::support::gpu;
use glam::DVec3;
use palpate::io;
use palpate::mesh::{ElementOrder, MeshDescription, TetMesh};
use palpate::scene::{Scene, Stage};
use std::path::Path;

/// A thick half ring of ten-node tets with curved edges, its nodes in reverse; divided into pieces as
/// while its edges were straight.
fn moved_ring() -> TetMesh {
    let bar = palpate::generate::bar([6, 2, 1], DVec3::new(0.3, 0.03, 0.02)).unwrap();
    let mut mesh = bar.with_mid_edge_nodes().unwrap();
    for p in &mut mesh.nodes {
        let (angle, radius) = (std::f64::consts::PI * p.x / 0.3, 0.08 + p.y);
        *p = DVec3::new(-radius * angle.cos(), radius * angle.sin(), p.z);
    }
    let last = mesh.nodes.len() as u32 - 1;
    mesh.nodes.reverse();
    mesh.tets.iter_mut().flatten().for_each(|v| *v = last - *v);
    mesh.length_unit = Some(1.0);
    mesh
}

/// The ring, divided into pieces by its curved shape.
fn half_ring() -> TetMesh {
    let mesh = moved_ring();
    let elements = mesh.ten_node_tets().unwrap();
    let made = TetMesh::from_ten_node_tets(mesh.nodes.clone(), &elements, Vec::new(), Vec::new());
    let ring = TetMesh {
        length_unit: mesh.length_unit,
        ..made.unwrap()
    };
    assert_eq!(ring.nodes, mesh.nodes);
    assert_eq!(ring.ten_node_tets().unwrap(), elements);
    ring
}

fn scene(file: &Path, order: &str) -> Scene {
    let text = format!(
        "[mesh]\nfile = {file:?}\n[material]\nmodel = \"neo-hookean\"\n{order}\nyoung = 2e4\ndensity = 1000\n[solver]\nname = \"implicit\"\ndt = 0.02\nengine = \"cpu\"\nsleep = false\ngravity = [0, 0, -9.81]\n[[pin]]\naxis = \"x\"\nbelow = 0.1\n[picture]\nsize = [48, 36]\n"
    );
    Scene::parse(&text).unwrap()
}

fn positions(stage: &mut Stage, steps: u32) -> Vec<DVec3> {
    stage.run(steps, &mut |_| {}).unwrap();
    stage.motion().unwrap().positions().unwrap()
}

#[test]
fn order_2_simulates_the_curved_tets_of_the_file() {
    let (folder, mesh) = (tempfile::tempdir().unwrap(), half_ring());
    for name in ["ring.vtu", "ring.vtk", "ring.msh", "ring.mesh"] {
        let file = folder.path().join(name);
        io::write(&file, &mesh).unwrap();
        let mut of_file = Stage::new(&gpu(), &scene(&file, "order = 2")).unwrap();
        assert_eq!(of_file.mesh().nodes, mesh.nodes, "{name}");
        let mut of_library =
            Stage::with_mesh(&gpu(), &scene(&file, "order = 2"), mesh.clone()).unwrap();
        let found = positions(&mut of_file, 5);
        assert_eq!(found, positions(&mut of_library, 5), "{name}");
        let moved = found.iter().zip(&mesh.nodes).map(|(x, p)| x.distance(*p));
        assert!(moved.fold(0.0, f64::max) > 1e-3);
        // The deformed body is written as ten-node tets, and reads back.
        let deformed = of_file.deformed_mesh().unwrap();
        assert_eq!(deformed.nodes, found);
        let out = folder.path().join("out.vtu");
        io::write(&out, &deformed).unwrap();
        let read = io::read(&out).unwrap();
        assert_eq!((read.order, &read.nodes), (ElementOrder::Quadratic, &found));
        assert_eq!(read.ten_node_tets().unwrap(), mesh.ten_node_tets().unwrap());
        assert_eq!(MeshDescription::new(&read).tets, mesh.tets.len() / 8);
    }
    // Which pieces the tets have hardly matters.
    let file = folder.path().join("ring.vtu");
    let found = positions(
        &mut Stage::new(&gpu(), &scene(&file, "order = 2")).unwrap(),
        5,
    );
    let mut other = Stage::with_mesh(&gpu(), &scene(&file, "order = 2"), moved_ring()).unwrap();
    let apart = found.iter().zip(positions(&mut other, 5));
    assert!(apart.map(|(x, y)| x.distance(y)).fold(0.0, f64::max) < 1e-4);
    // A body with straight edges is another one.
    let mut straight = mesh.clone();
    for element in mesh.ten_node_tets().unwrap() {
        for (edge, [a, b]) in palpate::mesh::TET_EDGES.into_iter().enumerate() {
            let [a, b] = [a, b].map(|k| mesh.nodes[element[k] as usize]);
            straight.nodes[element[4 + edge] as usize] = a.midpoint(b);
        }
    }
    let file = folder.path().join("ring.vtu");
    let found = positions(
        &mut Stage::new(&gpu(), &scene(&file, "order = 2")).unwrap(),
        5,
    );
    let mut other = Stage::with_mesh(&gpu(), &scene(&file, "order = 2"), straight).unwrap();
    assert_ne!(found, positions(&mut other, 5));
}

#[test]
fn order_1_simulates_the_corners_and_tells_of_order_2() {
    let (folder, mesh) = (tempfile::tempdir().unwrap(), half_ring());
    let file = folder.path().join("ring.vtu");
    io::write(&file, &mesh).unwrap();
    let mut is_corner = vec![false; mesh.nodes.len()];
    let elements = mesh.ten_node_tets().unwrap();
    for element in &elements {
        element[..4]
            .iter()
            .for_each(|v| is_corner[*v as usize] = true);
    }
    let corners: Vec<DVec3> = (0..mesh.nodes.len())
        .filter(|v| is_corner[*v])
        .map(|v| mesh.nodes[v])
        .collect();
    for order in ["", "order = 1"] {
        let mut stage = Stage::new(&gpu(), &scene(&file, order)).unwrap();
        assert_eq!(stage.mesh().nodes, corners);
        assert_eq!(stage.mesh().tets.len(), elements.len());
        let notes = stage.notes().join("\n");
        assert!(notes.contains("--order 2"), "{notes}");
        positions(&mut stage, 1);
    }
    // A picture shows the whole tets.
    let mut still = scene(&file, "");
    still.solver.name = None;
    let stage = Stage::new(&gpu(), &still).unwrap();
    assert_eq!(stage.mesh().nodes, mesh.nodes);
}

#[test]
fn folded_tets_of_a_file_are_refused_with_their_place() {
    let (folder, mut mesh) = (tempfile::tempdir().unwrap(), half_ring());
    let element = mesh.ten_node_tets().unwrap()[3];
    // The middle of an edge beyond one of its ends.
    let [a, b] = [0, 1].map(|k| mesh.nodes[element[k] as usize]);
    mesh.nodes[element[4] as usize] = a + 1.4 * (b - a);
    let file = folder.path().join("folded.vtu");
    io::write(&file, &mesh).unwrap();
    let made = Stage::new(&gpu(), &scene(&file, "order = 2")).map(|_| ());
    let message = made.unwrap_err().to_string();
    for words in ["Jacobian ≤ 0", "tet ", "order 1"] {
        assert!(message.contains(words), "{message}");
    }
    let told = MeshDescription::new(&io::read(&file).unwrap());
    assert!(told.folded_ten_node_tets > 0);
    let linear = Stage::new(&gpu(), &scene(&file, "order = 1"));
    assert!(linear.is_ok());
}

#[test]
fn ten_node_files_are_joined_with_generated_meshes() {
    let (folder, mut mesh) = (tempfile::tempdir().unwrap(), half_ring());
    mesh.length_unit = None;
    let file = folder.path().join("ring.vtu");
    io::write(&file, &mesh).unwrap();
    for (order, count) in [(2, 8), (1, 1)] {
        let text = format!(
            "[mesh]\nfile = {file:?}\n[[mesh.join]]\nname = \"box\"\ngenerate = \"box\"\ntets = 48\noffset = [0, 0, 0.5]\n[material]\nmodel = \"neo-hookean\"\norder = {order}\n[solver]\nname = \"implicit\"\n[[pin]]\naxis = \"x\"\nbelow = 0.1\n"
        );
        let scene = Scene::parse(&text).unwrap();
        let stage = Stage::new(&gpu(), &scene).unwrap();
        let tets = mesh.tets.len() / 8
            + palpate::generate::by_name("box", Some(48))
                .unwrap()
                .tets
                .len();
        assert_eq!(stage.mesh().tets.len(), count * tets);
        assert_eq!(stage.mesh().order.number(), order);
        if order == 2 {
            assert_eq!(stage.mesh().nodes[..mesh.nodes.len()], mesh.nodes[..]);
        }
    }
}
