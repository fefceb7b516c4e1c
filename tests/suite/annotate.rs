//! Annotations of pictures: in scenes, as pixels, and parts that they must leave unchanged.

use crate::support::gpu;
use palpate::annotate::{Annotations, Axes, BarColours, Legend, ScaleBar};
use palpate::glam::DVec3;
use palpate::render::{Background, Camera, Image};
use palpate::scene::{Scene, Stage};

const LIMB: &str = "[mesh]\ngenerate = \"limb\"\ntets = 3000\n";

/// Returns the stage of a scene of a small limb with a picture of `size` pixels and the entries
/// `picture`.
fn stage(size: [u32; 2], picture: &str) -> Stage {
    let [width, height] = size;
    let scene = format!("{LIMB}[picture]\nsize = [{width}, {height}]\n{picture}");
    let scene = Scene::parse(&scene).unwrap_or_else(|e| panic!("{e}"));
    Stage::new(&gpu(), &scene).unwrap_or_else(|e| panic!("{e}"))
}

fn empty(size: [u32; 2]) -> Image {
    Image {
        size,
        channels: 4,
        values: vec![0.0; 4 * size[0] as usize * size[1] as usize],
    }
}

#[test]
fn scale_bar_pixel_length_matches_label() {
    let eye = DVec3::new(1.0, 2.0, 30.0);
    let size = [640, 480];
    for (height, unit, words, length) in [
        (97.0, 1e-3, "20 mm", 20.0),
        (1.37, 1.0, "20 cm", 0.2),
        (1.37, 1e-6, "200 nm", 0.2),
    ] {
        let camera = Camera::orthographic(eye, DVec3::ZERO, DVec3::Y, height);
        let bar = ScaleBar {
            length_unit: Some(unit),
        };
        let (pixels, label) = bar.measure(&camera, size);
        assert_eq!(label, words);
        let expected = length * 480.0 / height;
        assert!((pixels - expected).abs() < 1e-9 * expected);
        let mut image = empty(size);
        let annotations = Annotations {
            scale_bar: Some(bar),
            ..Annotations::default()
        };
        annotations
            .draw(&mut image, &camera, Background::Black)
            .unwrap();
        // The longest row of light pixels is the scale bar's; its first pixel may be partly
        // covered.
        let ink = image.values.iter().copied().step_by(4).fold(0.0, f32::max);
        let light = |y: u32| -> f32 { (0..size[0]).map(|x| image.pixel(x, y)[0] / ink).sum() };
        let drawn = (0..size[1]).map(light).fold(0.0, f32::max);
        assert!(
            (f64::from(drawn) - expected).abs() < 0.1,
            "{drawn} {expected}"
        );
    }
}

#[test]
fn supersampled_image_equals_downsampled_larger_image() {
    for mode in ["composite", "surface"] {
        let picture = |samples: u32| format!("mode = \"{mode}\"\nsamples = {samples}\n");
        let fine = stage([126, 84], &picture(1)).image().unwrap();
        let drawn = stage([42, 28], &picture(9)).image().unwrap();
        let expected = fine.box_downsampled(3);
        assert_eq!(drawn.size, expected.size);
        let largest = expected.values.iter().copied().fold(0.0, f32::max);
        let off = drawn.values.iter().zip(&expected.values);
        let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest > 0.0 && off <= 1e-5 * largest, "{mode}: {off}");
        let plain = stage([42, 28], &picture(1)).image().unwrap();
        assert_ne!(plain, drawn, "{mode}");
    }
}

#[test]
fn legend_shows_region_names_and_colours() {
    let stage = stage([160, 120], "legend = true\n");
    let Some(Legend::Regions { name, regions }) = stage.annotations().legend else {
        panic!("{:?}", stage.annotations().legend);
    };
    assert_eq!(name, "label");
    let names: Vec<&str> = regions.iter().map(|r| r.name.as_str()).collect();
    let known: Vec<&str> = stage
        .mesh()
        .region_names
        .values()
        .map(String::as_str)
        .collect();
    assert_eq!(names, known);
    // The note of the scene states the same colours.
    let note = stage.scalar_field().note.clone().unwrap();
    for region in &regions {
        let [r, g, b] = region.colour.map(|c| (255.0 * c).round() as u8);
        let words = format!("{} (#{r:02x}{g:02x}{b:02x})", region.name);
        assert!(note.contains(&words), "{words}: {note}");
    }
}

