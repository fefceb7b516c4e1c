//! Every variant of every format gives the same mesh.

use crate::io::sample::{Bench, bits};
use palpate::mesh::Location;

#[test]
fn every_format_variant_matches_sample() {
    let bench = Bench::new();
    for fixture in crate::io::encode::all() {
        let mesh = bench
            .read_as(&fixture, &fixture.bytes, fixture.second.as_deref())
            .unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(bits(&mesh), bits(&fixture.expected), "{}", fixture.name);
    }
}

#[test]
fn crlf_and_byte_order_mark_are_ignored() {
    let bench = Bench::new();
    for fixture in crate::io::encode::all() {
        let Ok(text) = std::str::from_utf8(&fixture.bytes) else {
            continue;
        };
        // Not the binary ones, whose numbers it would change.
        if text.contains('\0') || fixture.name.contains("raw") {
            continue;
        }
        let windows = format!("\u{feff}{}", text.replace('\n', "\r\n"));
        let windows = windows
            .strip_prefix('\u{feff}')
            .filter(|_| fixture.second.is_some())
            .unwrap_or(&windows);
        let second = fixture.second.as_deref();
        let mesh = bench
            .read_as(&fixture, windows.as_bytes(), second)
            .unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(bits(&mesh), bits(&fixture.expected), "{}", fixture.name);
    }
}

#[test]
fn content_takes_precedence_over_extension() {
    let bench = Bench::new();
    for fixture in crate::io::encode::all()
        .iter()
        .filter(|f| f.second.is_none())
    {
        for name in ["mesh.dat", "mesh", "mesh.VTU", "mesh.mesh"] {
            let mesh = bench
                .read(name, &fixture.bytes)
                .unwrap_or_else(|e| panic!("{}: {e}", fixture.name));
            assert_eq!(bits(&mesh), bits(&fixture.expected), "{}", fixture.name);
        }
    }
}

#[test]
fn tetgen_reads_from_node_or_ele_path() {
    let bench = Bench::new();
    let fixture = crate::io::encode::all()
        .into_iter()
        .find(|f| f.second.is_some())
        .unwrap();
    bench
        .read_as(&fixture, &fixture.bytes, fixture.second.as_deref())
        .unwrap();
    let mesh = palpate::io::read(bench.path(&fixture.name).with_extension("ele")).unwrap();
    assert_eq!(bits(&mesh), bits(&fixture.expected));
}

