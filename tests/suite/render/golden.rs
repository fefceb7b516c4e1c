//! Small pictures stored under `tests/golden`, to detect changes. Set `PALPATE_BLESS=1` to rewrite
//! them, and inspect them before committing.

use crate::render::common::*;
use palpate::bench::{GOLDEN_PICTURES, golden_picture};
use palpate::render::*;
use std::path::PathBuf;

fn golden(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden")).join(name)
}

/// Compares a picture with the golden one, with the metric of `palpate compare`.
fn hold(image: &Image, name: &str) {
    let path = golden(name);
    if std::env::var_os("PALPATE_BLESS").is_some() {
        image.save(&path).unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let drawn = folder.path().join(name);
    image.save(&drawn).unwrap();
    let difference = apart(&drawn, &path);
    assert!(
        difference.within(1.0 / 255.0, 6.0 / 255.0),
        "{name}: {difference}"
    );
}

fn apart(a: &std::path::Path, b: &std::path::Path) -> ImageDifference {
    let open =
        |p: &std::path::Path| Image::read_for_comparison(p).unwrap_or_else(|e| panic!("{e}"));
    ImageDifference::between(&open(a), &open(b)).unwrap()
}

#[test]
fn images_match_golden_files() {
    let gpu = gpu();
    for name in GOLDEN_PICTURES {
        let image = golden_picture(&gpu, name).unwrap();
        hold(&image, &format!("{name}.png"));
    }
}

#[test]
fn comparison_detects_different_image() {
    let difference = apart(&golden("limb-bone.png"), &golden("limb-skin.png"));
    assert!(
        !difference.within(5.0 / 255.0, 20.0 / 255.0),
        "{difference}"
    );
    let same = apart(&golden("limb-bone.png"), &golden("limb-bone.png"));
    assert!(same.within(0.0, 0.0), "{same}");
}

#[test]
fn exr_preserves_floats_and_png_rounds() {
    let folder = tempfile::tempdir().unwrap();
    let image = Image {
        size: [2, 1],
        channels: 4,
        values: vec![0.1, 0.25, 3.5, 1.0, 0.2, 0.0, 0.1, 0.5],
    };
    let exr = folder.path().join("a.exr");
    image.save(&exr).unwrap();
    let back = image::open(&exr).unwrap().to_rgba32f();
    assert_eq!(back.into_raw(), image.values);
    let png = folder.path().join("a.png");
    image
        .save_as(&png, Background::White, BitDepth::Eight)
        .unwrap();
    assert_eq!(
        image::open(&png).unwrap().to_rgb8().into_raw(),
        [26, 64, 255, 179, 128, 153]
    );
    image
        .save_as(&png, Background::Transparent, BitDepth::Sixteen)
        .unwrap();
    let deep = image::open(&png).unwrap().to_rgba16().into_raw();
    assert_eq!(deep[4..], [26214, 0, 13107, 32768]);
    let length = Image {
        size: [2, 1],
        channels: 1,
        values: vec![1.5, 3.0],
    };
    length.save(&exr).unwrap();
    assert_eq!(
        image::open(&exr).unwrap().to_rgb32f().into_raw(),
        [1.5, 1.5, 1.5, 3.0, 3.0, 3.0]
    );
    assert!(image.save(folder.path().join("a.jpg")).is_err());
}
