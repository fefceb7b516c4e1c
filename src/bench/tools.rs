//! Milliseconds a step in contact with a tool.

use super::{Case, Context, Row};
use crate::generate::{Split, box_mesh};
use crate::physics::{
    Engine, EngineChoice, Material, MaterialModel, Shape, Simulator, SolverKind, Tool, ToolId,
    ToolPose,
};
use crate::{Error, Result};
use glam::{DQuat, DVec3};

pub(super) const ABOUT: &str = "A sphere presses into a slab of neo-Hookean elements, 20 kPa, \
    held at its bottom: implicit steps of 0.2 s, in each of which the sphere moves by a fiftieth of \
    the slab's height, down to a fifth of it and up again.";

/// Depths of the sphere, one a step, in units of the slab's width.
const DEPTHS: [f64; 18] = [
    0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.1, 0.09, 0.08, 0.07, 0.06, 0.05, 0.04,
    0.03, 0.02,
];
const STEP: f64 = 0.2;
const RADIUS: f64 = 0.3;
/// The pose of the sphere above the slab.
const ABOVE: DVec3 = DVec3::new(0.5, 0.52, 0.81);

pub(super) fn cases(quick: bool) -> Vec<Case> {
    // Cells across the slab: 2,500, 20,000 and 160,000 tets.
    let cells: &[usize] = if quick { &[10] } else { &[10, 20, 40] };
    let mut all = Vec::new();
    for &cells in cells {
        for engine in [Engine::Gpu, Engine::Cpu] {
            let row = Row::new("sphere on a slab", &engine.to_string(), "ms");
            let row = row.size(5 * cells * cells * (cells / 2), "tets");
            all.push(Case::new(row, move |context, row| {
                step(context, row, cells, engine)
            }));
        }
    }
    all
}

/// Returns the slab, held at its bottom, with the sphere above it.
pub(super) fn slab(cells: usize) -> Result<crate::mesh::TetMesh> {
    let size = DVec3::new(1.0, 1.0, 0.5);
    box_mesh([cells, cells, cells / 2], size, Split::Five)
}

/// Returns the material of the slab.
pub(super) fn material() -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        damping_time: 0.0,
        density: 1000.0,
        ..Material::from_young(2e4)
    }
}

/// Holds the slab at its bottom and adds the sphere.
pub(super) fn prepare(body: &mut dyn Simulator) -> Result<ToolId> {
    let nodes = (0u32..).zip(&body.mesh().nodes);
    let held: Vec<u32> = nodes.filter(|(_, p)| p.z < 1e-3).map(|(v, _)| v).collect();
    body.pin_nodes(&held)?;
    let tool = Tool {
        shape: Shape::Sphere { radius: RADIUS },
        pose: ToolPose::new(ABOVE, DQuat::IDENTITY),
        friction: 0.0,
        gap: None,
    };
    let contact = body.contact().ok_or_else(|| {
        Error::Input("this body has no contact with tools; use the engine gpu or cpu".into())
    })?;
    contact.add_tool(tool)
}

/// Moves the sphere to a depth below its first pose in one step.
pub(super) fn press(body: &mut dyn Simulator, id: ToolId, depth: f64) -> Result<()> {
    let to = ToolPose::new(ABOVE - DVec3::new(0.0, 0.0, depth), DQuat::IDENTITY);
    body.loads_mut().set_tool_target(id, to)?;
    body.run(1, STEP).map(drop)
}

fn step(context: &Context, row: Row, cells: usize, engine: Engine) -> Result<Row> {
    let mesh = slab(cells)?;
    let tets = mesh.tets.len();
    let choice = EngineChoice::Exactly(engine);
    let kind = SolverKind::Implicit;
    let mut body = choice.build_tets(context.gpu, mesh, &material(), kind)?;
    let id = prepare(body.as_mut())?;
    let mut depths = DEPTHS.iter().cycle();
    let spread = context.timing().measure(|| {
        let depth = depths.next().copied().unwrap_or(0.0);
        press(body.as_mut(), id, depth)
    })?;
    Ok(row.size(tets, "tets").spread(spread))
}
