//! All features of interior pictures combined: two clip planes, a slice, two isosurfaces, a
//! translucent skin and light, against their float64 reference.

use crate::render::common::*;
use crate::render::planes::{Seen, insides};
use glam::DVec3;
use palpate::generate;
use palpate::mesh::TriMesh;
use palpate::render::*;
use palpate::skin::{Compositor, CompositorOptions, Mapping, Skin, SkinBase, SkinColouring};

/// Returns a square of `size` about `middle`, perpendicular to `normal`.
fn square(middle: DVec3, normal: DVec3, size: f64) -> TriMesh {
    let n = 12u32;
    let (u, v) = normal.any_orthonormal_pair();
    let along = |k: u32| (f64::from(k) / f64::from(n) - 0.5) * size;
    let row = |j: u32| (0..=n).map(move |i| middle + along(i) * u + along(j) * v);
    let cell = |k: u32| {
        let a = k / n * (n + 1) + k % n;
        [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
    };
    TriMesh {
        vertices: (0..=n).flat_map(row).collect(),
        triangles: (0..n * n).flat_map(cell).collect(),
        ..TriMesh::default()
    }
}

#[test]
fn combined_features_match_float64() {
    let gpu = gpu();
    let mesh = generate::duct([9, 9, 9], DVec3::ONE, generate::Bore::Round).unwrap();
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low + high);
    let camera = Camera::fit_mesh(&mesh);
    // Towards the eye: points beyond the plane are in front of the skin.
    let normal = (camera.eye - middle).normalize() + DVec3::new(0.1, -0.05, 0.02);
    for (walk, light) in [
        (Traversal::Vertices, Light::Head),
        (Traversal::Planes, Light::From(DVec3::new(0.3, 1.0, -0.5))),
    ] {
        let mut seen = Seen::new(&gpu, &mesh, &mesh.nodes, walk, light);
        let (_, all) = insides(&mesh, &seen.scalars.clone()).pop().unwrap();
        let geometry = seen.caster.geometry();
        let (positions, frame) = (geometry.positions().clone(), geometry.frame());
        let carrier = SkinBase::from_mesh(&gpu, &mesh, &positions, frame).unwrap();
        let sheet = square(middle, normal, 0.7 * (high - low).max_element());
        let mut skin = Skin::new(&gpu, &sheet, &carrier, Mapping::Constant).unwrap();
        skin.set_colour(&SkinColouring::Plain([0.9, 0.8, 0.1]))
            .unwrap();
        skin.set_opacity(0.6).unwrap();
        skin.set_sections(&all).unwrap();
        let alone = Compositor::new(&gpu, options()).unwrap().image(
            std::slice::from_mut(&mut skin),
            None,
            &camera,
            SIZE,
        );
        let alone = alone.unwrap();
        seen.caster.set_sections(&all).unwrap();
        let image = Compositor::new(&gpu, options())
            .unwrap()
            .image(
                std::slice::from_mut(&mut skin),
                Some(&mut seen.caster),
                &camera,
                SIZE,
            )
            .unwrap();
        keep(&image, &format!("together_{walk:?}.png"));
        // The same in front of the skin, and behind it.
        let half = |normal: DVec3| {
            let mut inside = all.clone();
            inside.planes.push(Plane::clip(middle, normal));
            seen.truth(&camera, &inside)
        };
        let (before, behind) = (half(-normal), half(normal));
        let over = |front: &[f64; 4], back: &[f64; 4]| -> [f64; 4] {
            std::array::from_fn(|k| front[k] + (1.0 - front[3]) * back[k])
        };
        let off = |mix: &dyn Fn(usize, [f64; 4]) -> [f64; 4]| {
            let (mut far, mut sum) = (0, 0.0);
            for (i, found) in image.values.chunks(4).enumerate() {
                let skin: [f64; 4] = std::array::from_fn(|k| f64::from(alone.values[4 * i + k]));
                let truth = mix(i, skin);
                let errors = found.iter().zip(truth).map(|(a, b)| f64::from(*a) - b);
                let worst = errors.map(|e| 255.0 * e.abs()).fold(0.0, f64::max);
                match worst > 4.0 {
                    true => far += 1,
                    false => sum += worst * worst,
                }
            }
            let pixels = before.len() as f64;
            (f64::from(far) / pixels, (sum / pixels).sqrt())
        };
        let (far, rms) = off(&|i, skin| over(&before[i], &over(&skin, &behind[i])));
        let covered = alone.values.chunks(4).filter(|p| p[3] > 0.5).count();
        println!("{walk:?}: {far:.4} far, rms {rms:.3}, the skin covers {covered} pixels");
        assert!(far < 0.01 && rms < 0.5, "{walk:?}: {far} {rms}");
        assert!(covered > 300, "{covered}");
        // A skin in front of everything differs.
        let (far, _) = off(&|i, skin| over(&skin, &over(&before[i], &behind[i])));
        assert!(far > 0.02, "{far}");
    }
}

fn options() -> CompositorOptions {
    CompositorOptions {
        samples: 1,
        ..CompositorOptions::default()
    }
}

const SIZE: [u32; 2] = [64, 64];
