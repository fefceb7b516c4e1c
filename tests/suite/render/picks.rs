//! Picks on the GPU against intersection with every face in float64; and grabs from picks.

use crate::render::common::*;
use glam::{DMat3, DVec2, DVec3};
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, FACES, LocalFrame, TetMesh, Topology};
use palpate::mesher::{ClosedSurface, SurfaceDomain};
use palpate::physics::grid::{GridModel, GridShape};
use palpate::physics::{GpuBody, GrabMode, GridBody, ImplicitEuler, Material, Solver};
use palpate::render::Hit;
use palpate::render::{Camera, Geometry, Pick, local_positions};

const SIZE: [u32; 2] = [160, 120];

/// Returns the boundary as triangles, with tet and face of each.
fn boundary(mesh: &TetMesh, topology: &Topology) -> (Vec<[u32; 3]>, Vec<(u32, u32)>) {
    let faces = topology.boundary.iter();
    let corners = |f| topology.boundary_nodes(mesh, f);
    faces.map(|f| (corners(*f), (f.tet, f.face))).unzip()
}

/// Comparison of picks with the reference.
#[derive(Default, Debug)]
struct Tally {
    hits: usize,
    misses: usize,
    /// Hit by one and missed by the other, or another face.
    differ: usize,
    /// Of these, those without an edge of a face within `NEAR` of the ray.
    wrong: usize,
    /// Maximum distance of a picked point from the ray, for equal faces, in units of the body size.
    apart: f64,
}

/// Rays pass up to 0.61/256 of a pixel from its centre, i.e. at most 2e-6 of the body size at its
/// distance; more at larger distances, plus rounding to 32 bits. A pixel is about 1e-2.
const NEAR: f64 = 3e-5;

impl Tally {
    fn count(
        &mut self,
        found: Option<Pick>,
        camera: &Camera,
        pixel: DVec2,
        nodes: &[DVec3],
        faces: &(Vec<[u32; 3]>, Vec<(u32, u32)>),
    ) {
        let (low, high) = palpate::mesh::bounds(nodes);
        let size = (high - low).max_element();
        let ray = camera.ray(pixel, SIZE);
        let truth = Hit::closest(nodes, &faces.0, ray);
        match (found, truth) {
            (None, None) => self.misses += 1,
            (Some(pick), Some(hit)) if faces.1[hit.triangle] == (pick.tet, pick.face) => {
                self.hits += 1;
                let to = pick.point - ray.origin;
                let beside = to.cross(ray.direction).length();
                self.apart = self.apart.max(beside / size);
                assert_eq!(pick.nodes, faces.0[hit.triangle]);
                let corners = pick.nodes.map(|v| nodes[v as usize]);
                let sum: DVec3 = (0..3).map(|k| pick.weights[k] * corners[k]).sum();
                assert!(sum.distance(pick.point) < 1e-6 * size);
                let nearest = corners.map(|p| p.distance(pick.point));
                let own = nodes[pick.node as usize].distance(pick.point);
                assert!(pick.nodes.contains(&pick.node));
                assert!(nearest.iter().all(|d| own <= d + 1e-6 * size));
            }
            _ => {
                self.differ += 1;
                // One of the rays with small offsets hits the picked face.
                let aside = ray.direction.any_orthonormal_vector();
                let other = ray.direction.cross(aside);
                let code = found.map(|p| (p.tet, p.face));
                let near = (0..8).any(|k| {
                    let turn = std::f64::consts::TAU * f64::from(k) / 8.0;
                    let off = NEAR * size * (turn.cos() * aside + turn.sin() * other);
                    let ray = palpate::render::Ray {
                        origin: ray.origin + off,
                        ..ray
                    };
                    Hit::closest(nodes, &faces.0, ray).map(|h| faces.1[h.triangle]) == code
                });
                self.wrong += usize::from(!near);
            }
        }
    }
}

