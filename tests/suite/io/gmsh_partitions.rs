//! Gmsh files partitioned by Gmsh, names of physical groups, and damaged data.

use crate::io::sample::Bench;
use palpate::mesh::{Location, TetMesh};

fn read(text: &[u8]) -> TetMesh {
    Bench::new()
        .read("a.msh", text)
        .unwrap_or_else(|e| panic!("{e}"))
}

const NAMES: &str = "$PhysicalNames\n4\n2 5 \"base\"\n 3  11   \"soft,  tissue; a/b\"  \n3\t22\t\"bone\"\n3 30 \"_part{1}_physical{11}\"\n$EndPhysicalNames\n";

/// Two volumes, of which the first is divided among two partitions; one entity of a partition has a
/// group that Gmsh made for it, and ghost cells belong to entity 9.
const ENTITIES: &str = "$Entities\n0 0 0 2\n1 0 0 0 1 1 1 1 11 0\n2 0 0 0 1 1 1 1 22 0\n$EndEntities\n$PartitionedEntities\n2\n1\n9 1\n0 0 1 3\n7 3 1 2 1 2 0 0 0 1 1 1 0 0\n3 3 1 1 1 0 0 0 1 1 1 2 30 11 1 -7\n4 3 1 1 2 0 0 0 1 1 1 0 0\n5 3 2 1 2 0 0 0 1 1 1 1 22 0\n$EndPartitionedEntities\n";

const NODES: &str = "$Nodes\n1 6 1 6\n3 3 0 6\n1\n2\n3\n4\n5\n6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n-1 0 0\n0 -1 0\n$EndNodes\n";

const ELEMENTS: &str = "$Elements\n3 3 1 3\n3 3 4 1\n1 1 2 3 4\n3 4 4 1\n2 1 3 5 4\n3 5 4 1\n3 1 5 6 4\n$EndElements\n";

#[test]
fn partitions_keep_physical_groups() {
    let head = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n";
    let mesh = read(format!("{head}{NAMES}{ENTITIES}{NODES}{ELEMENTS}").as_bytes());
    let values = |name: &str| &mesh.field(name, Location::Cell).unwrap().values;
    assert_eq!(values("label"), &[11.0, 11.0, 22.0]);
    assert_eq!(values("gmsh:physical"), &[11.0, 11.0, 22.0]);
    assert_eq!(values("gmsh:geometrical"), &[1.0, 1.0, 2.0]);
    let names = [
        (11, "soft,  tissue; a/b".to_owned()),
        (22, "bone".to_owned()),
    ];
    assert_eq!(mesh.region_names, names.into());
    assert_eq!(mesh.repairs.warnings, Vec::<String>::new());
}

#[test]
fn groups_of_partitions_give_way_in_version_2() {
    // An element in two groups is listed twice; numbers of partitions follow the groups.
    let text = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{NAMES}$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 -1 0 0\n$EndNodes\n\
        $Elements\n3\n1 4 4 30 1 1 1 1 2 3 4\n1 4 4 11 1 1 1 1 2 3 4\n2 4 5 22 2 2 2 -1 1 3 5 4\n$EndElements\n"
    );
    let mesh = read(text.as_bytes());
    let label = mesh.field("label", Location::Cell).unwrap();
    assert_eq!(label.values, [11.0, 22.0]);
    assert_eq!(mesh.region_names.len(), 2);
}

#[test]
fn damaged_entities_are_rejected() {
    let head = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n";
    for (from, to, expected) in [
        (
            "2\n1\n9 1",
            "2\n99999\n9 1",
            "the number of ghost entities is 99999",
        ),
        (
            "4 3 1 1 2",
            "4 3 1 99999 2",
            "the number of partitions of entity 4 is 99999",
        ),
        ("0 0 1 3", "0 0 1 4", "expected an entity's tag"),
    ] {
        assert!(ENTITIES.contains(from), "{from}");
        let entities = ENTITIES.replacen(from, to, 1);
        let text = format!("{head}{entities}{NODES}{ELEMENTS}");
        let error = Bench::new().read("a.msh", text.as_bytes()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
}

#[test]
fn damaged_data_costs_that_field() {
    let data = |name: &str, last: &str| {
        format!(
            "$NodeData\n1\n\"{name}\"\n1\n0\n3\n0\n1\n6\n1 1\n2 2\n3 3\n4 4\n5 5\n6 {last}\n$EndNodeData\n"
        )
    };
    let head = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n";
    let (bad, good) = (data("bad", "?"), data("good", "6"));
    let mesh = read(format!("{head}{NODES}{ELEMENTS}{bad}{good}").as_bytes());
    assert!(mesh.field("bad", Location::Node).is_none());
    assert!(mesh.field("good", Location::Node).is_some());
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(
        warnings.contains("section $NodeData skipped: line") && warnings.contains("in \"bad\""),
        "{warnings}"
    );
}
