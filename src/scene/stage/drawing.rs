//! Rendering of a stage in the current configuration, with a cached frame.

use super::{NodeSource, Stage};
use crate::gpu::{PendingReadback, Recorder};
use crate::progress::{ProgressFn, no_progress};
use crate::render::{Camera, Image, Mode, Pick, SurfaceTarget, Target};
use crate::scene::picture::DisplayMode;
use crate::scene::tool_skin::ToolSkin;
use crate::{Error, Result};
use glam::DVec2;

/// A rendered picture with the state that it shows.
pub(in crate::scene) struct CachedFrame {
    version: u64,
    camera: Camera,
    image: Image,
    /// Linear light, if drawn by light paths.
    linear: Option<Image>,
}

/// A picture being read back from the device; see [`Stage::render_async`].
#[derive(Debug)]
pub struct PendingImage {
    size: [u32; 2],
    pixels: PendingReadback<[u8; 4]>,
}

impl PendingImage {
    /// Returns the picture once it has arrived.
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
    /// Updates the displayed nodes from the simulation and submits the work.
    pub(super) fn publish_now(&mut self) -> Result<()> {
        let mut work = self.gpu.start_recording();
        self.publish(&mut work)?;
        work.submit()
    }

    /// Records the update of the displayed nodes from the simulation.
    pub(super) fn publish(&mut self, work: &mut Recorder) -> Result<()> {
        if let NodeSource::Simulated(motion) = &mut self.drive {
            motion.simulator.update_nodes(work)?;
        }
        if let Some(drawn) = &mut self.looks.drawn {
            drawn.follow(work, self.drive.nodes());
        }
        let geometry = match &self.looks.drawn {
            Some(drawn) => &drawn.picker,
            None => self.looks.raycaster.geometry(),
        };
        let mesh = self.drive.mesh();
        let drawn = [geometry.positions().len(), geometry.tet_count()].map(|n| n as usize);
        if drawn != [mesh.nodes.len(), mesh.tets.len()] {
            return Err(Error::Input(
                "the body was cut without the stage, so it cannot be rendered; cut it with Stage::cut".into(),
            ));
        }
        Ok(())
    }

    /// Returns the visible point of the body's boundary at `pixel` of the picture in the current
    /// configuration; `None` if the ray misses. If the device moves the nodes, this waits and reads
    /// 36 bytes back; for a body on the CPU it uses the positions uploaded last.
    ///
    /// # Errors
    /// As [`Geometry::pick`](crate::render::Geometry::pick).
    pub fn pick(&mut self, pixel: DVec2) -> Result<Option<Pick>> {
        self.publish_now()?;
        let geometry = match &self.looks.drawn {
            Some(drawn) => &drawn.picker,
            None => self.looks.raycaster.geometry(),
        };
        match self.drive.nodes().put() {
            Some(positions) => {
                geometry.pick_positions(&positions, &self.looks.camera, pixel, self.looks.size)
            }
            None => geometry.pick(&self.looks.camera, pixel, self.looks.size),
        }
    }

    /// Returns the picture of the scene; the cached one if neither body nor camera has moved.
    ///
    /// # Errors
    /// As [`Raycaster::image`](crate::render::Raycaster::image).
    pub fn image(&mut self) -> Result<Image> {
        self.image_with_progress(&no_progress)
    }

    /// As [`Stage::image`]; reports the progress of light paths.
    ///
    /// # Errors
    /// As [`Stage::image`], and [`Error::Cancelled`].
    pub fn image_with_progress(&mut self, progress: ProgressFn) -> Result<Image> {
        self.publish_now()?;
        if self.follow_tools()? {
            self.cached = None;
        }
        let version = self.drive.nodes().version();
        if let Some(cached) = &self.cached
            && (cached.version, cached.camera) == (version, self.looks.camera)
        {
            self.pictures[1] += 1;
            return Ok(cached.image.clone());
        }
        let (image, linear) = match self.looks.paths.clone() {
            Some(options) => {
                self.refresh_field()?;
                let [shown, linear] = self.draw_paths(&options, progress)?;
                (shown, Some(linear))
            }
            None => (self.draw()?, None),
        };
        self.pictures[0] += 1;
        self.cached = Some(CachedFrame {
            version,
            camera: self.looks.camera,
            image: image.clone(),
            linear,
        });
        Ok(image)
    }

    /// Returns the values for an EXR: linear light of light paths, otherwise the picture.
    pub(in crate::scene) fn raw_image(&mut self, progress: ProgressFn) -> Result<Image> {
        let image = self.image_with_progress(progress)?;
        let linear = self
            .cached
            .as_ref()
            .and_then(|cached| cached.linear.clone());
        Ok(linear.unwrap_or(image))
    }

    /// Updates the displayed tools to their poses. Returns whether any has moved.
    pub(super) fn follow_tools(&mut self) -> Result<bool> {
        let mut moved = false;
        if let NodeSource::Simulated(motion) = &self.drive {
            for tool in &mut self.looks.tools {
                moved |= tool.follow(&self.gpu, motion)?;
            }
        }
        Ok(moved)
    }

