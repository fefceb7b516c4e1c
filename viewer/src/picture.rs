//! The picture in the window, and its overlays.

use crate::app::App;
use crate::body_session::{BodySession, PressError};
use crate::pointer_tool::PointerGesture;
#[cfg(not(target_arch = "wasm32"))]
use crate::ui_cache::UiCache;
use crate::viewport::Viewport;
use eframe::egui::{self, Color32, Rect, Sense, Stroke as Line};
use glam::DVec3;
use palpate::accuracy::Round;
use palpate::number_format::rounded;
use palpate::render::Camera;
use std::time::Duration;

/// Colour of warnings over the picture: orange of Okabe and Ito, legible on light and dark.
const WARNING: Color32 = Color32::from_rgb(230, 159, 0);

/// Colour of text on a section, whose background is light.
const SECTION_INK: Color32 = Color32::from_rgb(15, 15, 15);

impl App {
    /// Fits the view to the body.
    pub(crate) fn fit_view(&mut self) {
        if let (Some(show), Some(area)) = (&self.show, self.area) {
            let aspect = f64::from(area.size[0]) / f64::from(area.size[1].max(1));
            self.orbit.fit(show.bounds, aspect);
        }
    }

    /// Draws the picture and its overlays.
    pub(crate) fn draw_viewport(&mut self, ui: &mut egui::Ui, frame: &eframe::Frame) {
        let rect = ui.available_rect_before_wrap();
        let scale = ui.ctx().pixels_per_point();
        let pixels = (rect.size() * scale).round();
        let area = Viewport {
            rect,
            size: [pixels.x.max(1.0) as u32, pixels.y.max(1.0) as u32],
        };
        let response = ui.allocate_rect(rect, Sense::click_and_drag());
        #[cfg(not(target_arch = "wasm32"))]
        ui.ctx()
            .with_plugin(|kept: &mut UiCache| kept.picture = Some(rect));
        let before = self.area.replace(area);
        self.settled = before.is_some_and(|before| before.size == area.size);
        self.handle_pointer(ui, &response, area);
        let dark = ui.visuals().dark_mode;
        let backdrop = if dark {
            [0.05, 0.06, 0.08, 1.0]
        } else {
            [0.94, 0.95, 0.96, 1.0]
        };
        let camera = self.orbit.camera();
        if let (Some(show), Some(state)) = (&mut self.show, frame.wgpu_render_state()) {
            let with = (&self.gpu, state);
            let pictures = self.screen.pictures;
            match self.screen.draw(with, show, (&camera, backdrop), area.size) {
                Ok(finer) => {
                    self.refine_pending = finer;
                    let drawn = self.screen.pictures > pictures;
                    let shows = [self.frames.moved.take(), show.shown.take()];
                    let since = shows.into_iter().flatten().min().filter(|_| drawn);
                    let log = self.log.clone().map(|log| (log, state.device.clone()));
                    let until = self.frames.until_presented(since, log);
                    ui.painter().extend(self.screen.shape(rect, until));
                    if finer {
                        ui.ctx().request_repaint_after(Duration::from_millis(40));
                    }
                }
                Err(why) => self.status = (why.to_string(), true),
            }
        }
        self.overlay(ui, area, &camera);
    }

    /// Draws an indicator of the axes at the lower left.
    fn draw_axes(&self, painter: &egui::Painter, area: Viewport, strong: Color32) {
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
    }

