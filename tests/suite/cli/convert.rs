//! `palpate convert`.

use super::{failure, folder, palpate, stdout, text};
use serde_json::Value;
use std::path::Path;

const KNEE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/knee.nrrd");

fn convert(from: &Path, to: &Path, more: &[&str]) -> String {
    let output = palpate(&[&["convert", text(from), text(to)], more].concat());
    stdout(&output);
    String::from_utf8(output.stderr).unwrap()
}

fn regions(path: &Path) -> Vec<(Value, Value, Value)> {
    let json: Value =
        serde_json::from_str(&stdout(&palpate(&["info", text(path), "--json"]))).unwrap();
    let regions = json["regions"].as_array().unwrap().iter();
    regions
        .map(|r| (r["label"].clone(), r["name"].clone(), r["tets"].clone()))
        .collect()
}

#[test]
fn mesh_formats_round_trip() {
    let folder = folder("convert");
    let first = folder.join("knee.node");
    let made = palpate(&[
        "mesh",
        KNEE,
        "--labels",
        "all",
        "--tets",
        "3000",
        "--out",
        text(&first),
    ]);
    stdout(&made);
    let expected = regions(&first);
    assert!(expected.len() > 3 && expected.iter().all(|r| r.1.is_string()));
    let mut from = first;
    for (name, flags) in [
        ("a.vtu", &[][..]),
        ("a.msh", &[]),
        ("b.msh", &["--format", "gmsh22"]),
        ("c.msh", &["--text"]),
        ("a.inp", &[]),
        ("a.mesh", &[]),
        ("a.vtk", &["--text"]),
        ("b.ele", &["--format", "tetgen"]),
    ] {
        let to = folder.join(name);
        let told = convert(&from, &to, flags);
        assert!(!told.contains("\"label\""), "{told}");
        assert_eq!(regions(&to), expected, "{name}");
        from = to;
    }
    let start = |name: &str| {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        String::from_utf8_lossy(&bytes[..bytes.len().min(21)]).into_owned()
    };
    assert!(start("a.msh").contains("4.1 1 8"));
    assert!(start("b.msh").contains("2.2 1 8"));
    assert!(start("c.msh").contains("4.1 0 8"));
}

#[test]
fn convert_writes_surfaces() {
    let folder = folder("convert_surface");
    let stl = folder.join("a.stl");
    std::fs::write(&stl, "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n").unwrap();
    let ply = folder.join("a.ply");
    convert(&stl, &ply, &[]);
    assert_eq!(palpate::io::read_surface(&ply).unwrap().triangles.len(), 1);
    let refused = |arguments: &[&str], told: &str| {
        let error = failure(&palpate(&[&["convert"], arguments].concat()));
        assert!(error.contains(told), "{error}");
    };
    let mesh = folder.join("a.msh");
    refused(&[text(&stl), text(&mesh)], "a surface, which has no tets");
    refused(&[text(&stl), text(&mesh)], "palpate mesh");
    refused(&[KNEE, text(&mesh)], "a volume");
    refused(&[text(&stl), text(&ply), "--text"], "require a mesh");
    refused(
        &[text(&stl), text(&folder.join("a.xyz"))],
        "extension \".xyz\"",
    );
    assert!(!mesh.exists());
    let missing = folder.join("no.vtu");
    refused(&[text(&missing), text(&mesh)], "no.vtu: No such file");
}
