//! The viewer in a native window.

use crate::app::{App, Options};
use crate::device::device;
use eframe::egui;

/// Opens a window.
///
/// # Errors
/// A message if there is no display or no device, or if the log cannot be written.
pub fn run(options: Options, size: [u32; 2]) -> std::result::Result<(), String> {
    let [width, height] = size.map(|n| n as f32);
    let native = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_app_id("palpate-view")
            .with_inner_size([width, height])
            .with_drag_and_drop(true),
        wgpu_options: device(),
        // The interface has no gradients, and dithering would prevent pixel-exact copies.
        dithering: false,
        ..eframe::NativeOptions::default()
    };
    eframe::run_native(
        "Palpate",
        native,
        Box::new(move |creation| Ok(Box::new(App::new(creation, &options)?))),
    )
    .map_err(|e| {
        format!(
            "cannot open a window: {e}; a display (X11, or Wayland with XWayland) and a Vulkan driver are required (on Debian: apt install mesa-vulkan-drivers)"
        )
    })
}
