//! Attributes of nodes and cells in legacy VTK files. An unreadable one is left out, with a note.

use super::cursor::{ParseResult, integer, number};
use super::vtk_legacy::{File, Owner};
use super::vtk_legacy_names::decoded;
use crate::mesh::{Field, ScalarType};

/// Values and the type that they are stored in.
type TypedValues = (Vec<f64>, ScalarType);

/// Keywords of attributes with a name, besides FIELD.
const ATTRIBUTES: [&str; 11] = [
    "SCALARS",
    "COLOR_SCALARS",
    "LOOKUP_TABLE",
    "VECTORS",
    "NORMALS",
    "TENSORS",
    "TENSORS6",
    "TEXTURE_COORDINATES",
    "GLOBAL_IDS",
    "PEDIGREE_IDS",
    "EDGE_FLAGS",
];
/// Other keywords that can follow an attribute.
const SECTIONS: [&str; 6] = [
    "FIELD",
    "POINT_DATA",
    "CELL_DATA",
    "CELLS",
    "CELL_TYPES",
    "METADATA",
];

/// Whether a line starts with a keyword that can follow an attribute. The line `LOOKUP_TABLE NAME`
/// belongs to the attribute before it; with a number, it is an attribute.
fn starts_with_keyword(line: &[u8]) -> bool {
    let mut words = line.split(u8::is_ascii_whitespace);
    let word = String::from_utf8_lossy(words.next().unwrap_or_default()).to_ascii_uppercase();
    if word == "LOOKUP_TABLE" {
        return words.nth(1).is_some_and(|count| integer(count).is_some());
    }
    ATTRIBUTES.contains(&word.as_str()) || SECTIONS.contains(&word.as_str())
}

/// Whether a line is the header of an array of a FIELD: name, components, tuples, type.
fn is_array_header(line: &[u8]) -> bool {
    let words = line.split(u8::is_ascii_whitespace);
    let words: Vec<&[u8]> = words.filter(|word| !word.is_empty()).collect();
    match words[..] {
        [_, components, tuples, kind] => {
            integer(components).is_some() && integer(tuples).is_some() && number(kind).is_none()
        }
        _ => false,
    }
}

