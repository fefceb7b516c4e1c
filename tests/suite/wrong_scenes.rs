//! Errors in a scene are reported with the file, the line, the column and a remedy.

use crate::support::gpu;
use palpate::scene::{Scene, Stage};

/// A scene with an additional or modified line, the line and column in the message, and words in
/// it.
const WRONG: &[(&str, &str, &[&str])] = &[
    (
        "[mesh]\nfiel = \"a.vtu\"",
        "line 2, column 1",
        &["fiel", "file", "generate"],
    ),
    (
        "[mesh]\nfile = 3",
        "line 2, column 8",
        &["integer `3`", "path"],
    ),
    (
        "[mesh]\ngenerate = \"limp\"",
        "line 2, column 12",
        &["limp", "limb", "foot"],
    ),
    (
        "[mesh]\ngenerate = \"limb\"\ntets = \"many\"",
        "line 3, column 8",
        &["many"],
    ),
    (
        "[mesh]\nfile = \"a\"\nedge = \"2 furlongs\"",
        "line 3, column 8",
        &["furlongs"],
    ),
    (
        "[mesh]\nfile = \"a\"\nunit = \"furlong\"",
        "line 3, column 8",
        &["furlong", "cm"],
    ),
    (
        "[mesh]\nfile = \"a\"\nunit = -1",
        "line 3, column 8",
        &["positive"],
    ),
    (
        "[mesh]\nfile = \"a\"\nunit = [1]",
        "line 3, column 8",
        &["unit must be"],
    ),
    (
        "[mesh]\nfile = \"a\"\nlabels = \"some\"",
        "line 3, column 10",
        &["all"],
    ),
    (
        "[mesh]\nfile = \"a\"\nabove = [\"x=y\"]",
        "line 3",
        &["x=y"],
    ),
    (
        "[picture]\naxes = \"polar\"",
        "line 2, column 8",
        &["polar", "xyz", "anatomical"],
    ),
    (
        "[picture]\naxes = 3",
        "line 2, column 8",
        &["true", "anatomical"],
    ),
    (
        "[picture]\nlegend = \"yes\"",
        "line 2, column 10",
        &["boolean"],
    ),
    (
        "[mesh]\nfile = \"a\"\nbetween = [\"9..1\"]",
        "line 3",
        &["9..1"],
    ),
    (
        "mesh = {}\n[material]\nyoung = \"soft\"",
        "line 3, column 9",
        &["soft", "f64"],
    ),
    (
        "mesh = {}\n[material]\nyuong = 3",
        "line 3, column 9",
        &["`yuong` is neither a key"],
    ),
    (
        "mesh = {}\n[material]\ndamping_kind = \"none\"",
        "line 3, column 16",
        &["none", "axial or relative"],
    ),
    (
        "mesh = {}\n[material]\nvolume = \"mean\"",
        "line 3, column 10",
        &["mean", "per-tet or averaged"],
    ),
    (
        "mesh = {}\n[material]\nyoung = 1\n\nbone = { mass = 2 }",
        "line 5, column 8",
        &["`bone`"],
    ),
    (
        "mesh = {}\n[material]\nmodel = \"springs\"\nbone = { rigid = true }",
        "line 2, column 1",
        &["`bone` is rigid", "neo-hookean"],
    ),
    (
        "mesh = {}\n[material]\nbone = { rigid = 1 }",
        "line 3, column 8",
        &["`bone`"],
    ),
    (
        "[mesh]\nfile = \"a\"\nsplit = [[\"femur\"]]",
        "line 3, column 10",
        &["2"],
    ),
    (
        "mesh = {}\n[solver]\nnam = \"implicit\"",
        "line 3, column 1",
        &["nam", "name"],
    ),
    (
        "mesh = {}\n[solver]\nname = \"implizit\"",
        "line 3, column 8",
        &["implizit", "velocity-verlet"],
    ),
    (
        "mesh = {}\n[solver]\ngravity = [0, 1]",
        "line 3, column 11",
        &["3"],
    ),
    (
        "mesh = {}\n[[pin]]\naxis = \"w\"\nbelow = 0.1",
        "line 3, column 8",
        &["`w`", "`x`"],
    ),
    (
        "mesh = {}\n[[pin]]\naxis = \"z\"\nbelow = -0.6",
        "line 4, column 9",
        &["-0.6", "[0, 1]", "z_below"],
    ),
    (
        "mesh = {}\n[[pin]]\naxis = \"z\"\nabove = 12",
        "line 4, column 9",
        &["12", "x_above"],
    ),
    (
        "mesh = {}\n[[pin]]\nz_blow = 1",
        "line 3, column 1",
        &["z_blow", "z_below"],
    ),
    (
        "mesh = {}\n[[force]]\ntotal = [0, 0, 1]",
        "line 2",
        &["`on`"],
    ),
    (
        "mesh = {}\n[grid]\nspacing = \"wide\"",
        "line 3, column 11",
        &["a length"],
    ),
    (
        "mesh = {}\n[cage]\nkind = \"steel\"",
        "line 3, column 8",
        &["steel", "lattice"],
    ),
    (
        "mesh = {}\n[[grab]]\nat = [0, 0]\nradius = 1\npath = []",
        "line 3, column 6",
        &["3"],
    ),
    (
        "mesh = {}\n[[skin]]\nfile = \"s.ply\"\nmapping = \"tight\"",
        "line 4, column 11",
        &["tight", "auto"],
    ),
    (
        "mesh = {}\n[[skin]]\nfile = \"s.ply\"\ntransfer = \"neon\"",
        "line 4, column 12",
        &["neon", "viridis"],
    ),
    (
        "mesh = {}\n[camera]\nfov = \"wide\"",
        "line 3, column 7",
        &["wide"],
    ),
    (
        "mesh = {}\n[picture]\ntransfer = \"neon\"",
        "line 3, column 12",
        &["neon", "tissue"],
    ),
    (
        "mesh = {}\n[picture]\ntransfer = '{\"color\": []}'",
        "line 3, column 12",
        &["color", "colour"],
    ),
    (
        "mesh = {}\n[picture]\nmode = \"x-ray\"",
        "line 3, column 8",
        &["x-ray", "composite", "skin"],
    ),
    (
        "mesh = {}\n[picture]\ntraversal = \"slowly\"",
        "line 3, column 13",
        &["slowly", "vertices or planes"],
    ),
    // Under its old name.
    (
        "mesh = {}\n[picture]\nwalk = \"slowly\"",
        "line 3, column 8",
        &["slowly", "vertices or planes"],
    ),
    (
        "mesh = {}\n[picture]\ntraversal = \"planes\"\nwalk = \"planes\"",
        "line 4, column 1",
        &["[picture] has both `traversal`", "remove `walk`"],
    ),
    (
        "mesh = {}\n[picture]\nbackground = \"pink\"",
        "line 3, column 14",
        &["pink", "transparent"],
    ),
    (
        "mesh = {}\n[picture]\nsize = [640]",
        "line 3, column 8",
        &["2"],
    ),
    (
        "mesh = {}\n[picture]\nsize = [640, 480",
        "line 3",
        &["array"],
    ),
];

