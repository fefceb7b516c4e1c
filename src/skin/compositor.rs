//! Composites skins, the boundary and a volume into one image, in depth order.
//!
//! Opaque skins terminate the rays of the volume. Translucent ones are drawn by depth peeling,
//! front to back; the volume is rendered once more up to each layer, and the contribution between
//! two layers is the difference. So skin is blended exactly in front of, inside and behind the
//! volume.

use super::draw::{BlendMode, Skin};
use crate::gpu::{Draw, Gpu, Recorder};
use crate::render::{
    CACHED_SIZES, Camera, Image, ImageRegion, Mode, Raycaster, Surface, SurfaceTarget, Target,
    attachment, draw_supersampled,
};
use crate::{Error, Result};

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Blend {
            pub background: [f32; 4],
        }
    }
}

/// Options of a [`Compositor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CompositorOptions {
    /// Maximum number of translucent layers that are peeled; layers behind them are dropped. Each
    /// costs another rendering of the volume.
    pub layers: u32,
    /// Supersampling factor per axis for images read back to memory.
    pub samples: u32,
}

impl Default for CompositorOptions {
    fn default() -> CompositorOptions {
        CompositorOptions {
            layers: 4,
            samples: 2,
        }
    }
}

/// Contents of one image.
struct DrawnImage<'a> {
    boundary: Option<&'a mut Surface>,
    skins: Vec<&'a mut Skin>,
    raycaster: Option<&'a mut Raycaster>,
}

impl DrawnImage<'_> {
    fn reborrow(&mut self) -> DrawnImage<'_> {
        DrawnImage {
            boundary: self.boundary.as_deref_mut(),
            skins: self.skins.iter_mut().map(|s| &mut **s).collect(),
            raycaster: self.raycaster.as_deref_mut(),
        }
    }
}

/// Renders skins and a volume into one image.
pub struct Compositor {
    gpu: Gpu,
    options: CompositorOptions,
    /// Render targets of the most recently used sizes, latest first.
    targets: Vec<Targets>,
}

const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
const ACCUMULATOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
/// Maximum number of layers.
const MAX_LAYERS: u32 = 64;

/// Render targets for one image size.
struct Targets {
    size: [u32; 2],
    opaque: wgpu::TextureView,
    opaque_depth: wgpu::TextureView,
    layer: wgpu::TextureView,
    /// For even and odd layers.
    depths: [wgpu::TextureView; 2],
    volumes: [wgpu::TextureView; 2],
    sums: [wgpu::TextureView; 2],
    /// Blend draws of the first layer, and of even and odd layers.
    first: Draw,
    blends: [Draw; 2],
}

impl Compositor {
    /// Creates a compositor.
    ///
    /// # Errors
    /// [`Error::Input`] for more than 64 layers, or samples that are not from 1 to 8.
    pub fn new(gpu: &Gpu, options: CompositorOptions) -> Result<Compositor> {
        if options.layers > MAX_LAYERS || !(1..=8).contains(&options.samples) {
            return Err(Error::Input(format!(
                "the compositor supports up to {MAX_LAYERS} skin layers and 1 to 8 samples, got {} and {}",
                options.layers, options.samples
            )));
        }
        Ok(Compositor {
            gpu: gpu.clone(),
            options,
            targets: Vec::new(),
        })
    }

