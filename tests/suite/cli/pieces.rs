//! `palpate convert` and `mesh` in pieces.

use super::{failure, folder, palpate, stdout, text};
use palpate::io;
use std::path::Path;

#[test]
fn pieces_are_written_and_read() {
    let folder = folder("pieces_cli");
    let (one, index) = (folder.join("limb.vtu"), folder.join("limb.pvtu"));
    let limb = palpate::generate::by_name("limb", Some(2_000)).unwrap();
    io::write(&one, &limb).unwrap();
    stdout(&palpate(&[
        "convert",
        text(&one),
        text(&index),
        "--pieces",
        "3",
    ]));
    let info = |path: &Path| {
        let told = stdout(&palpate(&["info", text(path), "--json"]));
        let mut json: serde_json::Value = serde_json::from_str(&told).unwrap();
        json.as_object_mut()
            .unwrap()
            .retain(|key, _| key != "file" && key != "fields");
        json
    };
    assert_eq!(info(&index), info(&one));
    let back = folder.join("back.vtu");
    stdout(&palpate(&["convert", text(&index), text(&back)]));
    assert_eq!(io::read(&back).unwrap().tets, limb.tets);
    for wrong in [
        vec!["convert", text(&one), text(&index)],
        vec!["convert", text(&one), text(&back), "--pieces", "2"],
        vec!["mesh", text(&one), "--out", text(&index)],
    ] {
        let told = failure(&palpate(&wrong));
        assert!(told.contains("--pieces"), "{told}");
    }
}
