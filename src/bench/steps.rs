//! Steps and pictures a second of bars of the sizes in Tejada & Ertl (2005), table 1 and section 6.

use super::{Case, Context, Row, hold_one_end};
use crate::Result;
use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, Topology, depth_field};
use crate::physics::{
    DiscreteModel, Engine, EngineChoice, Material, Simulator, SolverKind, largest_stable_step,
};
use crate::render::{
    Camera, Geometry, Mode, Raycaster, Shading, Surface, SurfaceColour, SurfaceTarget, Target,
    TransferFunction,
};
use glam::DVec3;

pub(super) const ABOUT: &str = "Springs, E = 30 kPa, one end clamped, under gravity. Explicit \
    solvers run at half their largest stable step, implicit Euler at 0.01 s to a relative residual \
    of 10⁻³. Pictures have 512 × 512 pixels; the coupled rows are one step and one picture. The \
    paper's values are those of a GeForce 7800 and a 3.8 GHz Pentium 4 of 2005, on meshes of about \
    these sizes.";

/// Time step of implicit Euler, s.
const IMPLICIT_STEP: f64 = 0.01;
/// Steps per submission of an explicit solver.
const STEPS: u32 = 8;
const PIXELS: u32 = 512;

/// A row of the paper's table, in frames per second.
struct PaperRow {
    tets: usize,
    /// Explicit Euler, Verlet, velocity Verlet, implicit Euler, on the GPU.
    gpu: [f64; 4],
    /// Explicit Euler, and implicit Euler if it ended, on the CPU.
    cpu: (f64, Option<f64>),
    /// Verlet with the surface, raycast, implicit Euler with the raycaster.
    pictures: [Option<f64>; 3],
}

const PAPER: [PaperRow; 7] = [
    row(80, [3880.0, 3408.0, 3454.0, 282.0], (5824.0, Some(67.0))),
    row(13_766, [1039.0, 764.0, 764.0, 113.0], (102.0, None)),
    row(17_312, [945.0, 612.0, 614.0, 100.0], (80.0, None)),
    row(24_106, [900.0, 539.0, 541.0, 48.0], (58.0, None)),
    row(35_118, [445.0, 302.0, 302.0, 56.0], (44.0, None)),
    PaperRow {
        pictures: [Some(88.0), Some(11.21), Some(5.62)],
        ..row(112_299, [169.0, 119.0, 119.0, 22.0], (14.0, None))
    },
    PaperRow {
        pictures: [Some(144.0), Some(6.2), Some(2.57)],
        ..row(156_612, [220.0, 149.0, 149.0, 12.0], (12.0, None))
    },
];

const fn row(tets: usize, gpu: [f64; 4], cpu: (f64, Option<f64>)) -> PaperRow {
    PaperRow {
        tets,
        gpu,
        cpu,
        pictures: [None; 3],
    }
}

impl PaperRow {
    fn steps(&self, kind: SolverKind, engine: Engine) -> Option<f64> {
        match (engine, kind) {
            (Engine::Gpu, SolverKind::Explicit) => Some(self.gpu[0]),
            (Engine::Gpu, SolverKind::Verlet) => Some(self.gpu[1]),
            (Engine::Gpu, SolverKind::VelocityVerlet) => Some(self.gpu[2]),
            (Engine::Gpu, SolverKind::Implicit) => Some(self.gpu[3]),
            (Engine::Cpu, SolverKind::Explicit) => Some(self.cpu.0),
            (Engine::Cpu, SolverKind::Implicit) => self.cpu.1,
            _ => None,
        }
    }
}

/// What a picture shows.
#[derive(Clone, Copy, PartialEq)]
enum Drawn {
    Surface,
    Interior,
}

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let (sizes, kinds): (_, &[SolverKind]) = match quick {
        true => (&PAPER[..2], &[SolverKind::Verlet, SolverKind::Implicit]),
        false => (&PAPER[..], &SolverKind::ALL),
    };
    let mut all = Vec::new();
    for paper in sizes {
        let tets = paper.tets;
        for &kind in kinds {
            for engine in [Engine::Gpu, Engine::Cpu] {
                let row = Row::new(kind.name(), &engine.to_string(), "steps/s")
                    .size(tets, "tets")
                    .paper(paper.steps(kind, engine));
                all.push(Case::new(row, move |context, row| {
                    step_rate(context, row, tets, (kind, engine))
                }));
            }
        }
        let kinds = [
            (
                "verlet and surface",
                Some(SolverKind::Verlet),
                Drawn::Surface,
            ),
            ("raycast", None, Drawn::Interior),
            (
                "implicit and raycast",
                Some(SolverKind::Implicit),
                Drawn::Interior,
            ),
        ];
        for ((what, kind, drawn), value) in kinds.into_iter().zip(paper.pictures) {
            let row = Row::new(what, "gpu", "pictures/s")
                .size(tets, "tets")
                .paper(value);
            all.push(Case::new(row, move |context, row| {
                picture_rate(context, row, tets, kind, drawn)
            }));
        }
    }
    all
}

