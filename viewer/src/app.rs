//! The application: open document, session state and the frame of the interface.

use crate::blit::PresentCallback;
use crate::body_session::BodySession;
use crate::camera_control::Orbit;
use crate::document::Document;
use crate::examples::Example;
use crate::histogram::Histogram;
use crate::loading::{Loading, live_tasks};
use crate::log::{self, Frame, FrameLog, memory_mb};
use crate::open::WatchedFile;
use crate::panel::PendingImport;
use crate::path_prompt::PathPrompt;
use crate::platform::DialogResult;
use crate::pointer_tool::{PointerGesture, PointerTool, Viewport};
use crate::save::PendingScreenshot;
use crate::screen::Screen;
use crate::settings::{Settings, Theme};
#[cfg(not(target_arch = "wasm32"))]
use crate::ui_cache::UiCache;
use eframe::egui;
use eframe::egui_wgpu::{SurfaceConfig, WgpuConfiguration, WgpuSetupCreateNew};
use glam::DVec3;
use palpate::gpu::{Gpu, submit_time};
use palpate::render::Camera;
use palpate::{Error, Result};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use web_time::Instant;

/// Default cutting depth of strokes, relative to the body's diagonal.
const CUT_DEPTH: f64 = 0.1;
/// In narrower windows, in points, the panels are hidden by default.
const COMPACT_WIDTH: f32 = 480.0;
/// A frame requested within this delay counts as immediate; text cursors blink more slowly.
const SOON: Duration = Duration::from_millis(200);
/// Width of the toolbar at the left, in points.
const TOOLBAR_WIDTH: f32 = 72.0;

/// Start options.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The file to open first.
    pub open: InitialFile,
    /// Log file of frame timings.
    pub log: Option<PathBuf>,
}

/// The file to open first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum InitialFile {
    /// Nothing yet.
    #[default]
    Nothing,
    /// A file.
    File(PathBuf),
    /// The example of this name.
    Example(String),
}

/// Returns the device configuration: the limits that Palpate requires.
pub(crate) fn device() -> WgpuConfiguration {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor.backends = wgpu::Backends::PRIMARY;
    setup.instance_descriptor.flags = wgpu::InstanceFlags::empty();
    setup.device_descriptor = Arc::new(|adapter| wgpu::DeviceDescriptor {
        label: Some("palpate-view"),
        required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
        required_limits: wgpu::Limits::default(),
        ..Default::default()
    });
    let surface = SurfaceConfig {
        present_mode: wgpu::PresentMode::AutoNoVsync,
        ..SurfaceConfig::LOW_LATENCY
    };
    WgpuConfiguration {
        surface,
        wgpu_setup: setup.into(),
        ..WgpuConfiguration::default()
    }
}

/// Asynchronous device errors: device loss and validation errors.
#[derive(Default)]
pub(crate) struct DeviceFault {
    pub lost: Option<String>,
    refused: Option<String>,
}

