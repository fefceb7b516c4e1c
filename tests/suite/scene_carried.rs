//! Dynamic tools (with a mass or on a spring) in scenes.

use crate::stages::{reaction, refused, stage};
use glam::DVec3;
use palpate::mesh::Blade;
use palpate::scene::Stage;

/// A box of 10 cm on a table.
const BOX: &str = r#"
[mesh]
generate = "box"
tets = 384
[material]
model = "neo-hookean"
young = 2e4
density = 1000
[solver]
name = "implicit"
dt = 0.02
gravity = [0, 0, -9.81]
[[pin]]
name = "table"
z_below = 0.001
[picture]
size = [48, 36]
"#;

/// A finger that a target pushes 4 cm deep with a force of at most 3 N.
const FINGER: &str = r#"
[[tool]]
name = "finger"
sphere = { radius = 0.015 }
at = [0.05, 0.05, 0.118]
path = [[0.0, 0, 0, 0], [0.2, 0, 0, -0.04]]
spring_stiffness = 400
max_force = 3
friction = 0.4
"#;

/// A weight of 200 g that falls onto it.
const WEIGHT: &str = r#"
[[tool]]
name = "weight"
box = { size = [0.02, 0.02, 0.02] }
at = [0.02, 0.02, 0.114]
orientation = [0.1, 0.05, 1]
mass = 0.2
friction = 0.4
"#;

/// Returns the mean position of the nodes of a region.
fn middle(stage: &Stage, name: &str) -> DVec3 {
    let mesh = stage.mesh();
    let (label, _) = mesh
        .region_names
        .iter()
        .find(|(_, own)| *own == name)
        .unwrap();
    let labels = &mesh
        .fields
        .iter()
        .find(|f| f.name == "label")
        .unwrap()
        .values;
    let own = mesh.tets.iter().zip(labels);
    let own = own
        .filter(|(_, l)| **l as i64 == *label)
        .map(|(tet, _)| tet);
    let mut nodes: Vec<u32> = own.flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    let x = stage.motion().unwrap().positions().unwrap();
    nodes.iter().map(|v| x[*v as usize]).sum::<DVec3>() / nodes.len() as f64
}

#[test]
fn spring_tool_force_is_limited_and_free_tool_comes_to_rest() {
    let mut stage = stage(&format!("{BOX}{FINGER}{WEIGHT}"));
    stage.run(100, &mut |_| {}).unwrap();
    let force = |stage: &mut Stage, name: &str| reaction(stage, name).force;
    let pressed = force(&mut stage, "finger spring");
    assert!((pressed.length() - 3.0).abs() < 1e-3, "{pressed}");
    assert!(pressed.z > 2.9, "{pressed}");
    // The contact forces on the tools balance the loads on them.
    let ball = 4.0 / 3.0 * std::f64::consts::PI * 0.015f64.powi(3);
    let on_finger = force(&mut stage, "finger");
    let bears = pressed + DVec3::Z * 9.81 * 1000.0 * ball;
    assert!(on_finger.distance(bears) < 0.03, "{on_finger} {bears}");
    let on_weight = force(&mut stage, "weight");
    assert!(
        on_weight.distance(9.81 * 0.2 * DVec3::Z) < 0.03,
        "{on_weight}"
    );
    let told: Vec<String> = stage
        .measure(1)
        .unwrap()
        .tools
        .iter()
        .map(|t| t.name.clone())
        .collect();
    assert_eq!(told, ["finger", "weight"]);
    let finger = middle(&stage, "finger");
    assert!((finger.z - 0.1081).abs() < 5e-4, "{finger}");
    // The table supports the body, 1 kg, both tools and the finger's force.
    let table = force(&mut stage, "table");
    let volume = 4.0 / 3.0 * std::f64::consts::PI * 0.015f64.powi(3);
    let borne = 9.81 * (1.0 + 0.2 + 1000.0 * volume) + 3.0;
    assert!((table.z / -borne - 1.0).abs() < 0.02, "{table} {borne}");
    let weight = middle(&stage, "weight");
    let expected = DVec3::new(0.0169, 0.0177, 0.1045);
    assert!(weight.distance(expected) < 2e-4, "{weight}");
    stage.run(20, &mut |_| {}).unwrap();
    assert!(middle(&stage, "weight").distance(weight) < 1e-3);
}

