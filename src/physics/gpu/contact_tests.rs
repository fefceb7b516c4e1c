//! Tests of the contact kernels one by one against their float64 form, on random states.
#![allow(clippy::unwrap_used)]

use super::contact::gpu_data::{ContactStepState, Tool as ToolData};
use super::implicit_contact::{ContactContext, ContactPasses};
use super::integrator::{Integrator, Stage, Timing};
use crate::generate::{Split, ball, box_mesh};
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, Topology, TriMesh};
use crate::physics::contact::{DistanceField, ToolMotion};
use crate::physics::{
    GpuBody, ImplicitEuler, Material, MaterialModel, Shape, Tool, ToolId, ToolPose,
};
use bytemuck::Zeroable;
use glam::{DQuat, DVec3};
use std::sync::Arc;

/// Reproducible pseudo-random numbers in −1..1.
fn vectors(count: usize, seed: u64, size: f64) -> Vec<DVec3> {
    let mut state = seed;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    };
    (0..count)
        .map(|_| size * DVec3::new(next(), next(), next()))
        .collect()
}

const DT: f64 = 0.01;

/// One of each shape, about one or many edges of the block in size.
fn shapes() -> Vec<Shape> {
    let [sphere, capsule] = [0.21, 0.12].map(|radius| (radius, 0.3));
    let mesh = ball(0.2, 12).unwrap();
    let surface = TriMesh {
        triangles: boundary(&mesh),
        vertices: mesh.nodes,
        ..TriMesh::default()
    };
    vec![
        Shape::Sphere { radius: sphere.0 },
        Shape::Capsule {
            radius: capsule.0,
            length: capsule.1,
        },
        Shape::Box {
            half: DVec3::new(0.2, 0.15, 0.1),
        },
        Shape::Plane,
        Shape::Sdf(Arc::new(DistanceField::new(&surface).unwrap())),
    ]
}

fn boundary(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let topology = Topology::new(mesh);
    let faces = topology.boundary.iter();
    faces.map(|f| topology.boundary_nodes(mesh, *f)).collect()
}

fn block() -> TetMesh {
    box_mesh([5, 4, 3], DVec3::new(1.0, 0.8, 0.6), Split::Five).unwrap()
}

/// A perturbed block, with a rotated and moving `shape` slightly inside its top, or at the given
/// height above it.
fn pressed(
    gpu: &Gpu,
    shape: Shape,
    seed: u64,
    (goes, friction, above): (bool, f64, f64),
) -> (GpuBody, ToolId) {
    let mesh = block();
    let material = Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        density: 1000.0,
        ..Material::from_young(2e4)
    };
    let mut body = GpuBody::new(gpu, &mesh, &material).unwrap();
    body.pin(|p| p.z < 1e-3);
    let n = mesh.nodes.len();
    let off = vectors(n, seed, 0.01);
    let x: Vec<DVec3> = mesh.nodes.iter().zip(&off).map(|(p, d)| *p + *d).collect();
    body.set_positions(&x).unwrap();
    if goes {
        body.set_velocities(&vectors(n, seed + 1, 0.2)).unwrap();
    }
    let [axis, aside] = vectors(2, seed + 2, 1.0)[..] else {
        unreachable!()
    };
    let deep = match &shape {
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } => *radius,
        Shape::Box { half } => half.z,
        Shape::Sdf(_) => 0.2,
        Shape::Plane => 0.0,
    };
    // A plane facing the block from above would contain all of it.
    let (height, turn) = match &shape {
        Shape::Plane => (0.61, DQuat::from_axis_angle(DVec3::X, 3.0)),
        _ => (0.59 + deep + above, DQuat::from_scaled_axis(0.2 * axis)),
    };
    let at = DVec3::new(0.43, 0.37, height) + DVec3::new(0.05, 0.05, 0.002) * aside;
    let tool = Tool {
        shape,
        pose: ToolPose::new(at, turn),
        friction,
        gap: Some(0.02),
    };
    let id = body.loads_mut().add_tool(tool.pose);
    body.set_tools(&[tool], &boundary(&mesh)).unwrap();
    if goes {
        let to = ToolPose::new(
            at + 0.004 * axis,
            DQuat::from_scaled_axis(0.01 * aside) * turn,
        );
        body.loads_mut().set_tool_target(id, to).unwrap();
        body.upload_changes().unwrap();
    }
    (body, id)
}

