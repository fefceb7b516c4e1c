//! Scenes of several bodies.

use crate::stages::{refused, stage};
use crate::support::gpu;
use glam::DVec3;
use palpate::mesh::TetMesh;
use palpate::physics::Engine;
use palpate::render::Image;
use palpate::scene::{Checkpoint, Scene, Stage};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data");

/// Returns two boxes of 0.1 m, red at y = 0 and blue at y = 0.3, opaque, viewed along `way`.
fn boxes(way: f64, more: &str) -> String {
    format!(
        "[[body]]\nname = \"red\"\nmesh = {{ generate = \"box\", tets = 400 }}\n\
         [[body]]\nname = \"blue\"\nmesh = {{ generate = \"box\", tets = 700 }}\noffset = [0.0, 0.3, 0.0]\n\
         [camera]\neye = [0.05, {}, 0.05]\nlook_at = [0.05, 0.2, 0.05]\nup = [0, 0, 1]\northographic = 0.2\n\
         [light]\nfrom = \"none\"\n\
         [picture]\nfield = \"label\"\nsize = [40, 40]\n\
         transfer = '{{\"colour\": [[1, 1, 0, 0], [2, 0, 0, 1]], \"extinction\": [[1, 900], [2, 900]]}}'\n{more}",
        0.2 - way
    )
}

fn middle(image: &Image) -> [f32; 3] {
    let [r, g, b, _] = *image.pixel(20, 20) else {
        panic!("four channels");
    };
    [r, g, b]
}

#[test]
fn bodies_render_in_depth_order() {
    let [front, back] = [2.0, -2.0].map(|way| stage(&boxes(way, "")).image().unwrap());
    let ([r, _, b], [r2, _, b2]) = (middle(&front), middle(&back));
    assert!(r > 0.99 && b < 0.01, "{r} {b}");
    assert!(r2 < 0.01 && b2 > 0.99, "{r2} {b2}");
    // Moved apart laterally, they are next to each other; if translucent, one is visible through
    // the other.
    let thin = boxes(2.0, "").replace("900", "9");
    let [r, _, b] = middle(&stage(&thin).image().unwrap());
    // Through 0.1 m of extinction 9/m each.
    let opacity = 1.0 - (-0.9f32).exp();
    let behind = (1.0 - opacity) * opacity;
    assert!((r - opacity).abs() < 2e-3, "{r} {opacity}");
    assert!((b - behind).abs() < 2e-3, "{b} {behind}");
    // It equals the picture of the same mesh in one piece.
    let mut both = stage(&thin);
    let whole: TetMesh = both.mesh().clone();
    let alone = thin
        .split_once("[camera]")
        .map(|(_, rest)| format!("[mesh]\ngenerate = \"box\"\n[camera]{rest}"))
        .unwrap();
    let alone = Scene::parse(&alone).unwrap();
    let mut alone = Stage::with_mesh(&gpu(), &alone, whole).unwrap();
    let (a, b) = (both.image().unwrap(), alone.image().unwrap());
    assert_eq!(a.values, b.values);
    assert!(
        both.notes()
            .iter()
            .all(|n| !n.contains("the body is static"))
    );
}

/// Returns the text of the shipped scene, smaller.
fn three_text() -> String {
    let text = std::fs::read_to_string(format!("{DATA}/scenes/three_bodies.toml")).unwrap();
    text.replace("../", &format!("{DATA}/"))
        .replace("nodes = 6000", "nodes = 800")
        .replace("tets = 6000", "tets = 1500")
        .replace("tets = 3000", "tets = 600")
        .replace("size = [800, 600]", "size = [64, 48]")
}

/// Returns the shipped scene, smaller, with `more` entries.
fn three(more: &str) -> Scene {
    Scene::parse(&format!("{}\n{more}", three_text())).unwrap()
}

#[test]
fn bodies_use_their_own_solvers_and_are_reported() {
    let mut scene = three("");
    scene.body[0].engine = Some("gpu".parse().unwrap());
    scene.body[1].engine = Some("cpu".parse().unwrap());
    let mut stage = Stage::new(&gpu(), &scene).unwrap();
    assert!(
        stage.notes().iter().any(|n| n.starts_with("ball: ")),
        "{:?}",
        stage.notes()
    );
    let before = stage.image().unwrap();
    stage.run(10, &mut |_| {}).unwrap();
    assert!((stage.time() - 0.1).abs() < 1e-9);
    let report = stage.measure(1).unwrap();
    let bodies = &report.bodies;
    assert_eq!(
        bodies.iter().map(|b| b.name.as_str()).collect::<Vec<_>>(),
        ["bar", "ball", "duct"]
    );
    assert_eq!(bodies[0].engine, Engine::Gpu);
    assert_eq!(bodies[1].engine, Engine::Cpu);
    assert_eq!((bodies[0].solver, bodies[1].solver), ("implicit", "verlet"));
    assert!(bodies[0].steps == 1 && bodies[1].steps > 1);
    assert_eq!(report.tets, bodies.iter().map(|b| b.tets).sum::<usize>());
    assert_eq!((report.lost_rays, report.inverted), (0, 0));
    assert_ne!(stage.image().unwrap().values, before.values);
    // Every body has moved, and none has diverged.
    let (rest, now) = (stage.mesh(), stage.deformed_mesh().unwrap());
    let mut first = 0;
    for body in bodies {
        let moved = (first..first + body.nodes).map(|i| now.nodes[i].distance(rest.nodes[i]));
        let farthest = moved.fold(0.0, f64::max);
        assert!((1e-4..0.1).contains(&farthest), "{}: {farthest}", body.name);
        first += body.nodes;
    }
}

