//! The viewer in a native window.

use crate::app::{App, Options};
use crate::device::device;
use eframe::egui;

/// Opens a window.
///
/// # Errors
/// In words, where there is no display, no device, or no log can be written.
pub fn run(options: Options, size: [u32; 2]) -> std::result::Result<(), String> {
    let [width, height] = size.map(|n| n as f32);
    let native = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_app_id("palpate-view")
            .with_inner_size([width, height])
            .with_drag_and_drop(true),
        wgpu_options: device(),
        // Dithering is for gradients, which the interface has none of; it would defeat pixel-exact
        // copies.
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
            "no window could be opened: {e}; it needs a display (X11, or Wayland with XWayland) and a Vulkan driver (on Debian: apt install mesa-vulkan-drivers)"
        )
    })
}
