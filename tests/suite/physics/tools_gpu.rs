//! Tools on the GPU against those on the CPU, and against analytic results.

use crate::support::gpu;
use glam::{DQuat, DVec3};
use palpate::generate::{Split, box_mesh};
use palpate::mesh::TetMesh;
use palpate::physics::{
    CgSettings, CpuTets, Engine, GpuTets, Material, MaterialModel, Precision, Reaction, Shape,
    Simulator, SolverKind, Tool, ToolId, ToolPose,
};

fn material() -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        damping_time: 0.0,
        density: 1000.0,
        ..Material::from_young(2e4)
    }
}

/// Returns a body on the GPU, and the same on the CPU in float64.
fn both(mesh: &TetMesh) -> [Box<dyn Simulator>; 2] {
    let (gpu, kind) = (gpu(), SolverKind::Implicit);
    let settings = CgSettings::default();
    let mesh = || mesh.clone();
    [
        Box::new(GpuTets::new(&gpu, mesh(), &material(), kind).unwrap()),
        Box::new(
            CpuTets::new(&gpu, mesh(), &material(), kind, settings, Precision::Double).unwrap(),
        ),
    ]
}

fn add(body: &mut dyn Simulator, shape: &Shape, at: DVec3, friction: f64) -> ToolId {
    let tool = Tool {
        shape: shape.clone(),
        pose: ToolPose::new(at, DQuat::IDENTITY),
        friction,
        gap: None,
    };
    body.contact().unwrap().add_tool(tool).unwrap()
}

fn go(body: &mut dyn Simulator, id: ToolId, to: DVec3, dt: f64) -> Reaction {
    let to = ToolPose::new(to, DQuat::IDENTITY);
    body.loads_mut().set_tool_target(id, to).unwrap();
    body.run(1, dt).unwrap();
    body.contact().unwrap().tool_forces().unwrap()[0]
}

fn slab(cells: usize) -> TetMesh {
    box_mesh(
        [cells, cells, cells / 2],
        DVec3::new(1.0, 1.0, 0.5),
        Split::Five,
    )
    .unwrap()
}

#[test]
fn sphere_indentation_forces_match_cpu() {
    let mesh = slab(10);
    let shape = Shape::Sphere { radius: 0.3 };
    let run = |body: &mut dyn Simulator| -> Vec<Reaction> {
        body.pin(|p| p.z < 1e-3).unwrap();
        let start = DVec3::new(0.5, 0.52, 0.81);
        let id = add(body, &shape, start, 0.0);
        // Retracted by less than the indentation, and by many gaps, it is still in contact.
        let depths = [0.02, 0.04, 0.06, 0.08, 0.1, 0.096, 0.092, 0.06];
        depths
            .iter()
            .map(|d| go(body, id, start - DVec3::new(0.0, 0.0, *d), 0.2))
            .collect()
    };
    let [mut a, mut b] = both(&mesh);
    let (found, truth) = (run(a.as_mut()), run(b.as_mut()));
    assert_eq!((a.engine(), b.engine()), (Engine::Gpu, Engine::Cpu));
    let most = truth.iter().map(|r| r.force.z).fold(0.0, f64::max);
    assert!(truth[7].force.z > 0.2 * most, "{truth:?}");
    for (a, b) in found.iter().zip(&truth) {
        assert!((a.force - b.force).length() < 5e-3 * most, "{a:?} {b:?}");
        assert!(
            (a.moment - b.moment).length() < 5e-3 * 0.3 * most,
            "{a:?} {b:?}"
        );
    }
    let (x, y) = (a.positions().unwrap(), b.positions().unwrap());
    let off = x.iter().zip(&y).map(|(a, b)| a.distance(*b));
    assert!(off.fold(0.0, f64::max) < 2e-3 * 0.1);
}

#[test]
fn fast_sphere_has_no_tunnelling() {
    let [mut body, _] = both(&slab(10));
    let shape = Shape::Sphere { radius: 0.15 };
    body.pin(|p| p.z < 1e-3).unwrap();
    body.set_inversion_allowed(true);
    let mut at = DVec3::new(0.3, 0.5, 0.8);
    let id = add(body.as_mut(), &shape, at, 0.3);
    let down = DVec3::new(0.0, 0.0, -0.15);
    let aside = DVec3::new(0.15, 0.0, 0.0);
    for way in [down, down, aside, aside, aside, -down] {
        at += way;
        go(body.as_mut(), id, at, 0.01);
        let x = body.positions().unwrap();
        let nearest = x
            .iter()
            .map(|x| shape.distance(*x - at))
            .fold(f64::INFINITY, f64::min);
        assert!(nearest > 0.0, "{nearest} at {at}");
    }
}

