//! Pieces and parts of one mesh: in one file, in an index, in a series.

use crate::io::sample::Bench;
use crate::support::real_data;
use palpate::io;
use palpate::mesh::{TetMesh, Topology};

/// A piece of one tet on the side of x = 0 given by `x`, with `data` of its nodes.
fn piece(x: i32, data: &str) -> String {
    let [a, b] = if x < 0 { [1, 2] } else { [2, 1] };
    format!(
        "<Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><PointData>{data}</PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\">0 0 0 0 1 0 0 0 1 {x} 0 0</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\">0 {b} {a} 3</DataArray><DataArray type=\"Int32\" Name=\"offsets\">4</DataArray><DataArray type=\"UInt8\" Name=\"types\">10</DataArray></Cells></Piece>"
    )
}

const EMPTY: &str = "<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"><PointData></PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\"></DataArray></Points><Cells></Cells></Piece>";

fn file(pieces: &str) -> String {
    format!(
        "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid>{pieces}</UnstructuredGrid></VTKFile>"
    )
}

fn warm(values: &str) -> String {
    format!("<DataArray type=\"Float64\" Name=\"warm\">{values}</DataArray>")
}

/// Whether the mesh is the two tets, joined at a face, with the field.
fn assert_joined(mesh: &TetMesh) {
    assert_eq!((mesh.nodes.len(), mesh.tets.len()), (5, 2));
    assert_eq!(Topology::new(mesh).boundary.len(), 6);
    assert_eq!(mesh.fields.len(), 1, "{:?}", mesh.repairs.warnings);
    assert_eq!(mesh.fields[0].values, [1.0, 2.0, 3.0, 4.0, 5.0]);
}

#[test]
fn pieces_of_one_file_are_joined() {
    let [one, two] = [piece(-1, &warm("1 2 3 4")), piece(1, &warm("1 2 3 5"))];
    let bench = Bench::new();
    let mesh = bench
        .read("a.vtu", file(&format!("{one}{EMPTY}{two}")).as_bytes())
        .unwrap();
    assert_joined(&mesh);
    let note = "3 pieces joined at 3 nodes";
    assert!(
        mesh.repairs.warnings.iter().any(|w| w.contains(note)),
        "{:?}",
        mesh.repairs.warnings
    );
    // A field of one piece alone is left out, and said.
    let other = file(&format!("{one}{}", piece(1, "")));
    let mesh = bench.read("a.vtu", other.as_bytes()).unwrap();
    assert!(mesh.fields.is_empty());
    assert!(
        mesh.repairs
            .warnings
            .iter()
            .any(|w| w.contains("\"warm\" (nodes) skipped")),
        "{:?}",
        mesh.repairs.warnings
    );
}

#[test]
fn empty_piece_of_an_index_keeps_the_fields() {
    let bench = Bench::new();
    let contents = [
        EMPTY.to_owned(),
        piece(-1, &warm("1 2 3 4")),
        piece(1, &warm("1 2 3 5")),
    ];
    let mut index = String::from("<VTKFile type=\"PUnstructuredGrid\"><PUnstructuredGrid>");
    for (k, pieces) in contents.iter().enumerate() {
        std::fs::write(bench.path(&format!("p{k}.vtu")), file(pieces)).unwrap();
        index += &format!("<Piece Source=\"p{k}.vtu\"/>");
    }
    index += "</PUnstructuredGrid></VTKFile>";
    assert_joined(&bench.read("a.pvtu", index.as_bytes()).unwrap());
}

#[test]
fn parts_of_a_frame_are_joined() {
    let bench = Bench::new();
    for (k, x, values) in [(0, -1, "1 2 3 4"), (1, 1, "1 2 3 5")] {
        let text = file(&piece(x, &warm(values)));
        std::fs::write(bench.path(&format!("p{k}.vtu")), text).unwrap();
    }
    let series = "<VTKFile type=\"Collection\"><Collection><DataSet timestep=\"0\" part=\"1\" file=\"p1.vtu\"/><DataSet timestep=\"0\" part=\"0\" file=\"p0.vtu\"/><DataSet timestep=\"1\" file=\"p0.vtu\"/></Collection></VTKFile>";
    let path = bench.path("s.pvd");
    std::fs::write(&path, series).unwrap();
    let frames = io::read_pvd(&path).unwrap();
    assert_eq!(frames.len(), 2);
    assert_eq!(
        frames[0].files,
        [bench.path("p0.vtu"), bench.path("p1.vtu")]
    );
    assert_joined(&frames[0].read().unwrap());
    assert_eq!(
        frames[1].single_file(),
        Some(bench.path("p0.vtu").as_path())
    );
    assert_eq!(frames[1].read().unwrap().tets.len(), 1);
}

#[test]
fn cases_of_pieces_are_one_mesh_with_its_field() {
    for name in ["17_two_pieces.vtu", "18_empty_piece.pvtu"] {
        let Some(path) = real_data(&format!("cases/{name}")) else {
            return;
        };
        let mesh = io::read(path).unwrap();
        assert_eq!((mesh.nodes.len(), mesh.tets.len()), (12, 12), "{name}");
        assert_eq!(Topology::new(&mesh).boundary.len(), 20, "{name}");
        let field = mesh.fields.iter().find(|f| f.name == "temp").unwrap();
        assert_eq!(field.values[0], 1.0);
        assert_eq!(field.values[11], 2.0);
    }
}
