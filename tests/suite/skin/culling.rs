//! Back-face culling by node normals: the same triangles as in a float64 reference, and no visible
//! one.

use crate::skin::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::gpu::{Array, Gpu};
use palpate::mesh::{LocalFrame, TetMesh, TriMesh, unpack_normal};
use palpate::render::{Camera, local_positions};
use palpate::skin::BaseMesh;
use palpate::skin::culling::{BaseVisibility, CullData};
use palpate::skin::{Mapping, Skin, SkinBase};
use std::collections::HashSet;

const SIZE: [u32; 2] = [200, 160];

/// A ball of tets, bent by `amount`, and a smooth skin slightly above it.
struct Ball {
    mesh: TetMesh,
    frame: LocalFrame,
    positions: Array,
    carrier: SkinBase,
    surface: TriMesh,
}

impl Ball {
    fn new(gpu: &Gpu) -> Ball {
        let mesh = generate::ball(1.0, 16).unwrap();
        let frame = LocalFrame::from_mesh(&mesh);
        let positions = local_positions(gpu, &frame, &mesh.nodes).unwrap();
        let carrier = SkinBase::from_mesh(gpu, &mesh, &positions, frame).unwrap();
        let hills = |p: DVec3| 0.012 * (7.0 * p.x).sin() * (6.0 * p.y).cos();
        let surface = sphere(60, 120, |p| p * (1.03 + hills(p)));
        Ball {
            mesh,
            frame,
            positions,
            carrier,
            surface,
        }
    }

    fn stand(&self, gpu: &Gpu, place: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
        let nodes: Vec<DVec3> = self.mesh.nodes.iter().map(|p| place(*p)).collect();
        let local: Vec<[f32; 4]> = nodes
            .iter()
            .map(|p| self.frame.to_local(*p).extend(1.0).to_array())
            .collect();
        gpu.write_array(&self.positions, &local).unwrap();
        nodes
    }
}

/// Bent, stretched and twisted.
fn bend(p: DVec3) -> DVec3 {
    let turned = DVec3::new(
        p.x + 0.35 * p.z * p.z,
        1.2 * p.y,
        p.z + 0.1 * (3.0 * p.x).sin(),
    );
    let (sin, cos) = (0.5 * p.z).sin_cos();
    let twisted = DVec3::new(
        cos * turned.x - sin * turned.y,
        sin * turned.x + cos * turned.y,
        turned.z,
    );
    twisted + 0.05 * DVec3::new(0.0, (4.0 * p.z).sin(), 0.0)
}

fn cameras() -> Vec<Camera> {
    let at = DVec3::new(0.1, 0.0, 0.0);
    let look = |eye: [f64; 3], fov: f64| Camera::perspective(eye.into(), at, DVec3::Z, fov);
    vec![
        look([3.0, -4.5, 2.0], 34.0),
        look([-300.0, 400.0, -100.0], 0.4),
        Camera::orthographic(DVec3::new(4.0, 3.0, -2.0), at, DVec3::Z, 3.2),
        // Mostly outside the picture.
        look([0.5, -3.0, 0.4], 12.0),
        // Close, and inside.
        look([0.3, -1.7, 0.4], 60.0),
        look([0.2, -0.4, 0.1], 70.0),
    ]
}

#[test]
fn culling_does_not_change_images() {
    let gpu = gpu();
    let ball = Ball::new(&gpu);
    for mapping in [Mapping::Auto, Mapping::Constant, Mapping::NormalOnly] {
        let mut skin = Skin::new(&gpu, &ball.surface, &ball.carrier, mapping).unwrap();
        let all = ball.surface.triangles.len();
        ball.stand(&gpu, bend);
        let mut shares = Vec::new();
        for (n, camera) in cameras().iter().enumerate() {
            skin.set_culling(false);
            let whole = skin.image(camera, SIZE).unwrap();
            assert_eq!(skin.visible_triangles().unwrap().len(), all);
            skin.set_culling(true);
            let culled = skin.image(camera, SIZE).unwrap();
            assert!(whole.values == culled.values, "{mapping} {n}");
            assert!(whole.values.iter().any(|v| *v > 0.0));
            shares.push(1.0 - skin.visible_triangles().unwrap().len() as f64 / all as f64);
            keep(&culled, &format!("culled_{mapping}_{n}.png"));
        }
        println!("{mapping}: culled {shares:.2?}");
        // Most back faces; more if the picture shows only a part.
        assert!(shares[..3].iter().all(|s| *s > 0.3), "{shares:?}");
        assert!(shares[3] > 0.7, "{shares:?}");
        assert!(shares.iter().all(|s| *s < 1.0));
    }
}

