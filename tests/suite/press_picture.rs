//! The picture of a press.

use crate::press::{block, finger};
use crate::support::gpu;
use palpate::physics::BodyField;
use palpate::press::Press;
use palpate::render::{Background, Image};

const SIZE: [u32; 2] = [320, 240];

/// Returns the number of pixels of the red bar that marks the depth, outside of the inset.
fn marked(image: &Image) -> usize {
    let is_red = |p: &[f32]| p[0] > 0.6 && p[1] < 0.3 && p[2] < 0.3;
    let right = (0..SIZE[1]).flat_map(|y| (SIZE[0] * 3 / 10..SIZE[0]).map(move |x| (x, y)));
    right.filter(|(x, y)| is_red(image.pixel(*x, *y))).count()
}

/// Presses to the largest depth.
fn press_in(press: &mut Press) {
    while !press.at_max_depth() {
        press.advance().unwrap().unwrap();
    }
}

#[test]
fn picture_of_a_press_shows_the_dent_and_its_depth() {
    let mut press = Press::new(&gpu(), &block(""), &finger()).unwrap();
    assert!(press.picture(SIZE).is_err() && press.deepest_picture(SIZE).is_err());
    press.keep_picture(None).unwrap();
    let rest = press.picture(SIZE).unwrap();
    assert_eq!((rest.size, rest.channels), (SIZE, 4));
    assert_eq!(marked(&rest), 0);
    press_in(&mut press);
    press.keep_picture(None).unwrap();
    let pressed = press.picture(SIZE).unwrap();
    assert!(marked(&pressed) > 8, "{}", marked(&pressed));
    // The cut face fills much of the picture, and the finger stands above it.
    let opaque = pressed.values.chunks(4).filter(|p| p[3] > 0.99).count();
    let share = opaque as f64 / f64::from(SIZE[0] * SIZE[1]);
    assert!((0.4..0.95).contains(&share), "{share}");
    // The same picture each time, and it is kept while the finger withdraws.
    assert_eq!(press.picture(SIZE).unwrap(), pressed);
    while press.advance().unwrap().is_some() {
        press.keep_picture(None).unwrap();
    }
    assert_eq!(press.deepest_picture(SIZE).unwrap(), pressed);
    assert_ne!(press.picture(SIZE).unwrap(), pressed);
}

#[test]
fn isolines_of_a_press_are_drawn_on_demand() {
    let mut press = Press::new(&gpu(), &block(""), &finger()).unwrap();
    press_in(&mut press);
    let mut draw = |show| {
        press.keep_picture(show).unwrap();
        press.picture(SIZE).unwrap()
    };
    let [plain, displacement, stress] = [
        None,
        Some(BodyField::Displacement),
        Some(BodyField::VonMises),
    ]
    .map(&mut draw);
    // Compared below the title.
    let differing = |a: &Image, b: &Image| {
        let from = (4 * SIZE[0] * 40) as usize;
        let pairs = a.values[from..].chunks(4).zip(b.values[from..].chunks(4));
        pairs.filter(|(a, b)| a != b).count()
    };
    assert!(differing(&plain, &displacement) > 100);
    assert!(differing(&plain, &stress) > 100);
    assert!(differing(&displacement, &stress) > 100);
    assert_eq!(draw(None), plain);
}

#[test]
fn picture_of_a_press_rejects_sizes_it_cannot_draw() {
    let mut press = Press::new(&gpu(), &block(""), &finger()).unwrap();
    press.keep_picture(None).unwrap();
    for size in [[0, 10], [4, 200], [400, 100_000]] {
        let error = press.picture(size).unwrap_err().to_string();
        assert!(error.contains("8 to 8192"), "{error}");
    }
    assert_eq!(press.stage().picture_background(), Background::Gradient);
}

#[test]
fn scene_that_shows_a_computed_field_is_pressed() {
    let scene = block("[picture]\nfield = \"strain\"\n");
    let mut press = Press::new(&gpu(), &scene, &finger()).unwrap();
    press.keep_picture(None).unwrap();
    press.picture(SIZE).unwrap();
}
