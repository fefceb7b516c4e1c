//! Abaqus input files: sets, ranges, regions, and rejected input.

use crate::io::sample::Bench;
use palpate::mesh::{Location, TetMesh};
use std::fmt::Write as _;

/// Returns a row of `count` tets numbered from 1, each with its own nodes, after `elements`.
fn row(count: usize, elements: &str, sets: &str) -> String {
    let mut text = String::from("*NODE\n");
    for i in 0..count {
        for (k, corner) in ["0, 0", "1, 0", "0, 1", "0, 0"].iter().enumerate() {
            let z = if k == 3 { 1.0 } else { 0.0 };
            let x = corner.split_once(", ").unwrap();
            let x0: f64 = x.0.parse().unwrap();
            let _ = writeln!(
                text,
                "{}, {}, {}, {z}",
                4 * i + k + 1,
                x0 + 2.0 * i as f64,
                x.1
            );
        }
    }
    let _ = writeln!(text, "{elements}");
    for i in 0..count {
        let n = 4 * i;
        let _ = writeln!(
            text,
            "{}, {}, {}, {}, {}",
            i + 1,
            n + 1,
            n + 2,
            n + 3,
            n + 4
        );
    }
    text + sets
}

fn read(text: &str) -> TetMesh {
    Bench::new()
        .read("a.inp", text.as_bytes())
        .unwrap_or_else(|e| panic!("{e}"))
}

fn labels(mesh: &TetMesh) -> Vec<f64> {
    mesh.field("label", Location::Cell).unwrap().values.clone()
}

const PLAIN: &str = "*ELEMENT, TYPE=C3D4";

fn names(mesh: &TetMesh) -> Vec<&str> {
    mesh.region_names.values().map(String::as_str).collect()
}

#[test]
fn abaqus_sets_become_regions() {
    let lists = "*ELSET, ELSET=odd, GENERATE\n1, 99, 2\n*Elset, elset=even\n2,\n4\n";
    let mesh = read(&row(5, PLAIN, lists));
    assert_eq!(labels(&mesh), [1.0, 2.0, 1.0, 2.0, 1.0]);
    assert_eq!(names(&mesh), ["odd", "even"]);
    assert_eq!(mesh.repairs.warnings, Vec::<String>::new());
    // A set of all elements is ignored if there are others, and is the only region otherwise.
    let everything = "*ELSET, ELSET=all\nODD, even\n";
    assert_eq!(
        names(&read(&row(5, PLAIN, &format!("{everything}{lists}")))),
        ["odd", "even"]
    );
    let mesh = read(&row(3, "*ELEMENT, TYPE=C3D4, ELSET=all", ""));
    assert_eq!((labels(&mesh), names(&mesh)), (vec![1.0; 3], vec!["all"]));
    // Solid sections take precedence; load sets are not regions.
    let sections = "*ELSET, ELSET=loaded\n1, 2\n*ELSET, ELSET=a\n1, 2, 3\n*ELSET, ELSET=b\n4, 5\n*SOLID SECTION, ELSET=B, MATERIAL=m\n*SOLID SECTION, MATERIAL=m, ELSET=a\n";
    let mesh = read(&row(5, PLAIN, sections));
    assert_eq!(labels(&mesh), [1.0, 1.0, 1.0, 2.0, 2.0]);
    assert_eq!(names(&mesh), ["a", "b"]);
    let card = "*ELEMENT, TYPE=C3D4, ELSET=body";
    let mesh = read(&row(3, card, "*ELSET, ELSET=loaded\n1\n"));
    assert_eq!(
        names(&mesh),
        ["body"],
        "the set of *ELEMENT covers the volume"
    );
    // No kind of set covers the volume: all together, and elements in none have the label 0.
    let mesh = read(&row(
        3,
        PLAIN,
        "*ELSET, ELSET=a\n1, 2\n*ELSET, ELSET=b\n2\n",
    ));
    assert_eq!(labels(&mesh), [1.0, 1.0, 0.0]);
    assert!(mesh.repairs.warnings.join("").contains("in several sets"));
    assert!(
        read(&row(2, PLAIN, ""))
            .field("label", Location::Cell)
            .is_none()
    );
}

#[test]
fn cyclic_sets_and_huge_ranges_are_read() {
    let circle = "*ELSET, ELSET=a\nb\n1\n*ELSET, ELSET=b\na\n2\n*ELSET, ELSET=c\nnobody, 3\n*ELSET, ELSET=d, GENERATE\n1, 18446744073709551615, 3\n";
    let mesh = read(&row(4, PLAIN, circle));
    assert_eq!(labels(&mesh), [1.0, 1.0, 2.0, 3.0]);
    let mut sets = String::new();
    for i in 0..3000 {
        let _ = write!(sets, "*ELSET, ELSET=s{i}, GENERATE\n1, 9000000000, 7\n");
    }
    let error = Bench::new()
        .read("a.inp", row(3000, PLAIN, &sets).as_bytes())
        .unwrap_err();
    assert!(
        error.to_string().contains("too many repeated items"),
        "{error}"
    );
}

