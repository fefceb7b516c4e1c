//! `--film`, `--orbit` and `palpate presets`.

use crate::cli::*;

/// Returns the frames of a GIF, and its duration in hundredths of a second.
fn frames(path: &Path) -> (Vec<Vec<u8>>, u32) {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut read = options
        .read_info(std::fs::File::open(path).unwrap())
        .unwrap();
    let (mut frames, mut lasts) = (Vec::new(), 0);
    while let Some(frame) = read.read_next_frame().unwrap() {
        frames.push(frame.buffer.to_vec());
        lasts += u32::from(frame.delay);
    }
    (frames, lasts)
}

fn scene(folder: &Path) -> PathBuf {
    let scene = folder.join("bar.toml");
    let text = "[mesh]\ngenerate = \"bar\"\n[material]\nyoung = 2e4\n[solver]\nname = \"implicit\"\nsteps = 2\n[picture]\nsize = [64, 48]\nmode = \"surface\"\nbackground = \"black\"\n";
    std::fs::write(&scene, text).unwrap();
    scene
}

#[test]
fn film_orbits_static_body() {
    let folder = folder("turntable");
    let (film, mesh) = (folder.join("turn.gif"), format!("{DATA}/limb.vtu"));
    let arguments = [
        "render",
        &mesh,
        "--film",
        text(&film),
        "--frames",
        "6",
        "--size",
        "64x48",
        "--mode",
        "surface",
        "--fps",
        "10",
        "--background",
        "black",
    ];
    stdout(&palpate(&arguments));
    let (frames, lasts) = frames(&film);
    assert_eq!((frames.len(), lasts), (6, 60));
    for (i, frame) in frames.iter().enumerate() {
        let seen = frame.chunks(4).filter(|p| p[..3] != [0, 0, 0]).count();
        assert!(seen > 100, "{seen} pixels of frame {i}");
        assert!(
            i == 0 || frames[0] != *frame,
            "frame {i} is the first again"
        );
    }
}

#[test]
fn resumed_film_is_identical() {
    let folder = folder("film_resumed");
    let scene = scene(&folder);
    let run = |out: &str, film: &str, frames: &str, more: &[&str]| {
        let (out, film) = (folder.join(out), folder.join(film));
        let given = ["simulate", text(&scene), "--frames", frames];
        let outputs = ["--film", text(&film), "--out", text(&out)];
        let light = ["--mode", "composite", "--light", "path", "--spp", "2"];
        // A load and a view that are chosen depend on the number of frames.
        let fixed = [
            "--gravity=0,0,-9.81",
            "--eye=0.6,0.5,0.5",
            "--look-at=0.1,0,0",
        ];
        let found = palpate(&[&given[..], &outputs, &light, &fixed, more].concat());
        (film, found)
    };
    let (whole, found) = run("whole", "whole.gif", "4", &[]);
    stdout(&found);
    let (_, found) = run("broken", "broken.gif", "2", &[]);
    stdout(&found);
    let picture = folder.join("broken/bar_0001.png");
    let drawn = std::fs::metadata(&picture).unwrap().modified().unwrap();
    let (broken, found) = run("broken", "broken.gif", "4", &["--resume"]);
    stdout(&found);
    assert_eq!(frames(&whole).0.len(), 5);
    assert!(std::fs::read(whole).unwrap() == std::fs::read(broken).unwrap());
    let kept = std::fs::metadata(&picture).unwrap().modified().unwrap();
    assert_eq!(kept, drawn, "an earlier frame was drawn again");
    let (_, found) = run("broken", "c.gif", "5", &["--resume", "--no-pictures"]);
    assert!(failure(&found).contains("--no-pictures"));
}

#[test]
fn film_has_every_frame_of_simulation() {
    let folder = folder("film");
    let (scene, film, out) = (scene(&folder), folder.join("f.gif"), folder.join("out"));
    let run = [
        "simulate",
        text(&scene),
        "--frames",
        "3",
        "--film",
        text(&film),
        "--out",
        text(&out),
    ];
    stdout(&palpate(
        &[&run[..], &["--orbit", "180", "--no-meshes", "--time"]].concat(),
    ));
    let (frames, lasts) = frames(&film);
    assert_eq!((frames.len(), lasts), (4, 20));
    // The frames equal the pictures in the same folder.
    for (i, frame) in frames.iter().enumerate() {
        let picture = out.join(format!("bar_{i:04}.png"));
        let picture = image::open(picture).unwrap().to_rgba8();
        let off = frame
            .iter()
            .zip(picture.as_raw())
            .map(|(a, b)| a.abs_diff(*b));
        let mean = off.map(f64::from).sum::<f64>() / frame.len() as f64;
        assert!(
            mean < 2.0,
            "frame {i} is {mean} of 255 away from its picture"
        );
    }
    assert_ne!(frames[0], frames[3]);
}

