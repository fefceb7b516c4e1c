//! Panels of planes and isosurfaces.

use crate::app::App;
use crate::document::set_all;
use eframe::egui;
use glam::DVec3;
use palpate::scene::{IsosurfaceEntry, PlaneEntry};
use toml_edit::{Array, Item, Table, Value};

impl App {
    pub(super) fn planes(&mut self, ui: &mut egui::Ui) {
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
                        .on_hover_text("Perpendicular to the line of sight")
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
                    if ui.button("×").on_hover_text("Remove this plane").clicked() {
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
                        .on_hover_text("The plane deforms with the body")
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
                .on_hover_text("Drag the square to move a plane, the round arrow end to tilt it");
        }
        let middle = (0.5 * (low + high)).to_array();
        let [a, b, c] = middle;
        let back = self.orbit.turn * DVec3::Z;
        // Clips the half that is nearer to the eye.
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

    pub(super) fn isosurfaces(&mut self, ui: &mut egui::Ui) {
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
