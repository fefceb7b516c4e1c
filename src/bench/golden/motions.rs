//! Motions on the GPU compared with the same in float64.

use crate::bench::skins::ball;
use crate::bench::{Case, Context, Row, grids, hold_one_end, tools};
use crate::generate;
use crate::mesh::{LocalFrame, unpack_normal};
use crate::physics::reference::integrators::ReferenceIntegrator;
use crate::physics::reference::springs::ReferenceSprings;
use crate::physics::{
    CgSettings, CpuTets, Damping, DiscreteModel, GpuBody, GpuTets, GridBody, Material,
    MaterialModel, Precision, Simulator, SolverKind,
};
use crate::render::local_positions;
use crate::skin::{Mapping, Skin, SkinBase};
use crate::{Error, Result};
use glam::DVec3;

/// Unit of differences of motions: shares of the size or of the largest force.
const SHARE: &str = "largest difference";

/// Steps of springs, and the bound of their positions relative to the body's length.
const SPRING_STEPS: u32 = 100;
const OF_SPRINGS: f64 = 1e-4;
/// Steps of elements, and the bound of their positions relative to the largest displacement.
const ELEMENT_STEPS: u32 = 20;
const OF_ELEMENTS: f64 = 2e-3;
/// Steps of grid bodies, and the bound of their positions relative to the body's size after one.
const GRID_STEPS: u32 = 50;
const OF_GRID_STEP: f64 = 2e-6;
/// Depths of a sphere, and the bound of its force relative to the largest.
const DEPTHS: [f64; 8] = [0.02, 0.04, 0.06, 0.08, 0.1, 0.096, 0.092, 0.06];
const OF_FORCES: f64 = 5e-3;
/// Cells across the slab under the sphere.
const SLAB_CELLS: usize = 6;
/// Bounds of the positions of a skin, relative to the body's size, and of its normals.
const OF_SKIN: [f64; 2] = [2e-6, 2e-5];

pub(super) fn cases() -> Vec<Case> {
    let row = |what: String, bound: f64| Row::new(what, "gpu", SHARE).bound(bound);
    let mut all: Vec<Case> = SolverKind::ALL
        .into_iter()
        .map(|kind| {
            let row = row(format!("springs, {SPRING_STEPS} steps, {kind}"), OF_SPRINGS);
            Case::new(row, move |context, row| springs(context, row, kind))
        })
        .collect();
    for model in [MaterialModel::NeoHookean, MaterialModel::Corotated] {
        let row = row(format!("{model}, {ELEMENT_STEPS} steps"), OF_ELEMENTS);
        all.push(Case::new(row, move |context, row| {
            elements(context, row, model)
        }));
    }
    let bound = OF_GRID_STEP * f64::from(GRID_STEPS).sqrt();
    let grid = row(format!("grid body, {GRID_STEPS} steps"), bound);
    all.push(Case::new(grid, grid_body));
    all.push(Case::new(
        row("forces on a sphere".into(), OF_FORCES),
        sphere,
    ));
    for mapping in Mapping::ALL {
        let row = row(format!("skin, {mapping}"), OF_SKIN[0]);
        all.push(Case::new(row, move |context, row| {
            skin(context, row, mapping)
        }));
    }
    all
}

/// Returns the largest distance of two lists of points; NaN if a coordinate is.
fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
    let apart = a.iter().zip(b).map(|(a, b)| a.distance(*b));
    apart.fold(0.0, larger)
}

/// Returns the larger of two numbers; NaN if one is.
fn larger(a: f64, b: f64) -> f64 {
    match a.is_nan() || b.is_nan() {
        true => f64::NAN,
        false => a.max(b),
    }
}