#[test]
fn image_comparison_detects_missing_triangles() {
    let gpu = gpu();
    let ball = Ball::new(&gpu);
    let mut skin = Skin::new(&gpu, &ball.surface, &ball.carrier, Mapping::Auto).unwrap();
    ball.stand(&gpu, bend);
    let camera = &cameras()[0];
    let whole = skin.image(camera, SIZE).unwrap();
    // The triangles that culling of the opposite side drops.
    let opposite = Camera {
        eye: 2.0 * camera.look_at - camera.eye,
        ..*camera
    };
    skin.set_culling(true);
    skin.image(&opposite, SIZE).unwrap();
    let drawn: HashSet<[u32; 3]> = skin.visible_triangles().unwrap().into_iter().collect();
    let shown: Vec<bool> = skin
        .rest()
        .triangles
        .iter()
        .map(|t| drawn.contains(t))
        .collect();
    assert!(shown.contains(&false));
    skin.set_visible_triangles(&shown).unwrap();
    // A skin with holes: back faces may be visible through them.
    let holey = skin.image(camera, SIZE).unwrap();
    assert!(whole.values != holey.values);
    assert_eq!(skin.visible_triangles().unwrap().len(), drawn.len());
}

/// Returns the triangles culled by the reference, and the distance of each from the limit, in
/// radians.
fn twin(skin: &Skin, nodes: &[DVec3], camera: &Camera, plain: bool) -> Vec<(bool, f64)> {
    let base = skin.carrier().rest_mesh();
    let rest: Vec<Option<DVec3>> = base.normals.iter().map(|n| unpack_normal(*n)).collect();
    let tilts = CullData::new(base.nodes, &rest, skin.bound(), &skin.rest().triangles);
    let normals = BaseMesh::reference_normals(nodes, base.triangles);
    let outlooks: Vec<BaseVisibility> = tilts
        .bases
        .iter()
        .map(|base| {
            // The offsets of a base are in the local frame.
            let frame = skin.carrier().frame();
            let local = |p: DVec3| (p - frame.origin) / frame.scale;
            let nodes: Vec<DVec3> = nodes.iter().map(|p| local(*p)).collect();
            let camera = Camera {
                eye: local(camera.eye),
                look_at: local(camera.look_at),
                ..*camera
            };
            let found = BaseVisibility::new(base, &nodes, &normals, &camera);
            match plain {
                true => BaseVisibility {
                    strain: 1.0,
                    ..found
                },
                false => found,
            }
        })
        .collect();
    tilts
        .triangles
        .iter()
        .map(|(of, tilt)| {
            let these = of.map(|b| outlooks[b as usize]);
            let turned = |by: f64| {
                BaseVisibility::is_skipped(
                    *tilt,
                    these.map(|o| BaseVisibility {
                        angle: o.angle + by,
                        ..o
                    }),
                )
            };
            let near = if turned(1e-3) != turned(-1e-3) {
                0.0
            } else {
                1.0
            };
            (turned(0.0), near)
        })
        .collect()
}

