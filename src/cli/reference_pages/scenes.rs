//! Pages of the tables of a scene file, from its JSON Schema.

use super::GENERATED;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// Returns a page for each table of a scene, and one that lists them.
pub fn of_scenes(schema: &Value) -> Vec<(String, String)> {
    let reference = Reference::new(schema);
    let mut index = format!(
        "# Scene files\n\n{GENERATED}\n{INTRODUCTION}\n| table | contents |\n| --- | --- |\n"
    );
    let mut pages = Vec::new();
    for (name, entry) in properties(schema) {
        let heading = reference.heading(name, entry);
        let text = first_sentence(description(entry));
        index += &format!("| [`{heading}`]({name}.md) | {text} |\n");
        pages.extend(reference.pages(name, entry));
    }
    pages.insert(0, ("scene/index.md".to_owned(), index));
    pages
}

const INTRODUCTION: &str = "\
A scene is a TOML file that describes everything: mesh or generator, material by tissue, pins, forces,
tools, camera and picture. Only the mesh is required. An error names the line and column.

```toml
#:schema scene.schema.json
[mesh]
file = \"liver.vtu\"      # in the folder of the scene; or generate = \"limb\", tets = 100000
unit = \"mm\"             # length unit of the mesh, needed for physics

[material]
young = 2e4             # Pa
bone = [\"femur\", 6]     # regions of a tissue, by name or label: published values

[solver]
name = \"implicit\"
dt = 0.01               # s
steps = 100

[[pin]]                 # fixed nodes
axis = \"z\"
below = 0.05            # the lowest 5 % of the bounds

[[force]]
on = { axis = \"z\", above = 0.95 }
total = [0.0, -2.0, 0.0]  # N, distributed over the region

[picture]
field = \"intensity\"
size = [1024, 768]
```

## Completion and errors in an editor

`palpate schema` prints the [JSON Schema](../scene.schema.json) of scenes. Editors with a TOML language
server (Taplo; in Visual Studio Code *Even Better TOML*) complete keys, show their meaning and mark
errors, if the first line of the scene names the schema:

    palpate schema > scene.schema.json

```toml
#:schema scene.schema.json
```

## Tables

Each key has its type, unit, default, range and an example. `[[name]]` may be given several times.
";

/// The definitions of a schema, and the page of each.
struct Reference<'a> {
    definitions: &'a Map<String, Value>,
    /// Page and heading of the definitions of tables.
    places: BTreeMap<&'a str, (&'a str, String)>,
}

