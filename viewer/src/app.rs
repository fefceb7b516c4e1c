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

    /// Opens a file.
    pub(crate) fn open(&mut self, file: &Path, context: &egui::Context) {
        match Document::open(file) {
            Ok(document) => {
                if let Some(file) = &document.file {
                    self.settings.opened(file);
                    self.watched = Some((file.clone(), changed(file), Instant::now()));
                }
                self.begin(document, context);
            }
            Err(why) => self.tell_error(Err(why)),
        }
    }

    /// Opens what ships with the viewer.
    pub(crate) fn open_example(&mut self, example: &Example, context: &egui::Context) {
        self.watched = None;
        match example.open() {
            Ok(document) => self.begin(document, context),
            Err(why) => self.tell_error(Err(why)),
        }
    }

    fn begin(&mut self, document: Document, context: &egui::Context) {
        self.said = (format!("opening {}", document.name), false);
        match Loading::open(&self.gpu, document, context) {
            Ok(loading) => self.loading = Some(loading),
            Err(why) => self.tell_error(Err(why)),
        }
    }

    /// Makes the body anew from its scene, at rest, with a finger of `radius`, or the one it has.
    pub(crate) fn restart(&mut self, radius: Option<f64>, context: &egui::Context) {
        let (Some(document), Some(show)) = (&self.document, &self.show) else {
            return;
        };
        // What is being opened goes first.
        if self.loading.as_ref().is_some_and(|l| l.document.is_some()) {
            return;
        }
        let body = (show.mesh.clone(), radius.unwrap_or(show.radius));
        match Loading::again(&self.gpu, document, body, context) {
            Ok(loading) => self.loading = Some(loading),
            Err(why) => self.tell_error(Err(why)),
        }
    }

    /// Takes over a body that is ready.
    fn take_over(&mut self, context: &egui::Context) {
        let Some(made) = self.loading.as_ref().and_then(Loading::ready) else {
            return;
        };
        let Some(loading) = self.loading.take() else {
            return;
        };
        let mut show = match made {
            Ok(show) => show,
            // What was open before still is.
            Err(why) => return self.tell_error(Err(why)),
        };
        self.said = (show.notes.first().cloned().unwrap_or_default(), false);
        match (loading.document, &self.show, &self.document) {
            (Some(document), ..) => {
                self.see(&mut show);
                self.picture = show.stage().size();
                let title = format!("{} — Palpate", document.name);
                context.send_viewport_cmd(egui::ViewportCommand::Title(title));
                self.document = Some(document);
            }
            // What was chosen of how time goes by stays, and what was edited since it began.
            (None, Some(old), Some(document)) => {
                show.speed = old.speed;
                show.playing = old.playing || old.failed;
                if document.text() != loading.text {
                    let result = document.scene().and_then(|scene| show.set_looks(&scene));
                    self.tell_error(result);
                }
            }
            (None, ..) => {}
        }
        self.stroke = Stroke::Idle;
        self.ruler = None;
        self.histogram = None;
        self.screen.forget();
        self.show = Some(show);
    }

    /// Looks at a body as its scene has it.
    fn see(&mut self, show: &mut Show) {
        let camera = *show.stage_mut().camera_mut();
        self.orbit = Orbit::of(&camera, show.diagonal());
        // All that a wider picture would show.
        if let Some(area) = self.area {
            let wide = |[w, h]: [u32; 2]| f64::from(w) / f64::from(h.max(1));
            let wanted = wide(show.stage().size());
            self.orbit.zoom((wide(area.size) / wanted).min(1.0));
        }
    }

    /// Edits how the body looks; it follows at once.
    pub(crate) fn edit_looks(&mut self, what: &str, change: impl FnOnce(&mut DocumentMut)) {
        let result = self.try_edit(what, change, Show::set_looks);
        self.tell_error(result);
    }

    /// The same of planes and isosurfaces, as they are dragged.
    pub(crate) fn edit_planes(&mut self, what: &str, change: impl FnOnce(&mut DocumentMut)) {
        let result = self.try_edit(what, change, Show::set_planes);
        self.tell_error(result);
    }

    fn try_edit(
        &mut self,
        what: &str,
        change: impl FnOnce(&mut DocumentMut),
        follow: fn(&mut Show, &Scene) -> Result<()>,
    ) -> Result<()> {
        let Some(document) = &mut self.document else {
            return Ok(());
        };
        let scene = document.edit(what, change)?;
        let Some(show) = &mut self.show else {
            return Ok(());
        };
        if let Err(why) = follow(show, &scene) {
            document.forget()?;
            return Err(why);
        }
        Ok(())
    }

    /// Edits what the body is made of, or how it moves: it begins anew.
    pub(crate) fn edit_body(
        &mut self,
        what: &str,
        context: &egui::Context,
        change: impl FnOnce(&mut DocumentMut),
    ) {
        let Some(document) = &mut self.document else {
            return;
        };
        match document.edit(what, change) {
            Ok(_) => self.restart(None, context),
            Err(why) => self.tell_error(Err(why)),
        }
    }

    /// Undoes the last edit, or with `again` the last undo.
    pub(crate) fn undo(&mut self, again: bool, context: &egui::Context) {
        let result = self.try_undo(again, context);
        self.tell_error(result);
    }

    fn try_undo(&mut self, again: bool, context: &egui::Context) -> Result<()> {
        let Some(document) = &mut self.document else {
            return Ok(());
        };
        let before = document.body();
        if !document.step_back(again)? {
            return Ok(());
        }
        if document.body() != before {
            self.restart(None, context);
            return Ok(());
        }
        let scene = document.scene()?;
        let Some(show) = &mut self.show else {
            return Ok(());
        };
        if let Err(why) = show.set_looks(&scene) {
            document.step_back(!again)?;
            return Err(why);
        }
        Ok(())
    }

    /// The scene, as it is open.
    pub(crate) fn scene(&self) -> Option<Scene> {
        self.document.as_ref().and_then(|d| d.scene().ok())
    }

    /// Shows all of the body.
    pub(crate) fn fit(&mut self) {
        if let (Some(show), Some(area)) = (&self.show, self.area) {
            let aspect = f64::from(area.size[0]) / f64::from(area.size[1].max(1));
            self.orbit.fit(show.bounds, aspect);
        }
    }

    /// Saves, where a dialog said.
    pub(crate) fn save(&mut self, what: Saved, file: &Path) -> Result<()> {
        let camera = self.orbit.camera();
        let (Some(document), Some(show)) = (&self.document, &mut self.show) else {
            return Ok(());
        };
        match what {
            Saved::Picture => {
                let stage = show.stage_mut();
                *stage.camera_mut() = camera;
                stage.set_size(self.picture);
                stage.save(file)?;
            }
            Saved::Scene => {
                let file = std::path::absolute(file).map_err(Error::io(file))?;
                let folder = file.parent().unwrap_or(Path::new(""));
                let text = document.text_seen(folder, &camera, self.picture);
                palpate::io::atomic_write(&file, |out| {
                    use std::io::Write;
                    out.write_all(text.as_bytes()).map_err(Error::io(&file))
                })?;
            }
            Saved::Mesh => {
                palpate::io::write(file, &show.stage().deformed_mesh()?)?;
            }
            Saved::Press => palpate::io::atomic_write(file, |out| {
                use std::io::Write;
                let mut lines = "time_s,depth_m,force_n\n".to_owned();
                for s in &show.samples {
                    lines += &format!("{},{},{}\n", s.time_s, s.depth_m, s.force_n);
                }
                out.write_all(lines.as_bytes()).map_err(Error::io(file))
            })?,
        }
        // It is no news that what is open was saved.
        if let Some((watched, at, _)) = &mut self.watched {
            *at = changed(watched);
        }
        self.say(format!("saved {}", file.display()));
        Ok(())
    }

    /// Takes over what dialogs were closed with, and what was dropped onto the window.
    fn take_files(&mut self, context: &egui::Context) {
        while let Ok(chosen) = self.chosen.1.try_recv() {
            match chosen {
                Chosen::Open(file) => {
                    self.ask = None;
                    self.open(&file, context);
                }
                Chosen::Place(file) => {
                    if let Some(ask) = &mut self.ask {
                        ask.path = file.to_string_lossy().into_owned();
                    }
                }
            }
        }
        let dropped = context.input(|i| {
            let first = i.raw.dropped_files.first();
            first.map(|f| f.path().to_path_buf())
        });
        if let Some(file) = dropped {
            self.open(&file, context);
        }
    }

    /// Opens the file anew that is open and has changed.
    fn watch(&mut self, context: &egui::Context) {
        let Some((file, at, looked)) = &mut self.watched else {
            return;
        };
        context.request_repaint_after(LOOK);
        if looked.elapsed() < LOOK || self.loading.is_some() {
            return;
        }
        *looked = Instant::now();
        let now = changed(file);
        if now.is_some() && now != *at {
            let file = file.clone();
            self.open(&file, context);
        }
    }

    /// The picture, and what is drawn over it.
    fn central(&mut self, ui: &mut egui::Ui, frame: &eframe::Frame) {
        let rect = ui.available_rect_before_wrap();
        let scale = ui.ctx().pixels_per_point();
        let pixels = (rect.size() * scale).round();
        let area = Area {
            rect,
            size: [pixels.x.max(1.0) as u32, pixels.y.max(1.0) as u32],
        };
        let response = ui.allocate_rect(rect, Sense::click_and_drag());
        self.area = Some(area);
        self.hand(ui, &response, area);
        let dark = ui.visuals().dark_mode;
        let backdrop = if dark {
            [0.05, 0.06, 0.08, 1.0]
        } else {
            [0.94, 0.95, 0.96, 1.0]
        };
        let camera = self.orbit.camera();
        if let (Some(show), Some(state)) = (&mut self.show, frame.wgpu_render_state()) {
            let with = (&self.gpu, state);
            match self.screen.draw(with, show, (&camera, backdrop), area.size) {
                Ok((id, finer)) => {
                    let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
                    ui.painter().image(id, rect, whole, Color32::WHITE);
                    if finer {
                        ui.ctx().request_repaint_after(Duration::from_millis(40));
                    }
                }
                Err(why) => self.said = (why.to_string(), true),
            }
        }
        self.overlay(ui, area, &camera);
    }

    fn overlay(&mut self, ui: &egui::Ui, area: Area, camera: &Camera) {
        let painter = ui.painter_at(area.rect);
        let strong = ui.visuals().strong_text_color();
        let line = Line::new(2.0, ui.visuals().selection.stroke.color);
        if let Stroke::Cut(way, _) = &self.stroke {
            painter.line(way.clone(), line);
        }
        if let (Some([from, to]), Some(show)) = (self.ruler, &self.show)
            && let (Some(a), Some(b)) = (area.seen(camera, from), area.seen(camera, to))
        {
            painter.line_segment([a, b], line);
            for end in [a, b] {
                painter.circle_filled(end, 4.0, line.color);
            }
            painter.text(
                a.lerp(b, 0.5) + egui::vec2(8.0, -8.0),
                egui::Align2::LEFT_BOTTOM,
                format!("{:.2} mm", 1e3 * show.unit * from.distance(to)),
                egui::FontId::proportional(15.0),
                strong,
            );
        }
        if let Some(show) = &self.show
            && let (Some(force), Some(sample)) = (show.force(), show.samples.last())
        {
            let said = format!("{force:.3} N at {:.2} mm", 1e3 * sample.depth_m);
            let at = area.rect.left_top() + egui::vec2(14.0, 12.0);
            let font = egui::FontId::proportional(20.0);
            painter.text(at, egui::Align2::LEFT_TOP, said, font, strong);
        }
        // Which way is which: the body's axes, or its sides where it is a patient's.
        let origin = area.rect.left_bottom() + egui::vec2(46.0, -46.0);
        let names = ["x", "y", "z"];
        let colours = [
            Color32::from_rgb(213, 94, 0),
            Color32::from_rgb(0, 158, 115),
            Color32::from_rgb(86, 140, 233),
        ];
        for axis in 0..3 {
            let along = self.orbit.turn.inverse() * DVec3::AXES[axis];
            let end = origin + 30.0 * egui::vec2(along.x as f32, -along.y as f32);
            painter.line_segment([origin, end], Line::new(2.0, colours[axis]));
            let beyond = origin + 39.0 * egui::vec2(along.x as f32, -along.y as f32);
            let font = egui::FontId::proportional(13.0);
            painter.text(
                beyond,
                egui::Align2::CENTER_CENTER,
                names[axis],
                font,
                strong,
            );
        }
        if let Some(loading) = &self.loading {
            let (what, share, seconds) = loading.progress();
            let said = match share > 0.0 && share < 1.0 {
                true => format!("{}: {what}, {:.0} %", loading.name, 100.0 * share),
                false => format!("{}: {what}, {seconds:.0} s", loading.name),
            };
            let font = egui::FontId::proportional(18.0);
            let middle = area.rect.center();
            let place = painter.text(middle, egui::Align2::CENTER_CENTER, said, font, strong);
            let bar = Rect::from_center_size(
                place.center_bottom() + egui::vec2(0.0, 14.0),
                egui::vec2(220.0, 6.0),
            );
            painter.rect_filled(bar, 3.0, ui.visuals().extreme_bg_color);
            let mut done = bar;
            done.set_width(bar.width() * share as f32);
            painter.rect_filled(done, 3.0, line.color);
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