    /// Draws the force of a press with its error, and what is known about them.
    fn draw_force(&self, painter: &egui::Painter, area: Viewport, strong: Color32) {
        let Some(show) = &self.show else {
            return;
        };
        let (Some(force), Some(sample)) = (show.force(), show.samples().last()) else {
            return;
        };
        let depth = rounded(1e3 * sample.depth_m, 4);
        let said = match show.press_error() {
            Some(Ok(PressError {
                refined: Some(refined),
                ..
            })) => {
                let number = refined.error.around(refined.round.value, "N");
                format!("{number} at {depth} mm")
            }
            Some(Ok(error)) => format!("{} at {depth} mm", error.parts.around(force, "N")),
            _ => format!("{} N at {depth} mm", rounded(force, 4)),
        };
        // Below what is written on a section in place of the picture.
        let (at, strong) = match self.section_is_large() {
            true => (
                area.rect.left_bottom() - egui::vec2(-14.0, 74.0),
                SECTION_INK,
            ),
            false => (area.rect.left_top() + egui::vec2(14.0, 12.0), strong),
        };
        let font = egui::FontId::proportional(20.0);
        let place = painter.text(at, egui::Align2::LEFT_TOP, said, font, strong);
        if let Some(warning) = show.press_warning() {
            let font = egui::FontId::proportional(14.0);
            let width = area.rect.width() - 28.0;
            let text = painter.layout(warning, font, WARNING, width);
            painter.galley(place.left_bottom() + egui::vec2(0.0, 4.0), text, WARNING);
        } else if let Some(about) = error_note(show) {
            let below = place.left_bottom() + egui::vec2(0.0, 4.0);
            let font = egui::FontId::proportional(14.0);
            painter.text(below, egui::Align2::LEFT_TOP, about, font, strong);
        }
    }

    /// Draws what lies over the picture: handles, stroke, ruler, force, axes and progress.
    fn overlay(&mut self, ui: &mut egui::Ui, area: Viewport, camera: &Camera) {
        let mut cancelled = false;
        let painter = ui.painter_at(area.rect);
        let strong = ui.visuals().strong_text_color();
        let line = Line::new(2.0, ui.visuals().selection.stroke.color);
        self.draw_handles(ui, area, camera);
        if let PointerGesture::Cut(way, _) = &self.stroke {
            painter.line(way.clone(), line);
        }
        if let (Some([from, to]), Some(show)) = (self.ruler, &self.show)
            && let (Some(a), Some(b)) = (area.project(camera, from), area.project(camera, to))
        {
            painter.line_segment([a, b], line);
            for end in [a, b] {
                painter.circle_filled(end, 4.0, line.color);
            }
            painter.text(
                a.lerp(b, 0.5) + egui::vec2(8.0, -8.0),
                egui::Align2::LEFT_BOTTOM,
                format!("{} mm", rounded(1e3 * show.unit * from.distance(to), 6)),
                egui::FontId::proportional(15.0),
                strong,
            );
        }
        self.draw_section(ui, area);
        self.draw_force(&painter, area, strong);
        if !self.section_is_large() {
            self.draw_axes(&painter, area, strong);
        }
        let loading = self.loading.as_ref();
        let loading = loading.map(|l| (l.name.clone(), l.progress(), l.opens()));
        let taking = self.taking.as_ref().map(|taking| {
            let (name, progress) = taking.progress();
            (name, progress, true)
        });
        if let Some((name, (what, share, seconds), ends)) = loading.or(taking) {
            let said = match share > 0.0 && share < 1.0 {
                true => format!("{name}: {what}, {:.0} %", 100.0 * share),
                false => format!("{name}: {what}, {seconds:.0} s"),
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
            let below = bar.center_bottom() + egui::vec2(0.0, 22.0);
            let button = Rect::from_center_size(below, egui::vec2(80.0, 24.0));
            cancelled = ends && ui.put(button, egui::Button::new("Cancel")).clicked();
        }
        if cancelled {
            self.cancel_loading();
        }
    }
}

/// Returns what is known about the error of the force of a press, besides its size.
fn error_note(show: &BodySession) -> Option<String> {
    let goes_on = show.is_estimating();
    match show.press_error() {
        Some(Ok(PressError {
            refined: Some(refined),
            ..
        })) => {
            let Round {
                elements, order, ..
            } = refined.round;
            let own = rounded(show.force()?, 4);
            Some(format!(
                "on a finer mesh of {elements} tets of order {order}{}; {own} N on the mesh shown",
                if goes_on { ", refining…" } else { "" }
            ))
        }
        Some(Ok(error)) if !error.is_of_another_depth => Some(format!(
            "error: {} N{}",
            error.parts.in_words(),
            if goes_on { ", refining…" } else { "" }
        )),
        _ if goes_on => Some("estimating the error…".into()),
        Some(Ok(_)) => {
            Some("relative error of another depth; rest to estimate that of this one".into())
        }
        Some(Err(why)) => Some(format!("error unknown: {why}")),
        None => None,
    }
}
