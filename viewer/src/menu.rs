//! Menus, shortcuts, toolbar and status bar.

use crate::app::App;
use crate::camera_control::Side;
use crate::examples::EXAMPLES;
use crate::panel::ImportKind;
use crate::path_prompt::{PathPrompt, SaveKind};
use crate::platform;
use crate::pointer_tool::{PointerGesture, PointerTool};
use crate::settings::{MouseBindings, SectionLines, SectionPlace, Theme};
use eframe::egui::{self, Key, KeyboardShortcut, Modifiers};
use glam::DVec2;
use std::f64::consts::PI;

/// Camera steps of a key: rotation and pan in fractions of the picture's height.
const KEY_ROTATION: f64 = 1.0 / 12.0;
const KEY_PAN: f64 = 0.05;
/// Playback speeds.
const SPEEDS: [f64; 5] = [0.1, 0.25, 0.5, 1.0, 2.0];

const OPEN: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::O);
const OPEN_PATH: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::L);
const SAVE_PICTURE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::P);
const SAVE_SCENE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::S);
const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const RESTART: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::R);

impl App {
    /// Handles keyboard shortcuts, unless a text field has the focus.
    pub(crate) fn handle_shortcuts(&mut self, context: &egui::Context) {
        // A text field handles Ctrl+Z itself.
        if context.text_edit_focused() {
            return;
        }
        let pressed =
            |shortcut: &KeyboardShortcut| context.input_mut(|i| i.consume_shortcut(shortcut));
        if pressed(&REDO) {
            self.undo(true, context);
        }
        if pressed(&UNDO) {
            self.undo(false, context);
        }
        if pressed(&OPEN) {
            platform::choose_file(self.dialog_sender(context), ImportKind::Open);
        }
        if pressed(&OPEN_PATH) {
            self.ask = Some(PathPrompt::of(ImportKind::Open));
        }
        if pressed(&SAVE_PICTURE) {
            self.prompt_save_path(SaveKind::Picture);
        }
        if pressed(&SAVE_SCENE) {
            self.prompt_save_path(SaveKind::Scene);
        }
        if pressed(&RESTART) {
            self.rebuild_body(None, None, context);
        }
        if context.memory(|m| m.focused().is_some()) {
            return;
        }
        self.handle_camera_keys(context);
        let hit = |key: Key| context.input(|i| i.key_pressed(key));
        if hit(Key::Space) {
            self.play(None);
        }
        if hit(Key::Period) {
            self.step();
        }
        if hit(Key::Comma) {
            self.go_on(-1);
        }
        if hit(Key::Escape) {
            if matches!(self.stroke, PointerGesture::Cut(..)) {
                self.stroke = PointerGesture::Idle;
            }
            self.end_gesture();
            self.ruler = None;
            self.pointer_tool = PointerTool::Look;
        }
    }

    /// Handles the keys of the tools and of the camera.
    fn handle_camera_keys(&mut self, context: &egui::Context) {
        let shift = context.input(|i| i.modifiers.shift);
        let hit = |key: Key| context.input(|i| i.key_pressed(key));
        for (hand, _, key, _) in PointerTool::ALL {
            if hit(key) {
                self.pointer_tool = hand;
            }
        }
        let sides = [Key::R, Key::L, Key::A, Key::P, Key::S, Key::I];
        for (key, (side, _, _)) in sides.into_iter().zip(Side::ALL) {
            if hit(key) && context.input(|i| i.modifiers.is_none()) {
                self.orbit.look_from(side);
            }
        }
        let ways = [
            (Key::ArrowLeft, DVec2::NEG_X),
            (Key::ArrowRight, DVec2::X),
            (Key::ArrowUp, DVec2::NEG_Y),
            (Key::ArrowDown, DVec2::Y),
        ];
        for (key, way) in ways {
            match (hit(key), shift) {
                (true, false) => self.orbit.orbit(KEY_ROTATION * way),
                (true, true) => self.orbit.pan(KEY_PAN * way),
                _ => {}
            }
        }
        let near = [
            (Key::Plus, 1.15),
            (Key::Equals, 1.15),
            (Key::Minus, 1.0 / 1.15),
        ];
        for (key, factor) in near {
            if hit(key) {
                self.orbit.zoom(factor);
            }
        }
        for (key, forward) in [(Key::PageUp, KEY_PAN), (Key::PageDown, -KEY_PAN)] {
            if hit(key) {
                self.orbit.dolly(forward, 0.0);
            }
        }
        for (key, angle) in [
            (Key::OpenBracket, PI / 24.0),
            (Key::CloseBracket, -PI / 24.0),
        ] {
            if hit(key) {
                self.orbit.roll(angle);
            }
        }
        if hit(Key::F) || hit(Key::Home) {
            self.fit_view();
        }
        if hit(Key::O) {
            self.orbit.orthographic = !self.orbit.orthographic;
        }
        if hit(Key::X) {
            self.settings.section = self.settings.section.next();
            self.settings.write();
        }
    }