#[test]
fn legend_lists_regions_visible_in_transfer_function() {
    let transfer = r#"transfer = '{"colour": [[1, 1, 0, 0], [2, 0, 1, 0], [9, 0, 1, 0]], "extinction": [[1, 0], [1.5, 0], [1.5, 9]]}'"#;
    let stage = stage(
        [64, 48],
        &format!("field = \"label\"\nlegend = true\n{transfer}\n"),
    );
    let Some(Legend::Regions { regions, .. }) = stage.annotations().legend else {
        panic!("{:?}", stage.annotations().legend);
    };
    assert_eq!(regions.len(), stage.mesh().region_names.len() - 1);
    assert!(regions.iter().all(|r| r.colour == [0.0, 1.0, 0.0]));
}

#[test]
fn colour_bar_matches_displayed_scalar() {
    let bar = |picture: &str| {
        let stage = stage(
            [64, 48],
            &format!("legend = true\nfield = \"intensity\"\n{picture}"),
        );
        match stage.annotations().legend {
            Some(Legend::Bar(bar)) => bar,
            other => panic!("{other:?}"),
        }
    };
    let inside = bar("range = [-100, 900]\ntransfer = \"viridis\"\n");
    assert_eq!(inside.range, (-100.0, 900.0));
    let BarColours::Transfer {
        transfer,
        path_length,
    } = inside.colours
    else {
        panic!("{:?}", inside.colours);
    };
    assert_eq!(
        transfer.colour(-100.0).map(|c| (255.0 * c).round()),
        [68.0, 1.0, 84.0]
    );
    assert!(path_length.is_some());
    assert_eq!(bar("mode = \"mip\"\n").colours, BarColours::Grey);
    let surface = bar("mode = \"surface\"\n").colours;
    assert!(matches!(
        surface,
        BarColours::Transfer {
            path_length: None,
            ..
        }
    ));
    let plain = stage([64, 48], "mode = \"surface\"\nlegend = true\n");
    assert!(plain.annotations().legend.is_none());
    assert!(plain.notes().iter().any(|n| n.contains("one colour")));
}

#[test]
fn annotations_change_png_only() {
    let folder = tempfile::tempdir().unwrap();
    // An automatic view leaves room for the legend.
    let view = "background = \"white\"\n[camera]\neye = [-0.12, -0.45, 0.45]\nlook_at = [0.165, 0.005, 0.0]\nup = [0, 0, 1]\nfov = 22\n";
    let around = "legend = true\nscale_bar = true\naxes = true\ntitle = \"A limb\"\n";
    let mut plain = stage([320, 240], view);
    let mut around = stage([320, 240], &format!("{around}{view}"));
    assert!(plain.image().unwrap() == around.image().unwrap());
    let saved = |stage: &mut Stage, name: &str| {
        let path = folder.path().join(name);
        stage.save(&path).unwrap();
        image::open(&path).unwrap().to_rgba32f()
    };
    let [a, b] = [saved(&mut plain, "a.exr"), saved(&mut around, "b.exr")];
    assert!(a == b, "an EXR contains only the values");
    assert!(around.annotation_note("b.exr").is_some());
    assert!(around.annotation_note("b.png").is_none());
    let [a, b] = [saved(&mut plain, "a.png"), saved(&mut around, "b.png")];
    let differ = |left: u32, top: u32, right: u32, low: u32| {
        let pixels = (top..low).flat_map(|y| (left..right).map(move |x| (x, y)));
        pixels
            .filter(|(x, y)| a.get_pixel(*x, *y) != b.get_pixel(*x, *y))
            .count()
    };
    assert!(differ(130, 0, 190, 24) > 40, "the title");
    assert!(differ(220, 40, 320, 200) > 200, "the legend");
    assert!(differ(0, 180, 70, 240) > 60, "the axes");
    assert!(differ(230, 215, 320, 240) > 60, "the scale bar");
    assert_eq!(differ(80, 40, 200, 200), 0, "the middle");
}

