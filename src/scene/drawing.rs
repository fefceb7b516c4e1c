//! The pictures of a stage: drawn where the body is now, kept while nothing changes.

use super::picture::DisplayMode;
use super::stage::{NodeSource, Stage};
use super::tool_skin::ToolSkin;
use crate::gpu::{PendingReadback, Recorder};
use crate::render::{Camera, Image, Mode, Pick, SurfaceTarget, Target};
use crate::{Error, Result};
use glam::DVec2;

/// A picture and what it shows.
pub(super) struct CachedFrame {
    version: u64,
    camera: Camera,
    image: Image,
}

/// A picture on its way from the device; see [`Stage::render_async`].
#[derive(Debug)]
pub struct PendingImage {
    size: [u32; 2],
    pixels: PendingReadback<[u8; 4]>,
}

impl PendingImage {
    /// The picture, once it has arrived.
    ///
    /// # Errors
    /// As [`PendingReadback::try_take`].
    pub fn try_take(&mut self) -> Result<Option<Image>> {
        let pixels = self.pixels.try_take()?;
        Ok(pixels.map(|pixels| Image {
            size: self.size,
            channels: 4,
            values: pixels
                .iter()
                .flatten()
                .map(|byte| f32::from(*byte) / 255.0)
                .collect(),
        }))
    }
}

impl Stage {
    /// Brings the nodes that are drawn to where the body is, at once.
    pub(super) fn publish_now(&mut self) -> Result<()> {
        let mut work = self.gpu.start_recording();
        self.publish(&mut work)?;
        work.submit()
    }

    /// Brings the nodes that are drawn to where the body is.
    pub(super) fn publish(&mut self, work: &mut Recorder) -> Result<()> {
        if let NodeSource::Simulated(motion) = &mut self.drive {
            motion.simulator.update_nodes(work)?;
        }
        let (geometry, mesh) = (self.raycaster.geometry(), self.drive.mesh());
        let drawn = [geometry.positions().len(), geometry.tet_count()].map(|n| n as usize);
        if drawn != [mesh.nodes.len(), mesh.tets.len()] {
            return Err(Error::Input(
                "the body was cut without the stage, which cannot draw it any more; cut it with Stage::cut".into(),
            ));
        }
        Ok(())
    }

    /// What is seen of the body's boundary at the point `pixel` of the picture, where the body is
    /// now; none where the ray through it misses. Where the device moved the nodes it waits and
    /// reads 36 bytes back; of a body on the processor it is what was put out last.
    ///
    /// # Errors
    /// As [`Geometry::pick`](crate::render::Geometry::pick).
    pub fn pick(&mut self, pixel: DVec2) -> Result<Option<Pick>> {
        self.publish_now()?;
        let geometry = self.raycaster.geometry();
        match self.drive.nodes().put() {
            Some(positions) => geometry.pick_positions(&positions, &self.camera, pixel, self.size),
            None => geometry.pick(&self.camera, pixel, self.size),
        }
    }

    /// The picture, as the scene describes it: the last one, where neither body nor camera has
    /// moved since.
    ///
    /// # Errors
    /// As [`Raycaster::image`](crate::render::Raycaster::image).
    pub fn image(&mut self) -> Result<Image> {
        self.publish_now()?;
        if self.follow_tools()? {
            self.cached = None;
        }
        let version = self.drive.nodes().version();
        if let Some(cached) = &self.cached
            && (cached.version, cached.camera) == (version, self.camera)
        {
            self.pictures[1] += 1;
            return Ok(cached.image.clone());
        }
        let image = self.draw()?;
        self.pictures[0] += 1;
        self.cached = Some(CachedFrame {
            version,
            camera: self.camera,
            image: image.clone(),
        });
        Ok(image)
    }

    /// Brings the tools that are drawn to where they are. Whether any was elsewhere.
    fn follow_tools(&mut self) -> Result<bool> {
        let mut moved = false;
        if let NodeSource::Simulated(motion) = &self.drive {
            for tool in &mut self.tools {
                moved |= tool.follow(&self.gpu, motion)?;
            }
        }
        Ok(moved)
    }

