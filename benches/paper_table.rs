//! A table corresponding to the paper's (Tejada & Ertl 2005, table 1 and section 6), in Markdown:
//! steps per second of every solver on the GPU and on the CPU, alternating, pictures per second of
//! the surface and of the raycaster, and both coupled.
//!
//!     cargo bench --bench paper_table -- [--quick] [--steps]
//!
//! Bars with about the paper's numbers of tets; E = 30 kPa, implicit h = 0.01 s, explicit solvers
//! at half their largest stable step (explicit Euler damped, since it is unstable otherwise); the
//! coupled rate is one implicit step and one picture of 512 × 512 pixels. Medians. `--quick` stops
//! at the second size, `--steps` omits the pictures.

use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{TetMesh, Topology, depth_field};
use palpate::physics::{
    ClampedEnd, DiscreteModel, Engine, EngineChoice, Material, Simulator, SolverKind,
    largest_stable_step,
};
use palpate::render::{
    Camera, Geometry, Mode, Raycaster, Shading, Surface, SurfaceColour, SurfaceTarget, Target,
    TransferFunction,
};
use std::time::{Duration, Instant};

/// Tets of the meshes in the paper's table.
const PAPER: [usize; 7] = [80, 13_766, 17_312, 24_106, 35_118, 112_299, 156_612];
/// Minimum time per measurement, and maximum number of calls.
const LONG_ENOUGH: Duration = Duration::from_millis(1500);
const MAX_CALLS: usize = 200;
/// Steps per submission of an explicit solver.
const STEPS: u32 = 8;
const PIXELS: u32 = 512;

fn main() -> anyhow::Result<()> {
    let given = |flag: &str| std::env::args().any(|a| a == flag);
    let gpu = Gpu::new()?;
    println!("{}\n", gpu.adapter_name());
    let mut columns = vec!["tets".to_owned()];
    for kind in SolverKind::ALL {
        for engine in [Engine::Gpu, Engine::Cpu] {
            columns.push(format!("{kind}, {engine}"));
        }
    }
    if !given("--steps") {
        columns.extend(["Verlet + surface", "raycast", "implicit + raycast"].map(String::from));
    }
    println!("| {} |", columns.join(" | "));
    println!("|{}", " --- |".repeat(columns.len()));
    let sizes = if given("--quick") {
        &PAPER[..2]
    } else {
        &PAPER[..]
    };
    for tets in sizes {
        let mesh = generate::bar_of_about(*tets, DVec3::new(0.3, 0.1, 0.1))?;
        let mut cells = rates(&gpu, &mesh)?;
        if !given("--steps") {
            for (kind, surface) in [
                (Some(SolverKind::Verlet), true),
                (None, false),
                (Some(SolverKind::Implicit), false),
            ] {
                cells.push(format!("{:.1}", pictures(&gpu, &mesh, kind, surface)?));
            }
        }
        println!("| {} | {} |", mesh.tets.len(), cells.join(" | "));
    }
    Ok(())
}

/// Measures steps per second of every solver on both engines; for implicit Euler also the
/// iterations.
fn rates(gpu: &Gpu, mesh: &TetMesh) -> anyhow::Result<Vec<String>> {
    let mut cells = Vec::new();
    for kind in SolverKind::ALL {
        for engine in [Engine::Gpu, Engine::Cpu] {
            let (mut body, dt) = moving(gpu, mesh, kind, engine)?;
            let implicit = kind == SolverKind::Implicit;
            let steps = if implicit { 1 } else { STEPS };
            let rate = f64::from(steps) * rate(|| body.run(steps, dt).map(|_| ()))?;
            cells.push(match body.iterations()?.last() {
                Some(iterations) => format!("{rate:.1} ({iterations})"),
                None => format!("{rate:.0}"),
            });
        }
    }
    Ok(cells)
}

/// Returns the body, clamped at one end, and its step.
fn moving(
    gpu: &Gpu,
    mesh: &TetMesh,
    kind: SolverKind,
    engine: Engine,
) -> palpate::Result<(Box<dyn Simulator>, f64)> {
    let mut material = Material::from_young(3e4);
    if kind == SolverKind::Explicit {
        let network = DiscreteModel::new(mesh, &material)?;
        let undamped =
            largest_stable_step(&network, &vec![false; mesh.nodes.len()], SolverKind::Verlet);
        material.damping_time = 0.5 * undamped.unwrap_or(0.0);
    }
    let choice = EngineChoice::Exactly(engine);
    let mut body = choice.build_tets(gpu, mesh.clone(), &material, kind)?;
    let (rest, edges) = (&body.mesh().nodes, body.edge_nodes().into_iter());
    let (end, _) = ClampedEnd::of_largest_component(rest, body.masses(), edges, DVec3::NEG_Z);
    body.pin_nodes(&end.nodes)?;
    body.loads_mut().set_gravity(9.81 * end.load_direction());
    let dt = body.largest_stable_step().map_or(0.01, |limit| 0.5 * limit);
    Ok((body, dt))
}

/// Measures pictures per second of the surface or the interior, after a step or of a body that only
/// moved.
fn pictures(
    gpu: &Gpu,
    mesh: &TetMesh,
    kind: Option<SolverKind>,
    surface: bool,
) -> anyhow::Result<f64> {
    let engine = EngineChoice::Auto.resolve(gpu);
    let (mut body, dt) = moving(gpu, mesh, kind.unwrap_or(SolverKind::Verlet), engine)?;
    let topology = Topology::new(mesh);
    let depth = depth_field(mesh, &topology).values;
    let (frame, positions) = (body.nodes().frame(), body.nodes().array().clone());
    let geometry = Geometry::new(gpu, mesh, &topology, frame, &positions, &depth)?;
    let transfer = TransferFunction::preset("tissue")?;
    let plain = SurfaceColour::Plain([0.9, 0.7, 0.6]);
    let mut skin = Surface::new(gpu, &geometry, &depth, &plain, Shading::Smooth)?;
    let mut raycaster = Raycaster::new(gpu, geometry, &transfer)?;
    let camera = Camera::fit_mesh(mesh);
    let (colour, depth) = (
        view(gpu, wgpu::TextureFormat::Rgba8Unorm),
        view(gpu, wgpu::TextureFormat::Depth32Float),
    );
    let background = Some([0.0, 0.0, 0.0, 1.0]);
    rate(|| {
        let mut work = gpu.start_recording();
        if kind.is_some() {
            body.record(&mut work, 1, dt)?;
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
                depth: None,
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

/// Returns calls per second, from the median time of a call after two warm-up calls.
fn rate(mut call: impl FnMut() -> palpate::Result<()>) -> anyhow::Result<f64> {
    call()?;
    call()?;
    let mut times = Vec::new();
    let start = Instant::now();
    while times.len() < 3 || (start.elapsed() < LONG_ENOUGH && times.len() < MAX_CALLS) {
        let before = Instant::now();
        call()?;
        times.push(before.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    Ok(1.0 / times[times.len() / 2])
}