/// The reference in float64: displacements, velocities and tool motions as rounded to f32.
struct Truth {
    u: Vec<[f64; 4]>,
    v: Vec<[f64; 4]>,
    free: Vec<f64>,
    paths: Vec<ToolMotion>,
}

fn wide(v: &[f32; 4]) -> [f64; 4] {
    [f64::from(v[0]), f64::from(v[1]), f64::from(v[2]), 0.0]
}

fn turn(q: &[f32; 4]) -> [f64; 4] {
    q.map(f64::from)
}

fn truth(gpu: &Gpu, body: &GpuBody) -> Truth {
    let contact = body.contact.as_ref().unwrap();
    let velocities: Vec<[f32; 4]> = gpu.read_array(&body.velocities).unwrap();
    let masses: Vec<[f32; 2]> = gpu.read_array(&body.masses).unwrap();
    let tools: Vec<ToolData> = gpu.read_buffer(&contact.tools).unwrap();
    let paths = tools.iter().map(|t| ToolMotion {
        from: [wide(&t.start_position), turn(&t.start_rotation)],
        to: [wide(&t.target_position), turn(&t.target_rotation)],
    });
    Truth {
        u: contact.displacements(&body.nodes.local().unwrap()),
        v: velocities.iter().map(wide).collect(),
        free: masses
            .iter()
            .map(|m| f64::from(u8::from(m[1] != 0.0)))
            .collect(),
        paths: paths.collect(),
    }
}

/// Displaces by the velocities over a time.
fn moved(u: &[[f64; 4]], v: &[[f64; 4]], h: f64) -> Vec<[f64; 4]> {
    let both = u.iter().zip(v);
    both.map(|(u, v)| [0, 1, 2, 3].map(|k| u[k] + h * v[k]))
        .collect()
}

/// Largest difference relative to the largest magnitude.
fn worst(found: &[[f64; 4]], truth: &[[f64; 4]]) -> f64 {
    let length = |v: [f64; 4]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let size = truth.iter().map(|t| length(*t)).fold(0.0, f64::max);
    assert!(size > 0.0, "no node is in contact");
    let off = found.iter().zip(truth);
    let off = off.map(|(a, b)| length([0, 1, 2, 3].map(|k| a[k] - b[k])));
    off.fold(
        0.0,
        |worst: f64, e| if e.is_nan() { f64::NAN } else { worst.max(e) },
    ) / size
}

/// Puts the tools at the end of their motion in the step, as in its last iterations.
fn at_the_end(gpu: &Gpu, body: &GpuBody) {
    let contact = body.contact.as_ref().unwrap();
    let mut tools: Vec<ToolData> = gpu.read_buffer(&contact.tools).unwrap();
    for tool in &mut tools {
        (tool.current_position, tool.current_rotation) =
            (tool.target_position, tool.target_rotation);
        (tool.friction_position, tool.friction_rotation) =
            (tool.start_position, tool.start_rotation);
    }
    let bytes = bytemuck::cast_slice(&tools);
    gpu.queue().write_buffer(&contact.tools, 0, bytes);
    let state = ContactStepState {
        stage: 1,
        stages: 1,
        ..ContactStepState::zeroed()
    };
    let bytes = bytemuck::bytes_of(&state);
    gpu.queue().write_buffer(&contact.contact_state, 0, bytes);
}

fn timing(body: &GpuBody) -> Timing {
    let dt = (DT / body.units.time) as f32;
    Timing {
        dt,
        previous_dt: dt,
    }
}

/// The inputs of every pass of a step.
fn parts<'a>(
    solver: &'a ImplicitEuler,
    body: &'a GpuBody,
) -> (&'a ContactPasses, ContactContext<'a>) {
    solver
        .scheme
        .contact_context(&solver.core, body, timing(body))
        .unwrap()
}

