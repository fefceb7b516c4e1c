//! `palpate demo`: the limb phantom bends under load, its bones visible inside.

use super::{Outcome, progress, tell};
use clap::Args;
use palpate::gpu::Gpu;
use palpate::io::{self, PvdSeries};
use palpate::render::Image;
use palpate::scene::{Scene, Stage};
use palpate::{Error, Result};
use std::path::PathBuf;

/// The scene of the demo, which ships with the program.
const SCENE: &str = include_str!("../../data/scenes/limb.toml");
/// Its transfer function, in Hounsfield units.
const TRANSFER: &str = include_str!("../../data/limb.json");
/// Time a frame is shown in the animation, in ms.
const FRAME_MS: u32 = 60;

/// Arguments of `demo`.
#[derive(Args)]
pub struct DemoArguments {
    /// Folder for what it leaves
    #[arg(long, short, default_value = "out/demo")]
    out: PathBuf,
    /// About how many tets the limb has
    #[arg(long, default_value_t = 100_000)]
    tets: usize,
    /// Frames of the animation
    #[arg(long, default_value_t = 24)]
    frames: u32,
    /// Picture size in pixels, WIDTHxHEIGHT
    #[arg(long, default_value = "800x600", value_parser = super::flags::size)]
    size: [u32; 2],
}

/// Bends the limb, and leaves `rest.png`, `bent.png`, `bend.gif` and `bend.pvd`.
pub fn run(gpu: &Gpu, arguments: &DemoArguments) -> anyhow::Result<Outcome> {
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let mut scene = Scene::parse(SCENE)?;
    scene.mesh.tets = Some(arguments.tets);
    scene.picture.size = Some(arguments.size);
    scene.picture.transfer = Some(TRANSFER.to_owned());
    tell(&[
        format!("drawing on {}", gpu.adapter_name()),
        format!("generating a limb phantom of about {} tets", arguments.tets),
    ]);
    let mut stage = Stage::new(gpu, &scene)?;
    tell(&[format!(
        "{} tets, {} nodes; bending it under a load at the fingertips, {} frames",
        stage.mesh().tets.len(),
        stage.mesh().nodes.len(),
        arguments.frames
    )]);
    stage.save(out.join("rest.png"))?;
    let mut series = PvdSeries::create(out, "bend")?;
    stage.push(&mut series)?;
    let mut pictures = vec![stage.image()?];
    let steps = stage.steps();
    progress::over("frames", u64::from(arguments.frames), |bar| -> Result<()> {
        for _ in 0..arguments.frames {
            stage.run(steps, &mut |_| {})?;
            stage.push(&mut series)?;
            pictures.push(stage.image()?);
            bar.inc(1);
        }
        Ok(())
    })?;
    stage.save(out.join("bent.png"))?;
    save_gif(&out.join("bend.gif"), &pictures)?;
    tell(&[format!(
        "{0}/rest.png, {0}/bent.png, {0}/bend.gif, and {0}/bend.pvd for ParaView",
        out.display()
    )]);
    Ok(Outcome::Done)
}

/// An endless animation, there and back again.
fn save_gif(path: &std::path::Path, pictures: &[Image]) -> Result<()> {
    use image::codecs::gif::{GifEncoder, Repeat};
    let back = pictures.iter().rev().skip(1);
    io::atomic_write(path, |file| {
        // 10 of 1 (best) to 30 (fastest).
        let mut gif = GifEncoder::new_with_speed(file, 10);
        let encoded = gif.set_repeat(Repeat::Infinite).and_then(|()| {
            pictures
                .iter()
                .chain(back)
                .try_for_each(|p| gif.encode_frame(frame_of(p)))
        });
        encoded.map_err(|e| Error::format(path, format!("cannot be encoded: {e}")))
    })
}

fn frame_of(picture: &Image) -> image::Frame {
    let [width, height] = picture.size;
    let buffer = image::RgbaImage::from_fn(width, height, |x, y| {
        let byte = |v: f32| (255.0 * v.clamp(0.0, 1.0)).round() as u8;
        let p = picture.pixel(x, y);
        image::Rgba([byte(p[0]), byte(p[1]), byte(p[2]), 255])
    });
    let delay = image::Delay::from_numer_denom_ms(FRAME_MS, 1);
    image::Frame::from_parts(buffer, 0, 0, delay)
}