impl<'a> Reference<'a> {
    fn new(schema: &'a Value) -> Reference<'a> {
        static NONE: std::sync::LazyLock<Map<String, Value>> = std::sync::LazyLock::new(Map::new);
        let definitions = schema["definitions"].as_object().unwrap_or(&NONE);
        let places = BTreeMap::new();
        let mut reference = Reference {
            definitions,
            places,
        };
        for (name, entry) in properties(schema) {
            if let Some(table) = reference.table(entry) {
                let heading = reference.heading(name, entry);
                let first = !reference.places.contains_key(table);
                // Pins are the page of the regions of nodes, wherever else these occur.
                if first || name == "pin" {
                    reference.places.insert(table, (name, heading));
                }
            }
        }
        for (name, entry) in properties(schema) {
            let (table, name) = (reference.table(entry), name.as_str());
            let nested = table
                .map(|table| reference.nested(table))
                .unwrap_or_default();
            for (key, table) in nested {
                reference.places.entry(table).or_insert((name, key));
            }
        }
        reference
    }

    /// The table that an entry or its items consist of.
    fn table(&self, entry: &'a Value) -> Option<&'a str> {
        if let Some(name) = reference_name(entry) {
            let definition = &self.definitions[name];
            return match definition.get("properties") {
                Some(_) => Some(name),
                None => self.table(definition),
            };
        }
        let parts = ["allOf", "anyOf"]
            .iter()
            .filter_map(|key| entry[*key].as_array());
        let parts = parts.flatten().chain(entry.get("items"));
        let parts = parts.chain(entry.get("additionalProperties"));
        parts
            .filter(|part| part.is_object())
            .find_map(|part| self.table(part))
    }

    /// The tables within a table, with their keys, deepest last.
    fn nested(&self, table: &'a str) -> Vec<(String, &'a str)> {
        let mut found = Vec::new();
        let definition = &self.definitions[table];
        let more = definition
            .get("additionalProperties")
            .filter(|more| more.is_object());
        let keys = properties(definition).map(|(key, entry)| (key.clone(), entry));
        for (key, entry) in keys.chain(more.map(|more| ("NAME".to_owned(), more))) {
            if let Some(inner) = self.table(entry).filter(|inner| *inner != table) {
                found.push((key, inner));
            }
        }
        found
    }

    /// `[mesh]`, or `[[pin]]` for a list.
    fn heading(&self, name: &str, entry: &Value) -> String {
        let choices = entry["anyOf"].as_array().into_iter().flatten();
        let several = entry["type"] == "array" || choices.clone().any(|c| c["type"] == "array");
        match several {
            true => format!("[[{name}]]"),
            false => format!("[{name}]"),
        }
    }

    /// The pages of a table: its keys, and a page for each table in it that no other page has.
    fn pages(&self, name: &str, entry: &'a Value) -> Vec<(String, String)> {
        let heading = self.heading(name, entry);
        let table = self.table(entry);
        let text = table.map_or("", |table| description(&self.definitions[table]));
        let mut begin = String::new();
        // The table of a region is that of pins, whose own text says what they do.
        let own = description(entry);
        if !text.starts_with(own) {
            begin += &format!("{own}\n\n");
        }
        begin += &format!("{text}\n");
        let Some(table) = table else {
            return short_pages(name, &heading, &begin, Vec::new());
        };
        let mut pages = short_pages(name, &heading, &begin, self.keys(table, ""));
        for (key, inner) in self.nested(table) {
            let place = self.places.get(inner);
            if place.is_some_and(|place| place.0 == name && place.1 == key) {
                let heading = format!("{heading}, keys of {key}");
                let text = format!("{}\n", description(&self.definitions[inner]));
                let keys = self.keys(inner, &format!("{key}."));
                let name = nested_page(name, &key);
                pages.extend(short_pages(&name, &heading, &text, keys));
            }
        }
        pages
    }

    /// Returns a section for each key of a table, required ones first.
    fn keys(&self, table: &str, prefix: &str) -> Vec<String> {
        let definition = &self.definitions[table];
        let required = |key: &str| {
            let keys = definition["required"].as_array().into_iter().flatten();
            keys.clone().any(|one| one == key)
        };
        let mut keys: Vec<_> = properties(definition).collect();
        keys.sort_by_key(|(key, _)| !required(key));
        if keys.is_empty() {
            return vec!["\nIt has no keys: `{}`.\n".to_owned()];
        }
        let section = |(key, entry): (&String, &Value)| {
            let mut facts = vec![self.kind(entry)];
            let text = |name: &str| entry.get(name).and_then(Value::as_str);
            facts.extend(text("x-unit").map(|unit| format!("unit: {unit}")));
            facts.extend(range(entry));
            facts.extend(
                entry
                    .get("default")
                    .map(|v| format!("default `{}`", toml(v))),
            );
            if required(key) {
                facts.push("required".to_owned());
            }
            let facts = facts.join(" · ");
            let about = description(entry);
            let mut section = format!("\n### `{prefix}{key}`\n\n*{facts}*\n\n{about}\n");
            let examples = entry["examples"].as_array().into_iter().flatten();
            let examples: Vec<String> =
                examples.map(|v| format!("`{key} = {}`", toml(v))).collect();
            if !examples.is_empty() {
                section += &format!("\nExample: {}\n", examples.join(", or "));
            }
            section
        };
        keys.into_iter().map(section).collect()
    }

    /// The type of an entry in words.
    fn kind(&self, entry: &Value) -> String {
        if let Some(name) = reference_name(entry) {
            return match self.places.get(name) {
                Some((page, heading)) if heading.starts_with('[') => {
                    format!("table as in [`{heading}`]({page}.md)")
                }
                Some((page, key)) => format!("[table]({}.md)", nested_page(page, key)),
                None => self.kind(&self.definitions[name]),
            };
        }
        for key in ["anyOf", "oneOf", "allOf"] {
            if let Some(parts) = entry[key].as_array() {
                let mut kinds: Vec<String> = Vec::new();
                for part in parts {
                    let kind = self.kind(part);
                    if !kinds.contains(&kind) {
                        kinds.push(kind);
                    }
                }
                return kinds.join(", or ");
            }
        }
        if let Some(words) = entry["enum"].as_array() {
            let words: Vec<String> = words
                .iter()
                .map(|word| format!("`{}`", toml(word)))
                .collect();
            return match words.len() > 12 {
                true => format!("{}, … ({} in all)", words[..4].join(", "), words.len()),
                false => words.join(", "),
            };
        }
        if let Some(word) = entry.get("const") {
            return format!("`{}`", toml(word));
        }
        let kind = |name: &str| match name {
            "string" => "text".to_owned(),
            "boolean" => "true or false".to_owned(),
            "array" => self.list(entry),
            "object" => match entry.get("additionalProperties").filter(|v| v.is_object()) {
                Some(inner) => format!("by name: {}", self.kind(inner)),
                None => "table".to_owned(),
            },
            name => name.to_owned(),
        };
        match &entry["type"] {
            Value::String(name) => kind(name),
            Value::Array(names) => {
                let names: Vec<String> = names.iter().filter_map(Value::as_str).map(kind).collect();
                names.join(" or ")
            }
            _ => "any value".to_owned(),
        }
    }

    fn list(&self, entry: &Value) -> String {
        let item = self.kind(&entry["items"]);
        match (entry["minItems"].as_u64(), entry["maxItems"].as_u64()) {
            (Some(least), Some(most)) if least == most => match item.as_str() {
                "number" => format!("list of {most} numbers"),
                _ => format!("list of {most}: {item}"),
            },
            (_, Some(most)) => format!("list of up to {most}: {item}"),
            _ => format!("list of: {item}"),
        }
    }
}

/// Longest page.
const MOST_LINES: usize = 150;

/// The name of the page of a table within another.
fn nested_page(page: &str, key: &str) -> String {
    format!("{page}-{}", key.to_lowercase())
}

/// Divides sections among pages of at most 150 lines, each with a link to the next.
fn short_pages(
    name: &str,
    heading: &str,
    begin: &str,
    sections: Vec<String>,
) -> Vec<(String, String)> {
    let mut pages = vec![format!("# {heading}\n\n{GENERATED}\n{begin}")];
    for section in sections {
        let number = pages.len();
        if let Some(page) = pages.last_mut() {
            // The link takes two lines.
            if page.lines().count() + section.lines().count() + 2 > MOST_LINES {
                *page += &format!("\n[More keys]({name}-{}.md)\n", number + 1);
                pages.push(format!("# {heading}, more keys\n\n{GENERATED}\n"));
            }
        }
        if let Some(page) = pages.last_mut() {
            *page += &section;
        }
    }
    let file = |number: usize| match number {
        0 => format!("scene/{name}.md"),
        n => format!("scene/{name}-{}.md", n + 1),
    };
    let numbered = pages.into_iter().enumerate();
    numbered.map(|(n, page)| (file(n), page)).collect()
}

fn properties(table: &Value) -> impl Iterator<Item = (&String, &Value)> {
    table["properties"].as_object().into_iter().flatten()
}

fn description(entry: &Value) -> &str {
    entry["description"].as_str().unwrap_or_default()
}

/// The definition that an entry is, by itself or as the only part of it.
fn reference_name(entry: &Value) -> Option<&str> {
    let only = entry["allOf"].as_array().filter(|parts| parts.len() == 1);
    let target = entry
        .get("$ref")
        .or_else(|| only.and_then(|parts| parts[0].get("$ref")));
    target?.as_str()?.strip_prefix("#/definitions/")
}

fn first_sentence(text: &str) -> String {
    let text = text
        .split("\n\n")
        .next()
        .unwrap_or_default()
        .replace('\n', " ");
    match text.split_once(". ") {
        Some((first, _)) => format!("{first}."),
        None => text,
    }
}

fn range(entry: &Value) -> Option<String> {
    if let Some(range) = entry.get("x-range").and_then(Value::as_str) {
        return Some(format!("range: {range}"));
    }
    let bound = |key: &str| entry.get(key).filter(|v| v.is_number()).map(toml);
    let least = bound("minimum").map(|v| format!("≥ {v}"));
    let above = bound("exclusiveMinimum").map(|v| format!("> {v}"));
    let most = bound("maximum").map(|v| format!("≤ {v}"));
    let below = bound("exclusiveMaximum").map(|v| format!("< {v}"));
    let all: Vec<String> = [least.or(above), most.or(below)]
        .into_iter()
        .flatten()
        .collect();
    (!all.is_empty()).then(|| all.join(" and "))
}

/// A value as it stands in a scene.
fn toml(value: &Value) -> String {
    match value {
        Value::Array(values) => {
            let values: Vec<String> = values.iter().map(toml).collect();
            format!("[{}]", values.join(", "))
        }
        value => value.to_string(),
    }
}