/// Reads `text` under `name`.
fn read(name: &str, text: &str) -> palpate::mesh::TetMesh {
    Bench::new()
        .read(name, text.as_bytes())
        .unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn vtu_pieces_are_joined() {
    let piece = |x: f64, label: &str, second: &str| {
        format!(
            "<Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><PointData><DataArray type=\"Float64\" Name=\"x\">{x} 1 2 3</DataArray>{second}</PointData><CellData><DataArray type=\"{label}\" Name=\"c\">7</DataArray></CellData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\">{x} 0 0 9 0 0 0 9 0 0 0 9</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\">0 1 2 3</DataArray><DataArray type=\"Int32\" Name=\"offsets\">4</DataArray><DataArray type=\"UInt8\" Name=\"types\">10</DataArray></Cells></Piece>"
        )
    };
    let only_first = "<DataArray type=\"Float64\" Name=\"half\">1 2 3 4</DataArray>";
    let mesh = read(
        "a.vtu",
        &format!(
            "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid>{}<Piece NumberOfPoints=\"0\" NumberOfCells=\"0\"><PointData><DataArray type=\"Float64\" Name=\"x\"></DataArray></PointData><Points/></Piece><FieldData><DataArray type=\"Float64\" Name=\"TimeValue\">1.5</DataArray></FieldData>{}</UnstructuredGrid></VTKFile>",
            piece(0.5, "Int32", only_first),
            piece(-0.5, "UInt8", "")
        ),
    );
    assert_eq!(mesh.tets, [[0, 1, 2, 3], [4, 1, 2, 3]]);
    assert_eq!(mesh.nodes[4].x, -0.5);
    let x = mesh.field("x", Location::Node).unwrap();
    assert_eq!(x.values, [0.5, 1.0, 2.0, 3.0, -0.5]);
    assert_eq!(mesh.field("c", Location::Cell).unwrap().values, [7.0, 7.0]);
    assert!(mesh.field("half", Location::Node).is_none());
    let warnings = mesh.repairs.warnings.join("");
    assert!(warnings.contains("\"half\" (nodes) skipped"), "{warnings}");
}

#[test]
fn legacy_vtk_attributes_become_fields() {
    let text = crate::io::errors::LEGACY.replace(
        "SCALARS s double\nLOOKUP_TABLE default\n1 2 3 4\n",
        "scalars bare char\n1 -2 3 4
SCALARS two unsigned_short 2\nLOOKUP_TABLE mine\n1 2 3 4 5 6 7 8
LOOKUP_TABLE mine 2\n0 0 0 1 1 1 1 1
COLOR_SCALARS rgb 3\n0 0.5 1 0 0 0 1 1 1 0.2 0.4 0.6
NORMALS n float\n1 0 0 0 1 0 0 0 1 0 0 1
TENSORS t double\n1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9
TEXTURE_COORDINATES uv 2 float\n0 0 1 0 0 1 1 1
GLOBAL_IDS id vtktypeint32\n5 6 7 8
FIELD more 3\na%20b 1 4 long\n1 2 3 4\nshort 1 3 int\n1 2 3\nnames 1 4 string\na b\nc\n%20\nd
",
    );
    let mesh = read("a.vtk", &text);
    let found: Vec<_> = mesh
        .fields
        .iter()
        .map(|f| (f.name.as_str(), f.components, f.scalar_type))
        .collect();
    use palpate::mesh::ScalarType::*;
    let expected = [
        ("bare", 1, I8),
        ("two", 2, U16),
        ("rgb", 3, U8),
        ("n", 3, F32),
        ("t", 9, F64),
        ("uv", 2, F32),
        ("id", 1, I32),
        ("a b", 1, I64),
    ];
    assert_eq!(found, expected);
    let rgb = mesh.field("rgb", Location::Node).unwrap();
    assert_eq!(rgb.values[..3], [0.0, 128.0, 255.0]);
    assert_eq!(rgb.values[9..], [51.0, 102.0, 153.0]);
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(warnings.contains("\"short\" skipped"), "{warnings}");
    assert!(warnings.contains("\"names\" skipped"), "{warnings}");
}

#[test]
fn medit_reads_all_cell_types() {
    let text = "MeshVersionFormatted 2 Dimension 3 Vertices 13
0 0 0 0  1 0 0 0  1 1 0 0  0 1 0 0  0 0 1 0  1 0 1 0  1 1 1 0  0 1 1 0
2 0 0 0  2 0 1 0  0.5 0.5 2 0  3 0 0 0  0.5 -1 0.5 0
Hexahedra 1  1 2 3 4 5 6 7 8 1
Prisms 1  2 9 3 6 10 7 2
Pyramids 1  5 6 7 8 11 3
Tetrahedra 1  9 12 10 3 4
Quadrilaterals 1  1 2 3 4 5
End";
    let mesh = read("a.mesh", text);
    let label = mesh.field("medit:ref", Location::Cell).unwrap();
    let mut volumes = [0.0; 5];
    for (t, l) in label.values.iter().enumerate() {
        volumes[*l as usize] += mesh.tet_volume(t);
    }
    for (found, expected) in volumes.iter().zip([0.0, 1.0, 0.5, 1.0 / 3.0, 1.0 / 6.0]) {
        assert!((found - expected).abs() < 1e-12, "{volumes:?}");
    }
    assert_eq!(mesh.repairs.unused_nodes, 1);
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(
        warnings.contains("1 hexahedron, 1 pyramid, 1 wedge subdivided"),
        "{warnings}"
    );
    assert!(warnings.contains("1 quadrilateral dropped"), "{warnings}");
}

#[test]
fn medit_accepts_other_spellings_and_float_references() {
    let text = "MeshVersionFormatted 2 Dimension 3 Vertices 9
0 0 0 0.0  1 0 0 0.0  1 1 0 0.0  0 1 0 0.0  0 0 1 0.0  1 0 1 0.0  1 1 1 0.0  0 1 1 0.0  2 0 0 0.0
Tetraedra 1  2 9 3 6 1.0
Hexaedra 1  1 2 3 4 5 6 7 8 2.0
Corners 1 1
SubTetrahedra 1 7
End";
    let mesh = read("a.mesh", text);
    assert!((mesh.volume() - 7.0 / 6.0).abs() < 1e-12);
    assert!(mesh.field("medit:ref", Location::Node).is_none());
    let field = mesh.field("medit:ref", Location::Cell).unwrap();
    assert_eq!(field.values[..2], [1.0, 2.0]);
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(
        warnings.contains("section SubTetrahedra skipped"),
        "{warnings}"
    );
    assert!(!warnings.contains("Corners"), "{warnings}");
    for (from, to) in [
        ("2.0\nC", "x\nC"),
        ("2.0\nC", "inf\nC"),
        ("Hexaedra", "HexaedraQ9"),
    ] {
        let path = tempfile::tempdir().unwrap();
        let path = path.path().join("a.mesh");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        assert!(palpate::io::read(&path).is_err(), "{to}");
    }
}

#[test]
fn tetgen_bad_attribute_costs_that_attribute() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.node");
    let nodes = "4 3 2 1\n1 0 0 0 5 ? 1\n2 1 0 0 6 7 1\n3 0 1 0 7 8 1\n4 0 0 1 8 9 1\n";
    std::fs::write(&path, nodes).unwrap();
    std::fs::write(path.with_extension("ele"), "1 4 1\n1 1 2 3 4 soft\n").unwrap();
    let mesh = palpate::io::read(&path).unwrap();
    let names: Vec<&str> = mesh.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["tetgen:attr1", "tetgen:ref"]);
    let warnings = mesh.repairs.warnings.join("\n");
    for expected in [
        "attribute 2 of nodes skipped: line 2",
        "attribute 1 of cells skipped: line 2",
    ] {
        assert!(warnings.contains(expected), "{warnings}");
    }
}

