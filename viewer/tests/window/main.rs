//! Tests of the window on a virtual screen (Xvfb), driven by real pointer and key events (xdotool).
//! Screenshots are compared with the golden images in `viewer/tests/golden`.
//!
//! `PALPATE_BLESS=1` rewrites the golden images; inspect them before committing.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, missing_docs)]

mod screen;

use glam::DVec3;
use palpate::generate::bar_of_about;
use palpate::io::PvdSeries;
use palpate::mesh::{Field, Location};
use palpate::render::{Image, ImageDifference};
use screen::Window;
use serde_json::Value;
use std::path::Path;

/// Minimum root mean square difference of images that must differ (range 0 to 1).
const OTHER: f64 = 0.02;
/// Frames that take longer, ms, are printed; ten times as long counts as a hang.
const SLOW: f64 = 250.0;
/// Number of rounds in the memory test.
const ROUNDS: usize = 4;

/// Left, right, upper and lower bounds of pixels that the section through a press covers.
const INSET: [usize; 4] = [520, 690, 560, 700];

/// Returns the mean of red, green and blue over part of `image`.
fn brightness(image: &Image, [left, right, top, bottom]: [usize; 4]) -> f32 {
    let width = image.size[0] as usize;
    let rows =
        (top..bottom).map(|y| &image.values[4 * (y * width + left)..4 * (y * width + right)]);
    let sum: f32 = rows
        .flat_map(|row| row.chunks(4))
        .map(|p| p[0] + p[1] + p[2])
        .sum();
    sum / (3 * (right - left) * (bottom - top)) as f32
}

fn apart(a: &Image, b: &Image) -> f64 {
    ImageDifference::between(a, b).unwrap().rmse
}

/// Opens, orbits, presses, pulls, cuts, edits colours, clips, undoes and saves.
#[test]
fn window_session_matches_goldens() {
    let mut window = Window::open(&["--example", "limb"]);
    let open = window.hold_against("open");

    // Orbit, then return to a standard view.
    window.key("1");
    window.hold([400, 400], [520, 340]);
    let orbited = window.last()["camera"].clone();
    window.let_go();
    window.key("a");
    window.rest();
    assert_ne!(window.last()["camera"], orbited);
    window.key("f");
    window.rest();
    let side = window.hold_against("side");
    assert!(apart(&open, &side) > OTHER);

    // A press reports force and depth, and ends on release.
    window.key("2");
    window.hold([400, 400], [400, 440]);
    let pressed = window.wait("a press", |frame| frame["force_n"].as_f64() > Some(1.0));
    assert!(pressed["depth_m"].as_f64().unwrap() > 1e-3, "{pressed}");
    window.rest();
    let at_depth = window.shot();
    assert!(apart(&side, &at_depth) > 0.005);
    // The section has a light background, unlike the picture behind it.
    assert!(brightness(&side, INSET) < 0.2);
    window.wait_for_pixels(|shot| brightness(shot, INSET) > 0.4);
    window.let_go();
    assert!(brightness(&window.shot(), INSET) < 0.2);
    assert_eq!(window.last()["force_n"], Value::Null);

    // A pull deforms the body.
    window.key("3");
    window.hold([240, 385], [250, 330]);
    window.rest();
    let pulled = window.shot();
    assert!(apart(&side, &pulled) > OTHER, "{}", apart(&side, &pulled));
    window.let_go();
    println!("difference after release: {}", apart(&side, &window.shot()));

    // A stroke cuts tets; a reset restores the uncut body.
    window.key("4");
    let status = |frame: &Value| frame["said"].as_str().unwrap_or_default().to_owned();
    window.hold([430, 385], [430, 470]);
    window.let_go();
    let cut = window.wait("a cut", |frame| status(frame).starts_with("cut;"));
    window.key("ctrl+r");
    window.rest();
    assert!(window.last()["tets"].as_u64() <= cut["tets"].as_u64());

    // Add a clip plane through the centre, then undo it.
    window.click([810, 449]);
    window.rest();
    let clipped = window.hold_against("clip");
    assert!(apart(&side, &clipped) > OTHER);
    window.key("ctrl+z");
    window.rest();
    assert!(apart(&window.hold_against("undone"), &clipped) > OTHER);

    // Drag a point of the transfer function down.
    window.hold([900, 120], [900, 215]);
    window.let_go();
    let clear = window.hold_against("clear");
    assert!(apart(&side, &clear) > OTHER);

    // A saved scene is valid and has the current camera.
    window.enter_path("ctrl+s", "saved.toml");
    let file = window.folder.path().join("saved.toml");
    window.wait("the scene", |_| file.is_file());
    let scene = palpate::scene::Scene::read(&file).unwrap();
    assert!(scene.picture.transfer.unwrap().contains("extinction"));
    let eye = window.last()["camera"][0].clone();
    let saved = scene.camera.eye.unwrap();
    for k in 0..3 {
        assert!(
            (saved[k] - eye[k].as_f64().unwrap()).abs() < 1e-9,
            "{saved:?} {eye}"
        );
    }
    window.enter_path("ctrl+p", "saved.png");
    let file = window.folder.path().join("saved.png");
    window.wait("the picture", |_| file.is_file());
    assert_eq!(Image::read_for_comparison(&file).unwrap().size, [1024, 768]);

    // A file that cannot be opened is reported, and the open document stays.
    window.enter_path("ctrl+l", "nothing.vtu");
    let frame = window.wait("the error", |frame| status(frame).contains("nothing.vtu"));
    assert!(frame["tets"].as_u64() > Some(0));
    check_for_hangs(&window);
}

