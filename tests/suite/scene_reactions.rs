//! Reactions of bodies on their supports.

use crate::stages::{reaction, run};
use crate::support::gpu;
use glam::DVec3;
use palpate::physics::Reaction;
use palpate::scene::{ReactionLog, Scene, Stage};

const GRAVITY: f64 = 9.81;
/// Unit of the mesh in metres: the bar is 6 cm long.
const UNIT: f64 = 0.5;

/// Returns a bar along x, pinned at its lowest x, with its mesh in half metres.
fn bar(model: &str, more: &str) -> Stage {
    bar_of(model, "", more)
}

/// The same with additional material entries.
fn bar_of(model: &str, made: &str, more: &str) -> Stage {
    let text = format!(
        r#"
[mesh]
generate = "bar"
tets = 320
unit = {UNIT}
[material]
model = "{model}"
young = 2e5
density = 1000
{made}
[solver]
name = "implicit"
engine = "cpu"
dt = 0.05
tolerance = 1e-7
sleep = false
gravity = [0, 0, -{GRAVITY}]
{more}
"#
    );
    Stage::new(&gpu(), &Scene::parse(&text).unwrap()).unwrap()
}

const PIN: &str = "[[pin]]\nname = \"wall, left\"\naxis = \"x\"\nbelow = 0.01\n";

/// Returns the weight and its moment, N and N·m, of the body at its current positions.
fn weight(stage: &Stage) -> Reaction {
    let body = stage.motion().unwrap().simulator.as_ref();
    let unit = body.loads().frame_and_unit().1;
    let nodes = body.positions().unwrap();
    let nodes = nodes.iter().zip(body.masses());
    Reaction::from_point_forces(nodes.map(|(p, m)| (*m * GRAVITY * DVec3::NEG_Z, *p * unit)))
}

#[track_caller]
fn same(found: DVec3, expected: DVec3, tolerance: f64) {
    let off = (found - expected).length();
    assert!(
        off < tolerance * expected.length(),
        "{found} for {expected}"
    );
}

#[test]
fn hanging_body_reaction_equals_weight_and_moment() {
    for model in ["neo-hookean", "corotated", "springs"] {
        let mut stage = bar(model, PIN);
        // No deflection yet: the pin supports the weight of its own nodes.
        let first = reaction(&mut stage, "wall, left").force;
        assert!(
            first.z < 0.0 && first.z > 0.3 * weight(&stage).force.z,
            "{model} {first}"
        );
        run(&mut stage, 120);
        let (found, expected) = (reaction(&mut stage, "wall, left"), weight(&stage));
        same(found.force, expected.force, 1e-4);
        same(found.moment, expected.moment, 1e-4);
        // The lever arm: half of the bar's length, reduced by its deflection.
        let volume = stage.mesh().volume() * UNIT.powi(3);
        let lever = expected.moment.y / (1000.0 * volume * GRAVITY);
        let length = UNIT * stage.mesh().bounds().1.x;
        assert!((lever / length - 0.5).abs() < 0.02, "{lever} {length}");
    }
}

#[test]
fn grab_reaction_includes_springs_and_inertia() {
    // Pulled by springs of 40 N/m in total: the target moves first, then rests.
    let spring = "[[grab]]\nat = [0.12, 0.03, 0.03]\nradius = 0.02\nspring_stiffness = 40.0\npath = [[0.05, 0, 0, 0], [0.3, 0, 0, 0.02]]\n";
    let mut stage = bar("neo-hookean", &format!("{PIN}{spring}"));
    assert_eq!(reaction(&mut stage, "grab1"), Reaction::default());
    run(&mut stage, 200);
    let body = stage.motion().unwrap().simulator.as_ref();
    let (positions, rest) = (body.positions().unwrap(), &body.mesh().nodes);
    let at = DVec3::new(0.12, 0.03, 0.03);
    let held: Vec<usize> = (0..rest.len())
        .filter(|i| rest[*i].distance(at) <= 0.02)
        .collect();
    let moved = held.iter().map(|i| positions[*i] - rest[*i]).sum::<DVec3>() / held.len() as f64;
    let pull = 40.0 * UNIT * (DVec3::new(0.0, 0.0, 0.02) - moved);
    let found = reaction(&mut stage, "grab1").force;
    same(found, -pull, 1e-3);
    // Pins and grab support the weight together.
    let (pin, all) = (reaction(&mut stage, "wall, left"), weight(&stage));
    same(found + pin.force, all.force, 1e-3);

    // Moved by the grab alone: the reaction is the weight plus the inertial force.
    let follow = "[[grab]]\nname = \"hand\"\nat = [0.0, 0.03, 0.03]\nradius = 0.02\npath = [[0.0, 0, 0, 0], [0.05, 0, 0, 0.001], [0.1, 0, 0, 0.004], [0.15, 0, 0, 0.002], [9.0, 0, 0, 0.002]]\n";
    let floor = "[floor]\npoint = [0, 0, -90]\n";
    let mut stage = bar_of("neo-hookean", "damping = 0.0", &format!("{floor}{follow}"));
    let momentum = |stage: &Stage| {
        let body = stage.motion().unwrap().simulator.as_ref();
        let velocities = body.velocities().unwrap();
        let nodes = velocities.iter().zip(body.masses());
        nodes.map(|(v, m)| *m * UNIT * *v).sum::<DVec3>()
    };
    let path = [0.0, 0.001, 0.004, 0.002, 0.002, 0.002];
    run(&mut stage, 1);
    for k in 2..5 {
        let before = momentum(&stage);
        run(&mut stage, 1);
        let free = (momentum(&stage) - before) / 0.05;
        let body = stage.motion().unwrap().simulator.as_ref();
        let held = body.held_by(stage_grab(&stage)).unwrap();
        let mass: f64 = held.iter().map(|h| body.masses()[h.node as usize]).sum();
        let moved = UNIT * (path[k] - 2.0 * path[k - 1] + path[k - 2]) / (0.05 * 0.05);
        let inertia = free + mass * moved * DVec3::Z;
        let expected = weight(&stage).force - inertia;
        same(reaction(&mut stage, "hand").force, expected, 0.02);
        assert!(inertia.length() > 0.005 * expected.length(), "{inertia}");
    }
}

