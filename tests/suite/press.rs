//! Presses: a fingertip on a body that lies on a table.

use crate::support::gpu;
use glam::DVec3;
use palpate::press::{Press, Wanted};
use palpate::scene::Scene;

fn block(more: &str) -> Scene {
    let text = format!(
        "[mesh]\ngenerate = \"box\"\ntets = 900\n[material]\nyoung = 2e4\npoisson = 0.3\n{more}"
    );
    Scene::parse(&text).unwrap()
}

/// All samples of a press.
fn pressed(scene: &Scene, wanted: &Wanted) -> Press {
    let mut press = Press::new(&gpu(), scene, wanted).unwrap();
    while press.advance().unwrap().is_some() {}
    press
}

#[test]
fn a_fingertip_goes_in_comes_out_and_is_pushed_back_in_between() {
    let scene = block("");
    let press = pressed(&scene, &Wanted::default());
    let spot = *press.spot();
    assert!(spot.out.is_normalized() && spot.thickness > 0.0);
    let samples = press.samples();
    let deepest = samples.iter().map(|s| s.depth_m).fold(0.0, f64::max);
    assert!((deepest / (0.1 * spot.thickness) - 1.0).abs() < 1e-9);
    let load: Vec<_> = samples.iter().filter(|s| s.phase == "load").collect();
    let unload: Vec<_> = samples.iter().filter(|s| s.phase == "unload").collect();
    assert_eq!((load.len(), unload.len()), (16, 16));
    // The deeper, the harder; and nothing once it has let go.
    assert!(load.windows(2).all(|w| w[1].force_n > w[0].force_n - 1e-6));
    assert!(
        unload
            .windows(2)
            .all(|w| w[1].force_n < w[0].force_n + 1e-6)
    );
    let end = unload.last().unwrap();
    assert!(end.depth_m < 0.0 && end.force_n.abs() < 1e-9, "{samples:?}");
    // Slow: what is elastic gives back what it took.
    for s in &load {
        let back = unload.iter().find(|u| (u.depth_m - s.depth_m).abs() < 1e-9);
        if let Some(back) = back {
            let most = load.last().unwrap().force_n;
            assert!(
                (back.force_n - s.force_n).abs() < 0.05 * most,
                "{s:?} {back:?}"
            );
        }
    }
    let report = press.report(1.0);
    // A layer on what is hard seems stiffer than it is, but is of that order.
    let over = report.hertz_young_pa / 2e4;
    assert!((0.7..3.0).contains(&over), "{over}");
    assert_eq!(report.max_force_n, load.last().unwrap().force_n);
    assert_eq!(report.poisson, 0.3);
}

#[test]
fn twice_as_stiff_resists_twice_as_hard_and_a_force_ends_it() {
    let scene = block("");
    let mut stiff = scene.clone();
    stiff.material.young = Some(4e4);
    let up = Wanted {
        at: Some(DVec3::new(0.05, 0.05, 0.1)),
        depth: Some(5e-3),
        radius: Some(0.02),
        ..Wanted::default()
    };
    let [one, two] = [&scene, &stiff].map(|s| pressed(s, &up).report(0.0));
    let ratio = two.max_force_n / one.max_force_n;
    assert!((ratio - 2.0).abs() < 0.02, "{ratio}");
    let force = 0.5 * one.max_force_n;
    let by_force = Wanted {
        force: Some(force),
        depth: None,
        ..up
    };
    let press = pressed(&scene, &by_force);
    let found = press.report(0.0);
    assert!((found.max_force_n / force - 1.0).abs() < 0.05 && !press.falls_short());
    // It stops at the first step at which the force is reached.
    let before = press.samples().iter().filter(|s| s.phase == "load");
    let before: Vec<f64> = before.map(|s| s.force_n).collect();
    assert!(before[..before.len() - 1].iter().all(|f| *f < 0.99 * force));
}

#[test]
fn what_cannot_be_pressed_is_refused_in_words() {
    let gpu = gpu();
    let told = |scene: &Scene, wanted: &Wanted| {
        let found = Press::new(&gpu, scene, wanted);
        found.err().map(|e| e.to_string()).unwrap_or_default()
    };
    let scene = block("");
    let far = Wanted {
        at: Some(DVec3::splat(50.0)),
        ..Wanted::default()
    };
    assert!(told(&scene, &far).contains("nowhere near the body"));
    let below = Wanted {
        at: Some(DVec3::new(0.05, 0.05, 0.0)),
        ..Wanted::default()
    };
    assert!(told(&scene, &below).contains("lies on its table"));
    let both = Wanted {
        depth: Some(0.1),
        force: Some(1.0),
        ..Wanted::default()
    };
    assert!(told(&scene, &both).contains("one of them"));
    let wrong = Wanted {
        radius: Some(-1.0),
        ..Wanted::default()
    };
    assert!(told(&scene, &wrong).contains("a radius of -1"));
    let grid = Scene::parse("[grid]\ngenerate = \"heart\"\n");
    if let Ok(grid) = grid {
        assert!(told(&grid, &Wanted::default()).contains("one body of tets"));
    }
    let springs = block("model = \"springs\"\n");
    assert!(!told(&springs, &Wanted::default()).is_empty());
}