/// Asserts that no frame blocked the interface or rendered more than one picture, and prints slow
/// frames. The time of a software driver is excluded.
fn check_for_hangs(window: &Window) {
    let ms = |frame: &Value, key: &str| frame[key].as_f64().unwrap();
    let mut pictures = 0;
    for frame in window.frames() {
        let before = std::mem::replace(&mut pictures, frame["pictures"].as_u64().unwrap());
        assert!(
            pictures <= before + 1,
            "more than one picture in a frame; {before} before {frame}"
        );
        let (own, driver) = (
            ms(&frame, "ui_ms") - ms(&frame, "driver_ms"),
            ms(&frame, "driver_ms"),
        );
        if own + driver > SLOW {
            println!(
                "slow frame: {own:.0} ms, driver {driver:.0} ms, at step {}: {}",
                frame["steps"], frame["said"]
            );
        }
        assert!(
            own < 10.0 * SLOW,
            "a frame blocked the interface for {own} ms: {frame}"
        );
    }
}

/// Plays a recorded series, steps through it and uses the slider; moves a plane by its handle and
/// undoes that.
#[test]
fn series_playback_and_plane_handle() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = bar_of_about(2000, DVec3::new(0.12, 0.06, 0.06)).unwrap();
    let mut series = PvdSeries::create(folder.path(), "bar").unwrap();
    for k in 0..6 {
        let bent = |p: &DVec3| *p + 3.0 * f64::from(k) * p.x * p.x * DVec3::Z;
        let nodes: Vec<DVec3> = mesh.nodes.iter().map(bent).collect();
        let heat = nodes.iter().map(|p| p.z).collect();
        let heat = Field::scalar("heat", Location::Node, heat);
        let time = 0.1 * f64::from(k);
        series.push_deformed(time, &mesh, &nodes, &[heat]).unwrap();
    }
    let mut window = Window::open(&[series.path().to_str().unwrap()]);
    let first = window.shot();
    let frame = |record: &Value| record["series_frame"].as_u64();
    assert_eq!(frame(&window.last()), Some(0));
    window.key("space");
    let end = window.wait("the end", |record| frame(record) == Some(5));
    assert!((end["time_s"].as_f64().unwrap() - 0.5).abs() < 1e-9);
    window.rest();
    assert_eq!(window.last()["playing"], false);
    assert!(apart(&first, &window.shot()) > OTHER);
    window.key("comma");
    window.wait("the frame before", |record| frame(record) == Some(4));
    window.hold([700, 731], [400, 731]);
    window.let_go();
    let middle = frame(&window.last());
    assert!((1..=3).contains(&middle.unwrap()), "{middle:?}");

    let plane = |record: &Value| -> Vec<f64> {
        let own = record["planes"][0].as_array().cloned().unwrap_or_default();
        own.iter().filter_map(Value::as_f64).collect()
    };
    window.click([810, 306]);
    let clip = plane(&window.wait("a clip", |record| plane(record).len() == 6));
    window.rest();
    let before = window.shot();
    // The handle is at the centre of the bounds over all frames; the nearer half fills more.
    window.hold([481, 290], [526, 329]);
    window.let_go();
    let moved = plane(&window.last());
    assert_eq!(moved[3..], clip[3..]);
    assert!(moved[..3] != clip[..3], "{moved:?}");
    assert!(apart(&before, &window.shot()) > 0.005);
    window.key("ctrl+z");
    window.wait("the undo", |record| plane(record) == clip);
}

