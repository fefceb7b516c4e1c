//! Interactive use of a stage: asynchronous steps, changing appearances, a finger moved by hand.

use crate::stages::{positions, stage};
use glam::DVec3;
use palpate::physics::StepCallback;
use palpate::render::{Image, ImageDifference, Plane, Sections, TransferFunction};
use palpate::scene::{Scene, Stage};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// A box of 10 cm on a table, with a finger above it, and an increasing force.
const BOX: &str = r#"
[mesh]
generate = "box"
tets = 384
[material]
model = "neo-hookean"
young = 2e4
[solver]
name = "implicit"
engine = "cpu"
dt = 0.02
gravity = [0, 0, -9.81]
sleep = false
[[pin]]
z_below = 0.001
[[tool]]
sphere = { radius = 0.015 }
at = [0.05, 0.05, 0.13]
[picture]
size = [64, 48]
"#;

/// Requests steps one by one, and polls until each is done.
fn go(stage: &mut Stage, steps: u32) {
    for _ in 0..steps {
        stage.request_steps(1).unwrap();
        let since = Instant::now();
        while stage.poll_steps().unwrap() {
            assert!(
                since.elapsed() < Duration::from_secs(600),
                "step did not finish"
            );
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn apart(a: &Image, b: &Image) -> f64 {
    ImageDifference::between(a, b).unwrap().max
}

#[test]
fn asynchronous_steps_match_blocking_steps() {
    let cut = "[[cut]]\nedge = [[-0.01, 0.05, 0.11], [0.03, 0.05, 0.11]]\npath = [[0.03, 0, 0, 0], [0.09, 0, 0, -0.04]]\n";
    for more in ["", cut] {
        let text = format!("{BOX}{more}");
        let (mut asked, mut waited) = (stage(&text), stage(&text));
        go(&mut asked, 8);
        waited.run(8, &mut |_| {}).unwrap();
        assert_eq!(asked.time(), waited.time(), "{more}");
        assert_eq!(asked.mesh().tets, waited.mesh().tets, "{more}");
        assert!(positions(&asked) == positions(&waited), "{more}");
        // Continued, each with the other's method.
        asked.run(2, &mut |_| {}).unwrap();
        go(&mut waited, 2);
        assert!(positions(&asked) == positions(&waited), "{more}");
    }
    let mut cut_through = stage(&format!("{BOX}{cut}"));
    let before = cut_through.mesh().nodes.len();
    go(&mut cut_through, 8);
    assert!(cut_through.mesh().nodes.len() > before);
}

#[test]
fn step_completion_wakes_the_caller() {
    let mut stage = stage(BOX);
    let calls = Arc::new(AtomicUsize::new(0));
    let counted = calls.clone();
    let waker: StepCallback = Arc::new(move || {
        counted.fetch_add(1, Ordering::Relaxed);
    });
    stage.motion_mut().unwrap().simulator.set_waker(waker);
    stage.request_steps(1).unwrap();
    let since = Instant::now();
    let mut answered = 0;
    loop {
        let now = calls.load(Ordering::Relaxed);
        // Loads that arrive before the step also notify: only the state counts, checked after a
        // notification.
        if now > answered && !stage.poll_steps().unwrap() {
            break;
        }
        answered = now;
        assert!(
            since.elapsed() < Duration::from_secs(600),
            "no callback within 600 s"
        );
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(stage.time(), 0.02);
}

#[test]
fn tool_follows_target_and_teleports() {
    let mut stage = stage(&BOX.replace("[0, 0, -9.81]", "[0, 0, 0]"));
    stage
        .set_tool_target(0, DVec3::new(0.05, 0.05, 0.109))
        .unwrap();
    go(&mut stage, 1);
    // 6 mm deep within one step: mostly inertia.
    let force = stage.tool_force(0).unwrap();
    assert!((force.z / 9.411 - 1.0).abs() < 0.01, "{force}");
    // Through the box, to below it: teleported, nothing is pushed.
    stage
        .teleport_tool(0, DVec3::new(0.05, 0.05, -0.3))
        .unwrap();
    go(&mut stage, 20);
    let moved = positions(&stage).into_iter().zip(&stage.mesh().nodes);
    let most = moved.map(|(x, p)| x.distance(*p)).fold(0.0, f64::max);
    assert!(most < 1e-3, "{most}");
    assert_eq!(stage.tool_force(0).unwrap(), DVec3::ZERO);
    assert!(stage.teleport_tool(1, DVec3::ZERO).is_err());
}

#[test]
fn appearance_change_keeps_the_motion() {
    let looks = [
        "mode = \"mip\"\n",
        "transfer = \"magma\"\n[light]\nfrom = \"none\"\n",
        "[[plane]]\nclip = [0.05, 0.05, 0.05, 0, -1, 0]\n",
        "mode = \"surface\"\n",
    ];
    let mut changed = stage(BOX);
    changed.run(5, &mut |_| {}).unwrap();
    let plain = changed.image().unwrap();
    for look in looks {
        let text = format!("{BOX}{look}");
        let mut made = stage(&text);
        made.run(5, &mut |_| {}).unwrap();
        *made.camera_mut() = *changed.camera_mut();
        changed
            .set_appearance(&Scene::parse(&text).unwrap())
            .unwrap();
        let image = changed.image().unwrap();
        assert!(apart(&image, &made.image().unwrap()) == 0.0, "{look}");
        assert!(apart(&image, &plain) > 0.0, "{look}");
        assert_eq!(changed.time(), 0.1);
    }
    // Planes alone, which are faster.
    for look in [looks[2], "[[isosurface]]\nvalue = 0.02\n", ""] {
        let scene = Scene::parse(&format!("{BOX}{look}")).unwrap();
        changed.set_appearance(&Scene::parse(BOX).unwrap()).unwrap();
        changed.set_planes(&scene).unwrap();
        let image = changed.image().unwrap();
        changed.set_appearance(&scene).unwrap();
        let apart = apart(&image, &changed.image().unwrap());
        assert!(apart == 0.0, "{look}: {apart}");
    }
    // Invalid input changes nothing.
    let before = changed.image().unwrap();
    let wrong = Scene::parse(&BOX.replace("[picture]", "[picture]\nfield = \"nothing\"")).unwrap();
    assert!(changed.set_appearance(&wrong).is_err());
    assert!(apart(&changed.image().unwrap(), &before) == 0.0);
    // It continues from its current position.
    changed.run(1, &mut |_| {}).unwrap();
    assert!((changed.time() - 0.12).abs() < 1e-12);
    changed.set_appearance(&Scene::parse(BOX).unwrap()).unwrap();
    let own = changed.transfer();
    let plain = changed.image().unwrap();
    let bone = TransferFunction::preset("bone").unwrap();
    changed.set_transfer(&bone).unwrap();
    assert_ne!(changed.transfer(), own);
    assert!(apart(&changed.image().unwrap(), &plain) > 0.0);
}

/// A clip plane set on a stage has a cut face in mode `surface`, as one of the scene: the body would
/// look hollow.
#[test]
fn surfaces_have_cut_faces_wherever_planes_come_from() {
    let scene = "[mesh]\ngenerate = \"box\"\ntets = 300\n[picture]\nmode = \"surface\"\nsize = [40, 30]\n\
                 [camera]\neye = [0.5, -3.0, 0.9]\nlook_at = [0.5, 0.5, 0.5]\n";
    let plane = "[[plane]]\nclip = [0.5, 0.4, 0.5, 0.0, -1.0, 0.0]\n";
    let want = stage(&format!("{scene}{plane}")).image().unwrap();

    let mut set = stage(scene);
    let whole = set.image().unwrap();
    let mut inside = set.inside().clone();
    let cut = "0.5,0.4,0.5,0,-1,0".parse::<Plane>().unwrap();
    inside.planes.push(cut);
    set.set_sections(&inside).unwrap();
    assert!(set.image().unwrap() == want, "set on the stage");
    // Once more, with the faces that it has now.
    let inside = set.inside().clone();
    set.set_sections(&inside).unwrap();
    assert!(set.image().unwrap() == want, "set again");
    set.set_sections(&Sections::default()).unwrap();
    assert!(set.image().unwrap() == whole, "taken away");
    assert!(whole != want);
}
