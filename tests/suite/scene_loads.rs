//! Pressure, prescribed displacements and muscles in scenes.

use crate::stages::{TABLE, box_scene, positions, refused, run, stage};
use crate::support::gpu;
use glam::{DQuat, DVec3};
use palpate::generate;
use palpate::mesh::{Field, Location, TetMesh, Topology};
use palpate::physics::Engine;
use palpate::scene::{Scene, Stage};

/// A box of 100 mm under its weight.
const BOX: &str = box_scene!(
    "384",
    "",
    "dt = 0.05\ntolerance = 1e-7\ngravity = [0, 0, -9.81]"
);

#[test]
fn moved_nodes_follow_path_at_each_step() {
    let folder = std::env::temp_dir().join(format!("palpate-moves-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(
        folder.join("way.csv"),
        "time_s,x,y,z\n0.0,0,0,0\n0.2,0.0,0.01,0.02\n0.3,0.0,0.01,0.02\n",
    )
    .unwrap();
    let moves = r#"
[[move]]
on = { axis = "z", above = 0.99 }
WAY
rotation = [[0.05, 0], [0.25, 40]]
axis = [0, 0, 2]
"#;
    let inline = "path = [[0.0, 0, 0, 0], [0.2, 0.0, 0.01, 0.02], [0.3, 0, 0.01, 0.02]]";
    for (way, model, solver, height) in [
        (inline, "neo-hookean", "implicit", 0.00942),
        ("file = \"way.csv\"", "neo-hookean", "midpoint", 0.00936),
        (inline, "springs", "implicit", 0.00948),
    ] {
        let text = format!("{BOX}{TABLE}{}", moves.replace("WAY", way));
        let text = text
            .replace("neo-hookean", model)
            .replace("\"implicit\"", &format!("\"{solver}\""));
        let file = folder.join("scene.toml");
        std::fs::write(&file, text).unwrap();
        let mut stage = Stage::new(&gpu(), &Scene::read(&file).unwrap()).unwrap();
        assert_eq!(stage.motion().unwrap().engine(), Engine::Cpu);
        let rest = stage.mesh().nodes.clone();
        let top: Vec<usize> = (0..rest.len()).filter(|i| rest[*i].z > 0.0999).collect();
        let middle = DVec3::new(0.05, 0.05, 0.1);
        for step in 1..=8 {
            run(&mut stage, 1);
            let time = f64::from(step) * 0.05;
            let share = (time / 0.2).min(1.0);
            let angle = (40.0 * ((time - 0.05) / 0.2).clamp(0.0, 1.0)).to_radians();
            let turn = DQuat::from_rotation_z(angle);
            let now = positions(&stage);
            for i in &top {
                let to = middle + turn * (rest[*i] - middle) + share * DVec3::new(0.0, 0.01, 0.02);
                assert!(
                    now[*i].distance(to) < 1e-7,
                    "{model}, step {step}: {} {to}",
                    now[*i]
                );
            }
        }
        // Interior nodes follow: half way up, by about half the distance.
        let now = positions(&stage);
        let inner = (0..rest.len()).filter(|i| (rest[*i].z - 0.05).abs() < 1e-6);
        let moved: Vec<f64> = inner.map(|i| (now[i] - rest[i]).z).collect();
        let mean = moved.iter().sum::<f64>() / moved.len() as f64;
        assert!((mean - height).abs() < 5e-5, "{model} {solver} {mean}");
        // In the final equilibrium, the moved and the pinned nodes support the weight together.
        run(&mut stage, 60);
        let reactions = stage.reactions().unwrap();
        let names: Vec<&str> = reactions.iter().map(|r| r.0.as_str()).collect();
        assert_eq!(names, ["table", "move1"]);
        let sum = reactions[0].1.force + reactions[1].1.force;
        let off = sum.distance(-9.81 * DVec3::Z) / 9.81;
        let swings = if solver == "midpoint" { 0.1 } else { 1e-3 };
        assert!(off < swings, "{model}, {solver}: {sum}");
        assert!(reactions[1].1.force.z < -0.5, "{reactions:?}");
    }
    std::fs::write(folder.join("way.csv"), "time_s,x,y,z\n0.0,0,0\n").unwrap();
    let text = format!("{BOX}{TABLE}{}", moves.replace("WAY", "file = \"way.csv\""));
    std::fs::write(folder.join("scene.toml"), text).unwrap();
    let scene = Scene::read(folder.join("scene.toml")).unwrap();
    let error = Stage::new(&gpu(), &scene).err().unwrap().to_string();
    assert!(
        error.contains("way.csv") && error.contains("line 2"),
        "{error}"
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn pressure_on_selected_faces_equals_pin_reaction() {
    let pressed = |more: &str| {
        let mut stage = stage(&format!("{BOX}{TABLE}[[pressure]]\n{more}"));
        assert_eq!(stage.motion().unwrap().engine(), Engine::Cpu);
        run(&mut stage, 40);
        let force = stage.reactions().unwrap()[0].1.force;
        (force + 9.81 * DVec3::Z, stage)
    };
    let area = |stage: &Stage| {
        let (mesh, topology) = (stage.mesh(), Topology::new(stage.mesh()));
        let now = positions(stage);
        let faces = topology
            .boundary
            .iter()
            .map(|b| topology.boundary_nodes(mesh, *b));
        let top = faces.filter(|f| f.iter().all(|v| mesh.nodes[*v as usize].z > 0.0999));
        let of = |f: [u32; 3]| {
            let [a, b, c] = f.map(|v| now[v as usize]);
            0.5 * (b - a).cross(c - a)
        };
        top.map(of).sum::<DVec3>()
    };
    let (force, stage) = pressed("normal = [0, 0, 1]\npressure = 400.0\n");
    let expected = -400.0 * area(&stage);
    assert!(
        force.distance(expected) < 1e-3 * expected.length(),
        "{force} {expected}"
    );
    assert!((expected.length() / 4.0 - 1.0).abs() < 0.1, "{expected}");
    // The same faces selected by position, with a pressure that is ramped up.
    let (same, _) = pressed("on = { z_above = 0.0999 }\npressure = [[0.0, 0.0], [0.5, 400.0]]\n");
    assert!(
        same.distance(force) < 1e-3 * force.length(),
        "{same} {force}"
    );
    // Suction pulls.
    let (up, _) = pressed("normal = [0, 0, 1]\npressure = -400.0\n");
    assert!(up.z > 3.0, "{up}");
}

#[test]
fn pressure_acts_on_region_interface() {
    let folder = std::env::temp_dir().join(format!("palpate-between-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut mesh = generate::box_mesh([4, 4, 4], DVec3::splat(0.1), generate::Split::Five).unwrap();
    let middle = mesh.bounds().0.z + 0.05;
    let upper = |t| mesh.tet_nodes(t).iter().all(|p| p.z > middle - 1e-9);
    let labels = (0..mesh.tets.len()).map(|t| if upper(t) { 2.0 } else { 1.0 });
    let labels = Field::scalar("label", Location::Cell, labels.collect());
    mesh.set_field(labels).unwrap();
    let file = folder.join("halves.vtu");
    palpate::io::write(&file, &mesh).unwrap();
    let text = BOX.replace(
        "generate = \"box\"\nunit = 1.0\ntets = 384",
        &format!("file = {:?}", file.display().to_string()),
    );
    let text = |more: &str| format!("{text}{TABLE}[[pressure]]\npressure = 400.0\n{more}");
    // 400 Pa on a square of 0.1 m, both signs: the pin's reaction changes accordingly.
    for (between, sign) in [("[2, 1]", 1.0), ("[1, 2]", -1.0)] {
        let mut stage = stage(&text(&format!("between = {between}\n")));
        run(&mut stage, 40);
        let force = stage.reactions().unwrap()[0].1.force + 9.81 * DVec3::Z;
        assert!(
            (sign * force.z / -4.0 - 1.0).abs() < 0.1,
            "{between}: {force}"
        );
    }
    // A part of the interface.
    let mut half = stage(&text(&format!(
        "between = [2, 1]\non = {{ x_below = {} }}\n",
        mesh.bounds().0.x + 0.0501
    )));
    run(&mut half, 40);
    let force = half.reactions().unwrap()[0].1.force + 9.81 * DVec3::Z;
    assert!((force.z / -2.0 - 1.0).abs() < 0.1, "{force}");
    for (more, words) in [
        (
            "between = [1, 3]\n",
            ["no face", "interface of the two regions"],
        ),
        ("between = [\"lung\", 1]\n", ["lung", "region"]),
    ] {
        let said = refused(&text(more));
        assert!(words.iter().all(|w| said.contains(w)), "{words:?}: {said}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Returns the volume of the tets of a region, its length along z, and its mean cross-section.
fn shape(mesh: &TetMesh, nodes: &[DVec3], label: f64) -> [f64; 3] {
    let labels = &mesh.field("label", Location::Cell).unwrap().values;
    let (mut volume, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
    for (tet, own) in mesh.tets.iter().zip(labels) {
        if *own == label {
            let corners = tet.map(|v| nodes[v as usize]);
            volume += palpate::mesh::signed_volume(corners);
            for p in corners {
                (low, high) = (low.min(p.z), high.max(p.z));
            }
        }
    }
    [volume, high - low, volume / (high - low)]
}

#[test]
fn muscle_shortens_thickens_and_lifts_weight() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/data/scenes/biceps.toml");
    let mut scene = Scene::read(path).unwrap();
    scene.mesh.tets = Some(2_000);
    scene.picture.size = Some([32, 48]);
    let mut stage = Stage::new(&gpu(), &scene).unwrap();
    let rest = stage.mesh().nodes.clone();
    let [volume, length, section] = shape(stage.mesh(), &rest, 1.0);
    // Relaxed, it is slightly longer.
    run(&mut stage, 10);
    let [_, slack, _] = shape(stage.mesh(), &positions(&stage), 1.0);
    assert!(slack >= 0.999 * length, "{slack} {length}");
    run(&mut stage, 90);
    let now = positions(&stage);
    let [volume_now, length_now, section_now] = shape(stage.mesh(), &now, 1.0);
    let shares = [
        length_now / length,
        section_now / section,
        volume_now / volume,
    ];
    for (share, expected) in shares.iter().zip([0.7218, 1.3253, 0.9567]) {
        assert!((share - expected).abs() < 2e-3, "{shares:?}");
    }
    // The lower tendon has moved up.
    let lowest = |nodes: &[DVec3]| nodes.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    assert!(lowest(&now) > lowest(&rest) + 0.02);
    // Its force balances the suspended load: 2 N and its own weight.
    let body = stage.motion().unwrap().simulator.as_ref();
    let weight = 2.0 + 9.81 * body.masses().iter().sum::<f64>();
    let [(name, origin)] = &stage.reactions().unwrap()[..] else {
        panic!("there is one pin");
    };
    assert_eq!(name, "origin");
    assert!(
        (origin.force.z / -weight - 1.0).abs() < 0.05,
        "{origin:?} {weight}"
    );
    stage.image().unwrap();
}

#[test]
fn loads_reject_invalid_entries() {
    let pressure = "[[pressure]]\npressure = 1.0\n";
    let muscle = "[[muscle]]\ntension = 1e4\nactivation = 0.5\n";
    let lead = "[[move]]\non = { axis = \"z\", above = 0.9 }\npath = [[0, 0, 0, 0]]\n";
    let on_gpu = |text: &str| BOX.replace("dt = 0.05", "dt = 0.05\nengine = \"gpu\"") + text;
    for (text, entry) in [
        (pressure, "[[pressure]]"),
        (muscle, "[[muscle]]"),
        (lead, "[[move]]"),
    ] {
        let said = refused(&on_gpu(&format!("{TABLE}{text}")));
        assert!(
            said.contains(entry) && said.contains("--engine cpu"),
            "{said}"
        );
        let said = refused(&format!("{BOX}{TABLE}{text}[cage]\nnodes = 50\n"));
        assert!(said.contains(entry) && said.contains("[cage]"), "{said}");
        let bodies = "[solver]\nname = \"implicit\"\n[[body]]\nmesh = { generate = \"bar\" }\n";
        let said = refused(&format!("{bodies}{text}"));
        assert!(said.contains(entry) && said.contains("[[body]]"), "{said}");
    }
    for (text, words) in [
        (
            format!("{muscle}fibre = \"grain\"\n"),
            ["grain", "three components"],
        ),
        (muscle.replace("0.5", "1.5"), ["1.5", "from 0 to 1"]),
        (
            muscle.replace("0.5", "[[1.0, 0.1], [0.5, 0.2]]"),
            ["activation", "increasing"],
        ),
        (
            format!("{muscle}fibre = [0, 0, 0]\n"),
            ["fibre", "must not be zero"],
        ),
        (muscle.replace("1e4", "-1.0"), ["-1 Pa", "≥ 0"]),
        (
            format!("{pressure}normal = [0, 0, 0]\n"),
            ["normal", "not zero"],
        ),
        (
            format!("{pressure}normal = [0, 0, 1]\non = {{ z_below = 0.01 }}\n"),
            ["no face", "normal"],
        ),
        (format!("{lead}file = \"a.csv\"\n"), ["path", "file"]),
        (format!("{lead}axis = [0, 0, 1]\n"), ["rotation", "axis"]),
        (
            lead.replace("above = 0.9", "below = 0.5"),
            ["prescribe the motion", "pinned"],
        ),
    ] {
        let said = refused(&format!("{BOX}{TABLE}{text}"));
        assert!(words.iter().all(|w| said.contains(w)), "{words:?}: {said}");
    }
    let springs = format!("{BOX}{TABLE}{muscle}").replace("neo-hookean", "springs");
    let said = refused(&springs);
    assert!(said.contains("--material neo-hookean"), "{said}");
}
