//! `palpate demo`: the limb phantom bends under load, with its bones visible inside, and a
//! fingertip presses on a breast with a lump.

use super::{Outcome, print_json, print_notes, progress};
use clap::Args;
use palpate::gpu::Gpu;
use palpate::io::PvdSeries;
use palpate::press::PressOptions;
use palpate::render::{Animation, Background, Image};
use palpate::scene::{Scene, Stage};
use palpate::{Error, Result};
use serde_json::json;
use std::path::PathBuf;

/// The scene of the demo, embedded in the program.
const SCENE: &str = include_str!("../../data/scenes/limb.toml");
/// Its transfer function, in Hounsfield units.
const TRANSFER: &str = include_str!("../../data/limb.json");
/// Frame rate of the animation, 1/s.
const FPS: f64 = 16.0;
/// The scene of the press, embedded in the program.
const PRESSED_SCENE: &str = include_str!("../../data/scenes/breast.toml");
/// Factor by which the first mesh of the press has fewer tets than the limb, and their minimum number:
/// coarser ones do not have the shape of a breast.
const PRESS_COARSENING: usize = 5;
const MIN_PRESS_TETS: usize = 8_000;

/// Arguments of `demo`.
#[derive(Args)]
pub struct DemoArguments {
    /// Write the output to this folder
    #[arg(long, short, default_value = "out/demo")]
    out: PathBuf,
    /// Set the approximate number of tets of the limb; the first mesh of the press has a fifth of them
    #[arg(long, default_value_t = 100_000)]
    tets: usize,
    /// Set the number of frames of the animation
    #[arg(long, default_value_t = 24)]
    frames: u32,
    /// Set the picture size in pixels, WIDTHxHEIGHT
    #[arg(long, default_value = "800x600", value_parser = super::flag_values::size)]
    size: [u32; 2],
    /// Refine the mesh of the press until the error of its largest force is at most this share of it
    #[arg(long, value_name = "PERCENT", default_value = "5%", value_parser = super::refinement::percent)]
    within: f64,
    /// Print the report on standard output as JSON
    #[arg(long)]
    json: bool,
}

/// Bends the limb and writes `rest.png`, `bent.png`, `bend.gif` and `bend.pvd`; then presses on a breast,
/// whose mesh is refined until the force is as exact as wanted, and writes the output of `palpate press`
/// to the folder `press`.
pub fn run(gpu: &Gpu, arguments: &DemoArguments) -> anyhow::Result<Outcome> {
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let mut scene = Scene::parse(SCENE)?;
    scene.mesh.tets = Some(arguments.tets);
    scene.picture.size = Some(arguments.size);
    scene.picture.transfer = Some(TRANSFER.to_owned());
    print_notes(&[
        format!("rendering on {}", gpu.adapter_name()),
        format!("generating a limb phantom of about {} tets", arguments.tets),
    ]);
    let mut stage = Stage::new(gpu, &scene)?;
    print_notes(&[format!(
        "{} tets, {} nodes; simulating bending under a load at the fingertips, {} frames",
        stage.mesh().tets.len(),
        stage.mesh().nodes.len(),
        arguments.frames
    )]);
    stage.save(out.join("rest.png"))?;
    let mut series = PvdSeries::create(out, "bend")?;
    stage.write_frame(&mut series)?;
    let mut pictures = vec![stage.image()?];
    let steps = stage.steps();
    progress::with_bar("frames", u64::from(arguments.frames), |bar| -> Result<()> {
        for _ in 0..arguments.frames {
            stage.run(steps, &mut |_| {})?;
            stage.write_frame(&mut series)?;
            pictures.push(stage.image()?);
            bar.inc(1);
        }
        Ok(())
    })?;
    stage.save(out.join("bent.png"))?;
    save_film(&out.join("bend.gif"), &pictures)?;
    print_notes(&[format!(
        "wrote {0}/rest.png, {0}/bent.png, {0}/bend.gif, and {0}/bend.pvd for ParaView",
        out.display()
    )]);
    let pressed = out.join("press");
    std::fs::create_dir_all(&pressed).map_err(Error::io(&pressed))?;
    let mut scene = Scene::parse(PRESSED_SCENE)?;
    scene.mesh.tets = Some((arguments.tets / PRESS_COARSENING).max(MIN_PRESS_TETS));
    scene.picture.size = Some(arguments.size);
    scene.accuracy.within = Some(arguments.within);
    print_notes(&[format!(
        "pressing on a breast with a lump, until the force is within {} %",
        100.0 * arguments.within
    )]);
    let report = super::press::press(
        gpu,
        (&scene, super::press::PressView::default()),
        &PressOptions::default(),
        (&pressed, true),
    )?;
    print_notes(report.missed.as_slice());
    if arguments.json {
        print_json(&json!({
            "adapter": gpu.adapter_name(),
            "tets": stage.mesh().tets.len(),
            "nodes": stage.mesh().nodes.len(),
            "frames": arguments.frames,
            "press": report,
        }))?;
    }
    Ok(Outcome::Done)
}

/// Writes an endless animation that plays forwards and backwards.
fn save_film(path: &std::path::Path, pictures: &[Image]) -> Result<()> {
    let Some(first) = pictures.first() else {
        return Ok(());
    };
    let mut film = Animation::create(path, first.size, FPS)?;
    let back = pictures.iter().rev().skip(1);
    for picture in pictures.iter().chain(back) {
        film.push(picture, Background::Gradient)?;
    }
    film.finish()
}
