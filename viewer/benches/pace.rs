//! Frame rate and latency of the window during orbiting and pressing. It needs Xvfb and xdotool, which
//! `scripts/test viewer` installs:
//!
//!     cargo bench --profile dev -p palpate-view --bench pace
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, missing_docs)]

// Its checks of pictures are for the tests.
#[allow(dead_code)]
#[path = "../tests/window/screen.rs"]
mod screen;

use screen::Window;
use serde_json::Value;
use std::fmt::Write;
use std::time::{Duration, Instant};

/// Pointer motions per second.
const EVENTS: usize = 60;
/// Duration of a measurement, s, and number of repetitions.
const SECONDS: usize = 5;
const TURNS: usize = 3;
/// Number of latency measurements.
const PRESSES: i32 = 12;
/// Target pictures per second.
const ORBIT: f64 = 25.0;
const PRESS: f64 = 15.0;

/// Rates and times of one measurement.
struct Pace {
    pictures: f64,
    steps: f64,
    frames: f64,
    stall: f64,
    latency: f64,
}

/// Moves the pointer along `path` for the duration of a measurement.
fn pace(window: &Window, path: impl Fn(f64) -> [f64; 2]) -> Pace {
    let begun = window.frames().len();
    let count = EVENTS * SECONDS;
    let mut script = String::new();
    for n in 0..count {
        let [x, y] = path(n as f64 / count as f64).map(f64::round);
        let _ = writeln!(script, "mousemove {x} {y} sleep {}", 1.0 / EVENTS as f64);
    }
    let words: Vec<&str> = script.split_whitespace().collect();
    let since = Instant::now();
    window.xdotool(&words);
    let took = since.elapsed().as_secs_f64();
    let frames = window.frames();
    let all = &frames[begun..];
    let number = |frame: &Value, key: &str| frame[key].as_f64().unwrap_or(0.0);
    let (first, last) = (&all[0], &all[all.len() - 1]);
    let grown = |key| (number(last, key) - number(first, key)) / took;
    let mut latency: Vec<f64> = all.iter().map(|f| number(f, "latency_ms")).collect();
    latency.sort_by(f64::total_cmp);
    let busy = all
        .iter()
        .map(|f| number(f, "ui_ms") + number(f, "paint_ms"));
    Pace {
        pictures: grown("pictures"),
        steps: grown("steps"),
        frames: all.len() as f64 / took,
        stall: busy.fold(0.0, f64::max),
        latency: latency[latency.len() / 2],
    }
}

/// Prints measurements. Returns the best pictures per second.
fn report_best(name: &str, paces: &[Pace]) -> f64 {
    for pace in paces {
        println!(
            "{name}: {:.1} pictures/s, {:.1} steps/s, {:.1} frames/s, latency {:.0} ms, longest frame {:.0} ms",
            pace.pictures, pace.steps, pace.frames, pace.latency, pace.stall
        );
    }
    paces.iter().map(|p| p.pictures).fold(0.0, f64::max)
}

/// Returns the time from a pointer motion to a changed picture on the screen, ms.
fn latency(window: &mut Window, n: i32) -> f64 {
    window.rest();
    let before = window.shot();
    let since = Instant::now();
    window.xdotool(&["mousemove", "400", &(410 + 3 * n).to_string()]);
    // The central part of the picture, without the overlays.
    let middle = |image: &palpate::render::Image| {
        let width = image.size[0] as usize;
        let rows = (300..600).flat_map(|y| y * width + 250..y * width + 560);
        rows.map(|p| image.values[4 * p + 1]).collect::<Vec<f32>>()
    };
    let before = middle(&before);
    while middle(&window.pixels()) == before {
        assert!(
            since.elapsed() < Duration::from_secs(600),
            "the picture did not change within 600 s"
        );
        std::thread::sleep(Duration::from_millis(2));
    }
    1e3 * since.elapsed().as_secs_f64()
}

/// Measures orbiting and pressing.
fn main() {
    let mut window = Window::open(&["--example", "limb"]);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap();
    println!("load before: {}", load.trim());
    window.key("f");
    window.key("1");
    let round = |share: f64| {
        let angle = std::f64::consts::TAU * 2.0 * share;
        [
            350.0 + 120.0 * angle.sin(),
            400.0 + 40.0 * (2.0 * angle).sin(),
        ]
    };
    let mut orbits = Vec::new();
    for _ in 0..TURNS {
        window.to([350, 400]);
        window.button(true);
        orbits.push(pace(&window, round));
        window.let_go();
    }
    window.key("a");
    window.rest();
    window.key("f");
    window.rest();
    window.key("2");
    let deeper = |share: f64| [400.0, 400.0 + 60.0 * (std::f64::consts::PI * share).sin()];
    let mut presses = Vec::new();
    for _ in 0..TURNS {
        window.to([400, 400]);
        window.button(true);
        presses.push(pace(&window, deeper));
        window.let_go();
    }
    window.hold([400, 400], [400, 410]);
    let mut late: Vec<f64> = (1..=PRESSES).map(|n| latency(&mut window, n)).collect();
    window.let_go();
    late.sort_by(f64::total_cmp);
    let orbit = report_best("orbiting", &orbits);
    let press = report_best("pressing", &presses);
    println!(
        "latency from pointer to picture on the screen: {:.0} ms (median), {:.0} to {:.0}",
        late[late.len() / 2],
        late[0],
        late[late.len() - 1]
    );
    println!(
        "best: orbiting {orbit:.1} (target {ORBIT}), pressing {press:.1} (target {PRESS}) pictures/s"
    );
}