/// Multiplies the rows of faces and nodes by `p`, as in the linear solve.
fn product(gpu: &Gpu, body: &GpuBody, p: &[[f64; 4]]) -> Vec<[f64; 4]> {
    let contact = body.contact.as_ref().unwrap();
    let shares: Vec<[f32; 4]> = gpu.read_array(&contact.node_contributions).unwrap();
    let faces: Vec<[f32; 4]> = gpu.read_array(&contact.faces).unwrap();
    let corners: Vec<[u32; 4]> = gpu.read_array(&contact.corners).unwrap();
    let times = |texels: &[[f32; 4]], p: [f64; 4]| {
        let [[xx, xy, xz, yy], [yz, zz, ..]] = [texels[0], texels[1]].map(|t| t.map(f64::from));
        [
            xx * p[0] + xy * p[1] + xz * p[2],
            xy * p[0] + yy * p[1] + yz * p[2],
            xz * p[0] + yz * p[1] + zz * p[2],
            0.0,
        ]
    };
    let mut y: Vec<[f64; 4]> = (0..p.len())
        .map(|i| times(&shares[3 * i + 1..3 * i + 3], p[i]))
        .collect();
    for (f, face) in corners.iter().enumerate() {
        if faces[15 * f + 2][3] == 0.0 {
            continue;
        }
        for side in 0..3 {
            let (i, j) = (face[side] as usize, face[(side + 1) % 3] as usize);
            let block = &faces[15 * f + 9 + 2 * side..15 * f + 11 + 2 * side];
            for (a, b) in [(i, j), (j, i)] {
                let by = times(block, [0, 1, 2, 3].map(|k| p[b][k] - p[a][k]));
                y[a] = [0, 1, 2, 3].map(|k| y[a][k] + by[k]);
            }
        }
    }
    y
}

#[test]
fn tool_forces_and_blocks_match_float64() {
    let gpu = Gpu::new().unwrap();
    for (k, shape) in shapes().into_iter().enumerate() {
        for friction in [0.0, 0.4] {
            let seed = 10 * k as u64 + 1;
            let (body, _) = pressed(&gpu, shape.clone(), seed, (true, friction, 0.0));
            let solver = ImplicitEuler::new(&gpu, &body).unwrap();
            let (steps, with) = parts(&solver, &body);
            at_the_end(&gpu, &body);
            let mut work = gpu.start_recording();
            for pass in with.force_passes(steps, &body.velocities).unwrap() {
                pass.record(&mut work);
            }
            work.submit().unwrap();
            let contact = body.contact.as_ref().unwrap();
            let shares: Vec<[f32; 4]> = gpu.read_array(&contact.node_contributions).unwrap();
            let found: Vec<[f64; 4]> = shares.iter().step_by(3).map(wide).collect();
            let at = truth(&gpu, &body);
            let h = f64::from(with.dt);
            let p: Vec<[f64; 4]> = vectors(at.u.len(), seed + 7, 1.0)
                .iter()
                .map(|p| [p.x, p.y, p.z, 0.0])
                .collect();
            let end = moved(&at.u, &at.v, h);
            let scene = (&at.free[..], &at.paths[..]);
            let [f, y] = contact
                .reference()
                .forces(&at.u, [&end, &at.v], scene, (h, &p));
            let off = worst(&found, &f);
            // The sliding velocity is a difference of rotations and positions, with cancellation.
            let most = if friction > 0.0 { 2e-4 } else { 5e-6 };
            assert!(off < most, "{shape:?} {friction}: {off}");
            let own = product(&gpu, &body, &p);
            let off = worst(&own, &y);
            assert!(off < most, "{shape:?} {friction}: {off}");
            // Sensitivity check: with the tool at its start the comparison fails.
            let stays = at.paths.iter().map(|path| ToolMotion {
                to: path.from,
                ..*path
            });
            let stays: Vec<ToolMotion> = stays.collect();
            let scene = (&at.free[..], &stays[..]);
            let [f, y] = contact
                .reference()
                .forces(&at.u, [&end, &at.v], scene, (h, &p));
            assert!(worst(&found, &f) > 1e-3 && worst(&own, &y) > 1e-3);
        }
    }
}