fn bar(tets: usize) -> Result<TetMesh> {
    generate::bar_of_about(tets, DVec3::new(0.3, 0.1, 0.1))
}

fn step_rate(
    context: &Context,
    row: Row,
    tets: usize,
    (kind, engine): (SolverKind, Engine),
) -> Result<Row> {
    let mesh = bar(tets)?;
    let (mut body, dt) = moving(context.gpu, &mesh, kind, engine)?;
    let steps = if kind == SolverKind::Implicit {
        1
    } else {
        STEPS
    };
    let spread = context
        .timing()
        .measure(|| body.run(steps, dt).map(drop))?
        .per_second(f64::from(steps));
    let iterations = body.iterations()?;
    let note = iterations.last().map_or(String::new(), |n| {
        format!("{n} iterations in the last step")
    });
    Ok(row.size(mesh.tets.len(), "tets").spread(spread).note(note))
}

/// Returns the body, clamped at one end, and its step.
fn moving(
    gpu: &Gpu,
    mesh: &TetMesh,
    kind: SolverKind,
    engine: Engine,
) -> Result<(Box<dyn Simulator>, f64)> {
    let mut material = Material::from_young(3e4);
    if kind == SolverKind::Explicit {
        // Undamped, explicit Euler is never stable.
        let network = DiscreteModel::new(mesh, &material)?;
        let free = vec![false; mesh.nodes.len()];
        let limit = largest_stable_step(&network, &free, SolverKind::Verlet);
        material.damping_time = 0.5 * limit.unwrap_or(0.0);
    }
    let choice = EngineChoice::Exactly(engine);
    let mut body = choice.build_tets(gpu, mesh.clone(), &material, kind)?;
    hold_one_end(body.as_mut())?;
    let limit = body.largest_stable_step();
    let dt = limit.map_or(IMPLICIT_STEP, |limit| 0.5 * limit);
    Ok((body, dt))
}

/// Measures pictures per second, each after a step, or of a body that only moved.
fn picture_rate(
    context: &Context,
    row: Row,
    tets: usize,
    kind: Option<SolverKind>,
    drawn: Drawn,
) -> Result<Row> {
    let (gpu, mesh) = (context.gpu, bar(tets)?);
    let engine = EngineChoice::Auto.resolve(gpu);
    let (mut body, dt) = moving(gpu, &mesh, kind.unwrap_or(SolverKind::Verlet), engine)?;
    let topology = Topology::new(&mesh);
    let depths = depth_field(&mesh, &topology).values;
    let (frame, positions) = (body.nodes().frame(), body.nodes().array().clone());
    let geometry = Geometry::new(gpu, &mesh, &topology, frame, &positions, &depths)?;
    let transfer = TransferFunction::preset("tissue")?;
    let plain = SurfaceColour::Plain([0.9, 0.7, 0.6]);
    let mut surface = Surface::new(gpu, &geometry, &depths, &plain, Shading::Smooth)?;
    let mut raycaster = Raycaster::new(gpu, geometry, &transfer)?;
    let camera = Camera::fit_mesh(&mesh);
    let view = |format| {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
        gpu.target("measured picture", [PIXELS; 2], format, usage)
    };
    let colour = view(wgpu::TextureFormat::Rgba8Unorm)?;
    let depth = view(wgpu::TextureFormat::Depth32Float)?;
    let background = Some([0.0, 0.0, 0.0, 1.0]);
    let spread = context.timing().measure(|| {
        let mut work = gpu.start_recording();
        match kind {
            Some(_) => body.record(&mut work, 1, dt)?,
            None => raycaster.geometry().positions().mark_written(),
        }
        if drawn == Drawn::Surface {
            let target = SurfaceTarget {
                colour: &colour,
                depth: &depth,
                background,
            };
            surface.record(&mut work, &camera, &target)?;
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
    })?;
    let note = kind.map_or(String::new(), |_| format!("steps on the {engine} engine"));
    let row = row.size(mesh.tets.len(), "tets").note(note);
    Ok(row.spread(spread.per_second(1.0)))
}