/// Cancelling ends meshing, and the open document stays.
#[test]
fn cancel_stops_meshing() {
    let mut window = Window::open(&["--example", "limb"]);
    let scene = window.folder.path().join("large.toml");
    std::fs::write(&scene, "[mesh]\ngenerate = \"limb\"\ntets = 6000000\n").unwrap();
    window.enter_path("ctrl+l", "large.toml");
    // The interface stays responsive during meshing.
    for _ in 0..5 {
        let seen = window.last()["number"].as_u64();
        window.wait("another frame during meshing", |frame| {
            let works = frame["loading"] == "large.toml" && frame["reports"].as_u64() > Some(0);
            works && frame["number"].as_u64() > seen
        });
    }
    window.click([410, 432]);
    let cancelled = window.wait("the cancellation", |frame| frame["loading"].is_null());
    assert_eq!(cancelled["said"], "opening large.toml was cancelled");
    assert!(cancelled["tets"].as_u64().unwrap() < 20_000);
    window.wait("the end of its thread", |frame| frame["tasks"] == 0);
}

/// Each motion of the view is drawn, each deeper press steps and is drawn, and a pointer without a
/// button does neither: counted, so independent of the machine's speed.
#[test]
fn each_motion_is_drawn_and_each_press_steps() {
    let mut window = Window::open(&["--example", "limb"]);
    window.key("f");
    window.rest();
    // Pictures and steps from a motion of the pointer until the window rests.
    let counted = |window: &mut Window, at: [i32; 2]| {
        let count = |window: &Window| ["pictures", "steps"].map(|key| window.last()[key].as_u64());
        let before = count(window);
        window.to(at);
        window.rest();
        let after = count(window);
        [0, 1].map(|k| after[k].unwrap() - before[k].unwrap())
    };

    window.key("1");
    window.to([350, 400]);
    window.rest();
    assert_eq!(counted(&mut window, [390, 400]), [0, 0]);
    window.button(true);
    for n in 1..=4 {
        let [pictures, steps] = counted(&mut window, [390 + 10 * n, 400]);
        assert!(pictures >= 1 && steps == 0, "{n}: {pictures} {steps}");
    }
    window.let_go();

    window.key("f");
    window.key("2");
    window.to([400, 390]);
    window.rest();
    assert_eq!(counted(&mut window, [400, 400]), [0, 0]);
    window.button(true);
    window.rest();
    let mut depths = Vec::new();
    for n in 1..=4 {
        let [pictures, steps] = counted(&mut window, [400, 400 + 2 * n]);
        assert!(pictures >= 1 && steps >= 1, "{n}: {pictures} {steps}");
        depths.push(window.last()["depth_m"].as_f64().unwrap());
    }
    // The finger reaches each depth, which is proportional to the way of the pointer.
    for (n, depth) in (1..).zip(&depths) {
        let ratio = depth / depths[0] / f64::from(n);
        assert!((ratio - 1.0).abs() < 1e-9, "{depths:?}");
    }
    window.let_go();
}

