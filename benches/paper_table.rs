//! A table like the paper's (Tejada & Ertl 2005, table 1 and section 6), in Markdown: steps a
//! second of every solver on the GPU and of its float64 twin, pictures a second of the surface
//! and of the raycaster, and both coupled.
//!
//!     cargo bench --bench paper_table -- [--quick]
//!
//! Bars of about the paper's numbers of tets; E = 30 kPa, implicit h = 0.01 s, explicit solvers
//! at half their largest stable step (explicit Euler damped, so that it has one); the coupled
//! rate is one implicit step and one picture of 512 × 512 pixels. Medians.

use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::{TetMesh, Topology, depth_field, generate};
use palpate::physics::plain::springs::Particles;
use palpate::physics::plain::steppers;
use palpate::physics::{Body, Material, Solver, SolverKind, SpringNetwork, largest_stable_step};
use palpate::render::{
    Camera, Geometry, Mode, Raycaster, Shading, Surface, SurfaceColour, SurfaceTarget, Target,
    TransferFunction,
};
use std::time::{Duration, Instant};

/// Tets of the meshes in the paper's table.
const PAPER: [usize; 7] = [80, 13_766, 17_312, 24_106, 35_118, 112_299, 156_612];
/// Time spent on each measurement, at least; and calls at most.
const LONG_ENOUGH: Duration = Duration::from_millis(1500);
const MOST_CALLS: usize = 200;
/// Steps a submit of an explicit solver.
const STEPS: u32 = 8;
const PIXELS: u32 = 512;

fn main() -> anyhow::Result<()> {
    let quick = std::env::args().any(|a| a == "--quick");
    let gpu = Gpu::new()?;
    println!("{}\n", gpu.adapter_name());
    println!(
        "| tets | explicit | symplectic | Verlet | velocity Verlet | implicit (CG iterations) | CPU explicit | CPU implicit | Verlet + surface | raycast | implicit + raycast |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    let sizes = if quick { &PAPER[..2] } else { &PAPER[..] };
    for tets in sizes {
        let mesh = generate::bar_of_about(*tets, DVec3::new(0.3, 0.1, 0.1))?;
        println!("| {} {}", mesh.tets.len(), row(&gpu, &mesh)?);
    }
    Ok(())
}

fn row(gpu: &Gpu, mesh: &TetMesh) -> anyhow::Result<String> {
    let mut cells = String::new();
    for kind in SolverKind::ALL {
        let (mut body, mut solver, dt) = moving(gpu, mesh, kind)?;
        let steps = if kind == SolverKind::Implicit {
            1
        } else {
            STEPS
        };
        let mut iterations = 0;
        let rate = rate(|| {
            iterations = solver.run(&mut body, steps, dt)?.last.iterations;
            Ok(())
        })?;
        let rate = rate * f64::from(steps);
        cells += &match kind {
            SolverKind::Implicit => format!("| {rate:.1} ({iterations}) "),
            _ => format!("| {rate:.0} "),
        };
    }
    for kind in [SolverKind::Explicit, SolverKind::Implicit] {
        let (body, _, dt) = moving(gpu, mesh, kind)?;
        let mut twin = twin(&body);
        let rate = rate(|| {
            match kind {
                SolverKind::Implicit => {
                    steppers::implicit_euler(&mut twin, dt, 1e-3);
                }
                _ => steppers::explicit_euler(&mut twin, dt),
            }
            Ok(())
        })?;
        cells += &format!("| {rate:.1} ");
    }
    for (kind, surface) in [
        (Some(SolverKind::Verlet), true),
        (None, false),
        (Some(SolverKind::Implicit), false),
    ] {
        cells += &format!("| {:.1} ", pictures(gpu, mesh, kind, surface)?);
    }
    Ok(cells + "|")
}

/// The body, held at one end, with its solver and step.
fn moving(
    gpu: &Gpu,
    mesh: &TetMesh,
    kind: SolverKind,
) -> palpate::Result<(Body, Box<dyn Solver>, f64)> {
    let mut material = Material::young(3e4);
    if kind == SolverKind::Explicit {
        let network = SpringNetwork::new(mesh, &material)?;
        let undamped =
            largest_stable_step(&network, &vec![false; mesh.nodes.len()], SolverKind::Verlet);
        material.damping_time = 0.5 * undamped.unwrap_or(0.0);
    }
    let mut body = Body::new(gpu, mesh, &material)?;
    body.hold_one_end(9.81);
    let limit = largest_stable_step(body.network(), body.pinned(), kind);
    let solver = kind.solver(gpu, &body)?;
    Ok((body, solver, limit.map_or(0.01, |limit| 0.5 * limit)))
}

fn twin(body: &Body) -> Particles {
    let mut twin = Particles::new(body.network().clone());
    twin.pinned = body.pinned().to_vec();
    twin.gravity = body.gravity();
    twin
}

/// Pictures a second: the surface or the inside, after a step or of a body that only moved.
fn pictures(
    gpu: &Gpu,
    mesh: &TetMesh,
    kind: Option<SolverKind>,
    surface: bool,
) -> anyhow::Result<f64> {
    let (mut body, mut solver, dt) = moving(gpu, mesh, kind.unwrap_or(SolverKind::Verlet))?;
    let topology = Topology::new(mesh);
    let depth = depth_field(mesh, &topology).values;
    let (frame, positions) = (body.nodes().frame(), body.nodes().array().clone());
    let geometry = Geometry::new(gpu, mesh, &topology, frame, &positions, &depth)?;
    let transfer = TransferFunction::preset("tissue")?;
    let plain = SurfaceColour::Plain([0.9, 0.7, 0.6]);
    let mut skin = Surface::new(gpu, &geometry, &depth, &plain, Shading::Smooth)?;
    let mut raycaster = Raycaster::new(gpu, geometry, &transfer)?;
    let camera = Camera::framing(mesh);
    let (colour, depth) = (
        view(gpu, wgpu::TextureFormat::Rgba8Unorm),
        view(gpu, wgpu::TextureFormat::Depth32Float),
    );
    let background = Some([0.0, 0.0, 0.0, 1.0]);
    rate(|| {
        let mut work = gpu.record();
        if kind.is_some() {
            solver.record(&mut work, &mut body, 1, dt)?;
        }
        if surface {
            let (colour, depth) = (&colour, &depth);
            skin.record(
                &mut work,
                &camera,
                &SurfaceTarget {
                    colour,
                    depth,
                    background,
                },
            )?;
        } else {
            let target = Target {
                colour: &colour,
                occluder: None,
                background,
            };
            raycaster.record(&mut work, &camera, Mode::Composite, &target)?;
        }
        work.submit()?;
        gpu.wait()
    })
}

fn view(gpu: &Gpu, format: wgpu::TextureFormat) -> wgpu::TextureView {
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: PIXELS,
            height: PIXELS,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Calls a second, from the median time of a call after two to warm up.
fn rate(mut call: impl FnMut() -> palpate::Result<()>) -> anyhow::Result<f64> {
    call()?;
    call()?;
    let mut times = Vec::new();
    let start = Instant::now();
    while times.len() < 3 || (start.elapsed() < LONG_ENOUGH && times.len() < MOST_CALLS) {
        let before = Instant::now();
        call()?;
        times.push(before.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    Ok(1.0 / times[times.len() / 2])
}
