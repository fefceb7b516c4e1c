//! The JSON Schema of scene files: types of entries that are read by hand, and its plain form.

use super::Scene;
use super::keywords::{BACKGROUNDS, DAMPING_KINDS, MODES, TRAVERSALS};
use crate::generate::GENERATORS;
use crate::physics::{MaterialModel, SolverKind, VolumetricFormulation};
use crate::render::TransferFunction;
use schemars::generate::SchemaSettings;
use schemars::{Schema, SchemaGenerator, json_schema};
use serde_json::{Map, Value, json};

impl Scene {
    /// Returns the JSON Schema (draft 7) of scene files. A unit stands under `x-unit`, a range in
    /// words under `x-range`.
    pub fn schema() -> Value {
        let generator = SchemaSettings::draft07().into_generator();
        let mut schema = generator.into_root_schema_for::<Scene>().to_value();
        plain(&mut schema);
        if let Value::Object(root) = &mut schema {
            root.insert("title".into(), "Palpate scene".into());
        }
        schema
    }
}

/// Removes what a TOML file has no use for: null, the widths of numbers, and links between Rust
/// items in descriptions.
fn plain(schema: &mut Value) {
    match schema {
        Value::Object(object) => {
            object.remove("format");
            object.retain(|key, value| key != "default" || !is_empty(value));
            if let Some(Value::Array(types)) = object.get_mut("type") {
                types.retain(|name| name != "null");
                if let [one] = types.as_slice() {
                    let one = one.clone();
                    object.insert("type".into(), one);
                }
            }
            if let Some(Value::Array(choices)) = object.get_mut("anyOf") {
                choices.retain(|choice| choice != &json!({"type": "null"}));
                if let [one] = choices.as_slice() {
                    let one = one.clone();
                    object.remove("anyOf");
                    object.insert("allOf".into(), json!([one]));
                }
            }
            if let Some(Value::String(text)) = object.get_mut("description") {
                *text = without_links(text);
            }
            object.values_mut().for_each(plain);
        }
        Value::Array(values) => values.iter_mut().for_each(plain),
        _ => {}
    }
}

fn is_empty(value: &Value) -> bool {
    value.is_null() || value.as_array().is_some_and(Vec::is_empty)
}

/// Replaces ``[`Name`](path)`` by `` `Name` ``: the paths of Rust items lead nowhere outside of
/// their documentation.
fn without_links(text: &str) -> String {
    let mut plain = String::new();
    let mut rest = text;
    while let Some(end) = rest.find("](") {
        let (before, after) = rest.split_at(end);
        match (before.rfind('['), after.find(')')) {
            (Some(start), Some(close)) => {
                plain += &before[..start];
                plain += &before[start + 1..];
                rest = &after[close + 1..];
            }
            _ => break,
        }
    }
    plain += rest;
    plain.replace("[`", "`").replace("`]", "`")
}

fn words<'a>(words: impl IntoIterator<Item = &'a str>) -> Schema {
    let words: Vec<&str> = words.into_iter().collect();
    json_schema!({"type": "string", "enum": words})
}

/// Text that may be one of these words, which editors then offer.
fn words_or_text<'a>(words: impl IntoIterator<Item = &'a str>) -> Schema {
    let words: Vec<&str> = words.into_iter().collect();
    json_schema!({"anyOf": [{"type": "string", "enum": words}, {"type": "string"}]})
}

pub(super) fn mode(_: &mut SchemaGenerator) -> Schema {
    words(MODES)
}

pub(super) fn traversal(_: &mut SchemaGenerator) -> Schema {
    words(TRAVERSALS)
}

pub(super) fn background(_: &mut SchemaGenerator) -> Schema {
    words(BACKGROUNDS)
}

pub(super) fn damping_kind(_: &mut SchemaGenerator) -> Schema {
    words(DAMPING_KINDS)
}

pub(super) fn generator(_: &mut SchemaGenerator) -> Schema {
    words(GENERATORS.iter().map(|generator| generator.0))
}