/// Records errors of the device and requests a frame that reports them.
fn listen(device: &wgpu::Device, context: &egui::Context) -> Arc<Mutex<DeviceFault>> {
    let trouble = Arc::new(Mutex::new(DeviceFault::default()));
    let (noted, looks) = (trouble.clone(), context.clone());
    device.set_device_lost_callback(move |_, why| {
        lock(&noted).lost = Some(why);
        looks.request_repaint();
    });
    let (noted, looks) = (trouble.clone(), context.clone());
    device.on_uncaptured_error(Arc::new(move |why: wgpu::Error| {
        lock(&noted).refused = Some(why.to_string());
        looks.request_repaint();
    }));
    trouble
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Callback for every frame.
pub(crate) type FrameObserver = Box<dyn FnMut(&Frame)>;

/// The application.
pub struct App {
    pub(crate) gpu: Gpu,
    /// The interface context, for calls from outside a frame.
    #[cfg(target_arch = "wasm32")]
    pub(crate) context: egui::Context,
    pub(crate) document: Option<Document>,
    pub(crate) loading: Option<Loading>,
    pub(crate) show: Option<BodySession>,
    pub(crate) orbit: Orbit,
    pub(crate) settings: Settings,
    pub(crate) pointer_tool: PointerTool,
    pub(crate) stroke: PointerGesture,
    pub(crate) area: Option<Viewport>,
    /// Whether a refinement of the picture is pending.
    pub(crate) refine_pending: bool,
    /// Whether the picture has the same size as in the frame before.
    pub(crate) settled: bool,
    pub(crate) ruler: Option<[DVec3; 2]>,
    /// Cutting depth of strokes, relative to the body's diagonal.
    pub(crate) cut_depth: f64,
    pub(crate) histogram: Option<Histogram>,
    /// Whether planes have handles in the picture.
    pub(crate) handles_shown: bool,
    /// The point of the transfer function that is being dragged.
    pub(crate) dragged: Option<usize>,
    /// The open path prompt.
    pub(crate) ask: Option<PathPrompt>,
    /// Width and height of saved pictures.
    pub(crate) picture: [u32; 2],
    /// Text of the status line, and whether it is an error.
    pub(crate) status: (String, bool),
    pub(crate) chosen: (Sender<DialogResult>, Receiver<DialogResult>),
    pub(crate) screen: Screen,
    pub(crate) watched: Option<WatchedFile>,
    /// A scan or a skin that is being read.
    pub(crate) taking: Option<PendingImport>,
    /// State of the tuning panel.
    #[cfg(not(target_arch = "wasm32"))]
    pub(crate) tuning: crate::panel::Tuning,
    /// A picture to save as soon as it is rendered.
    pub(crate) saved_picture: Option<PendingScreenshot>,
    /// The film that is being recorded.
    #[cfg(not(target_arch = "wasm32"))]
    pub(crate) recording: Option<crate::recording::Recording>,
    pub(crate) log: Option<FrameLog>,
    /// Whether the panels are shown, if the user chose.
    pub(crate) panels_shown: Option<bool>,
    /// Callback for every frame.
    pub(crate) told: Option<FrameObserver>,
    trouble: Arc<Mutex<DeviceFault>>,
    /// Number of bodies opened so far.
    pub(crate) opened: u64,
    pub(crate) frames: Frames,
}

/// Frame statistics and input state.
pub(crate) struct Frames {
    number: u64,
    last: Instant,
    since: (Instant, u64),
    /// Recent pictures per second.
    rate: f64,
    ui_ms: f64,
    driver_ms: f64,
    /// When the interface finished the last frame.
    pub done: Instant,
    /// Time of the oldest camera motion that no picture shows yet.
    pub moved: Option<Instant>,
    /// Pointer position, and whether a button is down; number of keys pressed.
    pointer: Option<[f32; 2]>,
    down: bool,
    keys: u64,
    screen: Arc<Mutex<Presentation>>,
}

/// Presentation times of frames.
#[derive(Default)]
struct Presentation {
    /// Number of the last frame that was presented, and when.
    number: u64,
    at: Option<Instant>,
    /// Whether the interface wants another frame at once.
    soon: bool,
    /// Latency from the last user input to the presentation of its picture, ms.
    latency_ms: Option<f64>,
}

impl Frames {
    /// Records pointer and key input.
    fn look(&mut self, context: &egui::Context) {
        context.input(|i| {
            self.pointer = i.pointer.latest_pos().map(|at| [at.x, at.y]);
            self.down = i.pointer.any_down();
            let hit =
                |event: &&egui::Event| matches!(event, egui::Event::Key { pressed: true, .. });
            self.keys += i.events.iter().filter(hit).count() as u64;
        });
    }

    /// Returns a callback that records when this frame is presented, in the log as well; `asked` is
    /// when its content was requested.
    pub fn until_presented(
        &self,
        asked: Option<Instant>,
        log: Option<(FrameLog, wgpu::Device)>,
    ) -> PresentCallback {
        let (number, screen) = (self.number, self.screen.clone());
        PresentCallback(Box::new(move || {
            let mut screen = lock(&screen);
            let now = Instant::now();
            (screen.number, screen.at) = (number, Some(now));
            if let Some(asked) = asked {
                screen.latency_ms = Some(1e3 * now.duration_since(asked).as_secs_f64());
            }
            if let Some((log, device)) = &log {
                // The report is slow, so skip it during motion.
                let report = match screen.soon {
                    true => None,
                    false => device.generate_allocator_report(),
                };
                // The next frame reports an error of the file.
                let _ = log.push(&log::Presented {
                    presented: number,
                    soon: screen.soon,
                    allocations: report.as_ref().map(|r| r.allocations.len()),
                    device_bytes: report.as_ref().map(|r| r.total_allocated_bytes),
                });
            }
        }))
    }

    /// Returns the time from the interface to the screen of the last frame, and its latency, ms.
    fn shown(&self) -> (f64, Option<f64>) {
        let screen = lock(&self.screen);
        let took = screen.at.map(|at| at.saturating_duration_since(self.done));
        (
            took.map_or(0.0, |t| 1e3 * t.as_secs_f64()),
            screen.latency_ms,
        )
    }
}

/// Records whether the interface wants another frame at once.
struct RepaintWatch(Arc<Mutex<Presentation>>);

impl egui::Plugin for RepaintWatch {
    fn debug_name(&self) -> &'static str {
        "repaint watch"
    }

    fn output_hook(&mut self, _: &egui::Context, output: &mut egui::FullOutput) {
        let mut viewports = output.viewport_output.values();
        lock(&self.0).soon = viewports.any(|viewport| viewport.repaint_delay < SOON);
    }
}