fn springs(context: &Context, row: Row, kind: SolverKind) -> Result<Row> {
    let material = Material {
        damping: 0.05,
        damping_time: 1e-4,
        damping_kind: Damping::Axial,
        ..Material::from_young(1e5)
    };
    let mesh = generate::paper_bar()?;
    let gravity = DVec3::new(0.5, 0.0, -9.81);
    let mut body = GpuBody::new(context.gpu, &mesh, &material)?;
    let mut truth = ReferenceSprings::new(DiscreteModel::new(&mesh, &material)?);
    let held = |p: DVec3| p.x < 1e-3;
    body.pin(held);
    for (pinned, p) in truth.pinned.iter_mut().zip(&mesh.nodes) {
        *pinned |= held(*p);
    }
    body.set_gravity(gravity);
    truth.gravity = gravity;
    let h = if kind.is_implicit() { 0.01 } else { 2e-4 };
    kind.solver(context.gpu, &body)?
        .run(&mut body, SPRING_STEPS, h)?;
    let start = truth.x.clone();
    let mut reference = ReferenceIntegrator::new(kind, 1e-10);
    for _ in 0..SPRING_STEPS {
        reference.step(&mut truth, h)?;
    }
    let model = &truth.model;
    let found = body.positions()?.into_iter().map(|x| model.to_metres(x));
    let found: Vec<DVec3> = found.collect();
    let (low, high) = crate::mesh::bounds(&start);
    let size = (high - low).max_element();
    let moved = farthest(&truth.x, &start) / size;
    Ok(row
        .judged(farthest(&found, &truth.x) / size, moved > 1e-3)
        .note(format!("of the length; moved by {moved:.3} of it")))
}

fn elements(context: &Context, row: Row, model: MaterialModel) -> Result<Row> {
    let mesh = generate::bar([8, 2, 2], DVec3::new(0.8, 0.2, 0.2))?;
    let material = Material {
        model,
        poisson: 0.3,
        ..Material::from_young(5e4)
    };
    let (gpu, kind) = (context.gpu, SolverKind::Implicit);
    let settings = CgSettings {
        tolerance: 1e-6,
        ..CgSettings::default()
    };
    let mut body = GpuTets::new(gpu, mesh.clone(), &material, kind)?;
    body.set_integrator(kind, settings)?;
    let double = Precision::Double;
    let mut truth = CpuTets::new(gpu, mesh.clone(), &material, kind, settings, double)?;
    let bodies: [&mut dyn Simulator; 2] = [&mut body, &mut truth];
    for body in bodies {
        hold_one_end(body)?;
        body.run(ELEMENT_STEPS, 0.01)?;
    }
    let truth = truth.positions()?;
    let moved = farthest(&truth, &mesh.nodes);
    let apart = farthest(&body.positions()?, &truth) / moved;
    let enough = moved > 0.01;
    Ok(row
        .judged(apart, enough)
        .note(format!("of the largest displacement, {moved:.3} m")))
}

fn grid_body(context: &Context, row: Row) -> Result<Row> {
    let model = grids::model(2_000)?;
    let (size, h) = (0.1, 0.5 * model.conservative_step());
    let mut truth = model.reference();
    let mut body = GridBody::new(context.gpu, model)?;
    let gravity = DVec3::new(1.0, -9.0, 2.0);
    let held: Vec<u32> = truth.particles.iter().copied().take(40).collect();
    body.pin_nodes(&held)?;
    body.set_gravity(gravity);
    truth.gravity = gravity;
    for i in held {
        truth.inverse_masses[i as usize] = 0.0;
    }
    let (frame, unit) = (body.model().frame, body.model().length_unit);
    let in_metres = |p: &DVec3| (*p - frame.origin) * unit;
    // Both start from the values rounded to f32.
    truth.x = body.positions()?.iter().map(in_metres).collect();
    truth.previous = truth.x.clone();
    let start = truth.x.clone();
    body.run(GRID_STEPS, h)?;
    truth.first_step(h);
    (1..GRID_STEPS).for_each(|_| truth.step(h));
    let found: Vec<DVec3> = body.positions()?.iter().map(in_metres).collect();
    let of_particles = |x: &[DVec3]| -> Vec<DVec3> {
        let particles = truth.particles.iter();
        particles.map(|i| x[*i as usize]).collect()
    };
    let [found, there, start] = [&found, &truth.x, &start].map(|x| of_particles(x));
    let moved = farthest(&there, &start) / size;
    Ok(row
        .judged(farthest(&found, &there) / size, moved > 1e-3)
        .note(format!("of the diameter; moved by {moved:.3} of it")))
}

