//! Builds the camera, the sections and the renderers of a scene's picture.

use super::keywords::{BACKGROUNDS, MODES, TRAVERSALS, unknown_keyword_error};
use super::mesh_source::DEFAULT_PRESET;
use super::{ScalarField, Scene};
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, Topology};
use crate::physics::NodePositions;
use crate::render::*;
use crate::skin::CompositorOptions;
use crate::{Error, Result};
use glam::DVec3;

/// Default size of a picture.
pub(crate) const DEFAULT_SIZE: [u32; 2] = [1024, 768];
/// Colour of a surface without a field.
const SKIN_COLOUR: [f32; 3] = [0.87, 0.68, 0.56];

/// Fraction of the width reserved for a legend at the right, with the default camera.
const LEGEND: f64 = 0.22;

/// Content of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DisplayMode {
    /// The volume, rendered by the raycaster.
    Inside(Mode),
    /// The lit boundary.
    Surface,
    /// Only the skins.
    Skin,
}

impl Scene {
    /// Creates the renderers of the volume of `mesh` and of its boundary, with node positions from
    /// `nodes`.
    pub(super) fn build_renderers(
        &self,
        gpu: &Gpu,
        mesh: &TetMesh,
        topology: &Topology,
        (seen, scans): (&ScalarField, &[Scan]),
        nodes: &NodePositions,
        notes: &mut Vec<String>,
    ) -> Result<(Raycaster, Surface)> {
        let mode = self.display_mode()?;
        let (positions, frame) = (nodes.array(), nodes.frame());
        let mut geometry = Geometry::new(gpu, mesh, topology, frame, positions, seen.scalars())?;
        let constant = seen.values.windows(2).all(|v| v[0] == v[1]);
        if (self.picture.range.is_some() || constant)
            && scans.is_empty()
            && mode != DisplayMode::Inside(Mode::Xray)
        {
            geometry.set_scalars(mesh, seen.scalars(), seen.range)?;
        }
        let transfer = self.transfer(seen)?;
        let coloured = self.picture.field.is_some() || self.picture.transfer.is_some();
        let colour = match coloured && scans.is_empty() {
            true => SurfaceColour::Field(transfer.clone()),
            false => SurfaceColour::Plain(SKIN_COLOUR),
        };
        let mut surface = Surface::new(gpu, &geometry, &seen.values, &colour, Shading::Smooth)?;
        let mut options = self.raycast_options()?;
        let composite = DisplayMode::Inside(Mode::Composite);
        let with_isosurfaces = mode == DisplayMode::Surface && !self.isosurface.is_empty();
        if mode != composite && !with_isosurfaces {
            options.light = Light::None;
        }
        // Scans have their own gradients.
        let from_nodes = scans.is_empty() || options.shadows > 0.0;
        if options.light.is_on()
            && from_nodes
            && let Err(why) = geometry.enable_lighting(mesh, topology, seen.scalars())
        {
            notes.push(format!("rendering without light: {why}"));
            options.light = Light::None;
        }
        let inside = self.inside(mode, notes)?;
        if mode == DisplayMode::Inside(Mode::Xray) {
            options.xray = self.xray(mesh, seen.range, notes)?;
        }
        let mode_needs_rest = mode == DisplayMode::Inside(Mode::Xray);
        if inside.needs_rest_positions() || !scans.is_empty() || mode_needs_rest {
            geometry.store_rest_positions(mesh)?;
        }
        if mode == DisplayMode::Surface {
            surface.set_sections(&inside, &geometry)?;
        }
        let mut raycaster = Raycaster::with_options(gpu, geometry, &transfer, options)?;
        notes.extend(raycaster.set_scans(mesh, scans)?);
        raycaster.set_sections(&inside)?;
        let looks = self.region_looks(mesh, topology, &transfer)?;
        if looks.is_some() {
            if matches!(mode, DisplayMode::Surface | DisplayMode::Skin) {
                notes.push("region appearance and hidden regions are ignored in modes surface and skin, which show the boundary of all regions".into());
            }
            raycaster.set_regions(looks.as_ref())?;
        }
        Ok((raycaster, surface))
    }