impl App {
    pub(crate) fn new(
        creation: &eframe::CreationContext<'_>,
        options: &Options,
    ) -> std::result::Result<App, String> {
        let state = creation.wgpu_render_state.as_ref();
        let state = state.ok_or("the window has no wgpu graphics device")?;
        let gpu = Gpu::from_wgpu(&state.adapter, state.device.clone(), state.queue.clone());
        let log = options.log.as_deref().map(FrameLog::create).transpose();
        let now = Instant::now();
        let still = Camera::perspective(DVec3::Z, DVec3::ZERO, DVec3::Y, 30.0);
        let mut app = App {
            gpu,
            #[cfg(target_arch = "wasm32")]
            context: creation.egui_ctx.clone(),
            document: None,
            loading: None,
            show: None,
            orbit: Orbit::of(&still, 1.0),
            settings: Settings::read(),
            pointer_tool: PointerTool::default(),
            stroke: PointerGesture::default(),
            area: None,
            settled: false,
            refine_pending: false,
            ruler: None,
            cut_depth: CUT_DEPTH,
            histogram: None,
            handles_shown: true,
            dragged: None,
            ask: None,
            picture: [1024, 768],
            status: (String::new(), false),
            chosen: channel(),
            screen: Screen::default(),
            watched: None,
            taking: None,
            #[cfg(not(target_arch = "wasm32"))]
            tuning: crate::panel::Tuning::default(),
            saved_picture: None,
            #[cfg(not(target_arch = "wasm32"))]
            recording: None,
            log: log.map_err(|e| e.to_string())?,
            panels_shown: None,
            told: None,
            trouble: listen(&state.device, &creation.egui_ctx),
            opened: 0,
            frames: Frames {
                number: 0,
                last: now,
                since: (now, 0),
                rate: 0.0,
                ui_ms: 0.0,
                driver_ms: 0.0,
                done: now,
                moved: None,
                pointer: None,
                down: false,
                keys: 0,
                screen: Arc::default(),
            },
        };
        // WebGPU in a browser is never a software driver.
        #[cfg(not(target_arch = "wasm32"))]
        creation.egui_ctx.add_plugin(UiCache::new(state));
        let watch = RepaintWatch(app.frames.screen.clone());
        creation.egui_ctx.add_plugin(watch);
        app.apply_theme(&creation.egui_ctx);
        match &options.open {
            InitialFile::Nothing => {}
            InitialFile::File(file) => app.open(file, &creation.egui_ctx),
            InitialFile::Example(name) => {
                let example = Example::named(name).map_err(|e| e.to_string())?;
                app.open_example(example, &creation.egui_ctx);
            }
        }
        Ok(app)
    }

    /// Applies the colour theme.
    pub(crate) fn apply_theme(&self, context: &egui::Context) {
        context.set_theme(match self.settings.theme {
            Theme::System => egui::ThemePreference::System,
            Theme::Dark => egui::ThemePreference::Dark,
            Theme::Light => egui::ThemePreference::Light,
        });
    }

    /// Shows a message in the status line.
    pub(crate) fn set_status(&mut self, what: String) {
        self.status = (what, false);
    }

    /// Shows an error in the status line.
    pub(crate) fn show_error(&mut self, result: Result<()>) {
        if let Err(why) = result {
            self.status = (why.to_string(), true);
        }
    }

    /// Logs the frame.
    fn note_frame(&mut self, (began, submitted): (Instant, Duration), frame_ms: f64) {
        let driver = submit_time().saturating_sub(submitted);
        self.frames.driver_ms = 1e3 * driver.as_secs_f64();
        let pictures = self.screen.pictures;
        let (since, before) = self.frames.since;
        let passed = since.elapsed().as_secs_f64();
        if passed >= 1.0 {
            self.frames.rate = (pictures - before) as f64 / passed;
            self.frames.since = (Instant::now(), pictures);
        }
        self.frames.ui_ms = 1e3 * began.elapsed().as_secs_f64();
        if self.log.is_none() && self.told.is_none() {
            self.frames.done = Instant::now();
            return;
        }
        let frame = self.frame(frame_ms);
        if let Some(told) = &mut self.told {
            told(&frame);
        }
        if let Some(log) = &self.log
            && let Err(why) = log.push(&frame)
        {
            self.log = None;
            self.status = (why.to_string(), true);
        }
        self.frames.done = Instant::now();
    }

