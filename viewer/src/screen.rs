//! The picture within the window: a texture rendered at lower resolution while something moves.

use crate::blit::{Blit, PresentCallback};
use crate::body_session::BodySession;
use eframe::egui;
use eframe::egui_wgpu::RenderState;
use palpate::Result;
use palpate::gpu::Gpu;
use palpate::render::{Camera, ProgressivePaths};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use web_time::Instant;

/// Maximum rendering time of a picture during motion, s.
const FRAME_BUDGET: f64 = 0.03;
/// Resolution per axis relative to the window, during motion: from fine to coarse.
const RESOLUTION_SCALES: [f64; 4] = [1.0, 0.8, 0.64, 0.5];
/// Tiles of light paths that a frame begins with, before the time of one is known.
const FIRST_TILES: usize = 1;
/// Time without motion before the picture is rendered at full resolution.
const IDLE_DELAY: Duration = Duration::from_millis(120);

/// State that a picture shows.
#[derive(Clone, Copy, PartialEq)]
struct DrawnState {
    version: u64,
    camera: Camera,
    backdrop: [f32; 4],
    size: [u32; 2],
}

/// The render target of pictures.
#[derive(Default)]
pub struct Screen {
    texture: Option<Texture>,
    blit: Option<Blit>,
    shown: Option<DrawnState>,
    moved: Option<Instant>,
    /// The picture by light paths that sets in at rest, if the scene has one.
    paths: Option<Paths>,
    /// Whether it could not be started, and whether it was asked for since the last motion.
    paths_failed: bool,
    paths_asked: bool,
    /// Index of the resolution scale used during motion.
    coarse: usize,
    /// The last submitted picture: time and pixels, and the measured time per million pixels.
    sent: Arc<Mutex<SubmittedFrame>>,
    /// Number of pictures rendered.
    pub pictures: u64,
}

/// Light paths that set in.
struct Paths {
    picture: ProgressivePaths,
    /// Tiles that the last frame drew, and those of the next.
    tiles: usize,
    /// When the last tiles were submitted; none once they are drawn. And how long they took.
    sent: Arc<Mutex<(Option<Instant>, Duration)>>,
}

/// A texture, to render into and to display.
struct Texture {
    view: wgpu::TextureView,
    shown: wgpu::BindGroup,
}

#[derive(Default)]
struct SubmittedFrame {
    at: Option<(Instant, f64)>,
    seconds_a_million: Option<f64>,
}

impl Screen {
    /// Renders `show` from `camera` with `size` pixels, if anything changed. Returns whether a
    /// refinement is pending.
    ///
    /// # Errors
    /// The errors of [`BodySession::record`].
    pub fn draw(
        &mut self,
        (gpu, state): (&Gpu, &RenderState),
        show: &mut BodySession,
        (camera, backdrop): (&Camera, [f32; 4]),
        size: [u32; 2],
    ) -> Result<bool> {
        let now = Instant::now();
        let wanted = |size| DrawnState {
            version: show.version,
            camera: *camera,
            backdrop,
            size,
        };
        let differs = |a: &DrawnState, b: &DrawnState| {
            (a.version, a.camera, a.backdrop) != (b.version, b.camera, b.backdrop)
        };
        let full = wanted(size);
        let moves = self
            .shown
            .as_ref()
            .is_none_or(|shown| differs(shown, &full));
        if moves && self.shown.is_some() {
            self.moved = Some(now);
        }
        let still = self
            .moved
            .is_none_or(|moved| now.duration_since(moved) >= IDLE_DELAY);
        let size = match still {
            true => size,
            false => {
                self.choose(size);
                size.map(|n| {
                    ((f64::from(n) * RESOLUTION_SCALES[self.coarse]).round() as u32).max(1)
                })
            }
        };
        let next = wanted(size);
        let finer = self
            .shown
            .as_ref()
            .is_some_and(|shown| shown.size[0] < next.size[0]);
        let due = moves || self.shown != Some(next) && (still || !finer);
        if !due && self.texture.is_some() {
            if self.shown != Some(full) {
                return Ok(true);
            }
            return self.draw_paths(state, show, size);
        }
        (self.paths, self.paths_failed, self.paths_asked) = (None, false, false);
        let view = self.target(state, size);
        let mut work = gpu.start_recording();
        show.record(&mut work, camera, (&view, backdrop))?;
        work.submit()?;
        self.note(state, now, size);
        self.shown = Some(next);
        self.pictures += 1;
        Ok(next != full)
    }

