//! What the study of pictures draws: five bodies, each through a smooth and a spiky transfer
//! function, or a scene of the user's.

use crate::gpu::Gpu;
use crate::mesh::signed_volume;
use crate::mesh::{LocalFrame, Location, TetMesh, Topology, bounds, depth_field, generate};
use crate::render::{
    Camera, Geometry, Image, Isosurface, Light, Lighting, Plane, PlaneKind, RaycastOptions,
    Raycaster, ReferenceRaycaster, Scalars, Sections, TransferFunction, local_positions,
    node_gradients, shade, shade_surface,
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
pub(super) struct StudyBody {
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

impl StudyBody {
    /// The body `name` through the transfer function `through`.
    pub fn new(name: &str, through: &str) -> Result<StudyBody> {
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
        Ok(StudyBody {
            camera: Camera::fit_mesh_in(&stands, [1, 1]),
            transfer: transfer(through)?,
            mesh,
            positions,
            scalars,
            cells: None,
        })
    }

    /// The scene at `path`, after its steps; or the mesh there, at rest.
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

    /// How it is seen.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Number of tets.
    pub fn tets(&self) -> usize {
        self.mesh.tets.len()
    }

    /// What draws it, ready for light and for planes that bend with it.
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

    /// A plane in space that cuts some of it off, one in the body at rest, a slice, and of a field
    /// at the nodes an isosurface.
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

    /// The exact picture of what `caster` draws, in `light`: the ray integral in float64 through the
    /// middle of every pixel.
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
            let volume = |tet: u32, p: DVec3, way: DVec3| shade(light, gradient(tet, p), way);
            let surface =
                |tet: u32, p: DVec3, way: DVec3| shade_surface(light, gradient(tet, p), way);
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

    /// The gradients that light sees at the nodes; nothing where there is none.
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
        node_gradients(
            &self.mesh,
            &topology,
            &local,
            &shares,
            self.cells.as_deref(),
        )
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
