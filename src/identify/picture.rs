//! Pictures of a stiffness that was found: the body cut open, coloured by the factors or their uncertainty.

use super::report::Identified;
use super::stiffness_grid::SPREAD_FIELD;
use crate::gpu::Gpu;
use crate::mesh::{Location, TetMesh};
use crate::render::Image;
use crate::scene::{CameraEntry, PlaneEntry, Stage};
use crate::{Error, Result};
use glam::DVec3;

/// Height of the view relative to the body's extent, and the fraction of its width reserved for the legend.
const VIEW_SCALE: f64 = 1.15;
const LEGEND: f64 = 0.2;

impl Identified {
    /// Renders the field of stiffness factors, and for a stiffness that varies that of the standard deviations
    /// of their logarithms, on a cut through the place that differs most from the rest; returns names and
    /// images, none without such a field.
    ///
    /// # Errors
    /// As rendering.
    pub fn field_images(&self, gpu: &Gpu) -> Result<Vec<(&'static str, Image)>> {
        let field = self.scene.material.stiffness_field.as_deref();
        let (Some(mesh), Some(field)) = (self.mesh_with_field(), field) else {
            return Ok(Vec::new());
        };
        let cut = place_of_extreme(mesh, field)?;
        let mut images = vec![("stiffness", self.cut_image(gpu, mesh, (field, cut))?)];
        if mesh.field(SPREAD_FIELD, Location::Cell).is_some() {
            let image = self.cut_image(gpu, mesh, (SPREAD_FIELD, cut))?;
            images.push(("stiffness_spread", image));
        }
        Ok(images)
    }

    fn cut_image(&self, gpu: &Gpu, mesh: &TetMesh, (field, cut): (&str, DVec3)) -> Result<Image> {
        let mut scene = self.scene.clone();
        scene.solver.name = None;
        scene.tool.clear();
        scene.pin.clear();
        scene.isosurface.clear();
        scene.skin.clear();
        scene.moves.clear();
        scene.force.clear();
        scene.pressure.clear();
        scene.mass.clear();
        let (low, high) = mesh.bounds();
        let extent = high - low;
        let size = scene.picture.size.unwrap_or([800, 600]);
        // Upright, towards the narrower side.
        let towards = match extent.x < extent.y {
            true => DVec3::X,
            false => DVec3::NEG_Y,
        };
        let [a, b, c] = cut.to_array();
        let [d, e, f] = towards.to_array();
        scene.plane = vec![PlaneEntry {
            clip: Some([a, b, c, d, e, f]),
            rest: true,
            ..PlaneEntry::default()
        }];
        let right = DVec3::Z.cross(towards);
        let aspect = f64::from(size[0]) / f64::from(size[1].max(1));
        let across = extent.dot(right.abs());
        let height = VIEW_SCALE * extent.z.max(across / (aspect * (1.0 - LEGEND)));
        let middle = 0.5 * (low + high) + 0.5 * LEGEND * height * aspect * right;
        let eye = middle + 2.0 * extent.length() * towards;
        scene.camera = CameraEntry {
            eye: Some(eye.to_array()),
            look_at: Some(middle.to_array()),
            up: Some(DVec3::Z.to_array()),
            fov: None,
            orthographic: Some(height),
            frame_all: None,
        };
        let picture = &mut scene.picture;
        picture.region.clear();
        picture.field = Some(field.into());
        picture.transfer = Some("viridis".into());
        picture.range = None;
        picture.mode = Some("surface".into());
        picture.legend = Some(true);
        picture.scale_bar = Some(true);
        Stage::with_mesh(gpu, &scene, mesh.clone())?.render_on_background()
    }
}

/// Returns the middle of the tet whose factor differs most from the median.
fn place_of_extreme(mesh: &TetMesh, field: &str) -> Result<DVec3> {
    let field = mesh
        .field(field, Location::Cell)
        .ok_or_else(|| Error::Input(format!("the mesh has no field \"{field}\" of tets")))?;
    let mut sorted = field.values.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(1.0);
    let off = |t: &usize| (field.values[*t] / median).ln().abs();
    let extreme = (0..mesh.tets.len()).max_by(|a, b| off(a).total_cmp(&off(b)));
    Ok(extreme.map_or(DVec3::ZERO, |t| {
        mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0
    }))
}
