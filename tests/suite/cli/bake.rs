//! `palpate bake`.

use crate::cli::{DATA, failure, folder, palpate, stdout, text};
use std::fmt::Write;
use std::path::Path;

/// Writes a sphere of `rings` rings as an OBJ, its radius a function of height and angle, with
/// texture coordinates on request.
pub fn sphere(path: &Path, rings: usize, uvs: bool, radius: impl Fn(f64, f64) -> f64) {
    let around = 2 * rings;
    let mut obj = String::new();
    for r in 0..=rings {
        let tilt = std::f64::consts::PI * r as f64 / rings as f64;
        for k in 0..=around {
            let turn = std::f64::consts::TAU * k as f64 / around as f64;
            let far = radius(tilt, turn);
            let ring = far * tilt.sin();
            let [x, y, z] = [ring * turn.cos(), ring * turn.sin(), far * tilt.cos()];
            writeln!(obj, "v {x:.6} {y:.6} {z:.6}").unwrap();
            let [u, v] = [k as f64 / around as f64, 1.0 - r as f64 / rings as f64];
            writeln!(obj, "vt {u:.6} {v:.6}").unwrap();
        }
    }
    let corner = |r: usize, k: usize| {
        let i = r * (around + 1) + k + 1;
        if uvs {
            format!("{i}/{i}")
        } else {
            format!("{i}")
        }
    };
    for (r, k) in (0..rings).flat_map(|r| (0..around).map(move |k| (r, k))) {
        let [a, b, c, d] = [
            corner(r, k),
            corner(r + 1, k),
            corner(r + 1, k + 1),
            corner(r, k + 1),
        ];
        if r + 1 < rings {
            writeln!(obj, "f {a} {b} {c}").unwrap();
        }
        if r > 0 {
            writeln!(obj, "f {a} {c} {d}").unwrap();
        }
    }
    std::fs::write(path, obj).unwrap();
}

#[test]
fn bake_writes_normal_map_of_fine_surface() {
    let folder = folder("bake");
    let file = |name: &str| folder.join(name);
    let (coarse, fine, round) = (file("coarse.obj"), file("fine.obj"), file("round.obj"));
    sphere(&coarse, 20, true, |_, _| 1.0);
    sphere(&round, 80, false, |_, _| 1.0);
    // Waves along the angle alone: normals lean along the tangent, red, and never up or down.
    sphere(&fine, 80, false, |_, turn| 1.0 + 0.01 * (12.0 * turn).sin());
    let bake = |fine: &Path, out: &Path| {
        let report = file("bake.json");
        stdout(&palpate(&[
            "bake",
            text(&coarse),
            text(fine),
            "--out",
            text(out),
            "--size",
            "240x120",
            "--report",
            text(&report),
        ]));
        let report: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
        let covered = report["covered"].as_u64().unwrap();
        assert!(covered > 240 * 110, "{report}");
        image::open(out).unwrap().to_rgb8()
    };
    let map = bake(&fine, &file("waves.png"));
    assert_eq!(map.dimensions(), (240, 120));
    // At the equator the slope is 0.01 · 12 cos(12 angle): the normal leans in the opposite
    // direction.
    let mut worst: f64 = 0.0;
    for x in 0..240 {
        let turn = std::f64::consts::TAU * (f64::from(x) + 0.5) / 240.0;
        let slope = 0.12 * (12.0 * turn).cos() / (1.0 + 0.01 * (12.0 * turn).sin());
        let red = -slope / (1.0 + slope * slope).sqrt();
        let [r, g, b] = map
            .get_pixel(x, 60)
            .0
            .map(|c| (f64::from(c) - 128.0) / 127.0);
        worst = worst.max((r - red).abs());
        assert!(g.abs() < 0.03 && b > 0.95, "{x}: {r} {g} {b}");
    }
    println!("worst {worst}");
    assert!(worst < 0.04, "{worst}");
    // The normal map of a round sphere is flat.
    let flat = bake(&round, &file("flat.png"));
    let lean = |p: &image::Rgb<u8>| p.0[0].abs_diff(128).max(p.0[1].abs_diff(128));
    let row = (0..240).map(|x| lean(flat.get_pixel(x, 60)));
    assert!(row.max().unwrap() <= 2);
}

#[test]
fn bake_rejects_invalid_input() {
    let folder = folder("bake_wrong");
    let file = |name: &str| folder.join(name);
    let (mapped, bare, out) = (file("mapped.obj"), file("bare.obj"), file("normals.png"));
    sphere(&mapped, 6, true, |_, _| 1.0);
    sphere(&bare, 6, false, |_, _| 1.0);
    let tets = format!("{DATA}/ball.vtu");
    let (mapped, bare, png) = (text(&mapped), text(&bare), text(&out));
    let jpg = file("normals.jpg");
    for (coarse, fine, out, size, part) in [
        (bare, mapped, png, "8x8", "no texture coordinates"),
        (bare, mapped, png, "8x8", "bare.obj"),
        (mapped, bare, text(&jpg), "8x8", "normals.jpg"),
        (mapped, bare, png, "9999x8", "9999 x 8"),
        (mapped, tets.as_str(), png, "8x8", "is not a surface"),
        (mapped, "/no/such/fine.stl", png, "8x8", "/no/such/fine.stl"),
    ] {
        let errors = failure(&palpate(&[
            "bake", coarse, fine, "--out", out, "--size", size,
        ]));
        assert!(errors.contains(part), "{errors}");
    }
    assert!(!out.exists());
    let wrong = palpate(&["bake", mapped, bare, "--out", png, "--size", "0x8"]);
    assert_eq!(wrong.status.code(), Some(2));
}
