//! Rendering of cuts: the gap is visible, and the picture equals that of a mesh cut beforehand.

use crate::render::common::*;
use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Blade, TetMesh, Topology, cut, remove};
use palpate::physics::{GpuBody, ImplicitEuler, Material, Solver};
use palpate::render::*;

/// Returns a square blade about `centre` perpendicular to `normal`, of half-width `half`.
fn across(centre: DVec3, normal: DVec3, half: f64) -> Blade {
    let u = half * normal.any_orthonormal_vector();
    let v = normal.cross(u);
    Blade::from_quad([
        centre - u - v,
        centre + u - v,
        centre + u + v,
        centre - u + v,
    ])
    .unwrap()
}

fn volume(mesh: &TetMesh, positions: &[DVec3]) -> f64 {
    let volumes = mesh
        .tets
        .iter()
        .map(|t| palpate::mesh::signed_volume(t.map(|v| positions[v as usize])));
    volumes.sum()
}

#[test]
#[ignore = "long: scripts/test --full"]
fn cut_gap_opens_and_thickness_integral_equals_volume() {
    let gpu = gpu();
    let mut mesh = generate::bar([12, 6, 6], DVec3::new(0.12, 0.06, 0.06)).unwrap();
    let mut topology = Topology::new(&mesh);
    let mut body = GpuBody::new(&gpu, &mesh, &Material::uniform_springs(3_000.0, 1.0)).unwrap();
    body.add_force(DVec3::new(-1.0, 0.0, 0.0), |p| p.x < 0.001)
        .unwrap();
    body.add_force(DVec3::new(1.0, 0.0, 0.0), |p| p.x > 0.119)
        .unwrap();
    let mut solver = ImplicitEuler::new(&gpu, &body).unwrap();
    solver.run(&mut body, 20, 0.005).unwrap();
    let caster = |mesh: &TetMesh, topology: &Topology, body: &GpuBody| {
        let (positions, frame) = (body.nodes().array(), body.nodes().frame());
        let scalars = waves(mesh);
        let geometry = Geometry::new(&gpu, mesh, topology, frame, positions, &scalars).unwrap();
        Raycaster::new(&gpu, geometry, &peers_transfer()).unwrap()
    };
    let mut raycaster = caster(&mesh, &topology, &body);
    let mut ignorant = caster(&mesh, &topology, &body);
    // From the side, slightly oblique.
    let middle = DVec3::new(0.06, 0.03, 0.03);
    let away = DVec3::new(0.02, -1.0, 0.03).normalize();
    let camera = Camera::orthographic(middle + away, middle, DVec3::Z, 0.3);
    let size = [512, 512];
    let thickness = |caster: &mut Raycaster, mesh: &TetMesh, body: &GpuBody| -> Vec<f32> {
        let image = caster.image(&camera, size, Mode::Thickness).unwrap();
        let pixel = (0.3 / f64::from(size[1])).powi(2);
        let sum: f64 = image.values.iter().map(|v| f64::from(*v)).sum();
        let ratio = sum * pixel / volume(mesh, &body.positions().unwrap());
        assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
        image.values
    };
    let uncut = thickness(&mut raycaster, &mesh, &body);

    let blade = across(middle, DVec3::new(1.0, 0.0, 0.25).normalize(), 0.2);
    let done = body.cut(&mut mesh, &mut topology, &blade).unwrap();
    assert!(
        done.duplicated_nodes.len() >= 49,
        "{}",
        done.duplicated_nodes.len()
    );
    let positions = body.nodes().array();
    let scalars = waves(&mesh);
    let geometry = raycaster.geometry_mut();
    geometry
        .apply_cut(&mesh, &topology, &done, positions, &scalars)
        .unwrap();
    // Nothing has moved yet: the cut exists, but is closed.
    let closed = thickness(&mut raycaster, &mesh, &body);
    let apart = uncut
        .iter()
        .zip(&closed)
        .filter(|(a, b)| (**a - **b).abs() > 1e-5);
    assert!(apart.count() < 10);
    assert_eq!(raycaster.report(&camera, size).unwrap().lost_rays, 0);

    solver.run(&mut body, 30, 0.005).unwrap();
    let open = thickness(&mut raycaster, &mesh, &body);
    let gap = |now: &[f32]| {
        // The empty pixels between the first and the last covered one of each row.
        let rows = now
            .chunks_exact(size[0] as usize)
            .zip(uncut.chunks_exact(size[0] as usize));
        rows.map(|(now, uncut)| {
            let covered = |x: &usize| now[*x] > 0.0;
            let first = (0..now.len()).find(covered).unwrap_or(0);
            let last = (0..now.len()).rev().find(covered).unwrap_or(0);
            (first..last)
                .filter(|x| now[*x] == 0.0 && uncut[*x] > 0.0)
                .count()
        })
        .sum::<usize>()
    };
    println!("{} pixels of gap", gap(&open));
    assert!(gap(&open) >= 100);
    assert_eq!(raycaster.report(&camera, size).unwrap().lost_rays, 0);
    let image = raycaster.image(&camera, size, Mode::Composite).unwrap();
    keep(&image, "gap.png");
    // A renderer without the update for the cut still draws the tets as they were.
    let stale = ignorant.image(&camera, size, Mode::Thickness).unwrap();
    assert_eq!(gap(&stale.values), 0);
}

/// Pictures in all modes of rendering a geometry: both traversals and the surface.
struct Pictures {
    casters: [Raycaster; 2],
    surface: Surface,
    camera: Camera,
}

