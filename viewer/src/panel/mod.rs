//! Panels at the right; this file has those of colours, light and interaction.

mod material;
mod planes;
mod regions;
mod scans_and_skins;
mod series;
mod transfer;
#[cfg(not(target_arch = "wasm32"))]
mod tuning;

pub(crate) use planes::plane_table;
pub(crate) use scans_and_skins::{ImportKind, PendingImport};
#[cfg(not(target_arch = "wasm32"))]
pub(crate) use tuning::Tuning;

use crate::app::App;
use crate::document::set;
use crate::path_prompt::SaveKind;
use eframe::egui;
use egui_plot::{Line as Curve, Plot, PlotPoints};
use palpate::mesh::TetMesh;
use palpate::render::TransferFunction;
use toml_edit::Value;

/// Render modes and their display names.
const MODES: [(&str, &str); 8] = [
    ("composite", "Volume"),
    ("surface", "Boundary"),
    ("skin", "Skins"),
    ("mip", "Maximum value"),
    ("minip", "Minimum value"),
    ("mean", "Mean value"),
    ("xray", "X-ray"),
    ("thickness", "Thickness"),
];

/// Derived fields of a body that moves.
const COMPUTED: [&str; 5] = ["displacement", "von_mises", "stress_1", "strain", "J"];

impl App {
    /// Draws the panels at the right.
    pub(crate) fn panels(&mut self, ui: &mut egui::Ui) {
        let context = ui.ctx().clone();
        egui::ScrollArea::vertical().show(ui, |ui| {
            if self.show.is_none() {
                ui.label("Open a mesh, a volume, a surface, a scene or a series: drop it here or choose File › Open.");
                return;
            }
            section(ui, "Colours", true, |ui| self.colours(ui));
            section(ui, "Regions", true, |ui| self.regions(ui));
            section(ui, "Planes", true, |ui| self.planes(ui));
            section(ui, "Isosurfaces", false, |ui| self.isosurfaces(ui));
            section(ui, "Scans and skins", false, |ui| self.carried(ui));
            section(ui, "Light", false, |ui| self.light(ui));
            section(ui, "Interaction", true, |ui| self.touching(ui, &context));
            section(ui, "Material and solver", false, |ui| self.material_panel(ui, &context));
            #[cfg(not(target_arch = "wasm32"))]
            section(ui, "Tuning", false, |ui| self.tuning(ui, &context));
        });
    }

    /// Draws the choice of what is shown, and in which colours.
    fn colours(&mut self, ui: &mut egui::Ui) {
        let (Some(show), Some(scene)) = (&self.show, self.scene()) else {
            return;
        };
        let moves = show.stage().motion().is_some();
        let field = show.stage().scalar_field();
        let (name, range) = (field.name.clone(), field.range);
        let by_region = !field.regions.is_empty() && scene.picture.transfer.is_none();
        let mut names = scalar_fields(&show.mesh);
        if moves {
            names.extend(COMPUTED.map(str::to_owned));
        }
        let chosen = scene.picture.field.clone();
        let mode = scene.picture.mode.unwrap_or_else(|| "composite".into());
        let (mut picked, mut moded) = (None, None);
        egui::Grid::new("colours").num_columns(2).show(ui, |ui| {
            ui.label("Mode");
            moded = choose_mode(ui, &mode);
            ui.end_row();
            ui.label("Field");
            picked = choose_field(ui, &name, chosen.as_ref(), &names);
            ui.end_row();
            ui.label("Colours");
            egui::ComboBox::from_id_salt("preset")
                .selected_text("select preset")
                .show_ui(ui, |ui| {
                    for preset in TransferFunction::preset_names() {
                        if ui.button(preset).clicked() {
                            self.edit_appearance("transfer", |t| {
                                set(t, "picture", "transfer", Some(Value::from(preset)));
                            });
                            ui.close();
                        }
                    }
                });
            ui.end_row();
        });
        if let Some(mode) = moded {
            self.edit_appearance("mode", |t| {
                set(t, "picture", "mode", Some(Value::from(mode)))
            });
        }
        if let Some(field) = picked {
            self.edit_appearance("field", |t| {
                set(t, "picture", "field", field.map(Value::from))
            });
        }
        match (scene.scan.is_empty(), by_region) {
            (true, false) => self.transfer_editor(ui, range),
            (false, _) => {
                ui.label("Scans use the colours that the scene sets");
            }
            (_, true) => {
                ui.label("One colour per region; select a field or preset for values");
            }
        }
    }

    fn light(&mut self, ui: &mut egui::Ui) {
        let Some(scene) = self.scene() else { return };
        let mut lit = scene.light.from != Some(palpate::render::Light::None);
        if ui.checkbox(&mut lit, "Light").changed() {
            let from = if lit { "head" } else { "none" };
            self.edit_appearance("light", |t| {
                set(t, "light", "from", Some(Value::from(from)))
            });
        }
        let mut shadows = scene.light.shadows.unwrap_or(0.0);
        let slider = egui::Slider::new(&mut shadows, 0.0..=1.0).text("Shadows");
        if ui.add_enabled(lit, slider).changed() {
            let shadows = Some(Value::from(shadows)).filter(|_| shadows > 0.0);
            self.edit_appearance("shadows", |t| set(t, "light", "shadows", shadows));
        }
    }