#[test]
fn automatic_view_leaves_room_for_legend() {
    let opaque = |picture: &str| {
        let image = stage([160, 100], picture).image().unwrap();
        let columns = (0..160).filter(|x| (0..100).any(|y| image.pixel(*x, y)[3] > 0.0));
        columns.max().unwrap()
    };
    let (without, with) = (opaque(""), opaque("legend = true\n"));
    assert!(without > 140 && with < 130, "{without} {with}");
}

#[test]
fn thickness_legend_is_grey() {
    let mut thick = stage([200, 150], "mode = \"thickness\"\nlegend = true\n");
    assert!(thick.notes().iter().any(|n| n.contains("EXR")));
    let raw = thick.image().unwrap();
    let image = thick.render_annotated().unwrap();
    let longest = raw.values.iter().copied().fold(0.0, f32::max);
    let [x, y] = [90, 75];
    let grey = raw.pixel(x, y)[0] / longest;
    assert!(grey > 0.0);
    assert_eq!(image.pixel(x, y), [grey, grey, grey, 1.0]);
}

#[test]
fn moving_body_shows_time() {
    let scene = "[mesh]\ngenerate = \"bar\"\n[solver]\nname = \"implicit\"\ndt = 0.0125\nsteps = 2\n[picture]\ntime = true\nsize = [64, 48]\n";
    let mut stage = Stage::new(&gpu(), &Scene::parse(scene).unwrap()).unwrap();
    let time = |stage: &Stage| stage.annotations().time.unwrap();
    assert_eq!(time(&stage).seconds, 0.0);
    stage.run(4, &mut |_| {}).unwrap();
    assert!((time(&stage).seconds - 0.05).abs() < 1e-12);
    assert_eq!(time(&stage).resolution, 0.025);
}

#[test]
fn annotation_rejects_invalid_image() {
    let camera = Camera::orthographic(DVec3::Z, DVec3::ZERO, DVec3::Y, 1.0);
    let annotations = Annotations {
        axes: Some(Axes::Xyz),
        ..Annotations::default()
    };
    let mut grey = Image {
        channels: 1,
        values: vec![0.0; 64],
        size: [8, 8],
    };
    let result = annotations.draw(&mut grey, &camera, Background::Black);
    assert!(
        result
            .unwrap_err()
            .to_string()
            .contains("must have 4 channels, got 1")
    );
    let bad = Camera {
        eye: DVec3::ZERO,
        ..camera
    };
    assert!(
        annotations
            .draw(&mut empty([8, 8]), &bad, Background::Black)
            .is_err()
    );
}

#[test]
fn orbit_keeps_body_in_view() {
    let mut stage = stage([96, 96], "");
    stage.fit_orbit(&[]).unwrap();
    let starts = *stage.camera_mut();
    let mut filled: f64 = 0.0;
    for eighth in 0..8 {
        *stage.camera_mut() = starts.orbited(45.0 * f64::from(eighth));
        let image = stage.image().unwrap();
        let opaque = |x: u32, y: u32| image.pixel(x, y)[3] > 0.0;
        let edge = (0..96).any(|i| {
            [(i, 0), (i, 95), (0, i), (95, i)]
                .iter()
                .any(|(x, y)| opaque(*x, *y))
        });
        assert!(
            !edge,
            "at {} degrees the picture's edge cuts the body",
            45 * eighth
        );
        let across = (0..96).filter(|x| (0..96).any(|y| opaque(*x, y))).count();
        filled = filled.max(across as f64 / 96.0);
    }
    assert!(filled > 0.7, "it fills {filled} of the picture at most");
}

#[test]
fn letters_without_glyph_are_noted() {
    let with = stage([64, 48], "title = \"肝 Ωж\"").notes().join("; ");
    assert!(with.contains("lacks the letters 肝,"), "{with}");
    let without = stage([64, 48], "title = \"liver Ωж\"").notes().join("; ");
    assert!(!without.contains("lacks the letters"), "{without}");
}
