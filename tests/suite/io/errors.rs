//! Errors state the defect, its position, and the expected content.

use crate::io::sample::Bench;

/// Returns the last part of the error message for the file `name` with `text`.
fn message(name: &str, text: &str) -> String {
    match Bench::new().read(name, text.as_bytes()) {
        Ok(_) => panic!("{name} is accepted:\n{text}"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn rejects_files_that_are_not_meshes() {
    let bench = Bench::new();
    let of = |name: &str| palpate::io::read(bench.path(name)).unwrap_err().to_string();
    assert!(
        of("missing.vtu").contains("missing.vtu: No such file"),
        "{}",
        of("missing.vtu")
    );
    assert!(of("").contains("folder"));
    assert!(message("a.vtk", " \n").contains("empty"));
    let unknown = message("a.xyz", "hello");
    for format in ["VTK", ".vtu", "Gmsh", "TetGen", "Medit", "Abaqus"] {
        assert!(unknown.contains(format), "{unknown}");
    }
    assert!(message("a.vtu", "hello").contains("no <VTKFile>"));
    assert!(message("a.vtk", "hello").contains("line 1: expected \"# vtk DataFile"));
    assert!(message("a.msh", "hello").contains("line 1: expected the $Name"));
    assert!(message("a.mesh", "hello").contains("line 1: expected MeshVersionFormatted"));
    assert!(message("a.node", "hello").contains("a.node: line 1: expected integers in the header"));
    assert!(message("a.node", "1 3 0 0\n0 0 0 0\n").contains("a.ele: No such file"));
    let gzip = bench
        .read("a.vtu", &[0x1f, 0x8b, 8, 0])
        .unwrap_err()
        .to_string();
    assert!(gzip.contains("gzip"), "{gzip}");
}

pub const LEGACY: &str = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n0 0 0\n1 0 0\n0 1 0\n0 0 1\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 4\nSCALARS s double\nLOOKUP_TABLE default\n1 2 3 4\n";
const VTU: &str = "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\">0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\">0 1 2 3</DataArray><DataArray type=\"Int32\" Name=\"offsets\">4</DataArray><DataArray type=\"UInt8\" Name=\"types\">10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>";
const BINARY_VTU: &str = "<VTKFile type=\"UnstructuredGrid\" compressor=\"vtkZLibDataCompressor\"><UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"binary\">AQAAAGAAAAAAAAAA////fw==eJw=</DataArray></Points></Piece></UnstructuredGrid></VTKFile>";
pub const GMSH_2: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n1\n1 4 2 1 1 1 2 3 4\n$EndElements\n";
pub const GMSH_4: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n";
const MEDIT: &str = "MeshVersionFormatted 1\nDimension 3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\nTetrahedra\n1\n1 2 3 4 0\nEnd\n";

#[test]
fn undamaged_reference_files_are_valid() {
    let bench = Bench::new();
    for (name, text) in [
        ("a.vtk", LEGACY),
        ("a.vtu", VTU),
        ("a2.msh", GMSH_2),
        ("a4.msh", GMSH_4),
        ("a.mesh", MEDIT),
    ] {
        let mesh = bench.read(name, text.as_bytes()).unwrap();
        assert_eq!((mesh.nodes.len(), mesh.tets.len()), (4, 1), "{name}");
        assert_eq!(mesh.repairs.warnings, Vec::<String>::new());
    }
}

#[test]
fn damage_errors_state_position() {
    let huge = "4000000000000";
    for (name, text, from, to, expected) in [
        // wrong counts, which must not size an allocation
        (
            "a.vtk",
            LEGACY,
            "POINTS 4",
            "POINTS 4000000000000",
            "line 5: the number of POINTS is 4000000000000",
        ),
        (
            "a.vtk",
            LEGACY,
            "CELLS 1 5",
            "CELLS 1 4000000000000",
            "line 10: the size of the CELLS list",
        ),
        ("a.vtk", LEGACY, "CELLS 1 5", "CELLS 2 5", "cell 1"),
        (
            "a.vtk",
            LEGACY,
            "CELL_TYPES 1",
            "CELL_TYPES 9223372036854775807",
            "CELL_TYPES",
        ),
        (
            "a.vtk",
            LEGACY,
            "s double",
            "s double 65535",
            "line 17: the number of values in s is 262140",
        ),
        (
            "a.vtu",
            VTU,
            "Points=\"4\"",
            "Points=\"6148914691236517206\"",
            "exceeds the addressable range",
        ),
        (
            "a.vtu",
            VTU,
            "Points=\"4\"",
            "Points=\"4000000000000\"",
            "bytes are left in the file",
        ),
        (
            "a.vtu",
            VTU,
            "Cells=\"1\"",
            "Cells=\"2\"",
            "\"types\" in <Cells>",
        ),
        ("a.vtu", VTU, ">4<", ">4000000000000<", "\"connectivity\""),
        (
            "b.vtu",
            BINARY_VTU,
            "",
            "",
            "data are truncated: 2147483647 more",
        ),
        (
            "b.vtu",
            BINARY_VTU,
            "AQAAAGAA",
            "////f2AA",
            "blocks of 96 bytes",
        ),
        (
            "a.msh",
            GMSH_2,
            "$Nodes\n4",
            "$Nodes\n4000000000000",
            "line 5: the number of nodes",
        ),
        (
            "a.msh",
            GMSH_2,
            "$Nodes\n4",
            "$Nodes\n3",
            "line 9: expected $EndNodes",
        ),
        (
            "a.msh",
            GMSH_4,
            "3 1 0 4",
            "3 1 0 4000000000000",
            "number of nodes of a block",
        ),
        (
            "a.msh",
            GMSH_4,
            "1 4 1 4",
            "1 5 1 4",
            "announces 5 nodes, but its blocks hold 4",
        ),
        (
            "a.mesh",
            MEDIT,
            "Vertices\n4",
            "Vertices\n4000000000000",
            "line 4: the number of Vertices",
        ),
        (
            "a.mesh",
            MEDIT,
            "Vertices\n4",
            "Vertices\n3",
            "expected a keyword, found \"0\"",
        ),
        // values
        (
            "a.vtk",
            LEGACY,
            "0 1 0",
            "0 nan 0",
            "must have finite coordinates",
        ),
        (
            "a.vtk",
            LEGACY,
            "0 1 0",
            "0 1e999 0",
            "must have finite coordinates",
        ),
        (
            "a.vtk",
            LEGACY,
            "0 1 0",
            "0 one 0",
            "line 8: expected value 7 of 12 in POINTS (a number), found \"one\"",
        ),
        (
            "a.vtk",
            LEGACY,
            "4 0 1 2 3",
            "4 0 1 2 4",
            "refers to node 4, but there are only 4",
        ),
        (
            "a.vtk",
            LEGACY,
            "4 0 1 2 3",
            "4 0 1 2 -3",
            "refers to node -3",
        ),
        (
            "a.vtk",
            LEGACY,
            "\n10\n",
            "\n12\n",
            "8 corners, but it lists 4",
        ),
        ("a.vtk", LEGACY, "\n10\n", "\n999\n", "kind 999"),
        (
            "a.vtk",
            LEGACY,
            "UNSTRUCTURED_GRID",
            "STRUCTURED_GRID",
            "expected DATASET UNSTRUCTURED_GRID",
        ),
        ("a.vtu", VTU, "0 1 2 3", "0 1 2 4", "refers to node 4"),
        ("a.vtu", VTU, "0 1 2 3", "0 1 2.5 3", "2.5"),
        ("a.vtu", VTU, ">10<", ">5<", "only 1 triangle"),
        (
            "a.vtu",
            VTU,
            "\"UnstructuredGrid\"",
            "\"PolyData\"",
            "no <Piece>",
        ),
        (
            "a.vtu",
            VTU,
            "type=\"UnstructuredGrid\"",
            "type=\"UnstructuredGrid\" compressor=\"vtkBrotliDataCompressor\"",
            "vtkBrotliDataCompressor",
        ),
        (
            "a.vtu",
            VTU,
            "<DataArray type=\"UInt8\"",
            "<DataArray format=\"appended\" offset=\"0\" type=\"UInt8\"",
            "no <AppendedData>",
        ),
        (
            "a.msh",
            GMSH_2,
            "1 2 3 4\n",
            "1 2 3 9\n",
            "line 13: element 1 refers to node 9",
        ),
        (
            "a.msh",
            GMSH_2,
            "2 1 0 0",
            "1 1 0 0",
            "node 1 is defined twice, at different positions",
        ),
        ("a.msh", GMSH_2, "1 4 2 1", "1 444 2 1", "element type 444"),
        ("a.msh", GMSH_2, "2.2 0 8", "3.0 0 8", "version 3.0"),
        ("a.msh", GMSH_4, "1 1 2 3 4", "1 1 2 3 x", "found \"x\""),
        (
            "a.mesh",
            MEDIT,
            "1 2 3 4 0",
            "1 2 3 5 0",
            "line 11: tetrahedra 1 refers to vertex 5",
        ),
        (
            "a.mesh",
            MEDIT,
            "1 2 3 4 0",
            "0 2 3 4 0",
            "refers to vertex 0",
        ),
        (
            "a.mesh",
            MEDIT,
            "Dimension 3",
            "Dimension 2",
            "dimension 2, expected 3",
        ),
    ] {
        let damaged = text.replacen(from, to, 1);
        let error = message(name, &damaged);
        assert!(
            error.contains(name) && error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
    let nodes = "4 3 0 0\n0 0 0 0\n1 1 0 0\n2 0 1 0\n3 0 0 1\n";
    for (node, ele, expected) in [
        (
            nodes.replacen("4 ", &format!("{huge} "), 1),
            "1 4 0\n0 0 1 2 3\n".to_string(),
            "4000000000000",
        ),
        (
            nodes.replacen("4 3", "3 3", 1),
            "1 4 0\n0 0 1 2 3\n".into(),
            "a.node: line 5: more lines than the 3 nodes",
        ),
        (
            nodes.replacen("1 1 0 0", "1 1 0", 1),
            "1 4 0\n0 0 1 2 3\n".into(),
            "line 3: node 1 of 4 (counted from 0) has 3 columns, expected 4",
        ),
        (
            nodes.into(),
            "2 4 0\n0 0 1 2 3\n".into(),
            "a.ele: line 3: unexpected end of file, expected tetrahedron 1 of 2",
        ),
        (
            nodes.into(),
            "1 4 0\n0 0 1 2 4\n".into(),
            "a.ele: line 2: expected a node of tetrahedron 0 of 1 (counted from 0) that is in the .node file, found \"4\"",
        ),
        (
            nodes.into(),
            "1 7 0\n0 0 1 2 3\n".into(),
            "7 nodes per tetrahedron",
        ),
    ] {
        let bench = Bench::new();
        std::fs::write(bench.path("a.ele"), ele).unwrap();
        let error = bench
            .read("a.node", node.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
}