fn stage_grab(stage: &Stage) -> palpate::physics::GrabId {
    // The first value of a new body.
    let body = stage.motion().unwrap().simulator.as_ref();
    let id: palpate::physics::GrabId = serde_json::from_str("0").unwrap();
    assert!(body.held_by(id).is_ok());
    id
}

#[test]
fn reactions_are_rejected_without_supports_or_forces() {
    let refused = |stage: &mut Stage| stage.reactions().unwrap_err().to_string();
    let floor = "[floor]\npoint = [0, 0, -1]\n";
    assert!(refused(&mut bar("springs", floor)).contains("[[pin]]"));
    let mut stage = bar("springs", "");
    // For a body without pins: the automatically clamped end.
    run(&mut stage, 80);
    same(
        reaction(&mut stage, "held").force,
        weight(&stage).force,
        1e-4,
    );
    let text = "[mesh]\ngenerate = \"bar\"\n[solver]\nname = \"implicit\"\nengine = \"gpu\"\n";
    let mut on_gpu = Stage::new(&gpu(), &Scene::parse(text).unwrap()).unwrap();
    assert!(refused(&mut on_gpu).contains("--engine cpu"));
    let still = text.split("[solver]").next().unwrap();
    let mut still = Stage::new(&gpu(), &Scene::parse(still).unwrap()).unwrap();
    assert!(refused(&mut still).contains("--solver implicit"));
}

#[test]
fn reaction_table_resumes_after_completed_frames() {
    let folder = std::env::temp_dir().join(format!("palpate-reactions-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("table.csv");
    let mut stage = bar("neo-hookean", PIN);
    let mut log = ReactionLog::create(&path).unwrap();
    let mut times = Vec::new();
    for _ in 0..3 {
        log.push(&mut stage).unwrap();
        times.push(stage.time());
        run(&mut stage, 1);
    }
    let whole = std::fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = whole.lines().collect();
    assert_eq!(lines.len(), 4);
    assert_eq!(lines[0], "time_s,name,fx,fy,fz,mx,my,mz,force_error_n");
    assert!(lines[2].starts_with("0.05,\"wall, left\","), "{}", lines[2]);
    // Errors are those of the last frame, and may be set again.
    for error in [0.5, 0.25] {
        let errors = [("wall".into(), 9.0), ("wall, left".into(), error)];
        log.set_errors(&errors).unwrap();
    }
    let with_errors = std::fs::read_to_string(&path).unwrap();
    assert_eq!(with_errors, whole.trim_end().to_owned() + "0.25\n");
    ReactionLog::resume(&path, &times[..2]).unwrap();
    let kept = std::fs::read_to_string(&path).unwrap();
    assert_eq!(kept.lines().collect::<Vec<_>>(), lines[..3]);
    // A missing frame, and a file that is not a table.
    let error = ReactionLog::resume(&path, &times).unwrap_err().to_string();
    assert!(
        error.contains("frame 2") && error.contains("--resume"),
        "{error}"
    );
    std::fs::write(&path, "a,b\n").unwrap();
    let error = ReactionLog::resume(&path, &times).unwrap_err().to_string();
    assert!(error.contains("not a table of reactions"), "{error}");
    std::fs::remove_dir_all(&folder).unwrap();
}