#[test]
fn tetgen_reads_second_order_tets_with_gaps_in_numbering() {
    let bench = Bench::new();
    let corners = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"];
    // In an order of its own: of the edges 23, 03, 01, 12, 13 and 02.
    let middles = [
        "0 .5 .5", "0 0 .5", ".5 0 0", ".5 .5 0", ".5 0 .5", "0 .6 0",
    ];
    let mut node = String::from("10 3 0 0\n");
    for (i, place) in corners.iter().chain(&middles).enumerate() {
        node += &format!("{} {place}\n", 5 * i + 2);
    }
    let ele = "1 10 2\n1  2 7 12 17 22 27 32 37 42 47  -3 0.5\n";
    std::fs::write(bench.path("a.ELE"), ele).unwrap();
    let mesh = bench
        .read("a.NODE", node.as_bytes())
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        mesh.ten_node_tets().unwrap(),
        [[0, 1, 2, 3, 6, 9, 5, 7, 8, 4]]
    );
    let cell = |name| mesh.field(name, Location::Cell).unwrap().values.clone();
    assert_eq!(cell("tetgen:ref"), [-3.0; 8]);
    assert_eq!(cell("tetgen:ref2"), [0.5; 8]);
    assert!(mesh.repairs.warnings.is_empty(), "{:?}", mesh.repairs);
}
