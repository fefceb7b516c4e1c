//! Pictures: the perceptual difference in known cases, and the settings selected by a tolerance.

use palpate::generate;
use palpate::mesh::Location;
use palpate::render::ReferenceRaycaster;
use palpate::render::{
    Camera, Geometry, Image, ImageDifference, Mode, RaycastOptions, Raycaster, TableKind,
    TableTexel, TransferFunction,
};

const SIZE: [u32; 2] = [64, 48];

fn picture(of: impl Fn(f64, f64) -> [f64; 3]) -> Image {
    let values = (0..SIZE[1])
        .flat_map(|y| (0..SIZE[0]).map(move |x| [x, y].map(f64::from)))
        .flat_map(|[x, y]| {
            let [r, g, b] = of(x, y);
            [r, g, b, 1.0].map(|v| v as f32)
        })
        .collect();
    Image {
        size: SIZE,
        channels: 4,
        values,
    }
}

fn flip(a: &Image, b: &Image) -> f64 {
    ImageDifference::between(a, b).unwrap().flip.unwrap()
}

fn waves(shift: f64) -> Image {
    picture(|x, y| {
        [
            0.5 + 0.4 * (0.31 * x + shift).sin(),
            0.5 + 0.4 * (0.23 * y).cos(),
            0.5 - 0.25 * shift + 0.3 * (0.17 * (x + y)).sin(),
        ]
    })
}

/// The result of the authors' own program (flip-evaluator 1.7, LDR, its default viewing distance).
#[test]
fn flip_matches_published_values() {
    let plain = |c: [f64; 3]| picture(move |_, _| c);
    let checks = picture(|x, y| [((x / 4.0).floor() + (y / 4.0).floor()) % 2.0; 3]);
    let dots = picture(|x, y| {
        [if x % 16.0 == 8.0 && y % 16.0 == 8.0 {
            1.0
        } else {
            0.2
        }; 3]
    });
    for (name, a, b, expected) in [
        ("black, white", plain([0.0; 3]), plain([1.0; 3]), 0.967_388),
        (
            "green, blue",
            plain([0.0, 1.0, 0.0]),
            plain([0.0, 0.0, 1.0]),
            1.0,
        ),
        ("waves", waves(0.0), waves(0.2), 0.222_242),
        ("checks, black", checks.clone(), plain([0.0; 3]), 0.950_347),
        ("dots", dots, plain([0.2; 3]), 0.035_368),
        ("waves, checks", waves(0.0), checks, 0.892_349),
    ] {
        let got = flip(&a, &b);
        assert!(
            (got - expected).abs() < 2e-5,
            "{name}: {got}, not {expected}"
        );
    }
}

#[test]
fn flip_is_zero_for_equal_images_and_grows_with_error() {
    assert_eq!(flip(&waves(0.0), &waves(0.0)), 0.0);
    let grown: Vec<f64> = [0.01, 0.03, 0.1, 0.3]
        .map(|shift| flip(&waves(0.0), &waves(shift)))
        .to_vec();
    assert!(grown.is_sorted() && grown[0] > 0.0, "{grown:?}");
    // The metric is symmetric.
    let (a, b) = (
        flip(&waves(0.0), &waves(0.1)),
        flip(&waves(0.1), &waves(0.0)),
    );
    assert!((a - b).abs() < 1e-12);
}

#[test]
fn non_finite_value_counts_as_maximum_difference() {
    let mut broken = waves(0.0);
    broken.values[4 * 100] = f32::NAN;
    let pixels = f64::from(SIZE[0] * SIZE[1]);
    let got = flip(&waves(0.0), &broken);
    assert!(got >= 1.0 / pixels && got < 0.1, "{got}");
    // Both have the defect at the same place: no difference there.
    assert_eq!(flip(&broken, &broken.clone()), 0.0);
}

/// Returns a small body with waves, its exact picture, and its renderer, with thin shells or
/// discontinuous colours.
fn scene(extinction: Vec<[f64; 2]>, colour: Vec<[f64; 4]>) -> (Raycaster, Camera, Image) {
    let mesh = generate::benchmark_cube(6, false).unwrap();
    let scalars = mesh.field("scalar", Location::Node).unwrap().values.clone();
    let transfer = TransferFunction::relative(colour, extinction).unwrap();
    let geometry = Geometry::at_rest(&crate::support::gpu(), &mesh, &scalars).unwrap();
    let caster = Raycaster::new(&crate::support::gpu(), geometry, &transfer).unwrap();
    let camera = Camera::fit_mesh(&mesh);
    let (rays, resolved) = (
        ReferenceRaycaster::new(&mesh, &mesh.nodes, &scalars),
        caster.transfer(),
    );
    let pixels = rays.render(&camera, SIZE, |rays, ray| rays.composite(ray, &resolved));
    let truth = Image {
        size: SIZE,
        channels: 4,
        values: pixels.into_iter().flatten().map(|v| v as f32).collect(),
    };
    (caster, camera, truth)
}

fn shells() -> (Raycaster, Camera, Image) {
    let shell = |s: f64, peak: f64| [[s - 0.02, 0.0], [s, peak], [s + 0.02, 0.0]];
    let shells = [shell(0.25, 40.0), shell(0.5, 80.0), shell(0.75, 160.0)].concat();
    scene(shells, vec![[0.0, 0.2, 0.4, 0.9], [1.0, 0.9, 0.3, 0.2]])
}

