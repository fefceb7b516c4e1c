//! Timeline of a recorded series.

use crate::app::App;
use eframe::egui;

impl App {
    /// Draws the play and frame buttons and the slider.
    pub(crate) fn scrubber(&mut self, ui: &mut egui::Ui) {
        let Some(show) = &mut self.show else { return };
        let playing = show.playing;
        let Some(player) = &mut show.player else {
            return;
        };
        let (count, shown) = (player.series().count(), player.wanted());
        let time = player.series().time(shown);
        let (mut play, mut to) = (None, None);
        ui.horizontal(|ui| {
            let name = if playing { "Pause" } else { "Play" };
            if ui
                .button(name)
                .on_hover_text("Play or pause (Space)")
                .clicked()
            {
                play = Some(!playing);
            }
            let back = ui.add_enabled(shown > 0, egui::Button::new("Back"));
            if back.on_hover_text("Previous frame (,)").clicked() {
                to = shown.checked_sub(1);
            }
            let on = ui.add_enabled(shown + 1 < count, egui::Button::new("Next"));
            if on.on_hover_text("Next frame (.)").clicked() {
                to = Some(shown + 1);
            }
            let said = format!("frame {} of {count}, {time:.4} s", shown + 1);
            let room = ui.available_width() - 190.0;
            ui.spacing_mut().slider_width = room.max(60.0);
            let mut frame = shown;
            let slider = egui::Slider::new(&mut frame, 0..=count.saturating_sub(1));
            if ui.add(slider.show_value(false)).changed() {
                to = Some(frame);
            }
            ui.label(said);
        });
        if let Some(frame) = to {
            player.seek(frame);
            show.playing = false;
        }
        if play.is_some() {
            self.play(play);
        }
    }

    /// Moves by a number of frames, forwards or backwards. Returns whether a series is shown.
    pub(crate) fn go_on(&mut self, frames: isize) -> bool {
        let Some(show) = &mut self.show else {
            return false;
        };
        let Some(player) = &mut show.player else {
            return false;
        };
        show.playing = false;
        player.seek(player.wanted().saturating_add_signed(frames));
        true
    }

    /// Plays or pauses; toggles if `playing` is `None`. A series at its end restarts.
    pub(crate) fn play(&mut self, playing: Option<bool>) {
        let Some(show) = &mut self.show else { return };
        show.playing = playing.unwrap_or(!show.playing);
        if let Some(player) = show.player.as_mut().filter(|p| p.at_end())
            && show.playing
        {
            player.seek(0);
        }
    }
}
