//! Cages in scenes; sleeping bodies; no unnecessary work.

use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::Blade;
use palpate::physics::GrabMode;
use palpate::physics::{Engine, EngineChoice, Simulator};
use palpate::scene::{Scene, Stage};

/// Returns a scene of a small limb with two materials, pinned and pulled, with the entries `more`.
fn limb(more: &str) -> String {
    format!(
        "[mesh]\ngenerate = \"limb\"\ntets = 6000\n\
         [material]\nmodel = \"springs\"\nyoung = 1e5\nbone = {{ young = 1e6 }}\n\
         [[pin]]\naxis = \"x\"\nbelow = 0.08\n\
         [[force]]\non = {{ axis = \"x\", above = 0.85 }}\ntotal = [0, 0, -0.4]\n\
         [picture]\nsize = [96, 64]\n{more}"
    )
}

/// Simulated by passes, which these tests count.
fn stage(gpu: &Gpu, text: &str) -> Stage {
    let mut scene = Scene::parse(text).unwrap();
    scene.solver.engine = Some(EngineChoice::Exactly(Engine::Gpu));
    Stage::new(gpu, &scene).unwrap()
}

/// Returns the displacements of the nodes of the mesh.
fn moved(stage: &Stage) -> Vec<DVec3> {
    let there = stage.deformed_mesh().unwrap().nodes;
    let rest = &stage.mesh().nodes;
    there.iter().zip(rest).map(|(p, r)| *p - *r).collect()
}

fn norm(v: &[DVec3]) -> f64 {
    v.iter().map(|v| v.length_squared()).sum::<f64>().sqrt()
}

