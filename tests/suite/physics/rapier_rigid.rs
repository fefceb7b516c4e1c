//! Rigid regions, dynamic tools and joints of the rapier engine.

use crate::support::gpu;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{Field, Location, TetMesh};
use palpate::physics::{
    Capability, Engine, EngineChoice, GrabMode, Joint, JointKind, Material, MaterialModel,
    Simulator, SolverKind,
};
use palpate::scene::{Scene, Stage};

/// Region 1 is soft, the others are rigid; the body is stretched to make joints visible.
fn material(rigid: &[i64]) -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        damping_time: 0.01,
        region_field: Some("label".into()),
        rigid: rigid.iter().copied().collect(),
        ..Material::from_young(1e6)
    }
}

fn made(engine: Engine, mesh: &TetMesh, material: &Material) -> Box<dyn Simulator> {
    let choice = EngineChoice::Exactly(engine);
    let body = choice.build_tets(&gpu(), mesh.clone(), material, SolverKind::Implicit);
    body.unwrap()
}

/// Returns a soft block of 10 cm about x = −1 and bars of 40 cm along x from these positions,
/// regions 2, 3 ….
fn beside(bars: &[DVec3]) -> TetMesh {
    let soft = generate::bar([2; 3], DVec3::splat(0.1)).unwrap();
    let bar = generate::bar([8, 1, 1], DVec3::new(0.4, 0.04, 0.04)).unwrap();
    let (mut nodes, mut tets) = (Vec::new(), Vec::new());
    let mut labels = Vec::new();
    let shift = DVec3::new(-1.0, 0.0, 0.0);
    let pieces = std::iter::once((&soft, shift)).chain(bars.iter().map(|at| (&bar, *at)));
    for (label, (piece, at)) in pieces.enumerate() {
        let first = nodes.len() as u32;
        nodes.extend(piece.nodes.iter().map(|p| *p + at));
        tets.extend(piece.tets.iter().map(|t| t.map(|v| v + first)));
        labels.extend(vec![label as f64 + 1.0; piece.tets.len()]);
    }
    let mut mesh = TetMesh::new(nodes, tets, Vec::new(), Vec::new()).unwrap();
    mesh.set_field(Field::scalar("label", Location::Cell, labels))
        .unwrap();
    mesh
}

/// Returns the rapier body with the soft block pinned.
fn held(bars: &[DVec3]) -> Box<dyn Simulator> {
    let labels: Vec<i64> = (2..).take(bars.len()).collect();
    let mut body = made(Engine::Rapier, &beside(bars), &material(&labels));
    body.pin(|p| p.x < -0.5).unwrap();
    body
}

/// Returns the node at a rest position.
fn node(body: &dyn Simulator, at: DVec3) -> usize {
    let mut nodes = body.mesh().nodes.iter();
    nodes.position(|p| p.distance(at) < 1e-9).unwrap()
}

fn apart(a: &[DVec3], b: &[DVec3]) -> f64 {
    let each = a.iter().zip(b).map(|(a, b)| a.distance(*b));
    each.fold(0.0, f64::max)
}

