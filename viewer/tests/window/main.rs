//! The window itself, on a screen of its own (Xvfb), by real events of pointer and keys (xdotool): each
//! step's screenshot is held against a golden in `viewer/tests/golden`.
//!
//! `PALPATE_BLESS=1` writes the goldens anew; look at them before committing.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, missing_docs)]

mod pace;
mod screen;

use palpate::render::{Difference, Image};
use screen::Window;
use serde_json::Value;
use std::time::{Duration, Instant};

/// Root mean square difference of what is not alike, of 1, at least.
const OTHER: f64 = 0.02;
/// The interface is never busy for longer, ms.
const STALL: f64 = 250.0;

fn apart(a: &Image, b: &Image) -> f64 {
    Difference::between(a, b).unwrap().rmse
}

/// Opens, goes round, presses, pulls, cuts, edits colours, clips, undoes and saves.
#[test]
fn a_session_in_the_window() {
    let mut window = Window::open(&["--example", "limb"]);
    let open = window.hold_against("open");

    // Round it and back to a side of it.
    window.key("1");
    window.hold([400, 400], [520, 340]);
    let went = window.last()["camera"].clone();
    window.let_go();
    window.key("a");
    window.rest();
    assert_ne!(window.last()["camera"], went);
    window.key("f");
    window.rest();
    let side = window.hold_against("side");
    assert!(apart(&open, &side) > OTHER);

    // A press resists more the deeper it goes, and is gone when it is let go.
    window.key("2");
    window.hold([400, 400], [400, 440]);
    let pressed = window.wait("a press", |frame| frame["force_n"].as_f64() > Some(1.0));
    assert!(pressed["depth_m"].as_f64().unwrap() > 1e-3, "{pressed}");
    window.rest();
    let at_depth = window.shot();
    assert!(apart(&side, &at_depth) > 0.005);
    window.let_go();
    assert_eq!(window.last()["force_n"], Value::Null);

    // A pull moves the body, and it comes back.
    window.key("3");
    window.hold([240, 385], [250, 330]);
    window.rest();
    let pulled = window.shot();
    assert!(apart(&side, &pulled) > OTHER, "{}", apart(&side, &pulled));
    window.let_go();
    println!("let go: {}", apart(&side, &window.shot()));

    // A stroke parts tets; the body begins anew whole.
    window.key("4");
    let nodes = |said: &Value| said["said"].as_str().unwrap_or_default().to_owned();
    window.hold([430, 385], [430, 470]);
    window.let_go();
    let cut = window.wait("a cut", |frame| nodes(frame).starts_with("cut;"));
    window.key("ctrl+r");
    window.rest();
    assert!(window.last()["tets"].as_u64() <= cut["tets"].as_u64());

    // A clip, at the middle; undone it is gone.
    window.click([810, 449]);
    window.rest();
    let clipped = window.hold_against("clip");
    assert!(apart(&side, &clipped) > OTHER);
    window.key("ctrl+z");
    window.rest();
    assert!(apart(&window.hold_against("undone"), &clipped) > OTHER);

    // A point of the transfer function dragged down.
    window.hold([900, 120], [900, 215]);
    window.let_go();
    let clear = window.hold_against("clear");
    assert!(apart(&side, &clear) > OTHER);

    // Saved, the scene is one that can be read, seen from here.
    window.key("ctrl+s");
    window.key("ctrl+a");
    window.xdotool(&["type", "--delay", "20", "saved.toml"]);
    window.key("Return");
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
    window.key("ctrl+p");
    window.key("ctrl+a");
    window.xdotool(&["type", "--delay", "20", "saved.png"]);
    window.key("Return");
    let file = window.folder.path().join("saved.png");
    window.wait("the picture", |_| file.is_file());
    assert_eq!(Image::open(&file).unwrap().size, [1024, 768]);

    // What cannot be opened is said, and what was open stays.
    window.key("ctrl+l");
    window.xdotool(&["type", "--delay", "20", "nothing.vtu"]);
    window.key("Return");
    let said = window.wait("the error", |frame| nodes(frame).contains("nothing.vtu"));
    assert!(said["tets"].as_u64() > Some(0));

    no_stall(&window);
}

/// Holds that the interface was busy for no longer than [`STALL`] at a time. What a software driver
/// takes to draw is not the interface's.
fn no_stall(window: &Window) {
    let frames = window.frames();
    let took = frames.iter().filter_map(|f| f["ui_ms"].as_f64());
    let slowest = took.fold(0.0, f64::max);
    println!(
        "{} frames, the interface busy for {slowest:.0} ms at most",
        frames.len()
    );
    assert!(slowest < STALL, "{slowest} ms");
}

/// Looked at and pressed on for a while, it needs no more memory than at first.
#[test]
fn memory_does_not_grow() {
    let mut window = Window::open(&["--example", "breast"]);
    let memory = |window: &Window| window.last()["memory_mb"].as_f64().unwrap();
    let mut seen = Vec::new();
    let since = Instant::now();
    while since.elapsed() < Duration::from_secs(120) {
        window.key("1");
        window.hold([300, 300], [500, 320]);
        window.let_go();
        window.key("f");
        window.key("2");
        window.hold([410, 390], [410, 420]);
        window.let_go();
        seen.push(memory(&window));
    }
    no_stall(&window);
    println!("{seen:.0?} MB");
    let (early, late) = (seen[seen.len() / 4], seen[seen.len() - 1]);
    assert!(late < 1.1 * early + 20.0, "{early} MB, later {late} MB");
}
