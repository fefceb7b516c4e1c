//! Simulations that are killed and resumed give the same result as uninterrupted ones, byte for
//! byte.

use super::{failure, folder, palpate, stdout, text};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A bar, pinned at one end, grabbed at the other, cut in between.
const BAR: &str = r#"
[mesh]
generate = "bar"
tets = 400
[camera]
eye = [0.06, -0.5, 0.2]
look_at = [0.06, 0.03, 0.0]
up = [0, 0, 1]
[solver]
name = "implicit"
dt = 0.004
steps = 5
[[pin]]
axis = "x"
below = 0.1
[[grab]]
at = [0.12, 0.03, 0.03]
radius = 0.02
path = [[0.0, 0, 0, 0], [0.1, 0, 0, 0.02], [0.2, 0, 0.01, 0.02]]
release_time = 0.13
[[cut]]
edge = [[0.05, -0.01, 0.07], [0.05, 0.07, 0.07]]
path = [[0.03, 0, 0, 0], [0.15, 0.002, 0, -0.045]]
[picture]
size = [96, 72]
"#;

/// A grid body that is pulled by springs and cut.
const GRID: &str = r#"
[mesh]
file = "BAR_FILE"
[grid]
nodes = 400
damping = 2.0
[camera]
eye = [0.06, -0.5, 0.2]
look_at = [0.06, 0.03, 0.0]
up = [0, 0, 1]
[solver]
name = "verlet"
steps = 40
[[pin]]
axis = "x"
below = 0.1
[[grab]]
at = [0.12, 0.03, 0.03]
radius = 0.02
path = [[0.0, 0, 0, 0], [0.2, 0, 0, 0.02]]
spring_stiffness = 40.0
max_force = 1.0
[[cut]]
edge = [[0.05, -0.01, 0.07], [0.05, 0.07, 0.07]]
path = [[0.02, 0, 0, 0], [0.25, 0.002, 0, -0.045]]
[picture]
size = [96, 72]
"#;

fn scene(folder: &Path, name: &str, content: &str) -> PathBuf {
    let path = folder.join(format!("{name}.toml"));
    let bar = format!("{}/bar.vtu", super::DATA);
    std::fs::write(&path, content.replace("BAR_FILE", &bar)).unwrap();
    path
}

fn simulate(scene: &Path, out: &Path, frames: u32, more: &[&str]) -> std::process::Output {
    let frames = frames.to_string();
    let given = [
        "simulate",
        text(scene),
        "--out",
        text(out),
        "--frames",
        &frames,
    ];
    palpate(&[&given, more].concat())
}

/// Returns the frames and the index in a folder, by name.
fn frames(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let wanted = |name: &str| [".vtu", ".png", ".pvd"].iter().any(|e| name.ends_with(e));
    let mut all: Vec<(String, Vec<u8>)> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| {
            (
                path.file_name().unwrap().to_string_lossy().into_owned(),
                path,
            )
        })
        .filter(|(name, _)| wanted(name) && !name.starts_with('.'))
        .map(|(name, path)| (name, std::fs::read(path).unwrap()))
        .collect();
    all.sort();
    all
}

fn assert_same(broken: &Path, whole: &Path, what: &str) {
    let (a, b) = (frames(broken), frames(whole));
    let names = |all: &[(String, Vec<u8>)]| all.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b), "{what}");
    for ((name, one), (_, other)) in a.iter().zip(&b) {
        assert!(one == other, "{what}: {name} differs");
    }
}

/// A deterministic random number generator (xorshift).
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % n
    }
}