#[test]
fn hinged_bar_matches_pendulum_and_stops_at_limits() {
    let pivot = DVec3::new(0.0, 0.02, 0.02);
    let swing = |limits| {
        let mut body = held(&[DVec3::ZERO]);
        let hinge = Joint {
            regions: (2, None),
            anchor: pivot,
            kind: JointKind::Hinge(DVec3::Y, limits),
        };
        body.joints().unwrap().add_joint(hinge).unwrap();
        // It hangs along x except for a tenth of a radian: z points down and the weight along x.
        let (sin, cos) = 0.1f64.sin_cos();
        body.loads_mut()
            .set_gravity(9.81 * DVec3::new(cos, 0.0, -sin));
        body
    };
    // A physical pendulum: T = 2π √(I/(m g d)) (1 + θ²/16), with the mass of the nodes.
    let mut body = swing(None);
    let bar = |p: &DVec3| p.x > -0.5;
    let nodes = || body.mesh().nodes.iter().zip(body.masses());
    let (mut mass, mut first, mut second) = (0.0, DVec3::ZERO, 0.0);
    for (p, m) in nodes().filter(|(p, _)| bar(p)) {
        let r = *p - pivot;
        mass += m;
        first += *m * r;
        second += m * (r.x * r.x + r.z * r.z);
    }
    let d = first.length() / mass;
    let period = std::f64::consts::TAU * (second / (mass * 9.81 * d)).sqrt() * (1.0 + 0.01 / 16.0);
    let tip = DVec3::new(0.4, 0.02, 0.02);
    let ends = [0.0, 0.04].map(|y| node(&*body, DVec3::new(0.4, y, 0.0)));
    let angle = |body: &dyn Simulator| {
        let x = body.positions().unwrap();
        let at = 0.5 * (x[ends[0]] + x[ends[1]]);
        let rest = tip - DVec3::new(0.0, 0.0, 0.02) - pivot;
        let r = at - pivot;
        rest.z.atan2(rest.x) - r.z.atan2(r.x)
    };
    let steps = 500;
    body.run(steps / 2, 0.5 * period / f64::from(steps))
        .unwrap();
    let (quarter, rate) = (angle(&*body), 0.1);
    body.run(steps / 2, 0.5 * period / f64::from(steps))
        .unwrap();
    let half = angle(&*body);
    println!("{quarter} at a quarter of the period, {half} at half");
    assert!((quarter - rate).abs() < 5e-3 * rate, "{quarter}");
    assert!((half - 2.0 * rate).abs() < 5e-3 * rate, "{half}");
    // The bar has kept its shape, and its position on the hinge.
    let x = body.positions().unwrap();
    for (p, q) in body.mesh().nodes.iter().zip(&x).filter(|(p, _)| bar(p)) {
        assert!((p.distance(pivot) - q.distance(pivot)).abs() < 1e-5);
    }

    let mut stopped = swing(Some([-1.0, 0.05]));
    stopped.run(steps, period / f64::from(steps)).unwrap();
    let at = angle(&*stopped);
    assert!((0.02..0.053).contains(&at), "{at}");
    let mut other_way = swing(Some([-0.05, 1.0]));
    other_way
        .run(steps, 0.5 * period / f64::from(steps))
        .unwrap();
    assert!(angle(&*other_way) > 0.15);
}

#[test]
fn joints_allow_only_their_degrees_of_freedom() {
    let along = |k: f64| DVec3::new(0.42 * k, 0.0, 0.0);
    let mut body = held(&[along(0.0), along(1.0), along(2.0)]);
    let at = |x: f64| DVec3::new(x, 0.02, 0.02);
    let joints = [
        ((2, None), at(0.0), JointKind::Ball),
        ((2, Some(3)), at(0.41), JointKind::Fixed),
        (
            (3, Some(4)),
            at(0.83),
            JointKind::Slider(DVec3::X, Some([0.0, 0.05])),
        ),
    ];
    for (between, at, kind) in joints {
        body.joints()
            .unwrap()
            .add_joint(Joint {
                regions: between,
                anchor: at,
                kind,
            })
            .unwrap();
    }
    // They hang along x from the start, and the last slides to its limit.
    body.loads_mut().set_gravity(DVec3::new(9.81, 0.0, 0.0));
    body.run(200, 0.005).unwrap();
    let x = body.positions().unwrap();
    let moved = |at: DVec3| x[node(&*body, at)] - at;
    let near = 2e-3;
    assert!(moved(DVec3::new(0.4, 0.0, 0.0)).length() < near);
    assert!(moved(DVec3::new(0.82, 0.04, 0.04)).length() < near);
    let slid = moved(DVec3::new(1.24, 0.0, 0.04));
    assert!(slid.distance(DVec3::new(0.05, 0.0, 0.0)) < near, "{slid}");
    // Pulled sideways they rotate about the first joint only.
    body.loads_mut().set_gravity(DVec3::new(9.81, 0.0, 3.0));
    body.run(100, 0.005).unwrap();
    let y = body.positions().unwrap();
    let far = |p: DVec3| y[node(&*body, p)];
    let one = far(DVec3::new(0.4, 0.0, 0.0)) - far(DVec3::ZERO);
    let two = far(DVec3::new(0.82, 0.0, 0.0)) - far(DVec3::new(0.42, 0.0, 0.0));
    let three = far(DVec3::new(1.24, 0.0, 0.0)) - far(DVec3::new(0.84, 0.0, 0.0));
    assert!(one.z > 0.03, "{one}");
    assert!(one.angle_between(two) < 1e-2 && one.angle_between(three) < 1e-2);
}