fn jumps() -> (Raycaster, Camera, Image) {
    let colour = vec![
        [0.0, 0.1, 0.2, 0.9],
        [0.5, 0.1, 0.2, 0.9],
        [0.5, 1.0, 0.8, 0.1],
    ];
    scene(vec![[0.0, 6.0], [1.0, 12.0]], colour)
}

/// Returns the root mean square error with `options`, in 1/255.
fn error(scene: &mut (Raycaster, Camera, Image), options: RaycastOptions) -> f64 {
    let (caster, camera, truth) = scene;
    caster.set_options(options).unwrap();
    let image = caster.image(camera, SIZE, Mode::Composite).unwrap();
    255.0 * ImageDifference::between(truth, &image).unwrap().rmse
}

#[test]
#[ignore = "long: scripts/test --full"]
fn tolerance_is_met_at_monotonic_cost() {
    let tolerances = [0.3, 0.5, 1.0, 2.0, 5.0, 12.0];
    for (name, mut scene) in [("shells", shells()), ("jumps", jumps())] {
        let mut before = (u32::MAX, 1.0);
        for tolerance in tolerances {
            let options = RaycastOptions::for_tolerance(tolerance / 255.0).unwrap();
            let found = error(&mut scene, options);
            // One-dimensional integrals have more samples than any table of slices, at lower cost.
            let size = match scene.0.table_layers() {
                1 => 0,
                _ => scene.0.table_size(),
            };
            let cost = (size, options.opacity_cutoff);
            println!("{name}: {found:.3} within {tolerance}, {cost:?}");
            assert!(found <= tolerance, "{name}: {found}, not {tolerance}");
            assert!(
                cost.0 <= before.0 && cost.1 < before.1,
                "{name}: {cost:?} after {before:?}"
            );
            before = cost;
        }
    }
    let default = RaycastOptions::for_tolerance(0.5 / 255.0).unwrap();
    assert_eq!(default, RaycastOptions::default());
}

#[test]
fn coarse_settings_exceed_tolerance() {
    let plain = RaycastOptions::default();
    for (what, options) in [
        (
            "table",
            RaycastOptions {
                table_size: Some(32),
                ..plain
            },
        ),
        (
            "end of rays",
            RaycastOptions {
                opacity_cutoff: 0.8,
                ..plain
            },
        ),
        (
            "samples",
            RaycastOptions {
                table: TableKind::Samples(1),
                ..plain
            },
        ),
    ] {
        let found = error(&mut shells(), options);
        assert!(found > 0.5, "{what}: {found}");
    }
}

#[test]
fn dense_sampling_matches_preintegration() {
    let mut scene = shells();
    let samples = |n| RaycastOptions {
        table: TableKind::Samples(n),
        opacity_cutoff: 1.0,
        ..RaycastOptions::default()
    };
    let errors = [1, 4, 16, 64].map(|n| error(&mut scene, samples(n)));
    assert!(errors.is_sorted_by(|a, b| a > b), "{errors:?}");
    assert!(errors[3] < 0.1, "{errors:?}");
}

#[test]
#[ignore = "long: scripts/test --full"]
fn every_table_texel_and_size_matches_reference() {
    let mut scene = shells();
    for (texel, bound) in [
        (TableTexel::Byte, 2.0),
        (TableTexel::Half, 0.5),
        (TableTexel::Single, 0.5),
    ] {
        let texel = RaycastOptions {
            texel,
            ..RaycastOptions::default()
        };
        if texel.texel == TableTexel::Single
            && !crate::support::gpu().has(wgpu::Features::FLOAT32_FILTERABLE)
        {
            continue;
        }
        let found = error(&mut scene, texel);
        assert!(found < bound, "{:?}: {found}", texel.texel);
    }
    for table in [TableKind::Sliced, TableKind::Volume] {
        let sized = |n| RaycastOptions {
            table,
            table_size: Some(n),
            ..RaycastOptions::default()
        };
        let errors = [16, 64, 256].map(|n| error(&mut scene, sized(n)));
        assert!(errors.is_sorted_by(|a, b| a > b), "{table:?}: {errors:?}");
    }
}

#[test]
fn rejects_options_out_of_range() {
    let (mut caster, ..) = jumps();
    let plain = RaycastOptions::default();
    for (options, expected) in [
        (
            RaycastOptions {
                opacity_cutoff: 0.0,
                ..plain
            },
            "opacity must be > 0 and ≤ 1, got 0",
        ),
        (
            RaycastOptions {
                opacity_cutoff: 1.5,
                ..plain
            },
            "opacity must be > 0 and ≤ 1, got 1.5",
        ),
        (
            RaycastOptions {
                table_tolerance: f64::NAN,
                ..plain
            },
            "tolerance must be > 0 and finite (pixel values are 0 to 1), got NaN",
        ),
        (
            RaycastOptions {
                table_size: Some(4),
                ..plain
            },
            "texels per side, got 4",
        ),
        (
            RaycastOptions {
                table: TableKind::Samples(65),
                ..plain
            },
            "samples per tet must be 1 to 64, got 65",
        ),
    ] {
        let message = caster.set_options(options).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    // The old ones remain.
    assert_eq!(*caster.options(), plain);
    for tolerance in [0.0, -1.0, f64::NAN, 1.0] {
        let message = RaycastOptions::for_tolerance(tolerance)
            .unwrap_err()
            .to_string();
        assert!(message.contains("in 1/255"), "{message}");
    }
}