    /// Advances by one step, or shows the next frame of a series.
    fn step(&mut self) {
        if self.go_on(1) {
            return;
        }
        let Some(show) = &mut self.show else { return };
        show.playing = false;
        let result = match show.stage_mut().poll_steps() {
            Ok(true) => Ok(()),
            Ok(false) => show.step(),
            Err(why) => Err(why),
        };
        self.show_error(result);
    }

    /// Draws the menus.
    pub(crate) fn menu(&mut self, ui: &mut egui::Ui) {
        let context = ui.ctx().clone();
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| self.menu_file(ui, &context));
            ui.menu_button("Edit", |ui| {
                let [undo, redo] = self.can_undo();
                if item(ui, undo, "Undo", Some(&UNDO)) {
                    self.undo(false, &context);
                }
                if item(ui, redo, "Redo", Some(&REDO)) {
                    self.undo(true, &context);
                }
                ui.separator();
                if item(ui, self.show.is_some(), "Reset body", Some(&RESTART)) {
                    self.rebuild_body(None, None, &context);
                }
            });
            ui.menu_button("View", |ui| self.menu_view(ui, &context));
            ui.menu_button("Help", |ui| {
                ui.label("Drag to orbit, turn the wheel to zoom.");
                for (_, name, key, help) in PointerTool::ALL {
                    ui.label(format!("{}  {name}: {help}", key.name()));
                }
                ui.label("Space: play or pause   .: next step or frame   ,: previous frame");
                ui.label("F: fit   O: orthographic projection   X: section through a press");
                ui.label("R L A P S I: standard views   arrows: orbit   Shift and arrows: pan");
                ui.label("+ and -: zoom   PgUp and PgDn: dolly   [ and ]: roll");
            });
        });
        self.show_ask(&context);
    }

    fn menu_file(&mut self, ui: &mut egui::Ui, context: &egui::Context) {
        if item(ui, true, "Open…", Some(&OPEN)) {
            platform::choose_file(self.dialog_sender(context), ImportKind::Open);
        }
        if item(ui, true, "Open path…", Some(&OPEN_PATH)) {
            self.ask = Some(PathPrompt::of(ImportKind::Open));
        }
        ui.menu_button("Open recent", |ui| {
            let recent = self.settings.recent.clone();
            if recent.is_empty() {
                ui.label("No recent files");
            }
            for file in recent {
                let name = file
                    .file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned();
                if ui
                    .button(name)
                    .on_hover_text(file.display().to_string())
                    .clicked()
                {
                    self.open(&file, context);
                    ui.close();
                }
            }
        });
        ui.menu_button("Examples", |ui| {
            for example in EXAMPLES {
                if item(ui, true, example.name, None) {
                    self.open_example(example, context);
                }
            }
        });
        ui.separator();
        let open = self.show.is_some();
        if item(ui, open, "Save picture…", Some(&SAVE_PICTURE)) {
            self.prompt_save_path(SaveKind::Picture);
        }
        if item(ui, open, "Save scene…", Some(&SAVE_SCENE)) {
            self.prompt_save_path(SaveKind::Scene);
        }
        if item(ui, open, "Save deformed body…", None) {
            self.prompt_save_path(SaveKind::Mesh);
        }
        #[cfg(not(target_arch = "wasm32"))]
        match self.recording.is_some() {
            false if item(ui, open, "Save film…", None) => self.prompt_save_path(SaveKind::Film),
            true if item(ui, true, "Stop film", None) => self.end_film(),
            _ => {}
        }
        ui.separator();
        if item(ui, true, "Quit", None) {
            context.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    fn menu_view(&mut self, ui: &mut egui::Ui, context: &egui::Context) {
        if item(ui, true, "Fit (F)", None) {
            self.fit_view();
        }
        for (side, letter, name) in Side::ALL {
            if item(ui, true, &format!("{name} ({letter})"), None) {
                self.orbit.look_from(side);
            }
        }
        ui.checkbox(&mut self.orbit.orthographic, "Orthographic (O)");
        if item(ui, true, "Show or hide panels", None) {
            let area = self.area.map_or(0.0, |area| area.rect.right());
            let shown = area < context.content_rect().right() - 1.0;
            self.panels_shown = Some(!shown);
        }
        ui.separator();
        let before = self.settings.clone();
        ui.label("Section through a press (X)");
        for (place, name) in [
            (SectionPlace::Hidden, "Hidden"),
            (SectionPlace::Inset, "Inset"),
            (SectionPlace::Large, "In place of the picture"),
        ] {
            ui.radio_value(&mut self.settings.section, place, name);
        }
        ui.menu_button("Isolines on the section", |ui| {
            for (lines, name) in [
                (SectionLines::None, "None"),
                (SectionLines::Displacement, "Displacement"),
                (SectionLines::Stress, "Von Mises stress"),
            ] {
                ui.radio_value(&mut self.settings.section_lines, lines, name);
            }
        });
        ui.separator();
        ui.label("Mouse bindings");
        ui.radio_value(
            &mut self.settings.mouse_bindings,
            MouseBindings::ParaView,
            "ParaView",
        );
        ui.radio_value(
            &mut self.settings.mouse_bindings,
            MouseBindings::Slicer,
            "3D Slicer",
        );
        ui.separator();
        ui.radio_value(&mut self.settings.theme, Theme::Dark, "Dark");
        ui.radio_value(&mut self.settings.theme, Theme::Light, "Light");
        ui.radio_value(&mut self.settings.theme, Theme::System, "System");
        if self.settings != before {
            self.apply_theme(context);
            self.settings.write();
        }
    }

    /// Draws the toolbar at the left.
    pub(crate) fn toolbar(&mut self, ui: &mut egui::Ui) {
        ui.add_space(4.0);
        for (hand, name, key, help) in PointerTool::ALL {
            let help = format!("{help} ({})", key.name());
            ui.selectable_value(&mut self.pointer_tool, hand, name)
                .on_hover_text(help);
        }
        ui.separator();
        for (side, letter, name) in Side::ALL {
            if ui
                .button(letter)
                .on_hover_text(format!("View from: {name}"))
                .clicked()
            {
                self.orbit.look_from(side);
            }
        }
        if ui
            .button("Fit")
            .on_hover_text("Fit the view to the body (F)")
            .clicked()
        {
            self.fit_view();
        }
    }

    /// Draws the status bar.
    pub(crate) fn status(&mut self, ui: &mut egui::Ui) {
        let context = ui.ctx().clone();
        let rate = self.rate();
        ui.horizontal(|ui| {
            if let Some(show) = &mut self.show {
                let moves = show.stage().motion().is_some();
                let (mut step, mut rest) = (false, false);
                // A series has its own timeline.
                if show.player.is_none() {
                    let play = if show.playing { "Pause" } else { "Play" };
                    if ui.add_enabled(moves, egui::Button::new(play)).clicked() {
                        show.playing = !show.playing;
                    }
                    step = ui.add_enabled(moves, egui::Button::new("Step")).clicked();
                    rest = ui.add_enabled(moves, egui::Button::new("Reset")).clicked();
                }
                egui::ComboBox::from_id_salt("speed")
                    .selected_text(format!("{} × real time", show.speed))
                    .width(100.0)
                    .show_ui(ui, |ui| {
                        for speed in SPEEDS {
                            ui.selectable_value(&mut show.speed, speed, format!("{speed} ×"));
                        }
                    });
                let asleep = show.stage().motion().is_some_and(|m| m.asleep());
                ui.separator();
                ui.label(format!("{:.2} s", show.time()));
                ui.separator();
                let steps = match (show.playing && moves, asleep) {
                    (_, true) => "at rest".to_owned(),
                    _ if show.player.is_some() => "recorded".to_owned(),
                    _ => format!("{:.0} steps/s", show.rate),
                };
                let paths = self.screen.path_samples();
                let paths = paths.map_or(String::new(), |n| format!("  light paths: {n} samples"));
                ui.label(format!(
                    "{} tets  {steps}  {rate:.0} pictures/s{paths}",
                    show.stage().mesh().tets.len()
                ));
                if step {
                    self.step();
                }
                if rest {
                    self.rebuild_body(None, None, &context);
                }
            }
            #[cfg(not(target_arch = "wasm32"))]
            if let Some(seconds) = self.films() {
                ui.separator();
                let (dot, _) = ui.allocate_exact_size(egui::vec2(10.0, 10.0), egui::Sense::hover());
                let red = ui.visuals().error_fg_color;
                ui.painter().circle_filled(dot.center(), 5.0, red);
                if ui.button(format!("Stop film, {seconds:.0} s")).clicked() {
                    self.end_film();
                }
            }
            ui.separator();
            let (said, wrong) = &self.status;
            let text = match wrong {
                true => egui::RichText::new(said).color(ui.visuals().error_fg_color),
                false => egui::RichText::new(said),
            };
            ui.add(egui::Label::new(text).truncate())
                .on_hover_text(said);
        });
    }
}

/// Draws a menu entry. Returns whether it was chosen.
fn item(ui: &mut egui::Ui, enabled: bool, name: &str, shortcut: Option<&KeyboardShortcut>) -> bool {
    let mut button = egui::Button::new(name);
    if let Some(shortcut) = shortcut {
        button = button.shortcut_text(ui.ctx().format_shortcut(shortcut));
    }
    let chosen = ui.add_enabled(enabled, button).clicked();
    if chosen {
        ui.close();
    }
    chosen
}
