//! Parsing of files in memory.

use crate::io::sample::bits;
use palpate::io;

#[test]
fn parsing_bytes_matches_reading_files() {
    for fixture in crate::io::encode::all() {
        let parsed = io::parse(&fixture.name, &fixture.bytes);
        if fixture.second.is_some() {
            let error = parsed.unwrap_err().to_string();
            assert!(error.contains("two files"), "{error}");
            continue;
        }
        let mesh = parsed.unwrap_or_else(|e| panic!("{}: {e}", fixture.name));
        assert_eq!(bits(&mesh), bits(&fixture.expected), "{}", fixture.name);
    }
}

#[test]
fn parse_errors_state_given_name() {
    for (name, bytes, expected) in [
        ("some/a.vtu", &b"hello"[..], "some/a.vtu: no <VTKFile>"),
        ("a.vtu", b" \n", "a.vtu: file is empty"),
        (
            "a",
            b"hello",
            "a: unknown format: neither the content nor the extension",
        ),
    ] {
        let error = io::parse(name, bytes).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn surfaces_and_volumes_parse_from_bytes() {
    let stl = "\u{feff}solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    let surface = io::parse_surface("a.stl", stl.as_bytes()).unwrap();
    assert_eq!(surface.triangles.len(), 1);
    let error = io::parse_surface("a.stl", b"").unwrap_err().to_string();
    assert!(error.contains("a.stl: file is empty"), "{error}");
    let nrrd = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: text\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace: RAS\n\n1 2 3 4 5 6 7 8\n";
    let volume = io::parse_volume("a.nrrd", nrrd.as_bytes()).unwrap();
    assert_eq!(volume.size, [2, 2, 2]);
    let apart = nrrd.replace("\n\n1 2 3 4 5 6 7 8", "\ndata file: voxels.raw\n");
    let error = io::parse_volume("a.nhdr", apart.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("voxels.raw") && error.contains("another file"),
        "{error}"
    );
}
