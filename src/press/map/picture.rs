//! Picture of a map: the body from above, coloured by its stiffness.

use super::{MapPoint, PressMap};
use crate::gpu::Gpu;
use crate::mesh::{Field, Location};
use crate::render::Image;
use crate::scene::{CameraEntry, PlaneEntry, Stage};
use crate::{Error, Result};
use glam::DVec3;

/// Height of the view relative to the body's extent, and the fraction of its width reserved for the
/// legend.
const VIEW_SCALE: f64 = 1.15;
const LEGEND: f64 = 0.2;
/// Field shown in images, N/m.
const FIELD: &str = "stiffness (N/m)";

impl PressMap {
    /// Renders the stiffness on the body, seen from above, interpolated between the points. A map of a
    /// part of the body shows that part.
    ///
    /// # Errors
    /// [`Error::Input`] without any result; otherwise as rendering.
    pub fn image(&self, gpu: &Gpu) -> Result<Image> {
        if self.median().is_none() {
            return Err(Error::Input(
                "the map has no results to draw; every press failed".into(),
            ));
        }
        let mut mesh = self.bench.mesh.clone();
        let values = mesh.nodes.iter().map(|p| self.at(*p)).collect();
        mesh.set_field(Field::scalar(FIELD, Location::Node, values))?;
        let mut scene = self.bench.setup.scene.clone();
        scene.solver.name = None;
        scene.tool.clear();
        scene.pin.clear();
        scene.plane.clear();
        scene.isosurface.clear();
        scene.skin.clear();
        let shown = self.grid.bounds(&mesh);
        if shown != mesh.bounds() {
            let beyond = shown.0.distance(shown.1) * self.up.abs();
            let [a, b] = [shown.0 - beyond, shown.1 + beyond].map(|p| p.to_array());
            scene.plane.push(PlaneEntry {
                around: Some([a[0], a[1], a[2], b[0], b[1], b[2]]),
                ..PlaneEntry::default()
            });
        }
        let picture = &mut scene.picture;
        picture.region.clear();
        picture.field = Some(FIELD.into());
        picture.transfer = Some("viridis".into());
        picture.range = None;
        picture.mode = Some("surface".into());
        picture.legend = Some(true);
        picture.scale_bar = Some(true);
        scene.camera = self.view(scene.picture.size.unwrap_or([800, 600]));
        let mut stage = Stage::with_mesh(gpu, &scene, mesh)?;
        stage.render_on_background()
    }

    /// Returns a camera that looks straight down, with room for a legend in an image of `size`
    /// pixels.
    fn view(&self, size: [u32; 2]) -> CameraEntry {
        let (low, high) = self.grid.bounds(&self.bench.mesh);
        let [across, ahead] = self.grid.axes.map(|axis| (high - low)[axis]);
        let aspect = f64::from(size[0]) / f64::from(size[1].max(1));
        let height = (VIEW_SCALE * ahead).max(VIEW_SCALE * across / (aspect * (1.0 - LEGEND)));
        let up = DVec3::AXES[self.grid.axes[1]];
        let right = up.cross(self.up);
        let aside = 0.5 * LEGEND * height * aspect * right;
        let middle = 0.5 * (low + high) + aside;
        let eye = middle + 2.0 * low.distance(high) * self.up;
        CameraEntry {
            eye: Some(eye.to_array()),
            look_at: Some(middle.to_array()),
            up: Some(up.to_array()),
            fov: None,
            orthographic: Some(height),
            frame_all: None,
        }
    }

    /// Returns the stiffness interpolated between the surrounding points, or that of the nearest
    /// point if none of them has a result.
    fn at(&self, p: DVec3) -> f64 {
        let found = |cell: usize| {
            let k = self.cells.binary_search(&cell).ok()?;
            self.points[k].stiffness()
        };
        let around = self.grid.around(p);
        let known = around
            .iter()
            .filter_map(|(cell, w)| Some((found(*cell)?, *w)));
        let (sum, weight) = known.fold((0.0, 0.0), |s, (x, w)| (s.0 + w * x, s.1 + w));
        if weight > 1e-9 {
            return sum / weight;
        }
        let away = |q: &&MapPoint| {
            let off = q.point - p;
            (off - self.up * off.dot(self.up)).length_squared()
        };
        let pressed = self.points.iter().filter(|q| q.stiffness().is_some());
        let nearest = pressed.min_by(|a, b| away(a).total_cmp(&away(b)));
        nearest.and_then(MapPoint::stiffness).unwrap_or(0.0)
    }
}
