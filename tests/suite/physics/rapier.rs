//! The engine by rapier's soft bodies, compared with the CPU engine.

use crate::support::gpu;
use glam::{DQuat, DVec3};
use palpate::generate;
use palpate::mesh::{Blade, Field, Location, TetMesh};
use palpate::physics::{
    Capability, DistanceField, Engine, EngineChoice, Floor, GrabMode, Material, MaterialModel,
    RegionMaterial, SelfContactSettings, Shape, Simulator, SolverKind, Stiffness, Tool, ToolPose,
    VolumetricFormulation,
};
use palpate::scene::{Scene, Stage};
use std::sync::Arc;

const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// 1 MPa, damped so that the bar, which oscillates at 1.6 Hz, is at rest within a second.
fn soft() -> Material {
    Material {
        model: MaterialModel::NeoHookean,
        poisson: 0.3,
        mass_damping: 16.0,
        damping_time: 0.01,
        ..Material::from_young(1e6)
    }
}

fn made(engine: Engine, mesh: &TetMesh, material: &Material) -> Box<dyn Simulator> {
    let choice = EngineChoice::Exactly(engine);
    let body = choice.build_tets(&gpu(), mesh.clone(), material, SolverKind::Implicit);
    body.unwrap()
}

/// Returns a bar along x, pinned at its lower end.
fn bar(engine: Engine, material: &Material) -> Box<dyn Simulator> {
    let mut body = made(engine, &bar_mesh(), material);
    body.pin(|p| p.x < 1e-6).unwrap();
    body
}

/// Returns `body` in equilibrium under its weight.
fn rested(mut body: Box<dyn Simulator>) -> Box<dyn Simulator> {
    body.loads_mut().set_gravity(GRAVITY);
    body.run(100, 0.02).unwrap();
    body
}

fn bar_mesh() -> TetMesh {
    generate::bar([8, 2, 2], DVec3::new(0.8, 0.2, 0.2)).unwrap()
}

/// Returns a block of 10 cm and 20 kPa from the origin, in units of `unit` metres, with `cells`
/// cells along each edge.
fn block(engine: Engine, cells: usize, unit: f64) -> Box<dyn Simulator> {
    let mesh = generate::bar([cells; 3], DVec3::splat(0.1 / unit)).unwrap();
    let material = Material {
        stiffness: Stiffness::Young(2e4),
        mass_damping: 0.0,
        length_unit: unit,
        ..soft()
    };
    made(engine, &mesh, &material)
}

/// Returns the largest distance between corresponding nodes of two bodies.
fn apart(a: &dyn Simulator, b: &dyn Simulator) -> f64 {
    let (a, b) = (a.positions().unwrap(), b.positions().unwrap());
    let each = a.iter().zip(&b).map(|(a, b)| a.distance(*b));
    each.fold(0.0, f64::max)
}

fn way(body: &dyn Simulator) -> f64 {
    body.report().unwrap().max_displacement
}

fn momentum(body: &dyn Simulator) -> DVec3 {
    let all = body.velocities().unwrap().into_iter().zip(body.masses());
    all.map(|(v, m)| v * *m).sum()
}

#[test]
#[ignore = "long: scripts/test --full"]
fn bar_rests_where_cpu_engine_rests() {
    // rapier's corotated model has a different volume term: they agree for small strains.
    for (model, near) in [
        (MaterialModel::NeoHookean, 1e-3),
        (MaterialModel::Corotated, 1e-2),
    ] {
        let material = Material { model, ..soft() };
        let [ours, theirs] = [Engine::Rapier, Engine::Cpu].map(|e| rested(bar(e, &material)));
        assert_eq!(ours.engine(), Engine::Rapier);
        let bent = way(&*theirs);
        assert!(bent > 0.03, "{bent}");
        let off = apart(&*ours, &*theirs) / bent;
        assert!(off < near, "{model}: {off}");
        // Pinned nodes have not moved.
        let (now, rest) = (ours.positions().unwrap(), &ours.mesh().nodes);
        let held = rest.iter().zip(&now).filter(|(p, _)| p.x < 1e-6);
        assert_eq!(held.clone().count(), 9);
        assert!(held.map(|(p, x)| p.distance(*x)).fold(0.0, f64::max) < 1e-6);
    }
    // A bar twice as stiff bends about half as far.
    let stiff = Material {
        stiffness: Stiffness::Young(2e6),
        ..soft()
    };
    let bent = [soft(), stiff].map(|m| way(&*rested(bar(Engine::Rapier, &m))));
    let ratio = bent[1] / bent[0];
    assert!((0.45..0.55).contains(&ratio), "{ratio}");
}

