//! Statistics of the frames: rates, times until they are on the screen, and their log.

use crate::app::App;
use crate::blit::PresentCallback;
use crate::body_session::BodySession;
use crate::device::lock;
use crate::loading::{Loading, live_tasks};
use crate::log::{self, Frame, FrameLog, memory_mb};
use eframe::egui;
use palpate::gpu::Gpu;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use web_time::Instant;

/// A frame requested within this delay counts as immediate; text cursors blink more slowly.
const SOON: Duration = Duration::from_millis(200);

/// Callback for every frame.
pub(crate) type FrameObserver = Box<dyn FnMut(&Frame)>;

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
    /// Starts the statistics.
    pub fn new() -> Frames {
        let now = Instant::now();
        Frames {
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
        }
    }

    /// Returns a plugin that records whether the interface wants another frame at once.
    pub fn watch(&self) -> impl egui::Plugin + use<> {
        RepaintWatch(self.screen.clone())
    }

    /// Begins a frame. Returns the time since the last one began, ms.
    pub fn begin(&mut self, now: Instant) -> f64 {
        let frame_ms = 1e3 * now.duration_since(self.last).as_secs_f64();
        self.last = now;
        self.number += 1;
        frame_ms
    }

    /// Records pointer and key input.
    pub fn look(&mut self, context: &egui::Context) {
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
    /// Logs the frame.
    pub(crate) fn note_frame(&mut self, (began, submitted): (Instant, Duration), frame_ms: f64) {
        let driver = Gpu::submit_time().saturating_sub(submitted);
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
        let error = show.and_then(|s| s.press_error()?.ok());
        let refined = error.as_ref().and_then(|error| error.refined.as_ref());
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
            light_path_samples: self.screen.path_samples(),
            tets: show.map_or(0, |s| s.stage().mesh().tets.len()),
            camera: [camera.eye.to_array(), camera.look_at.to_array()],
            force_n: show.and_then(BodySession::force),
            force_error_n: error.as_ref().map(|error| error.parts.total()),
            force_error_is_estimated: error.as_ref().map(|error| !error.is_of_another_depth),
            refined_force_n: refined.map(|force| [force.round.value, force.error.total()]),
            depth_m: show.and_then(|s| s.samples().last().map(|s| s.depth_m)),
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

    /// Returns the recent pictures per second.
    pub(crate) fn rate(&self) -> f64 {
        self.frames.rate
    }
}
