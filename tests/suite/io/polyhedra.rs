//! Polyhedra are split into tets that conform to the cells beside them.

use crate::io::sample::Bench;
use crate::support::real_data;
use palpate::io;
use palpate::mesh::{TetMesh, Topology};

/// The nodes of a block of 2 × 1 × 1 cubes, x running fastest.
const BLOCK: &str = "0 0 0 1 0 0 2 0 0 0 1 0 1 1 0 2 1 0 0 0 1 1 0 1 2 0 1 0 1 1 1 1 1 2 1 1";

/// Faces of the first cube, with mixed orientations.
const CUBE: [&[usize]; 6] = [
    &[0, 3, 4, 1],
    &[6, 7, 10, 9],
    &[0, 1, 7, 6],
    &[1, 4, 10, 7],
    &[4, 3, 9, 10],
    &[3, 0, 6, 9],
];

/// Returns a `.vtu` with a polyhedron of these faces (of VTK up to 9.3), followed by `others`: type
/// and nodes.
fn vtu(nodes: &str, faces: &[&[usize]], others: &[(u8, &[usize])]) -> String {
    let join = |all: &[usize]| {
        all.iter()
            .map(usize::to_string)
            .collect::<Vec<_>>()
            .join(" ")
    };
    let mut corners: Vec<usize> = faces.concat();
    corners.sort_unstable();
    corners.dedup();
    let mut stream = vec![faces.len()];
    for face in faces {
        stream.push(face.len());
        stream.extend(*face);
    }
    let mut connectivity = corners.clone();
    let mut offsets = vec![corners.len()];
    let mut types = vec![42];
    for (kind, own) in others {
        connectivity.extend(*own);
        offsets.push(connectivity.len());
        types.push(usize::from(*kind));
    }
    let face_ends = format!("{}{}", stream.len(), " -1".repeat(others.len()));
    let array = |name: &str, values: &str| {
        format!("<DataArray type=\"Int64\" Name=\"{name}\" format=\"ascii\">{values}</DataArray>")
    };
    let count = nodes.split_whitespace().count() / 3;
    let field: Vec<usize> = (0..count).collect();
    format!(
        "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"{count}\" NumberOfCells=\"{}\"><PointData><DataArray type=\"Float64\" Name=\"n\">{}</DataArray></PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\">{nodes}</DataArray></Points><Cells>{}{}{}{}{}</Cells></Piece></UnstructuredGrid></VTKFile>",
        types.len(),
        join(&field),
        array("connectivity", &join(&connectivity)),
        array("offsets", &join(&offsets)),
        array("types", &join(&types)),
        array("faces", &join(&stream)),
        array("faceoffsets", &face_ends),
    )
}

fn read(text: &str) -> TetMesh {
    Bench::new().read("a.vtu", text.as_bytes()).unwrap()
}

fn noted(mesh: &TetMesh, what: &str) -> bool {
    mesh.repairs.warnings.iter().any(|w| w.contains(what))
}

/// The boundary of a block of two cubes that conform has 10 squares.
fn assert_is_block(mesh: &TetMesh) {
    assert!((mesh.volume() - 2.0).abs() < 1e-12, "{}", mesh.volume());
    assert_eq!(Topology::new(mesh).boundary.len(), 20);
    assert_eq!(mesh.repairs.inverted_fixed, 0);
    assert!(noted(mesh, "1 polyhedron"), "{:?}", mesh.repairs.warnings);
}

#[test]
fn polyhedron_conforms_to_hexahedron_beside_it() {
    let mesh = read(&vtu(BLOCK, &CUBE, &[(12, &[1, 2, 5, 4, 7, 8, 11, 10])]));
    assert_is_block(&mesh);
    if let Some(path) = real_data("cases/19_polyhedron_and_hex.vtu") {
        assert_is_block(&io::read(path).unwrap());
    }
}

#[test]
fn legacy_polyhedron_reads_by_its_faces() {
    let faces: Vec<String> = CUBE
        .iter()
        .map(|face| {
            let nodes: Vec<String> = face.iter().map(usize::to_string).collect();
            format!("{} {}", face.len(), nodes.join(" "))
        })
        .collect();
    let text = format!(
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 12 double\n{BLOCK}\nCELLS 2 41\n31 6 {}\n8 1 2 5 4 7 8 11 10\nCELL_TYPES 2\n42 12\n",
        faces.join(" ")
    );
    assert_is_block(&Bench::new().read("a.vtk", text.as_bytes()).unwrap());
}

#[test]
fn concave_polyhedron_gets_a_node_that_sees_its_faces() {
    // A prism over an L, whose smallest node does not see the faces beyond the notch.
    let outline = [[2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [0, 0]];
    let nodes: Vec<String> = [0, 1]
        .iter()
        .flat_map(|z| outline.map(|[x, y]| format!("{x} {y} {z}")))
        .collect();
    let faces: Vec<Vec<usize>> = (0..6)
        .map(|i| vec![i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i])
        .chain([(0..6).rev().collect(), (6..12).collect()])
        .collect();
    let faces: Vec<&[usize]> = faces.iter().map(Vec::as_slice).collect();
    let mesh = read(&vtu(&nodes.join(" "), &faces, &[]));
    assert!((mesh.volume() - 3.0).abs() < 1e-12, "{}", mesh.volume());
    assert_eq!(mesh.repairs.inverted_fixed, 0);
    assert_eq!(mesh.nodes.len(), 13);
    assert!(noted(&mesh, "got a node at its centre"));
    // The mean of the numbers 0 to 11.
    let field = &mesh.fields[0].values;
    assert!((field[12] - 5.5).abs() < 1e-12, "{field:?}");
}

#[test]
fn open_polyhedron_is_dropped_with_a_note() {
    let mesh = read(&vtu(
        BLOCK,
        &CUBE[1..],
        &[(12, &[1, 2, 5, 4, 7, 8, 11, 10])],
    ));
    assert!((mesh.volume() - 1.0).abs() < 1e-12);
    assert!(
        noted(&mesh, "1 polyhedron dropped"),
        "{:?}",
        mesh.repairs.warnings
    );
}

#[test]
fn polyhedron_with_invalid_faces_is_an_error() {
    let text = vtu(BLOCK, &CUBE, &[]).replace("6 4 0 3 4 1", "6 4 0 3 4 99");
    let error = Bench::new().read("a.vtu", text.as_bytes()).unwrap_err();
    assert!(error.to_string().contains("refers to node 99"), "{error}");
}