/// Returns a bar with bone in its far half, pinned at the near end.
fn bony(engine: Engine) -> Box<dyn Simulator> {
    let mut mesh = generate::bar([8, 2, 2], DVec3::new(0.8, 0.2, 0.2)).unwrap();
    let middle = |t: usize| mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
    let label = |t: usize| if middle(t).x > 0.5 { 2.0 } else { 1.0 };
    let labels = (0..mesh.tets.len()).map(label).collect();
    mesh.set_field(Field::scalar("label", Location::Cell, labels))
        .unwrap();
    let material = Material {
        mass_damping: 16.0,
        ..material(&[2])
    };
    let mut body = made(engine, &mesh, &material);
    body.pin(|p| p.x < 1e-6).unwrap();
    body
}

#[test]
fn rigid_region_in_soft_tissue_matches_cpu_engine() {
    let rested = [Engine::Rapier, Engine::Cpu].map(|engine| {
        let mut body = bony(engine);
        body.loads_mut().set_gravity(DVec3::new(0.0, 0.0, -9.81));
        body.run(150, 0.02).unwrap();
        body.positions().unwrap()
    });
    let rest = &bony(Engine::Cpu).mesh().nodes.clone();
    let bent = apart(&rested[1], rest);
    let off = apart(&rested[0], &rested[1]) / bent;
    println!("{off:.1e} of {bent:.3} m apart");
    assert!(bent > 0.02 && off < 3e-3, "{off} {bent}");
    // The bone has kept its shape.
    let bone = |p: &&DVec3| p.x > 0.5 + 1e-6;
    let pairs: Vec<(DVec3, DVec3)> = rest
        .iter()
        .zip(&rested[0])
        .filter(|(p, _)| bone(p))
        .map(|(p, x)| (*p, *x))
        .collect();
    for (p, x) in &pairs {
        let (q, y) = &pairs[0];
        assert!((p.distance(*q) - x.distance(*y)).abs() < 1e-5);
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn rigid_regions_follow_grabs() {
    let tip = DVec3::new(0.8, 0.1, 0.1);
    let lift = DVec3::new(0.0, 0.03, 0.08);
    let spring = GrabMode::Spring {
        stiffness: 2e4,
        limit: 1e4,
    };
    // One node: it rotates about it; several: it moves with them; springs.
    for (radius, grip, near) in [
        (0.01, GrabMode::Follow, 2e-3),
        (0.15, GrabMode::Follow, 2e-3),
        (0.15, spring, 2e-3),
    ] {
        let [ours, theirs] = [Engine::Rapier, Engine::Cpu].map(|engine| {
            let mut body = bony(engine);
            let grab = body.grab(tip, radius, grip).unwrap();
            body.set_target(grab, tip + lift).unwrap();
            body.run(150, 0.01).unwrap();
            body.positions().unwrap()
        });
        let way = apart(&theirs, &bony(Engine::Cpu).mesh().nodes);
        let off = apart(&ours, &theirs) / way;
        println!("{radius} {grip:?}: {off:.1e} of {way:.3} m apart");
        assert!(
            way > 0.05 && off < near,
            "{radius} {grip:?}: {off} of {way}"
        );
    }
}

#[test]
fn forces_and_state_apply_to_rigid_regions() {
    let mut body = held(&[DVec3::ZERO]);
    let middle = DVec3::new(0.2, 0.02, 0.02);
    let bar = body.nodes_where(|p| p.x > -0.5);
    let mass: f64 = bar.iter().map(|v| body.masses()[*v as usize]).sum();
    body.loads_mut()
        .add_force(DVec3::new(0.0, mass, 0.0), &bar)
        .unwrap();
    // 1 m/s² for 0.1 s, and the same as an initial velocity; one radian per second about its
    // centre.
    let rest = body.mesh().nodes.clone();
    let spin = DVec3::new(0.0, 0.0, 1.0);
    let given: Vec<DVec3> = rest
        .iter()
        .map(|p| match p.x > -0.5 {
            true => DVec3::Z + spin.cross(*p - middle),
            false => DVec3::ZERO,
        })
        .collect();
    body.set_velocities(&given).unwrap();
    let kept = apart(&body.velocities().unwrap(), &given);
    assert!(kept < 1e-5, "{kept}");
    body.run(100, 1e-3).unwrap();
    let x = body.positions().unwrap();
    let (sin, cos) = 0.1f64.sin_cos();
    for v in bar {
        let r = rest[v as usize] - middle;
        let turned = DVec3::new(cos * r.x - sin * r.y, sin * r.x + cos * r.y, r.z);
        let there = middle + turned + DVec3::new(0.0, 0.005, 0.1);
        let off = x[v as usize].distance(there);
        assert!(off < 2e-4, "{off}");
    }
}

#[test]
fn rejects_invalid_joints() {
    let mut body = held(&[DVec3::ZERO]);
    let ball = |between| Joint {
        regions: between,
        anchor: DVec3::ZERO,
        kind: JointKind::Ball,
    };
    let hinge = |axis, limits| Joint {
        kind: JointKind::Hinge(axis, limits),
        ..ball((2, None))
    };
    for (joint, expected) in [
        (ball((1, None)), "is not rigid"),
        (ball((2, Some(7))), "is not rigid"),
        (ball((2, Some(2))), "to itself"),
        (hinge(DVec3::ZERO, None), "axis must be finite and non-zero"),
        (
            hinge(DVec3::X, Some([0.1, 0.2])),
            "must contain 0, got 0.1 to 0.2",
        ),
    ] {
        let message = body
            .joints()
            .unwrap()
            .add_joint(joint)
            .err()
            .unwrap()
            .to_string();
        assert!(message.contains(expected), "{message}");
    }
    let mut other = made(Engine::Cpu, &beside(&[DVec3::ZERO]), &material(&[2]));
    let message = Capability::Joints.require(other.joints());
    let message = message.err().unwrap().to_string();
    assert!(message.contains("--engine rapier"), "{message}");
}

/// A soft block on a table, a weight that falls onto it, and one on an arm.
const SCENE: &str = r#"
[mesh]
generate = "box"
tets = 384
unit = 1.0
[material]
young = 2e4
poisson = 0.3
damping_ratio = 0.5
damping_hz = 10
[solver]
name = "implicit"
engine = "rapier"
dt = 0.01
gravity = [0, 0, -9.81]
[contact]
friction = 0.4
[[pin]]
name = "table"
axis = "z"
below = 0.01
[[tool]]
name = "weight"
sphere = { radius = 0.02 }
at = [0.05, 0.05, 0.124]
mass = 0.2
[[tool]]
name = "arm"
box = { size = [0.1, 0.02, 0.02] }
at = [0.25, 0.05, 0.2]
mass = 0.1
[[joint]]
between = ["arm"]
at = [0.3, 0.05, 0.2]
hinge = { axis = [0.0, 1, 0] }
[picture]
size = [48, 32]
"#;

#[test]
#[ignore = "long: scripts/test --full"]
fn weight_rests_on_soft_block_and_arm_hangs_on_joint() {
    let gpu = gpu();
    let mut stage = Stage::new(&gpu, &Scene::parse(SCENE).unwrap()).unwrap();
    let before = stage.image().unwrap();
    stage.run(150, &mut |_| {}).unwrap();
    assert!(before != stage.image().unwrap());
    let all = stage.reactions().unwrap();
    let of = |name: &str| all.iter().find(|(own, _)| own == name).unwrap().1.force;
    println!("{all:?}");
    let weight = 0.2 * 9.81;
    assert!((of("weight").z / weight - 1.0).abs() < 0.05, "{all:?}");
    // The table supports block and weight.
    let body = &stage.motion().unwrap().simulator;
    let masses = body.mesh().nodes.iter().zip(body.masses());
    let block = 9.81
        * masses
            .filter(|(p, _)| p.z < 0.1001)
            .map(|(_, m)| m)
            .sum::<f64>();
    assert!(
        (of("table").z / -(block + weight) - 1.0).abs() < 0.05,
        "{all:?}"
    );
    // The arm swings below its hinge, and stays attached.
    let (rest, x) = (&body.mesh().nodes, body.positions().unwrap());
    let pivot = DVec3::new(0.3, 0.05, 0.2);
    let arm: Vec<(&DVec3, &DVec3)> = rest.iter().zip(&x).filter(|(p, _)| p.x > 0.15).collect();
    assert!(arm.len() > 8 && arm.iter().all(|(_, x)| x.z < 0.225));
    assert!(
        arm.iter()
            .all(|(p, x)| (p.distance(pivot) - x.distance(pivot)).abs() < 1e-3)
    );
    assert!(arm.iter().any(|(p, x)| p.distance(**x) > 0.01));

    for (from, to, expected) in [
        ("between = [\"arm\"]", "between = [\"leg\"]", "leg"),
        ("between = [\"arm\"]", "between = []", "got 0"),
        ("hinge = { axis = [0.0, 1, 0] }", "", "one of `hinge`"),
        ("engine = \"rapier\"", "engine = \"cpu\"", "--engine rapier"),
    ] {
        let text = SCENE.replace(from, to);
        let message = Scene::parse(&text).and_then(|s| Stage::new(&gpu, &s));
        let message = message.err().unwrap().to_string();
        assert!(message.contains(expected), "{to}: {message}");
    }
}
