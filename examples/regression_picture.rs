//! A rendering as a regression test in CI: render, compare with the stored image, fail beyond a
//! tolerance. The first run creates the image.
//!
//!     cargo run --release --example regression_picture [-- SCENE.toml GOLDEN.png]

use palpate::prelude::*;
use palpate::render::{Image, ImageDifference};
use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> palpate::Result<ExitCode> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/data/scenes");
    let scene = arguments
        .next()
        .unwrap_or(format!("{scenes}/bar.toml").into());
    let golden = arguments.next().unwrap_or("golden.png".into());

    let mut scene = Scene::read(scene)?;
    scene.picture.size = Some([200, 150]);
    let mut stage = Stage::new(&Gpu::new()?, &scene)?;
    stage.run(stage.steps(), &mut |_| {})?;
    if !golden.exists() {
        stage.save(&golden)?;
        println!("created {}", golden.display());
        return Ok(ExitCode::SUCCESS);
    }
    let drawn = golden.with_extension("new.png");
    stage.save(&drawn)?;
    let difference = ImageDifference::between(
        &Image::read_for_comparison(&golden)?,
        &Image::read_for_comparison(&drawn)?,
    )?;
    println!("{difference}");
    Ok(match difference.within(0.5 / 255.0, 2.0 / 255.0) {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    })
}
