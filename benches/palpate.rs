//! Criterion benches: a step of each solver, and a frame of the raycaster.
//!
//!     cargo bench
#![allow(missing_docs)]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::{Location, generate};
use palpate::physics::{Body, Material, SolverKind, largest_stable_step};
use palpate::render::RaycastOptions;
use palpate::render::{Camera, Geometry, Mode, Raycaster, Target, TransferFunction, Walk};

fn steps(c: &mut Criterion) {
    let gpu = Gpu::new().expect("an adapter");
    let mut group = c.benchmark_group("step");
    group.sample_size(10);
    for tets in [4_320, 34_560] {
        let mesh = generate::bar_of_about(tets, DVec3::new(0.8, 0.2, 0.2)).expect("a bar");
        for kind in SolverKind::ALL {
            let material = Material::soft_tissue();
            let mut body = Body::new(&gpu, &mesh, &material).expect("a body");
            body.pin_lowest_end(9.81);
            let limit = largest_stable_step(body.network(), body.pinned(), kind);
            let dt = limit.map_or(0.01, |limit| 0.5 * limit);
            let mut solver = kind.solver(&gpu, &body).expect("a solver");
            group.bench_function(BenchmarkId::new(kind.name(), tets), |b| {
                b.iter(|| solver.run(&mut body, 1, dt).expect("a step"));
            });
        }
    }
}

fn frames(c: &mut Criterion) {
    let gpu = Gpu::new().expect("an adapter");
    let mut group = c.benchmark_group("frame");
    group.sample_size(10);
    for n in [10, 20] {
        let mesh = generate::benchmark_cube(n, false).expect("a cube");
        let field = mesh.field("scalar", Location::Node).expect("its field");
        for walk in [Walk::Vertices, Walk::Planes] {
            let geometry = Geometry::at_rest(&gpu, &mesh, &field.values).expect("a geometry");
            let options = RaycastOptions {
                walk,
                ..Default::default()
            };
            let transfer = TransferFunction::preset("viridis").expect("a preset");
            let mut raycaster =
                Raycaster::with_options(&gpu, geometry, &transfer, options).expect("a raycaster");
            let camera = Camera::framing(&mesh);
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
            let view = texture.create_view(&Default::default());
            let name = format!("{walk:?}").to_lowercase();
            group.bench_function(BenchmarkId::new(name, mesh.tets.len()), |b| {
                b.iter(|| {
                    let mut work = gpu.record();
                    raycaster.geometry_mut().moved();
                    let target = Target {
                        colour: &view,
                        occluder: None,
                        background: Some([0.0; 4]),
                    };
                    raycaster
                        .record(&mut work, &camera, Mode::Composite, &target)
                        .expect("recorded");
                    work.submit().expect("submitted");
                    gpu.wait().expect("drawn");
                });
            });
        }
    }
}

criterion_group!(benches, steps, frames);
criterion_main!(benches);
