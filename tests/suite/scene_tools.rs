//! Tools in scenes and pictures.

use crate::stages::{FINGER, TABLE, box_scene, positions, reaction, refused, run, stage};
use glam::DVec3;
use palpate::physics::Engine;
use palpate::render::Image;
use palpate::scene::ReactionLog;

/// A box of 100 mm, without gravity.
const BOX: &str = box_scene!("1296", "", "dt = 0.05\ngravity = [0, 0, 0]");

#[test]
fn tool_force_equals_pin_reaction() {
    let mut stage = stage(&format!("{BOX}{TABLE}{FINGER}"));
    assert_eq!(stage.motion().unwrap().engine(), Engine::Cpu);
    let file = std::env::temp_dir().join(format!("palpate-tools-{}.csv", std::process::id()));
    let mut log = ReactionLog::create(&file).unwrap();
    log.push(&mut stage).unwrap();
    run(&mut stage, 4);
    log.push(&mut stage).unwrap();
    run(&mut stage, 30);
    log.push(&mut stage).unwrap();
    let (finger, table) = (
        reaction(&mut stage, "finger"),
        reaction(&mut stage, "table"),
    );
    // Hertz: 7.6 N on a half-space; the block is a layer, and its tets are coarse.
    let expected = 11.516;
    assert!((finger.force.z / expected - 1.0).abs() < 0.01, "{finger:?}");
    let off = (finger.force + table.force).length();
    assert!(off < 0.01 * finger.force.z, "{finger:?} {table:?}");
    // Pressed at the centre, it is neither displaced laterally nor rotated.
    assert!(finger.force.truncate().length() < 0.1 * finger.force.z);
    assert!(finger.moment.length() < 0.1 * 0.02 * finger.force.z);
    let text = std::fs::read_to_string(&file).unwrap();
    let rows: Vec<&str> = text.lines().filter(|l| l.contains(",finger,")).collect();
    assert_eq!(rows.len(), 3, "{text}");
    let z = |row: &str| row.split(',').nth(4).unwrap().parse::<f64>().unwrap();
    assert_eq!(z(rows[0]), 0.0);
    assert!((z(rows[2]) - finger.force.z).abs() < 1e-12);
    let report = stage.measure(1).unwrap();
    assert_eq!(report.tools.len(), 1);
    assert_eq!(report.tools[0].name, "finger");
    // No boundary node is inside.
    let centre = DVec3::new(0.05, 0.05, 0.105);
    let nearest = positions(&stage)
        .iter()
        .map(|x| x.distance(centre))
        .fold(1.0, f64::min);
    assert!(nearest > 0.02 && nearest < 0.025, "{nearest}");
    std::fs::remove_file(&file).unwrap();
}

#[test]
fn failed_contact_of_tool_is_noted_at_the_end() {
    let notes = |tool: &str, steps: u32| {
        let mut stage = stage(&format!("{BOX}{TABLE}{tool}"));
        run(&mut stage, steps);
        stage.end_notes().unwrap()
    };
    assert_eq!(notes(FINGER, 6), Vec::<String>::new());
    // It starts inside, where it meets no boundary.
    let swallowed = FINGER.replace("0.02 }", "0.005 }");
    let swallowed = notes(&swallowed.replace("0.125]", "0.06]"), 2);
    assert!(
        swallowed.len() == 1 && swallowed[0].contains("finger is inside the body"),
        "{swallowed:?}"
    );
    // It touches faces larger than itself.
    let coarse = FINGER.replace("0.02 }", "0.01 }");
    let coarse = notes(&coarse.replace("-0.02]", "-0.025]"), 6);
    assert!(
        coarse.len() == 1 && coarse[0].contains("smaller than the faces"),
        "{coarse:?}"
    );
}

#[test]
fn gpu_tool_contact_matches_cpu() {
    let moved =
        "path = [[0.0, 0, 0, 0], [0.2, 0, 0, -0.02], [0.6, 0.01, 0, -0.015]]\nfriction = 0.3";
    let finger = FINGER.replace("path = [[0.0, 0, 0, 0], [0.2, 0, 0, -0.02]]", moved);
    let on = |engine: &str| {
        let text = BOX.replace("dt = 0.05", &format!("dt = 0.05\nengine = \"{engine}\""));
        let mut stage = stage(&format!("{text}{TABLE}{finger}"));
        run(&mut stage, 12);
        let engine = stage.motion().unwrap().engine();
        let report = stage.measure(1).unwrap();
        let felt = reaction(&mut stage, "finger");
        assert_eq!(report.tools.len(), 1);
        (engine, felt, positions(&stage))
    };
    let ((engine, found, x), (_, truth, y)) = (on("gpu"), on("cpu"));
    assert_eq!(engine, Engine::Gpu);
    let size = truth.force.length();
    assert!(
        truth.force.z > 0.1 && -truth.force.x > 0.02 * size,
        "{truth:?}"
    );
    let off = (found.force - truth.force).length();
    assert!(off < 0.02 * size, "{found:?} {truth:?}");
    let off = x.iter().zip(&y).map(|(a, b)| a.distance(*b));
    assert!(off.fold(0.0, f64::max) < 0.01 * 0.02);
}

