//! The application: open document, session state and the frame of the interface.

use crate::body_session::BodySession;
use crate::camera_control::Orbit;
use crate::device::{DeviceFault, listen};
use crate::document::Document;
use crate::examples::Example;
use crate::frames::{FrameObserver, Frames};
use crate::histogram::Histogram;
use crate::loading::Loading;
use crate::log::FrameLog;
use crate::open::WatchedFile;
use crate::panel::PendingImport;
use crate::path_prompt::PathPrompt;
use crate::platform::DialogResult;
use crate::pointer_tool::{PointerGesture, PointerTool};
use crate::save::PendingScreenshot;
use crate::screen::Screen;
use crate::settings::{Settings, Theme};
#[cfg(not(target_arch = "wasm32"))]
use crate::ui_cache::UiCache;
use crate::viewport::Viewport;
use eframe::egui;
use glam::DVec3;
use palpate::Result;
use palpate::gpu::Gpu;
use palpate::render::Camera;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use web_time::Instant;

/// Default cutting depth of strokes, relative to the body's diagonal.
const CUT_DEPTH: f64 = 0.1;
/// In narrower windows, in points, the panels are hidden by default.
const COMPACT_WIDTH: f32 = 480.0;
/// Width of the toolbar at the left, in points.
const TOOLBAR_WIDTH: f32 = 72.0;

/// Start options.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The file to open first.
    pub open: InitialFile,
    /// Whether presses have no error estimates.
    pub no_error: bool,
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
    /// The section through a press.
    pub(crate) section: Option<egui::TextureHandle>,
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
    /// Whether the errors of presses are estimated.
    estimates_errors: bool,
    pub(crate) log: Option<FrameLog>,
    /// Whether the panels are shown, if the user chose.
    pub(crate) panels_shown: Option<bool>,
    /// Callback for every frame.
    pub(crate) told: Option<FrameObserver>,
    pub(crate) trouble: Arc<Mutex<DeviceFault>>,
    /// Number of bodies opened so far.
    pub(crate) opened: u64,
    pub(crate) frames: Frames,
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
            section: None,
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
            estimates_errors: !options.no_error,
            log: log.map_err(|e| e.to_string())?,
            panels_shown: None,
            told: None,
            trouble: listen(&state.device, &creation.egui_ctx),
            opened: 0,
            frames: Frames::new(),
        };
        // WebGPU in a browser is never a software driver.
        #[cfg(not(target_arch = "wasm32"))]
        creation.egui_ctx.add_plugin(UiCache::new(state));
        creation.egui_ctx.add_plugin(app.frames.watch());
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
}

impl eframe::App for App {
    #[cfg(target_arch = "wasm32")]
    fn as_any_mut(&mut self) -> Option<&mut dyn std::any::Any> {
        Some(self)
    }

    fn ui(&mut self, ui: &mut egui::Ui, frame: &mut eframe::Frame) {
        let (began, submitted) = (Instant::now(), Gpu::submit_time());
        let frame_ms = self.frames.begin(began);
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
            if self.estimates_errors {
                show.update_press_error(&self.gpu, &context);
            }
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
