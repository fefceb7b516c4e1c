//! The lit surface: its coverage equals that of the rays, and its lighting follows its nodes.

use crate::render::common::*;
use palpate::generate;
use palpate::render::*;

#[test]
fn surface_coverage_equals_ray_hits() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(6, true).unwrap();
    let positions = bent(&mesh);
    let scalars = node_scalars(&mesh, "scalar");
    let mut scene = Scene::new(
        &gpu,
        &mesh,
        &positions,
        &scalars,
        &peers_transfer(),
        RaycastOptions::default(),
    );
    for shading in [Shading::Smooth, Shading::Flat] {
        for colour in [
            SurfaceColour::Plain([0.8, 0.5, 0.4]),
            SurfaceColour::Field(TransferFunction::preset("viridis").unwrap()),
        ] {
            let mut surface =
                Surface::new(&gpu, scene.caster.geometry(), &scalars, &colour, shading).unwrap();
            let camera = peers_camera();
            let image = surface.image(&camera, [96, 96]).unwrap();
            keep(&image, &format!("surface-{shading:?}.png"));
            let inside = scene
                .caster
                .image(&camera, [96, 96], Mode::Thickness)
                .unwrap();
            let mut apart = 0;
            for (pixel, length) in image.values.chunks(4).zip(&inside.values) {
                let (covered, met) = (pixel[3], *length > 0.0);
                // Edge pixels are partly covered.
                apart += usize::from((covered == 1.0 && !met) || (covered == 0.0 && met));
                assert!(pixel[..3].iter().all(|c| (0.0..=1.0).contains(c)));
            }
            // A corner may lie between the samples of its pixel.
            assert!(apart <= 2, "{apart}");
            let bright = image.values.chunks(4).filter(|p| p[1] > 0.3).count();
            assert!(bright > 500, "{bright}");
        }
    }
}