/// The force of a finger that rests has its error; that of one that moves has none yet.
#[test]
fn resting_press_has_an_error() {
    let mut window = Window::open(&["--example", "limb"]);
    let scene = window.folder.path().join("block.toml");
    let text = "[mesh]\ngenerate = \"bar\"\ntets = 6000\n[material]\nmodel = \"neo-hookean\"\n";
    std::fs::write(&scene, text).unwrap();
    window.enter_path("ctrl+l", "block.toml");
    window.wait("the block", |frame| {
        frame["name"] == "block.toml" && frame["loading"].is_null()
    });
    window.rest();
    window.key("2");
    window.hold([410, 371], [410, 391]);
    let error = |frame: &Value| frame["force_error_n"].as_f64();
    let rested = window.wait("the error", |frame| error(frame).is_some());
    let force = rested["force_n"].as_f64().unwrap();
    let found = error(&rested).unwrap();
    assert!(
        found > 1e-3 * force && found < 3.0 * force,
        "{found} of {force}"
    );
    window.to([410, 394]);
    let is_deeper = |frame: &Value| frame["depth_m"].as_f64() > rested["depth_m"].as_f64();
    window.wait("its error", |frame| {
        is_deeper(frame) && frame["force_error_is_estimated"] == true
    });
    // Until then it has the same error relative to the force.
    let moved = window.logged(is_deeper).unwrap();
    assert_eq!(moved["force_error_is_estimated"], false);
    let expected = found / force * moved["force_n"].as_f64().unwrap();
    assert!((error(&moved).unwrap() / expected - 1.0).abs() < 1e-9);
    // While it rests, the mesh is refined in the background: the force settles, its error shrinks.
    let refined = window.wait("the force on a finer mesh", |frame| {
        let bar = frame["refined_force_n"][1].as_f64();
        bar.zip(error(frame))
            .is_some_and(|(bar, first)| 3.0 * bar < first)
    });
    let own = refined["force_n"].as_f64().unwrap();
    let [force, bar] = [0, 1].map(|k| refined["refined_force_n"][k].as_f64().unwrap());
    let coarse = error(&refined).unwrap();
    assert!(
        force < own && own - force < coarse + bar,
        "{own} ± {coarse}, {force} ± {bar}"
    );
    window.let_go();
    window.wait("the end of the press", |frame| error(frame).is_none());
}

/// Adds a skin and undoes that.
#[test]
fn added_skin_is_shown_and_undone() {
    let mut window = Window::open(&["--example", "limb"]);
    let bare = window.shot();
    window.click([819, 495]);
    window.rest();
    window.click([809, 551]);
    window.rest();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/limb_10k.vtu");
    window.xdotool(&["type", "--delay", "5", file.to_str().unwrap()]);
    window.key("Return");
    let said = |frame: &Value| frame["said"].as_str().unwrap_or_default().to_owned();
    window.wait("the skin", |frame| {
        said(frame).contains("skin limb_10k.vtu")
    });
    window.rest();
    let worn = window.shot();
    assert!(apart(&bare, &worn) > OTHER, "{}", apart(&bare, &worn));
    window.key("ctrl+z");
    window.rest();
    assert!(apart(&worn, &window.shot()) > OTHER);
}

/// After the first round, orbiting and pressing neither allocate on the device nor read back from
/// it, and need no more memory.
#[test]
fn repeated_use_does_not_grow_memory() {
    // Estimates of errors allocate, or not, depending on whether they end before the finger moves.
    let mut window = Window::open(&["--example", "breast", "--no-error"]);
    let (mut host, mut counts, mut device) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        window.key("1");
        window.hold([300, 300], [500, 320]);
        window.let_go();
        window.key("f");
        window.key("2");
        window.hold([410, 390], [410, 420]);
        // Each round also renders the finger at full resolution.
        window.rest();
        window.let_go();
        let last = window.last();
        host.push(last["memory_mb"].as_f64().unwrap());
        counts.push(["bytes_allocated", "readbacks"].map(|key| last[key].as_u64().unwrap()));
        device.push(window.device_memory());
    }
    println!("{host:.0?} MB; bytes allocated and readbacks: {counts:?}");
    println!("live allocations on the device and their bytes: {device:?}");
    let half = ROUNDS / 2;
    assert!(
        counts[1..].iter().all(|count| *count == counts[1]),
        "{counts:?}"
    );
    // A round renders dozens of pictures of a megabyte each, so a leak exceeds this limit.
    if let (Some([early, early_bytes]), Some([late, late_bytes])) =
        (device[half], device[ROUNDS - 1])
    {
        let grows = late > early + 16 || late_bytes > early_bytes + 4_000_000;
        assert!(!grows, "{device:?}");
    }
    // Ten times the variation between rounds.
    let (early, late) = (host[half], host[ROUNDS - 1]);
    assert!(
        late < early + 200.0,
        "memory grows from {early} MB to {late} MB"
    );
    check_for_hangs(&window);
}
