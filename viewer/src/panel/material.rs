//! Panel of the material and the simulation settings.

use super::edited;
use crate::app::App;
use crate::document::{numbers, set};
use eframe::egui;
use palpate::mesh::ElementOrder;
use palpate::physics::{Engine, EngineChoice, TISSUES};
use palpate::scene::{OrderChoice, Scene};
use toml_edit::{Array, DocumentMut, Item, Table, Value};

/// Engines and their display names.
const ENGINES: [(&str, &str); 3] = [("auto", "automatic"), ("cpu", "CPU"), ("gpu", "GPU")];
/// Integrators and their descriptions.
const INTEGRATORS: [(&str, &str); 7] = [
    (
        "implicit",
        "first order, stable at any step; supports pressing",
    ),
    ("bdf2", "second order, CPU only; supports pressing"),
    ("midpoint", "second order, conserves energy, CPU only"),
    ("explicit", "small steps only"),
    ("symplectic", "small steps, conserves energy"),
    ("verlet", "small steps, conserves energy"),
    ("velocity-verlet", "small steps, conserves energy"),
];

/// Orders of the elements and their display names.
const ORDERS: [(&str, &str); 3] = [
    ("1", "linear tets"),
    ("2", "quadratic tets"),
    ("auto", "automatic"),
];

/// Table, key and new value of an entry.
type Edit = (&'static str, &'static str, Value);

impl App {
    /// Draws the panel of material and simulation settings; a change rebuilds the body.
    pub(crate) fn material_panel(&mut self, ui: &mut egui::Ui, context: &egui::Context) {
        let (Some(show), Some(scene)) = (&self.show, self.scene()) else {
            return;
        };
        let Some(motion) = show.stage().motion() else {
            ui.label("Static body");
            return;
        };
        let (dt, scheme) = (1e3 * motion.dt, motion.kind().to_string());
        let (engine, by) = (motion.engine(), scene.solver.engine);
        let tolerance = scene.solver.tolerance.unwrap_or(0.01);
        let mut edits: Vec<Edit> = Vec::new();
        let mut stiffer = None;
        egui::Grid::new("matter").num_columns(2).show(ui, |ui| {
            ui.label("Engine");
            if let Some(name) = choose_engine(ui, by, engine) {
                let value = Value::from(name);
                edits.push(("solver", "engine", value));
            }
            ui.end_row();
            ui.label("Integrator");
            let schemes = INTEGRATORS.map(|(name, _)| (name, name));
            if let Some(name) = choice(ui, "scheme", &scheme, &scheme, &schemes) {
                edits.push(("solver", "name", Value::from(name)));
            }
            ui.end_row();
            if let Some((_, about)) = INTEGRATORS.iter().find(|(name, _)| *name == scheme) {
                ui.label("");
                ui.weak(*about);
                ui.end_row();
            }
            ui.label("Time step");
            if let Some(dt) = edited(ui, "dt", dt, (0.01..=1000.0, 0.1, " ms")) {
                edits.push(("solver", "dt", Value::from(1e-3 * dt)));
            }
            ui.end_row();
            ui.label("Tolerance");
            if let Some(tolerance) = edited(ui, "tolerance", tolerance, (1e-8..=0.3, 0.001, "")) {
                edits.push(("solver", "tolerance", Value::from(tolerance)));
            }
            ui.end_row();
            if motion
                .simulator
                .model()
                .is_some_and(|m| m.elements().is_some())
            {
                ui.label("Elements");
                let order = show.stage().mesh().order;
                if let Some(value) = choose_order(ui, scene.material.order, order) {
                    edits.push(("material", "order", value));
                }
                ui.end_row();
            }
            stiffer = young_rows(ui, &scene, &mut edits);
        });
        if let Some((name, young)) = stiffer {
            let what = format!("young of {name}");
            self.edit_body(&what, context, |t| set_stiffness(t, &name, young));
        }
        let gravity = scene.solver.gravity.unwrap_or([0.0; 3]);
        for (table, key, value) in edits {
            self.edit_body(key, context, |t| {
                if table == "solver" {
                    name_solver(t, (gravity, dt, tolerance));
                }
                set(t, table, key, Some(value));
            });
        }
    }
}

/// Draws the rows of Young's moduli, and adds the edit of that of the body. Returns the tissue whose
/// modulus changed, with the new one, Pa.
fn young_rows(ui: &mut egui::Ui, scene: &Scene, edits: &mut Vec<Edit>) -> Option<(String, f64)> {
    let range = || (0.01..=1e9, 0.1, " kPa");
    if let Some(young) = scene.material.young {
        ui.label("Young's modulus");
        if let Some(young) = edited(ui, "young", 1e-3 * young, range()) {
            edits.push(("material", "young", Value::from(1e3 * young)));
        }
        ui.end_row();
    }
    let mut changed = None;
    for (name, young) in stiffnesses(scene) {
        ui.label(format!("  of {name}"));
        let id = format!("young of {name}");
        if let Some(young) = edited(ui, &id, 1e-3 * young, range()) {
            changed = Some((name, 1e3 * young));
        }
        ui.end_row();
    }
    changed
}

