//! JavaScript interface of the viewer in a web page.

use crate::app::{App, InitialFile, Options};
use crate::camera_control::Orbit;
use crate::device::device;
use crate::log::Frame;
use eframe::egui::{FontData, FontDefinitions};
use glam::DVec3;
use palpate::io;
use palpate::render::{Camera, Projection};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::path::Path;
use std::sync::Arc;
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::JsFuture;

/// Polling interval for pictures, ms.
const POLL_INTERVAL_MS: i32 = 10;
/// Virtual file name of a picture.
const SCREENSHOT_NAME: &str = "picture.png";

/// A viewer on a canvas.
#[wasm_bindgen]
pub struct Viewer {
    runner: eframe::WebRunner,
}

/// Camera in the JavaScript interface.
#[derive(Serialize, Deserialize)]
struct View {
    eye: [f64; 3],
    look_at: [f64; 3],
    up: [f64; 3],
    /// Vertical opening angle in degrees; `None` for an orthographic view.
    fov: Option<f64>,
    /// Height of an orthographic view, in file units.
    orthographic: Option<f64>,
}

fn wrong(why: impl ToString) -> JsValue {
    js_sys::Error::new(&why.to_string()).into()
}

#[wasm_bindgen]
impl Viewer {
    /// Creates a viewer that is not shown yet.
    #[wasm_bindgen(constructor)]
    #[allow(clippy::new_without_default)]
    pub fn new() -> Viewer {
        Viewer {
            runner: eframe::WebRunner::new(),
        }
    }

    /// Starts the viewer on `canvas`, with an example of this name or empty. Calls `told` after every
    /// frame with its log record as JSON, and `ended` with the message of a panic of the module.
    ///
    /// # Errors
    /// An error if there is no WebGPU or the example is unknown.
    pub async fn start(
        &self,
        canvas: web_sys::HtmlCanvasElement,
        example: Option<String>,
        told: js_sys::Function,
        ended: js_sys::Function,
    ) -> Result<(), JsValue> {
        notify_finished(ended);
        let options = Options {
            open: example.map_or(InitialFile::Nothing, InitialFile::Example),
            log: None,
            // A page has one thread, and would not respond during an estimate.
            no_error: true,
        };
        let web = eframe::WebOptions {
            renderer: eframe::Renderer::Wgpu,
            wgpu_options: device(),
            dithering: false,
            ..Default::default()
        };
        let tell = move |frame: &Frame| {
            if let Ok(text) = serde_json::to_string(frame) {
                // Exceptions in the page's callback are ignored.
                let _ = told.call1(&JsValue::NULL, &text.into());
            }
        };
        let create = move |creation: &eframe::CreationContext<'_>| {
            creation.egui_ctx.set_fonts(letters());
            let mut app = App::new(creation, &options)?;
            app.told = Some(Box::new(tell));
            Ok(Box::new(app) as Box<dyn eframe::App>)
        };
        self.runner.start(canvas, web, Box::new(create)).await
    }

    fn with<T>(&self, act: impl FnOnce(&mut App) -> palpate::Result<T>) -> Result<T, JsValue> {
        let app = self.runner.app_mut::<App>();
        let mut app = app.ok_or_else(|| wrong("the viewer is not started"))?;
        let done = act(&mut app).map_err(wrong);
        app.repaint();
        done
    }

    /// Stores a file in memory, for files that refer to it.
    pub fn add_file(&self, name: &str, bytes: Vec<u8>) {
        io::insert_file(name, bytes);
    }

    /// Opens a file that was added, with a colour preset.
    ///
    /// # Errors
    /// An error if the viewer is not started. Errors of the file are reported by a frame.
    pub fn open(&self, name: &str, transfer: Option<String>) -> Result<(), JsValue> {
        self.with(|app| {
            let context = app.context.clone();
            app.open_as(Path::new(name), transfer.as_deref(), &context);
            Ok(())
        })
    }

    /// Shows an error in the status line.
    ///
    /// # Errors
    /// An error if the viewer is not started.
    pub fn say(&self, why: String) -> Result<(), JsValue> {
        self.with(|app| {
            app.status = (why, true);
            Ok(())
        })
    }

    /// Returns the camera as JSON.
    ///
    /// # Errors
    /// An error if the viewer is not started.
    pub fn camera(&self) -> Result<String, JsValue> {
        let camera = self.with(|app| Ok(app.orbit.camera()))?;
        let [fov, orthographic] = match camera.projection {
            Projection::Perspective { fov } => [Some(fov), None],
            Projection::Orthographic { height } => [None, Some(height)],
        };
        let view = View {
            eye: camera.eye.to_array(),
            look_at: camera.look_at.to_array(),
            up: camera.up.to_array(),
            fov,
            orthographic,
        };
        serde_json::to_string(&view).map_err(wrong)
    }

    /// Sets the camera from JSON.
    ///
    /// # Errors
    /// An error if it is invalid.
    pub fn set_camera(&self, json: &str) -> Result<(), JsValue> {
        let view: View = serde_json::from_str(json).map_err(wrong)?;
        let [eye, look_at, up] = [view.eye, view.look_at, view.up].map(DVec3::from);
        let camera = match view.orthographic {
            Some(height) => Camera::orthographic(eye, look_at, up, height),
            None => Camera::perspective(eye, look_at, up, view.fov.unwrap_or(30.0)),
        };
        self.with(|app| {
            camera.check()?;
            let size = app.show.as_ref().map_or(1.0, |show| show.diagonal());
            app.orbit = Orbit::of(&camera, size);
            Ok(())
        })
    }

    /// Presses the finger on the body at a point of the picture (`x` to the right and `y` down, from
    /// 0 to 1), to `depth` metres; an active press continues at its point.
    ///
    /// # Errors
    /// An error if there is no body at this point, or it cannot be pressed on.
    pub fn press(&self, x: f64, y: f64, depth: f64) -> Result<(), JsValue> {
        self.with(|app| app.press_at([x, y], depth))
    }

    /// Retracts the finger.
    ///
    /// # Errors
    /// An error if the viewer is not started.
    pub fn release(&self) -> Result<(), JsValue> {
        self.with(|app| {
            app.release_press();
            Ok(())
        })
    }

    /// Returns the picture, `width` × `height` pixels, as a PNG.
    ///
    /// # Errors
    /// An error if rendering fails.
    pub async fn screenshot(&self, width: u32, height: u32) -> Result<Vec<u8>, JsValue> {
        let (mut pending, writer) = self.with(|app| app.ask_picture([width, height]))?;
        loop {
            if let Some(image) = pending.try_take().map_err(wrong)? {
                writer.save(image, SCREENSHOT_NAME).map_err(wrong)?;
                return io::take_file(SCREENSHOT_NAME).ok_or_else(|| {
                    wrong("internal error: the picture was not written; please report it")
                });
            }
            pause(POLL_INTERVAL_MS).await;
        }
    }

    /// Returns the log record of the last frame as JSON.
    ///
    /// # Errors
    /// An error if the viewer is not started.
    pub fn state(&self) -> Result<String, JsValue> {
        // Reading the state does not require another frame.
        let app = self.runner.app_mut::<App>();
        let app = app.ok_or_else(|| wrong("the viewer is not started"))?;
        serde_json::to_string(&app.frame(0.0)).map_err(wrong)
    }

    /// Stops the viewer and frees the canvas.
    pub fn destroy(&self) {
        self.runner.destroy();
    }
}

