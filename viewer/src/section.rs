//! The section through a press, over the picture: as an inset, or in its place.

use crate::app::App;
use crate::body_session::SectionOptions;
use crate::settings::{SectionLines, SectionPlace};
use crate::viewport::Viewport;
use eframe::egui::{self, Color32, Rect, Stroke, StrokeKind, TextureHandle, TextureOptions};
use palpate::physics::BodyField;

/// Width of the inset relative to the picture, and its bounds, in points.
const INSET: f32 = 0.42;
const INSET_WIDTH: std::ops::RangeInclusive<f32> = 240.0..=560.0;
/// Width over height of the inset.
const ASPECT: f32 = 4.0 / 3.0;
/// Distance of the inset from the edges of the picture, in points.
const MARGIN: f32 = 12.0;

impl App {
    /// Whether a section is shown in place of the picture.
    pub(crate) fn section_is_large(&self) -> bool {
        self.section.is_some() && self.settings.section == SectionPlace::Large
    }

    /// Draws the section through the body under the finger, while it presses.
    pub(crate) fn draw_section(&mut self, ui: &egui::Ui, area: Viewport) {
        let place = match self.settings.section {
            SectionPlace::Hidden => None,
            SectionPlace::Large => Some(area.rect),
            SectionPlace::Inset => {
                let width = (INSET * area.rect.width())
                    .clamp(*INSET_WIDTH.start(), *INSET_WIDTH.end())
                    .min(area.rect.width() - 2.0 * MARGIN);
                let size = egui::vec2(width, width / ASPECT);
                let corner = area.rect.right_bottom() - egui::Vec2::splat(MARGIN);
                Some(Rect::from_min_max(corner - size, corner))
            }
        };
        let scale = ui.ctx().pixels_per_point();
        let options = place.map(|place| SectionOptions {
            size: [place.width(), place.height()].map(|x| (x * scale).round().max(16.0) as u32),
            lines: match self.settings.section_lines {
                SectionLines::None => None,
                SectionLines::Displacement => Some(BodyField::Displacement),
                SectionLines::Stress => Some(BodyField::VonMises),
            },
        });
        let Some(show) = &mut self.show else {
            self.section = None;
            return;
        };
        let updated = show.update_section(options, ui.ctx());
        let pressed = show.force().is_some();
        match updated {
            Ok(Some(pixels)) => {
                let size = pixels.size.map(|n| n as usize);
                let image = egui::ColorImage::from_rgba_unmultiplied(size, &pixels.rgba);
                match &mut self.section {
                    Some(texture) => texture.set(image, TextureOptions::LINEAR),
                    none => *none = Some(texture(ui, image)),
                }
            }
            Ok(None) => {}
            Err(why) => self.status = (why.to_string(), true),
        }
        if !pressed || place.is_none() {
            self.section = None;
        }
        if let (Some(texture), Some(place)) = (&self.section, place) {
            let painter = ui.painter_at(area.rect);
            let whole = Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
            painter.image(texture.id(), place, whole, Color32::WHITE);
            let line = Stroke::new(1.0, ui.visuals().weak_text_color());
            painter.rect_stroke(place, 0.0, line, StrokeKind::Inside);
        }
    }
}

fn texture(ui: &egui::Ui, image: egui::ColorImage) -> TextureHandle {
    ui.ctx()
        .load_texture("section", image, TextureOptions::LINEAR)
}