/// Writes the settings of a solver to the text of a scene that names none: gravity, the step in ms
/// and the tolerance.
fn name_solver(text: &mut DocumentMut, (gravity, dt, tolerance): ([f64; 3], f64, f64)) {
    let solver = text.get("solver").and_then(Item::as_table_like);
    if solver.is_none_or(|s| s.get("name").is_none()) {
        set(text, "solver", "name", Some(Value::from("implicit")));
        set(text, "solver", "gravity", Some(numbers(gravity)));
        set(text, "solver", "dt", Some(Value::from(1e-3 * dt)));
        set(text, "solver", "tolerance", Some(Value::from(tolerance)));
    }
}

/// Draws the choice of the engine, of which `engine` runs. Returns the new choice, if it changed.
fn choose_engine(
    ui: &mut egui::Ui,
    asked: Option<EngineChoice>,
    engine: Engine,
) -> Option<&'static str> {
    let chosen = match asked {
        Some(EngineChoice::Exactly(engine)) => engine.to_string(),
        _ => "auto".to_owned(),
    };
    let called = ENGINES.iter().find(|(name, _)| *name == chosen);
    let called = match called {
        Some(("auto", called)) => format!("{called} ({engine})"),
        Some((_, called)) => (*called).to_owned(),
        None => chosen.clone(),
    };
    choice(ui, "engine", &called, &chosen, &ENGINES)
}

/// Draws the choice of the order of elements, of which `order` is simulated. Returns the new value, if
/// it changed.
fn choose_order(
    ui: &mut egui::Ui,
    asked: Option<OrderChoice>,
    order: ElementOrder,
) -> Option<Value> {
    let chosen = match asked {
        Some(OrderChoice::Auto) => "auto".to_owned(),
        Some(OrderChoice::Exactly(order)) => order.to_string(),
        None => ElementOrder::Linear.to_string(),
    };
    let name = |word: &str| {
        let found = ORDERS.iter().find(|(own, _)| *own == word);
        found.map_or("", |(_, called)| called)
    };
    let called = match asked {
        Some(OrderChoice::Auto) => format!("{} ({})", name("auto"), name(&order.to_string())),
        _ => name(&chosen).to_owned(),
    };
    let word = choice(ui, "order", &called, &chosen, &ORDERS)?;
    Some(
        word.parse::<i64>()
            .map_or_else(|_| word.into(), Value::from),
    )
}

/// Draws a combo box of words with display names. Returns the new choice, if it changed.
fn choice<'a>(
    ui: &mut egui::Ui,
    name: &str,
    called: &str,
    chosen: &str,
    all: &[(&'a str, &str)],
) -> Option<&'a str> {
    let mut picked = None;
    egui::ComboBox::from_id_salt(name)
        .selected_text(called)
        .show_ui(ui, |ui| {
            for (word, called) in all {
                if ui.selectable_label(*word == chosen, *called).clicked() && *word != chosen {
                    picked = Some(*word);
                }
            }
        });
    picked
}

/// Returns Young's modulus, Pa, of each tissue of the scene that is not rigid, if known.
fn stiffnesses(scene: &Scene) -> Vec<(String, f64)> {
    let of = |(name, young): (&str, Option<f64>)| {
        let published = TISSUES.iter().find(|t| t.name == name).map(|t| t.young);
        Some((name.to_owned(), young.or(published)?))
    };
    scene.material.soft_tissues().filter_map(of).collect()
}

/// Sets Young's modulus of a tissue, Pa; a list of its regions becomes a table.
fn set_stiffness(text: &mut DocumentMut, name: &str, young: f64) {
    let material = text.entry("material").or_insert(Item::Table(Table::new()));
    let Some(material) = material.as_table_like_mut() else {
        return;
    };
    let regions: Option<Array> = material.get(name).and_then(Item::as_array).cloned();
    if regions.is_some() || material.get(name).is_none() {
        material.insert(name, Item::Table(Table::new()));
    }
    let Some(tissue) = material.get_mut(name).and_then(Item::as_table_like_mut) else {
        return;
    };
    if let Some(regions) = regions {
        tissue.insert("regions", Item::Value(Value::Array(regions)));
    }
    tissue.insert("young", Item::Value(Value::from(young)));
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn stiffness_is_set_in_every_tissue_notation() {
        let text = "[material]\nyoung = 3e4\nfat = [\"fat\", 2]\nmuscle = { young = 1e4 }\n[material.skin]\nregions = [1]\n";
        let mut document: DocumentMut = text.parse().unwrap();
        let scene = |d: &DocumentMut| Scene::parse_in(&d.to_string(), Path::new("")).unwrap();
        let before = stiffnesses(&scene(&document));
        let names: Vec<&str> = before.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["fat", "muscle", "skin"]);
        for (name, _) in &before {
            set_stiffness(&mut document, name, 5e4);
        }
        let after = stiffnesses(&scene(&document));
        assert!(after.iter().all(|(_, young)| *young == 5e4), "{document}");
        assert!(
            document.to_string().contains("regions = [\"fat\", 2]"),
            "{document}"
        );
    }
}
