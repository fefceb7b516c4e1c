//! Gmsh output beyond the plain mesh.

use crate::io::errors::{GMSH_2, GMSH_4};
use crate::io::sample::Bench;
use palpate::mesh::{Location, TetMesh};

fn read(text: &str) -> TetMesh {
    let bench = Bench::new();
    bench
        .read("a.msh", text.as_bytes())
        .unwrap_or_else(|e| panic!("{e}"))
}

const NODE_DATA: &str =
    "$NodeData\n1\n\"heat\"\n1\n0.5\n3\n0\n1\n4\n1 0.5\n2 1.5\n3 2.5\n4 3.5\n$EndNodeData\n";

#[test]
fn mesh_repeated_before_each_view_is_read_once() {
    for text in [GMSH_2, GMSH_4] {
        let mesh = read(&format!("{text}{NODE_DATA}{text}"));
        assert_eq!((mesh.nodes.len(), mesh.tets.len()), (4, 1));
        assert_eq!(mesh.repairs.repeated, 0);
        assert_eq!(
            mesh.field("heat", Location::Node).unwrap().values,
            [0.5, 1.5, 2.5, 3.5]
        );
    }
}

#[test]
fn element_with_duplicate_number_is_kept_and_counted() {
    let six = GMSH_2
        .replace("$Nodes\n4", "$Nodes\n5")
        .replace("$EndNodes", "5 0 0 -1\n$EndNodes")
        .replace("$Elements\n1", "$Elements\n3")
        .replace(
            "$EndElements",
            "1 4 2 2 1 1 3 2 5\n2 4 2 1 1 1 2 3 4\n$EndElements",
        );
    let data = "$ElementData\n1\n\"heat\"\n1\n0.5\n3\n0\n1\n2\n1 0.5\n2 1.5\n$EndElementData\n";
    let mesh = read(&format!("{six}{data}"));
    // The third repeats the first under another number.
    assert_eq!((mesh.tets.len(), mesh.repairs.repeated), (2, 1));
    let groups = mesh.field("gmsh:physical", Location::Cell).unwrap();
    assert_eq!(groups.values, [1.0, 2.0]);
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(
        warnings.contains("1 element has the number of another"),
        "{warnings}"
    );
    assert!(
        warnings.contains("\"heat\" skipped: 1 of the 3"),
        "{warnings}"
    );
}

#[test]
fn parametric_node_coordinates_are_skipped() {
    let text = GMSH_2
        .replace("Nodes", "ParametricNodes")
        .replace("1 0 0 0", "1 0 0 0 0 1")
        .replace("2 1 0 0", "2 1 0 0 1 4 0.25")
        .replace("3 0 1 0", "3 0 1 0 2 5 0.25 0.75")
        .replace("4 0 0 1\n$", "4 0 0 1 3 1\n$");
    let mesh = read(&text);
    assert!((mesh.volume() - 1.0 / 6.0).abs() < 1e-15);
}

#[test]
fn unusable_data_is_skipped_with_warning() {
    for (from, to, expected) in [
        (
            "\n4\n1 0.5\n",
            "\n3\n",
            "1 of the 4 nodes of the volume have no value",
        ),
        (
            "\n0\n1\n4\n1 0.5\n2 1.5\n3 2.5\n4 3.5\n",
            "\n0\n2\n2\n1 0.5 1.5\n2 2.5 3.5\n",
            "2 components",
        ),
        ("NodeData", "ElementNodeData", "$ElementNodeData skipped"),
    ] {
        let mesh = read(&format!("{GMSH_2}{}", NODE_DATA.replace(from, to)));
        assert!(mesh.field("heat", Location::Node).is_none());
        let warnings = mesh.repairs.warnings.join("\n");
        assert!(
            warnings.contains(expected),
            "expected {expected:?} in {warnings:?}"
        );
    }
    let later = NODE_DATA
        .replace("1 0.5", "1 9.5")
        .replace("\n0\n1\n", "\n1\n1\n");
    let mesh = read(&format!("{GMSH_2}{NODE_DATA}{later}"));
    assert_eq!(mesh.field("heat", Location::Node).unwrap().values[0], 9.5);
    assert!(
        mesh.repairs
            .warnings
            .join("")
            .contains("the last one is kept")
    );
}

#[test]
fn physical_volume_names_become_region_names() {
    let text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 \"skin\"\n3 7 \"left knee\"\n$EndPhysicalNames\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n$Elements\n1\n1 4 2 7 1 1 2 3 4\n$EndElements\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("named.msh");
    std::fs::write(&path, text).unwrap();
    let mesh = palpate::io::read(&path).unwrap();
    assert_eq!(mesh.region_names, [(7, "left knee".to_owned())].into());
    let label = mesh.field("label", palpate::mesh::Location::Cell).unwrap();
    assert_eq!(label.values, [7.0]);
}
