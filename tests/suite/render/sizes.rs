//! Invalid sizes: an error from every function that takes a size, and the device remains usable.

use crate::render::common::*;
use palpate::Error;
use palpate::generate;
use palpate::gpu::Texel;
use palpate::render::*;
use palpate::scene::{Scene as SceneFile, Stage};
use palpate::skin::{Compositor, CompositorOptions, Skin, SkinBase};

const TOO_LARGE: [u32; 2] = [100_000, 100_000];

/// Returns the message of an error that states the size.
fn refused<T>(result: palpate::Result<T>) -> String {
    match result {
        Err(e @ (Error::Input(_) | Error::Gpu(_))) => e.to_string(),
        Err(e) => panic!("another error: {e}"),
        Ok(_) => panic!("no error"),
    }
}

#[test]
fn rejects_invalid_image_sizes() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(3, false).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    let camera = peers_camera();
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
    let colour = SurfaceColour::Plain([1.0; 3]);
    let mut surface = Surface::new(&gpu, &geometry, &scalars, &colour, Shading::Flat).unwrap();
    let frame = geometry.frame();
    let carrier = SkinBase::from_mesh(&gpu, &mesh, geometry.positions(), frame).unwrap();
    let mut skin = Skin::body_surface(&gpu, &carrier, None).unwrap();
    let mut composer = Compositor::new(&gpu, CompositorOptions::default()).unwrap();
    let mut caster = Raycaster::new(&gpu, geometry, &peers_transfer()).unwrap();
    for size in [TOO_LARGE, [0, 5], [u32::MAX, 2]] {
        for mode in [Mode::Composite, Mode::Thickness] {
            assert!(refused(caster.image(&camera, size, mode)).contains("65536"));
        }
        assert!(refused(caster.report(&camera, size)).contains("65536"));
        assert!(refused(surface.image(&camera, size)).contains("65536"));
        assert!(refused(skin.image(&camera, size)).contains("65536"));
        let skins = std::slice::from_mut(&mut skin);
        assert!(refused(composer.image(skins, None, &camera, size)).contains("65536"));
    }
    assert!(caster.image(&camera, [8, 8], Mode::Composite).is_ok());
}

#[test]
fn stage_rejects_invalid_image_sizes() {
    let gpu = gpu();
    for mode in ["composite", "surface", "thickness"] {
        let text = format!("[mesh]\ngenerate = \"bar\"\n[picture]\nmode = \"{mode}\"\n");
        let scene = SceneFile::parse(&text).unwrap();
        let mut stage = Stage::new(&gpu, &scene).unwrap();
        stage.set_size(TOO_LARGE);
        refused(stage.image());
        refused(stage.measure(1));
        // A picture in memory is tiled, a single render target cannot be.
        stage.set_size([9_000, 9]);
        assert!(refused(stage.frame_ms(1)).contains("measured picture"));
        stage.set_size([16, 16]);
        stage.image().unwrap();
    }
}

#[test]
fn rejects_resources_beyond_device_limits() {
    let gpu = gpu();
    let usage = wgpu::TextureUsages::TEXTURE_BINDING;
    let format = wgpu::TextureFormat::Rgba32Float;
    for size in [TOO_LARGE, [0, 1]] {
        assert!(refused(gpu.target("wall", size, format, usage)).contains("wall"));
    }
    assert!(refused(gpu.texture("stack", [8, 8, 70_000], format, usage)).contains("stack"));
    assert!(refused(gpu.buffer("heap", u64::MAX)).contains("heap"));
    assert!(refused(gpu.buffer("heap", 1 << 50)).contains("heap"));
    assert!(refused(gpu.array("list", Texel::F32x4, usize::MAX)).contains("list"));
    gpu.poll_errors().unwrap();
    gpu.wait().unwrap();
    gpu.array("list", Texel::F32, 10).unwrap();
}