#[test]
#[ignore = "long: scripts/test --full"]
fn cage_motion_matches_full_limb() {
    let gpu = Gpu::new().unwrap();
    let still = "[solver]\ngravity = [0, 0, 0]\nname = ";
    let run = |rest: &str, seconds: f64| {
        let mut stage = stage(&gpu, &limb(&format!("{still}{rest}")));
        let dt = stage.motion().unwrap().dt;
        stage.run((seconds / dt) as u32, &mut |_| {}).unwrap();
        let found = moved(&stage);
        (stage, found)
    };
    let mut wrong = Vec::new();
    let (_, truth) = run("\"implicit\"\ndt = 0.02", 1.6);
    for (cage, tolerance) in [
        ("\"implicit\"\ndt = 0.02\n[cage]\nnodes = 400", 0.3),
        ("\"implicit\"\ndt = 0.02\n[cage]\nnodes = 1200", 0.2),
        (
            "\"verlet\"\n[cage]\nkind = \"grid\"\nnodes = 400\ndamping = 10",
            0.2,
        ),
    ] {
        let (mut stage, found) = run(cage, 1.6);
        let off: Vec<DVec3> = found.iter().zip(&truth).map(|(a, b)| *a - *b).collect();
        let error = norm(&off) / norm(&truth);
        println!("{cage}: {error}; {:?}", stage.notes());
        if error > tolerance {
            wrong.push((cage, error));
        }
        assert!(norm(&truth) > 0.01 * (truth.len() as f64).sqrt() * 0.33);
        // The picture shows the current fine mesh, without a previous read-back.
        let report = stage.measure(1).unwrap();
        assert_eq!(report.readbacks, 0);
        let nodes = report.cage.unwrap().nodes;
        assert!(nodes < stage.mesh().nodes.len(), "{nodes}");
        assert!((report.volume_ratio - 1.0).abs() < 0.05, "{report:?}");
        let image = stage.image().unwrap();
        let lit = image.values.chunks(4).filter(|p| p[3] > 0.05).count();
        assert!(lit > 300, "{lit}");
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn cage_is_grabbed_through_mesh() {
    let gpu = Gpu::new().unwrap();
    let text = limb(
        "[solver]\nname = \"implicit\"\ndt = 0.02\ngravity = [0, 0, 0]\n[cage]\nnodes = 300\n\
         [[grab]]\nat = [0.33, 0, 0]\nradius = 0.001\npath = [[0, 0, 0, 0], [0.4, 0, 0.05, 0]]",
    );
    let mut stage = stage(&gpu, &text);
    stage.run(40, &mut |_| {}).unwrap();
    let found = moved(&stage);
    let at = DVec3::new(0.33, 0.0, 0.0);
    let nearest = (0..found.len())
        .min_by(|a, b| {
            let away = |i: &usize| stage.mesh().nodes[*i].distance(at);
            away(a).total_cmp(&away(b))
        })
        .unwrap();
    let drawn = found[nearest].y;
    assert!((0.03..0.07).contains(&drawn), "{drawn}");
}

#[test]
#[ignore = "long: scripts/test --full"]
fn rejects_invalid_cages() {
    let gpu = Gpu::new().unwrap();
    let refused = |more: &str, word: &str| {
        let scene = Scene::parse(&limb(more)).unwrap();
        let error = Stage::new(&gpu, &scene).err().unwrap().to_string();
        assert!(error.contains(word), "{more}: {error}");
    };
    let implicit = "[solver]\nname = \"implicit\"\n";
    refused(&format!("{implicit}[cage]\nkind = \"grid\""), "verlet");
    refused(
        &format!("{implicit}[cage]\nnodes = 1"),
        "number of cage nodes must be",
    );
    refused(&format!("{implicit}[cage]\ndamping = 2"), "lattice");
    let cut = "[[cut]]\nedge = [[0, 0, -9], [0, 0, 9]]\npath = [[0, 0, 5, 0], [1, 0, -5, 0]]";
    refused(&format!("{implicit}[cage]\n{cut}"), "cut");
    assert!(Scene::parse(&limb("[cage]\nkind = \"net\"")).is_err());
    let mut stage = stage(&gpu, &limb(&format!("{implicit}[cage]\nnodes = 300")));
    let rest = stage.mesh().nodes.clone();
    assert!(stage.set_positions(&rest).is_err());
    let edge = |y: f64| [DVec3::new(0.2, y, -1.0), DVec3::new(0.2, y, 1.0)];
    let blade = Blade::from_sweep(&[edge(-1.0), edge(1.0)]).unwrap();
    assert!(stage.cut(&blade).is_err());
}

/// Returns a bar that sags and comes to rest, of tets or of particles.
fn resting(gpu: &Gpu, kind: &str) -> Stage {
    let text = format!(
        "[mesh]\nfile = '{}/data/bar.vtu'\n[material]\nyoung = 2e4\n[solver]\n{kind}\n\
         [[pin]]\naxis = \"x\"\nbelow = 0.05\n[picture]\nsize = [64, 48]\ntraversal = \"planes\"",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = match kind.contains("[grid]") {
        true => text.replace("[material]", "unit = \"m\"\n[material]"),
        false => text,
    };
    stage(gpu, &text)
}

const TETS: &str = "name = \"implicit\"\ndt = 0.02";
const CAGE: &str = "name = \"implicit\"\ndt = 0.02\n[cage]\nnodes = 40";
const GRID: &str = "name = \"verlet\"\n[grid]\nnodes = 150\ndamping = 20";

fn settle(stage: &mut Stage) {
    for _ in 0..400 {
        let steps = (0.25 / stage.motion().unwrap().dt) as u32;
        stage.run(steps, &mut |_| {}).unwrap();
        if stage.motion().unwrap().asleep() {
            return;
        }
    }
    panic!("the body does not come to rest");
}

#[test]
fn body_at_rest_sleeps_and_wakes_on_contact() {
    type Touch = (&'static str, fn(&mut dyn Simulator));
    let touches: [Touch; 3] = [
        ("force", |body| {
            let forces = vec![DVec3::new(0.0, 1e-4, 0.0); body.mesh().nodes.len()];
            body.set_forces(&forces).unwrap();
        }),
        ("pin", |body| body.pin_nodes(&[0]).unwrap()),
        ("grab", |body| {
            let at = body.nodes().positions().unwrap();
            let (low, high) = palpate::mesh::bounds(&at);
            let end = DVec3::new(high.x, 0.5 * (low.y + high.y), 0.5 * (low.z + high.z));
            body.grab(end, 0.03, GrabMode::Follow).unwrap();
        }),
    ];
    let gpu = Gpu::new().unwrap();
    for kind in [TETS, CAGE, GRID] {
        let mut stage = resting(&gpu, kind);
        settle(&mut stage);
        let (time, slept) = (stage.time(), stage.motion().unwrap().steps_slept());
        let there = moved(&stage);
        let (dt, before) = (stage.motion().unwrap().dt, gpu.passes_recorded());
        stage.run(50, &mut |_| {}).unwrap();
        assert_eq!(
            gpu.passes_recorded(),
            before,
            "{kind}: a sleeping body must not be simulated"
        );
        let motion = stage.motion().unwrap();
        assert_eq!(motion.steps_slept(), slept + 50);
        assert!((stage.time() - time - 50.0 * dt).abs() < 1e-9);
        assert_eq!(moved(&stage), there);
        for (name, touch) in touches {
            settle(&mut stage);
            touch(stage.motion_mut().unwrap().simulator.as_mut());
            let before = gpu.passes_recorded();
            stage.run(1, &mut |_| {}).unwrap();
            assert!(
                !stage.motion().unwrap().asleep(),
                "{kind} must wake on {name}"
            );
            assert_ne!(gpu.passes_recorded(), before);
        }
        // An awake body is simulated, and so is one that may not sleep.
        stage.motion_mut().unwrap().set_sleep_allowed(false);
        let slept = stage.motion().unwrap().steps_slept();
        stage.run(300, &mut |_| {}).unwrap();
        assert_eq!(stage.motion().unwrap().steps_slept(), slept);
    }
}

#[test]
fn cut_wakes_sleeping_body() {
    let gpu = Gpu::new().unwrap();
    let edge = |z: f64| [DVec3::new(0.061, -1.0, z), DVec3::new(0.061, 1.0, z)];
    let blade = Blade::from_sweep(&[edge(-1.0), edge(1.0)]).unwrap();
    for kind in [TETS, GRID] {
        let mut stage = resting(&gpu, kind);
        settle(&mut stage);
        assert!(stage.cut(&blade).unwrap(), "{kind}");
        stage.run(1, &mut |_| {}).unwrap();
        assert!(!stage.motion().unwrap().asleep(), "{kind}");
    }
}

#[test]
fn unrequested_work_is_skipped() {
    let gpu = Gpu::new().unwrap();
    let count = |name: &str| gpu.passes_recorded().get(name).copied().unwrap_or(0);
    let counts = || {
        [
            count("render/refresh_geometry"),
            count("render/table_slice") + count("render/table_volume"),
            count("render/start"),
            count("cage/embedding"),
        ]
    };
    let mut stage = resting(&gpu, CAGE);
    let first = stage.image().unwrap();
    let [refreshes, tables, _, carried] = counts();
    assert_eq!((refreshes, carried), (1, 0), "no embedding update at rest");
    assert_eq!(tables, 60);
    // The same picture again needs no pass, even with steps of a sleeping body in between.
    let before = gpu.passes_recorded();
    assert_eq!(stage.image().unwrap(), first);
    assert_eq!(gpu.passes_recorded(), before);
    // Another view: no refresh, no table, but a picture.
    stage.camera_mut().eye.z += 0.05;
    let other = stage.image().unwrap();
    assert_ne!(other, first);
    let now = counts();
    assert_eq!([now[0], now[1], now[3]], [1, tables, 0]);
    // Steps: one embedding and one refresh per picture, however many steps.
    stage.run(30, &mut |_| {}).unwrap();
    stage.image().unwrap();
    let now = counts();
    assert_eq!([now[0], now[1], now[3]], [2, tables, 1]);
    // Asleep: no pass.
    settle(&mut stage);
    let asleep = stage.image().unwrap();
    let before = gpu.passes_recorded();
    stage.run(30, &mut |_| {}).unwrap();
    assert_eq!(stage.image().unwrap(), asleep);
    assert_eq!(gpu.passes_recorded(), before);
    // Without skin and light, no normals are needed.
    assert_eq!(
        count("skin/node_normals") + count("render/surface_normals"),
        0
    );
    // The report has the counts; measuring renders and simulates sleeping bodies, too.
    let report = stage.measure(3).unwrap();
    assert_eq!(report.frames_reused, 2);
    assert_eq!(report.pictures_drawn, 4);
    assert!(report.asleep && report.steps_skipped >= 30, "{report:?}");
    assert_eq!(report.passes_recorded, before);
    let after = counts();
    assert!(after[0] >= now[0] + 3, "{after:?} {now:?}");
    assert!(gpu.passes_recorded()["physics/commit"] >= before["physics/commit"] + 3);
}
