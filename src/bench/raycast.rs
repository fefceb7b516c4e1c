//! Milliseconds a frame of the raycaster against tets and pixels.

use super::{Case, Context, Row};
use crate::Result;
use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::{LocalFrame, Location, TetMesh, Topology};
use crate::render::{
    Camera, Geometry, Light, Mode, RaycastOptions, Raycaster, Target, local_positions,
};
use crate::study::{peers_camera, peers_transfer};
use std::cell::RefCell;
use std::rc::Rc;

pub(super) const ABOUT: &str = "The benchmark cube, six tets a cell, with a smooth scalar. \
    Everything is redrawn in each frame, and the camera turns by 7° from one to the next; lit \
    frames have a light at the eye.";

/// Memory of a frame with light, bytes a tet, measured at ten million tets on a software driver,
/// which keeps textures there, and rounded up.
const BYTES_PER_TET: u64 = 250;
/// Angle between frames, degrees.
const TURN: f64 = 7.0;

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let sizes: &[usize] = match quick {
        true => &[10_000, 100_000],
        false => &[10_000, 100_000, 1_000_000, 4_000_000, 16_000_000],
    };
    let prepared = Rc::new(RefCell::new(None));
    let mut all = Vec::new();
    for &tets in sizes {
        for light in [Light::None, Light::Head] {
            for side in [512, 1024] {
                let lit = if light == Light::None { "plain" } else { "lit" };
                let what = format!("{lit}, {side} × {side}");
                let row = Row::new(what, "gpu", "ms").size(tets, "tets");
                let prepared = Rc::clone(&prepared);
                let case = Case::new(row, move |context, row| {
                    let mut kept = prepared.borrow_mut();
                    let subject = match kept.take_if(|p: &mut Prepared| p.is(tets, light)) {
                        Some(subject) => subject,
                        None => {
                            // The previous one is dropped first, to limit memory.
                            *kept = None;
                            Prepared::new(context.gpu, tets, light)?
                        }
                    };
                    frame(context, row, kept.insert(subject), side)
                });
                all.push(case.memory(BYTES_PER_TET * tets as u64));
            }
        }
    }
    all
}

/// A raycaster of the cube, for pictures of several sizes.
struct Prepared {
    asked: usize,
    light: Light,
    tets: usize,
    caster: Raycaster,
}

impl Prepared {
    fn new(gpu: &Gpu, asked: usize, light: Light) -> Result<Prepared> {
        let mesh = cube(asked)?;
        let geometry = geometry(gpu, &mesh, light)?;
        let options = RaycastOptions {
            light,
            ..Default::default()
        };
        let caster = Raycaster::with_options(gpu, geometry, &peers_transfer()?, options)?;
        Ok(Prepared {
            asked,
            light,
            tets: mesh.tets.len(),
            caster,
        })
    }

    fn is(&self, tets: usize, light: Light) -> bool {
        self.asked == tets && self.light == light
    }
}

/// Returns the benchmark cube of about `tets` tets.
pub(super) fn cube(tets: usize) -> Result<TetMesh> {
    generate::by_name("cube", Some(tets))
}

/// Returns the geometry of the cube, with lists for light if there is any.
pub(super) fn geometry(gpu: &Gpu, mesh: &TetMesh, light: Light) -> Result<Geometry> {
    let topology = Topology::new(mesh);
    let field = mesh.field("scalar", Location::Node);
    let scalars = field.map(|f| f.values.clone()).unwrap_or_default();
    let frame = LocalFrame::from_mesh(mesh);
    let positions = local_positions(gpu, &frame, &mesh.nodes)?;
    let mut geometry = Geometry::new(gpu, mesh, &topology, frame, &positions, &scalars)?;
    if light != Light::None {
        geometry.enable_lighting(mesh, &topology, &scalars)?;
    }
    Ok(geometry)
}

fn frame(context: &Context, row: Row, subject: &mut Prepared, side: u32) -> Result<Row> {
    let (tets, caster) = (subject.tets, &mut subject.caster);
    let spread = frames(context, caster, peers_camera(), [side; 2])?;
    Ok(row.size(tets, "tets").spread(spread))
}

/// Times frames that are drawn completely, from a camera that turns.
pub(super) fn frames(
    context: &Context,
    caster: &mut Raycaster,
    mut camera: Camera,
    size: [u32; 2],
) -> Result<super::Spread> {
    let gpu = context.gpu;
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let view = gpu.target("measured picture", size, format, usage)?;
    let target = Target {
        colour: &view,
        depth: None,
        background: Some([0.0, 0.0, 0.0, 1.0]),
    };
    context.timing().measure(|| {
        caster.geometry().positions().mark_written();
        let mut work = gpu.start_recording();
        caster.record(&mut work, &camera, Mode::Composite, &target)?;
        work.submit()?;
        camera = camera.orbited(TURN);
        gpu.wait()
    })
}