    fn touching(&mut self, ui: &mut egui::Ui, context: &egui::Context) {
        let Some(show) = &self.show else { return };
        if let Some(why) = show.cannot_press() {
            ui.label(format!("Pressing unavailable: {why}"));
        }
        let mm = 1e3 * show.unit;
        let (before, most) = (mm * show.radius, 0.25 * mm * show.diagonal());
        let mut chosen = None;
        ui.horizontal(|ui| {
            ui.label("Radius");
            let (range, speed) = (0.01 * most..=most, 0.005 * most);
            chosen = edited(ui, "radius", before, (range, speed, " mm"));
        });
        if let Some(radius) = chosen {
            self.rebuild_body(Some(radius / mm), None, context);
        }
        let cut_depth = &mut self.cut_depth;
        ui.horizontal(|ui| {
            ui.label("Cut depth");
            let mut percent = 100.0 * *cut_depth;
            ui.add(
                egui::DragValue::new(&mut percent)
                    .range(1.0..=100.0)
                    .suffix(" %"),
            );
            *cut_depth = 0.01 * percent;
            ui.label("of body diagonal");
        });
        let Some(show) = &self.show else { return };
        let points: PlotPoints<'_> = show
            .samples()
            .iter()
            .map(|s| [1e3 * s.depth_m, s.force_n])
            .collect();
        Plot::new("press")
            .height(130.0)
            .x_axis_label("Depth (mm)")
            .y_axis_label("Force (N)")
            .allow_scroll(false)
            .show(ui, |plot| plot.line(Curve::new("press", points)));
        let measured = !show.samples().is_empty();
        if ui
            .add_enabled(measured, egui::Button::new("Save as CSV…"))
            .clicked()
        {
            self.prompt_save_path(SaveKind::Press);
        }
    }
}

fn section(ui: &mut egui::Ui, name: &str, open: bool, add: impl FnOnce(&mut egui::Ui)) {
    egui::CollapsingHeader::new(name)
        .default_open(open)
        .show(ui, add);
}

/// Draws a number field. Returns the new value once editing ends.
pub(crate) fn edited(
    ui: &mut egui::Ui,
    name: &str,
    value: f64,
    (range, speed, unit): (std::ops::RangeInclusive<f64>, f64, &str),
) -> Option<f64> {
    let id = ui.make_persistent_id(name);
    let mut now = ui.data(|d| d.get_temp::<f64>(id)).unwrap_or(value);
    let field = egui::DragValue::new(&mut now)
        .range(range)
        .clamp_existing_to_range(false)
        .speed(speed)
        .suffix(unit);
    let response = ui.add(field);
    let done = response.drag_stopped() || response.lost_focus();
    match done || !(response.dragged() || response.has_focus()) {
        true => ui.data_mut(|d| d.remove::<f64>(id)),
        false => {
            ui.data_mut(|d| d.insert_temp(id, now));
        }
    }
    (done && now != value).then_some(now)
}

/// Returns the names of the scalar fields.
fn scalar_fields(mesh: &TetMesh) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for field in mesh.fields.iter().filter(|f| f.components == 1) {
        if !names.contains(&field.name) {
            names.push(field.name.clone());
        }
    }
    names
}

/// Draws the choice of the mode. Returns the mode that was picked.
fn choose_mode(ui: &mut egui::Ui, chosen: &str) -> Option<&'static str> {
    let mut picked = None;
    let called = MODES
        .iter()
        .find(|(m, _)| *m == chosen)
        .map_or(chosen, |m| m.1);
    egui::ComboBox::from_id_salt("mode")
        .selected_text(called)
        .show_ui(ui, |ui| {
            for (mode, called) in MODES {
                if ui.selectable_label(mode == chosen, called).clicked() {
                    picked = Some(mode);
                }
            }
        });
    picked
}

/// Draws the choice of the field, of which `shown` is displayed. Returns the field that was picked;
/// the inner `None` is the default.
fn choose_field(
    ui: &mut egui::Ui,
    shown: &str,
    chosen: Option<&String>,
    names: &[String],
) -> Option<Option<String>> {
    let mut picked = None;
    egui::ComboBox::from_id_salt("field")
        .selected_text(shown)
        .show_ui(ui, |ui| {
            if ui.selectable_label(chosen.is_none(), "automatic").clicked() {
                picked = Some(None);
            }
            for field in names {
                if ui.selectable_label(chosen == Some(field), field).clicked() {
                    picked = Some(Some(field.clone()));
                }
            }
        });
    picked
}
