//! AVS UCD and MFEM meshes, and messages about formats that are not supported.

use crate::io::sample::Bench;
use palpate::mesh::{Location, TetMesh};

fn read(name: &str, text: &str) -> TetMesh {
    Bench::new()
        .read(name, text.as_bytes())
        .unwrap_or_else(|e| panic!("{e}"))
}

fn error(name: &str, bytes: &[u8]) -> String {
    match Bench::new().read(name, bytes) {
        Ok(_) => panic!("{name} is accepted"),
        Err(e) => e.to_string(),
    }
}

/// A hexahedron, a pyramid on it, a prism beside it and a tet, in the node order of UCD.
const UCD: &str = "# comment\n# another\n14 4 4 1 0
1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 0 0 1\n6 1 0 1\n7 1 1 1\n8 0 1 1
9 2 0 0\n10 2 0 1\n11 0.5 0.5 2\n12 3 0 0\n13 0.5 -1 0.5\n14 9 9 9
1 1 hex 5 6 7 8 1 2 3 4\n2 2 pyr 11 5 6 7 8\n3 3 prism 6 10 7 2 9 3\n4 4 tet 9 12 3 10
2 1 3\ntemp, K\nflow, m/s
1 1 0 0 0\n2 2 0 0 0\n3 3 0 0 0\n4 4 0 0 0\n5 5 0 0 0\n6 6 0 0 0\n7 7 0 0 0\n8 8 0 0 0
9 9 0 0 0\n10 10 0 0 0\n11 11 0 0 0\n12 12 0 0 0\n13 13 0 0 0\n14 14 0 0 1
1 1\nstiffness, Pa\n1 10\n2 20\n3 30\n4 40\n";

#[test]
fn ucd_reads_all_cell_types_and_data() {
    // By content: the extension is that of Abaqus.
    for name in ["a.inp", "a.ucd", "a"] {
        let mesh = read(name, UCD);
        let material = mesh.field("ucd:material", Location::Cell).unwrap();
        let mut volumes = [0.0; 5];
        for (t, m) in material.values.iter().enumerate() {
            volumes[*m as usize] += mesh.tet_volume(t);
        }
        for (found, expected) in volumes.iter().zip([0.0, 1.0, 1.0 / 3.0, 0.5, 1.0 / 6.0]) {
            assert!((found - expected).abs() < 1e-12, "{volumes:?}");
        }
        assert_eq!(mesh.repairs.inverted_fixed, 0);
        let temperature = mesh.field("temp", Location::Node).unwrap();
        assert_eq!(temperature.values[2], 3.0);
        assert_eq!(mesh.field("flow", Location::Node).unwrap().components, 3);
        let stiffness = mesh.field("stiffness", Location::Cell).unwrap();
        assert_eq!(stiffness.values.last(), Some(&40.0));
    }
}

#[test]
fn ucd_bad_value_costs_its_field() {
    let mesh = read("a.inp", &UCD.replace("\n3 3 0 0 0\n", "\n3 ? 0 0 0\n"));
    assert!(mesh.field("temp", Location::Node).is_none());
    assert!(mesh.field("flow", Location::Node).is_some());
    assert!(mesh.field("stiffness", Location::Cell).is_some());
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(
        warnings.contains("field \"temp\" skipped: line 27: expected a number, found \"?\""),
        "{warnings}"
    );
}