    /// Returns the planes and isosurfaces of the picture. The lit boundary shows its cut faces as a
    /// volume.
    pub(super) fn inside(&self, mode: DisplayMode, notes: &mut Vec<String>) -> Result<Sections> {
        let mut inside = Sections {
            draw_volume: self.picture.volume.unwrap_or(true),
            ..Sections::default()
        };
        for entry in &self.plane {
            inside.planes.extend(entry.planes()?);
        }
        for entry in &self.isosurface {
            inside.isosurfaces.push(entry.isosurface()?);
        }
        inside.check()?;
        let surfaces = inside.isosurfaces.len() + inside.planes.len() - inside.clips().count();
        match mode {
            DisplayMode::Inside(Mode::Composite) => {
                if !inside.draw_volume && surfaces == 0 {
                    return Err(Error::Input(
                        "nothing to draw: volume = false (--no-volume) requires slices or isosurfaces"
                            .into(),
                    ));
                }
            }
            DisplayMode::Surface => {
                inside = inside.with_cut_faces();
                if inside.check().is_err() {
                    return Err(Error::Input(
                        "too many clip planes: in mode surface each one also counts as a slice, for its cut face; use at most 16 (a box has six)"
                            .into(),
                    ));
                }
            }
            _ => {
                if surfaces > 0 || !inside.draw_volume {
                    notes.push(
                        "slices and isosurfaces are ignored: they require mode composite or surface"
                            .into(),
                    );
                }
                inside.planes.retain(|p| p.kind == PlaneKind::Clip);
                inside.isosurfaces.clear();
                inside.draw_volume = true;
            }
        }
        Ok(inside)
    }

    /// Returns the transfer function of the scene, or the default one of `seen`.
    pub(crate) fn transfer(&self, seen: &ScalarField) -> Result<TransferFunction> {
        if let Some(own) = seen.transfer.as_ref().filter(|_| !self.scan.is_empty()) {
            return Ok(own.clone());
        }
        match (&self.picture.transfer, &seen.transfer) {
            (Some(named), _) => self.named_transfer(named),
            (None, Some(own)) => Ok(own.clone()),
            (None, None) => TransferFunction::preset(DEFAULT_PRESET),
        }
    }

    /// Returns a transfer function from a preset, inline JSON or a JSON file.
    pub(super) fn named_transfer(&self, named: &str) -> Result<TransferFunction> {
        match named {
            json if json.trim_start().starts_with('{') => TransferFunction::from_json(json),
            file if file.ends_with(".json") => TransferFunction::read(file),
            name => TransferFunction::preset(name),
        }
    }

    pub(super) fn raycast_options(&self) -> Result<RaycastOptions> {
        let mut options = match self.picture.quality {
            Some(tolerance) => RaycastOptions::for_tolerance(tolerance / 255.0)?,
            None => RaycastOptions::default(),
        };
        options.walk = match self.picture.traversal.as_deref() {
            None => options.walk,
            Some("vertices") => Traversal::Vertices,
            Some("planes") => Traversal::Planes,
            Some(other) => {
                return Err(unknown_keyword_error("traversal", &TRAVERSALS, other));
            }
        };
        if let Some(accuracy) = self.picture.accuracy {
            if !(accuracy.is_finite() && accuracy > 0.0) {
                return Err(Error::Input(format!(
                    "[picture] accuracy (error of pixel values) must be positive, got {accuracy}"
                )));
            }
            options.table_tolerance = accuracy;
        }
        options.layers = self.picture.layers.unwrap_or(options.layers);
        options.light = self.light.from.unwrap_or(Light::Head);
        let shadows = self.light.shadows.unwrap_or(options.shadows);
        if !(0.0..=1.0).contains(&shadows) {
            return Err(Error::Input(format!(
                "[light] shadows must be in [0, 1] (0: none), got {shadows}"
            )));
        }
        options.shadows = shadows;
        Ok(options)
    }

    pub(super) fn compose_options(&self) -> Result<CompositorOptions> {
        Ok(CompositorOptions {
            samples: self.samples_each_way()?,
            ..CompositorOptions::default()
        })
    }

    /// Returns the supersampling factor per axis.
    pub(super) fn samples_each_way(&self) -> Result<u32> {
        let skins = CompositorOptions::default().samples;
        let Some(samples) = self.picture.samples else {
            return Ok(match self.display_mode()? {
                DisplayMode::Surface | DisplayMode::Skin => skins,
                DisplayMode::Inside(Mode::Composite) if !self.skin.is_empty() => skins,
                DisplayMode::Inside(_) => 1,
            });
        };
        (1..=8).find(|n| n * n == samples).ok_or_else(|| {
            Error::Input(format!(
                "samples per pixel must be a square number (1, 4, 9, 16, 25, 36, 49 or 64), got {samples}"
            ))
        })
    }