#[test]
fn step_equals_four_implicit_euler_substeps_with_similar_damping() {
    for (damping_time, near) in [(0.0, 1e-3), (0.01, 3e-2)] {
        let material = Material {
            damping_time,
            mass_damping: 0.0,
            ..soft()
        };
        let mut bars = [Engine::Rapier, Engine::Cpu].map(|engine| bar(engine, &material));
        for (body, steps) in bars.iter_mut().zip([20, 80]) {
            body.loads_mut().set_gravity(0.1 * GRAVITY);
            body.run(steps, 0.2 / f64::from(steps)).unwrap();
        }
        let [ours, theirs] = bars;
        let off = apart(&*ours, &*theirs) / way(&*theirs);
        assert!(off < near, "{damping_time}: {off}");
    }
}

#[test]
fn regions_have_their_own_stiffness() {
    let mut mesh = bar_mesh();
    let labels = (0..mesh.tets.len()).map(|t| {
        let x = mesh.tet_nodes(t).iter().map(|p| p.x).sum::<f64>() / 4.0;
        if (0.2..0.5).contains(&x) { 1.0 } else { 0.0 }
    });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let hard = RegionMaterial {
        stiffness: 2e7,
        density: 1500.0,
        poisson: 0.3,
    };
    let mut material = Material {
        region_field: Some("label".into()),
        ..soft()
    };
    material.regions.insert(1, hard);
    let [ours, theirs] = [Engine::Rapier, Engine::Cpu].map(|engine| {
        let mut body = made(engine, &mesh, &material);
        body.pin(|p| p.x < 1e-6).unwrap();
        rested(body)
    });
    let off = apart(&*ours, &*theirs) / way(&*theirs);
    assert!(off < 5e-3, "{off}");
    assert!(way(&*ours) < 0.9 * way(&*rested(bar(Engine::Rapier, &soft()))));
    // Poisson's ratio is uniform.
    material.regions.insert(
        1,
        RegionMaterial {
            poisson: 0.4,
            ..hard
        },
    );
    let choice = EngineChoice::Exactly(Engine::Rapier);
    let message = choice.build_tets(&gpu(), mesh, &material, SolverKind::Implicit);
    let message = message.err().unwrap().to_string();
    assert!(message.contains("one Poisson's ratio"), "{message}");
}

