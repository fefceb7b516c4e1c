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
        let mut removed = None;
        for (n, plane) in planes.iter_mut().enumerate() {
            let row = plane_row(ui, n, plane, (low, high), self.orbit.turn * DVec3::Z);
            changed |= row.changed;
            if row.removed {
                removed = Some(n);
            }
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
        if let Some(n) = removed {
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
        let (mut changed, mut removed) = (false, None);
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
                        removed = Some(n);
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
        if let Some(n) = removed {
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

/// What was done in the row of a plane.
#[derive(Default)]
struct PlaneRow {
    changed: bool,
    removed: bool,
}

/// Draws the controls of a plane of a body with these bounds; `back` points from the body to the
/// eye.
fn plane_row(
    ui: &mut egui::Ui,
    n: usize,
    plane: &mut PlaneEntry,
    (low, high): (DVec3, DVec3),
    back: DVec3,
) -> PlaneRow {
    let mut row = PlaneRow::default();
    let kind = if plane.slice.is_some() {
        "Slice"
    } else {
        "Clip"
    };
    let Some(values) = plane.clip.as_mut().or(plane.slice.as_mut()) else {
        ui.horizontal(|ui| {
            ui.label("Box");
            if ui.button("×").clicked() {
                row.removed = true;
            }
        });
        return row;
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
                    row.changed = true;
                }
            }
            if ui
                .button("view")
                .on_hover_text("Perpendicular to the line of sight")
                .clicked()
            {
                normal = back;
                point = 0.5 * (low + high);
                row.changed = true;
            }
            if ui.button("flip").clicked() {
                normal = -normal;
                row.changed = true;
            }
            if ui.button("×").on_hover_text("Remove this plane").clicked() {
                row.removed = true;
            }
        });
        let (first, last) = extent((low, high), normal);
        let mut at = ((point.dot(normal) - first) / (last - first)).clamp(0.0, 1.0);
        let slider = egui::Slider::new(&mut at, 0.0..=1.0).show_value(false);
        let slid = ui.horizontal(|ui| {
            row.changed |= ui
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
            row.changed = true;
        }
    });
    *values = [point.x, point.y, point.z, normal.x, normal.y, normal.z];
    row
}

/// Returns the smallest and largest coordinate of a box along `normal`.
fn extent((low, high): (DVec3, DVec3), normal: DVec3) -> (f64, f64) {
    let corners = (0..8).map(|k| {
        let pick = |axis: usize| [low, high][k >> axis & 1][axis];
        DVec3::new(pick(0), pick(1), pick(2)).dot(normal)
    });
    corners.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| {
        (a.min(d), b.max(d))
    })
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
