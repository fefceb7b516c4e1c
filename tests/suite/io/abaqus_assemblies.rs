//! Abaqus assemblies: parts, instances, and included files.

use crate::io::sample::Bench;
use glam::DVec3;
use palpate::mesh::{Location, TetMesh};

fn read(text: &str) -> TetMesh {
    Bench::new()
        .read("a.inp", text.as_bytes())
        .unwrap_or_else(|e| panic!("{e}"))
}

fn error(text: &str) -> String {
    match Bench::new().read("a.inp", text.as_bytes()) {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(e) => e.to_string(),
    }
}

/// Returns a part of one tet with edges of length `edge` at the origin, and `sets`.
fn part(name: &str, edge: f64, sets: &str) -> String {
    format!(
        "*Part, name={name}\n*Node\n1, 0, 0, 0\n2, {edge}, 0, 0\n3, 0, {edge}, 0\n4, 0, 0, {edge}\n\
        *Element, type=C3D4\n1, 1, 2, 3, 4\n{sets}*End Part\n"
    )
}

fn assembly(instances: &[(&str, &str, &str)], sets: &str) -> String {
    let mut text = String::from("*Assembly, name=All\n");
    for (name, part, place) in instances {
        text += &format!("*Instance, name={name}, part={part}\n{place}*End Instance\n");
    }
    text + sets + "*End Assembly\n"
}

fn names(mesh: &TetMesh) -> Vec<&str> {
    mesh.region_names.values().map(String::as_str).collect()
}

fn labels(mesh: &TetMesh) -> &[f64] {
    &mesh.field("label", Location::Cell).unwrap().values
}

#[test]
fn abaqus_instance_is_translated_then_rotated() {
    let text = part("p", 1.0, "");
    let moved = read(&(text.clone() + &assembly(&[("p-1", "P", "100., 0., 0.\n")], "")));
    assert_eq!(moved.nodes[1], DVec3::new(101.0, 0.0, 0.0));
    assert_eq!(moved.repairs.warnings, Vec::<String>::new());
    // A quarter turn about the axis from (0, 1, 0) along z, after a translation.
    let turned = assembly(&[("p-1", "p", "1, 0, 0\n0, 1, 0, 0, 1, 7, 90.\n")], "");
    let turned = read(&(text.clone() + &turned));
    let expected = [
        DVec3::new(1.0, 2.0, 0.0),
        DVec3::new(1.0, 3.0, 0.0),
        DVec3::new(0.0, 2.0, 0.0),
        DVec3::new(1.0, 2.0, 1.0),
    ];
    for (found, expected) in turned.nodes.iter().zip(expected) {
        assert!(found.distance(expected) < 1e-12, "{found} {expected}");
    }
    assert!((turned.volume() - 1.0 / 6.0).abs() < 1e-12);
}

#[test]
fn abaqus_part_with_several_instances_is_copied() {
    let sets = "*Nset, nset=tip\n4\n*Elset, elset=body\n1\n";
    let places = [
        ("a", "p", ""),
        ("b", "p", "0, 0, 5\n"),
        ("c", "p", "0, 0, 9\n"),
    ];
    let of_assembly = "*Elset, elset=last, instance=c\n1\n*Nset, nset=top, instance=c\n4,\n\
        *Nset, nset=ends\na.4, c.tip\n*Nset, nset=none\n1, 2\n";
    let mesh = read(&(part("p", 1.0, sets) + &assembly(&places, of_assembly)));
    assert_eq!((mesh.nodes.len(), mesh.tets.len()), (12, 3));
    assert_eq!(mesh.nodes[11], DVec3::new(0.0, 0.0, 10.0));
    // The set of the part covers all; that of the assembly is the more special.
    let node = |name: &str| {
        let field = mesh.field(name, Location::Node).unwrap();
        let set: Vec<usize> = (0..12).filter(|i| field.values[*i] == 1.0).collect();
        set
    };
    assert_eq!(node("nset:tip"), [3, 7, 11]);
    assert_eq!(node("nset:top"), [11]);
    assert_eq!(node("nset:ends"), [3, 11]);
    assert!(mesh.field("nset:none", Location::Node).is_none());
}

#[test]
fn abaqus_parts_share_numbers_and_become_regions() {
    let two = [("u-1", "upper", "0, 0, 4\n"), ("l-1", "lower", "")];
    let mesh = read(
        &(part("upper", 1.0, "")
            + &part("lower", 2.0, "*Elset, elset=all\n1\n")
            + &assembly(&two, "")),
    );
    assert!((mesh.volume() - 9.0 / 6.0).abs() < 1e-12);
    assert_eq!(names(&mesh), ["upper", "all"]);
    assert_eq!(labels(&mesh).len(), 2);
    // Sets of one name in two parts are two regions.
    let set = "*Elset, elset=Set-1\n1\n*Solid Section, elset=Set-1, material=m\n,\n";
    let text = part("upper", 1.0, set) + &part("lower", 2.0, set);
    let mesh = read(&(text.clone() + &assembly(&two, "")));
    assert_eq!(names(&mesh), ["upper.Set-1", "lower.Set-1"]);
    // Without an assembly all parts are read.
    let mesh = read(&text);
    assert_eq!(mesh.tets.len(), 2);
    assert!(mesh.repairs.warnings.join("").contains("no *ASSEMBLY"));
    // A part outside of the assembly is not.
    let mesh = read(&(text.clone() + &assembly(&two[1..], "")));
    assert_eq!(mesh.tets.len(), 1);
    let warnings = mesh.repairs.warnings.join("");
    assert!(warnings.contains("\"upper\" skipped"), "{warnings}");
}