/// Returns the fonts of the interface: of egui's fonts only those in use, which saves a fifth of a
/// megabyte of download.
fn letters() -> FontDefinitions {
    let mut fonts = FontDefinitions::empty();
    let files = [
        ("Ubuntu-Light", epaint_default_fonts::UBUNTU_LIGHT),
        ("egui-icons", epaint_default_fonts::EGUI_ICONS),
    ];
    for (name, bytes) in files {
        let font = FontData::from_static(bytes);
        fonts.font_data.insert(name.into(), Arc::new(font));
        for family in fonts.families.values_mut() {
            family.push(name.into());
        }
    }
    fonts
}

thread_local! {
    /// Callbacks for a panic of the module.
    static EXIT_CALLBACKS: RefCell<Vec<js_sys::Function>> = const { RefCell::new(Vec::new()) };
}

/// Registers `ended` to be called with the message of a panic, after which the module is unusable.
fn notify_finished(ended: js_sys::Function) {
    let first = EXIT_CALLBACKS.with_borrow_mut(|all| {
        all.push(ended);
        all.len() == 1
    });
    if !first {
        return;
    }
    let before = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        before(panic);
        let why = JsValue::from(panic.to_string());
        EXIT_CALLBACKS.with_borrow(|all| {
            for ended in all {
                // Exceptions in the page's callback are ignored.
                let _ = ended.call1(&JsValue::NULL, &why);
            }
        });
    }));
}

/// Waits for a number of milliseconds.
pub(crate) async fn pause(milliseconds: i32) {
    let wait = js_sys::Promise::new(&mut |done, _| {
        if let Some(window) = web_sys::window() {
            let _ =
                window.set_timeout_with_callback_and_timeout_and_arguments_0(&done, milliseconds);
        }
    });
    let _ = JsFuture::from(wait).await;
}