/// Returns a bar bent into a horseshoe: many rays hit it twice.
fn horseshoe() -> (TetMesh, Vec<DVec3>) {
    let mesh = generate::bar([32, 4, 4], DVec3::new(8.0, 1.0, 1.0)).unwrap();
    let bend = |p: &DVec3| {
        let (turn, radius) = (0.55 * (p.x - 4.0), 1.6 + p.y);
        DVec3::new(radius * turn.sin(), radius * turn.cos(), p.z + 0.2 * p.x)
    };
    let bent = mesh.nodes.iter().map(bend).collect();
    (mesh, bent)
}

fn cameras(middle: DVec3) -> [Camera; 4] {
    let aside = DVec3::new(7.0, -3.0, 4.0);
    let up = DVec3::Z;
    [
        Camera::perspective(middle + aside, middle, up, 34.0),
        Camera::orthographic(middle + aside, middle, up, 5.0),
        Camera::perspective(middle + 3000.0 * aside, middle, up, 0.011),
        // Between the arms, and so close that parts lie behind it.
        Camera::perspective(middle + DVec3::new(0.4, -1.4, 0.1), middle, up, 80.0),
    ]
}

#[test]
fn pick_on_deformed_body_returns_first_hit() {
    // A separate device: read-backs are counted.
    let gpu = palpate::gpu::Gpu::new().unwrap();
    let (mesh, bent) = horseshoe();
    let topology = Topology::new(&mesh);
    let frame = LocalFrame::from_mesh(&mesh);
    let positions = local_positions(&gpu, &frame, &bent).unwrap();
    let scalars = waves(&mesh);
    let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &scalars).unwrap();
    let faces = boundary(&mesh, &topology);
    let (low, high) = palpate::mesh::bounds(&bent);
    let mut random = Random::new(5);
    for camera in cameras(0.5 * (low + high)) {
        let (mut tally, mut at_rest) = (Tally::default(), Tally::default());
        let (mut on_processor, mut same) = (Tally::default(), 0);
        for _ in 0..250 {
            let pixel = DVec2::new(random.between(0.0, 160.0), random.between(0.0, 120.0));
            let before = gpu.readbacks();
            let found = geometry.pick(&camera, pixel, SIZE).unwrap();
            assert_eq!(gpu.readbacks(), before + 1);
            if let Some(pick) = found {
                let ray = camera.ray(pixel, SIZE);
                let along = (pick.point - ray.origin).dot(ray.direction);
                assert!((pick.distance - along).abs() < 1e-12 * along);
            }
            tally.count(found, &camera, pixel, &bent, &faces);
            at_rest.count(None, &camera, pixel, &mesh.nodes, &faces);
            let there = geometry
                .pick_positions(&bent, &camera, pixel, SIZE)
                .unwrap();
            assert_eq!(gpu.readbacks(), before + 1);
            same += usize::from(there.map(|p| (p.tet, p.face)) == found.map(|p| (p.tet, p.face)));
            on_processor.count(there, &camera, pixel, &bent, &faces);
        }
        println!("{tally:?}");
        assert!(tally.hits > 50, "{tally:?}");
        assert!(tally.wrong == 0 && tally.differ <= 3, "{tally:?}");
        assert!(tally.apart < NEAR, "{tally:?}");
        // The CPU pick is in float64.
        assert!(
            same >= 247 && on_processor.apart < 1e-9,
            "{same} {on_processor:?}"
        );
        assert!(
            on_processor.wrong == 0 && on_processor.differ == 0,
            "{on_processor:?}"
        );
        // The comparison is effective: the body at rest gives other picks.
        assert!(at_rest.wrong > 10, "{at_rest:?}");
    }
}