    fn draw(&mut self) -> Result<Image> {
        self.refresh_field()?;
        let samples = self.samples;
        let bare = self.skins.is_empty() && self.tools.is_empty();
        let shows = self.raycaster.inside().has_surfaces();
        let tools = self.tools.iter_mut().map(|tool| &mut tool.skin);
        match self.mode {
            DisplayMode::Inside(Mode::Composite) if !bare => {
                let inside = Some(&mut self.raycaster);
                let all = self.skins.iter_mut().chain(tools);
                self.composer.image(all, inside, &self.camera, self.size)
            }
            DisplayMode::Inside(mode) => {
                let fine = self.size.map(|n| n.saturating_mul(samples));
                let image = self.raycaster.image(&self.camera, fine, mode)?;
                Ok(match samples {
                    1 => image,
                    n => image.box_downsampled(n),
                })
            }
            DisplayMode::Surface if shows || tools.len() > 0 => {
                let surface = (&mut self.surface, tools);
                let inside = shows.then_some(&mut self.raycaster);
                self.composer
                    .boundary_image(surface, inside, &self.camera, self.size)
            }
            DisplayMode::Surface => {
                let camera = &self.camera;
                self.surface.image_of_samples(camera, self.size, samples)
            }
            DisplayMode::Skin => {
                let all = self.skins.iter_mut().chain(tools);
                self.composer.image(all, None, &self.camera, self.size)
            }
        }
    }

    /// Records the drawing of the picture into `colour`, whose size replaces the scene's, on
    /// the backdrop: for callers with encoders and views of their own. Reads nothing back.
    ///
    /// # Errors
    /// As [`Raycaster::record`](crate::render::Raycaster::record).
    pub fn record(&mut self, work: &mut Recorder, colour: &wgpu::TextureView) -> Result<()> {
        self.publish(work)?;
        self.refresh_field()?;
        self.follow_tools()?;
        let background = Some(self.backdrop);
        let target = Target {
            colour,
            depth: None,
            background,
        };
        let size = [colour.texture().width(), colour.texture().height()];
        // Tools that are put away cost nothing.
        let seen = |tool: &ToolSkin| tool.is_in_view(&self.camera, size);
        let seen: Vec<bool> = self.tools.iter().map(seen).collect();
        let has_tools = seen.contains(&true);
        let shows = self.raycaster.inside().has_surfaces();
        if self.mode == DisplayMode::Surface && !(shows || has_tools) {
            let depth = self.depth_for(colour)?;
            let target = SurfaceTarget {
                colour,
                depth: &depth,
                background,
            };
            return self.surface.record(work, &self.camera, &target);
        }
        let camera = &self.camera;
        let bare = self.skins.is_empty() && !has_tools;
        let tools = self.tools.iter_mut().zip(seen);
        let tools = tools.filter_map(|(tool, seen)| seen.then_some(&mut tool.skin));
        match self.mode {
            DisplayMode::Skin => {
                let all = self.skins.iter_mut().chain(tools);
                self.composer.record(work, all, None, camera, &target)
            }
            DisplayMode::Inside(Mode::Composite) if !bare => {
                let inside = Some(&mut self.raycaster);
                let all = self.skins.iter_mut().chain(tools);
                self.composer.record(work, all, inside, camera, &target)
            }
            DisplayMode::Inside(mode) => self.raycaster.record(work, camera, mode, &target),
            DisplayMode::Surface => {
                let surface = (&mut self.surface, tools);
                let inside = shows.then_some(&mut self.raycaster);
                self.composer
                    .record_boundary(work, surface, inside, camera, &target)
            }
        }
    }

    /// Asks for the picture as [`Stage::record`] draws it, on nothing, and waits for none of it: who
    /// cannot wait, as in a browser, looks when it is there. Each channel has eight bits.
    ///
    /// # Errors
    /// As [`Stage::record`].
    pub fn render_async(&mut self) -> Result<PendingImage> {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let target = self.gpu.target("picture", self.size, format, usage)?;
        let backdrop = std::mem::replace(&mut self.backdrop, [0.0; 4]);
        let mut work = self.gpu.start_recording();
        let recorded = self.record(&mut work, &target);
        self.backdrop = backdrop;
        recorded?;
        work.submit()?;
        Ok(PendingImage {
            size: self.size,
            pixels: self.gpu.read_texture_async(target.texture())?,
        })
    }

    /// A depth attachment of the size of `colour`, kept for the next picture.
    fn depth_for(&mut self, colour: &wgpu::TextureView) -> Result<wgpu::TextureView> {
        let texture = colour.texture();
        if let Some(depth) = &self.depth
            && depth.texture().size() == texture.size()
        {
            return Ok(depth.clone());
        }
        let depth = self.gpu.target(
            "depth",
            [texture.width(), texture.height()],
            wgpu::TextureFormat::Depth32Float,
            wgpu::TextureUsages::RENDER_ATTACHMENT,
        )?;
        self.depth = Some(depth.clone());
        Ok(depth)
    }

    /// The extension that suits the pictures of this stage.
    pub fn picture_extension(&self) -> &'static str {
        match self.mode {
            DisplayMode::Inside(Mode::Thickness) => "exr",
            _ => "png",
        }
    }
}
