//! `palpate render --pick`: the pick at a pixel, as JSON.

use crate::cli::*;

#[test]
fn pick_prints_json() {
    let folder = folder("pick");
    let scene = folder.join("cube.toml");
    let text_of_scene = r#"
        [mesh]
        generate = "cube"
        tets = 400
        [picture]
        size = [60, 40]
        [camera]
        eye = [0.5, -3.0, 0.5]
        look_at = [0.5, 0.5, 0.5]
        up = [0, 0, 1]
        orthographic = 2.0
    "#;
    std::fs::write(&scene, text_of_scene).unwrap();
    let pick = |pixel: &str| palpate(&["render", text(&scene), "--pick", pixel]);
    let json =
        |pixel: &str| -> serde_json::Value { serde_json::from_str(&stdout(&pick(pixel))).unwrap() };
    let found = json("35,17");
    // A pixel is 1/20 wide; its centre is 5.5 and 2.5 pixels from that of the picture.
    let expected = [0.5 + 5.5 / 20.0, 0.0, 0.5 + 2.5 / 20.0];
    for (k, expected) in expected.into_iter().enumerate() {
        let at = found["point"][k].as_f64().unwrap();
        assert!((at - expected).abs() < 1e-3, "{found}");
    }
    assert!((found["distance"].as_f64().unwrap() - 3.0).abs() < 1e-5);
    assert!(found["tet"].is_u64() && found["node"].is_u64(), "{found}");
    assert!(json("2,2").is_null());
    let said = failure(&pick("60,70"));
    assert!(said.contains("60 × 40"), "{said}");
    assert_eq!(pick("here").status.code(), Some(2));
}
