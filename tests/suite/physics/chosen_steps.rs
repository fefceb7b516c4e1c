//! Explicit steps that are chosen automatically, or advised after a failure, hold.

use crate::support;
use palpate::Error;
use palpate::scene::{Scene, Stage};

/// Steps of a run.
const STEPS: u32 = 300;

/// Bodies, and gravity (m/s²) that bends them by much of their size.
const BODIES: [(&str, f64); 3] = [
    ("file = '{root}/data/bar.vtu'", 600.0),
    ("generate = \"limb\"\ntets = 2000", 1000.0),
    ("file = '{root}/data/ball.vtu'", 1000.0),
];

fn run(body: &str, kind: &str, gravity: f64, dt: Option<f64>) -> palpate::Result<f64> {
    let body = body.replace("{root}", env!("CARGO_MANIFEST_DIR"));
    let dt = dt.map_or_else(String::new, |dt| format!("dt = {dt}\n"));
    let scene = Scene::parse(&format!(
        "[mesh]\n{body}\nunit = \"m\"\n[material]\nmodel = \"neo-hookean\"\nyoung = 1e6\npoisson = 0.3\n\
         [solver]\nname = \"{kind}\"\nengine = \"cpu\"\n{dt}gravity = [0, 0, -{gravity}]\n"
    ))?;
    let mut stage = Stage::new(&support::gpu(), &scene)?;
    stage.run(STEPS, &mut |_| {})?;
    let report = stage.motion().unwrap().report()?;
    assert_eq!(report.inverted_tets, 0);
    Ok(report.max_displacement / report.extent)
}

#[test]
fn chosen_and_advised_explicit_steps_hold() {
    for (body, gravity) in BODIES {
        for kind in ["symplectic", "verlet", "velocity-verlet"] {
            let moved = run(body, kind, gravity, None).unwrap();
            assert!(moved > 0.01, "{body} {kind}: {moved}");
            let error = run(body, kind, gravity, Some(0.05)).unwrap_err();
            let Error::Solver { advice, .. } = &error else {
                panic!("{error}");
            };
            let advised = advice.split("--dt ").nth(1).unwrap();
            let advised: f64 = advised.split(' ').next().unwrap().parse().unwrap();
            run(body, kind, gravity, Some(advised)).unwrap();
        }
    }
}