    pub(super) fn display_mode(&self) -> Result<DisplayMode> {
        match self.picture.mode.as_deref() {
            None | Some("composite") => Ok(DisplayMode::Inside(Mode::Composite)),
            Some("thickness") => Ok(DisplayMode::Inside(Mode::Thickness)),
            Some("mip") => Ok(DisplayMode::Inside(Mode::Maximum)),
            Some("minip") => Ok(DisplayMode::Inside(Mode::Minimum)),
            Some("mean") => Ok(DisplayMode::Inside(Mode::Mean)),
            Some("xray") => Ok(DisplayMode::Inside(Mode::Xray)),
            Some("surface") => Ok(DisplayMode::Surface),
            Some("skin") if self.skin.iter().all(|skin| skin.hidden) => Err(Error::Input(
                "mode \"skin\" requires a [[skin]] that is not hidden".into(),
            )),
            Some("skin") => Ok(DisplayMode::Skin),
            Some(other) => Err(unknown_keyword_error("mode", &MODES, other)),
        }
    }

    /// Whether the picture is of the volume, by emission and absorption.
    pub(super) fn is_composite(&self) -> bool {
        matches!(
            self.display_mode(),
            Ok(DisplayMode::Inside(Mode::Composite))
        )
    }

    pub(super) fn background(&self) -> Result<Background> {
        match self.picture.background.as_deref() {
            None | Some("gradient") => Ok(Background::Gradient),
            Some("transparent") => Ok(Background::Transparent),
            Some("black") => Ok(Background::Black),
            Some("white") => Ok(Background::White),
            Some(other) => Err(unknown_keyword_error("background", &BACKGROUNDS, other)),
        }
    }

    pub(super) fn bits(&self) -> Result<BitDepth> {
        match self.picture.bits {
            None | Some(8) => Ok(BitDepth::Eight),
            Some(16) => Ok(BitDepth::Sixteen),
            Some(other) => Err(Error::Input(format!(
                "bits per channel must be 8 or 16, got {other}"
            ))),
        }
    }

    /// Returns the camera: a view of all `points` suited to the shape of `mesh`, overridden by the
    /// keys of the scene.
    pub(super) fn camera(
        &self,
        mesh: &TetMesh,
        points: &[DVec3],
        size: [u32; 2],
    ) -> Result<Camera> {
        use crate::render::Projection;
        let entry = &self.camera;
        let legend = self.picture.legend == Some(true) && entry.is_unset();
        let fit = match entry.frame_all {
            Some(true) => Camera::fit_points,
            _ => Camera::fill_points,
        };
        let mut camera = match legend {
            true => beside_legend(|size| fit(mesh, points, size), size),
            false => fit(mesh, points, size),
        };
        if let Some(look_at) = entry.look_at {
            // The eye keeps its position relative to the point looked at.
            camera.eye += DVec3::from(look_at) - camera.look_at;
            camera.look_at = look_at.into();
        }
        if let Some(eye) = entry.eye {
            camera.eye = eye.into();
        }
        if let Some(up) = entry.up {
            camera.up = up.into();
        }
        match (entry.fov, entry.orthographic) {
            (Some(_), Some(_)) => {
                return Err(Error::Input(
                    "the camera has both `fov` and `orthographic`; remove one of them".into(),
                ));
            }
            (Some(fov), None) => camera.projection = Projection::Perspective { fov },
            (None, Some(height)) => camera.projection = Projection::Orthographic { height },
            (None, None) => {}
        }
        camera.check()?;
        Ok(camera)
    }
}

/// Returns the camera that `fit` makes for the part of a picture to the left of a legend.
fn beside_legend(fit: impl Fn([u32; 2]) -> Camera, size: [u32; 2]) -> Camera {
    let left = (1.0 - LEGEND) * f64::from(size[0]);
    let mut camera = fit([left as u32, size[1]]);
    let axes = camera.axes();
    let distance = camera.eye.distance(camera.look_at);
    let width = 2.0 * axes.half_height * distance * axes.aspect(size);
    let aside = 0.5 * LEGEND * width * axes.right;
    camera.eye += aside;
    camera.look_at += aside;
    camera
}
