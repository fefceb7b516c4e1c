//! Picks on moved skins, against intersection with every triangle in float64.

use crate::skin::common::*;
use glam::{DVec2, DVec3};
use palpate::generate;
use palpate::mesh::LocalFrame;
use palpate::render::Hit;
use palpate::render::{Camera, local_positions};
use palpate::skin::{Mapping, Skin, SkinBase};

const SIZE: [u32; 2] = [120, 100];

#[test]
fn pick_on_bent_skin_returns_triangle_vertex_and_node() {
    let gpu = gpu();
    let mesh = generate::ball(1.0, 8).unwrap();
    let bend = |p: &DVec3| *p + DVec3::new(0.3 * p.z * p.z, 0.1 * (2.0 * p.x).sin(), 0.0);
    let bent: Vec<DVec3> = mesh.nodes.iter().map(bend).collect();
    let frame = LocalFrame::from_mesh(&mesh);
    let positions = local_positions(&gpu, &frame, &bent).unwrap();
    let carrier = SkinBase::from_mesh(&gpu, &mesh, &positions, frame).unwrap();
    let surface = bumpy(40);
    let mut skin = Skin::new(&gpu, &surface, &carrier, Mapping::Auto).unwrap();
    let vertices = skin.vertices().unwrap();
    // Some triangles are not drawn, so they cannot be picked.
    let shown: Vec<bool> = (0..surface.triangles.len()).map(|t| t % 7 != 0).collect();
    let kept = (0..shown.len()).filter(|t| shown[*t]);
    let kept: Vec<usize> = kept.collect();
    skin.set_visible_triangles(&shown).unwrap();
    let triangles: Vec<[u32; 3]> = kept.iter().map(|t| surface.triangles[*t]).collect();
    let camera = Camera::perspective(DVec3::new(2.0, -5.0, 2.0), DVec3::ZERO, DVec3::Z, 30.0);
    let (mut same, mut differ, mut at_rest) = (0, 0, 0);
    let mut random = noise(3);
    for _ in 0..150 {
        let pixel = DVec2::new(60.0 * (1.0 + random()), 50.0 * (1.0 + random()));
        let found = skin.pick(&camera, pixel, SIZE).unwrap();
        let ray = camera.ray(pixel, SIZE);
        let unbent = Hit::closest(&surface.vertices, &triangles, ray).map(|h| kept[h.triangle]);
        at_rest += usize::from(unbent != found.map(|p| p.triangle));
        let truth = Hit::closest(&vertices, &triangles, ray);
        let (Some(pick), Some(hit)) = (found, truth) else {
            differ += usize::from(found.is_some() != truth.is_some());
            continue;
        };
        if pick.triangle != kept[hit.triangle] {
            differ += 1;
            continue;
        }
        same += 1;
        let point = ray.origin + pick.distance * ray.direction;
        assert!(point.distance(pick.point) < 1e-4, "{pick:?}");
        let corners = surface.triangles[pick.triangle];
        assert!(corners.contains(&pick.vertex));
        let away = |v: u32| vertices[v as usize].distance(pick.point);
        assert!(corners.iter().all(|v| away(pick.vertex) <= away(*v) + 1e-6));
        // Its node is one of those nearby.
        let node = bent[pick.node as usize].distance(pick.point);
        let nearest = bent
            .iter()
            .map(|p| p.distance(pick.point))
            .fold(f64::INFINITY, f64::min);
        assert!(node < nearest + 0.3, "{node} {nearest}");
    }
    println!("{same} the same, {differ} other, {at_rest} other at rest");
    assert!(same > 50 && differ <= 1, "{same} {differ}");
    assert!(at_rest > 20);
}
