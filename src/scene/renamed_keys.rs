//! Old names of scene keys, which still work.

use super::Scene;
use serde::de::Visitor;
use serde::{Deserialize, Deserializer};
use std::convert::Infallible;
use std::fmt;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Error, ValueDeserializer};

/// An entry of a scene, the old name of one of its keys, and the current name. The entries of a
/// `[[body]]` have the same keys.
const RENAMED_KEYS: [(&str, &str, &str); 18] = [
    ("[mesh]", "part", "split"),
    ("[mesh]", "part_gap", "split_gap"),
    ("[material]", "contrast", "max_stiffness_ratio"),
    ("[floor]", "rate", "stiffness_rate"),
    ("[[grab]]", "spring", "spring_stiffness"),
    ("[[grab]]", "limit", "max_force"),
    ("[[grab]]", "release", "release_time"),
    ("[[move]]", "turn", "rotation"),
    ("[[move]]", "about", "pivot"),
    ("[[pressure]]", "pascal", "pressure"),
    ("[[pressure]]", "facing", "normal"),
    ("[[tool]]", "along", "orientation"),
    ("[[tool]]", "turn", "rotation"),
    ("[[tool]]", "spring", "spring_stiffness"),
    ("[[tool]]", "limit", "max_force"),
    ("[[skin]]", "wall", "cut_colour"),
    ("[xray]", "white", "white_level"),
    ("[picture]", "walk", "traversal"),
];

/// Parses the text of a scene, in which keys may have their old names; these are noted.
///
/// # Errors
/// An error with the line: a syntax error, an invalid entry, or a key under both of its names.
pub(super) fn parse(text: &str) -> Result<Scene, Error> {
    let mut root = DeTable::parse(text)?;
    let mut notes = Vec::new();
    let scene = rename(root.get_mut(), &mut notes)
        .and_then(|()| Scene::deserialize(toml::Deserializer::from(root)));
    match scene {
        Ok(scene) => Ok(Scene { notes, ..scene }),
        Err(mut error) => {
            error.set_input(Some(text));
            Err(error)
        }
    }
}

/// Gives all keys of a scene their current names.
fn rename(root: &mut DeTable, notes: &mut Vec<String>) -> Result<(), Error> {
    for (entry, old, new) in RENAMED_KEYS {
        let name = entry.trim_matches(['[', ']']);
        for table in tables(root, name) {
            rename_key(table, entry, (old, new), notes)?;
        }
        let of_body = entry.replace(name, &format!("body.{name}"));
        for body in tables(root, "body") {
            for table in tables(body, name) {
                rename_key(table, &of_body, (old, new), notes)?;
            }
        }
    }
    Ok(())
}

/// Returns the table of that name, or the tables of the array of that name.
fn tables<'a, 'i>(root: &'a mut DeTable<'i>, name: &str) -> Vec<&'a mut DeTable<'i>> {
    let values = match root.get_mut(name).map(Spanned::get_mut) {
        Some(DeValue::Table(table)) => return vec![table],
        Some(DeValue::Array(values)) => values,
        _ => return Vec::new(),
    };
    let tables = values.iter_mut().filter_map(|value| match value.get_mut() {
        DeValue::Table(table) => Some(table),
        _ => None,
    });
    tables.collect()
}

/// Renames a key of a table of `entry`, and notes it once.
fn rename_key(
    table: &mut DeTable,
    entry: &str,
    (old, new): (&'static str, &'static str),
    notes: &mut Vec<String>,
) -> Result<(), Error> {
    let Some((key, value)) = table.remove_entry(old) else {
        return Ok(());
    };
    if table.contains_key(new) {
        let message = format!("{entry} has both `{new}` and its old name `{old}`; remove `{old}`");
        return Err(error_at(key.span(), message));
    }
    table.insert(Spanned::new(key.span(), new.into()), value);
    let note = format!("{entry} `{old}` is now `{new}`; the old key still works");
    if !notes.contains(&note) {
        notes.push(note);
    }
    Ok(())
}

