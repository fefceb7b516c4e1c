//! Features of scenes on bodies of order 2: each cell of the table in docs/explanation/quadratic-tets.md.

use crate::stages::{FINGER, TABLE, box_scene, positions, reaction, run, stage};
use crate::support::gpu;
use glam::DVec3;
use palpate::mesh::Blade;
use palpate::physics::{BodyField, Engine};
use palpate::scene::{Scene, Stage};

/// A cube of 0.1 m, of 162 quadratic tets.
const BOX: &str = box_scene!(
    "162",
    "order = 2",
    "dt = 0.05\ntolerance = 1e-7\nsleep = false\ngravity = [0, 0, 0]"
);

fn field(stage: &Stage, field: BodyField) -> Vec<f64> {
    let simulator = stage.motion().unwrap().simulator.as_ref();
    field.per_tet(simulator).unwrap()
}

/// The file's nodes come first, and the elements are on the CPU.
#[test]
fn order_2_adds_nodes_after_those_of_the_file() {
    let linear = stage(&BOX.replace("order = 2", "order = 1"));
    let quadratic = stage(BOX);
    let (few, many) = (linear.mesh(), quadratic.mesh());
    assert_eq!(few.nodes[..], many.nodes[..few.nodes.len()]);
    assert_eq!(8 * few.tets.len(), many.tets.len());
    assert_eq!(quadratic.motion().unwrap().engine(), Engine::Cpu);
    let refused = |from: &str, to: &str| {
        let scene = Scene::parse(&BOX.replace(from, to));
        let made = scene.and_then(|scene| Stage::new(&gpu(), &scene).map(|_| ()));
        made.unwrap_err().to_string()
    };
    for (from, to, words) in [
        ("order = 2", "order = 3", "expected 1"),
        ("[picture]", "[cage]\n[picture]", "order 1"),
        ("\"neo-hookean\"", "\"springs\"", "springs have no order 2"),
        ("dt = 0.05", "dt = 0.05\nengine = \"gpu\"", "--engine cpu"),
    ] {
        let message = refused(from, to);
        assert!(message.contains(words), "{words}: {message}");
    }
}

/// Uniform tension: exact displacements, reactions and fields in every tet.
#[test]
fn order_2_is_exact_under_uniform_tension() {
    // A support that leaves the lateral contraction free; mass damping stops the rotation about it.
    let text = BOX.replace(
        "density = 1000",
        "density = 1000\ndamping_ratio = 1.0\ndamping_hz = 1.75",
    );
    let mut stage = stage(&format!(
        "{text}{}{}",
        "[[pin]]\nname = \"corner\"\nsphere = [0, 0, 0, 1e-4]\n",
        "[[force]]\non = { z_above = 0.0999 }\ntotal = [0, 0, 2]\n[[force]]\non = { z_below = 1e-4 }\ntotal = [0, 0, -2]\n"
    ));
    run(&mut stage, 100);
    // 200 Pa on E = 2e4 Pa: a strain of 1 %, whatever small rotation there is.
    let (x, rest) = (positions(&stage), stage.mesh().nodes.clone());
    let bottom = |p: DVec3| {
        rest.iter()
            .position(|q| q.distance(p - 0.1 * DVec3::Z) < 1e-9)
    };
    let stretches: Vec<f64> = (0..x.len())
        .filter(|i| rest[*i].z > 0.0999)
        .map(|i| x[i].distance(x[bottom(rest[i]).unwrap()]) - 0.1)
        .collect();
    let mean = stretches.iter().sum::<f64>() / stretches.len() as f64;
    assert!((mean / 1e-3 - 1.0).abs() < 0.02, "{mean}");
    let is_even = |stretch: &f64| (stretch / mean - 1.0).abs() < 1e-3;
    assert!(stretches.iter().all(is_even), "{stretches:?}");
    let stress = field(&stage, BodyField::VonMises);
    let (low, high) = stress
        .iter()
        .fold((f64::MAX, 0.0f64), |(l, h), s| (l.min(*s), h.max(*s)));
    assert!(
        low > 200.5 && high < 202.0 && high / low < 1.001,
        "{low} {high}"
    );
    let strain = field(&stage, BodyField::Strain);
    let of_length = mean / 0.1 + 0.5 * (mean / 0.1).powi(2);
    assert!(
        strain.iter().all(|e| (e / of_length - 1.0).abs() < 1e-3),
        "{of_length}"
    );
    let growth = field(&stage, BodyField::J);
    let mean_growth = growth.iter().sum::<f64>() / growth.len() as f64;
    assert!(
        (mean_growth - 1.0 - 0.4 * of_length).abs() < 3e-4,
        "{mean_growth}"
    );
}

