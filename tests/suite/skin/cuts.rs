//! Skins that open at cuts of their body.

use crate::skin::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::mesh::{Blade, LocalFrame, TetMesh, Topology, components, cut};
use palpate::render::{Camera, local_positions};
use palpate::skin::{Mapping, Skin, SkinBase};

/// Returns the bar under a fine skin, cut across at x = 4.2, and positions with the far half moved
/// away.
fn halves() -> (TetMesh, TetMesh, Vec<DVec3>, Blade) {
    let mesh = generate::bar([8, 2, 2], DVec3::new(8.0, 1.0, 1.0)).unwrap();
    let corner = |y: f64, z: f64| DVec3::new(4.2, y, z);
    let corners = [(-3.0, -3.0), (4.0, -3.0), (4.0, 4.0), (-3.0, 4.0)];
    let blade = Blade::from_quad(corners.map(|(y, z)| corner(y, z))).unwrap();
    let (mut parted, mut topology) = (mesh.clone(), Topology::new(&mesh));
    let done = cut(&mut parted, &mut topology, &mesh.nodes, &blade).unwrap();
    assert!(!done.is_empty());
    let (piece, pieces) = components(&topology);
    assert_eq!(pieces, 2);
    let mut moved = parted.nodes.clone();
    for (t, tet) in parted.tets.iter().enumerate() {
        if piece[t] == piece[parted.tets.len() - 1] {
            for v in tet {
                moved[*v as usize] = parted.nodes[*v as usize] + DVec3::new(2.0, 0.5, 0.0);
            }
        }
    }
    (mesh, parted, moved, blade)
}

#[test]
fn skin_follows_cut_halves_and_shows_cut_faces() {
    let gpu = gpu();
    let surface = bar().skin;
    let (mesh, parted, moved, blade) = halves();
    let frame = LocalFrame::from_mesh(&mesh);
    for mapping in [Mapping::Constant, Mapping::Interpolated, Mapping::Auto] {
        let positions = local_positions(&gpu, &frame, &mesh.nodes).unwrap();
        let carrier = SkinBase::from_mesh(&gpu, &mesh, &positions, frame).unwrap();
        let mut skin = Skin::new(&gpu, &surface, &carrier, mapping).unwrap();
        // Cut, but not yet separated.
        let positions = local_positions(&gpu, &frame, &parted.nodes).unwrap();
        let carrier = SkinBase::from_mesh(&gpu, &parted, &positions, frame).unwrap();
        let done = skin.apply_cut(&carrier, &blade).unwrap();
        let triangles = skin.rest().triangles.len();
        assert!(done.hidden > 50 && done.hidden < triangles / 20, "{done:?}");
        assert!(done.walls.len() > 10);
        let error = apart(&skin.vertices().unwrap(), &surface.vertices);
        assert!(error < 1e-5, "{mapping}: {error:e}");
        // Separated: each half as before, and nothing in between.
        let apart_now: Vec<[f32; 4]> = moved
            .iter()
            .map(|p| frame.to_local(*p).extend(1.0).to_array())
            .collect();
        gpu.write_array(&positions, &apart_now).unwrap();
        let placed = skin.skinned_vertices().unwrap();
        let step = DVec3::new(2.0, 0.5, 0.0);
        let (mut stayed, mut went) = (0, 0);
        for (p, rest) in placed.iter().zip(&skin.rest().positions) {
            let by = p.position - *rest;
            match by.length() < 0.5 * step.length() {
                true => stayed += usize::from(by.length() < 1e-4),
                false => went += usize::from(by.distance(step) < 1e-4),
            }
        }
        assert_eq!(stayed + went, placed.len());
        assert!(stayed.min(went) > placed.len() / 3);
        let stretched = |shown: &dyn Fn(usize) -> bool| {
            let all = skin.rest().triangles.iter().enumerate();
            all.filter(|(t, _)| shown(*t))
                .flat_map(|(_, [a, b, c])| [(*a, *b), (*b, *c), (*c, *a)])
                .map(|(v, w)| [v, w].map(|v| placed[v as usize].position))
                .filter(|[v, w]| v.distance(*w) > 1.0)
                .count()
        };
        assert_eq!(stretched(&|t| skin.shown()[t]), 0);
        // The hidden triangles are those that would span the gap.
        assert!(stretched(&|t| !skin.shown()[t]) >= done.hidden);
        // The walls are visible through the gap.
        let mut walls = Skin::body_surface(&gpu, &carrier, Some(&done.walls)).unwrap();
        let camera = Camera::perspective(
            DVec3::new(9.5, 4.0, 6.0),
            DVec3::new(4.5, 0.5, 0.5),
            DVec3::Z,
            30.0,
        );
        let image = walls.image(&camera, [64, 64]).unwrap();
        let lit = image.values.chunks(4).filter(|p| p[3] == 1.0).count();
        assert!(lit > 50, "{lit}");
    }
}

#[test]
fn body_surface_renders_without_skin() {
    let gpu = gpu();
    let ball = generate::ball(1.0, 8).unwrap();
    let frame = LocalFrame::from_mesh(&ball);
    let positions = local_positions(&gpu, &frame, &ball.nodes).unwrap();
    let carrier = SkinBase::from_mesh(&gpu, &ball, &positions, frame).unwrap();
    let mut bare = Skin::body_surface(&gpu, &carrier, None).unwrap();
    let placed = bare.skinned_vertices().unwrap();
    for (p, v) in placed.iter().zip(&bare.rest().sources) {
        assert!(p.position.distance(ball.nodes[*v as usize]) < 1e-6);
        assert!(p.normal.dot(p.position.normalize()) > 0.9);
    }
    let camera = Camera::fit_mesh(&ball);
    let image = bare.image(&camera, [32, 32]).unwrap();
    assert!(image.pixel(16, 16)[3] == 1.0 && image.pixel(0, 0)[3] == 0.0);
    assert!(Skin::body_surface(&gpu, &carrier, Some(&[])).is_err());
    assert!(Skin::body_surface(&gpu, &carrier, Some(&[[0, 1, 999_999]])).is_err());
}

#[test]
fn apply_cut_rejects_base_of_other_body() {
    let gpu = gpu();
    let scene = bar();
    let (carrier, _) = scene.carrier(&gpu, &scene.rest);
    let mut skin = Skin::new(&gpu, &scene.skin, &carrier, Mapping::Auto).unwrap();
    let other = scenes().remove(0);
    let (other, _) = other.carrier(&gpu, &other.rest);
    let (.., blade) = halves();
    let refused = skin.apply_cut(&other, &blade).unwrap_err().to_string();
    assert!(refused.contains("local frame"));
    // A blade that hits nothing changes nothing.
    let far = [(90.0, 0.0), (90.0, 1.0), (91.0, 1.0), (91.0, 0.0)];
    let far = Blade::from_quad(far.map(|(x, y)| DVec3::new(x, y, 0.0))).unwrap();
    let done = skin.apply_cut(&carrier, &far).unwrap();
    assert_eq!(
        (done.rebound_vertices, done.hidden, done.walls.len()),
        (0, 0, 0)
    );
}
