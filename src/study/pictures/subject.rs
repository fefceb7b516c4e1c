//! What the study of pictures draws: five bodies, each through a smooth and a spiky transfer
//! function, or a scene of the user's.

use crate::gpu::Gpu;
use crate::mesh::signed_volume;
use crate::mesh::{LocalFrame, Location, TetMesh, Topology, bounds, depth_field, generate};
use crate::render::RayReference;
use crate::render::{
    Camera, Geometry, Image, RaycastOptions, Raycaster, Scalars, TransferFunction, local_positions,
};
use crate::scene::Stage;
use crate::study::bodies;
use crate::{Error, Result};
use glam::DVec3;
use std::path::Path;

/// A body of the study: its name, and the field that is seen.
struct Source {
    name: &'static str,
    field: Option<&'static str>,
}

const SOURCES: [Source; 5] = [
    Source {
        name: "duct",
        field: None,
    },
    Source {
        name: "limb",
        field: Some("intensity"),
    },
    Source {
        name: "hollow",
        field: Some("distance"),
    },
    Source {
        name: "ring",
        field: Some("heat"),
    },
    Source {
        name: "foot",
        field: None,
    },
];

/// The transfer functions of the study.
pub(super) const TRANSFERS: [&str; 2] = ["smooth", "spiky"];

/// Smooth: broad ramps. Spiky: three thin shells and nothing between them, which point samples
/// miss.
fn transfer(name: &str) -> Result<TransferFunction> {
    if name == "smooth" {
        let colour = vec![
            [0.0, 0.15, 0.3, 0.8],
            [0.5, 0.9, 0.8, 0.6],
            [1.0, 0.8, 0.2, 0.1],
        ];
        return TransferFunction::relative(colour, vec![[0.0, 1.5], [1.0, 9.0]]);
    }
    let colour = vec![
        [0.0, 0.2, 0.4, 0.9],
        [0.35, 0.2, 0.4, 0.9],
        [0.35, 0.95, 0.75, 0.2],
        [0.6, 0.95, 0.75, 0.2],
        [0.6, 0.9, 0.2, 0.15],
    ];
    let mut extinction = vec![[0.0, 0.0]];
    for (middle, peak) in [(0.22, 60.0), (0.48, 120.0), (0.74, 240.0)] {
        extinction.extend([[middle - 0.012, 0.0], [middle, peak], [middle + 0.012, 0.0]]);
    }
    TransferFunction::relative(colour, extinction)
}

/// A body, where it stands, and how it is seen.
pub(super) struct Subject {
    mesh: TetMesh,
    positions: Vec<DVec3>,
    scalars: Vec<f64>,
    /// One scalar a tet, where those are seen.
    cells: Option<Vec<f64>>,
    camera: Camera,
    transfer: TransferFunction,
}

/// The names of the bodies.
pub(super) fn names(quick: bool) -> Vec<&'static str> {
    let few = if quick { 1 } else { SOURCES.len() };
    SOURCES.iter().take(few).map(|s| s.name).collect()
}

impl Source {
    fn mesh(&self) -> Result<TetMesh> {
        match self.name {
            "duct" => generate::duct(
                [12, 12, 12],
                DVec3::new(1.0, 1.0, 1.5),
                generate::Bore::Round,
            ),
            "hollow" => bodies::hollow(),
            "ring" => bodies::ring(),
            name => generate::by_name(name, Some(40_000)),
        }
    }
}

impl Subject {
    /// The body `name` through the transfer function `through`.
    pub fn new(name: &str, through: &str) -> Result<Subject> {
        let source = SOURCES.iter().find(|s| s.name == name);
        let source = source.ok_or_else(|| Error::Input(format!("there is no body \"{name}\"")))?;
        let mesh = source.mesh()?;
        let scalars = match source.field.and_then(|f| mesh.field(f, Location::Node)) {
            Some(field) => field.values.clone(),
            None if name == "duct" => waves(&mesh),
            None => depth_field(&mesh, &Topology::new(&mesh)).values,
        };
        let positions = match name {
            "limb" | "duct" => bent(&mesh),
            _ => mesh.nodes.clone(),
        };
        let stands = TetMesh {
            nodes: positions.clone(),
            ..mesh.clone()
        };
        Ok(Subject {
            camera: Camera::framing_for(&stands, [1, 1]),
            transfer: transfer(through)?,
            mesh,
            positions,
            scalars,
            cells: None,
        })
    }

    /// The scene at `path`, after its steps; or the mesh there, at rest.
    pub fn of_scene(gpu: &Gpu, path: &Path) -> Result<Subject> {
        let scene = bodies::named(path)?;
        let mut stage = Stage::new(gpu, &scene)?;
        stage.run(stage.steps(), &mut |_| {})?;
        let seen = stage.scalar_field();
        Ok(Subject {
            positions: stage.deformed_mesh()?.nodes,
            scalars: seen.values.clone(),
            cells: seen.cells.clone(),
            transfer: scene.transfer(seen)?,
            mesh: stage.mesh().clone(),
            camera: *stage.camera_mut(),
        })
    }

    fn seen(&self) -> Scalars<'_> {
        match &self.cells {
            Some(cells) => Scalars::Cells(cells),
            None => Scalars::Nodes(&self.scalars),
        }
    }

    /// How it is seen.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Number of tets.
    pub fn tets(&self) -> usize {
        self.mesh.tets.len()
    }

    /// What draws it.
    pub fn raycaster(&self, gpu: &Gpu) -> Result<Raycaster> {
        let frame = LocalFrame::of_mesh(&self.mesh);
        let positions = local_positions(gpu, &frame, &self.positions)?;
        let topology = Topology::new(&self.mesh);
        let geometry = Geometry::new(gpu, &self.mesh, &topology, frame, &positions, self.seen())?;
        Raycaster::with_options(gpu, geometry, &self.transfer, RaycastOptions::default())
    }

    /// The exact picture: the ray integral in float64 through the middle of every pixel.
    pub fn truth(&self, caster: &Raycaster, size: [u32; 2]) -> Image {
        let transfer = caster.transfer();
        let rays = match &self.cells {
            Some(cells) => RayReference::of_cells(&self.mesh, &self.positions, cells),
            None => RayReference::new(&self.mesh, &self.positions, &self.scalars),
        };
        let pixels = rays.picture(&self.camera, size, |rays, ray| {
            rays.composite(ray, &transfer)
        });
        Image {
            size,
            channels: 4,
            values: pixels.into_iter().flatten().map(|v| v as f32).collect(),
        }
    }
}

/// A made-up field, smooth over the bounds of the mesh.
fn waves(mesh: &TetMesh) -> Vec<f64> {
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

/// A smooth bend of the mesh, as strong as leaves every tet the right way out.
fn bent(mesh: &TetMesh) -> Vec<DVec3> {
    let (low, high) = bounds(&mesh.nodes);
    let (middle, unit) = (0.5 * (low + high), (high - low).max_element());
    let mut amount = 0.25;
    loop {
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
        let volume = |t: &[u32; 4]| signed_volume(t.map(|v| moved[v as usize]));
        if amount < 1e-3 || mesh.tets.iter().all(|t| volume(t) > 0.0) {
            return moved;
        }
        amount *= 0.6;
    }
}
