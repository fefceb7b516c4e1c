//! Maximum, minimum and mean intensity projection, against float64.

use crate::render::common::*;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use palpate::render::*;

/// Tolerance as a fraction of the range of scalars.
const NEAR: f64 = 2e-3;

const SIZE: [u32; 2] = [64, 64];

const MODES: [Mode; 3] = [Mode::Maximum, Mode::Minimum, Mode::Mean];

/// Returns the projection of the segments of a ray, and their length.
fn projected(mode: Mode, segments: &[Segment]) -> Option<f64> {
    let ends = segments.iter().flat_map(|s| s.s);
    let length: f64 = segments.iter().map(|s| s.t[1] - s.t[0]).sum();
    let mean = segments
        .iter()
        .map(|s| 0.5 * (s.s[0] + s.s[1]) * (s.t[1] - s.t[0]) / length);
    (length > 0.0).then(|| match mode {
        Mode::Maximum => ends.fold(f64::NEG_INFINITY, f64::max),
        Mode::Minimum => ends.fold(f64::INFINITY, f64::min),
        _ => mean.sum(),
    })
}

/// A mesh with waves as scalars, and a view of it.
struct Projected {
    scene: Scene,
    camera: Camera,
}

impl Projected {
    fn new(mesh: &TetMesh, walk: Traversal) -> Projected {
        let gpu = Gpu::new().unwrap();
        let options = RaycastOptions {
            walk,
            ..Default::default()
        };
        let (nodes, scalars) = (&mesh.nodes, waves(mesh));
        Projected {
            scene: Scene::new(&gpu, mesh, nodes, &scalars, &peers_transfer(), options),
            camera: Camera::fit_mesh_in(mesh, SIZE),
        }
    }

    /// Returns, among the rays that hit the mesh, the fraction of those whose pixel in the picture
    /// of `mode` differs by more than `NEAR` from their projection by `against`. A ray along a
    /// silhouette may hit another part than in float64.
    fn apart(&mut self, mode: Mode, against: Mode) -> f64 {
        let Scene { caster, truth } = &mut self.scene;
        let image = caster.image(&self.camera, SIZE, mode).unwrap();
        assert_eq!(image.channels, 4);
        let (low, high) = caster.geometry().scalar_range();
        let truth = truth.render(&self.camera, SIZE, |reference, ray| {
            projected(against, &reference.segments(ray))
        });
        let (mut off, mut met) = (0, 0);
        for (pixel, truth) in image.values.chunks_exact(4).zip(truth) {
            let Some(truth) = truth else {
                continue;
            };
            assert!(pixel[0] == pixel[1] && pixel[1] == pixel[2]);
            assert!(pixel[3] == 0.0 || pixel[3] == 1.0);
            let grey = (truth - low) / (high - low);
            met += 1;
            off += usize::from(pixel[3] == 0.0 || (f64::from(pixel[0]) - grey).abs() > NEAR);
        }
        assert!(met > 300);
        off as f64 / f64::from(met)
    }
}

#[test]
fn projections_match_float64() {
    // A duct is left and entered again: projections continue over layers.
    for mesh in [
        generate::by_name("duct", Some(4000)).unwrap(),
        generate::ball(1.0, 5).unwrap(),
    ] {
        for walk in [Traversal::Vertices, Traversal::Planes] {
            let mut rays = Projected::new(&mesh, walk);
            for mode in MODES {
                let off = rays.apart(mode, mode);
                println!("{mode:?} {walk:?}: {off:.4} of the rays");
                assert!(off < 0.02, "{mode:?} {walk:?}: {off}");
            }
        }
    }
}

#[test]
fn projection_modes_differ() {
    let mesh = generate::ball(1.0, 5).unwrap();
    let mut rays = Projected::new(&mesh, Traversal::Vertices);
    for mode in MODES {
        for other in MODES.into_iter().filter(|m| *m != mode) {
            let off = rays.apart(mode, other);
            assert!(off > 0.8, "{mode:?} is {other:?}: {off}");
        }
    }
}