/// Writes a closed, non-convex surface: an L of 3 by 3 by 1 cm.
fn bracket() -> std::path::PathBuf {
    let outline = [
        [0.0, 0.0],
        [0.03, 0.0],
        [0.03, 0.01],
        [0.01, 0.01],
        [0.01, 0.03],
        [0.0, 0.03],
    ];
    let flat = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
    let mut text = String::from("solid bracket\n");
    let mut facet = |corners: [[f64; 3]; 3]| {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in corners {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endloop\nendfacet\n";
    };
    let at = |k: usize, z: f64| [outline[k % 6][0], outline[k % 6][1], z];
    for [a, b, c] in flat {
        facet([at(a, 0.01), at(b, 0.01), at(c, 0.01)]);
        facet([at(a, 0.0), at(c, 0.0), at(b, 0.0)]);
    }
    for k in 0..6 {
        facet([at(k, 0.0), at(k + 1, 0.0), at(k + 1, 0.01)]);
        facet([at(k, 0.0), at(k + 1, 0.01), at(k, 0.01)]);
    }
    text += "endsolid bracket\n";
    let file = std::env::temp_dir().join(format!("palpate-bracket-{}.stl", std::process::id()));
    std::fs::write(&file, text).unwrap();
    file
}

#[test]
fn closed_surface_tool_rests_with_its_weight() {
    let file = bracket();
    let tool = format!(
        "[[tool]]\nname = \"bracket\"\nsurface = {:?}\nat = [0.03, 0.03, 0.106]\nmass = 0.05\nfriction = 0.4\n",
        file.display().to_string()
    );
    let mut stage = stage(&format!("{BOX}{tool}"));
    std::fs::remove_file(&file).unwrap();
    stage.run(100, &mut |_| {}).unwrap();
    let all = stage.reactions().unwrap();
    let (_, on) = all.iter().find(|(name, _)| name == "bracket").unwrap();
    let weight = 9.81 * 0.05 * DVec3::Z;
    assert!(on.force.distance(weight) < 0.02, "{} {weight}", on.force);
    assert!(on.moment.length() < 2e-4, "{}", on.moment);
    let lies = middle(&stage, "bracket");
    assert!((lies.z - 0.1030).abs() < 2e-4, "{lies}");
}

#[test]
fn surface_tool_on_spring_follows_path() {
    let file = bracket();
    let tool = format!(
        "[[tool]]\nname = \"hook\"\nsurface = {:?}\nat = [0.03, 0.03, 0.13]\npath = [[0.0, 0, 0, 0], [0.2, 0, 0.02, 0]]\nspring_stiffness = 500\n",
        file.display().to_string()
    );
    let mut stage = stage(&format!("{BOX}{tool}"));
    std::fs::remove_file(&file).unwrap();
    let before = middle(&stage, "hook");
    stage.run(100, &mut |_| {}).unwrap();
    let moved = middle(&stage, "hook") - before;
    // The spring deflects by the weight of 5 cm³ of water.
    let goal = DVec3::new(0.0, 0.02, -9.81 * 5e-3 / 500.0);
    assert!(moved.distance(goal) < 5e-4, "{moved} {goal}");
    let all = stage.reactions().unwrap();
    let on = |name: &str| all.iter().find(|(own, _)| own == name).unwrap().1.force;
    assert!(on("hook").length() < 1e-9, "{}", on("hook"));
    let borne = on("hook spring");
    assert!((borne.z + 9.81 * 5e-3).abs() < 2e-3, "{borne}");
}

#[test]
fn stiff_spring_on_light_tool_is_stable() {
    // 2 g on 5 kN/m, 30 times the stability limit of an explicit step.
    let light = FINGER.replace(
        "spring_stiffness = 400",
        "spring_stiffness = 5000\nmass = 0.002",
    );
    let light = light.replace("max_force = 3\n", "");
    let mut stage = stage(&format!("{BOX}{light}"));
    stage.run(40, &mut |_| {}).unwrap();
    let finger = middle(&stage, "finger");
    // The deflection of the spring equals its load.
    let target = DVec3::new(0.05, 0.05, 0.078);
    assert!(
        finger.distance(target) < 1e-2 && finger.z > target.z,
        "{finger}"
    );
}

#[test]
fn dynamic_tools_are_rendered() {
    let mut with = stage(&format!("{BOX}{WEIGHT}"));
    let mut hidden = stage(&format!("{BOX}{WEIGHT}hidden = true\n"));
    let [with, hidden] = [&mut with, &mut hidden].map(|stage| stage.image().unwrap().values);
    assert_ne!(with, hidden);

    // And still are after the body is cut.
    let mut cut = stage(&format!("{BOX}{WEIGHT}"));
    assert_eq!(cut.skins().len(), 1);
    let corners = [[-1.0, 0.05], [1.0, 0.05], [1.0, 0.2], [-1.0, 0.2]];
    let blade = Blade::from_quad(corners.map(|[y, z]| DVec3::new(0.07, y, z))).unwrap();
    assert!(cut.cut(&blade).unwrap());
    assert_eq!(cut.skins().len(), 1);
}

#[test]
fn dynamic_tools_reject_invalid_entries() {
    for (given, said) in [
        (
            "[[tool]]\nplane = {}\nat = [0, 0, 0.2]\nmass = 1\n",
            "spheres, capsules, boxes and closed surfaces",
        ),
        (
            "[[tool]]\nsphere = { radius = 0.01 }\nat = [0, 0, 0.2]\nmass = -1\n",
            "must have a positive, finite mass",
        ),
        (
            "[[tool]]\nsphere = { radius = 0.0 }\nat = [0, 0, 0.2]\nmass = 1\n",
            "radius 0",
        ),
        (
            "[[tool]]\nsphere = { radius = 0.01 }\nat = [0, 0, 0.2]\nmass = 1\npath = [[0.0, 0, 0, 0]]\n",
            "set `spring_stiffness`",
        ),
        (
            "[[tool]]\nsphere = { radius = 0.01 }\nat = [0, 0, 0.2]\nmass = 1\nmax_force = 1\n",
            "without `spring_stiffness`",
        ),
        (
            "[[tool]]\nsphere = { radius = 0.01 }\nat = [0, 0, 0.2]\nspring_stiffness = 1\nrotation = [[0.0, 0]]\n",
            "remove them",
        ),
    ] {
        let message = refused(&format!("{BOX}{given}"));
        assert!(message.contains(said), "{message}");
    }
    let loose = BOX.replace("[[pin]]\nname = \"table\"\nz_below = 0.001\n", "");
    assert!(refused(&format!("{loose}{WEIGHT}")).contains("[[pin]]"));
    let gpu = BOX.replace("dt = 0.02", "dt = 0.02\nengine = \"gpu\"");
    assert!(refused(&format!("{gpu}{WEIGHT}")).contains("cpu"));
}