impl File<'_> {
    /// Reads the attribute `keyword`; one that cannot be read is left out, with a note.
    pub fn attribute_or_note(&mut self, keyword: &str) -> ParseResult<()> {
        let start = self.from.at.position();
        self.from.bad_token = false;
        let is_value = number(keyword.as_bytes()).is_some();
        self.kept &= is_value;
        let Err(e) = self.attribute(keyword) else {
            return Ok(());
        };
        if self.from.ascii && is_value && self.owner.is_some() {
            // Values after the last array, whose number of values is thus wrong.
            self.from.bad_token = true;
            let last = self.mesh.fields.pop_if(|_| self.kept);
            self.kept = false;
            let Some(Field { name: last, .. }) = last else {
                // Noted already.
                return self.skip_lines(start, e);
            };
            return self.skip_array(&last, start, "more values than announced".into());
        }
        if keyword != "FIELD" && !ATTRIBUTES.contains(&keyword) && !self.is_miscounted() {
            return Err(e);
        }
        self.from.at.go_to(start);
        let name = self.from.at.peek().unwrap_or_default();
        let name = decoded(&String::from_utf8_lossy(name));
        self.skip_array(&name, start, e)
    }

    /// Whether the number of tuples of this section is not that of its items.
    fn is_miscounted(&self) -> bool {
        self.owner.is_some_and(|owner| owner.tuples != owner.items)
    }

    fn at_keyword(&self) -> bool {
        {
            let rest = self.from.at.rest().trim_ascii_start();
            let line = rest.split(|b| *b == b'\n').next();
            starts_with_keyword(line.unwrap_or_default())
        }
    }

    /// Notes that the array `name` cannot be read, and moves from `start`, within the line of its
    /// header, to what follows. Fails with `why` in a truncated file, and in a binary file, where
    /// the end of the array is unknown.
    fn skip_array(&mut self, name: &str, start: usize, why: String) -> ParseResult<()> {
        let note = format!("array \"{name}\" skipped: {why}");
        self.skip_lines(start, why)?;
        self.mesh.warnings.push(note);
        Ok(())
    }

    /// Moves from `start`, within a line of an array, to what follows the array, or fails as
    /// [`File::skip_array`].
    fn skip_lines(&mut self, start: usize, why: String) -> ParseResult<()> {
        if !self.from.ascii && !self.is_miscounted() {
            return Err(why);
        }
        let miscounted = self.is_miscounted();
        let at = &mut self.from.at;
        at.go_to(start);
        at.rest_of_line();
        loop {
            let here = at.position();
            if at.rest().trim_ascii().is_empty() {
                if !self.from.bad_token && !miscounted {
                    return Err(why);
                }
                break;
            }
            let line = at.rest_of_line().trim_ascii_start();
            if starts_with_keyword(line) || is_array_header(line) {
                at.go_to(here);
                break;
            }
        }
        Ok(())
    }

    /// Reads SCALARS, VECTORS, FIELD and similar attributes.
    fn attribute(&mut self, keyword: &str) -> ParseResult<()> {
        if keyword == "FIELD" {
            return self.field_arrays();
        }
        if !ATTRIBUTES.contains(&keyword) {
            let shown: String = keyword.chars().take(40).collect();
            return Err(self.from.at.error(format_args!(
                "expected POINTS, CELLS, CELL_TYPES, POINT_DATA, CELL_DATA, FIELD or the name of an attribute, found {shown:?}"
            )));
        }
        let name = decoded(self.from.at.word(format_args!("the name of {keyword}"))?);
        if keyword == "LOOKUP_TABLE" {
            let rows = self
                .from
                .at
                .count(format_args!("the size of LOOKUP_TABLE {name}"), 4)?;
            return self.from.colours(rows, 4, &name).map(|_| ());
        }
        let Some(Owner { tuples, .. }) = self.owner else {
            return Err(self.from.at.error(format_args!(
                "{keyword} {name} must follow POINT_DATA or CELL_DATA"
            )));
        };
        let (components, values) = match keyword {
            "COLOR_SCALARS" => {
                let components = self
                    .from
                    .components(format_args!("components of COLOR_SCALARS {name}"))?;
                (
                    components,
                    Some(self.from.colours(tuples, components, &name)?),
                )
            }
            "SCALARS" => self.scalars(tuples, &name)?,
            _ => {
                let components = match keyword {
                    "VECTORS" | "NORMALS" => 3,
                    "TENSORS" => 9,
                    "TENSORS6" => 6,
                    "TEXTURE_COORDINATES" => self
                        .from
                        .components(format_args!("dimensions of TEXTURE_COORDINATES {name}"))?,
                    _ => 1,
                };
                let kind = self.from.type_name(&name)?;
                (
                    components,
                    self.from.values(tuples, components, &kind, &name)?,
                )
            }
        };
        self.keep(name, tuples, components, values);
        Ok(())
    }

    /// Reads the components and values of SCALARS.
    fn scalars(&mut self, tuples: usize, name: &str) -> ParseResult<(usize, Option<TypedValues>)> {
        let kind = self
            .from
            .at
            .word(format_args!("the type of SCALARS {name}"))?
            .to_string();
        let given = String::from_utf8_lossy(self.from.at.rest_of_line())
            .trim()
            .to_string();
        let components = if given.is_empty() {
            Ok(1)
        } else {
            given.parse()
        };
        let components: usize = components
            .ok()
            .filter(|c| (1..=1 << 16).contains(c))
            .ok_or_else(|| {
                self.from.at.error(format_args!(
                    "SCALARS {name}: number of components must be 1 to 65536, got \
                    {given:?}"
                ))
            })?;
        self.from.skip_table_name();
        let values = self.from.values(tuples, components, &kind, name)?;
        Ok((components, values))
    }

    /// Reads FIELD name n: n arrays, each with its own name, width, length and type.
    fn field_arrays(&mut self) -> ParseResult<()> {
        self.from.at.word(format_args!("the name of FIELD"))?;
        let arrays = self
            .from
            .at
            .count(format_args!("the number of arrays in FIELD"), 1)?;
        for array in 0..arrays {
            let mut name = self
                .from
                .at
                .word(format_args!("the name of array {array} of FIELD"))?;
            while name == "METADATA" {
                self.from.skip_metadata();
                name = self
                    .from
                    .at
                    .word(format_args!("the name of array {array} of FIELD"))?;
            }
            if name == "NULL_ARRAY" {
                continue;
            }
            let name = decoded(name);
            let header = self.from.at.position();
            if let Err(e) = self.field_array(&name) {
                self.skip_array(&name, header, e)?;
                if self.at_keyword() {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Reads the array `name` of a FIELD.
    fn field_array(&mut self, name: &str) -> ParseResult<()> {
        let components = self
            .from
            .components(format_args!("components of array {name}"))?;
        let tuples = self
            .from
            .at
            .count(format_args!("tuples of array {name}"), 0)?;
        let kind = self.from.type_name(name)?;
        let values = self.from.values(tuples, components, &kind, name)?;
        match self.owner {
            Some(_) => self.keep(name.to_owned(), tuples, components, values),
            // An array of the whole mesh.
            None => {
                if let Some((values, _)) = values {
                    self.global.array(name, &values);
                }
            }
        }
        Ok(())
    }

    /// Keeps an array of the items of a section, if it has a tuple for each.
    fn keep(
        &mut self,
        name: String,
        tuples: usize,
        components: usize,
        values: Option<(Vec<f64>, ScalarType)>,
    ) {
        let Some(Owner {
            location, items, ..
        }) = self.owner
        else {
            return;
        };
        self.kept = false;
        let why = match values {
            Some((values, scalar_type)) if tuples == items => {
                self.kept = true;
                self.mesh.fields.push(Field {
                    name,
                    location,
                    components,
                    values,
                    scalar_type,
                });
                return;
            }
            Some(_) => format!("it has {tuples} tuples, but there are {items} {location}"),
            None => "it is not numeric".into(),
        };
        self.mesh
            .warnings
            .push(format!("array \"{name}\" skipped: {why}"));
    }
}
