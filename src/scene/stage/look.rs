//! Changes of a stage's appearance: everything at once, or planes, sections and transfer function.

use super::Stage;
use crate::Result;
use crate::render::{AbsoluteTransferFunction, Mode, Sections, TransferFunction};
use crate::scene::Scene;
use crate::scene::appearance::SceneAppearance;
use crate::scene::picture::DisplayMode;

impl Stage {
    /// Applies the appearance in `scene` to the body in its current configuration: picture, light,
    /// X-rays, planes, isosurfaces, scans, skins and output. The motion, the camera and the picture
    /// size are kept. Returns notes of the automatic choices.
    ///
    /// # Errors
    /// As [`Stage::new`]; the stage is then unchanged.
    pub fn set_appearance(&mut self, scene: &Scene) -> Result<Vec<String>> {
        let scene = Scene {
            picture: scene.picture.clone(),
            light: scene.light.clone(),
            xray: scene.xray.clone(),
            plane: scene.plane.clone(),
            isosurface: scene.isosurface.clone(),
            scan: scene.scan.clone(),
            skin: scene.skin.clone(),
            output: scene.output.clone(),
            camera: scene.camera.clone(),
            ..self.scene.clone()
        };
        let mut looks = SceneAppearance::new(&self.gpu, &scene, &mut self.drive)?;
        (looks.camera, looks.size) = (self.looks.camera, self.looks.size);
        let notes = std::mem::take(&mut looks.notes);
        self.looks = looks;
        self.scene = scene;
        self.cached = None;
        Ok(notes)
    }

    /// As [`Stage::set_appearance`], but for planes and isosurfaces only, if the picture shows the
    /// volume: fast enough to drag them.
    ///
    /// # Errors
    /// As [`Stage::set_appearance`].
    pub fn set_planes(&mut self, scene: &Scene) -> Result<Vec<String>> {
        // In other modes the lighting depends on the sections.
        if self.looks.mode != DisplayMode::Inside(Mode::Composite) {
            return self.set_appearance(scene);
        }
        let scene = Scene {
            plane: scene.plane.clone(),
            isosurface: scene.isosurface.clone(),
            ..self.scene.clone()
        };
        let mut notes = Vec::new();
        let inside = scene.inside(self.looks.mode, &mut notes)?;
        // Tools are not clipped by the planes of a scene.
        self.set_body_inside(&inside)?;
        self.scene = scene;
        Ok(notes)
    }

    /// Returns the section planes and isosurfaces.
    pub fn inside(&self) -> &Sections {
        self.looks.raycaster.inside()
    }

    /// Sets the sections of the volume, boundary and skins; tools are clipped by planes in space
    /// only. In mode `surface` clip planes have cut faces.
    ///
    /// # Errors
    /// As [`Raycaster::set_sections`](crate::render::Raycaster::set_sections).
    pub fn set_sections(&mut self, inside: &Sections) -> Result<()> {
        self.set_body_inside(inside)?;
        // Tools have no rest configuration.
        let mut in_space = inside.clone();
        in_space.planes.retain(|plane| !plane.at_rest);
        for tool in &mut self.looks.tools {
            tool.skin.set_sections(&in_space)?;
        }
        Ok(())
    }

    /// Sets the sections of the body and its skins, but not of tools.
    fn set_body_inside(&mut self, inside: &Sections) -> Result<()> {
        let is_surface = self.looks.mode == DisplayMode::Surface;
        let inside = &match is_surface {
            true => inside.clone().with_cut_faces(),
            false => inside.clone(),
        };
        if inside.needs_rest_positions() && !self.looks.raycaster.inside().needs_rest_positions() {
            let mesh = match &self.looks.drawn {
                Some(drawn) => &drawn.mesh,
                None => self.drive.mesh(),
            };
            self.looks
                .raycaster
                .geometry_mut()
                .store_rest_positions(mesh)?;
        }
        self.looks.raycaster.set_sections(inside)?;
        if is_surface {
            self.looks
                .surface
                .set_sections(inside, self.looks.raycaster.geometry())?;
        }
        for skin in &mut self.looks.skins {
            skin.set_sections(inside)?;
        }
        self.cached = None;
        Ok(())
    }

    /// Draws the mesh of the body itself from now on, with boundaries of regions along the faces of its
    /// tets: the drawn mesh cannot be cut, and cannot show other fields.
    pub(super) fn draw_own_mesh(&mut self) -> Result<()> {
        if self.looks.drawn.is_none() {
            return Ok(());
        }
        let inside = self.looks.raycaster.inside().clone();
        let mut scene = self.scene.clone();
        scene.picture.boundaries = Some("tets".into());
        self.set_appearance(&scene)?;
        self.set_body_inside(&inside)
    }

    /// Returns the transfer function of the displayed field, in absolute values.
    pub fn transfer(&self) -> AbsoluteTransferFunction {
        self.looks.raycaster.transfer()
    }

    /// Sets the transfer function of the volume; the boundary and regions with their own appearance
    /// keep theirs.
    ///
    /// # Errors
    /// As [`Raycaster::set_transfer`](crate::render::Raycaster::set_transfer).
    pub fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        self.cached = None;
        self.looks.raycaster.set_transfer(transfer)
    }

    /// Sets the background of [`Stage::record`] as RGBA; default black.
    pub fn set_backdrop(&mut self, colour: [f32; 4]) {
        self.backdrop = colour;
    }
}
