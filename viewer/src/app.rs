//! The window: what is open, and a frame of the interface.

use crate::ask::{Ask, Chosen, Saved};
use crate::document::Document;
use crate::examples::Example;
use crate::hand::{Area, Hand, Stroke};
use crate::histogram::Histogram;
use crate::loading::Loading;
use crate::log::{Frame, FrameLog, memory_mb};
use crate::orbit::Orbit;
use crate::screen::Screen;
use crate::settings::{Settings, Theme};
use crate::show::Show;
use eframe::egui::{self, Color32, Pos2, Rect, Sense, Stroke as Line};
use eframe::egui_wgpu::{SurfaceConfig, WgpuConfiguration, WgpuSetupCreateNew};
use glam::DVec3;
use palpate::gpu::Gpu;
use palpate::render::Camera;
use palpate::scene::Scene;
use palpate::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant, SystemTime};
use toml_edit::DocumentMut;

/// How deep strokes cut where nobody chose, over the body's diagonal.
const CUT_DEPTH: f64 = 0.1;
/// How often the file that is open is looked at.
const LOOK: Duration = Duration::from_secs(1);
/// Width of the tools at the left, in points.
const HANDS: f32 = 72.0;

/// What the viewer is started with.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// What is opened.
    pub file: Option<PathBuf>,
    /// Or the example that is; the limb where neither is said.
    pub example: Option<String>,
    /// Size of the window, in points.
    pub size: [u32; 2],
    /// Where to write what each frame took.
    pub log: Option<PathBuf>,
}

/// The window.
pub struct App {
    pub(crate) gpu: Gpu,
    pub(crate) document: Option<Document>,
    pub(crate) loading: Option<Loading>,
    pub(crate) show: Option<Show>,
    pub(crate) orbit: Orbit,
    pub(crate) settings: Settings,
    pub(crate) hand: Hand,
    pub(crate) stroke: Stroke,
    pub(crate) area: Option<Area>,
    pub(crate) ruler: Option<[DVec3; 2]>,
    /// How deep strokes cut, over the body's diagonal.
    pub(crate) cut_depth: f64,
    pub(crate) histogram: Option<Histogram>,
    /// The point of the transfer function that is dragged.
    pub(crate) dragged: Option<usize>,
    /// What a path is asked for, while it is.
    pub(crate) ask: Option<Ask>,
    /// Width and height of pictures that are saved.
    pub(crate) picture: [u32; 2],
    /// What is said in the status line, and whether it is an error.
    pub(crate) said: (String, bool),
    pub(crate) chosen: (Sender<Chosen>, Receiver<Chosen>),
    screen: Screen,
    watched: Option<(PathBuf, Option<SystemTime>, Instant)>,
    log: Option<FrameLog>,
    frames: Frames,
}

/// How frames go by.
struct Frames {
    last: Instant,
    since: (Instant, u64),
    /// Pictures a second, lately.
    rate: f64,
    ui_ms: f64,
}

/// Opens a window.
///
/// # Errors
/// In words, where there is no display, no device, or no log can be written.
pub fn run(options: Options) -> std::result::Result<(), String> {
    let [width, height] = options.size.map(|n| n as f32);
    let native = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_app_id("palpate-view")
            .with_inner_size([width, height])
            .with_drag_and_drop(true),
        wgpu_options: device(),
        ..eframe::NativeOptions::default()
    };
    eframe::run_native(
        "Palpate",
        native,
        Box::new(move |creation| Ok(Box::new(App::new(creation, &options)?))),
    )
    .map_err(|e| {
        format!(
            "no window could be opened: {e}; it needs a display (X11, or Wayland with XWayland) and a Vulkan driver (on Debian: apt install mesa-vulkan-drivers)"
        )
    })
}