/// Returns the distance that a block has slid on an inclined plane with friction ½ after ¼ and
/// after ½ of a second, in its edges, and the fraction of its weight on the plane before.
fn slid(degrees: f64) -> [f64; 3] {
    let edge = 0.1;
    let mesh = box_mesh([3, 3, 2], DVec3::new(edge, edge, 0.5 * edge), Split::Five).unwrap();
    let [mut body, _] = both(&mesh);
    let body = body.as_mut();
    add(body, &Shape::Plane, DVec3::new(0.0, 0.0, -1e-3), 0.5);
    let tilted = |degrees: f64| {
        let angle = degrees.to_radians();
        9.81 * DVec3::new(angle.sin(), 0.0, -angle.cos())
    };
    body.loads_mut().set_gravity(tilted(0.0));
    body.run(80, 0.01).unwrap();
    let weight: f64 = 9.81 * body.masses().iter().sum::<f64>();
    let borne = -body.contact().unwrap().tool_forces().unwrap()[0].force.z / weight;
    // Tilted slowly to avoid oscillations.
    for k in 1..=20 {
        body.loads_mut()
            .set_gravity(tilted(f64::from(k) / 20.0 * degrees));
        body.run(1, 0.01).unwrap();
    }
    let along = |body: &dyn Simulator| {
        let x = body.positions().unwrap();
        x.iter().map(|x| x.x).sum::<f64>() / (edge * x.len() as f64)
    };
    let start = along(body);
    let [quarter, half] = [(); 2].map(|()| {
        body.run(25, 0.01).unwrap();
        along(body) - start
    });
    [quarter, half, borne]
}

#[test]
#[ignore = "long: scripts/test --full"]
fn block_sticks_below_friction_angle_and_slides_above() {
    let angle = 0.5f64.atan().to_degrees();
    let [quarter, half, borne] = slid(angle - 1.0);
    assert!(
        (borne - 1.0).abs() < 2e-3,
        "the plane supports {borne} of the weight"
    );
    // Sticking, it creeps by less than the regularisation speed of the friction, plus rounding.
    assert!((half - quarter).abs() < 0.25 * 2e-4, "{quarter} {half}");
    let [quarter, half, _] = slid(angle + 1.0);
    let steep = (angle + 1.0).to_radians();
    let acceleration = 9.81 * (steep.sin() - 0.5 * steep.cos());
    let expected = acceleration * 0.25f64.powi(2) / 0.1;
    let curve = half - 2.0 * quarter;
    assert!((curve / expected - 1.0).abs() < 0.05, "{curve} {expected}");
}

#[test]
fn distant_tool_leaves_steps_unchanged() {
    let mesh = slab(6);
    let run = |tool: bool| {
        let [mut body, _] = both(&mesh);
        body.pin(|p| p.x < 1e-3).unwrap();
        body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
        let start = DVec3::new(0.5, 0.5, 3.0);
        let id = tool.then(|| add(body.as_mut(), &Shape::Sphere { radius: 0.2 }, start, 0.3));
        for k in 1..=5 {
            if let Some(id) = id {
                let to = start + f64::from(k) * DVec3::new(0.3, 0.0, -0.1);
                let to = ToolPose::new(to, DQuat::IDENTITY);
                body.loads_mut().set_tool_target(id, to).unwrap();
            }
            body.run(1, 0.01).unwrap();
        }
        (body.positions().unwrap(), body.iterations().unwrap())
    };
    let ((x, of_tools), (y, without)) = (run(true), run(false));
    let off = x.iter().zip(&y).map(|(a, b)| a.distance(*b));
    assert!(off.fold(0.0, f64::max) < 1e-6);
    // One linear solve per step, reported in rounds of eight iterations.
    for (a, b) in of_tools.iter().zip(&without) {
        assert!(*a <= b.next_multiple_of(8) + 8, "{of_tools:?} {without:?}");
    }
}

#[test]
fn resumed_run_is_identical() {
    let mesh = slab(6);
    let shape = Shape::Sphere { radius: 0.2 };
    let start = DVec3::new(0.5, 0.5, 0.71);
    let made = || {
        let [mut body, _] = both(&mesh);
        body.pin(|p| p.z < 1e-3).unwrap();
        let id = add(body.as_mut(), &shape, start, 0.3);
        (body, id)
    };
    let at = |k: u32| start - f64::from(k) * DVec3::new(0.005, 0.0, 0.02);
    let (mut whole, id) = made();
    let mut state = None;
    for k in 1..=4 {
        go(whole.as_mut(), id, at(k), 0.05);
        if k == 2 {
            state = Some(whole.checkpoint().unwrap().state().unwrap());
        }
    }
    let (mut resumed, id) = made();
    resumed
        .checkpoint_mut()
        .unwrap()
        .set_state(&state.unwrap())
        .unwrap();
    for k in 3..=4 {
        go(resumed.as_mut(), id, at(k), 0.05);
    }
    assert!(whole.positions().unwrap() == resumed.positions().unwrap());
}

#[test]
fn unsupported_tool_contact_is_reported() {
    let mesh = slab(4);
    let (gpu, kind) = (gpu(), SolverKind::Implicit);
    let tool = || Tool {
        shape: Shape::Plane,
        pose: ToolPose::new(DVec3::ZERO, DQuat::IDENTITY),
        friction: 0.0,
        gap: None,
    };
    let springs = Material::from_young(2e4);
    let mut body = GpuTets::new(&gpu, mesh.clone(), &springs, kind).unwrap();
    let message = body
        .contact()
        .unwrap()
        .add_tool(tool())
        .unwrap_err()
        .to_string();
    assert!(message.contains("use --material"), "{message}");
    let mut body = GpuTets::new(&gpu, mesh, &material(), kind).unwrap();
    body.contact().unwrap().add_tool(tool()).unwrap();
    let settings = CgSettings::default();
    let message = body
        .set_integrator(SolverKind::Symplectic, settings)
        .unwrap_err();
    assert!(message.to_string().contains("use implicit"), "{message}");
}