#[test]
fn reactions_on_order_2_balance_weight_force_and_pressure() {
    let text = BOX.replace("gravity = [0, 0, 0]", "gravity = [0, 0, -9.81]");
    let mut stage = stage(&format!(
        "{text}{TABLE}[[force]]\non = {{ z_above = 0.0999 }}\ntotal = [0, 0.5, 0]\n[[pressure]]\nnormal = [0, 0, 1]\npressure = 100.0\n[[mass]]\non = {{ z_above = 0.0999 }}\nkg = 0.2\n"
    ));
    run(&mut stage, 60);
    // A cube of 1 kg and 0.2 kg on it, 100 Pa on 0.01 m² that turns little.
    let force = reaction(&mut stage, "table").force;
    let expected = DVec3::new(0.0, 0.5, -1.2 * 9.81 - 1.0);
    assert!(
        force.distance(expected) < 0.02 * expected.length(),
        "{force} {expected}"
    );
}

#[test]
fn moved_and_grabbed_regions_of_order_2_follow_their_paths() {
    let mut moved = stage(&format!(
        "{BOX}{TABLE}[[move]]\nname = \"lid\"\non = {{ axis = \"z\", above = 0.99 }}\npath = [[0.0, 0, 0, 0], [0.2, 0.0, 0.01, 0.01]]\n"
    ));
    run(&mut moved, 40);
    let (x, rest) = (positions(&moved), moved.mesh().nodes.clone());
    for i in (0..x.len()).filter(|i| rest[*i].z > 0.0999) {
        let target = rest[i] + DVec3::new(0.0, 0.01, 0.01);
        assert!(x[i].distance(target) < 1e-6, "{} {target}", x[i]);
    }
    let [table, lid] = ["table", "lid"].map(|name| reaction(&mut moved, name).force);
    assert!(
        (table + lid).length() < 1e-3 * lid.length(),
        "{table} {lid}"
    );
    let mut grabbed = stage(&format!(
        "{BOX}{TABLE}[[grab]]\nat = [0.1, 0.1, 0.1]\nradius = 0.03\npath = [[0.0, 0, 0, 0], [0.2, 0, 0, 0.01]]\n"
    ));
    run(&mut grabbed, 8);
    let x = positions(&grabbed);
    let corner = (0..x.len()).find(|i| rest[*i].distance(DVec3::splat(0.1)) < 1e-6);
    let risen = x[corner.unwrap()].z - 0.1;
    assert!((risen - 0.01).abs() < 1e-5, "{risen}");
}

#[test]
fn tool_on_order_2_presses_as_on_a_finer_mesh() {
    let force = |order: u32, tets: usize| {
        let text = BOX
            .replace("order = 2", &format!("order = {order}"))
            .replace("tets = 162", &format!("tets = {tets}"));
        let mut stage = stage(&format!("{text}{TABLE}{FINGER}"));
        run(&mut stage, 12);
        let [finger, table] = ["finger", "table"].map(|name| reaction(&mut stage, name).force);
        assert!(
            (finger + table).length() < 0.02 * table.length(),
            "{finger} {table}"
        );
        assert!(stage.end_notes().unwrap().is_empty());
        table.length()
    };
    let (coarse, coarser, fine) = (force(2, 1296), force(1, 1296), force(1, 20_000));
    let found = [coarse, coarser, fine];
    println!("order 2, order 1 and finer: {found:.4?} N");
    for (force, expected) in found.iter().zip([8.257, 11.517, 8.107]) {
        assert!((force / expected - 1.0).abs() < 0.01, "{found:?}");
    }
}

#[test]
fn order_2_supports_rigid_regions_muscles_and_joined_meshes() {
    let text = BOX.replace(
        "generate = \"box\"\nunit = 1.0\ntets = 162",
        "generate = \"biceps\"\ntets = 1500",
    );
    let mut stage = stage(&format!(
        "{text}{}",
        "[[pin]]\nz_above = 0.112\n[[muscle]]\nregion = \"muscle\"\nfibre = \"fibre\"\ntension = 4e4\nactivation = [[0.0, 0.0], [0.2, 0.5]]\n"
    ));
    let length = |stage: &Stage| {
        let z = positions(stage).into_iter().map(|p| p.z);
        let (low, high) = z.fold((f64::MAX, f64::MIN), |(l, h), z| (l.min(z), h.max(z)));
        high - low
    };
    let before = length(&stage);
    run(&mut stage, 10);
    let after = length(&stage);
    let share = after / before;
    assert!((share - 0.6895).abs() < 1e-3, "{share}");
    let joined = r#"
[mesh]
generate = "box"
tets = 48
unit = 1.0
[[mesh.join]]
name = "upper"
generate = "box"
tets = 48
offset = [0, 0, 0.105]
[material]
model = "neo-hookean"
order = 2
young = 2e4
density = 1000
[solver]
name = "implicit"
dt = 0.02
[[pin]]
axis = "z"
below = 0.01
[contact]
friction = 0.5
[picture]
size = [48, 36]
"#;
    let mut resting = self::stage(joined);
    run(&mut resting, 40);
    let x = positions(&resting);
    // The upper box fell by 5 mm onto the lower one, which is pressed by its weight.
    let upper = (0..x.len()).filter(|i| resting.mesh().nodes[*i].z > 0.1045);
    let lowest = upper.map(|i| x[i].z).fold(f64::MAX, f64::min);
    assert!((lowest - 0.0946).abs() < 2e-4, "{lowest}");
}