#[test]
fn scene_error_reports_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    for (content, place, words) in WRONG {
        std::fs::write(&path, content).unwrap();
        let said = Scene::read(&path).unwrap_err().to_string();
        assert!(said.contains("scene.toml"), "{content}\n{said}");
        // "line 1" must not match "line 12".
        let there = said
            .match_indices(place)
            .any(|(at, _)| !said[at + place.len()..].starts_with(|c: char| c.is_ascii_digit()));
        assert!(there, "{place} is wanted\n{content}\n{said}");
        for word in *words {
            assert!(said.contains(word), "{word} is wanted\n{content}\n{said}");
        }
        for noise in ["Some(", "None", "Error {", "untagged"] {
            assert!(!said.contains(noise), "{noise}: {said}");
        }
    }
}

#[test]
fn old_keys_are_noted_by_the_stage() {
    let notes = |key: &str| {
        let text = format!(
            "[mesh]\ngenerate = \"box\"\ntets = 200\n[picture]\nsize = [8, 8]\n{key} = \"planes\"\n"
        );
        let stage = Stage::new(&gpu(), &Scene::parse(&text).unwrap()).unwrap();
        stage.notes().join("\n")
    };
    let old = notes("walk");
    let note = "[picture] `walk` is now `traversal`; the old key still works";
    assert!(old.contains(note), "{old}");
    assert!(!notes("traversal").contains("old key"));
}
