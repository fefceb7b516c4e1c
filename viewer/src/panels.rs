//! The panels at the right: colours, regions, planes, isosurfaces, light, touch.

use crate::app::App;
use crate::ask::Saved;
use crate::document::{set, set_all};
use crate::histogram::Histogram;
use eframe::egui::{self, Color32, Pos2, Rect, Sense, Stroke as Line};
use egui_plot::{Line as Curve, Plot, PlotPoints};
use glam::DVec3;
use palpate::mesh::{Location, TetMesh};
use palpate::render::TransferFunction;
use palpate::scene::{IsosurfaceEntry, PlaneEntry, RegionLookEntry};
use toml_edit::{Array, Item, Table, Value};

/// Height of the editor of transfer functions.
const EDITOR: f32 = 110.0;
/// How near the pointer takes a point.
const NEAR: f32 = 9.0;
/// The way through the body whose opacity the editor shows, over the body's extent.
const WAY: f64 = 0.1;
/// Opacities are not dragged beyond this.
const DENSE: f64 = 0.995;

/// Modes of pictures, and what they are called here.
const MODES: [(&str, &str); 8] = [
    ("composite", "Inside"),
    ("surface", "Boundary"),
    ("skin", "Skins"),
    ("mip", "Largest value"),
    ("minip", "Least value"),
    ("mean", "Mean value"),
    ("xray", "X-ray"),
    ("thickness", "Thickness"),
];

/// What a body that moves can show of itself.
const COMPUTED: [&str; 5] = ["displacement", "von_mises", "stress_1", "strain", "J"];

