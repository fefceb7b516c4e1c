//! Regions with smooth boundaries in the pictures of scenes.

use crate::support::gpu;
use glam::DVec2;
use palpate::render::Image;
use palpate::scene::{Scene, Stage};

fn scene(picture: &str, more: &str) -> Scene {
    let text = format!(
        "[mesh]\ngenerate = \"breast\"\ntets = 6000\n{more}\n[picture]\nsize = [160, 120]\n{picture}"
    );
    Scene::parse(&text).unwrap()
}

fn difference(a: &Image, b: &Image) -> f64 {
    let sum: f64 = a
        .values
        .iter()
        .zip(&b.values)
        .map(|(a, b)| f64::from((a - b).abs()))
        .sum();
    sum / a.values.len() as f64
}

const LUMP: &str = "region.lump = { colour = \"blue\", opacity = 1.0 }\nregion.fat = { colour = \"wheat\", opacity = 0.1 }\nregion.gland = { colour = \"tomato\", opacity = 0.1 }\n";

#[test]
fn boundaries_are_smooth_unless_those_of_the_tets_are_wanted() {
    let mut smooth = Stage::new(&gpu(), &scene(LUMP, "")).unwrap();
    let by_tets = format!("boundaries = \"tets\"\n{LUMP}");
    let mut tets = Stage::new(&gpu(), &scene(&by_tets, "")).unwrap();
    let [a, b] = [&mut smooth, &mut tets].map(|stage| stage.image().unwrap());
    let apart = difference(&a, &b);
    assert!(apart > 1e-4 && apart < 0.05, "{apart}");
    // The boundary of the body is the same, and so are picks of its tets.
    for pixel in [[80.0, 60.0], [60.0, 70.0], [100.0, 64.0]] {
        let pixel = DVec2::from_array(pixel);
        let found = smooth.pick(pixel).unwrap();
        assert_eq!(found.is_some(), tets.pick(pixel).unwrap().is_some());
        assert_eq!(
            format!("{found:?}"),
            format!("{:?}", tets.pick(pixel).unwrap())
        );
    }
    // A change of the appearance changes the boundaries back.
    smooth.set_appearance(&scene(&by_tets, "")).unwrap();
    assert_eq!(smooth.image().unwrap(), b);
    let wrong = scene_error("boundaries = \"round\"\n");
    assert!(wrong.contains("smooth or tets"), "{wrong}");
}

fn scene_error(picture: &str) -> String {
    let text = format!("[mesh]\ngenerate = \"breast\"\n[picture]\n{picture}");
    Scene::parse(&text).unwrap_err().to_string()
}

#[test]
fn smooth_boundaries_follow_the_moving_body() {
    let moving = "[material]\nmodel = \"neo-hookean\"\nyoung = 3000\n[solver]\nname = \"implicit\"\ndt = 0.02\nsteps = 3\ngravity = [0.0, -40.0, 0.0]\n[[pin]]\naxis = \"z\"\nbelow = 0.1\n";
    let by_tets = format!("boundaries = \"tets\"\n{LUMP}");
    let mut smooth = Stage::new(&gpu(), &scene(LUMP, moving)).unwrap();
    let mut tets = Stage::new(&gpu(), &scene(&by_tets, moving)).unwrap();
    for stage in [&mut smooth, &mut tets] {
        *stage.camera_mut() = Stage::new(&gpu(), &scene(LUMP, ""))
            .unwrap()
            .camera_mut()
            .to_owned();
    }
    let rest = smooth.image().unwrap();
    for stage in [&mut smooth, &mut tets] {
        stage.run(3, &mut |_| {}).unwrap();
    }
    let a = smooth.image().unwrap();
    assert!(difference(&a, &rest) > 1e-2);
    // A stage that gets smooth boundaries when it has moved shows it where it is.
    tets.set_appearance(&scene(LUMP, moving)).unwrap();
    assert!(difference(&tets.image().unwrap(), &a) < 1e-3);
}