/// What the window's device is made with: the limits that Palpate keeps to.
fn device() -> WgpuConfiguration {
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

impl App {
    fn new(
        creation: &eframe::CreationContext<'_>,
        options: &Options,
    ) -> std::result::Result<App, String> {
        let state = creation.wgpu_render_state.as_ref();
        let state = state.ok_or("the window has no wgpu device")?;
        let gpu = Gpu::from_wgpu(&state.adapter, state.device.clone(), state.queue.clone());
        let log = options.log.as_deref().map(FrameLog::create).transpose();
        let now = Instant::now();
        let still = Camera::perspective(DVec3::Z, DVec3::ZERO, DVec3::Y, 30.0);
        let mut app = App {
            gpu,
            document: None,
            loading: None,
            show: None,
            orbit: Orbit::of(&still, 1.0),
            settings: Settings::read(),
            hand: Hand::default(),
            stroke: Stroke::default(),
            area: None,
            ruler: None,
            cut_depth: CUT_DEPTH,
            histogram: None,
            dragged: None,
            ask: None,
            picture: [1024, 768],
            said: (String::new(), false),
            chosen: channel(),
            screen: Screen::default(),
            watched: None,
            log: log.map_err(|e| e.to_string())?,
            frames: Frames {
                last: now,
                since: (now, 0),
                rate: 0.0,
                ui_ms: 0.0,
            },
        };
        app.wear_theme(&creation.egui_ctx);
        match (&options.file, &options.example) {
            (Some(file), _) => app.open(file, &creation.egui_ctx),
            (None, name) => {
                let name = name.as_deref().unwrap_or("limb");
                let example = Example::named(name).map_err(|e| e.to_string())?;
                app.open_example(example, &creation.egui_ctx);
            }
        }
        Ok(app)
    }

    /// Has the interface dark or light.
    pub(crate) fn wear_theme(&self, context: &egui::Context) {
        context.set_theme(match self.settings.theme {
            Theme::System => egui::ThemePreference::System,
            Theme::Dark => egui::ThemePreference::Dark,
            Theme::Light => egui::ThemePreference::Light,
        });
    }

    /// Says something in the status line.
    pub(crate) fn say(&mut self, what: String) {
        self.said = (what, false);
    }

    /// Says why something failed, in the status line.
    pub(crate) fn tell_error(&mut self, result: Result<()>) {
        if let Err(why) = result {
            self.said = (why.to_string(), true);
        }
    }


    /// Writes what the frame took.
    fn note_frame(&mut self, began: Instant, frame_ms: f64) {
        let pictures = self.screen.pictures;
        let (since, before) = self.frames.since;
        let passed = since.elapsed().as_secs_f64();
        if passed >= 1.0 {
            self.frames.rate = (pictures - before) as f64 / passed;
            self.frames.since = (Instant::now(), pictures);
        }
        self.frames.ui_ms = 1e3 * began.elapsed().as_secs_f64();
        let camera = self.orbit.camera();
        let Some(log) = &mut self.log else { return };
        let show = self.show.as_ref();
        let frame = Frame {
            frame_ms,
            ui_ms: self.frames.ui_ms,
            steps: show.map_or(0, |s| s.steps),
            iterations: show
                .and_then(|s| s.stage().motion()?.progress())
                .map_or(0, |p| p.last.iterations),
            pictures,
            tets: show.map_or(0, |s| s.stage().mesh().tets.len()),
            camera: [camera.eye.to_array(), camera.look_at.to_array()],
            force_n: show.and_then(Show::force),
            depth_m: show.and_then(|s| s.samples.last().map(|s| s.depth_m)),
            memory_mb: memory_mb(),
            said: self.said.0.clone(),
        };
        if let Err(why) = log.push(&frame) {
            self.log = None;
            self.said = (why.to_string(), true);
        }
    }

    /// Pictures a second, lately.
    pub(crate) fn rate(&self) -> f64 {
        self.frames.rate
    }
}

/// When a file was changed last.
fn changed(file: &Path) -> Option<SystemTime> {
    std::fs::metadata(file).and_then(|m| m.modified()).ok()
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut egui::Ui, frame: &mut eframe::Frame) {
        let began = Instant::now();
        let frame_ms = 1e3 * began.duration_since(self.frames.last).as_secs_f64();
        self.frames.last = began;
        let context = ui.ctx().clone();
        self.take_files(&context);
        self.take_over(&context);
        self.watch(&context);
        self.keys(&context);
        if let Some(show) = &mut self.show {
            show.tick(began);
            if let Some(remark) = show.remark.take() {
                self.said = (remark, false);
            }
            if let Some(why) = show.failure.take() {
                self.said = (format!("the simulation stopped: {why}"), true);
            }
        }
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui));
        egui::Panel::left("hands")
            .exact_size(HANDS)
            .show(ui, |ui| self.hands(ui));
        egui::Panel::right("panels")
            .default_size(300.0)
            .size_range(220.0..=480.0)
            .show(ui, |ui| self.panels(ui));
        egui::CentralPanel::default()
            .frame(egui::Frame::NONE)
            .show(ui, |ui| self.central(ui, frame));
        if let Err(why) = self.gpu.check() {
            self.said = (why.to_string(), true);
        }
        if self.loading.is_some() {
            context.request_repaint_after(Duration::from_millis(100));
        }
        if let Some(look) = self.show.as_ref().and_then(Show::next_look) {
            context.request_repaint_after(look);
        }
        self.note_frame(began, frame_ms);
    }
}
