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

/// A camera, as JavaScript has it.
#[derive(Serialize, Deserialize)]
struct View {
    eye: [f64; 3],
    look_at: [f64; 3],
    up: [f64; 3],
    /// Vertical opening angle in degrees; none for an orthographic view.
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

    /// Shows it on `canvas`, with the example of a name or with nothing; `told` is called after every
    /// frame with what is known of it, as JSON, and `ended` with why once the module cannot go on.
    ///
    /// # Errors
    /// Where there is no WebGPU, or no such example.
    pub async fn start(
        &self,
        canvas: web_sys::HtmlCanvasElement,
        example: Option<String>,
        told: js_sys::Function,
        ended: js_sys::Function,
    ) -> Result<(), JsValue> {
        tell_of_end(ended);
        let options = Options {
            open: example.map_or(InitialFile::Nothing, InitialFile::Example),
            log: None,
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
        let mut app = app.ok_or_else(|| wrong("the viewer is not shown"))?;
        let done = act(&mut app).map_err(wrong);
        app.repaint();
        done
    }

    /// Stores a file in memory, for files that refer to it.
    pub fn add_file(&self, name: &str, bytes: Vec<u8>) {
        io::insert_file(name, bytes);
    }

    /// Opens a file that was added, shown by a preset of colours.
    ///
    /// # Errors
    /// An error if the viewer is not shown. What is wrong with the file is told by a frame.
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
    /// An error if the viewer is not shown.
    pub fn say(&self, why: String) -> Result<(), JsValue> {
        self.with(|app| {
            app.status = (why, true);
            Ok(())
        })
    }

    /// Returns the camera as JSON.
    ///
    /// # Errors
    /// An error if the viewer is not shown.
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

    /// Has the finger press on what is seen at a point of the picture, from 0 to 1 to the right and
    /// down, so many metres deep; goes on with the press that there is.
    ///
    /// # Errors
    /// Where nothing is seen there, or nothing can be pressed on.
    pub fn press(&self, x: f64, y: f64, depth: f64) -> Result<(), JsValue> {
        self.with(|app| app.press_at([x, y], depth))
    }

    /// Retracts the finger.
    ///
    /// # Errors
    /// An error if the viewer is not shown.
    pub fn release(&self) -> Result<(), JsValue> {
        self.with(|app| {
            app.let_go_of_press();
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
                return io::take_file(SCREENSHOT_NAME)
                    .ok_or_else(|| wrong("the picture is not there"));
            }
            pause(POLL_INTERVAL_MS).await;
        }
    }

    /// Returns the log record of the last frame as JSON.
    ///
    /// # Errors
    /// An error if the viewer is not shown.
    pub fn state(&self) -> Result<String, JsValue> {
        // Reading it is no reason for another frame.
        let app = self.runner.app_mut::<App>();
        let app = app.ok_or_else(|| wrong("the viewer is not shown"))?;
        serde_json::to_string(&app.frame(0.0)).map_err(wrong)
    }

    /// Stops the viewer and frees the canvas.
    pub fn destroy(&self) {
        self.runner.destroy();
    }
}

/// The letters of the interface: of egui's own only those that are used, which are a fifth of a
/// megabyte less to load.
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
    /// Who is told once the module cannot go on.
    static EXIT_CALLBACKS: RefCell<Vec<js_sys::Function>> = const { RefCell::new(Vec::new()) };
}

/// Has `ended` called with the message of a panic, after which nothing of the module can be called.
fn tell_of_end(ended: js_sys::Function) {
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
                // What the page makes of it is its own matter.
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