/// Returns an error at this position of the text. TOML errors get a position only while a value is
/// deserialised, so this deserialises one.
fn error_at(position: Range<usize>, message: String) -> Error {
    struct Failure(String);

    impl Visitor<'_> for Failure {
        type Value = Infallible;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("nothing")
        }

        fn visit_str<E: serde::de::Error>(self, _: &str) -> Result<Infallible, E> {
            Err(E::custom(self.0))
        }
    }

    let value = Spanned::new(position, DeValue::String("".into()));
    match ValueDeserializer::from(value).deserialize_any(Failure(message)) {
        Ok(never) => match never {},
        Err(error) => error,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::scene::scene_hash;

    /// Returns a valid value of a key, by its old name.
    fn value(old: &str) -> &'static str {
        match old {
            "part" => "[[\"a\", \"b\"]]",
            "turn" => "[[0.0, 0.0], [1.0, 30.0]]",
            "about" | "facing" | "along" | "wall" => "[0.0, 0.5, 1.0]",
            "walk" => "\"planes\"",
            _ => "5.0",
        }
    }

    /// Returns a scene with an entry that has this key.
    fn with_key(entry: &str, key: &str, value: &str) -> String {
        let required = match entry {
            "[[grab]]" => "at = [0, 0, 0]\nradius = 1.0\npath = [[0.0, 0, 0, 0]]",
            "[[move]]" => "on = { axis = \"z\", below = 0.1 }",
            "[[pressure]]" if !["pascal", "pressure"].contains(&key) => "pressure = 1.0",
            "[[tool]]" => "at = [0, 0, 0]",
            "[[skin]]" => "file = \"skin.obj\"",
            "[floor]" => "point = [0, 0, 0]",
            _ => "",
        };
        format!("{entry}\n{required}\n{key} = {value}\n")
    }

    #[test]
    fn old_key_gives_the_same_scene_and_a_note() {
        for (entry, old, new) in RENAMED_KEYS {
            let value = value(old);
            let by_old = Scene::parse(&with_key(entry, old, value)).unwrap();
            let by_new = Scene::parse(&with_key(entry, new, value)).unwrap();
            let note = format!("{entry} `{old}` is now `{new}`; the old key still works");
            assert_eq!(by_old.notes(), [note]);
            assert!(by_new.notes().is_empty(), "{entry} {new}");
            assert_eq!(scene_hash(&by_old), scene_hash(&by_new), "{entry} {old}");
            // The hash depends on the key.
            let other = value.replace('5', "6").replace("30", "40");
            let other = other.replace("planes", "vertices").replace('a', "c");
            if let Ok(other) = Scene::parse(&with_key(entry, new, &other)) {
                assert_ne!(scene_hash(&by_new), scene_hash(&other), "{entry} {new}");
            }
        }
    }

    #[test]
    fn key_under_both_names_is_rejected_with_its_line() {
        for (entry, old, new) in RENAMED_KEYS {
            let value = value(old);
            let text = format!("{}{old} = {value}\n", with_key(entry, new, value));
            let error = Scene::parse(&text).unwrap_err().to_string();
            let words = ["TOML parse error at line ", entry, "has both", old, new];
            assert!(words.iter().all(|w| error.contains(w)), "{error}");
        }
    }

    #[test]
    fn old_keys_of_several_entries_and_bodies_are_noted_once() {
        let tool = "[[tool]]\nat = [0, 0, 0]\nalong = [1, 0, 0]\n";
        let body = "[[body]]\nmesh = { generate = \"box\", part_gap = 1.0 }\n";
        let scene = Scene::parse(&format!("{tool}{tool}{body}{body}")).unwrap();
        let renamed = ["[body.mesh] `part_gap`", "[[tool]] `along`"];
        assert_eq!(scene.notes().len(), renamed.len(), "{:?}", scene.notes());
        for (note, start) in scene.notes().iter().zip(renamed) {
            assert!(note.starts_with(start), "{note}");
        }
        assert_eq!(scene.body[1].mesh.split_gap, Some(1.0));
        assert_eq!(scene.tool[1].orientation, Some([1.0, 0.0, 0.0]));
    }
}