#[test]
fn adjacent_pixel_picks_different_point() {
    let gpu = gpu();
    let (mesh, bent) = horseshoe();
    let topology = Topology::new(&mesh);
    let frame = LocalFrame::from_mesh(&mesh);
    let positions = local_positions(&gpu, &frame, &bent).unwrap();
    let scalars = waves(&mesh);
    let geometry = Geometry::new(&gpu, &mesh, &topology, frame, &positions, &scalars).unwrap();
    let faces = boundary(&mesh, &topology);
    let camera = cameras(DVec3::new(0.0, 1.0, 1.3))[0];
    let mut tally = Tally::default();
    for i in 0..100 {
        let pixel = DVec2::new(40.5 + 0.8 * f64::from(i), 60.5);
        let found = geometry.pick(&camera, pixel + DVec2::X, SIZE).unwrap();
        tally.count(found, &camera, pixel, &bent, &faces);
    }
    assert!(tally.wrong > 0 && tally.apart > 1e-3, "{tally:?}");
    for bad in [DVec2::new(-1.0, 3.0), DVec2::new(3.0, 121.0), DVec2::NAN] {
        assert!(geometry.pick(&camera, bad, SIZE).is_err());
        assert!(geometry.pick_positions(&bent, &camera, bad, SIZE).is_err());
    }
}

#[test]
fn pick_from_inside_hits_back_face() {
    let gpu = gpu();
    let mesh = generate::bar([6, 6, 6], DVec3::splat(1.0)).unwrap();
    let scalars = waves(&mesh);
    let geometry = Geometry::at_rest(&gpu, &mesh, &scalars).unwrap();
    let eye = DVec3::splat(0.52);
    let camera = Camera::perspective(eye, DVec3::new(1.0, 0.6, 0.6), DVec3::Z, 60.0);
    let middle = DVec2::new(80.0, 60.0);
    let found = geometry.pick(&camera, middle, SIZE).unwrap().unwrap();
    assert!((found.point.x - 1.0).abs() < 1e-6, "{found:?}");
    let face = FACES[found.face as usize].map(|k| mesh.tets[found.tet as usize][k]);
    assert_eq!(face, found.nodes);
}

/// Returns the point of `pick` on the body at `nodes`.
fn on(pick: &Pick, nodes: &[DVec3]) -> DVec3 {
    (0..3)
        .map(|k| pick.weights[k] * nodes[pick.nodes[k] as usize])
        .sum()
}

#[test]
fn cut_face_is_picked_and_grabbed() {
    let gpu = gpu();
    let mut mesh = generate::bar([12, 6, 6], DVec3::new(0.12, 0.06, 0.06)).unwrap();
    let mut topology = Topology::new(&mesh);
    let mut body = GpuBody::new(&gpu, &mesh, &Material::from_young(2e4)).unwrap();
    body.pin(|p| p.x < 0.001);
    body.add_force(DVec3::new(0.5, 0.0, 0.0), |p| p.x > 0.119)
        .unwrap();
    let frame = body.nodes().frame();
    let scalars = waves(&mesh);
    let positions = body.nodes().array();
    let mut geometry = Geometry::new(&gpu, &mesh, &topology, frame, positions, &scalars).unwrap();
    let edge = |z: f64| [DVec3::new(0.05, -0.1, z), DVec3::new(0.07, 0.2, z)];
    let blade = Blade::from_sweep(&[edge(0.1), edge(-0.1)]).unwrap();
    let cut = body.cut(&mut mesh, &mut topology, &blade).unwrap();
    let scalars = waves(&mesh);
    let positions = body.nodes().array();
    geometry
        .apply_cut(&mesh, &topology, &cut, positions, &scalars)
        .unwrap();
    let mut solver = ImplicitEuler::new(&gpu, &body).unwrap();
    solver.run(&mut body, 20, 0.005).unwrap();

    // Into the gap, onto the wall of the fixed piece.
    let nodes = body.positions().unwrap();
    let middle = DVec3::new(0.06, 0.03, 0.03);
    let camera = Camera::perspective(middle + DVec3::new(0.2, -0.2, 0.2), middle, DVec3::Z, 24.0);
    let faces = boundary(&mesh, &topology);
    let (mut tally, mut walls) = (Tally::default(), Vec::new());
    for y in 0..24 {
        for x in 0..32 {
            let pixel = DVec2::new(5.0 * f64::from(x) + 2.5, 5.0 * f64::from(y) + 2.5);
            let found = geometry.pick(&camera, pixel, SIZE).unwrap();
            tally.count(found, &camera, pixel, &nodes, &faces);
            let is_wall = |p: &Pick| {
                p.nodes
                    .iter()
                    .all(|v| cut.duplicated_nodes.iter().any(|d| d.contains(v)))
            };
            walls.extend(found.filter(is_wall));
        }
    }
    println!("{tally:?}, {} on the cut face", walls.len());
    assert!(tally.wrong == 0 && tally.hits > 100, "{tally:?}");
    assert!(walls.len() > 10);

    let wall = walls[walls.len() / 2];
    let hand = body.grab(wall.point, 0.012, GrabMode::Follow).unwrap();
    let pulled = wall.point + DVec3::new(0.0, -0.02, 0.01);
    body.set_target(hand, pulled).unwrap();
    solver.run(&mut body, 5, 0.005).unwrap();
    let now = body.positions().unwrap()[wall.node as usize];
    let expected = nodes[wall.node as usize] + (pulled - wall.point);
    assert!(now.distance(expected) < 1e-6, "{now} {expected}");
    // The same pixel now shows another place; the point on the wall is at or near the target.
    let moved = on(&wall, &body.positions().unwrap());
    assert!(moved.distance(pulled) < 0.01, "{moved} {pulled}");
}

