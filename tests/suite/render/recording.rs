//! Several pictures recorded before one submission, each with its own settings.

use crate::render::common::*;
use palpate::generate;
use palpate::gpu::{Gpu, Recorder};
use palpate::render::*;

fn target(gpu: &Gpu, size: [u32; 2]) -> wgpu::TextureView {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    gpu.target("picture", size, wgpu::TextureFormat::Rgba32Float, usage)
        .unwrap()
}

fn on(colour: &wgpu::TextureView) -> Target<'_> {
    Target {
        colour,
        depth: None,
        background: Some([0.0; 4]),
    }
}

fn pixels(gpu: &Gpu, view: &wgpu::TextureView) -> Vec<f32> {
    let read: Vec<[f32; 4]> = gpu.read_texture(view.texture()).unwrap();
    read.into_iter().flatten().collect()
}

fn raycaster(gpu: &Gpu, options: RaycastOptions) -> Raycaster {
    let mesh = generate::benchmark_cube(5, true).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    let geometry = Geometry::at_rest(gpu, &mesh, &scalars).unwrap();
    Raycaster::with_options(gpu, geometry, &peers_transfer(), options).unwrap()
}

/// Settings of a picture in a recording: camera, transfer function, size.
type Wanted = (Camera, TransferFunction, [u32; 2]);

/// Returns three settings that differ in one item each.
fn wanted() -> Vec<Wanted> {
    let (near, preset) = (peers_camera(), TransferFunction::preset("viridis").unwrap());
    let mut aside = near;
    aside.eye.x -= 1.5;
    vec![
        (near, peers_transfer(), [60, 40]),
        (aside, peers_transfer(), [60, 40]),
        (aside, preset.clone(), [60, 40]),
        (near, preset, [33, 50]),
    ]
}

fn alone(caster: &mut Raycaster, (camera, transfer, size): &Wanted) -> Vec<f32> {
    caster.set_transfer(transfer).unwrap();
    caster.image(camera, *size, Mode::Composite).unwrap().values
}

#[test]
fn images_in_one_submit_keep_settings() {
    let gpu = gpu();
    for walk in [Traversal::Vertices, Traversal::Planes] {
        let options = RaycastOptions {
            walk,
            ..Default::default()
        };
        let mut caster = raycaster(&gpu, options);
        let truth: Vec<_> = wanted().iter().map(|w| alone(&mut caster, w)).collect();
        assert!((1..4).all(|i| truth[i] != truth[i - 1]));
        let mut caster = raycaster(&gpu, options);
        let targets: Vec<_> = wanted().iter().map(|w| target(&gpu, w.2)).collect();
        let mut work = gpu.start_recording();
        for ((camera, transfer, _), colour) in wanted().iter().zip(&targets) {
            caster.set_transfer(transfer).unwrap();
            caster
                .record(&mut work, camera, Mode::Composite, &on(colour))
                .unwrap();
        }
        work.submit().unwrap();
        for (i, (view, truth)) in targets.iter().zip(&truth).enumerate() {
            assert!(pixels(&gpu, view) == *truth, "{walk:?}: picture {i}");
        }
    }
}

#[test]
fn recordings_submit_in_any_order() {
    let gpu = gpu();
    let mut caster = raycaster(&gpu, RaycastOptions::default());
    let truth: Vec<_> = wanted().iter().map(|w| alone(&mut caster, w)).collect();
    let mut caster = raycaster(&gpu, RaycastOptions::default());
    let mut encoders = Vec::new();
    for (camera, transfer, size) in wanted() {
        let colour = target(&gpu, size);
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        caster.set_transfer(&transfer).unwrap();
        let mut work = Recorder::with_encoder(&gpu, &mut encoder);
        caster
            .record(&mut work, &camera, Mode::Composite, &on(&colour))
            .unwrap();
        work.submit().unwrap();
        encoders.push((colour, encoder));
    }
    // The first, which should build its table, is never submitted.
    encoders.remove(0);
    for ((colour, encoder), truth) in encoders.into_iter().zip(&truth[1..]).rev() {
        gpu.queue().submit([encoder.finish()]);
        assert!(pixels(&gpu, &colour) == *truth);
    }
}

#[test]
fn surfaces_in_one_submit_keep_cameras() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(5, true).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
    let colour = SurfaceColour::Plain([0.8, 0.5, 0.3]);
    let mut surface = Surface::new(&gpu, &geometry, &scalars, &colour, Shading::Flat).unwrap();
    let size = [60, 40];
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let depth = gpu
        .target("depth", size, wgpu::TextureFormat::Depth32Float, usage)
        .unwrap();
    let cameras: Vec<Camera> = wanted().iter().take(2).map(|w| w.0).collect();
    let mut draw = |at_once: bool| -> Vec<Vec<f32>> {
        let targets: Vec<_> = cameras.iter().map(|_| target(&gpu, size)).collect();
        let mut work = gpu.start_recording();
        for (camera, colour) in cameras.iter().zip(&targets) {
            let into = SurfaceTarget {
                colour,
                depth: &depth,
                background: Some([0.0; 4]),
            };
            surface.record(&mut work, camera, &into).unwrap();
            if !at_once {
                std::mem::replace(&mut work, gpu.start_recording())
                    .submit()
                    .unwrap();
            }
        }
        work.submit().unwrap();
        targets.iter().map(|view| pixels(&gpu, view)).collect()
    };
    let truth = draw(false);
    assert!(truth[0] != truth[1]);
    assert!(draw(true) == truth);
}
