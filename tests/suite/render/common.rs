//! Shared helpers of the render tests: devices, scenes, comparisons.

use glam::DVec3;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Location, TetMesh};
use palpate::render::ReferenceRaycaster;
use palpate::render::{
    Camera, Geometry, Image, Mode, RaycastOptions, Raycaster, Scalars, TransferFunction,
};

pub use crate::support::gpu;

/// Reads a real mesh, if the real data are present.
pub fn real_mesh(name: &str) -> Option<TetMesh> {
    Some(palpate::io::read(crate::support::real_data(name)?).unwrap())
}

/// Iterates over the real meshes that are present.
pub fn real_meshes() -> impl Iterator<Item = (&'static str, TetMesh)> {
    let found = |name: &&'static str| Some((*name, real_mesh(name)?));
    REAL_MESHES.iter().filter_map(found)
}

/// Iterates over generated meshes as diverse as the real ones: convex and not, with a duct, thin
/// limbs, and slivers.
pub fn made_meshes() -> impl Iterator<Item = (&'static str, TetMesh)> {
    let round = generate::Bore::Round;
    [
        (
            "duct",
            generate::duct([9, 9, 9], DVec3::new(1.0, 1.0, 1.5), round).unwrap(),
        ),
        ("limb", generate::by_name("limb", Some(6_000)).unwrap()),
        ("slivers", slivers()),
    ]
    .into_iter()
}

/// Returns a cube with a duct, its nodes perturbed so that many tets are nearly flat and none is
/// inverted.
pub fn slivers() -> TetMesh {
    let mut mesh = generate::benchmark_cube(9, true).unwrap();
    let mut random = Random::new(11);
    let mut around = vec![Vec::new(); mesh.nodes.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        tet.iter().for_each(|v| around[*v as usize].push(t));
    }
    let least = 0.03 * mesh.volume() / mesh.tets.len() as f64;
    for (v, tets) in around.iter().enumerate() {
        let before = mesh.nodes[v];
        // As far as the incident tets allow, with a margin.
        let mut shift = 0.09 * random.direction();
        mesh.nodes[v] = before + shift;
        while tets.iter().any(|t| mesh.tet_volume(*t) < least) {
            shift *= 0.9;
            mesh.nodes[v] = before + shift;
        }
    }
    mesh
}

/// Returns the values of a node field.
pub fn node_scalars(mesh: &TetMesh, name: &str) -> Vec<f64> {
    mesh.field(name, Location::Node).unwrap().values.clone()
}

/// Returns a smooth synthetic field for meshes without one: waves over the mesh's bounds.
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

/// Returns the transfer function of the comparison with VTK (`benches/peers/cube.py`).
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

/// Returns the camera of the comparison with VTK, before its first rotation.
pub fn peers_camera() -> Camera {
    let middle = DVec3::splat(0.5);
    Camera::perspective(middle + DVec3::new(1.3, 0.8, 2.0), middle, DVec3::Y, 30.0)
}

/// Returns the root mean square and 99.9th percentile of the differences, in 1/255.
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

/// A raycaster and the exact reference, for nodes at `positions`.
pub struct Scene {
    pub caster: Raycaster,
    pub truth: ReferenceRaycaster,
}

impl Scene {
    pub fn new<'a>(
        gpu: &Gpu,
        mesh: &TetMesh,
        positions: &[DVec3],
        scalars: impl Into<Scalars<'a>>,
        transfer: &TransferFunction,
        options: RaycastOptions,
    ) -> Scene {
        let scalars = scalars.into();
        let frame = palpate::mesh::LocalFrame::from_mesh(mesh);
        let array = palpate::render::local_positions(gpu, &frame, positions).unwrap();
        let topology = palpate::mesh::Topology::new(mesh);
        let geometry = Geometry::new(gpu, mesh, &topology, frame, &array, scalars).unwrap();
        Scene {
            caster: Raycaster::with_options(gpu, geometry, transfer, options).unwrap(),
            truth: match scalars {
                Scalars::Nodes(values) => ReferenceRaycaster::new(mesh, positions, values),
                Scalars::Cells(values) => {
                    ReferenceRaycaster::from_cell_scalars(mesh, positions, values)
                }
            },
        }
    }

    /// Returns the picture and its differences from the reference.
    pub fn compare(&mut self, camera: &Camera, size: [u32; 2]) -> (Image, f64, f64) {
        let image = self.caster.image(camera, size, Mode::Composite).unwrap();
        let transfer = self.caster.transfer();
        let truth = self.truth.render(camera, size, |reference, ray| {
            reference.composite(ray, &transfer)
        });
        let (rms, worst) = difference(&image, &truth);
        (image, rms, worst)
    }
}

/// Saves a picture for inspection.
pub fn keep(image: &Image, name: &str) {
    if let Ok(folder) = std::env::var("PALPATE_TEST_PICTURES") {
        image
            .save(std::path::Path::new(&folder).join(name))
            .unwrap();
    }
}

/// A deterministic stream of numbers from 0 to 1.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0;
            if v.length() > 0.1 && v.length() < 1.0 {
                return v.normalize();
            }
        }
    }
}

/// Names of real meshes.
const REAL_MESHES: [&str; 10] = [
    "tet/bullet_boot.vtk",
    "tet/bullet_ditto.vtk",
    "tet/chaste_ellipsoid_15811.node",
    "tet/gaia_liver.mesh",
    "tet/polyfem_cubes_v22.msh",
    "tet/polyfem_41_binary.msh",
    "tet/polyfem_Armadillo13K.msh",
    "tet/gaia_alligator.vtk",
    "scalar/disk_out_ref_tets.vtu",
    "scalar/chaste_heart_decimation.vtu",
];

/// Returns a smooth deformation of the mesh, as large as possible without inverted tets.
pub fn bent(mesh: &TetMesh) -> Vec<DVec3> {
    let (low, high) = mesh.bounds();
    let (middle, unit) = (0.5 * (low + high), (high - low).max_element());
    let mut amount = 0.25;
    for _ in 0..12 {
        let moved: Vec<DVec3> = mesh
            .nodes
            .iter()
            .map(|p| {
                let u = (*p - middle) / unit;
                let lift = DVec3::new(
                    (3.0 * u.y).sin() + 0.3 * u.z,
                    (2.0 * u.z + 0.5).sin(),
                    u.x * u.x + 0.4 * u.y,
                );
                *p + amount * unit * lift
            })
            .collect();
        let upright =
            |t: &[u32; 4]| palpate::mesh::signed_volume(t.map(|v| moved[v as usize])) > 0.0;
        if mesh.tets.iter().all(upright) {
            return moved;
        }
        amount *= 0.6;
    }
    panic!("every deformation inverts a tet");
}

/// Returns the intensities of the limb phantom.
pub fn limb_scalars(mesh: &TetMesh) -> Vec<f64> {
    let field = mesh
        .fields
        .iter()
        .find(|f| f.location == Location::Node && f.components == 1)
        .unwrap();
    field.values.clone()
}
