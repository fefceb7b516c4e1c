//! Panel of regions: visibility, colour and opacity of each.

use crate::app::App;
use eframe::egui::{self, Color32, Pos2, Sense};
use palpate::mesh::{Location, TetMesh};
use palpate::scene::RegionAppearanceEntry;
use toml_edit::{DocumentMut, Item, Table, Value};

impl App {
    pub(super) fn regions(&mut self, ui: &mut egui::Ui) {
        let (Some(show), Some(scene)) = (&self.show, self.scene()) else {
            return;
        };
        let regions = regions_of(&show.mesh);
        if regions.is_empty() {
            ui.label("The mesh has no regions");
            return;
        }
        let looks = scene.picture.region;
        // Matched by label or by case-insensitive name.
        let look_of = |name: &String| {
            let mut all = looks.iter();
            all.find(|(said, _)| is_called(&show.mesh, name, said))
        };
        let field = show.stage().scalar_field();
        let transfer = show.stage().transfer();
        // Returns the default colour of a region, from the transfer function.
        let drawn = |name: &String| {
            let (_, scalar) = field.regions.iter().find(|(own, _)| own == name)?;
            let [r, g, b] = transfer
                .colour(*scalar)
                .map(|c| (255.0 * c.clamp(0.0, 1.0)) as u8);
            Some(Color32::from_rgb(r, g, b))
        };
        let hidden = |name: &String| {
            let hide = scene.picture.hide.iter();
            let mut said = hide.filter(|said| is_called(&show.mesh, name, said));
            said.next().is_some() || look_of(name).is_some_and(|(_, look)| look.hidden)
        };
        let known = show.mesh.clone();
        let mut change: Option<(String, RegionAppearanceEntry)> = None;
        for name in &regions {
            let mut look = look_of(name)
                .map(|(_, look)| look.clone())
                .unwrap_or_default();
            look.hidden = hidden(name);
            if region_row(ui, name, drawn(name), &mut look) {
                change = Some((name.clone(), look));
            }
        }
        if let Some((name, look)) = change {
            let key = look_of(&name).map_or_else(|| name.clone(), |(key, _)| key.clone());
            self.edit_appearance(&format!("region {name}"), |t| {
                write_region(t, &known, (&name, &key), look);
            });
        }
    }
}

/// Draws the controls of a region, whose default colour is `drawn`. Returns whether its look was
/// changed.
fn region_row(
    ui: &mut egui::Ui,
    name: &str,
    drawn: Option<Color32>,
    look: &mut RegionAppearanceEntry,
) -> bool {
    let mut changed = false;
    ui.horizontal(|ui| {
        if eye(ui, !look.hidden)
            .on_hover_text("Show or hide")
            .clicked()
        {
            look.hidden = !look.hidden;
            changed = true;
        }
        let colour = look
            .colour
            .as_deref()
            .and_then(|c| Color32::from_hex(c).ok());
        let mut own = colour.or(drawn).unwrap_or(Color32::GRAY);
        if ui.color_edit_button_srgba(&mut own).changed() {
            let [r, g, b, _] = own.to_array();
            look.colour = Some(format!("#{r:02x}{g:02x}{b:02x}"));
            changed = true;
        }
        if look.colour.is_some() {
            let mut opacity = look.opacity.unwrap_or(0.9);
            let slider = egui::DragValue::new(&mut opacity)
                .range(0.0..=1.0)
                .speed(0.01);
            if ui
                .add(slider)
                .on_hover_text("Opacity over the mean chord length of the region")
                .changed()
            {
                look.opacity = Some(opacity);
                changed = true;
            }
        }
        ui.label(name);
    });
    changed
}

/// Writes the look of the region `name` to the text of a scene, under `key`.
fn write_region(
    text: &mut DocumentMut,
    mesh: &TetMesh,
    (name, key): (&str, &str),
    look: RegionAppearanceEntry,
) {
    let picture = text.entry("picture").or_insert(Item::Table(Table::new()));
    let Some(picture) = picture.as_table_like_mut() else {
        return;
    };
    if let Some(hide) = picture.get_mut("hide").and_then(Item::as_array_mut) {
        hide.retain(|other| {
            let said = other.as_str().map(str::to_owned);
            let said = said.or(other.as_integer().map(|label| label.to_string()));
            !said.is_some_and(|said| is_called(mesh, name, &said))
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
        true => all.remove(key),
        false => all.insert(key, Item::Table(own)),
    };
}

/// Draws a visibility button: an open or a closed eye.
pub(super) fn eye(ui: &mut egui::Ui, open: bool) -> egui::Response {
    let (rect, response) = ui.allocate_exact_size(egui::vec2(22.0, 16.0), Sense::click());
    response
        .widget_info(|| egui::WidgetInfo::selected(egui::Role::CheckBox, true, open, "visible"));
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

/// Returns the names of a mesh's regions; numbers for unnamed ones.
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

/// Whether `said` in a scene refers to the region `name`: case-insensitive names, or labels.
fn is_called(mesh: &TetMesh, name: &str, said: &str) -> bool {
    let mut labels = mesh.region_names.iter();
    said.eq_ignore_ascii_case(name)
        || labels.any(|(label, own)| own == name && said == label.to_string())
}