impl App {
    /// The panels at the right.
    pub(crate) fn panels(&mut self, ui: &mut egui::Ui) {
        let context = ui.ctx().clone();
        egui::ScrollArea::vertical().show(ui, |ui| {
            if self.show.is_none() {
                ui.label("Open a mesh, a volume, a surface or a scene: drop it here, or choose File › Open.");
                return;
            }
            section(ui, "Colours", true, |ui| self.colours(ui));
            section(ui, "Regions", true, |ui| self.regions(ui));
            section(ui, "Planes", true, |ui| self.planes(ui));
            section(ui, "Isosurfaces", false, |ui| self.isosurfaces(ui));
            section(ui, "Light", false, |ui| self.light(ui));
            section(ui, "Touch", true, |ui| self.touching(ui, &context));
            section(ui, "Matter and time", false, |ui| self.matter(ui, &context));
        });
    }

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
            ui.label("Show");
            let called = MODES
                .iter()
                .find(|(m, _)| *m == mode)
                .map_or(mode.as_str(), |m| m.1);
            egui::ComboBox::from_id_salt("mode")
                .selected_text(called)
                .show_ui(ui, |ui| {
                    for (mode_of, called) in MODES {
                        if ui.selectable_label(mode_of == mode, called).clicked() {
                            moded = Some(mode_of);
                        }
                    }
                });
            ui.end_row();
            ui.label("Field");
            egui::ComboBox::from_id_salt("field")
                .selected_text(name)
                .show_ui(ui, |ui| {
                    if ui
                        .selectable_label(chosen.is_none(), "what suits the body")
                        .clicked()
                    {
                        picked = Some(None);
                    }
                    for field in &names {
                        if ui
                            .selectable_label(chosen.as_ref() == Some(field), field)
                            .clicked()
                        {
                            picked = Some(Some(field.clone()));
                        }
                    }
                });
            ui.end_row();
            ui.label("Colours");
            egui::ComboBox::from_id_salt("preset")
                .selected_text("take a preset")
                .show_ui(ui, |ui| {
                    for preset in TransferFunction::preset_names() {
                        if ui.button(preset).clicked() {
                            self.edit_looks("transfer", |t| {
                                set(t, "picture", "transfer", Some(Value::from(preset)));
                            });
                            ui.close();
                        }
                    }
                });
            ui.end_row();
        });
        if let Some(mode) = moded {
            self.edit_looks("mode", |t| {
                set(t, "picture", "mode", Some(Value::from(mode)))
            });
        }
        if let Some(field) = picked {
            self.edit_looks("field", |t| {
                set(t, "picture", "field", field.map(Value::from))
            });
        }
        match (scene.scan.is_empty(), by_region) {
            (true, false) => self.transfer_editor(ui, range),
            (false, _) => {
                ui.label("Scans have the colours that their scene gives them");
            }
            (_, true) => {
                ui.label("A colour a region; take a field or a preset to show values");
            }
        }
    }

    /// The opacity of each scalar over how often it occurs: points that can be dragged, added by a
    /// double click, and taken away by a click of the right button.
    fn transfer_editor(&mut self, ui: &mut egui::Ui, range: (f64, f64)) {
        let Some(show) = &self.show else { return };
        let stage = show.stage();
        let field = stage.scalar_field();
        let of = (field.name.clone(), show.version);
        let fresh = |h: &&Histogram| h.of == of && h.range == range;
        if self.histogram.as_ref().filter(fresh).is_none() {
            let values = field.cells.as_ref().unwrap_or(&field.values);
            self.histogram = Some(Histogram::of(values, range, of));
        }
        let (low, high) = show.bounds;
        let way = WAY * (high - low).max_element();
        let transfer = stage.transfer();
        let mut points = transfer.extinction_nodes().to_vec();
        let width = ui.available_width();
        let (rect, response) =
            ui.allocate_exact_size(egui::vec2(width, EDITOR), Sense::click_and_drag());
        let span = (range.1 - range.0).max(f64::MIN_POSITIVE);
        let place = |[s, density]: [f64; 2]| {
            let opacity = -(-density * way).exp_m1();
            Pos2::new(
                rect.left() + rect.width() * ((s - range.0) / span).clamp(0.0, 1.0) as f32,
                rect.bottom() - rect.height() * opacity as f32,
            )
        };
        let point = |at: Pos2| {
            let x = f64::from((at.x - rect.left()) / rect.width()).clamp(0.0, 1.0);
            let y = f64::from((rect.bottom() - at.y) / rect.height()).clamp(0.0, DENSE);
            [range.0 + x * span, -(-y).ln_1p() / way]
        };
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
        if let Some(histogram) = &self.histogram {
            let bar = rect.width() / histogram.bars.len() as f32;
            for (n, share) in histogram.bars.iter().enumerate() {
                let s = range.0 + span * (n as f64 + 0.5) / histogram.bars.len() as f64;
                let [r, g, b] = transfer
                    .colour(s)
                    .map(|c| (255.0 * c.clamp(0.0, 1.0)) as u8);
                let left = rect.left() + bar * n as f32;
                let top = rect.bottom() - rect.height() * share;
                let bar =
                    Rect::from_min_max(Pos2::new(left, top), Pos2::new(left + bar, rect.bottom()));
                painter.rect_filled(bar, 0.0, Color32::from_rgb(r, g, b).gamma_multiply(0.75));
            }
        }
        let line = Line::new(1.5, ui.visuals().strong_text_color());
        painter.line(points.iter().map(|p| place(*p)).collect(), line);
        for p in &points {
            painter.circle(place(*p), 4.0, ui.visuals().window_fill, line);
        }
        let near = |at: Pos2, points: &[[f64; 2]]| {
            let away = |p: &[f64; 2]| place(*p).distance(at);
            let all = points.iter().enumerate().map(|(n, p)| (n, away(p)));
            let nearest = all.min_by(|a, b| a.1.total_cmp(&b.1));
            nearest.filter(|(_, away)| *away <= NEAR).map(|(n, _)| n)
        };
        let Some(at) = response.interact_pointer_pos() else {
            self.dragged = None;
            response.on_hover_text(
                "Drag points; double-click to add one, right-click to take one away",
            );
            return;
        };
        let mut changed = false;
        if response.double_clicked() {
            points.push(point(at));
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            changed = true;
        } else if response.secondary_clicked() {
            if let Some(n) = near(at, &points).filter(|_| points.len() > 1) {
                points.remove(n);
                changed = true;
            }
        } else if response.drag_started() {
            let begun = ui.input(|i| i.pointer.press_origin()).unwrap_or(at);
            self.dragged = near(begun, &points);
        }
        if let Some(n) = self
            .dragged
            .filter(|n| response.dragged() && *n < points.len())
        {
            let [s, density] = point(at);
            let before = n.checked_sub(1).map_or(f64::NEG_INFINITY, |n| points[n][0]);
            let after = points.get(n + 1).map_or(f64::INFINITY, |p| p[0]);
            points[n] = [s.clamp(before, after), density];
            changed = true;
        }
        if changed {
            let json = serde_json::json!({
                "colour": transfer.colour_nodes(),
                "extinction": points,
            });
            self.edit_transfer(&json.to_string());
        }
    }

    /// Takes a transfer function over, which is quicker than all looks are.
    fn edit_transfer(&mut self, json: &str) {
        let result = TransferFunction::from_json(json).and_then(|transfer| {
            let (Some(document), Some(show)) = (&mut self.document, &mut self.show) else {
                return Ok(());
            };
            document.edit("transfer", |t| {
                set(t, "picture", "transfer", Some(Value::from(json)));
            })?;
            show.stage_mut().set_transfer(&transfer)
        });
        self.tell_error(result);
    }

    fn regions(&mut self, ui: &mut egui::Ui) {
        let (Some(show), Some(scene)) = (&self.show, self.scene()) else {
            return;
        };
        let regions = regions_of(&show.mesh);
        if regions.is_empty() {
            ui.label("The mesh has none");
            return;
        }
        let looks = scene.picture.region;
        let hidden = |name: &String| {
            let hide = scene.picture.hide.iter();
            let mut said = hide.filter(|said| is_called(&show.mesh, name, said));
            said.next().is_some() || looks.get(name).is_some_and(|look| look.hidden)
        };
        let known = show.mesh.clone();
        let mut change: Option<(String, RegionLookEntry)> = None;
        for name in &regions {
            let mut look = looks.get(name).cloned().unwrap_or_default();
            look.hidden = hidden(name);
            ui.horizontal(|ui| {
                if eye(ui, !look.hidden)
                    .on_hover_text("Show or hide")
                    .clicked()
                {
                    look.hidden = !look.hidden;
                    change = Some((name.clone(), look.clone()));
                }
                let colour = look
                    .colour
                    .as_deref()
                    .and_then(|c| Color32::from_hex(c).ok());
                let mut own = colour.unwrap_or(Color32::GRAY);
                if ui.color_edit_button_srgba(&mut own).changed() {
                    let [r, g, b, _] = own.to_array();
                    look.colour = Some(format!("#{r:02x}{g:02x}{b:02x}"));
                    change = Some((name.clone(), look.clone()));
                }
                if look.colour.is_some() {
                    let mut opacity = look.opacity.unwrap_or(0.9);
                    let slider = egui::DragValue::new(&mut opacity)
                        .range(0.0..=1.0)
                        .speed(0.01);
                    if ui
                        .add(slider)
                        .on_hover_text("Opacity of a ray's mean way through it")
                        .changed()
                    {
                        look.opacity = Some(opacity);
                        change = Some((name.clone(), look.clone()));
                    }
                }
                ui.label(name);
            });
        }
        if let Some((name, look)) = change {
            self.edit_looks(&format!("region {name}"), |t| {
                let picture = t.entry("picture").or_insert(Item::Table(Table::new()));
                let Some(picture) = picture.as_table_like_mut() else {
                    return;
                };
                if let Some(hide) = picture.get_mut("hide").and_then(Item::as_array_mut) {
                    hide.retain(|other| {
                        let said = other.as_str().map(str::to_owned);
                        let said = said.or(other.as_integer().map(|label| label.to_string()));
                        !said.is_some_and(|said| is_called(&known, &name, &said))
                    });
                }
                let all = picture.entry("region").or_insert(Item::Table(Table::new()));
                let Some(all) = all.as_table_like_mut() else {
                    return;
                };
                let mut own = Table::new();
                let texts = [("transfer", look.transfer), ("colour", look.colour)];
                for (key, text) in texts.into_iter().filter_map(|(k, t)| t.map(|t| (k, t))) {
                    own.insert(key, Item::Value(Value::from(text)));
                }
                if let Some(opacity) = look.opacity {
                    own.insert("opacity", Item::Value(Value::from(opacity)));
                }
                if look.hidden {
                    own.insert("hidden", Item::Value(Value::from(true)));
                }
                match own.is_empty() {
                    true => all.remove(&name),
                    false => all.insert(&name, Item::Table(own)),
                };
            });
        }
    }

    fn planes(&mut self, ui: &mut egui::Ui) {
        let (Some(show), Some(scene)) = (&self.show, self.scene()) else {
            return;
        };
        let (low, high) = show.bounds;
        let mut planes = scene.plane;
        let mut changed = false;
        let mut gone = None;
        for (n, plane) in planes.iter_mut().enumerate() {
            let kind = if plane.slice.is_some() {
                "Slice"
            } else {
                "Clip"
            };
            let Some(values) = plane.clip.as_mut().or(plane.slice.as_mut()) else {
                ui.horizontal(|ui| {
                    ui.label("Box");
                    if ui.button("×").clicked() {
                        gone = Some(n);
                    }
                });
                continue;
            };
            let [a, b, c, x, y, z] = *values;
            let (mut point, mut normal) = (
                DVec3::new(a, b, c),
                DVec3::new(x, y, z).normalize_or(DVec3::Z),
            );
            ui.push_id(n, |ui| {
                ui.horizontal(|ui| {
                    ui.label(kind);
                    for (axis, name) in DVec3::AXES.into_iter().zip(["x", "y", "z"]) {
                        let on = normal.dot(axis).abs() > 0.999;
                        if ui.selectable_label(on, name).clicked() {
                            normal = axis;
                            point = 0.5 * (low + high);
                            changed = true;
                        }
                    }
                    if ui
                        .button("view")
                        .on_hover_text("Across the line of sight")
                        .clicked()
                    {
                        normal = self.orbit.turn * DVec3::Z;
                        point = 0.5 * (low + high);
                        changed = true;
                    }
                    if ui.button("flip").clicked() {
                        normal = -normal;
                        changed = true;
                    }
                    if ui.button("×").on_hover_text("Take it away").clicked() {
                        gone = Some(n);
                    }
                });
                let corners = (0..8).map(|k| {
                    let pick = |axis: usize| [low, high][k >> axis & 1][axis];
                    DVec3::new(pick(0), pick(1), pick(2)).dot(normal)
                });
                let (first, last) = corners
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| {
                        (a.min(d), b.max(d))
                    });
                let mut at = ((point.dot(normal) - first) / (last - first)).clamp(0.0, 1.0);
                let slider = egui::Slider::new(&mut at, 0.0..=1.0).show_value(false);
                let slid = ui.horizontal(|ui| {
                    changed |= ui
                        .checkbox(&mut plane.rest, "bends")
                        .on_hover_text("The cut bends with the body")
                        .changed();
                    ui.spacing_mut().slider_width = (ui.available_width() - 8.0).max(60.0);
                    ui.add(slider).changed()
                });
                if slid.inner {
                    let middle = 0.5 * (low + high);
                    let along = first + at * (last - first);
                    point = middle + (along - middle.dot(normal)) * normal;
                    changed = true;
                }
            });
            *values = [point.x, point.y, point.z, normal.x, normal.y, normal.z];
        }
        if !planes.is_empty() {
            ui.checkbox(&mut self.handles_shown, "Handles in the picture")
                .on_hover_text("Drag the square to move a plane, the round end of its arrow to tilt it");
        }
        let middle = (0.5 * (low + high)).to_array();
        let [a, b, c] = middle;
        let back = self.orbit.turn * DVec3::Z;
        // What is nearest to the eye is cut off first.
        let axis = back.abs().max_position();
        let n = DVec3::AXES[axis] * back[axis].signum();
        let new = [a, b, c, n.x, n.y, n.z];
        ui.horizontal(|ui| {
            if ui.button("Add a clip").clicked() {
                planes.push(PlaneEntry {
                    clip: Some(new),
                    ..PlaneEntry::default()
                });
                changed = true;
            }
            if ui.button("Add a slice").clicked() {
                planes.push(PlaneEntry {
                    slice: Some(new),
                    ..PlaneEntry::default()
                });
                changed = true;
            }
        });
        if let Some(n) = gone {
            planes.remove(n);
            changed = true;
        }
        if changed {
            self.edit_planes("planes", |t| {
                set_all(t, "plane", planes.iter().map(plane_table).collect());
            });
        }
    }

    fn isosurfaces(&mut self, ui: &mut egui::Ui) {
        let (Some(show), Some(scene)) = (&self.show, self.scene()) else {
            return;
        };
        let (low, high) = show.stage().scalar_field().range;
        let mut surfaces = scene.isosurface;
        let (mut changed, mut gone) = (false, None);
        for (n, surface) in surfaces.iter_mut().enumerate() {
            ui.push_id(n, |ui| {
                ui.horizontal(|ui| {
                    changed |= ui
                        .add(
                            egui::Slider::new(&mut surface.value, low..=high)
                                .clamping(egui::SliderClamping::Edits),
                        )
                        .changed();
                    let mut opacity = surface.opacity.unwrap_or(1.0);
                    let own = egui::DragValue::new(&mut opacity)
                        .range(0.05..=1.0)
                        .speed(0.01);
                    if ui.add(own).on_hover_text("Opacity").changed() {
                        surface.opacity = Some(opacity);
                        changed = true;
                    }
                    if ui.button("×").clicked() {
                        gone = Some(n);
                    }
                });
            });
        }
        if ui.button("Add one").clicked() {
            surfaces.push(IsosurfaceEntry {
                value: 0.5 * (low + high),
                colour: None,
                opacity: None,
            });
            changed = true;
        }
        if let Some(n) = gone {
            surfaces.remove(n);
            changed = true;
        }
        if changed {
            self.edit_planes("isosurfaces", |t| {
                set_all(
                    t,
                    "isosurface",
                    surfaces.iter().map(isosurface_table).collect(),
                );
            });
        }
    }

    fn light(&mut self, ui: &mut egui::Ui) {
        let Some(scene) = self.scene() else { return };
        let mut lit = scene.light.from != Some(palpate::render::Light::None);
        if ui.checkbox(&mut lit, "Light").changed() {
            let from = if lit { "head" } else { "none" };
            self.edit_looks("light", |t| {
                set(t, "light", "from", Some(Value::from(from)))
            });
        }
        let mut shadows = scene.light.shadows.unwrap_or(0.0);
        let slider = egui::Slider::new(&mut shadows, 0.0..=1.0).text("shadows");
        if ui.add_enabled(lit, slider).changed() {
            let shadows = Some(Value::from(shadows)).filter(|_| shadows > 0.0);
            self.edit_looks("shadows", |t| set(t, "light", "shadows", shadows));
        }
    }

    fn touching(&mut self, ui: &mut egui::Ui, context: &egui::Context) {
        let Some(show) = &self.show else { return };
        if let Some(why) = show.cannot_press() {
            ui.label(format!("It cannot be pressed on: {why}"));
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
            self.restart(Some(radius / mm), None, context);
        }
        let cut_depth = &mut self.cut_depth;
        ui.horizontal(|ui| {
            ui.label("Cuts go");
            let mut percent = 100.0 * *cut_depth;
            ui.add(
                egui::DragValue::new(&mut percent)
                    .range(1.0..=100.0)
                    .suffix(" %"),
            );
            *cut_depth = 0.01 * percent;
            ui.label("of the body deep");
        });
        let Some(show) = &self.show else { return };
        let points: PlotPoints<'_> = show
            .samples
            .iter()
            .map(|s| [1e3 * s.depth_m, s.force_n])
            .collect();
        Plot::new("press")
            .height(130.0)
            .x_axis_label("depth, mm")
            .y_axis_label("force, N")
            .allow_scroll(false)
            .show(ui, |plot| plot.line(Curve::new("press", points)));
        let measured = !show.samples.is_empty();
        if ui
            .add_enabled(measured, egui::Button::new("Save as CSV…"))
            .clicked()
        {
            self.ask_place(Saved::Press);
        }
    }
}

