//! Errors of bodies under moves, grabs and loads that depend on time.

use crate::support::gpu;
use palpate::accuracy::{ErrorParts, RestErrors};
use palpate::no_progress;
use palpate::scene::{Scene, Stage};

/// A bar without gravity, pinned at one end. Each load grows for `duration` seconds, of which half pass.
fn half_loaded(order: u32, duration: f64, loads: &str) -> Stage {
    let text = format!(
        "[mesh]\ngenerate = \"box\"\ntets = 750\n[material]\nyoung = 1e4\npoisson = 0.4\norder = {order}\n[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = {}\ngravity = [0, 0, 0]\n[[pin]]\nname = \"end\"\naxis = \"x\"\nbelow = 0.01\n{}",
        duration / 40.0,
        loads.replace("END", &duration.to_string())
    );
    let mut stage = Stage::new(&gpu(), &Scene::parse(&text).unwrap()).unwrap();
    stage.run(20, &mut |_| {}).unwrap();
    stage
}

/// Returns the force on a support, and its error.
fn force(stage: &mut Stage, name: &str) -> (f64, ErrorParts) {
    let errors = RestErrors::estimate(stage, &no_progress).unwrap().unwrap();
    let of_name = errors.forces.iter().find(|force| force.name == name);
    let force = of_name.unwrap_or_else(|| panic!("{name}: {:?}", errors.forces));
    (force.force_n, force.error_n)
}

const MOVE: &str = "[[move]]\nname = \"lid\"\non = { axis = \"x\", above = 0.99 }\npath = [[0, 0, 0, 0], [END, 0.0, 0.0, 0.02]]\n";

/// Loads.
const LOADS: [&str; 3] = [
    MOVE,
    "[[move]]\nname = \"lid\"\non = { axis = \"x\", above = 0.99 }\npath = [[0, 0, 0, 0]]\n[[pressure]]\non = { axis = \"z\", above = 0.99 }\npressure = [[0, 0], [END, 800]]\n",
    "[[move]]\nname = \"lid\"\non = { axis = \"x\", above = 0.99 }\npath = [[0, 0, 0, 0]]\n[[tool]]\nsphere = { radius = 0.03 }\nat = [0.05, 0.05, 0.131]\npath = [[0, 0, 0, 0], [END, 0, 0, -0.02]]\n",
];

/// The error of the mesh is the difference to the same motion of quadratic tets, as long as both are
/// slow.
#[test]
fn errors_in_slow_motion_are_differences_to_quadratic_tets() {
    for loads in LOADS {
        let (given, parts) = force(&mut half_loaded(1, 400.0, loads), "lid");
        let finer = half_loaded(2, 400.0, loads).reactions().unwrap();
        let finer = finer.iter().find(|(name, _)| name == "lid").unwrap();
        let difference = (given - finer.1.force.length()).abs();
        assert!(difference > 0.01 * given, "{loads}: {given} {finer:?}");
        let ratio = parts.mesh / difference;
        assert!((ratio - 2.5).abs() < 0.2, "{loads}: {ratio} {parts:?}");
        assert!(parts.time < 0.02 * given, "{loads}: {parts:?}");
    }
}

/// A grab holds nodes as a move does.
#[test]
fn grabs_have_the_errors_of_moves() {
    let path = "path = [[0, 0, 0, 0], [END, 0.02, 0.0, 0.0]]\n";
    let grab = format!("[[grab]]\nname = \"hand\"\nat = [0.1, 0.05, 0.05]\nradius = 0.03\n{path}");
    let moved =
        format!("[[move]]\nname = \"hand\"\non = {{ sphere = [0.1, 0.05, 0.05, 0.03] }}\n{path}");
    let [grab, moved] =
        [grab, moved].map(|loads| force(&mut half_loaded(1, 400.0, &loads), "hand"));
    assert!((grab.0 / moved.0 - 1.0).abs() < 1e-3, "{grab:?} {moved:?}");
    let ratio = grab.1.mesh / moved.1.mesh;
    assert!((ratio - 1.0).abs() < 1e-2, "{grab:?} {moved:?}");
}

/// Inertia is a part of the error, until the motion is too fast for an estimate.
#[test]
fn time_error_grows_with_speed() {
    let shares = [200.0, 4.0, 1.0].map(|duration| {
        let (given, parts) = force(&mut half_loaded(1, duration, MOVE), "lid");
        parts.time / given
    });
    assert!(shares[0] < 1e-3, "{shares:?}");
    assert!(shares[1] > 2.0 * shares[0], "{shares:?}");
    assert!(shares[2] > 2.0 * shares[1], "{shares:?}");
    let mut fast = half_loaded(1, 0.01, MOVE);
    let why = RestErrors::estimate(&mut fast, &no_progress).unwrap();
    assert!(why.unwrap_err().contains("in fast motion"));
}

/// Loads that were changed since the scene was read count, or are refused.
#[test]
fn estimate_has_the_present_loads() {
    let mut stage = half_loaded(1, 400.0, "");
    let motion = stage.motion_mut().unwrap();
    let gravity = glam::DVec3::new(0.0, 0.0, -5.0);
    motion.simulator.loads_mut().set_gravity(gravity);
    motion.wake();
    stage.run(20, &mut |_| {}).unwrap();
    let (weight, parts) = force(&mut stage, "end");
    assert!(
        weight > 0.01 && parts.total() < 0.02 * weight,
        "{weight} {parts:?}"
    );
    let loads = stage.motion_mut().unwrap().simulator.loads_mut();
    loads
        .add_force(glam::DVec3::new(0.0, 0.0, 0.1), &[5])
        .unwrap();
    let why = RestErrors::estimate(&mut stage, &no_progress).unwrap();
    let why = why.unwrap_err();
    assert!(why.contains("others were set since"), "{why}");
}

#[test]
fn bodies_on_springs_have_no_errors() {
    let grab = "[[grab]]\nat = [0.1, 0.05, 0.05]\nradius = 0.05\nspring_stiffness = 10\npath = [[0, 0, 0, 0]]\n";
    let mut stage = half_loaded(1, 400.0, grab);
    let why = RestErrors::estimate(&mut stage, &no_progress).unwrap();
    let why = why.unwrap_err();
    assert!(why.contains("springs or free tools"), "{why}");
}