#[test]
fn set_state_round_trips() {
    let material = Material {
        mass_damping: 0.0,
        ..soft()
    };
    let mut body = made(Engine::Rapier, &bar_mesh(), &material);
    let turn = DQuat::from_rotation_y(2.5);
    let places: Vec<DVec3> = body.mesh().nodes.iter().map(|p| turn * *p).collect();
    let thrown = DVec3::new(0.5, -0.25, 1.0);
    body.set_positions(&places).unwrap();
    body.set_velocities(&vec![thrown; places.len()]).unwrap();
    let before = momentum(&*body);
    body.run(10, 0.01).unwrap();
    // Rotated and thrown, it moves rigidly.
    let flown = places.iter().map(|p| *p + 0.1 * thrown);
    let now = body.positions().unwrap();
    let off = now.iter().zip(flown).map(|(a, b)| a.distance(b));
    assert!(off.fold(0.0, f64::max) < 1e-4);
    assert!(momentum(&*body).distance(before) < 1e-4 * before.length());
    assert!(body.set_positions(&places[1..]).is_err());
    body.restart().unwrap();
    assert!(way(&*body) < 1e-6);
    // The rendered positions are those of the body.
    body.loads_mut().set_gravity(GRAVITY);
    body.run(20, 0.01).unwrap();
    body.sync_nodes().unwrap();
    let drawn = body.nodes().positions().unwrap();
    let now = body.positions().unwrap();
    let off = now.iter().zip(&drawn).map(|(a, b)| a.distance(*b));
    assert!(off.fold(0.0, f64::max) < 1e-5 && way(&*body) > 0.1);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn grabs_hold_pull_and_release() {
    let tip = DVec3::new(0.8, 0.1, 0.1);
    let lift = DVec3::new(0.0, 0.05, 0.1);
    let spring = |limit| GrabMode::Spring {
        stiffness: 500.0,
        limit,
    };
    // Springs deviate by about their fraction of the step: 10 % at 20 ms.
    for grip in [GrabMode::Follow, spring(1e9), spring(20.0)] {
        let mut bars = [Engine::Rapier, Engine::Cpu].map(|engine| bar(engine, &soft()));
        let grabs = bars.each_mut().map(|body| {
            let grab = body.grab(tip, 0.11, grip).unwrap();
            body.set_target(grab, tip + lift).unwrap();
            body.run(200, 0.005).unwrap();
            grab
        });
        let [mut ours, theirs] = bars;
        let off = apart(&*ours, &*theirs) / way(&*theirs);
        assert!(off < 3e-2, "{grip:?}: {off}");
        assert!(way(&*ours) > 0.01);
        assert!(ours.release(grabs[0]).unwrap() > 4);
        ours.run(100, 0.02).unwrap();
        assert!(way(&*ours) < 1e-3, "{grip:?}: {}", way(&*ours));
    }
}

#[test]
fn prescribed_nodes_reach_their_targets() {
    let mut body = bar(Engine::Rapier, &soft());
    let end = body.nodes_where(|p| p.x > 0.8 - 1e-6);
    let led = body.add_prescribed_motion(&end).unwrap();
    let rest: Vec<DVec3> = end.iter().map(|v| body.mesh().nodes[*v as usize]).collect();
    let speed = DVec3::new(0.0, 0.0, 0.2);
    let speeds = vec![speed; end.len()];
    body.loads_mut()
        .set_prescribed_motion(led, &rest, &speeds)
        .unwrap();
    body.run(20, 0.01).unwrap();
    let now = body.positions().unwrap();
    for (v, p) in end.iter().zip(&rest) {
        assert!(now[*v as usize].distance(*p + 0.2 * speed) < 1e-5);
    }
    assert!(body.add_prescribed_motion(&end).is_err());
}

/// Indents the top of a block on a table with `shape` by a tenth of its height; the shape starts
/// `below` its origin. Also returns the forces on the tool and the table.
fn pressed(
    engine: Engine,
    unit: f64,
    shape: Shape,
    below: f64,
) -> (Box<dyn Simulator>, [DVec3; 2]) {
    let size = 0.1 / unit;
    let mut body = block(engine, 5, unit);
    let table = body.nodes_where(|p| p.z < 1e-6 * size);
    body.pin_nodes(&table).unwrap();
    let top = DVec3::new(0.5 * size, 0.5 * size, size + below);
    let at = |down: f64| ToolPose::new(top - down * DVec3::Z, DQuat::IDENTITY);
    let tool = Tool {
        shape,
        pose: at(-0.01 * size),
        friction: 0.0,
        gap: None,
    };
    let id = body.contact().unwrap().add_tool(tool).unwrap();
    for k in 1..=10 {
        let down = 0.01 * size * f64::from(k);
        body.loads_mut().set_tool_target(id, at(down)).unwrap();
        body.run(1, 0.01).unwrap();
    }
    body.run(20, 0.01).unwrap();
    let forces = body.reactions().unwrap().nodal_forces().unwrap();
    let borne = table.iter().map(|v| forces[*v as usize]).sum();
    let tool = body.contact().unwrap().tool_forces().unwrap()[0].force;
    (body, [tool, borne])
}

#[test]
#[ignore = "long: scripts/test --full"]
fn tools_press_and_report_reactions() {
    // In metres, and in millimetres.
    for (unit, cylinder) in [(1.0, true), (1e-3, false)] {
        let size = 0.1 / unit;
        let r = 0.4 * size;
        let mut shapes = vec![(Shape::Sphere { radius: r }, r)];
        if cylinder {
            let solid = generate::ball(r, 6).unwrap();
            let field = DistanceField::new(&solid.boundary_surface(None).unwrap()).unwrap();
            let length = 0.2 * size;
            let half = DVec3::splat(r);
            shapes.push((Shape::Capsule { radius: r, length }, r + 0.5 * length));
            shapes.push((Shape::Box { half }, r));
            shapes.push((Shape::Sdf(Arc::new(field)), r));
        }
        for (shape, below) in shapes {
            let (body, [tool, table]) = pressed(Engine::Rapier, unit, shape.clone(), below);
            let (_, [expected, _]) = pressed(Engine::Cpu, unit, shape.clone(), below);
            // It is pushed up by the force of the table as computed by the CPU engine: rapier keeps
            // nodes out of a tool, but hardly the surface between them.
            assert!(tool.z > 1.0, "{shape:?}: {tool}");
            assert!(
                (tool + table).length() < 0.1 * tool.z,
                "{shape:?}: {tool} {table}"
            );
            assert!(
                tool.distance(expected) < 0.25 * expected.z,
                "{shape:?}: {tool} {expected}"
            );
            // The indentation equals the displacement of the tool.
            let now = body.positions().unwrap();
            let sunk = body.mesh().nodes.iter().zip(&now).map(|(p, x)| p.z - x.z);
            let dent = sunk.fold(0.0, f64::max) / size;
            assert!((0.07..0.12).contains(&dent), "{shape:?}: {dent}");
        }
    }
}

#[test]
fn falling_block_rests_on_plane() {
    for plane in [true, false] {
        let mut body = block(Engine::Rapier, 3, 1.0);
        let weight = body.masses().iter().sum::<f64>() * 9.81;
        if plane {
            let pose = ToolPose::new(DVec3::new(0.0, 0.0, -0.02), DQuat::IDENTITY);
            let tool = Tool {
                shape: Shape::Plane,
                pose,
                friction: 0.3,
                gap: None,
            };
            body.contact().unwrap().add_tool(tool).unwrap();
        }
        body.loads_mut().set_gravity(GRAVITY);
        body.run(160, 0.005).unwrap();
        let now = body.positions().unwrap();
        let lowest = now.iter().map(|x| x.z).fold(f64::INFINITY, f64::min);
        if !plane {
            assert!(lowest < -1.0, "{lowest}");
            continue;
        }
        assert!((-0.0205..-0.018).contains(&lowest), "{lowest}");
        assert!(body.rms_speed() < 1e-2, "{}", body.rms_speed());
        let force = body.contact().unwrap().tool_forces().unwrap()[0].force;
        assert!((force.z + weight).abs() < 1e-2 * weight, "{force} {weight}");
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn self_contact_separates_pieces_when_enabled() {
    for contact in [true, false] {
        let low = generate::bar([3; 3], DVec3::splat(0.1)).unwrap();
        let mut high = low.clone();
        for p in &mut high.nodes {
            *p += DVec3::new(0.02, 0.01, 0.11);
        }
        let whole = TetMesh::merge_meshes(&[("low".into(), &low), ("high".into(), &high)]).unwrap();
        let material = Material {
            mass_damping: 0.0,
            ..soft()
        };
        let mut body = made(Engine::Rapier, &whole, &material);
        body.pin(|p| p.z < 1e-6).unwrap();
        if contact {
            assert_eq!(
                body.contact()
                    .unwrap()
                    .set_self_contact(SelfContactSettings::default())
                    .unwrap(),
                0
            );
        }
        body.loads_mut().set_gravity(GRAVITY);
        body.run(80, 0.005).unwrap();
        let now = body.positions().unwrap();
        let upper = body.nodes_where(|p| p.z > 0.105);
        let lowest = upper.iter().map(|v| now[*v as usize].z);
        let lowest = lowest.fold(f64::INFINITY, f64::min);
        match contact {
            true => assert!((0.09..0.105).contains(&lowest), "{lowest}"),
            false => assert!(lowest < -0.1, "{lowest}"),
        }
    }
}

#[test]
fn unsupported_features_are_reported() {
    let choice = EngineChoice::Exactly(Engine::Rapier);
    let refused = |material: &Material, kind| {
        let made = choice.build_tets(&gpu(), bar_mesh(), material, kind);
        made.err().unwrap().to_string()
    };
    let springs = refused(&Material::from_young(1e5), SolverKind::Implicit);
    assert!(springs.contains("--material neo-hookean"), "{springs}");
    for kind in [SolverKind::Bdf2, SolverKind::Verlet] {
        let message = refused(&soft(), kind);
        assert!(message.contains("--solver implicit"), "{message}");
    }
    let averaged = Material {
        volume: VolumetricFormulation::NodalAveraged,
        ..soft()
    };
    let message = refused(&averaged, SolverKind::Implicit);
    assert!(message.contains("--engine cpu"), "{message}");
    let mut bony = bar_mesh();
    let labels = vec![1.0; bony.tets.len()];
    bony.set_field(Field::scalar("label", Location::Cell, labels))
        .unwrap();
    let mut rigid = Material {
        region_field: Some("label".into()),
        ..soft()
    };
    rigid.rigid.insert(1);
    let message = choice.build_tets(&gpu(), bony, &rigid, SolverKind::Implicit);
    let message = message.err().unwrap().to_string();
    assert!(message.contains("leave a region soft"), "{message}");

    let mut body = bar(Engine::Rapier, &soft());
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let blade = Blade::from_quad(corners.map(|[y, z]| DVec3::new(0.4, y, z))).unwrap();
    let floor = Floor::new(DVec3::ZERO, DVec3::Z, 500.0).unwrap();
    let message = [
        body.cut(&blade).err(),
        Capability::Checkpoints.require(body.checkpoint()).err(),
        body.add_term(Arc::new(floor)).err(),
        Capability::Pressure.require(body.scaled_loads()).err(),
        body.set_integrator(SolverKind::Midpoint, Default::default())
            .err(),
    ];
    for message in message {
        let message = message.unwrap().to_string();
        assert!(message.contains("--engine cpu"), "{message}");
    }
    // It continues regardless.
    body.run(2, 0.01).unwrap();
    assert!(body.run(2, -1.0).is_err());
}

/// A block on a table under a finger.
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
dt = 0.02
gravity = [0, 0, 0]
[[pin]]
name = "table"
axis = "z"
below = 0.01
[[tool]]
name = "finger"
sphere = { radius = 0.03 }
at = [0.05, 0.05, 0.135]
path = [[0.0, 0, 0, 0], [0.2, 0, 0, -0.02]]
[picture]
size = [32, 24]
"#;

#[test]
fn scene_selects_rapier_engine() {
    let gpu = gpu();
    let mut stage = Stage::new(&gpu, &Scene::parse(SCENE).unwrap()).unwrap();
    let before = stage.image().unwrap();
    stage.run(30, &mut |_| {}).unwrap();
    assert_eq!(stage.motion().unwrap().engine(), Engine::Rapier);
    let all = stage.reactions().unwrap();
    let of = |name: &str| all.iter().find(|(own, _)| own == name).unwrap().1.force;
    let (finger, table) = (of("finger"), of("table"));
    assert!(finger.z > 0.5, "{all:?}");
    assert!((finger + table).length() < 0.05 * finger.z, "{all:?}");
    assert!(before != stage.image().unwrap());

    for (entry, expected) in [
        ("[[pressure]]\npressure = 500", "pressure is supported"),
        ("[floor]\npoint = [0, 0, -0.1]", "[[tool]] with a plane"),
    ] {
        let text = format!("{SCENE}{entry}\n");
        let message = Scene::parse(&text).and_then(|s| Stage::new(&gpu, &s));
        let message = message.err().unwrap().to_string();
        assert!(message.contains(expected), "{entry}: {message}");
    }
}