#[test]
fn abaqus_instance_with_its_own_mesh_is_moved() {
    let text = "*Part, name=p\n*End Part\n*Assembly, name=a\n*Instance, name=i, part=p\n0, 0, 3\n\
        *Node\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n*Element, type=C3D4, elset=e\n\
        1, 1, 2, 3, 4\n*End Instance\n*Node\n1, 7, 7, 7\n*Nset, nset=reference\n1\n*End Assembly\n";
    let mesh = read(text);
    assert_eq!(mesh.nodes.len(), 4);
    assert_eq!(mesh.nodes[0], DVec3::new(0.0, 0.0, 3.0));
    assert_eq!(names(&mesh), ["e"]);
}

#[test]
fn abaqus_assembly_errors_state_instance_and_cause() {
    let text = part("p", 1.0, "");
    for (instance, expected) in [
        (
            ("i", "q", ""),
            "instance \"i\" is of part \"q\", which the file does not define",
        ),
        (
            ("i", "p", "1, x, 0\n"),
            "line 12: position of instance \"i\" has \"x\"",
        ),
        (("i", "p", "1, nan, 0\n"), "expected a number"),
        (
            ("i", "p", "0, 0, 0\n1, 1, 1, 1, 1, 1, 30\n"),
            "an axis of length 0",
        ),
        (("i", "p", "1, 2, 3, 4, 5\n"), "a line of 5 numbers"),
    ] {
        let error = error(&(text.clone() + &assembly(&[instance], "")));
        assert!(
            error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
    let undefined = part("p", 1.0, "").replace("1, 1, 2, 3, 4", "1, 1, 2, 3, 5");
    let error = error(&undefined);
    assert!(error.contains("element 1 of part \"p\" refers to undefined node 5"));
}

#[test]
fn abaqus_copies_beyond_any_memory_are_refused() {
    let mut nodes = String::from("*Part, name=p\n*Node\n");
    for i in 1..=10_000 {
        nodes += &format!("{i},{i}\n");
    }
    let mut text = nodes + "*Element, type=C3D4\n1, 1, 2, 3, 4\n*End Part\n*Assembly\n";
    for _ in 0..2000 {
        text += "*Instance, part=p\n*End Instance\n";
    }
    let error = error(&text);
    assert!(error.contains("20002000 nodes and elements"), "{error}");
}

const NODES: &str = "1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n";

#[test]
fn abaqus_included_files_are_inserted() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("parts")).unwrap();
    std::fs::write(bench.path("parts/nodes.txt"), NODES).unwrap();
    std::fs::write(
        bench.path("parts/all.inp"),
        "** all\n*NODE\n*INCLUDE,\nINPUT=nodes.txt\n",
    )
    .unwrap();
    std::fs::write(bench.path("elements.txt"), "1, 1, 2, 3, 4").unwrap();
    for text in [
        "*INCLUDE, INPUT=\"parts/all.inp\"\n*ELEMENT, TYPE=C3D4, INPUT=elements.txt, ELSET=e\n",
        "*Heading\nx\n*Node, input=parts\\nodes.txt\n*Element, type=C3D4, elset=e\n*Include, input=elements.txt\n",
    ] {
        let mesh = bench.read("a.inp", text.as_bytes()).unwrap();
        assert_eq!((mesh.nodes.len(), mesh.tets.len()), (4, 1));
        assert_eq!(names(&mesh), ["e"]);
        assert_eq!(mesh.repairs.warnings, Vec::<String>::new());
    }
    // A path of another machine: the file beside this one.
    let far =
        format!("*NODE\n{NODES}*ELEMENT, TYPE=C3D4\n*INCLUDE, INPUT=/far/away/elements.txt\n");
    assert_eq!(bench.read("a.inp", far.as_bytes()).unwrap().tets.len(), 1);
    let surface = palpate::io::read_surface(bench.path("a.inp"));
    assert!(surface.is_err(), "a tet has no triangles of its own");
}

#[test]
fn abaqus_include_errors_state_file_and_line() {
    let bench = Bench::new();
    std::fs::write(bench.path("bad.inp"), "*NODE\n1, 0, 0, 0\n2, x, 0, 0\n").unwrap();
    std::fs::write(bench.path("none.inp"), "** nothing\n").unwrap();
    std::fs::write(bench.path("loop.inp"), "*INCLUDE, INPUT=a.inp\n").unwrap();
    for (text, expected) in [
        (
            "*HEADING\n*INCLUDE, INPUT=bad.inp\n",
            "bad.inp, line 3: x of node 2",
        ),
        (
            "*HEADING\n*INCLUDE, INPUT=gone.inp\n",
            "line 2: *INCLUDE names the file gone.inp, which cannot be read",
        ),
        (
            "*HEADING\n*INCLUDE, INPUT=loop.inp\n",
            "loop.inp, line 1: *INCLUDE names the file a.inp, which includes itself",
        ),
        (
            "*NODE, INPUT=bad.inp\n*ELEMENT\n",
            "bad.inp, line 3: x of node 2",
        ),
        (
            "*INCLUDE, INPUT=none.inp\n*NODE\n1, y\n",
            "line 3: x of node 1",
        ),
    ] {
        let error = bench
            .read("a.inp", text.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(expected),
            "expected {expected:?} in {error:?}"
        );
    }
    let memory = palpate::io::parse("a.inp", b"*INCLUDE, INPUT=x.inp\n").unwrap_err();
    assert!(
        memory.to_string().contains("single file in memory"),
        "{memory}"
    );
}