#[test]
fn all_abaqus_solid_types_preserve_volume() {
    let cube = "*NODE\n1, 0,0,0\n2, 1,0,0\n3, 1,1,0\n4, 0,1,0\n5, 0,0,1\n6, 1,0,1\n7, 1,1,1\n8, 0,1,1\n9, .5,.5,.5\n";
    for (kind, nodes, volume) in [
        ("C3D8R", "1,2,3,4,5,6,7,8", 1.0),
        ("SC8R", "1,2,3,4,5,6,7,8", 1.0),
        ("C3D6", "1,2,4,5,6,8", 0.5),
        ("C3D5", "1,2,3,4,5", 1.0 / 3.0),
        ("DC3D4", "1,2,4,5", 1.0 / 6.0),
        ("C3D10MH", "1,2,4,5,9,9,9,9,9,9", 1.0 / 6.0),
        ("C3D20R", "1,2,3,4,5,6,7,8,9,9,9,9,9,9,9,\n9,9,9,9,9", 1.0),
        ("C3D15", "1,2,4,5,6,8,9,9,9,9,9,9,9,9,9", 0.5),
    ] {
        let mesh = read(&format!("{cube}*ELEMENT, TYPE={kind}\n7, {nodes}\n"));
        assert!(
            (mesh.volume() - volume).abs() < 1e-12,
            "{kind}: {}",
            mesh.volume()
        );
        assert_eq!(mesh.repairs.inverted_fixed, 0, "{kind}");
    }
    let shells = "*ELEMENT, TYPE=S4R\n1, 1,2,3,4\n*ELEMENT, TYPE=UFO9\n2, 1,2\n3, 3,4\n";
    let mesh = read(&format!(
        "{cube}{shells}*ELEMENT, TYPE=C3D8\n4, 1,2,3,4,5,6,7,8\n"
    ));
    let warnings = mesh.repairs.warnings.join("\n");
    assert!(warnings.contains("1 quadrilateral dropped"), "{warnings}");
    assert!(
        warnings.contains("2 lines of elements of unknown type UFO9"),
        "{warnings}"
    );
}

#[test]
fn trailing_comma_does_not_consume_next_line() {
    let mesh = read(&row(2, "*ELEMENT, TYPE=C3D4,", ""));
    assert_eq!(mesh.tets.len(), 2);
    let mesh = read(&row(2, "*ELEMENT,\nELSET=a,\nTYPE=C3D4", ""));
    assert_eq!((mesh.tets.len(), names(&mesh)), (2, vec!["a"]));
}

#[test]
fn duplicate_element_numbers_are_counted() {
    let text = row(3, PLAIN, "").replace("\n3, 9, 10", "\n2, 9, 10");
    let mesh = read(&text);
    assert_eq!(mesh.tets.len(), 3);
    let warnings = mesh.repairs.warnings.join("");
    assert!(
        warnings.contains("1 element has the number of another"),
        "{warnings}"
    );
}

#[test]
fn abaqus_errors_state_line_and_cause() {
    let whole = row(2, PLAIN, "");
    for (from, to, expected) in [
        (
            "*NODE",
            "*INCLUDE, INPUT=mesh.inp\n*NODE",
            "line 1: *INCLUDE names the file mesh.inp",
        ),
        ("*NODE\n", "*NODE, INPUT=n.txt\n", "reads the file n.txt"),
        ("*NODE\n", "*NODE, SYSTEM=C\n", "coordinate system C"),
        ("*NODE\n", "*NGEN\n1, 9\n*NODE\n", "*NGEN is not supported"),
        (
            "\n2, 1, 0, 0",
            "\n1, 1, 0, 0",
            "line 3: node 1 is defined twice",
        ),
        (
            "\n2, 1, 0, 0",
            "\n2, one, 0, 0",
            "line 3: x of node 2 is \"one\"",
        ),
        (
            "\n2, 1, 0, 0",
            "\ntwo, 1, 0, 0",
            "line 3: expected the number of a node, found \"two\"",
        ),
        (
            "1, 1, 2, 3, 4\n",
            "1, 1, 2, 3, 44\n",
            "element 1 refers to undefined node 44",
        ),
        (
            "1, 1, 2, 3, 4\n",
            "1, 1, 2, 3, 4, 5\n",
            "element 1 lists more than 4 nodes",
        ),
        (
            "2, 5, 6, 7, 8\n",
            "2, 5, 6, 7\n",
            "unexpected end of file: element 2 before this line lists 3 of 4 nodes",
        ),
        (
            "2, 5, 6, 7, 8\n",
            "2, 5, 6, 7\n*STEP\n",
            "line 13: element 2",
        ),
        (", TYPE=C3D4", "", "line 10: *ELEMENT has no TYPE"),
        ("*ELEMENT", "*ELSET\n1\n*ELEMENT", "*ELSET has no name"),
        (
            "*ELEMENT",
            "*ELSET, ELSET=a, GENERATE\n1, 5, 0\n*ELEMENT",
            "FIRST, LAST, STEP",
        ),
        (
            "*ELEMENT",
            "*PART, NAME=b\n*NODE\n1, 0, 0, 0\n*ELEMENT",
            "element 1 of part \"b\" refers to undefined node 2",
        ),
        ("TYPE=C3D4", "TYPE=UFO9", "mesh has no cells"),
    ] {
        let text = whole.replacen(from, to, 1);
        match Bench::new().read("a.inp", text.as_bytes()) {
            Ok(_) => panic!("{to} is accepted"),
            Err(e) => {
                let error = e.to_string();
                assert!(
                    error.contains("a.inp") && error.contains(expected),
                    "expected {expected:?} in {error:?}"
                );
            }
        }
    }
    for text in ["*HEADING\nx\n", "*NODE\n1, 0, 0, 0\n", "*HEADING,"] {
        assert!(Bench::new().read("a.inp", text.as_bytes()).is_err());
    }
}