fn section(ui: &mut egui::Ui, name: &str, open: bool, add: impl FnOnce(&mut egui::Ui)) {
    egui::CollapsingHeader::new(name)
        .default_open(open)
        .show(ui, add);
}

/// A number that is dragged or typed: what it was changed to, once that is done.
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

/// A button that is an open eye, or a closed one.
fn eye(ui: &mut egui::Ui, open: bool) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(egui::vec2(22.0, 16.0), Sense::click());
    response.widget_info(|| egui::WidgetInfo::selected(egui::Role::CheckBox, true, open, "shown"));
    let line = ui.style().interact(&response).fg_stroke;
    let (middle, half) = (rect.center(), egui::vec2(9.0, 4.5));
    let arc = |up: f32| {
        let points = (0..=12).map(|n| {
            let x = n as f32 / 6.0 - 1.0;
            middle + egui::vec2(half.x * x, -up * half.y * (1.0 - x * x))
        });
        points.collect::<Vec<Pos2>>()
    };
    let painter = ui.painter();
    painter.line(arc(-1.0), line);
    if open {
        painter.line(arc(1.0), line);
        painter.circle_filled(middle, 2.6, line.color);
    }
    response
}

/// The fields of one number.
fn scalar_fields(mesh: &TetMesh) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for field in mesh.fields.iter().filter(|f| f.components == 1) {
        if !names.contains(&field.name) {
            names.push(field.name.clone());
        }
    }
    names
}

