//! Pictures per second of skins, alone and with the steps of their body, by mapping: corresponds to
//! section 5 of Mosegaard & Sørensen (2005).
//!
//!     cargo bench --bench skin -- [SCAN THRESHOLD [NODES]]
//!
//! A body of 20,000 particles of the size of a heart under 50,000 faces, 18 nodes under 10,000
//! faces, and the isosurface of a scan at full resolution on a body of NODES (42,745) particles.
//! 512 x 512 pixels.

use glam::{DMat3, DVec3};
use palpate::gpu::Gpu;
use palpate::mesh::{LocalFrame, TriMesh};
use palpate::mesher::{ClosedSurface, SurfaceDomain, ThresholdRange};
use palpate::meshing::MeshingConfig;
use palpate::physics::grid::{GridModel, GridShape};
use palpate::physics::{GridBody, Material};
use palpate::render::{Camera, SurfaceTarget, local_positions};
use palpate::skin::{Mapping, Skin, SkinBase};
use std::time::Instant;

const MAPPINGS: [Mapping; 3] = [Mapping::OneToOne, Mapping::Constant, Mapping::Interpolated];

/// Returns a ball of radius `r` of 2 `around` (`rings` − 1) triangles, with bumps of height `hills`.
fn ball(rings: u32, around: u32, r: f64, hills: f64) -> TriMesh {
    let at = |ring: u32, k: u32| 1 + (ring - 1) * around + k % around;
    let last = at(rings, 0);
    let place = |polar: f64, turn: f64| {
        let p = DVec3::new(
            polar.sin() * turn.cos(),
            polar.sin() * turn.sin(),
            polar.cos(),
        );
        p * r * (1.0 + hills * (9.0 * p.x).sin() * (7.0 * p.y + p.z).cos())
    };
    let (pi, mut surface) = (std::f64::consts::PI, TriMesh::default());
    surface.vertices.push(place(0.0, 0.0));
    for ring in 1..rings {
        let polar = pi * f64::from(ring) / f64::from(rings);
        let turn = |k: u32| 2.0 * pi * f64::from(k) / f64::from(around);
        surface
            .vertices
            .extend((0..around).map(|k| place(polar, turn(k))));
    }
    surface.vertices.push(place(pi, 0.0));
    for k in 0..around {
        surface.triangles.push([0, at(1, k), at(1, k + 1)]);
        surface
            .triangles
            .push([last, at(rings - 1, k + 1), at(rings - 1, k)]);
        for ring in 1..rings - 1 {
            let [a, b, c, d] = [
                at(ring, k),
                at(ring + 1, k),
                at(ring + 1, k + 1),
                at(ring, k + 1),
            ];
            surface.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    surface
}

/// Calls `run` until half a second has passed, three times; returns the highest rate in calls per
/// second.
fn rate(mut run: impl FnMut() -> palpate::Result<()>) -> palpate::Result<f64> {
    run()?;
    let mut best: f64 = 0.0;
    for _ in 0..3 {
        let (start, mut calls) = (Instant::now(), 0.0);
        while start.elapsed().as_secs_f64() < 0.5 {
            run()?;
            calls += 1.0;
        }
        best = best.max(calls / start.elapsed().as_secs_f64());
    }
    Ok(best)
}

struct Screen(wgpu::TextureView, wgpu::TextureView);

impl Screen {
    fn new(gpu: &Gpu) -> Screen {
        let texture = |format| {
            let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d {
                    width: 512,
                    height: 512,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        Screen(
            texture(wgpu::TextureFormat::Rgba8Unorm),
            texture(wgpu::TextureFormat::Depth32Float),
        )
    }

    fn draw(&self, gpu: &Gpu, skin: &mut Skin, camera: &Camera) -> palpate::Result<()> {
        let mut work = gpu.start_recording();
        let target = SurfaceTarget {
            colour: &self.0,
            depth: &self.1,
            background: Some([0.0; 4]),
        };
        skin.record(&mut work, camera, &target)?;
        work.submit()?;
        gpu.wait()
    }
}

/// Measures a row: a skin on a base, alone, and with `steps` of `body` before each picture.
fn row(
    gpu: &Gpu,
    name: &str,
    surface: &TriMesh,
    carrier: &SkinBase,
    mut body: Option<(&mut GridBody, u32)>,
) -> palpate::Result<()> {
    let screen = Screen::new(gpu);
    let (low, high) = palpate::mesh::bounds(&surface.vertices);
    let (middle, size) = (0.5 * (low + high), (high - low).length());
    let camera = Camera::perspective(middle - 1.6 * size * DVec3::Y, middle, DVec3::Z, 35.0);
    for mapping in MAPPINGS {
        let mut skin = Skin::new(gpu, surface, carrier, mapping)?;
        let alone = rate(|| screen.draw(gpu, &mut skin, &camera))?;
        skin.set_culling(true);
        let culled = rate(|| screen.draw(gpu, &mut skin, &camera))?;
        let faces = surface.triangles.len();
        let left_out = 100.0 * (1.0 - skin.visible_triangles()?.len() as f64 / faces as f64);
        skin.set_culling(false);
        let with = match &mut body {
            None => "–".to_owned(),
            Some((body, steps)) => {
                let dt = 0.5 * body.model().conservative_step();
                let both = rate(|| {
                    body.run(*steps, dt)?;
                    screen.draw(gpu, &mut skin, &camera)
                })?;
                format!("{both:.1} ({steps})")
            }
        };
        println!(
            "| {name} | {faces} | {mapping} | {alone:.1} | {culled:.1} ({left_out:.0} %) | {with} |",
        );
    }
    Ok(())
}

fn main() -> palpate::Result<()> {
    let gpu = Gpu::new()?;
    println!("{}", gpu.adapter().name);
    println!(
        "| body | faces | mapping | images per second | with culling (culled) | with steps (per image) |"
    );
    println!("| --- | --- | --- | --- | --- | --- |");

    let heart = ball(126, 200, 0.05, 0.06);
    let inside = SurfaceDomain::new(vec![ClosedSurface::new(&heart)?])?;
    let shape = GridShape::from_domain_with_count(&inside, 20_000, DMat3::IDENTITY)?;
    let mut body = GridBody::new(&gpu, GridModel::new(shape, &Material::from_young(1e4))?)?;
    let name = format!("{} particles", body.model().shape.count());
    let carrier = SkinBase::from_grid(&mut body)?;
    row(&gpu, &name, &heart, &carrier, Some((&mut body, 15)))?;

    let (few, surface) = (ball(5, 4, 1.0, 0.0), ball(51, 100, 1.05, 0.05));
    let (low, high) = palpate::mesh::bounds(&few.vertices);
    let frame = LocalFrame::from_bounds(low, high);
    let positions = local_positions(&gpu, &frame, &few.vertices)?;
    let (nodes, triangles) = (&few.vertices, &few.triangles);
    let carrier = SkinBase::with_area_normals(&gpu, &positions, frame, nodes, triangles)?;
    let name = format!("{} hand-placed nodes", nodes.len());
    row(&gpu, &name, &surface, &carrier, None)?;

    let given: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    let [scan, threshold, more @ ..] = given.as_slice() else {
        return Ok(());
    };
    let recipe = MeshingConfig {
        input: vec![scan.into()],
        above: vec![threshold.parse::<ThresholdRange>()?],
        ..MeshingConfig::default()
    };
    let surface = recipe.extract_surface(0, &palpate::no_progress)?;
    let nodes = more.first().and_then(|n| n.parse().ok()).unwrap_or(42_745);
    let mut body = recipe.with_domain(|found| {
        let shape = GridShape::from_domain_with_count(found.domain, nodes, DMat3::IDENTITY)?;
        GridBody::new(&gpu, GridModel::new(shape, &Material::from_young(1e4))?)
    })?;
    let name = format!("{} particles, scan isosurface", body.model().shape.count());
    let carrier = SkinBase::from_grid(&mut body)?;
    row(&gpu, &name, &surface, &carrier, Some((&mut body, 6)))
}