#[test]
fn step_system_contains_tool_blocks() {
    let gpu = Gpu::new().unwrap();
    let shape = Shape::Sphere { radius: 0.21 };
    let p = vectors(block().nodes.len(), 5, 1.0);
    let p: Vec<[f32; 4]> = p
        .iter()
        .map(|p| p.as_vec3().extend(0.0).to_array())
        .collect();
    let run = |away: bool| {
        let (mut body, id) = pressed(&gpu, shape.clone(), 3, (false, 0.3, 0.0));
        if away {
            let far = ToolPose::new(DVec3::new(0.0, 0.0, 3.0), DQuat::IDENTITY);
            body.loads_mut().teleport_tool(id, far).unwrap();
            body.upload_changes().unwrap();
        }
        let solver = ImplicitEuler::new(&gpu, &body).unwrap();
        let step = solver
            .scheme
            .step(&solver.core, &body, timing(&body))
            .unwrap();
        let [Stage::Passes(begin), Stage::Loop { gate, rounds, .. }, ..] = &step.stages[..] else {
            panic!("an implicit step must begin with the system and its solve")
        };
        let mut work = gpu.start_recording();
        begin.iter().for_each(|pass| pass.record(&mut work));
        work.submit().unwrap();
        gpu.write_array(&solver.scheme.preconditioned[0], &p)
            .unwrap();
        let mut work = gpu.start_recording();
        gate.record(&mut work);
        rounds[0].record(&mut work);
        work.submit().unwrap();
        let found: Vec<[f32; 4]> = gpu.read_array(&solver.scheme.product).unwrap();
        (body, found)
    };
    let ((body, near), (_, far)) = (run(false), run(true));
    let by_tool: Vec<[f64; 4]> = near
        .iter()
        .zip(&far)
        .map(|(a, b)| [0, 1, 2, 3].map(|k| f64::from(a[k]) - f64::from(b[k])))
        .collect();
    let at = truth(&gpu, &body);
    let h = f64::from(timing(&body).dt);
    let p: Vec<[f64; 4]> = p.iter().map(wide).collect();
    let contact = body.contact.as_ref().unwrap();
    let scene = (&at.free[..], &at.paths[..]);
    let [_, mut y] = contact
        .reference()
        .forces(&at.u, [&at.u, &at.v], scene, (h, &p));
    for (y, free) in y.iter_mut().zip(&at.free) {
        *y = y.map(|x| free * x);
    }
    let off = worst(&by_tool, &y);
    assert!(off < 5e-5, "{off}");
}

#[test]
fn collision_free_fraction_matches_float64() {
    let gpu = Gpu::new().unwrap();
    for (k, shape) in shapes().into_iter().enumerate() {
        if matches!(shape, Shape::Plane) {
            continue;
        }
        let seed = 100 + k as u64;
        let (body, _) = pressed(&gpu, shape.clone(), seed, (true, 0.0, 0.05));
        let solver = ImplicitEuler::new(&gpu, &body).unwrap();
        let (steps, with) = parts(&solver, &body);
        at_the_end(&gpu, &body);
        let at = truth(&gpu, &body);
        let h = f64::from(with.dt);
        // Upwards, so that some points would pass through.
        let directions: Vec<[f32; 4]> = vectors(at.u.len(), seed + 3, 0.05 / h)
            .iter()
            .zip(&at.free)
            .map(|(p, free)| {
                let p = *free * (*p + DVec3::new(0.0, 0.0, 0.25 / h));
                p.as_vec3().extend(0.0).to_array()
            })
            .collect();
        gpu.write_array(&with.start.velocities, &directions)
            .unwrap();
        gpu.write_array(&solver.core.next_velocities, &velocities(&gpu, &body))
            .unwrap();
        let mut work = gpu.start_recording();
        steps.ccd_pass(&with).unwrap().record(&mut work);
        work.submit().unwrap();
        let parts: Vec<[f32; 2]> = gpu.read_buffer(&steps.step_bounds).unwrap();
        let found = parts.iter().map(|p| f64::from(p[0])).fold(1.0, f64::min);
        let start = moved(&at.u, &at.v, h);
        let directions: Vec<[f64; 4]> = directions.iter().map(wide).collect();
        let end = moved(&start, &directions, h);
        let contact = body.contact.as_ref().unwrap();
        let expected =
            contact
                .reference()
                .collision_free_fraction([&start, &end], &at.free, &at.paths);
        assert!(expected > 0.0 && expected < 0.9, "{shape:?}: {expected}");
        assert!(
            (found - expected).abs() < 2e-4,
            "{shape:?}: {found} {expected}"
        );
        // Sensitivity check of the comparison.
        let end = moved(&start, &directions, 1.1 * h);
        let other =
            contact
                .reference()
                .collision_free_fraction([&start, &end], &at.free, &at.paths);
        assert!((found - other).abs() > 1e-3, "{shape:?}: {found} {other}");
    }
}

fn velocities(gpu: &Gpu, body: &GpuBody) -> Vec<[f32; 4]> {
    gpu.read_array(&body.velocities).unwrap()
}
