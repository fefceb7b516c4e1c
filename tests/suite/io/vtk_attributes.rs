//! One bad attribute of a VTK file costs that attribute alone.

use crate::io::errors::LEGACY;
use crate::io::sample::Bench;
use crate::support::real_data;
use palpate::io;
use palpate::mesh::TetMesh;

fn names(mesh: &TetMesh) -> Vec<&str> {
    mesh.fields.iter().map(|f| f.name.as_str()).collect()
}

fn noted(mesh: &TetMesh, what: &str) {
    let notes = &mesh.repairs.warnings;
    assert!(notes.iter().any(|n| n.contains(what)), "{what}: {notes:?}");
}

#[test]
fn bad_legacy_attribute_costs_itself_alone() {
    let bench = Bench::new();
    let after = "VECTORS v double\n1 2 3 4 5 6 7 8 9 10 11 12\n";
    let field = "FIELD f 2\na 1 4 double\n1 2 x 4\nb 1 4 double\n5 6 7 8\n";
    let cells = |count: usize, values: &str| {
        format!("{after}CELL_DATA {count}\nSCALARS c double\nLOOKUP_TABLE default\n{values}\n")
    };
    for (what, tail, replaced, kept, note) in [
        (
            "a word among values",
            after.to_owned(),
            ("1 2 3 4\n", "1 2 x 4\n"),
            vec!["v"],
            "\"s\" skipped",
        ),
        (
            "too few values",
            after.to_owned(),
            ("1 2 3 4\n", "1 2 3\n"),
            vec!["v"],
            "\"s\" skipped",
        ),
        (
            "too many values",
            after.to_owned(),
            ("1 2 3 4\n", "1 2 3 4 5 6\n"),
            vec!["v"],
            "\"s\" skipped: more values",
        ),
        (
            "an unknown type",
            after.to_owned(),
            ("s double", "s complex"),
            vec!["v"],
            "unknown type",
        ),
        (
            "a word in a FIELD",
            format!("{field}{after}"),
            ("", ""),
            vec!["s", "b", "v"],
            "\"a\" skipped",
        ),
        (
            "too many cells",
            cells(2, "1 2"),
            ("", ""),
            vec!["s", "v"],
            "\"c\" skipped: it has 2 tuples, but there are 1",
        ),
        (
            "fewer values than cells",
            cells(2, "1"),
            ("", ""),
            vec!["s", "v"],
            "\"c\" skipped",
        ),
        (
            "no cells",
            cells(0, "1"),
            ("", ""),
            vec!["s", "v"],
            "\"c\" skipped: it has 0 tuples",
        ),
    ] {
        let (from, to) = replaced;
        let text = format!("{}{tail}", LEGACY.replacen(from, to, 1));
        let mesh = bench.read("a.vtk", text.as_bytes());
        let mesh = mesh.unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(names(&mesh), kept, "{what}");
        noted(&mesh, note);
    }
}

#[test]
fn bad_xml_attribute_costs_itself_alone() {
    let piece = "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><PointData>BAD<DataArray type=\"Float64\" Name=\"good\">1 2 3 4</DataArray></PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\">0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\">0 1 2 3</DataArray><DataArray type=\"Int32\" Name=\"offsets\">4</DataArray><DataArray type=\"UInt8\" Name=\"types\">10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>";
    for (attributes, values, note) in [
        ("type=\"Float64\"", "1 2 3", "bytes are left"),
        ("type=\"Float64\"", "1 2 3 4 5", "more than the expected 4"),
        ("type=\"Float64\"", "1 2 x 4", "expected value 2 of 4"),
        ("type=\"Float64\" format=\"binary\"", "AAAA", "truncated"),
        (
            "type=\"Float64\" format=\"appended\" offset=\"9\"",
            "",
            "no <AppendedData>",
        ),
        (
            "type=\"Float64\" NumberOfComponents=\"\"",
            "1 2 3 4",
            "NumberOfComponents",
        ),
        ("type=\"Complex\"", "1 2 3 4", "not numeric"),
    ] {
        let bad = format!("<DataArray {attributes} Name=\"bad\">{values}</DataArray>");
        let mesh = Bench::new().read("a.vtu", piece.replace("BAD", &bad).as_bytes());
        let mesh = mesh.unwrap_or_else(|e| panic!("{attributes}: {e}"));
        assert_eq!(names(&mesh), ["good"]);
        noted(&mesh, "\"bad\" skipped");
        noted(&mesh, note);
    }
}

#[test]
fn values_of_windows_that_are_not_numbers_are_read() {
    let bench = Bench::new();
    for (given, is) in [
        ("1.#QNAN", f64::NAN),
        ("-1.#IND", f64::NAN),
        ("-1.#IND00", f64::NAN),
        ("1.#SNAN", f64::NAN),
        ("-nan(ind)", f64::NAN),
        ("nan(0x1)", f64::NAN),
        ("-nan", f64::NAN),
        ("1.#INF", f64::INFINITY),
        ("-1.#INF00", f64::NEG_INFINITY),
        ("inf", f64::INFINITY),
    ] {
        let text = LEGACY.replace("1 2 3 4\n", &format!("1 {given} 3 4\n"));
        let mesh = bench.read("a.vtk", text.as_bytes());
        let mesh = mesh.unwrap_or_else(|e| panic!("{given}: {e}"));
        let found = mesh.fields[0].values[1];
        assert!(
            found == is || (found.is_nan() && is.is_nan()),
            "{given}: {found}"
        );
    }
    let text = LEGACY.replace("0 1 0\n", "0 -1.#IND 0\n");
    let error = bench
        .read("a.vtk", text.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(error.contains("node 2"), "{error}");
}

#[test]
fn cases_with_bad_attributes_read() {
    let files = [
        "24_c_celldata_count.vtk",
        "24_c_msvc2_nan.vtk",
        "13_one_nan.vtu",
    ];
    for name in files {
        let Some(path) = real_data(&format!("cases/{name}")) else {
            return;
        };
        let mesh = io::read(path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(mesh.tets.len(), 48, "{name}");
        assert!((mesh.volume() - 8.0).abs() < 1e-12, "{name}");
    }
}