#[test]
fn order_2_keeps_rigid_regions_rigid() {
    let text = r#"
[mesh]
generate = "limb"
tets = 3000
[material]
model = "neo-hookean"
order = 2
[material.bone]
rigid = true
[solver]
name = "implicit"
dt = 0.02
tolerance = 1e-8
gravity = [0, 0, -9.81]
[[pin]]
axis = "x"
below = 0.02
[picture]
size = [48, 36]
"#;
    let mut stage = stage(text);
    run(&mut stage, 10);
    let (x, mesh) = (positions(&stage), stage.mesh());
    let model = stage.motion().unwrap().simulator.model().unwrap();
    let (low, high) = mesh.bounds();
    let size = (high - low).max_element();
    assert!(!model.rigid_bodies().is_empty());
    for body in model.rigid_bodies() {
        let [a, b] = [body.nodes[0], body.nodes[body.nodes.len() - 1]].map(|v| v as usize);
        for i in body.nodes.iter().map(|v| *v as usize) {
            for j in [a, b] {
                let stretch = x[i].distance(x[j]) - mesh.nodes[i].distance(mesh.nodes[j]);
                assert!(stretch.abs() < 1e-5 * size, "{stretch}");
            }
        }
    }
    let moved = (0..x.len()).map(|i| x[i].distance(mesh.nodes[i]));
    let moved = moved.fold(0.0, f64::max) / size;
    assert!((moved / 0.52483 - 1.0).abs() < 1e-3, "{moved}");
}

#[test]
fn order_2_is_cut_resumed_and_sleeps() {
    let text = BOX.replace("gravity = [0, 0, 0]", "gravity = [0, 0, -9.81]");
    let text = format!("{text}{TABLE}");
    let mut whole = stage(&text);
    whole.keep_checkpoints();
    run(&mut whole, 3);
    let half = whole.checkpoint(&[]).unwrap();
    run(&mut whole, 4);
    let mut resumed = stage(&text);
    resumed.resume(&half).unwrap();
    run(&mut resumed, 4);
    assert_eq!(positions(&whole), positions(&resumed));
    assert_eq!(
        whole.image().unwrap().values,
        resumed.image().unwrap().values
    );
    let corner = |x: f64, y: f64| DVec3::new(x, y, 0.05);
    let blade = Blade::from_quad([
        corner(-0.1, -0.1),
        corner(0.2, -0.1),
        corner(0.2, 0.2),
        corner(-0.1, 0.2),
    ]);
    assert!(whole.cut(&blade.unwrap()).unwrap());
    let nodes = whole.mesh().nodes.len();
    assert!(nodes > resumed.mesh().nodes.len() && whole.mesh().ten_node_tets().is_ok());
    run(&mut whole, 4);
    let mut asleep = stage(&text.replace("sleep = false", "sleep = true"));
    run(&mut asleep, 200);
    assert!(asleep.measure(1).unwrap().asleep, "still awake");
}

/// Every scheme on f32 swings a bar at the same period; explicit schemes choose a stable step.
#[test]
fn all_schemes_hold_on_order_2() {
    let mut found = Vec::new();
    for (solver, dt) in [
        ("implicit", "dt = 0.0005"),
        ("bdf2", "dt = 0.002"),
        ("midpoint", "dt = 0.002"),
        ("symplectic", ""),
        ("verlet", ""),
        ("velocity-verlet", ""),
    ] {
        let text = BOX
            .replace("\"implicit\"", &format!("\"{solver}\""))
            .replace("dt = 0.05", dt)
            .replace("tets = 162", "tets = 48")
            .replace(
                "density = 1000",
                "density = 1000\ndamping_ratio = 0.05\ndamping_hz = 20",
            )
            .replace("tolerance = 1e-7\n", "")
            .replace("gravity = [0, 0, 0]", "gravity = [0, 0, -9.81]");
        let mut stage = stage(&format!("{text}{TABLE}"));
        let until = 0.04;
        while stage.time() < until - 1e-9 {
            run(&mut stage, 1);
        }
        let x = positions(&stage);
        let rest = &stage.mesh().nodes;
        let top = (0..x.len()).filter(|i| rest[*i].z > 0.0999);
        let drops: Vec<f64> = top.map(|i| rest[i].z - x[i].z).collect();
        let drop = drops.iter().sum::<f64>() / drops.len() as f64;
        // All at the same time, to first order.
        found.push((solver, drop * (until / stage.time()).powi(2)));
    }
    let (_, reference) = found[1];
    for (solver, drop) in &found {
        assert!((drop / reference - 1.0).abs() < 0.1, "{solver}: {found:?}");
    }
}