#[test]
fn film_of_series_shows_its_times() {
    let folder = folder("film_series");
    let (scene, out) = (scene(&folder), folder.join("out"));
    stdout(&palpate(&[
        "simulate",
        text(&scene),
        "--frames",
        "2",
        "--no-pictures",
        "--out",
        text(&out),
    ]));
    let (series, film, played) = (
        out.join("bar.pvd"),
        folder.join("f.gif"),
        folder.join("played"),
    );
    let play = |more: &[&str]| {
        let play = [
            "simulate",
            text(&series),
            "--size",
            "64x48",
            "--out",
            text(&played),
            "--film",
            text(&film),
        ];
        stdout(&palpate(&[&play[..], more].concat()));
        frames(&film).0
    };
    let (plain, told) = (play(&[]), play(&["--time"]));
    assert_eq!((plain.len(), told.len()), (3, 3));
    let upper = |frame: &[u8]| frame[..4 * 64 * 16].to_vec();
    assert!(plain.iter().zip(&told).all(|(a, b)| upper(a) != upper(b)));
}

#[test]
fn film_rejects_invalid_output_before_the_run() {
    let folder = folder("film_errors");
    let (scene, out) = (scene(&folder), folder.join("out"));
    let simulate =
        |more: &[&str]| palpate(&[&["simulate", text(&scene), "--out", text(&out)], more].concat());
    let film = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let said = failure(&simulate(&["--film", &film("f.avi")]));
    assert!(said.contains(".gif or .mp4"), "{said}");
    let said = failure(&simulate(&["--film", &film("f.gif"), "--fps", "90"]));
    assert!(said.contains("0.01 to 50"), "{said}");
    let said = failure(&simulate(&["--no-pictures", "--no-meshes"]));
    assert!(said.contains("write a film"), "{said}");
    assert!(!out.exists());
    let both = simulate(&["--film", &film("f.gif"), "--orbit", "90", "--resume"]);
    assert_eq!(both.status.code(), Some(2));
    let said = failure(&palpate(&[
        "render",
        text(&scene),
        "--orbit",
        "90",
        "--out",
        &film("a.png"),
    ]));
    assert!(said.contains("--film"), "{said}");
    // A mesh without a solver: the message mentions the orbit.
    let mesh = format!("{DATA}/bar.vtu");
    let said = failure(&palpate(&["simulate", &mesh, "--out", text(&out)]));
    assert!(said.contains("film a static body"), "{said}");
    // Without ffmpeg.
    let nowhere = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["render", &mesh, "--size", "32x32", "--film", &film("f.mp4")])
        .env("PATH", &folder)
        .output();
    let said = failure(&nowhere.unwrap());
    assert!(said.contains("install"), "{said}");
    assert!(!folder.join("f.mp4").exists());
}

#[test]
fn presets_are_listed_and_rendered() {
    let names = stdout(&palpate(&["presets"]));
    let names: Vec<&str> = names.lines().collect();
    assert_eq!(names, palpate::render::TransferFunction::preset_names());
    assert!(names.contains(&"viridis") && names.contains(&"RdBu"));
    let sheet = folder("presets").join("sheet.png");
    stdout(&palpate(&["presets", "--out", text(&sheet)]));
    let sheet = image::open(&sheet).unwrap().to_rgb8();
    assert!(sheet.width() > 600 && sheet.height() > 300);
}

#[test]
fn annotation_flags_change_the_picture() {
    let folder = folder("around");
    let mesh = format!("{DATA}/limb.vtu");
    let draw = |name: &str, more: &[&str]| {
        let out = folder.join(name);
        let arguments = ["render", &mesh, "--size", "160x120", "--out", text(&out)];
        let output = palpate(&[&arguments[..], more].concat());
        let notes = String::from_utf8_lossy(&output.stderr).into_owned();
        stdout(&output);
        (out, notes)
    };
    let (plain, _) = draw("plain.png", &[]);
    let plain = std::fs::read(plain).unwrap();
    for (i, flags) in [
        &["--legend"][..],
        &["--scale-bar"],
        &["--axes"],
        &["--axes", "anatomical"],
        &["--title", "A limb"],
        &["--samples", "4"],
    ]
    .iter()
    .enumerate()
    {
        let (drawn, _) = draw(&format!("{i}.png"), flags);
        assert_ne!(std::fs::read(drawn).unwrap(), plain, "{flags:?}");
    }
    let (_, notes) = draw("values.exr", &["--title", "A limb"]);
    assert!(notes.contains("an EXR contains only the values"), "{notes}");
    let wrong = |flags: &[&str]| palpate(&[&["render", &mesh, "--out", "x.png"], flags].concat());
    assert_eq!(wrong(&["--axes", "polar"]).status.code(), Some(2));
    let said = failure(&wrong(&["--samples", "3"]));
    assert!(said.contains("1, 4, 9, 16"), "{said}");
    let said = failure(&wrong(&["--transfer", "virdis"]));
    assert!(said.contains("did you mean \"viridis\"?"), "{said}");
}