/// The regions of a mesh, by name or number.
fn regions_of(mesh: &TetMesh) -> Vec<String> {
    let field = mesh.region_field().filter(|f| f.location == Location::Cell);
    let Some(field) = field else {
        return Vec::new();
    };
    let labels: std::collections::BTreeSet<i64> = field.values.iter().map(|v| *v as i64).collect();
    let name = |label: i64| {
        mesh.region_names
            .get(&label)
            .cloned()
            .unwrap_or_else(|| label.to_string())
    };
    labels.into_iter().map(name).collect()
}

/// Whether a scene that says `said` means the region `name`: names in any case, or labels.
fn is_called(mesh: &TetMesh, name: &str, said: &str) -> bool {
    let mut labels = mesh.region_names.iter();
    said.eq_ignore_ascii_case(name)
        || labels.any(|(label, own)| own == name && said == label.to_string())
}

pub(crate) fn plane_table(plane: &PlaneEntry) -> Table {
    let mut table = Table::new();
    let all = [
        ("clip", plane.clip),
        ("slice", plane.slice),
        ("box", plane.around),
    ];
    for (key, values) in all.into_iter().filter_map(|(k, v)| v.map(|v| (k, v))) {
        table.insert(
            key,
            Item::Value(Value::Array(values.into_iter().collect::<Array>())),
        );
    }
    if plane.rest {
        table.insert("rest", Item::Value(Value::from(true)));
    }
    if let Some(opacity) = plane.opacity {
        table.insert("opacity", Item::Value(Value::from(opacity)));
    }
    table
}

fn isosurface_table(surface: &IsosurfaceEntry) -> Table {
    let mut table = Table::new();
    table.insert("value", Item::Value(Value::from(surface.value)));
    if let Some(colour) = &surface.colour {
        table.insert("colour", Item::Value(Value::from(colour.as_str())));
    }
    if let Some(opacity) = surface.opacity {
        table.insert("opacity", Item::Value(Value::from(opacity)));
    }
    table
}