    /// Draws some tiles of the light paths of a scene at rest. Returns whether more are to come.
    fn draw_paths(
        &mut self,
        state: &RenderState,
        show: &mut BodySession,
        size: [u32; 2],
    ) -> Result<bool> {
        let Some(texture) = self.texture.as_ref().map(|t| t.view.texture().clone()) else {
            return Ok(false);
        };
        if self.paths.is_none() {
            let wanted = show.stage().draws_paths();
            if !wanted || self.paths_failed || show.is_going() {
                return Ok(false);
            }
            self.paths_failed = true;
            let picture = show.start_paths(size, !self.paths_asked)?;
            (self.paths_failed, self.paths_asked) = (false, true);
            // Surfaces are read back, which a browser cannot wait for.
            let Some(picture) = picture else {
                return Ok(true);
            };
            self.paths = Some(Paths {
                picture,
                tiles: FIRST_TILES,
                sent: Arc::default(),
            });
        }
        let Some(paths) = self.paths.as_mut().filter(|p| !p.picture.is_done()) else {
            return Ok(false);
        };
        let (under_way, took) = *paths.sent.lock().unwrap_or_else(PoisonError::into_inner);
        if under_way.is_some() {
            return Ok(true);
        }
        if took > Duration::ZERO {
            let more = match took.as_secs_f64() < 0.5 * FRAME_BUDGET {
                true => 2 * paths.tiles,
                false => (paths.tiles as f64 * FRAME_BUDGET / took.as_secs_f64()) as usize,
            };
            paths.tiles = more.clamp(1, paths.picture.tiles());
        }
        let began = Instant::now();
        *paths.sent.lock().unwrap_or_else(PoisonError::into_inner) = (Some(began), took);
        paths.picture.draw(&texture, paths.tiles)?;
        let sent = paths.sent.clone();
        state.queue.on_submitted_work_done(move || {
            *sent.lock().unwrap_or_else(PoisonError::into_inner) = (None, began.elapsed());
        });
        Ok(true)
    }

    /// Returns the samples per pixel of the light paths shown; `None` for other pictures.
    pub fn path_samples(&self) -> Option<u32> {
        self.paths.as_ref().map(|paths| paths.picture.samples())
    }

    /// Forces the next picture to be rendered.
    pub fn invalidate(&mut self) {
        self.shown = None;
    }

    /// Records the submission of a picture, and its completion time.
    fn note(&self, state: &RenderState, now: Instant, size: [u32; 2]) {
        let millions = 1e-6 * f64::from(size[0]) * f64::from(size[1]);
        let sent = self.sent.clone();
        lock(&sent).at = Some((now, millions));
        state.queue.on_submitted_work_done(move || {
            let mut sent = lock(&sent);
            if sent.at == Some((now, millions)) {
                let seconds = now.elapsed().as_secs_f64() / millions.max(1e-6);
                let before = sent.seconds_a_million.unwrap_or(seconds);
                sent.seconds_a_million = Some(0.6 * before + 0.4 * seconds);
            }
        });
    }

    /// Selects the finest resolution scale within the frame budget.
    fn choose(&mut self, [width, height]: [u32; 2]) {
        let Some(seconds) = lock(&self.sent).seconds_a_million else {
            self.coarse = RESOLUTION_SCALES.len() - 1;
            return;
        };
        let pixels = 1e-6 * f64::from(width) * f64::from(height);
        let soon = |share: &f64| seconds * pixels * share * share <= FRAME_BUDGET;
        let best = RESOLUTION_SCALES
            .iter()
            .position(soon)
            .unwrap_or(RESOLUTION_SCALES.len() - 1);
        // Hysteresis: refine only if there is time to spare.
        let spare = seconds * pixels * RESOLUTION_SCALES[best].powi(2) <= 0.7 * FRAME_BUDGET;
        if best > self.coarse || spare {
            self.coarse = best;
        }
    }

    /// Returns the texture of this size.
    fn target(&mut self, state: &RenderState, size: [u32; 2]) -> wgpu::TextureView {
        if let Some(Texture { view, .. }) = &self.texture
            && [view.texture().width(), view.texture().height()] == size
        {
            return view.clone();
        }
        let texture = state.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: wgpu::Extent3d {
                width: size[0],
                height: size[1],
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            // Tiles of light paths are copied to it.
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let blit = self.blit.get_or_insert_with(|| Blit::new(state));
        self.texture = Some(Texture {
            shown: blit.bind_texture(&state.device, &view),
            view: view.clone(),
        });
        view
    }

    /// Returns the shape that draws the picture over `rect`; `None` before the first picture. `until`
    /// is dropped when the frame is presented.
    pub(crate) fn shape(&self, rect: egui::Rect, until: PresentCallback) -> Option<egui::Shape> {
        let (blit, texture) = (self.blit.as_ref()?, self.texture.as_ref()?);
        Some(blit.shape(&texture.shown, rect, Some(until)))
    }
}

fn lock(sent: &Mutex<SubmittedFrame>) -> std::sync::MutexGuard<'_, SubmittedFrame> {
    sent.lock().unwrap_or_else(PoisonError::into_inner)
}