/// Waits for `file`; returns whether it appeared before the child ended.
fn comes(file: &Path, child: &mut Child) -> bool {
    let patience = Instant::now();
    while !file.exists() {
        assert!(patience.elapsed() < Duration::from_secs(600), "{file:?}");
        if child.try_wait().unwrap().is_some() {
            return file.exists();
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    true
}

#[test]
#[ignore = "long: scripts/test --full"]
fn resume_after_kill_matches_uninterrupted_run() {
    const FRAMES: u32 = 14;
    let here = folder("resume_killed");
    let scene = scene(&here, "bar", BAR);
    let (whole, broken) = (here.join("whole"), here.join("broken"));
    let began = Instant::now();
    stdout(&simulate(&scene, &whole, FRAMES, &[]));
    let a_frame = began.elapsed().as_millis() as u64 / u64::from(FRAMES) + 1;
    let mut dice = Dice(20_051_130);
    let mut killed_running = 0;
    for kill in 0..5u32 {
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(["simulate", text(&scene), "--out", text(&broken)]);
        command.args(["--frames", &FRAMES.to_string(), "--resume"]);
        let mut child = command
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // At any moment of a frame, and at least a frame before the end, however fast it runs by then.
        let frame = 2 * u64::from(kill) + dice.below(2);
        let mark = broken.join(format!("bar_{frame:05}.vtu"));
        comes(&mark, &mut child);
        let (since, pause) = (
            Instant::now(),
            Duration::from_millis(dice.below(2 * a_frame)),
        );
        let too_late = broken.join(format!("bar_{:05}.vtu", frame + 3));
        while since.elapsed() < pause && !too_late.exists() {
            std::thread::sleep(Duration::from_millis(1));
        }
        killed_running += u32::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(killed_running >= 3, "only {killed_running} kills hit a run");
    stdout(&simulate(&scene, &broken, FRAMES, &["--resume"]));
    assert_same(&broken, &whole, "killed");
    // The cut has duplicated nodes: it is part of the restored state.
    let count = |i: u32| {
        let mesh = palpate::io::read(whole.join(format!("bar_{i:05}.vtu"))).unwrap();
        mesh.nodes.len()
    };
    assert!(count(FRAMES) > count(0));
}

/// A bar of elements with all features that only the CPU engine supports.
const LOADED: &str = r#"
[mesh]
generate = "bar"
tets = 80
[material]
model = "neo-hookean"
[camera]
eye = [0.06, -0.5, 0.2]
look_at = [0.06, 0.03, 0.0]
up = [0, 0, 1]
[solver]
name = "bdf2"
dt = 0.004
steps = 3
[[pin]]
axis = "x"
below = 0.1
[[move]]
name = "hand"
on = { axis = "x", above = 0.95 }
path = [[0.0, 0, 0, 0], [0.03, 0, 0, 0.01], [0.05, 0, 0.01, 0.01]]
[[pressure]]
normal = [0, 0, 1]
pressure = [[0.0, 0], [0.04, 900.0]]
[[muscle]]
tension = 1e4
activation = [[0.0, 0], [0.05, 1.0]]
[picture]
field = "von_mises"
size = [48, 36]
[output]
fields = ["von_mises", "J"]
reactions = "reactions.csv"
"#;

#[test]
fn resume_keeps_fields_and_reactions() {
    let here = folder("resume_loaded");
    let scene = scene(&here, "scene", LOADED);
    let (whole, broken) = (here.join("whole"), here.join("broken"));
    stdout(&simulate(&scene, &whole, 5, &[]));
    stdout(&simulate(&scene, &broken, 2, &[]));
    stdout(&simulate(&scene, &broken, 5, &["--resume"]));
    assert_same(&broken, &whole, "loaded");
    let table = |folder: &Path| std::fs::read_to_string(folder.join("reactions.csv")).unwrap();
    let all = table(&whole);
    assert_eq!(all, table(&broken));
    // A line for the pin and one for the grab, for six frames.
    assert_eq!(all.lines().count(), 1 + 2 * 6, "{all}");
    assert!(all.lines().skip(1).all(|line| line.split(',').count() == 9));
    let last = palpate::io::read(whole.join("scene_00005.vtu")).unwrap();
    let fields = ["von_mises", "J"].map(|name| last.field(name, palpate::mesh::Location::Cell));
    assert!(fields.iter().all(Option::is_some));
    // A missing table prevents resuming.
    std::fs::remove_file(broken.join("reactions.csv")).unwrap();
    let said = failure(&simulate(&scene, &broken, 6, &["--resume"]));
    assert!(said.contains("reactions.csv"), "{said}");
}

/// A run of 4 frames resumed to 9 equals one of 9.
fn goes_on(name: &str, content: &str) {
    let here = folder(&format!("resume_{name}"));
    let scene = scene(&here, "scene", content);
    let (whole, broken) = (here.join("whole"), here.join("broken"));
    stdout(&simulate(&scene, &whole, 9, &[]));
    stdout(&simulate(&scene, &broken, 4, &[]));
    let frame = |k: u32| std::fs::read(whole.join(format!("scene_{k:05}.vtu"))).unwrap();
    assert_ne!(frame(4), frame(9), "{name}: it moves");
    stdout(&simulate(&scene, &broken, 9, &["--resume"]));
    assert_same(&broken, &whole, name);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn resume_is_bitwise_identical_for_every_solver() {
    for name in [
        "explicit",
        "symplectic",
        "verlet",
        "velocity-verlet",
        "implicit",
    ] {
        let soft = "[material]\nyoung = 2e3\n[solver]";
        let content = BAR
            .replace("\"implicit\"", &format!("\"{name}\""))
            .replace("[solver]", soft)
            .replace("dt = 0.004", "dt = 0.0002")
            .replace("steps = 5", "steps = 60");
        goes_on(name, &content);
    }
}

#[test]
fn resume_is_bitwise_identical_for_grids() {
    goes_on("grid", GRID);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn resume_is_bitwise_identical_for_cages() {
    let without_cut = BAR.split("[[cut]]").next().unwrap();
    for (kind, solver) in [("lattice", "implicit"), ("grid", "verlet")] {
        let content = format!("{without_cut}\n[cage]\nnodes = 60\nkind = \"{kind}\"\n")
            .replace("\"implicit\"", &format!("\"{solver}\""))
            .replace("dt = 0.004", "dt = 0.0004");
        goes_on(&format!("cage_{kind}"), &content);
    }
}

#[test]
#[ignore = "long: scripts/test --full"]
fn resume_is_bitwise_identical_after_cut_under_skin() {
    let here = folder("resume_skin_source");
    let surface = here.join("skin.ply");
    let bar = palpate::generate::by_name("bar", Some(400)).unwrap();
    let faces = bar.boundary_surface(None).unwrap();
    palpate::io::write_surface(&surface, &faces).unwrap();
    for (name, content) in [("skin", BAR), ("grid_skin", GRID)] {
        let skin = format!("mode = \"skin\"\n[[skin]]\nfile = {:?}\n", text(&surface));
        goes_on(name, &format!("{content}{skin}"));
    }
}

#[test]
fn resume_rejects_checkpoints_of_other_runs() {
    let here = folder("resume_refused");
    let bar = scene(&here, "bar", BAR);
    let out = here.join("out");
    stdout(&simulate(&bar, &out, 2, &["--no-pictures"]));
    let kept = out.join("bar.checkpoint");
    let good = std::fs::read(&kept).unwrap();
    let refused = |words: &[&str], more: &[&str]| {
        let given = [&["--no-pictures", "--resume"], more].concat();
        let said = failure(&simulate(&bar, &out, 4, &given));
        assert!(said.contains("bar.checkpoint"), "{said}");
        for word in words {
            assert!(said.contains(word), "{word}: {said}");
        }
        assert!(said.contains("without --resume"), "{said}");
        assert!(!out.join("bar_00003.vtu").exists());
    };
    // A different scene: by a flag, by its text.
    refused(&["different scene"], &["--dt", "0.003"]);
    scene(
        &here,
        "bar",
        &BAR.replace("0.02, 0.02", "0.02, 0.021")
            .replace("below = 0.1", "below = 0.2"),
    );
    refused(&["different scene"], &[]);
    scene(&here, "bar", BAR);
    // Damaged: a bit in the middle, truncated, empty, other content.
    for place in [30, good.len() / 2, good.len() - 1] {
        let mut bad = good.clone();
        bad[place] ^= 4;
        std::fs::write(&kept, &bad).unwrap();
        refused(&[], &[]);
    }
    std::fs::write(&kept, &good[..good.len() / 2]).unwrap();
    refused(&["damaged"], &[]);
    std::fs::write(&kept, b"").unwrap();
    refused(&["not a checkpoint"], &[]);
    std::fs::write(&kept, b"palpate checkpoint 1 0.0.9\nxxxx").unwrap();
    refused(&["1 0.0.9"], &[]);
    // The file of a completed frame is missing.
    std::fs::write(&kept, &good).unwrap();
    std::fs::remove_file(out.join("bar_00001.vtu")).unwrap();
    let said = failure(&simulate(&bar, &out, 4, &["--no-pictures", "--resume"]));
    assert!(
        said.contains("bar_00001.vtu") && said.contains("missing"),
        "{said}"
    );
}

#[test]
fn altered_checkpoint_changes_the_result() {
    let here = folder("resume_doctored");
    let bar = scene(&here, "bar", BAR);
    let (whole, broken) = (here.join("whole"), here.join("broken"));
    let only_meshes = ["--no-pictures"];
    stdout(&simulate(&bar, &whole, 3, &only_meshes));
    stdout(&simulate(&bar, &broken, 1, &only_meshes));
    let kept = broken.join("bar.checkpoint");
    let mut bytes = std::fs::read(&kept).unwrap();
    let start = bytes.iter().position(|b| *b == b'\n').unwrap() + 5;
    // Within the positions, with a correct checksum.
    for byte in &mut bytes[start + 1000..start + 1016] {
        *byte ^= 4;
    }
    let mut crc = flate2::Crc::new();
    crc.update(&bytes[start..]);
    bytes[start - 4..start].copy_from_slice(&crc.sum().to_le_bytes());
    std::fs::write(&kept, &bytes).unwrap();
    let done = simulate(&bar, &broken, 3, &["--no-pictures", "--resume"]);
    let end = |folder: &Path| std::fs::read(folder.join("bar_00003.vtu")).ok();
    assert!(
        !done.status.success() || end(&broken) != end(&whole),
        "the alteration must change the result"
    );
}

#[test]
fn resume_without_checkpoint_starts_with_note() {
    let here = folder("resume_none");
    let bar = scene(&here, "bar", BAR);
    let out = here.join("out");
    let done = simulate(&bar, &out, 1, &["--no-pictures", "--resume"]);
    stdout(&done);
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(
        said.contains("no checkpoint") && said.contains("first frame"),
        "{said}"
    );
    assert!(out.join("bar_00001.vtu").exists());
    let played = palpate(&[
        "simulate",
        text(&out.join("bar.pvd")),
        "--out",
        text(&here),
        "--resume",
    ]);
    assert!(failure(&played).contains("requires a simulation"));
}

/// The state of rapier cannot be restored: such runs write no checkpoint, and a message states it.
#[cfg(feature = "rapier")]
#[test]
fn resume_rejects_rapier() {
    let here = folder("resume_rapier");
    let scene = here.join("bar.toml");
    let bar = "[mesh]\ngenerate = \"bar\"\ntets = 200\n[solver]\nname = \"implicit\"\nengine = \"rapier\"\n[picture]\nsize = [32, 24]\n";
    std::fs::write(&scene, bar).unwrap();
    let out = here.join("out");
    let run = |more: &[&str]| {
        let mut all = vec![
            "simulate",
            text(&scene),
            "--frames",
            "2",
            "--out",
            text(&out),
        ];
        all.extend(more);
        palpate(&all)
    };
    stdout(&run(&[]));
    assert!(out.join("bar_0002.png").exists() && !out.join("bar.checkpoint").exists());
    let told = failure(&run(&["--resume"]));
    assert!(told.contains("remove --resume"), "{told}");
}