fn grid(gpu: &Gpu) -> GridBody {
    let ball = generate::ball(1.0, 8)
        .unwrap()
        .boundary_surface(None)
        .unwrap();
    let domain = SurfaceDomain::new(vec![ClosedSurface::new(&ball).unwrap()]).unwrap();
    let shape = GridShape::from_domain_with_count(&domain, 2_000, DMat3::IDENTITY).unwrap();
    let model = GridModel::new(shape, &Material::from_young(5e3)).unwrap();
    GridBody::new(gpu, model).unwrap()
}

#[test]
fn picked_grid_particle_follows_grab() {
    let gpu = gpu();
    let mut body = grid(&gpu);
    let mesh = body.mesh().clone();
    let topology = Topology::new(&mesh);
    let (positions, frame) = (body.nodes().array(), body.nodes().frame());
    let scalars = waves(&mesh);
    let geometry = Geometry::new(&gpu, &mesh, &topology, frame, positions, &scalars).unwrap();
    let dt = 0.5 * body.model().conservative_step();
    let squashed: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| *p * DVec3::new(0.8, 1.2, 0.9))
        .collect();
    body.set_positions(&squashed).unwrap();
    body.run(20, dt).unwrap();
    let nodes = body.positions().unwrap();
    let faces = boundary(&mesh, &topology);
    let camera = Camera::perspective(DVec3::new(3.0, -4.0, 2.0), DVec3::ZERO, DVec3::Z, 32.0);
    let mut random = Random::new(9);
    let (mut tally, mut last) = (Tally::default(), None);
    for _ in 0..150 {
        let pixel = DVec2::new(random.between(0.0, 160.0), random.between(0.0, 120.0));
        let found = geometry.pick(&camera, pixel, SIZE).unwrap();
        tally.count(found, &camera, pixel, &nodes, &faces);
        last = found.or(last);
    }
    assert!(tally.wrong == 0 && tally.hits > 30, "{tally:?}");
    let pick = last.unwrap();
    let hand = body.grab(pick.point, 0.3, GrabMode::Follow).unwrap();
    let away = DVec3::new(0.2, 0.1, -0.1);
    body.set_target(hand, pick.point + away).unwrap();
    body.run(5, dt).unwrap();
    let now = body.positions().unwrap()[pick.node as usize];
    let error = now.distance(nodes[pick.node as usize] + away);
    assert!(error < 1e-6, "{error:e}");
}