    /// Returns the log record of a frame.
    pub(crate) fn frame(&self, frame_ms: f64) -> Frame {
        let camera = self.orbit.camera();
        let show = self.show.as_ref();
        let (paint_ms, latency_ms) = self.frames.shown();
        let (presented, soon) = {
            let screen = lock(&self.frames.screen);
            (screen.number, screen.soon)
        };
        Frame {
            number: self.frames.number,
            presented,
            soon,
            frame_ms,
            ui_ms: self.frames.ui_ms,
            driver_ms: self.frames.driver_ms,
            paint_ms,
            latency_ms,
            steps: show.map_or(0, |s| s.steps),
            iterations: show
                .and_then(|s| s.stage().motion()?.progress())
                .map_or(0, |p| p.last.iterations),
            pictures: self.screen.pictures,
            tets: show.map_or(0, |s| s.stage().mesh().tets.len()),
            camera: [camera.eye.to_array(), camera.look_at.to_array()],
            force_n: show.and_then(BodySession::force),
            depth_m: show.and_then(|s| s.samples.last().map(|s| s.depth_m)),
            memory_mb: memory_mb(),
            readbacks: self.gpu.readbacks(),
            bytes_allocated: self.gpu.bytes_allocated(),
            lost: lock(&self.trouble).lost.clone(),
            opened: self.opened,
            said: self.status.0.clone(),
            error: self.status.1,
            name: self.document.as_ref().map(|d| d.name.clone()),
            loading: self.loading.as_ref().map(|l| l.name.clone()),
            reports: self.loading.as_ref().map_or(0, Loading::reports),
            tasks: live_tasks(),
            time_s: show.map_or(0.0, BodySession::time),
            playing: show.is_some_and(|s| s.playing),
            series_frame: show.and_then(|s| Some(s.player.as_ref()?.shown())),
            planes: self.plane_values(),
            busy: self.loading.is_some()
                || self.refine_pending
                || show.is_some_and(BodySession::is_going),
            pointer: self.frames.pointer,
            down: self.frames.down,
            keys: self.frames.keys,
        }
    }

    /// Returns device errors since the last frame; after device loss, that error.
    fn device_trouble(&self) -> Option<Error> {
        let checked = self.gpu.poll_errors().err();
        let mut trouble = lock(&self.trouble);
        let refused = trouble.refused.take();
        match &trouble.lost {
            Some(why) => Some(Error::DeviceLost(why.clone())),
            None => refused.map(Error::Gpu).or(checked),
        }
    }

    /// Returns the recent pictures per second.
    pub(crate) fn rate(&self) -> f64 {
        self.frames.rate
    }
}

impl eframe::App for App {
    #[cfg(target_arch = "wasm32")]
    fn as_any_mut(&mut self) -> Option<&mut dyn std::any::Any> {
        Some(self)
    }

    fn ui(&mut self, ui: &mut egui::Ui, frame: &mut eframe::Frame) {
        let (began, submitted) = (Instant::now(), submit_time());
        let frame_ms = 1e3 * began.duration_since(self.frames.last).as_secs_f64();
        self.frames.last = began;
        self.frames.number += 1;
        let context = ui.ctx().clone();
        self.frames.look(&context);
        self.take_files(&context);
        self.install_body(&context);
        self.finish_import();
        let saved = self.save_arrived(&context);
        self.show_error(saved);
        #[cfg(not(target_arch = "wasm32"))]
        self.film(&context);
        self.watch(&context);
        let (held, pressed) = context.input(|i| (i.pointer.any_down(), i.pointer.any_pressed()));
        if let Some(document) = &mut self.document {
            document.track_drag(held, pressed);
        }
        self.handle_shortcuts(&context);
        let patience = self.update_interaction(&context);
        if let Some(show) = &mut self.show {
            show.advance_to_now(patience);
            if let Some(remark) = show.remark.take() {
                self.status = (remark, false);
            }
            if let Some(why) = show.failure.take() {
                self.status = (format!("the simulation stopped: {why}"), true);
            }
        }
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui));
        if self.show.as_ref().is_some_and(|show| show.player.is_some()) {
            egui::Panel::bottom("series").show(ui, |ui| self.scrubber(ui));
        }
        egui::Panel::left("hands")
            .exact_size(TOOLBAR_WIDTH)
            .show(ui, |ui| self.toolbar(ui));
        // On a phone, the panels would leave no room for the picture.
        if self
            .panels_shown
            .unwrap_or(ui.available_width() >= COMPACT_WIDTH)
        {
            egui::Panel::right("panels")
                .default_size(300.0)
                .size_range(220.0..=480.0)
                .show(ui, |ui| self.panels(ui));
        }
        egui::CentralPanel::default()
            .frame(egui::Frame::NONE)
            .show(ui, |ui| self.draw_viewport(ui, frame));
        if let Some(why) = self.device_trouble() {
            self.status = (why.to_string(), true);
        }
        if self.loading.is_some() || self.taking.is_some() {
            context.request_repaint_after(Duration::from_millis(100));
        }
        if let Some(look) = self.show.as_ref().and_then(BodySession::next_poll) {
            context.request_repaint_after(look);
        }
        self.note_frame((began, submitted), frame_ms);
    }
}