impl Pictures {
    fn new(
        gpu: &Gpu,
        mesh: &TetMesh,
        positions: &[DVec3],
        frame: palpate::mesh::LocalFrame,
    ) -> Pictures {
        let topology = Topology::new(mesh);
        let array = local_positions(gpu, &frame, positions).unwrap();
        let scalars = waves(mesh);
        let casters = [Traversal::Vertices, Traversal::Planes].map(|walk| {
            let geometry = Geometry::new(gpu, mesh, &topology, frame, &array, &scalars).unwrap();
            let options = RaycastOptions {
                walk,
                ..Default::default()
            };
            Raycaster::with_options(gpu, geometry, &peers_transfer(), options).unwrap()
        });
        let colour = SurfaceColour::Field(TransferFunction::preset("viridis").unwrap());
        let geometry = casters[0].geometry();
        let surface = Surface::new(gpu, geometry, &scalars, &colour, Shading::Smooth).unwrap();
        Pictures {
            casters,
            surface,
            camera: Camera::perspective(DVec3::new(2.0, 1.5, 2.5), DVec3::ZERO, DVec3::Y, 40.0),
        }
    }

    fn all(&mut self) -> [Image; 3] {
        let (camera, size) = (&self.camera, [96, 96]);
        let mut caster = |k: usize| {
            self.casters[k]
                .image(camera, size, Mode::Composite)
                .unwrap()
        };
        [
            caster(0),
            caster(1),
            self.surface.image(camera, size).unwrap(),
        ]
    }

    /// Applies a cut, at `positions` of the current mesh.
    fn follow(
        &mut self,
        gpu: &Gpu,
        mesh: &TetMesh,
        topology: &Topology,
        cut: &palpate::mesh::TetCut,
        positions: &[DVec3],
    ) {
        let frame = self.casters[0].geometry().frame();
        let array = local_positions(gpu, &frame, positions).unwrap();
        let scalars = waves(mesh);
        for caster in &mut self.casters {
            let geometry = caster.geometry_mut();
            geometry
                .apply_cut(mesh, topology, cut, &array, &scalars)
                .unwrap();
        }
        self.surface
            .follow(self.casters[0].geometry(), &scalars)
            .unwrap();
    }
}

/// Moves every node towards the centre of its tets, so that every cut opens.
fn drawn_in(mesh: &TetMesh) -> Vec<DVec3> {
    let mut middles = vec![(DVec3::ZERO, 0.0); mesh.nodes.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        let centroid = mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        for v in tet {
            middles[*v as usize].0 += centroid;
            middles[*v as usize].1 += 1.0;
        }
    }
    let nodes = mesh.nodes.iter().zip(&middles);
    nodes
        .map(|(p, (sum, count))| {
            if *count > 0.0 {
                p.lerp(*sum / *count, 0.3)
            } else {
                *p
            }
        })
        .collect()
}

#[test]
#[ignore = "long: scripts/test --full"]
fn cut_geometry_equals_new_geometry() {
    let gpu = gpu();
    let mut mesh = generate::ball(1.0, 7).unwrap();
    let mut topology = Topology::new(&mesh);
    let frame = palpate::mesh::LocalFrame::from_mesh(&mesh);
    let mut following = Pictures::new(&gpu, &mesh, &drawn_in(&mesh), frame);
    let mut last = following.all();
    let normals = [
        DVec3::X,
        DVec3::new(0.1, 1.0, 0.2),
        DVec3::new(0.5, 0.1, -1.0),
    ];
    for round in 0..5 {
        let rest = mesh.nodes.clone();
        let done = match normals.get(round) {
            Some(normal) => {
                // The first ends inside the ball.
                let half = if round == 0 { 0.6 } else { 3.0 };
                let blade = across(0.1 * DVec3::ONE, normal.normalize(), half);
                cut(&mut mesh, &mut topology, &rest, &blade).unwrap()
            }
            None => {
                let tets: Vec<u32> = (0..mesh.tets.len() as u32).filter(|t| t % 7 < 2).collect();
                remove(&mut mesh, &mut topology, &tets).unwrap()
            }
        };
        assert!(!done.is_empty());
        let positions = drawn_in(&mesh);
        following.follow(&gpu, &mesh, &topology, &done, &positions);
        let pictures = following.all();
        let mut fresh = Pictures::new(&gpu, &mesh, &positions, frame);
        for (k, (a, b)) in pictures.iter().zip(fresh.all()).enumerate() {
            assert!(a.values == b.values, "round {round}, picture {k}");
            assert!(
                a.values != last[k].values,
                "round {round}: the cut shows in picture {k}"
            );
        }
        last = pictures;
    }
}

#[test]
fn apply_cut_rejects_cut_of_other_mesh() {
    let gpu = gpu();
    let mut mesh = generate::ball(1.0, 5).unwrap();
    let mut geometry = Geometry::at_rest(&gpu, &mesh, &waves(&mesh)).unwrap();
    let mut topology = Topology::new(&mesh);
    let mut done = Vec::new();
    for x in [-0.3, 0.3] {
        let positions = mesh.nodes.clone();
        let blade = across(DVec3::X * x, DVec3::X, 3.0);
        done.push(cut(&mut mesh, &mut topology, &positions, &blade).unwrap());
    }
    let scalars = waves(&mesh);
    let positions = local_positions(&gpu, &geometry.frame(), &mesh.nodes).unwrap();
    // The second without the first.
    let error = geometry
        .apply_cut(&mesh, &topology, &done[1], &positions, &scalars)
        .unwrap_err();
    assert!(error.to_string().contains("every cut in order"), "{error}");
    let cells = vec![1.0; mesh.tets.len()];
    assert!(
        geometry
            .apply_cut(
                &mesh,
                &topology,
                &done[0],
                &positions,
                Scalars::Cells(&cells)
            )
            .is_err()
    );
}