    /// Records the rendering of `skins` and of the volume that `raycaster` draws into `target`; the
    /// depth buffer of the target holds the caller's opaque occluders. Reads nothing back.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid camera, or if skins and volume do not share their local
    /// frame; [`Error::Gpu`] if the device fails.
    pub fn record<'s>(
        &mut self,
        work: &mut Recorder,
        skins: impl IntoIterator<Item = &'s mut Skin>,
        raycaster: Option<&mut Raycaster>,
        camera: &Camera,
        target: &Target,
    ) -> Result<()> {
        let texture = target.colour.texture();
        let window = ImageRegion::full([texture.width(), texture.height()]);
        let scene = DrawnImage {
            boundary: None,
            skins: skins.into_iter().collect(),
            raycaster,
        };
        self.record_window(work, scene, camera, target, window)
    }

    /// As [`Compositor::record`], for the lit boundary, `skins`, and the slices, isosurfaces and
    /// cut faces that `raycaster` draws, if any.
    ///
    /// # Errors
    /// As [`Compositor::record`].
    pub fn record_boundary<'s>(
        &mut self,
        work: &mut Recorder,
        (boundary, skins): (&mut Surface, impl IntoIterator<Item = &'s mut Skin>),
        raycaster: Option<&mut Raycaster>,
        camera: &Camera,
        target: &Target,
    ) -> Result<()> {
        let texture = target.colour.texture();
        let window = ImageRegion::full([texture.width(), texture.height()]);
        let scene = DrawnImage {
            boundary: Some(boundary),
            skins: skins.into_iter().collect(),
            raycaster,
        };
        self.record_window(work, scene, camera, target, window)
    }

    /// Renders the image of [`Compositor::record_boundary`] at `size` pixels on a transparent
    /// background. Waits and reads back.
    ///
    /// # Errors
    /// As [`Compositor::record`].
    pub fn boundary_image<'s>(
        &mut self,
        (boundary, skins): (&mut Surface, impl IntoIterator<Item = &'s mut Skin>),
        raycaster: Option<&mut Raycaster>,
        camera: &Camera,
        size: [u32; 2],
    ) -> Result<Image> {
        let scene = DrawnImage {
            boundary: Some(boundary),
            skins: skins.into_iter().collect(),
            raycaster,
        };
        self.image_of(scene, camera, size)
    }

    /// Renders the image of `camera` at `size` pixels on a transparent background. Waits and reads
    /// back.
    ///
    /// # Errors
    /// As [`Compositor::record`].
    pub fn image<'s>(
        &mut self,
        skins: impl IntoIterator<Item = &'s mut Skin>,
        raycaster: Option<&mut Raycaster>,
        camera: &Camera,
        size: [u32; 2],
    ) -> Result<Image> {
        let scene = DrawnImage {
            boundary: None,
            skins: skins.into_iter().collect(),
            raycaster,
        };
        self.image_of(scene, camera, size)
    }

    fn image_of(
        &mut self,
        mut scene: DrawnImage,
        camera: &Camera,
        size: [u32; 2],
    ) -> Result<Image> {
        let gpu = self.gpu.clone();
        let samples = self.options.samples;
        draw_supersampled(&gpu, size, samples, |colour, window| {
            let target = Target {
                colour,
                depth: None,
                background: Some([0.0; 4]),
            };
            let mut work = gpu.start_recording();
            self.record_window(&mut work, scene.reborrow(), camera, &target, window)?;
            work.submit()
        })
    }

    /// Records one tile: the opaque surfaces, then the layers of translucent skins with the volume
    /// before each.
    fn record_window(
        &mut self,
        work: &mut Recorder,
        scene: DrawnImage,
        camera: &Camera,
        target: &Target,
        window: ImageRegion,
    ) -> Result<()> {
        camera.check()?;
        let DrawnImage {
            boundary,
            mut skins,
            mut raycaster,
        } = scene;
        check_frames(&skins, raycaster.as_deref())?;
        self.use_targets(window.size)?;
        let (gpu, targets) = (&self.gpu, &self.targets[0]);
        let translucent = skins.iter().any(|s| s.opacity() < 1.0);
        let layers = if translucent { self.options.layers } else { 0 };
        targets.begin(gpu, work, target.depth)?;
        if raycaster.is_none() {
            targets.clear_volumes(work);
        }
        let into = SurfaceTarget {
            colour: &targets.opaque,
            depth: &targets.opaque_depth,
            background: None,
        };
        if let Some(boundary) = boundary {
            boundary.record_window(work, camera, &into, window)?;
        }
        for skin in skins.iter() {
            skin.carrier().record_normals(work);
        }
        for skin in skins.iter_mut().filter(|s| s.opacity() >= 1.0) {
            skin.record_window(work, camera, &into, window, BlendMode::default())?;
        }
        for i in 0..layers as usize {
            let (now, before) = (i % 2, 1 - i % 2);
            targets.clear_layer(work, now);
            for skin in skins.iter_mut().filter(|s| s.opacity() < 1.0) {
                let into = SurfaceTarget {
                    colour: &targets.layer,
                    depth: &targets.depths[now],
                    background: None,
                };
                let how = BlendMode {
                    behind: (i > 0).then_some(&targets.depths[before]),
                    blended: false,
                };
                skin.record_window(work, camera, &into, window, how)?;
            }
            if let Some(raycaster) = raycaster.as_deref_mut() {
                let into = Target {
                    colour: &targets.volumes[now],
                    depth: Some(&targets.depths[now]),
                    background: Some([0.0; 4]),
                };
                raycaster.record_region(work, camera, Mode::Composite, &into, window)?;
            }
            let colour = [attachment(&targets.sums[now], wgpu::LoadOp::Load)];
            let mut pass = work.render_pass("skin/blend", &colour, None);
            let blend = match i {
                0 => &targets.first,
                _ => &targets.blends[now],
            };
            blend.record(&mut pass, 3, 1);
        }
        let now = layers as usize % 2;
        if let Some(raycaster) = raycaster {
            let into = Target {
                colour: &targets.volumes[now],
                depth: Some(&targets.opaque_depth),
                background: Some([0.0; 4]),
            };
            raycaster.record_region(work, camera, Mode::Composite, &into, window)?;
        }
        targets.finish(gpu, work, target, layers)
    }

    /// Makes the targets of this size the first ones.
    fn use_targets(&mut self, size: [u32; 2]) -> Result<()> {
        let kept = self.targets.iter().position(|t| t.size == size);
        let targets = match kept {
            Some(at) => self.targets.remove(at),
            None => Targets::new(&self.gpu, size)?,
        };
        self.targets.truncate(CACHED_SIZES - 1);
        self.targets.insert(0, targets);
        Ok(())
    }
}