fn sphere(context: &Context, row: Row) -> Result<Row> {
    let (gpu, kind, mesh) = (context.gpu, SolverKind::Implicit, tools::slab(SLAB_CELLS)?);
    let (material, settings) = (tools::material(), CgSettings::default());
    let mut body = GpuTets::new(gpu, mesh.clone(), &material, kind)?;
    let double = Precision::Double;
    let mut truth = CpuTets::new(gpu, mesh, &material, kind, settings, double)?;
    let forces = |body: &mut dyn Simulator| -> Result<Vec<DVec3>> {
        let id = tools::prepare(body)?;
        let mut forces = Vec::new();
        for depth in DEPTHS {
            tools::press(body, id, depth)?;
            let found = body.contact().map(|contact| contact.tool_forces());
            let found = found.transpose()?.unwrap_or_default();
            forces.extend(found.first().map(|reaction| reaction.force));
        }
        Ok(forces)
    };
    let (found, there) = (forces(&mut body)?, forces(&mut truth)?);
    let most = there.iter().map(|f| f.length()).fold(0.0, f64::max);
    let all = found.len() == DEPTHS.len() && there.len() == DEPTHS.len();
    Ok(row
        .judged(farthest(&found, &there) / most, all && most > 0.0)
        .note(format!("of the largest force, {most:.1} N")))
}

fn skin(context: &Context, row: Row, mapping: Mapping) -> Result<Row> {
    let gpu = context.gpu;
    let rest = generate::ball(1.0, 8)?.boundary_surface(None)?;
    let bend = |p: &DVec3| *p + DVec3::new(0.3 * p.y * p.z, 0.2 * p.x.sin(), 0.1 * p.x);
    let moved: Vec<DVec3> = rest.vertices.iter().map(bend).collect();
    let (low, high) = crate::mesh::bounds(&rest.vertices);
    let frame = LocalFrame::from_bounds(low, high);
    let array = local_positions(gpu, &frame, &moved)?;
    let (nodes, triangles) = (&rest.vertices, &rest.triangles);
    let base = SkinBase::with_area_normals(gpu, &array, frame, nodes, triangles)?;
    let skin = Skin::new(gpu, &ball(40, 80, 1.1, 0.04), &base, mapping)?;
    let placed = skin.skinned_vertices()?;
    let local: Vec<[f32; 4]> = gpu.read_array(&array)?;
    let local = local
        .iter()
        .map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()));
    let local: Vec<DVec3> = local.collect();
    let packed: Vec<u32> = gpu.read_array(base.normals())?;
    let normals: Vec<Option<DVec3>> = packed.iter().map(|n| unpack_normal(*n)).collect();
    if placed.len() != skin.bound().len() {
        let (there, bound) = (placed.len(), skin.bound().len());
        return Err(Error::Gpu(format!(
            "{there} of {bound} vertices of a skin came back"
        )));
    }
    let mut worst = [0.0, 0.0];
    for (found, bound) in placed.iter().zip(skin.bound()) {
        let truth = bound.skin(&local, &normals);
        let position = (found.position - frame.origin) / frame.scale;
        let pairs = [(position, truth.position), (found.normal, truth.normal)];
        for (worst, (a, b)) in worst.iter_mut().zip(pairs) {
            *worst = larger(*worst, a.distance(b));
        }
    }
    let note = format!(
        "of the size; normals {:.1e}, bound {:.0e}",
        worst[1], OF_SKIN[1]
    );
    Ok(row.judged(worst[0], worst[1] <= OF_SKIN[1]).note(note))
}
