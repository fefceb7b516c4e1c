//! What the render tests share: devices, scenes, comparisons.

use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::mesh::{Location, TetMesh};
use palpate::reference::RayReference;
use palpate::render::{Camera, Geometry, Image, Mode, RaycastOptions, Raycaster, TransferFunction};

/// The device of the tests; there is always one, or the test fails.
pub fn gpu() -> Gpu {
    Gpu::new().unwrap()
}

/// Reads a mesh of `../shared/data`.
pub fn shared(name: &str) -> TetMesh {
    let path =
        std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")).join(name);
    assert!(
        path.exists(),
        "{} is absent: these tests read it",
        path.display()
    );
    palpate::io::read(&path).unwrap()
}

/// The values of a node field.
pub fn node_scalars(mesh: &TetMesh, name: &str) -> Vec<f64> {
    mesh.field(name, Location::Node).unwrap().values.clone()
}

/// A smooth made-up field for meshes without one: waves over the mesh's bounds.
pub fn waves(mesh: &TetMesh) -> Vec<f64> {
    let (low, high) = mesh.bounds();
    let unit = (high - low).max_element();
    mesh.nodes
        .iter()
        .map(|p| {
            let u = (*p - low) / unit;
            0.5 + 0.25 * ((7.0 * u.x).sin() * (5.0 * u.y).cos() + (6.0 * u.z + 2.0 * u.x).sin())
        })
        .collect()
}

/// The transfer function of `../shared/peers/render/bench_vtk.py`.
pub fn peers_transfer() -> TransferFunction {
    TransferFunction::new(
        vec![
            [0.0, 0.1, 0.1, 0.8],
            [0.5, 0.1, 0.9, 0.3],
            [1.0, 0.9, 0.2, 0.1],
        ],
        vec![
            [0.0, 0.0],
            [0.45, 0.0],
            [0.55, 3.5],
            [0.65, 0.5],
            [1.0, 8.0],
        ],
    )
    .unwrap()
}

/// The camera of `../shared/peers/render/bench_vtk.py`, before its first turn.
pub fn peers_camera() -> Camera {
    let middle = DVec3::splat(0.5);
    Camera::perspective(middle + DVec3::new(1.3, 0.8, 2.0), middle, DVec3::Y, 30.0)
}

/// Root mean square and 99.9th percentile of the differences, in 255ths.
pub fn difference(image: &Image, truth: &[[f64; 4]]) -> (f64, f64) {
    let mut errors: Vec<f64> = image
        .values
        .iter()
        .zip(truth.iter().flatten())
        .map(|(a, b)| 255.0 * (f64::from(*a) - b).abs())
        .collect();
    assert_eq!(errors.len(), truth.len() * 4);
    assert!(errors.iter().all(|e| e.is_finite()));
    let square: f64 = errors.iter().map(|e| e * e).sum();
    let rms = (square / errors.len() as f64).sqrt();
    errors.sort_by(f64::total_cmp);
    (rms, errors[errors.len() * 999 / 1000])
}

/// A raycaster and the exact one, for nodes at `positions`.
pub struct Scene {
    pub caster: Raycaster,
    pub truth: RayReference,
}

impl Scene {
    pub fn new(
        gpu: &Gpu,
        mesh: &TetMesh,
        positions: &[DVec3],
        scalars: &[f64],
        transfer: &TransferFunction,
        options: RaycastOptions,
    ) -> Scene {
        let frame = palpate::mesh::LocalFrame::of_mesh(mesh);
        let array = palpate::render::local_positions(gpu, &frame, positions).unwrap();
        let topology = palpate::mesh::Topology::new(mesh);
        let geometry = Geometry::new(gpu, mesh, &topology, frame, &array, scalars).unwrap();
        Scene {
            caster: Raycaster::with_options(gpu, geometry, transfer, options).unwrap(),
            truth: RayReference::new(mesh, positions, scalars),
        }
    }

    /// The picture and its differences from the truth.
    pub fn compare(&mut self, camera: &Camera, size: [u32; 2]) -> (Image, f64, f64) {
        let image = self.caster.image(camera, size, Mode::Composite).unwrap();
        let transfer = self.caster.transfer();
        let truth = self.truth.picture(camera, size, |reference, ray| {
            reference.composite(ray, &transfer)
        });
        let (rms, worst) = difference(&image, &truth);
        (image, rms, worst)
    }
}

/// Where pictures of failing (and other) tests can be looked at.
pub fn keep(image: &Image, name: &str) {
    if let Ok(folder) = std::env::var("PALPATE_TEST_PICTURES") {
        image
            .save(std::path::Path::new(&folder).join(name))
            .unwrap();
    }
}