#[test]
fn culling_matches_reference() {
    let gpu = gpu();
    let mesh = generate::ball(1.0, 6).unwrap();
    let base = mesh.boundary_surface(None).unwrap();
    let surface = sphere(24, 48, |p| p * (1.04 + 0.02 * (5.0 * p.x).sin()));
    let mut random = noise(11);
    let (mut skipped, mut close, mut ignorant) = (0, 0, 0);
    for mapping in [Mapping::Interpolated, Mapping::Constant, Mapping::Auto] {
        let (low, high) = palpate::mesh::bounds(&base.vertices);
        let frame = LocalFrame::from_bounds(low, high);
        let nodes: Vec<DVec3> = base
            .vertices
            .iter()
            .map(|p| {
                let jitter = DVec3::new(random(), random(), random());
                bend(*p) + 0.04 * jitter
            })
            .collect();
        let positions = local_positions(&gpu, &frame, &nodes).unwrap();
        let rest = &base.vertices;
        let carrier =
            SkinBase::with_area_normals(&gpu, &positions, frame, rest, &base.triangles).unwrap();
        let mut skin = Skin::new(&gpu, &surface, &carrier, mapping).unwrap();
        skin.set_culling(true);
        for camera in &cameras()[..3] {
            skin.image(camera, SIZE).unwrap();
            let drawn = skin.visible_triangles().unwrap();
            // In the order of the surface.
            let places: Vec<usize> = drawn
                .iter()
                .map(|t| skin.rest().triangles.iter().position(|u| u == t).unwrap())
                .collect();
            assert!(places.windows(2).all(|w| w[0] < w[1]));
            let drawn: HashSet<[u32; 3]> = drawn.into_iter().collect();
            let truth = twin(&skin, &nodes, camera, false);
            let plain = twin(&skin, &nodes, camera, true);
            for ((t, (skips, margin)), (plainly, _)) in
                skin.rest().triangles.iter().zip(truth).zip(plain)
            {
                skipped += usize::from(skips);
                let same = drawn.contains(t) != skips;
                close += usize::from(margin == 0.0);
                ignorant += usize::from(drawn.contains(t) == plainly);
                assert!(same || margin == 0.0, "{mapping}");
            }
        }
    }
    println!("{skipped} culled, {close} near the limit, {ignorant} differ without strain");
    assert!(skipped > 1000 && close < skipped / 20);
    assert!(ignorant > 100);
}

#[test]
fn culling_is_disabled_for_open_or_translucent_skins() {
    let gpu = gpu();
    let ball = Ball::new(&gpu);
    ball.stand(&gpu, bend);
    let camera = &cameras()[0];
    let count = |skin: &mut Skin| {
        skin.set_culling(true);
        skin.image(camera, SIZE).unwrap();
        skin.visible_triangles().unwrap().len()
    };
    let all = ball.surface.triangles.len();
    let mut skin = Skin::new(&gpu, &ball.surface, &ball.carrier, Mapping::Auto).unwrap();
    assert!(count(&mut skin) < all);
    skin.set_opacity(0.5).unwrap();
    assert_eq!(count(&mut skin), all);
    let mut open = ball.surface.clone();
    open.triangles.truncate(all - 40);
    let mut skin = Skin::new(&gpu, &open, &ball.carrier, Mapping::Auto).unwrap();
    assert_eq!(count(&mut skin), all - 40);

    // The nodes of the lower half have no normal, as for a grid body one particle thick.
    let base = ball.carrier.rest_mesh();
    let mut packed = base.normals.to_vec();
    let places = &ball.mesh.nodes;
    for (normal, p) in packed.iter_mut().zip(places) {
        if p.z < 0.0 {
            *normal = palpate::mesh::NO_NORMAL;
        }
    }
    let normals = gpu
        .array_of("normals", palpate::gpu::Texel::U32, &packed)
        .unwrap();
    let thin = SkinBase::new(
        &ball.positions,
        ball.frame,
        &normals,
        places,
        &packed,
        base.triangles,
    )
    .unwrap();
    let mut skin = Skin::new(&gpu, &ball.surface, &thin, Mapping::Constant).unwrap();
    let drawn = count(&mut skin);
    assert!(drawn < all);
    let drawn: HashSet<[u32; 3]> = skin.visible_triangles().unwrap().into_iter().collect();
    let bound = skin.bound();
    let low = |v: u32| {
        let nodes = bound[v as usize].nodes;
        nodes.iter().any(|n| places[*n as usize].z < 0.0)
    };
    let triangles = skin.rest().triangles.iter();
    let mut below = triangles.filter(|t| t.iter().any(|v| low(*v)));
    assert!(below.all(|t| drawn.contains(t)));
}