pub(super) fn solver(_: &mut SchemaGenerator) -> Schema {
    let all = SolverKind::ALL.into_iter().chain(SolverKind::ELEMENT_ONLY);
    words(all.map(SolverKind::name))
}

pub(super) fn engine(_: &mut SchemaGenerator) -> Schema {
    words(["auto", "gpu", "cpu", "rapier"])
}

pub(super) fn material_model(_: &mut SchemaGenerator) -> Schema {
    words(MaterialModel::ALL.map(MaterialModel::name))
}

pub(super) fn volume(_: &mut SchemaGenerator) -> Schema {
    words(VolumetricFormulation::ALL.map(VolumetricFormulation::name))
}

pub(super) fn order(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"enum": [1, 2, "1", "2", "auto"]})
}

pub(super) fn cage_kind(_: &mut SchemaGenerator) -> Schema {
    words(["lattice", "grid"])
}

pub(super) fn mapping(_: &mut SchemaGenerator) -> Schema {
    words([
        "one-to-one",
        "constant",
        "interpolated",
        "normal-only",
        "auto",
    ])
}

pub(super) fn frame(_: &mut SchemaGenerator) -> Schema {
    words_or_text(["ras", "lps"])
}

pub(super) fn transfer(_: &mut SchemaGenerator) -> Schema {
    words_or_text(TransferFunction::preset_names())
}

pub(super) fn preset(generator: &mut SchemaGenerator) -> Schema {
    transfer(generator)
}

pub(super) fn text(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"type": "string"})
}

pub(super) fn light(_: &mut SchemaGenerator) -> Schema {
    let direction = vector(3);
    json_schema!({"anyOf": [words_or_text(["head", "none"]), direction]})
}

pub(super) fn axes(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"enum": [true, false, "xyz", "anatomical"]})
}

pub(super) fn unit(_: &mut SchemaGenerator) -> Schema {
    let metres = json!({"type": "number", "exclusiveMinimum": 0});
    json_schema!({"anyOf": [words_or_text(["m", "cm", "mm", "um", "in"]), metres]})
}

pub(super) fn length(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"anyOf": [
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "string", "pattern": "^\\s*[0-9]"},
    ]})
}

pub(super) fn percentage(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"type": "string", "pattern": "^\\s*[0-9.eE+-]+\\s*%\\s*$"})
}

pub(super) fn thresholds(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"type": "array", "items": {"type": ["number", "string"]}})
}

pub(super) fn fraction(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"type": "number"})
}

/// One table `[scan]`, or several `[[scan]]`.
pub(super) fn scans(generator: &mut SchemaGenerator) -> Schema {
    let one = generator.subschema_for::<super::ScanEntry>();
    let most = crate::render::MAX_SCANS;
    json_schema!({"anyOf": [one, {"type": "array", "items": one, "maxItems": most}]})
}

fn vector(length: usize) -> Value {
    let items = Map::from_iter([("type".to_owned(), json!("number"))]);
    json!({"type": "array", "items": items, "minItems": length, "maxItems": length})
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rust_links_become_plain_words() {
        let text = "as [`Muscle`](crate::physics::Muscle), in [0, 1], of [`Axes`] (see it)";
        assert_eq!(
            without_links(text),
            "as `Muscle`, in [0, 1], of `Axes` (see it)"
        );
    }

    #[test]
    fn every_key_of_a_scene_is_described_once() {
        let schema = Scene::schema();
        let tables = schema["definitions"].as_object();
        let tables = tables
            .into_iter()
            .flatten()
            .map(|(name, table)| (name.as_str(), table));
        let mut keys = 0;
        for (name, table) in tables.chain([("Scene", &schema)]) {
            for (key, entry) in table["properties"].as_object().into_iter().flatten() {
                let text = entry["description"].as_str().unwrap_or_default();
                assert!(!text.is_empty(), "{name}.{key} has no description");
                assert!(!text.contains("crate::"), "{name}.{key}: {text}");
                keys += 1;
            }
        }
        assert!(keys > 200, "{keys} keys");
    }
}
