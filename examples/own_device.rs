//! Palpate inside a program with its own wgpu device: steps and pictures are recorded into the
//! program's encoder and drawn into its view, without read-back in between.
//!
//!     cargo run --release --example own_device

use palpate::generate;
use palpate::gpu::Recorder;
use palpate::mesh::depth_field;
use palpate::prelude::*;
use palpate::render::Target;

fn main() -> anyhow::Result<()> {
    // Existing objects of the program: an adapter, a device, a queue, a texture to show.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let options = wgpu::RequestAdapterOptions::default();
    let adapter = pollster::block_on(instance.request_adapter(&options))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default()))?;
    let shown = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("window"),
        size: wgpu::Extent3d {
            width: 256,
            height: 256,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = shown.create_view(&Default::default());

    let gpu = Gpu::from_wgpu(&adapter, device.clone(), queue.clone());
    let mesh = generate::ball(0.05, 8)?;
    // The steps run on the GPU, too, even a software one.
    let (engine, tissue) = ("gpu".parse::<EngineChoice>()?, Material::very_soft_tissue());
    let mut body = engine.build_tets(&gpu, mesh, &tissue, SolverKind::Implicit)?;
    body.clamp_one_end(9.81)?;
    let depth = depth_field(body.mesh(), body.topology());
    let geometry = Geometry::from_nodes(&gpu, body.mesh(), body.nodes(), &depth.values)?;
    let mut raycaster = Raycaster::new(&gpu, geometry, &TransferFunction::preset("tissue")?)?;
    let camera = Camera::fit_mesh(body.mesh());

    let before = gpu.readbacks();
    for _ in 0..20 {
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut work = Recorder::with_encoder(&gpu, &mut encoder);
        body.record(&mut work, 2, 0.005)?;
        body.update_nodes(&mut work)?;
        let target = Target {
            colour: &view,
            depth: None,
            background: Some([0.0, 0.0, 0.0, 1.0]),
        };
        raycaster.record(&mut work, &camera, Default::default(), &target)?;
        drop(work);
        queue.submit([encoder.finish()]);
    }
    println!("20 frames, {} readbacks", gpu.readbacks() - before);
    println!("simulated {:.2} s", body.finish()?.time);
    Ok(())
}
