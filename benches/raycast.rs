//! Speed of the raycaster: the benchmark cube of 6 n³ tets at 512 x 512, everything redrawn in each
//! of N frames, with the camera rotated by 7° between them. Prints milliseconds per frame.
//!
//!     cargo bench --bench raycast -- 20 10 [planes] [volume|sliced|integrals] [stored|sampled]

use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::Location;
use palpate::render::*;
use std::time::Instant;

fn main() -> anyhow::Result<()> {
    // `cargo bench` adds an argument.
    let mut words = std::env::args().skip(1).filter(|a| a != "--bench");
    let mut number = |default| {
        words
            .next()
            .map_or(Ok(default), |word| word.parse::<usize>())
    };
    let (n, frames) = (number(20)?, number(5)?);
    let words: Vec<String> = words.collect();
    let given = |word: &str| words.iter().any(|w| w == word);
    let gpu = Gpu::new()?;
    let mesh = generate::benchmark_cube(n, given("hole"))?;
    let scalars = mesh
        .field("scalar", Location::Node)
        .map(|f| f.values.clone())
        .unwrap_or_default();
    let transfer = TransferFunction::new(
        vec![
            [0.0, 0.1, 0.1, 0.8],
            [0.5, 0.1, 0.9, 0.3],
            [1.0, 0.9, 0.2, 0.1],
        ],
        vec![
            [0.0, 0.0],
            [0.45, 0.0],
            [0.55, 3.5],
            [0.65, 0.5],
            [1.0, 8.0],
        ],
    )?;
    let options = RaycastOptions {
        walk: if given("planes") {
            Traversal::Planes
        } else {
            Traversal::Vertices
        },
        table: match () {
            () if given("volume") => TableKind::Volume,
            () if given("sliced") => TableKind::Sliced,
            () if given("integrals") => TableKind::Integrals,
            () => TableKind::Auto,
        },
        reads: match () {
            () if given("stored") => MeshAccess::Stored,
            () if given("sampled") => MeshAccess::Sampled,
            () => MeshAccess::Auto,
        },
        ..Default::default()
    };
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars)?;
    let mut caster = Raycaster::with_options(&gpu, geometry, &transfer, options)?;
    let middle = DVec3::splat(0.5);
    let mut camera =
        Camera::perspective(middle + DVec3::new(1.3, 0.8, 2.0), middle, DVec3::Y, 30.0);
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("frame"),
        size: wgpu::Extent3d {
            width: 512,
            height: 512,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let mut times = Vec::new();
    for frame in 0..=frames {
        gpu.time_passes(frame == frames);
        let start = Instant::now();
        caster.geometry().positions().mark_written();
        let mut work = gpu.start_recording();
        let target = Target {
            colour: &view,
            depth: None,
            background: Some([0.0, 0.0, 0.0, 1.0]),
        };
        caster.record(&mut work, &camera, Mode::Composite, &target)?;
        work.submit()?;
        gpu.wait()?;
        // The first frame compiles the pipelines, the last is timed by pass.
        if frame > 0 && frame < frames {
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        camera = camera.orbited(7.0);
    }
    times.sort_by(f64::total_cmp);
    println!("{}, {} tets", gpu.adapter_name(), mesh.tets.len());
    println!(
        "median {:.1} ms, minimum {:.1} ms",
        times[times.len() / 2],
        times[0]
    );
    for (pass, ms) in gpu.timings()? {
        println!("  {pass}: {ms:.2} ms");
    }
    let report = caster.report(&camera, [512, 512])?;
    println!("{report:?}");
    Ok(())
}