#[test]
fn ucd_errors_state_line_and_cause() {
    for (from, to, expected) in [
        (
            "14 4 4 1 0",
            "14 99999999 4 1 0",
            "line 3: the number of cells is 99999999",
        ),
        (
            "tet 9",
            "tot 9",
            "line 21: cell 4 has the type \"tot\"; expected one of pt, line",
        ),
        ("tet 9", "tet 90", "cell 4 refers to undefined node 90"),
        ("\n3 1 1 0\n", "\n2 1 1 0\n", "node 2 is defined twice"),
        (
            "2 1 3\n",
            "2 1 4\n",
            "have 5 components, but the first line of the file states 4",
        ),
        ("2 1 3\n", "2 1 9999999999999\n", "components"),
        ("1 10\n2 20", "1 10\n1 20", "1 has values twice"),
        ("3 30\n4 40\n", "3 30\n", "unexpected end of file"),
        ("3 30\n", "33 30\n", "values belong to \"33\""),
    ] {
        assert!(UCD.contains(from), "{from}");
        let error = error("a.inp", UCD.replacen(from, to, 1).as_bytes());
        assert!(
            error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
}

const MFEM: &str =
    "MFEM mesh v1.0\n\n# comment\ndimension\n3\n\nelements\n2\n1 5 0 1 2 3 4 5 6 7\n7 4 1 8 2 5
\nboundary\n1\n3 2 0 1 2\n\nvertices\n9\n";
const POINTS: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n2 0 0\n";

#[test]
fn mfem_meshes_are_read_by_content() {
    let mesh = read("a.mesh", &format!("{MFEM}3\n{POINTS}"));
    assert!((mesh.volume() - 7.0 / 6.0).abs() < 1e-12);
    let attribute = mesh.field("mfem:attribute", Location::Cell).unwrap();
    assert_eq!(attribute.values.last(), Some(&7.0));
    // A curved mesh: the values of its vertices precede those of edges, by node or by coordinate.
    let space =
        "\nnodes\nFiniteElementSpace\nFiniteElementCollection: H1_3D_P2\nVDim: 3\nOrdering:";
    let by_point = format!("{MFEM}{space} 1\n{POINTS}0.5 0.5 0.5\n");
    let numbers: Vec<Vec<&str>> = POINTS.lines().map(|l| l.split(' ').collect()).collect();
    let mut by_axis = format!("{MFEM}{space} 0\n");
    for axis in 0..3 {
        for point in &numbers {
            by_axis += &format!("{}\n", point[axis]);
        }
        by_axis += "0.5\n";
    }
    for text in [by_point, by_axis] {
        let curved = read("a.mesh", &text);
        assert_eq!(curved.nodes, mesh.nodes);
        let warnings = curved.repairs.warnings.join("");
        assert!(warnings.contains("1 other nodes dropped"), "{warnings}");
    }
}

#[test]
fn mfem_errors_state_line_and_cause() {
    let whole = format!("{MFEM}3\n{POINTS}");
    for (from, to, expected) in [
        (
            "MFEM mesh",
            "MFEM NURBS mesh",
            "line 1: MFEM meshes of the kind \"NURBS mesh\"",
        ),
        (
            "7 4 1 8",
            "7 9 1 8",
            "the geometry of element 2 is 9, expected 0 to 7",
        ),
        ("7 4 1 8", "7 4 1 -8", "refers to vertex -8"),
        ("7 4 1 8", "7 4 1 80", "refers to node 80"),
        (
            "elements\n2",
            "elements\n20000",
            "the number of elements is 20000",
        ),
        (
            "vertices\n9\n3",
            "vertices\n9\n2",
            "vertices have 2 coordinates",
        ),
        (
            "vertices\n9",
            "vertices\n9000000000",
            "unexpected end of file",
        ),
        ("vertices", "4", "expected the name of a section"),
    ] {
        assert!(whole.contains(from), "{from}");
        let error = error("a.mesh", whole.replacen(from, to, 1).as_bytes());
        assert!(
            error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
    let broken = "nodes\nFiniteElementSpace\nFiniteElementCollection: L2_T1_3D_P1\nVDim: 3\nOrdering: 1\n0\n";
    let error = error("a.mesh", format!("{MFEM}{broken}").as_bytes());
    assert!(
        error.contains("\"L2_T1_3D_P1\" are not supported"),
        "{error}"
    );
}

#[test]
fn unsupported_formats_are_named_with_a_converter() {
    let hdf5 = b"\x89HDF\r\n\x1a\n............INFOS_GENERALES";
    let iges = format!("{:72}S      1\n", "");
    for (name, bytes, expected) in [
        (
            "a.med",
            &hdf5[..],
            "format MED (SALOME, Code_Aster), which is not supported; convert it with meshio (pip install meshio h5py; meshio convert FILE.med FILE.vtu)",
        ),
        ("a", hdf5, "format MED"),
        ("a.xyz", b"\x89HDF\r\n\x1a\n", "format HDF5"),
        ("a.cgns", b"\x89HDF\r\n\x1a\n", "format CGNS"),
        ("a.e", b"CDF\x01....num_el_blk", "format Exodus II"),
        (
            "a.unv",
            b"    -1\n  2411\n",
            "gmsh FILE.unv -save -o FILE.msh",
        ),
        ("a.txt", b"    -1\n  2411\n", "format UNV"),
        (
            "a.feb",
            b"<?xml version=\"1.0\"?>\n<febio_spec version=\"4.0\">",
            "FEBio Studio",
        ),
        (
            "a.bdf",
            b"$ comment\nBEGIN BULK\n",
            "meshio convert FILE.bdf FILE.vtu",
        ),
        ("a.dat", b"SOL 101\nGRID,1,,0.,0.,0.\n", "format Nastran"),
        ("a.xdmf", b"<?xml version=\"1.0\"?><Xdmf>", "ParaView"),
        ("a", b"/*--- C++ ---*/\nFoamFile\n{\n", "format OpenFOAM"),
        (
            "a.cdb",
            b"/COM,ANSYS RELEASE\n/PREP7\n",
            "mapdl_archive.Archive(\"FILE.cdb\")",
        ),
        ("a.k", b"*NODE\n1, 0, 0, 0\n", "format LS-DYNA"),
        ("a.dat", b"$ x\n*KEYWORD\n", "format LS-DYNA"),
        (
            "a.step",
            b"ISO-10303-21;\n",
            "gmsh -3 FILE.step -o FILE.msh",
        ),
        ("a", iges.as_bytes(), "format IGES"),
        ("a.msh", b"(0 \"ANSYS\")\n", "format ANSYS Fluent"),
        ("a.meshb", b"\x01\0\0\0\x02\0\0\0", "format binary Medit"),
        ("a.mnc", b"x", "mnc2nii FILE.mnc FILE.nii"),
        ("a.tif", b"II*\0....", "3D Slicer"),
        ("a.glb", b"glTF....", "Blender"),
        ("a.off", b"OFF\n3 1 0\n", "meshio convert FILE.off FILE.ply"),
        ("a.zip", b"PK\x03\x04", "unzip"),
    ] {
        let error = error(name, bytes);
        assert!(
            error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
    let surface = palpate::io::parse_surface("a.gii", b"<?xml?><GIFTI>").unwrap_err();
    assert!(
        surface.to_string().contains("mris_convert FILE.gii"),
        "{surface}"
    );
    let volume = palpate::io::parse_volume("a.mnc", b"CDF\x01").unwrap_err();
    assert!(volume.to_string().contains("format MINC"), "{volume}");
    let volume = palpate::io::parse_volume("a.dcm", b"x").unwrap_err();
    assert!(volume.to_string().contains("dcm2niix"), "{volume}");
}
