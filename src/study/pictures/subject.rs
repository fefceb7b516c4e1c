//! Subjects of the image study: five bodies, each with a smooth and a spiky transfer function, or
//! the user's scene.

use crate::generate;
use crate::gpu::Gpu;
use crate::mesh::signed_volume;
use crate::mesh::{LocalFrame, Location, TetMesh, Topology, bounds, depth_field};
use crate::render::{
    Camera, Geometry, Image, Isosurface, Light, Lighting, Plane, PlaneKind, RaycastOptions,
    Raycaster, ReferenceRaycaster, Scalars, Sections, TransferFunction, local_positions,
};
use crate::scene::Stage;
use crate::study::bodies;
use crate::{Error, Result};
use glam::DVec3;
use std::path::Path;

/// A body of the study: its name and its rendered field.
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

/// Transfer functions of the study.
pub(super) const TRANSFERS: [&str; 2] = ["smooth", "spiky"];

/// Returns a transfer function. Smooth: broad ramps. Spiky: three thin shells with nothing between,
/// which point sampling misses.
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

/// A body with its positions, camera and transfer function.
pub(super) struct StudyBody {
    mesh: TetMesh,
    positions: Vec<DVec3>,
    scalars: Vec<f64>,
    /// One scalar per tet, if a cell field is rendered.
    cells: Option<Vec<f64>>,
    camera: Camera,
    transfer: TransferFunction,
}

/// Returns the names of the bodies.
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

impl StudyBody {
    /// Creates the body `name` with the transfer function `through`.
    pub fn new(name: &str, through: &str) -> Result<StudyBody> {
        let source = SOURCES.iter().find(|s| s.name == name);
        let source =
            source.ok_or_else(|| Error::Input(format!("unknown study body \"{name}\"")))?;
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
        Ok(StudyBody {
            camera: Camera::fit_mesh_in(&stands, [1, 1]),
            transfer: transfer(through)?,
            mesh,
            positions,
            scalars,
            cells: None,
        })
    }

    /// Creates the body of the scene at `path` after its steps, or of the mesh there at rest.
    pub fn of_scene(gpu: &Gpu, path: &Path) -> Result<StudyBody> {
        let scene = bodies::named(path)?;
        let mut stage = Stage::new(gpu, &scene)?;
        stage.run(stage.steps(), &mut |_| {})?;
        let seen = stage.scalar_field();
        Ok(StudyBody {
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

    /// Returns the camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns the number of tets.
    pub fn tets(&self) -> usize {
        self.mesh.tets.len()
    }

    /// Returns its raycaster, prepared for lighting and for planes that deform with the body.
    pub fn raycaster(&self, gpu: &Gpu) -> Result<Raycaster> {
        let frame = LocalFrame::from_mesh(&self.mesh);
        let positions = local_positions(gpu, &frame, &self.positions)?;
        let topology = Topology::new(&self.mesh);
        let seen = self.seen();
        let mut geometry = Geometry::new(gpu, &self.mesh, &topology, frame, &positions, seen)?;
        geometry.enable_lighting(&self.mesh, &topology, seen)?;
        geometry.store_rest_positions(&self.mesh)?;
        Raycaster::with_options(gpu, geometry, &self.transfer, RaycastOptions::default())
    }

    /// Returns a clip plane in space, one in the rest configuration, a slice, and, for a nodal
    /// field, an isosurface.
    pub fn inside(&self) -> Sections {
        let (low, high) = bounds(&self.positions);
        let (middle, size) = (0.5 * (low + high), high - low);
        let (rest_low, rest_high) = self.mesh.bounds();
        let at_rest = 0.5 * (rest_low + rest_high) + 0.2 * DVec3::Y * (rest_high - rest_low).y;
        let slice = Plane::slice(middle - 0.05 * size, DVec3::new(0.9, -0.3, 0.4));
        let values = self.scalars.iter();
        let (least, most) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| {
            (a.min(*s), b.max(*s))
        });
        let isosurface = Isosurface {
            value: least + 0.6 * (most - least),
            colour: Some([0.9, 0.3, 0.2]),
            opacity: 0.5,
        };
        Sections {
            planes: vec![
                Plane::clip(middle + 0.15 * size, DVec3::new(1.0, 0.2, 0.3)),
                Plane::clip(at_rest, DVec3::new(-0.1, 1.0, 0.2)).at_rest(),
                Plane {
                    kind: PlaneKind::Slice(0.7),
                    ..slice
                },
            ],
            isosurfaces: match self.cells {
                Some(_) => Vec::new(),
                None => vec![isosurface],
            },
            draw_volume: true,
        }
    }

    /// Computes the reference image of `caster` in `light`: the ray integral in float64 through the
    /// centre of every pixel.
    pub fn reference_image(&self, caster: &Raycaster, size: [u32; 2], light: Light) -> Image {
        let transfer = caster.transfer();
        let rays = match &self.cells {
            Some(cells) => {
                ReferenceRaycaster::from_cell_scalars(&self.mesh, &self.positions, cells)
            }
            None => ReferenceRaycaster::new(&self.mesh, &self.positions, &self.scalars),
        };
        let gradients = self.gradients(caster, light);
        let mix = |of: &[DVec3], tet: u32, weights: [f64; 4]| -> DVec3 {
            let nodes = self.mesh.tets[tet as usize].iter();
            nodes.zip(weights).map(|(v, w)| w * of[*v as usize]).sum()
        };
        let pixels = rays.render(&self.camera, size, |rays, ray| {
            let gradient =
                |tet: u32, p: DVec3| mix(&gradients, tet, rays.barycentric_weights(tet, p));
            let rest = |tet: u32, weights: [f64; 4]| mix(&self.mesh.nodes, tet, weights);
            let volume = |tet: u32, p: DVec3, way: DVec3| light.shade(gradient(tet, p), way);
            let surface =
                |tet: u32, p: DVec3, way: DVec3| light.shade_surface(gradient(tet, p), way);
            let lighting = Lighting {
                volume: &volume,
                surface: &surface,
            };
            let lit = light.is_on().then_some(&lighting);
            rays.composite_sections(ray, &|_| Some(&transfer), caster.inside(), &rest, lit)
        });
        Image {
            size,
            channels: 4,
            values: pixels.into_iter().flatten().map(|v| v as f32).collect(),
        }
    }

    /// Returns the nodal gradients for lighting; empty without light.
    fn gradients(&self, caster: &Raycaster, light: Light) -> Vec<DVec3> {
        if !light.is_on() {
            return Vec::new();
        }
        let geometry = caster.geometry();
        let (frame, (low, high)) = (geometry.frame(), geometry.scalar_range());
        let local = self.positions.iter();
        let local: Vec<DVec3> = local.map(|p| (*p - frame.origin) / frame.scale).collect();
        let shares: Vec<f64> = match &self.cells {
            Some(_) => vec![0.0; self.scalars.len()],
            None => {
                let share = |s: &f64| (s - low) / (high - low);
                self.scalars.iter().map(share).collect()
            }
        };
        let topology = Topology::new(&self.mesh);
        Geometry::reference_node_gradients(
            &self.mesh,
            &topology,
            &local,
            &shares,
            self.cells.as_deref(),
        )
    }
}

/// Returns a synthetic field, smooth over the bounds of the mesh.
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

/// Returns a smooth bend of the mesh, as strong as possible without inverted tets.
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
