//! Normal maps baked from fine to coarse surfaces.

use crate::skin::common::*;
use crate::skin::mapping::with_uvs;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{LocalFrame, TriMesh};
use palpate::render::{Camera, Image, local_positions};
use palpate::skin::{Mapping, Skin, SkinBase, bake};

/// A sphere with dents and bumps that the coarse one lacks.
fn dented(p: DVec3) -> DVec3 {
    p * (1.0 + 0.02 * (14.0 * p.x).sin() * (13.0 * p.y).cos() * (12.0 * p.z).sin())
}

#[test]
fn baked_map_reproduces_fine_surface() {
    let gpu = gpu();
    let coarse = with_uvs(&sphere(24, 48, |p| p));
    let fine = sphere(150, 300, dented);
    let (map, report) = bake(&coarse, &fine, [512, 256]).unwrap();
    // Nearly all of the texture is covered; the rays hit the fine surface.
    assert!(
        report.covered > 480 * 256 && report.missed < 500,
        "{report:?}"
    );
    let ball = generate::ball(1.0, 6).unwrap();
    let frame = LocalFrame::from_mesh(&ball);
    let positions = local_positions(&gpu, &frame, &ball.nodes).unwrap();
    let carrier = SkinBase::from_mesh(&gpu, &ball, &positions, frame).unwrap();
    let camera = Camera::perspective(DVec3::new(4.0, 3.0, 1.0), DVec3::ZERO, DVec3::Z, 20.0);
    let picture = |skin: &mut Skin| skin.image(&camera, [160, 160]).unwrap();
    let skin = |surface| Skin::new(&gpu, surface, &carrier, Mapping::Interpolated).unwrap();
    let truth = picture(&mut skin(&fine));
    let mut coarse_skin = skin(&coarse);
    let plain = picture(&mut coarse_skin);
    coarse_skin.set_normal_map(Some(&map)).unwrap();
    let mapped = picture(&mut coarse_skin);
    // Within the centre of the disc: at its rim the silhouettes differ.
    let off = |image: &Image| {
        let (mut sum, mut count) = (0.0, 0);
        for (x, y) in (40..120).flat_map(|y| (40..120).map(move |x| (x, y))) {
            sum += f64::from((image.pixel(x, y)[0] - truth.pixel(x, y)[0]).abs());
            count += 1;
        }
        sum / f64::from(count)
    };
    let (with, without) = (off(&mapped), off(&plain));
    println!("mean difference from the fine surface: {with:.4} mapped, {without:.4} plain");
    assert!(with < 0.3 * without && without > 0.02, "{with} {without}");
}

#[test]
fn self_bake_is_flat_and_invalid_input_rejected() {
    let coarse = with_uvs(&sphere(16, 32, |p| p));
    let (map, report) = bake(&coarse, &coarse, [128, 64]).unwrap();
    assert_eq!(report.missed, 0);
    // Only near the poles, where triangles degenerate, texels are not covered.
    assert!(report.covered > 128 * 58, "{report:?}");
    let bent = |t: &&[u8; 4]| t[0].abs_diff(128) > 2 || t[1].abs_diff(128) > 2 || t[2] < 253;
    assert_eq!(map.texels.iter().filter(bent).count(), 0);
    // The map of another surface is not flat.
    let (map, _) = bake(&coarse, &sphere(60, 120, dented), [128, 64]).unwrap();
    assert!(map.texels.iter().filter(bent).count() > 1000);

    let bare = sphere(4, 8, |p| p);
    let refused = |c: &TriMesh, f: &TriMesh, size| bake(c, f, size).unwrap_err().to_string();
    assert!(refused(&bare, &coarse, [8, 8]).contains("texture coordinates"));
    assert!(refused(&coarse, &coarse, [0, 8]).contains("0 x 8"));
    assert!(refused(&coarse, &TriMesh::default(), [8, 8]).contains("triangles"));
    let mut wild = coarse.clone();
    wild.fields[0].values[7] = 1e9;
    assert!(refused(&wild, &coarse, [8, 8]).contains("of the coarse surface must be finite"));
}
