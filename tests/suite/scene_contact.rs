//! Self-contact of a body in scenes.

use crate::stages::stage;
use crate::support::gpu;
use glam::DVec3;
use palpate::scene::{Scene, Stage};

/// A box of 10 cm that is pinned, and another 4 mm above it, oblique.
const TWO: &str = r#"
[mesh]
generate = "box"
tets = 384
[[mesh.join]]
name = "upper"
generate = "box"
tets = 384
turn = 20
offset = [0.03, -0.01, 0.104]
[material]
model = "neo-hookean"
young = 4e4
poisson = 0.3
[solver]
name = "implicit"
dt = 0.02
gravity = [0, 0, -9.81]
[[pin]]
z_below = 0.001
[picture]
size = [32, 24]
"#;

/// Counts the boundary edges that intersect boundary faces: by the signs of volumes, for all pairs
/// with overlapping bounding boxes.
fn pierced(stage: &Stage) -> usize {
    let x = stage.motion().unwrap().positions().unwrap();
    let (mesh, topology) = (stage.mesh(), palpate::mesh::Topology::new(stage.mesh()));
    let boundary = topology.boundary.iter();
    let faces: Vec<[u32; 3]> = boundary
        .map(|b| topology.boundary_nodes(mesh, *b))
        .collect();
    let mut edges: Vec<[u32; 2]> = faces
        .iter()
        .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| [*a.min(b), *a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let at = |v: u32| x[v as usize];
    let volume = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
    let boxed = |nodes: &[u32]| {
        let places = nodes.iter().map(|v| at(*v));
        let low = places.clone().fold(DVec3::INFINITY, DVec3::min);
        (low, places.fold(DVec3::NEG_INFINITY, DVec3::max))
    };
    let boxes: Vec<(DVec3, DVec3)> = faces.iter().map(|f| boxed(f)).collect();
    let goes_through = |edge: &&[u32; 2]| {
        let (low, high) = boxed(*edge);
        let [p, q] = edge.map(at);
        faces.iter().zip(&boxes).any(|(face, (from, to))| {
            if !(low.cmple(*to).all() && from.cmple(high).all()) {
                return false;
            }
            let [a, b, c] = face.map(at);
            let apart = edge.iter().all(|v| !face.contains(v));
            let across = volume(a, b, c, p) * volume(a, b, c, q) < 0.0;
            let turns = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
            let within = turns.iter().all(|t| *t > 0.0) || turns.iter().all(|t| *t < 0.0);
            apart && across && within
        })
    };
    edges.iter().filter(goes_through).count()
}

/// Returns the height of the lowest node of the upper box.
fn lowest(stage: &Stage) -> f64 {
    let x = stage.motion().unwrap().positions().unwrap();
    let upper = &x[x.len() / 2..];
    upper.iter().map(|p| p.z).fold(f64::INFINITY, f64::min)
}

#[test]
fn falling_box_rests_on_other_box() {
    let mut resting = stage(&format!("{TWO}[contact]\nfriction = 0.5\n"));
    let names = &resting.mesh().region_names;
    assert!(names.values().any(|n| n == "upper") && names.values().any(|n| n == "first"));
    assert!(
        resting
            .notes()
            .iter()
            .all(|n| !n.contains("intersect others"))
    );
    for _ in 0..5 {
        resting.run(8, &mut |_| {}).unwrap();
        assert_eq!(pierced(&resting), 0);
    }
    let z = lowest(&resting);
    assert!((z - 0.0953).abs() < 2e-4, "{z}");
    // Without contact, it falls through.
    let mut falling = stage(TWO);
    falling.run(8, &mut |_| {}).unwrap();
    assert!(pierced(&falling) > 0);
    let start = lowest(&stage(TWO));
    falling.run(32, &mut |_| {}).unwrap();
    // Free fall in 40 implicit steps: g h² (1 + … + 40).
    let fallen = (start - lowest(&falling)) / (9.81 * 0.02f64.powi(2) * 820.0);
    assert!((fallen - 1.0).abs() < 1e-3, "{fallen}");
}

#[test]
fn resumed_checkpoint_is_bitwise_identical() {
    let text = format!("{TWO}[contact]\nfriction = 0.5\n");
    let mut whole = stage(&text);
    whole.run(12, &mut |_| {}).unwrap();
    let simulator = &whole.motion().unwrap().simulator;
    let state = simulator.checkpoint().unwrap().state().unwrap();
    let mut resumed = stage(&text);
    let simulator = &mut resumed.motion_mut().unwrap().simulator;
    let saved = simulator.checkpoint_mut().unwrap();
    saved.set_state(&state).unwrap();
    for stage in [&mut whole, &mut resumed] {
        stage.run(6, &mut |_| {}).unwrap();
    }
    let places = |stage: &Stage| stage.motion().unwrap().positions().unwrap();
    assert!(places(&whole) == places(&resumed));
}

#[test]
fn rejects_contact_without_support() {
    let message = |more: &str, from: &str, to: &str| {
        let text = format!("{TWO}[contact]\n{more}").replace(from, to);
        let found = Scene::parse(&text).and_then(|scene| Stage::new(&gpu(), &scene));
        found.err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert!(message("friction = -1", "", "").contains("friction must be finite and ≥ 0, got -1"));
    assert!(message("gap = 0.0", "", "").contains("gap must be finite and > 0, got 0"));
    let gpu = message("", "dt = 0.02", "dt = 0.02\nengine = \"gpu\"");
    assert!(
        gpu.contains("[contact]") && gpu.contains("--engine cpu"),
        "{gpu}"
    );
    let springs = message("", "neo-hookean", "springs");
    assert!(
        springs.contains("finite elements") || springs.contains("springs"),
        "{springs}"
    );
    let explicit = message("", "\"implicit\"", "\"verlet\"");
    assert!(explicit.contains("use implicit or bdf2"), "{explicit}");
    assert!(message("", "turn = 20", "axis = [0, 0, 0]").contains("[[mesh.join]] upper"));
    assert!(message("", "offset", "offfset").contains("offfset"));
}

#[test]
#[ignore = "long: scripts/test --full"]
fn knee_cartilage_does_not_interpenetrate() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/data/scenes/knee_contact.toml");
    let mut stage = Stage::new(&gpu(), &Scene::read(file).unwrap()).unwrap();
    let tibia = |stage: &Stage| {
        let x = stage.motion().unwrap().positions().unwrap();
        let mesh = stage.mesh();
        let label = mesh.region_label("tibia bone").unwrap() as f64;
        let labels = &mesh
            .fields
            .iter()
            .find(|f| f.name == "label")
            .unwrap()
            .values;
        let own = mesh.tets.iter().zip(labels).find(|(_, l)| **l == label);
        x[own.unwrap().0[0] as usize]
    };
    let start = tibia(&stage);
    for _ in 0..7 {
        assert_eq!(pierced(&stage), 0);
        stage.run(5, &mut |_| {}).unwrap();
    }
    assert_eq!(pierced(&stage), 0);
    // In mm: it has bent.
    assert!(tibia(&stage).distance(start) > 5.0);
}