/// Checks that skins and volume share their local frame.
fn check_frames(skins: &[&mut Skin], raycaster: Option<&Raycaster>) -> Result<()> {
    let volume_frame = raycaster.map(|r| r.geometry().frame());
    let mut frames = skins
        .iter()
        .map(|s| s.carrier().frame())
        .chain(volume_frame);
    if let Some(first) = frames.next()
        && frames.any(|f| f != first)
    {
        return Err(Error::Input(
            "skins and volume of an image must have the same local frame; use those of one body"
                .into(),
        ));
    }
    Ok(())
}

impl Targets {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Targets> {
        let texture = |format| {
            let copied = match format {
                DEPTH => wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST,
                _ => wgpu::TextureUsages::empty(),
            };
            gpu.target(
                "layers of skin",
                size,
                format,
                wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | copied,
            )
        };
        let layer = texture(ACCUMULATOR_FORMAT)?;
        let volumes = [texture(ACCUMULATOR_FORMAT)?, texture(ACCUMULATOR_FORMAT)?];
        let sums = [texture(ACCUMULATOR_FORMAT)?, texture(ACCUMULATOR_FORMAT)?];
        let blend = |now: usize, first: bool| {
            let before = 1 - now;
            gpu.draw("skin/blend")
                .constant("FIRST_LAYER", f64::from(u8::from(first)))
                .read(&sums[before])
                .read(&volumes[before])
                .read(&volumes[now])
                .read(&layer)
                .params(&gpu_data::Blend {
                    background: [0.0; 4],
                })
                .target(ACCUMULATOR_FORMAT, None)
                .build()
        };
        Ok(Targets {
            size,
            opaque: texture(ACCUMULATOR_FORMAT)?,
            opaque_depth: texture(DEPTH)?,
            depths: [texture(DEPTH)?, texture(DEPTH)?],
            first: blend(0, true)?,
            blends: [blend(0, false)?, blend(1, false)?],
            layer,
            volumes,
            sums,
        })
    }

    /// Clears the opaque colour and initialises its depth from the caller's occluders.
    fn begin(
        &self,
        gpu: &Gpu,
        work: &mut Recorder,
        occluder: Option<&wgpu::TextureView>,
    ) -> Result<()> {
        clear(work, &self.opaque);
        let depth = wgpu::RenderPassDepthStencilAttachment {
            view: &self.opaque_depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0.0),
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        };
        let copy = match occluder {
            Some(occluder) => Some(
                gpu.draw("skin/depth")
                    .read(occluder)
                    .depth(DEPTH, wgpu::CompareFunction::Always, true)
                    .build()?,
            ),
            None => None,
        };
        let mut pass = work.render_pass("skin/depth", &[], Some(depth));
        if let Some(copy) = copy {
            copy.record(&mut pass, 3, 1);
        }
        Ok(())
    }

    /// Clears the volume targets, for an image without a volume.
    fn clear_volumes(&self, work: &mut Recorder) {
        self.volumes.iter().for_each(|volume| clear(work, volume));
    }

    /// Starts a layer: clears its colour and sets its depth to that of the opaque objects.
    fn clear_layer(&self, work: &mut Recorder, now: usize) {
        clear(work, &self.layer);
        work.encoder().copy_texture_to_texture(
            self.opaque_depth.texture().as_image_copy(),
            self.depths[now].texture().as_image_copy(),
            self.opaque_depth.texture().size(),
        );
    }

    /// Adds the remaining volume and the opaque colour, and draws the result into `target`.
    fn finish(&self, gpu: &Gpu, work: &mut Recorder, target: &Target, layers: u32) -> Result<()> {
        let now = layers as usize % 2;
        let before = 1 - now;
        let over = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;
        let draw = gpu
            .draw("skin/blend")
            .constant("LAST_LAYER", 1.0)
            .constant("FIRST_LAYER", f64::from(u8::from(layers == 0)))
            .read(&self.sums[before])
            .read(&self.volumes[before])
            .read(&self.volumes[now])
            .read(&self.opaque)
            .params(&gpu_data::Blend {
                background: target.background.unwrap_or_default(),
            })
            .target(
                target.colour.texture().format(),
                target.background.is_none().then_some(over),
            )
            .build()?;
        let load = match target.background {
            Some(_) => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
            None => wgpu::LoadOp::Load,
        };
        let mut pass = work.render_pass("skin/blend", &[attachment(target.colour, load)], None);
        draw.record(&mut pass, 3, 1);
        Ok(())
    }
}

fn clear(work: &mut Recorder, view: &wgpu::TextureView) {
    let nothing = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);
    work.render_pass("skin/clear", &[attachment(view, nothing)], None);
}
