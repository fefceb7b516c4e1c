//! The sample mesh in MSH 1 and 4.0 and as an Abaqus input file, encoded independently of the
//! library.

use crate::io::sample::{Fixture, Sample};
use palpate::mesh::{Field, Location, ScalarType};
use std::fmt::Write as _;

/// Returns all fixtures.
pub fn all() -> Vec<Fixture> {
    vec![
        gmsh_1(),
        gmsh_40(false, false),
        gmsh_40(true, false),
        gmsh_40(true, true),
        abaqus(),
    ]
}

fn whole(name: &str, location: Location, scalar_type: ScalarType, values: &[f64]) -> Field {
    Field {
        name: name.into(),
        location,
        components: 1,
        values: values.to_vec(),
        scalar_type,
    }
}

/// Returns the content of both Gmsh files: the mesh, in physical group 7.
fn with_groups(sample: &Sample) -> palpate::mesh::TetMesh {
    let mut expected = sample.tets();
    for (name, values) in [
        ("gmsh:physical", [7.0, 7.0]),
        ("gmsh:geometrical", [1.0, 3.0]),
    ] {
        let field = whole(name, Location::Cell, ScalarType::I32, &values);
        expected.set_field(field).unwrap();
    }
    expected
}

/// MSH 1. Nodes have tags 3, 6, 9 ..., elements 10, 12, ...
fn gmsh_1() -> Fixture {
    let sample = Sample::new().with_fields(|_| false);
    let mut file = String::from("$NOD\n5\n");
    for (i, p) in sample.nodes.iter().enumerate() {
        let _ = writeln!(file, "{} {} {} {}", 3 * i + 3, p.x, p.y, p.z);
    }
    file += "$ENDNOD\n$ELM\n3\n";
    for (i, (kind, nodes)) in sample.cells.iter().enumerate() {
        let (kind, group) = if *kind == 10 { (4, 7) } else { (2, 0) };
        let list: Vec<String> = nodes.iter().map(|v| (3 * v + 3).to_string()).collect();
        let (tag, count) = (10 + 2 * i, nodes.len());
        let _ = writeln!(
            file,
            "{tag} {kind} {group} {} {count} {}",
            i + 1,
            list.join(" ")
        );
    }
    file += "$ENDELM\n";
    Fixture::new("v1.msh", file.into_bytes(), with_groups(&sample))
}