    pub(super) fn draw(&mut self) -> Result<Image> {
        self.refresh_field()?;
        let samples = self.looks.samples;
        let bare = self.looks.skins.is_empty() && self.looks.tools.is_empty();
        let shows = self.looks.raycaster.inside().has_surfaces();
        let tools = self.looks.tools.iter_mut().map(|tool| &mut tool.skin);
        match self.looks.mode {
            DisplayMode::Inside(Mode::Composite) if !bare => {
                let inside = Some(&mut self.looks.raycaster);
                let all = self.looks.skins.iter_mut().chain(tools);
                self.looks
                    .composer
                    .image(all, inside, &self.looks.camera, self.looks.size)
            }
            DisplayMode::Inside(mode) => {
                let fine = self.looks.size.map(|n| n.saturating_mul(samples));
                let image = self.looks.raycaster.image(&self.looks.camera, fine, mode)?;
                Ok(match samples {
                    1 => image,
                    n => image.box_downsampled(n),
                })
            }
            DisplayMode::Surface if shows || tools.len() > 0 => {
                let surface = (&mut self.looks.surface, tools);
                let inside = shows.then_some(&mut self.looks.raycaster);
                self.looks.composer.boundary_image(
                    surface,
                    inside,
                    &self.looks.camera,
                    self.looks.size,
                )
            }
            DisplayMode::Surface => {
                let camera = &self.looks.camera;
                self.looks
                    .surface
                    .image_of_samples(camera, self.looks.size, samples)
            }
            DisplayMode::Skin => {
                let all = self.looks.skins.iter_mut().chain(tools);
                self.looks
                    .composer
                    .image(all, None, &self.looks.camera, self.looks.size)
            }
        }
    }

    /// Records the rendering of the picture into `colour`, whose size replaces the scene's, over
    /// the backdrop: for callers with their own encoders and views. Reads nothing back. Light is
    /// local, also in a scene with light paths.
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
        // Tools outside the view are skipped.
        let seen = |tool: &ToolSkin| tool.is_in_view(&self.looks.camera, size);
        let seen: Vec<bool> = self.looks.tools.iter().map(seen).collect();
        let has_tools = seen.contains(&true);
        let shows = self.looks.raycaster.inside().has_surfaces();
        if self.looks.mode == DisplayMode::Surface && !(shows || has_tools) {
            let depth = self.depth_for(colour)?;
            let target = SurfaceTarget {
                colour,
                depth: &depth,
                background,
            };
            return self.looks.surface.record(work, &self.looks.camera, &target);
        }
        let camera = &self.looks.camera;
        let bare = self.looks.skins.is_empty() && !has_tools;
        let tools = self.looks.tools.iter_mut().zip(seen);
        let tools = tools.filter_map(|(tool, seen)| seen.then_some(&mut tool.skin));
        match self.looks.mode {
            DisplayMode::Skin => {
                let all = self.looks.skins.iter_mut().chain(tools);
                self.looks.composer.record(work, all, None, camera, &target)
            }
            DisplayMode::Inside(Mode::Composite) if !bare => {
                let inside = Some(&mut self.looks.raycaster);
                let all = self.looks.skins.iter_mut().chain(tools);
                self.looks
                    .composer
                    .record(work, all, inside, camera, &target)
            }
            DisplayMode::Inside(mode) => self.looks.raycaster.record(work, camera, mode, &target),
            DisplayMode::Surface => {
                let surface = (&mut self.looks.surface, tools);
                let inside = shows.then_some(&mut self.looks.raycaster);
                self.looks
                    .composer
                    .record_boundary(work, surface, inside, camera, &target)
            }
        }
    }

    /// Starts rendering as by [`Stage::record`], over transparent black, without waiting: callers
    /// that cannot block, as in a browser, poll the result. Each channel has eight bits.
    ///
    /// # Errors
    /// As [`Stage::record`].
    pub fn render_async(&mut self) -> Result<PendingImage> {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let format = wgpu::TextureFormat::Rgba8Unorm;
        let target = self.gpu.target("picture", self.looks.size, format, usage)?;
        let backdrop = std::mem::replace(&mut self.backdrop, [0.0; 4]);
        let mut work = self.gpu.start_recording();
        let recorded = self.record(&mut work, &target);
        self.backdrop = backdrop;
        recorded?;
        work.submit()?;
        Ok(PendingImage {
            size: self.looks.size,
            pixels: self.gpu.read_texture_async(target.texture())?,
        })
    }

    /// Returns a depth attachment of the size of `colour`, reused for the next picture.
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

    /// Returns the file extension of the pictures of this stage.
    pub fn picture_extension(&self) -> &'static str {
        match self.looks.mode {
            DisplayMode::Inside(Mode::Thickness) => "exr",
            _ => "png",
        }
    }
}