#[test]
fn checkpoint_restores_all_bodies() {
    let more = "[[cut]]\nedge = [[0.06, -1, -0.2], [0.06, 1, -0.2]]\npath = [[0.02, 0, 0, 0], [0.05, 0, 0, 0.5]]\n\
         [[grab]]\nat = [0.1, -0.12, 0.01]\nradius = 0.03\npath = [[0, 0, 0, 0], [0.1, 0, 0, 0.01]]\n";
    // A mesh in a cage cannot be cut.
    let text = three_text().replace("cage = { kind = \"lattice\", nodes = 300 }", "");
    assert_ne!(text, three_text());
    let scene = Scene::parse(&format!("{text}\n{more}")).unwrap();
    let gpu = gpu();
    let mut whole = Stage::new(&gpu, &scene).unwrap();
    whole.keep_checkpoints();
    whole.run(6, &mut |_| {}).unwrap();
    let half: Checkpoint = whole.checkpoint(&[]).unwrap();
    whole.run(4, &mut |_| {}).unwrap();
    let mut resumed = Stage::new(&gpu, &scene).unwrap();
    resumed.resume(&half).unwrap();
    resumed.run(4, &mut |_| {}).unwrap();
    let (a, b) = (whole.deformed_mesh(), resumed.deformed_mesh());
    let (a, b) = (a.unwrap(), b.unwrap());
    assert_eq!(a.nodes, b.nodes);
    assert_eq!(a.tets, b.tets);
    assert!(a.nodes.len() > Stage::new(&gpu, &scene).unwrap().mesh().nodes.len());
    assert_eq!(
        whole.image().unwrap().values,
        resumed.image().unwrap().values
    );
}

#[test]
fn body_units_are_converted() {
    let text = "[[body]]\nmesh = { generate = \"box\", tets = 100, unit = \"cm\" }\n\
         [[body]]\nmesh = { generate = \"box\", tets = 100, unit = \"m\" }\noffset = [1, 0, 0]\n";
    let stage = stage(text);
    let nodes = &stage.mesh().nodes;
    let half = nodes.len() / 2;
    let low = |part: &[DVec3]| part.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
    let high = |part: &[DVec3]| part.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
    let sizes = [&nodes[..half], &nodes[half..]].map(|part| (high(part) - low(part)).x);
    assert!((sizes[1] / sizes[0] - 100.0).abs() < 1e-9, "{sizes:?}");
    assert!((low(&nodes[half..]).x - 100.0 * low(&nodes[..half]).x - 1.0).abs() < 1e-9);
}

#[test]
fn bodies_reject_invalid_entries() {
    let two = boxes(2.0, "");
    let both = format!("[mesh]\ngenerate = \"box\"\n{two}");
    assert!(refused(&both).contains("[mesh], [grid] and [cage] are not allowed"));
    let pinned = format!("{two}\n[[pin]]\naxis = \"z\"\nbelow = 0.1\n");
    assert!(refused(&pinned).contains("[[body.pin]]"));
    let same = two.replace("\"blue\"", "\"red\"");
    assert!(refused(&same).contains("two bodies have the name \"red\""));
    let mut scene = Scene::parse(&two).unwrap();
    scene.body[1].solver = Some("implicit".into());
    let told = Stage::new(&gpu(), &scene).err().unwrap().to_string();
    assert!(told.contains("body \"red\" has no solver"), "{told}");
    scene.body[1].mesh.generate = Some("blob".into());
    let told = Stage::new(&gpu(), &scene).err().unwrap().to_string();
    assert!(
        told.contains("body \"blue\"") && told.contains("blob"),
        "{told}"
    );
    let told = scene.mesh_of_one().unwrap_err().to_string();
    assert!(told.contains("a single body is required"), "{told}");
    let wrong = Scene::parse("[[body]]\nmesh = { generate = \"box\" }\nengin = \"cpu\"\n");
    assert!(wrong.unwrap_err().to_string().contains("line 3"));
}