/// MSH 4.0, whose blocks store the entity before the dimension, and each tag with its item.
fn gmsh_40(binary: bool, big: bool) -> Fixture {
    let sample = Sample::new().with_fields(|_| false);
    let mut file = format!("$MeshFormat\n4.0 {} 8\n", u8::from(binary)).into_bytes();
    let int = |file: &mut Vec<u8>, values: &[i32]| {
        for v in values {
            match (binary, big) {
                (false, _) => file.extend(format!("{v} ").into_bytes()),
                (true, true) => file.extend(v.to_be_bytes()),
                (true, false) => file.extend(v.to_le_bytes()),
            }
        }
    };
    let size = |file: &mut Vec<u8>, values: &[u64]| {
        for v in values {
            match (binary, big) {
                (false, _) => file.extend(format!("{v} ").into_bytes()),
                (true, true) => file.extend(v.to_be_bytes()),
                (true, false) => file.extend(v.to_le_bytes()),
            }
        }
    };
    let real = |file: &mut Vec<u8>, values: &[f64]| {
        for v in values {
            match (binary, big) {
                (false, _) => file.extend(format!("{v} ").into_bytes()),
                (true, true) => file.extend(v.to_be_bytes()),
                (true, false) => file.extend(v.to_le_bytes()),
            }
        }
    };
    if binary {
        int(&mut file, &[1]);
        file.push(b'\n');
    }
    file.extend(b"$EndMeshFormat\n$Entities\n");
    size(&mut file, &[1, 0, 1, 2]);
    // A point has a bounding box in 4.0, of six numbers.
    int(&mut file, &[1]);
    real(&mut file, &[0.0; 6]);
    size(&mut file, &[0]);
    for (tag, group) in [(2, None), (1, Some(7)), (3, Some(7))] {
        int(&mut file, &[tag]);
        real(&mut file, &[0.0; 6]);
        size(&mut file, &[group.iter().len() as u64]);
        group.iter().for_each(|g| int(&mut file, &[*g]));
        size(&mut file, &[1]);
        int(&mut file, &[1]);
    }
    file.extend(b"\n$EndEntities\n$Nodes\n");
    size(&mut file, &[2, 5]);
    for (parametric, nodes) in [(0, 0..2), (1, 2..5)] {
        int(&mut file, &[1, 3, parametric]);
        size(&mut file, &[nodes.len() as u64]);
        for i in nodes {
            int(&mut file, &[3 * i as i32 + 3]);
            real(&mut file, &sample.nodes[i].to_array());
            if parametric == 1 {
                real(&mut file, &[0.25; 3]);
            }
        }
    }
    file.extend(b"\n$EndNodes\n$Elements\n");
    size(&mut file, &[3, 3]);
    for (i, (kind, nodes)) in sample.cells.iter().enumerate() {
        let (dimension, kind) = if *kind == 10 { (3, 4) } else { (2, 2) };
        int(&mut file, &[1 + i as i32, dimension, kind]);
        size(&mut file, &[1]);
        int(&mut file, &[10 + 2 * i as i32]);
        let nodes: Vec<i32> = nodes.iter().map(|v| 3 * *v as i32 + 3).collect();
        int(&mut file, &nodes);
    }
    file.extend(b"\n$EndElements\n");
    let name = format!("v4.0_binary{binary}_big{big}.msh");
    Fixture::new(name, file, with_groups(&sample))
}

/// Abaqus, with the usual content other than the mesh.
fn abaqus() -> Fixture {
    let sample = Sample::new().with_fields(|_| false);
    let mut file = String::from(
        "** a comment\n*Heading\n the sample\n*Part, name=Body\n*Node, nset=Everything\n",
    );
    for (i, p) in sample.nodes.iter().enumerate() {
        let _ = writeln!(file, "  {}, {}, {},{}", 3 * i + 3, p.x, p.y, p.z);
    }
    let nodes = |cell: usize| {
        let list = sample.cells[cell].1.iter();
        list.map(|v| (3 * v + 3).to_string())
            .collect::<Vec<_>>()
            .join(", ")
    };
    let _ = writeln!(file, "*Element, type=C3D4, elset=left\n10, {}", nodes(0));
    // A file that ends from here on cannot be told from a complete one.
    let end = file.len() - 1;
    // The nodes of an element may continue on the next line, and so may a keyword.
    let _ = write!(
        file,
        "*ELEMENT, TYPE=S3\n12, {}\n*Element, elset=\"right side\",\n  type=c3d4h\n14,\n{}\n",
        nodes(1),
        nodes(2)
    );
    file += "*Nset, nset=ends, generate\n 3, 15, 12\n*Nset, nset=Same\n ends\n*End Part\n";
    file += "*Assembly\n*Instance, name=Body-1, part=Body\n*End Instance\n*Node\n 1, 9, 9, 9\n*Nset, nset=point\n1\n*End Assembly\n";
    file += "*Material, name=Tissue\n*Elastic\n 30000., 0.45\n*Step\n*Static\n0.1, 1.\n*End Step\n";
    let mut expected = sample.tets();
    let label = whole("label", Location::Cell, ScalarType::I32, &[1.0, 2.0]);
    expected.set_field(label).unwrap();
    for name in ["nset:ends", "nset:Same"] {
        let ends = [1.0, 0.0, 0.0, 0.0, 1.0];
        let field = whole(name, Location::Node, ScalarType::U8, &ends);
        expected.set_field(field).unwrap();
    }
    let may_end = (end..file.len()).collect();
    let mut fixture = Fixture::new("sample.inp", file.into_bytes(), expected);
    fixture.may_end = may_end;
    fixture
}