#[test]
fn surface_tool_matches_sphere_and_friction_drags() {
    let force = |tool: &str, more: &str| {
        let text = FINGER.replace("sphere = { radius = 0.02 }", tool);
        let mut stage = stage(&format!("{BOX}{TABLE}{text}{more}"));
        run(&mut stage, 12);
        reaction(&mut stage, "finger").force
    };
    let ball = force("sphere = { radius = 0.02 }", "");
    let folder = std::env::temp_dir().join(format!("palpate-ball-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("ball.obj");
    std::fs::write(&file, sphere(0.02)).unwrap();
    let surface = force(&format!("surface = {:?}", file.to_str().unwrap()), "");
    assert!((surface.z / ball.z - 1.0).abs() < 0.05, "{surface} {ball}");
    let capsule = force(
        "capsule = { radius = 0.02, length = 0.04 }\norientation = [1, 0, 0]",
        "",
    );
    let ratio = capsule.z / ball.z;
    assert!((ratio - 1.578).abs() < 0.02, "{ratio}");
    let aside = "path = [[0.0, 0, 0, 0], [0.2, 0, 0, -0.02], [0.6, 0.02, 0, -0.02]]";
    let drag = |friction: &str| {
        let text = FINGER.replace("path = [[0.0, 0, 0, 0], [0.2, 0, 0, -0.02]]", aside);
        let mut stage = stage(&format!("{BOX}{TABLE}{text}{friction}"));
        run(&mut stage, 12);
        reaction(&mut stage, "finger").force
    };
    let [smooth, rough] = ["", "friction = 0.3\n"].map(drag);
    // It slides: the drag is Coulomb's, less what the dent's other shape changes.
    let drag = (smooth.x - rough.x) / rough.z;
    assert!((drag - 0.31).abs() < 0.01, "{drag}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Returns a ball as an OBJ file.
fn sphere(radius: f64) -> String {
    let (rings, around) = (24, 32);
    let mut text = format!("v 0 0 {radius}\nv 0 0 -{radius}\n");
    for k in 1..rings {
        let polar = std::f64::consts::PI * f64::from(k) / f64::from(rings);
        for n in 0..around {
            let angle = std::f64::consts::TAU * f64::from(n) / f64::from(around);
            let (x, y) = (polar.sin() * angle.cos(), polar.sin() * angle.sin());
            let p = radius * DVec3::new(x, y, polar.cos());
            text += &format!("v {} {} {}\n", p.x, p.y, p.z);
        }
    }
    let at = |k: i32, n: i32| match k {
        0 => 1,
        k if k == rings => 2,
        k => 3 + (k - 1) * around + n % around,
    };
    for k in 0..rings {
        for n in 0..around {
            let [a, b, c, d] = [at(k, n), at(k + 1, n), at(k + 1, n + 1), at(k, n + 1)];
            if k + 1 < rings {
                text += &format!("f {a} {b} {c}\n");
            }
            if k > 0 {
                text += &format!("f {a} {c} {d}\n");
            }
        }
    }
    text
}

#[test]
fn block_rests_on_plane_tool_without_pins() {
    let text = BOX.replace("gravity = [0, 0, 0]", "gravity = [0, 0, -9.81]");
    let plane = "[[tool]]\nname = \"ground\"\nplane = {}\nat = [0, 0, -0.01]\nfriction = 0.4\n";
    let mut stage = stage(&format!("{text}{plane}"));
    run(&mut stage, 30);
    let ground = reaction(&mut stage, "ground").force;
    assert!((ground.z / -9.81 - 1.0).abs() < 0.01, "{ground}");
    let lowest = positions(&stage).iter().map(|x| x.z).fold(1.0, f64::min);
    assert!(lowest > -0.01 && lowest < -0.0098, "{lowest}");
}

#[test]
fn resumed_run_is_identical() {
    let text = format!("{BOX}{TABLE}{FINGER}friction = 0.2\n")
        .replace("-0.02]]", "-0.02], [0.5, 0.02, 0, -0.01]]");
    let mut whole = stage(&text);
    whole.keep_checkpoints();
    run(&mut whole, 3);
    let half = whole.checkpoint(&[]).unwrap();
    run(&mut whole, 5);
    let mut resumed = stage(&text);
    resumed.resume(&half).unwrap();
    run(&mut resumed, 5);
    assert_eq!(positions(&whole), positions(&resumed));
    let forces = [&mut whole, &mut resumed].map(|stage| reaction(stage, "finger"));
    assert_eq!(forces[0], forces[1]);
    assert_eq!(
        whole.image().unwrap().values,
        resumed.image().unwrap().values
    );
}

/// Returns the fraction of pixels in which two pictures differ.
fn differ(a: &Image, b: &Image) -> f64 {
    let pixels = a.values.chunks(4).zip(b.values.chunks(4));
    let apart = pixels.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| (a - b).abs() > 0.02));
    apart.count() as f64 / (a.values.len() / 4) as f64
}

#[test]
fn tools_are_rendered_at_their_poses() {
    // Viewed along −y: the body lies between 0 and 0.1.
    let eye = "[camera]\neye = [0.05, -0.4, 0.06]\nlook_at = [0.05, 0.05, 0.06]\n";
    for mode in ["surface", "composite"] {
        let picture = |tool: &str| {
            let text = BOX.replace(
                "size = [48, 36]",
                &format!("size = [48, 36]\nmode = \"{mode}\""),
            );
            stage(&format!("{text}{TABLE}{eye}{tool}")).image().unwrap()
        };
        let at = |y: f64, more: &str| {
            let sphere = "sphere = { radius = 0.02 }";
            picture(&format!(
                "[[tool]]\n{sphere}\nat = [0.05, {y}, 0.05]\n{more}"
            ))
        };
        let nothing = picture("");
        let before = at(-0.1, "colour = [1.0, 0, 0]\n");
        let hidden = at(-0.1, "hidden = true\n");
        assert_eq!(differ(&nothing, &hidden), 0.0, "{mode}");
        assert!(differ(&nothing, &before) > 0.02, "{mode}");
        // Red at its position: in the middle.
        let middle = 4 * (18 * 48 + 24);
        let [r, g] = [0, 1].map(|k| before.values[middle + k]);
        assert!(r > 0.3 && g < 0.1 * r, "{mode}: {r} {g}");
        let behind = at(0.2, "colour = [1.0, 0, 0]\n");
        match mode {
            // Opaque objects occlude those behind them.
            "surface" => assert!(differ(&nothing, &behind) < 0.002),
            _ => assert!(differ(&nothing, &behind) < differ(&nothing, &before) + 0.01),
        }
    }
}

#[test]
fn pictures_follow_tool_motion() {
    let mut stage = stage(&format!("{BOX}{TABLE}{FINGER}").replace("-0.02]]", "0.02]]"));
    let first = stage.image().unwrap();
    run(&mut stage, 4);
    assert!(differ(&first, &stage.image().unwrap()) > 0.001);
}

#[test]
fn tools_reject_invalid_entries() {
    let cases = [
        (
            FINGER.replace("sphere = { radius = 0.02 }", ""),
            ["`sphere`", "exactly one of"],
        ),
        (
            FINGER.replace("at =", "plane = {}\nat ="),
            ["`sphere`", "exactly one of"],
        ),
        (
            FINGER.replace("0.02 }", "-1.0 }"),
            ["radius -1", "lengths > 0"],
        ),
        (format!("{FINGER}friction = -0.1\n"), ["-0.1", "≥ 0"]),
        (
            format!("{FINGER}gap = 0.0\n"),
            ["gap must be", "> 0, got 0"],
        ),
        (
            format!("{FINGER}orientation = [0, 0, 0]\n"),
            ["orientation", "direction"],
        ),
        (
            format!("{FINGER}axis = [0, 0, 1]\n"),
            ["[[tool]]", "both `axis`"],
        ),
        (
            format!("{FINGER}file = \"a.csv\"\n"),
            ["[[tool]]", "remove one of them"],
        ),
    ];
    for (text, words) in cases {
        let error = refused(&format!("{BOX}{TABLE}{text}"));
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    }
    let of_body = [
        (
            "model = \"neo-hookean\"",
            "model = \"springs\"",
            ["finite elements", "neo-hookean"],
        ),
        (
            "name = \"implicit\"",
            "name = \"midpoint\"",
            ["midpoint", "bdf2"],
        ),
        (
            "name = \"implicit\"",
            "name = \"bdf2\"\nengine = \"gpu\"",
            ["bdf2", "engine"],
        ),
        ("[[pin]]", "[cage]\n[[pin]]", ["[[tool]]", "[cage]"]),
    ];
    for (from, to, words) in of_body {
        let error = refused(&format!("{BOX}{TABLE}{FINGER}").replace(from, to));
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    }
    // A tool that starts inside is reported, and pushed out.
    let inside = FINGER.replace("0.125]", "0.11]");
    let stage = stage(&format!("{BOX}{TABLE}{inside}"));
    let note = stage.notes().iter().find(|n| n.contains("pushed out"));
    assert!(
        note.is_some_and(|n| n.contains("finger")),
        "{:?}",
        stage.notes()
    );
}
