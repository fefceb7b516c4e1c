//! Reader for VTK's legacy format: unstructured grids of versions 2 to 5, ASCII and binary.
//!
//! The `vtkio` crate (0.6.3) was tried on real files and on what VTK 9 writes: it rejects
//! version 5 (`OFFSETS`/`CONNECTIVITY`) and arrays with 64-bit types, so this reader is our own.

use super::cells::{RawMesh, index};
use super::cursor::{Cursor, Parse};
use super::scalar;
use crate::mesh::{Field, Location, ScalarType};
use glam::DVec3;

/// The first bytes of every file of this format.
pub(super) const MAGIC: &[u8] = b"# vtk DataFile";

/// Reads the content of a legacy VTK file.
pub(super) fn read(bytes: &[u8]) -> Parse<RawMesh> {
    let mut file = File::open(bytes)?;
    while let Some(token) = file.at.token() {
        let keyword = String::from_utf8_lossy(token).to_ascii_uppercase();
        match keyword.as_str() {
            "POINTS" => file.points()?,
            "CELLS" => file.cells()?,
            "CELL_TYPES" => file.cell_types()?,
            "POINT_DATA" => file.data_of(Location::Node)?,
            "CELL_DATA" => file.data_of(Location::Cell)?,
            "METADATA" => file.skip_metadata(),
            _ => file.attribute(&keyword)?,
        }
    }
    file.finish()
}

struct File<'a> {
    at: Cursor<'a>,
    ascii: bool,
    version: u32,
    mesh: RawMesh,
    has_points: bool,
    /// Nodes of all cells, and where each cell's end.
    cells: Option<(Vec<f64>, Vec<usize>)>,
    kinds: Option<Vec<f64>>,
    /// Whose attributes are being read, and how many tuples they have; `None` before
    /// POINT_DATA and CELL_DATA, where arrays belong to the file as a whole.
    owner: Option<(Location, usize)>,
    /// Components of the array read last.
    last_components: usize,
}

impl<'a> File<'a> {
    fn open(bytes: &'a [u8]) -> Parse<File<'a>> {
        let mut at = Cursor::new(bytes);
        let first = String::from_utf8_lossy(at.rest_of_line()).into_owned();
        let version = first
            .rsplit(' ')
            .next()
            .and_then(|v| v.split('.').next())
            .and_then(|v| v.parse().ok())
            .filter(|_| first.starts_with("# vtk DataFile"))
            .ok_or_else(|| {
                format!("line 1: expected \"# vtk DataFile Version x.y\", found {first:?}")
            })?;
        if !(1..=5).contains(&version) {
            return Err(format!(
                "line 1: legacy VTK version {version} is not known; versions 1 to 5 are"
            ));
        }
        at.rest_of_line(); // the title
        let mode = at
            .word(format_args!("ASCII or BINARY"))?
            .to_ascii_uppercase();
        let ascii = match mode.as_str() {
            "ASCII" => true,
            "BINARY" => false,
            _ => return Err(at.error(format_args!("expected ASCII or BINARY, found {mode:?}"))),
        };
        let dataset = at.word(format_args!("DATASET"))?.to_ascii_uppercase();
        let kind = at
            .word(format_args!("the kind of DATASET"))?
            .to_ascii_uppercase();
        if dataset != "DATASET" || kind != "UNSTRUCTURED_GRID" {
            return Err(at.error(format_args!(
                "expected DATASET UNSTRUCTURED_GRID (a mesh of cells), found {dataset} {kind}"
            )));
        }
        at.rest_of_line();
        at.binary = !ascii;
        Ok(File {
            at,
            ascii,
            version,
            mesh: RawMesh::default(),
            has_points: false,
            cells: None,
            kinds: None,
            owner: None,
            last_components: 0,
        })
    }

    fn points(&mut self) -> Parse<()> {
        let count = self.at.count(format_args!("the number of POINTS"), 3)?;
        let mut kind = self.type_name("POINTS")?;
        if self.ascii && kind.eq_ignore_ascii_case("float") {
            // Many writers say float and print a double's digits: none of them is thrown away.
            kind = "double".into();
        }
        let values = self
            .values(count, 3, &kind, "POINTS")?
            .ok_or_else(|| self.at.error("POINTS cannot be strings"))?;
        self.mesh.nodes = values
            .0
            .as_chunks()
            .0
            .iter()
            .map(|p| DVec3::from_array(*p))
            .collect();
        self.has_points = true;
        Ok(())
    }

    fn cells(&mut self) -> Parse<()> {
        let count = self.at.count(format_args!("the number of CELLS"), 1)?;
        let size = self
            .at
            .count(format_args!("the size of the CELLS list"), 1)?;
        self.at.rest_of_line();
        let split = self.version >= 5
            && self
                .at
                .peek()
                .is_some_and(|t| t.eq_ignore_ascii_case(b"OFFSETS"));
        self.cells = Some(if split {
            self.split_cells(count, size)?
        } else {
            let list = self.numbers(size, ScalarType::I32, "CELLS")?;
            self.counted_cells(count, &list)?
        });
        Ok(())
    }

    /// Versions up to 4: each cell is its number of nodes, then the nodes.
    fn counted_cells(&self, count: usize, list: &[f64]) -> Parse<(Vec<f64>, Vec<usize>)> {
        let mut nodes = Vec::with_capacity(list.len());
        let mut ends = Vec::with_capacity(count);
        let mut next = 0;
        for cell in 0..count {
            let length = list.get(next).and_then(|n| index(*n));
            let Some(cell_nodes) =
                length.and_then(|n| list.get(next + 1..(next + 1).checked_add(n)?))
            else {
                return Err(self.at.error(format_args!(
                    "CELLS: cell {cell} (counted from 0) does not fit in the {} numbers announced for {count} cells",
                    list.len()
                )));
            };
            nodes.extend_from_slice(cell_nodes);
            ends.push(nodes.len());
            next += 1 + cell_nodes.len();
        }
        if next != list.len() {
            return Err(self.at.error(format_args!(
                "CELLS: {count} cells use {next} of the {} numbers announced",
                list.len()
            )));
        }
        Ok((nodes, ends))
    }

    /// Version 5: `count` offsets (one more than cells), then all nodes.
    fn split_cells(&mut self, count: usize, size: usize) -> Parse<(Vec<f64>, Vec<usize>)> {
        self.at.token();
        let kind = self.type_name("OFFSETS")?;
        let offsets = self.values(count, 1, &kind, "OFFSETS")?;
        let keyword = self.at.word(format_args!("CONNECTIVITY"))?;
        if !keyword.eq_ignore_ascii_case("CONNECTIVITY") {
            return Err(self
                .at
                .error(format_args!("expected CONNECTIVITY, found {keyword:?}")));
        }
        let kind = self.type_name("CONNECTIVITY")?;
        let nodes = self.values(size, 1, &kind, "CONNECTIVITY")?;
        let (Some((offsets, _)), Some((nodes, _))) = (offsets, nodes) else {
            return Err(self.at.error("OFFSETS and CONNECTIVITY cannot be strings"));
        };
        let mut ends = Vec::with_capacity(offsets.len());
        let mut last = 0;
        for (cell, offset) in offsets.iter().enumerate() {
            let end =
                index(*offset).filter(|o| *o >= last && *o <= nodes.len() && (cell > 0 || *o == 0));
            last = end.ok_or_else(|| {
                self.at.error(format_args!(
                    "OFFSETS: entry {cell} is {offset}, expected a number from {last} to the {} entries of CONNECTIVITY (the first entry is 0)",
                    nodes.len()
                ))
            })?;
            if cell > 0 {
                ends.push(last);
            }
        }
        if last != nodes.len() {
            return Err(self.at.error(format_args!(
                "OFFSETS end at {last}, but CONNECTIVITY has {} entries",
                nodes.len()
            )));
        }
        Ok((nodes, ends))
    }

    fn cell_types(&mut self) -> Parse<()> {
        let count = self.at.count(format_args!("the number of CELL_TYPES"), 1)?;
        self.at.rest_of_line();
        self.kinds = Some(self.numbers(count, ScalarType::I32, "CELL_TYPES")?);
        Ok(())
    }

    fn data_of(&mut self, location: Location) -> Parse<()> {
        let (name, items) = match location {
            Location::Node => (
                "POINT_DATA",
                Some(self.mesh.nodes.len()).filter(|_| self.has_points),
            ),
            Location::Cell => ("CELL_DATA", self.cells.as_ref().map(|(_, ends)| ends.len())),
        };
        let count = self
            .at
            .integer(format_args!("the number of {name} tuples"))?;
        match items {
            Some(items) if usize::try_from(count) == Ok(items) => {
                self.owner = Some((location, items));
                Ok(())
            }
            Some(items) => Err(self.at.error(format_args!(
                "{name} announces {count} tuples, but there are {items} {location}"
            ))),
            None => Err(self
                .at
                .error(format_args!("{name} comes before the {location} it is for"))),
        }
    }

    /// SCALARS, VECTORS, FIELD and their kin.
    fn attribute(&mut self, keyword: &str) -> Parse<()> {
        if keyword == "FIELD" {
            return self.field_arrays();
        }
        let known = [
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
        if !known.contains(&keyword) {
            let shown: String = keyword.chars().take(40).collect();
            return Err(self.at.error(format_args!(
                "expected POINTS, CELLS, CELL_TYPES, POINT_DATA, CELL_DATA, FIELD or the name of an attribute, found {shown:?}"
            )));
        }
        let name = decoded(self.at.word(format_args!("the name of {keyword}"))?);
        if keyword == "LOOKUP_TABLE" {
            let rows = self
                .at
                .count(format_args!("the size of LOOKUP_TABLE {name}"), 4)?;
            return self.colours(rows, 4, &name).map(|_| ());
        }
        let Some((location, tuples)) = self.owner else {
            return Err(self.at.error(format_args!(
                "{keyword} {name} comes before POINT_DATA or CELL_DATA"
            )));
        };
        let (components, values) = match keyword {
            "COLOR_SCALARS" => {
                let components =
                    self.components(format_args!("components of COLOR_SCALARS {name}"))?;
                (components, Some(self.colours(tuples, components, &name)?))
            }
            "SCALARS" => {
                let kind = self
                    .at
                    .word(format_args!("the type of SCALARS {name}"))?
                    .to_string();
                let given = String::from_utf8_lossy(self.at.rest_of_line())
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
                        self.at.error(format_args!(
                            "SCALARS {name}: {given:?} is no number of components"
                        ))
                    })?;
                self.skip_table_name();
                (components, self.values(tuples, components, &kind, &name)?)
            }
            _ => {
                let components = match keyword {
                    "VECTORS" | "NORMALS" => 3,
                    "TENSORS" => 9,
                    "TENSORS6" => 6,
                    "TEXTURE_COORDINATES" => {
                        self.components(format_args!("dimensions of TEXTURE_COORDINATES {name}"))?
                    }
                    _ => 1,
                };
                let kind = self.type_name(&name)?;
                (components, self.values(tuples, components, &kind, &name)?)
            }
        };
        self.keep(name, location, components, values);
        Ok(())
    }

    /// FIELD name n: n arrays of their own name, width, length and type.
    fn field_arrays(&mut self) -> Parse<()> {
        self.at.word(format_args!("the name of FIELD"))?;
        let arrays = self
            .at
            .count(format_args!("the number of arrays in FIELD"), 1)?;
        for array in 0..arrays {
            let mut name = self
                .at
                .word(format_args!("the name of array {array} of FIELD"))?;
            while name == "METADATA" {
                self.skip_metadata();
                name = self
                    .at
                    .word(format_args!("the name of array {array} of FIELD"))?;
            }
            if name == "NULL_ARRAY" {
                continue;
            }
            let name = decoded(name);
            let components = self.components(format_args!("components of array {name}"))?;
            let tuples = self.at.count(format_args!("tuples of array {name}"), 0)?;
            let kind = self.type_name(&name)?;
            let values = self.values(tuples, components, &kind, &name)?;
            match self.owner {
                Some((location, items)) if tuples == items => {
                    self.keep(name, location, components, values);
                }
                Some((location, items)) => self.mesh.warnings.push(format!(
                    "array \"{name}\" is left out: it has {tuples} tuples, but there are {items} {location}"
                )),
                None => {} // belongs to the file, not to nodes or cells
            }
        }
        Ok(())
    }

    fn keep(
        &mut self,
        name: String,
        location: Location,
        components: usize,
        values: Option<(Vec<f64>, ScalarType)>,
    ) {
        match values {
            Some((values, scalar_type)) => self.mesh.fields.push(Field {
                name,
                location,
                components,
                values,
                scalar_type,
            }),
            None => self
                .mesh
                .warnings
                .push(format!("array \"{name}\" is left out: it holds no numbers")),
        }
    }

    fn components(&mut self, what: std::fmt::Arguments) -> Parse<usize> {
        let count = self.at.integer(what)?;
        usize::try_from(count)
            .ok()
            .filter(|c| (1..=1 << 16).contains(c))
            .ok_or_else(|| {
                self.at
                    .error(format_args!("{what}: {count} makes no sense"))
            })
    }

    /// The rest of a header line: the type of the values that follow.
    fn type_name(&mut self, of: &str) -> Parse<String> {
        let name = self.at.word(format_args!("the type of {of}"))?.to_string();
        self.at.rest_of_line();
        Ok(name)
    }

    fn skip_table_name(&mut self) {
        const KEYWORD: &[u8] = b"LOOKUP_TABLE";
        let here = self.at.position();
        self.at.skip_space();
        let found = self.at.rest().get(..KEYWORD.len());
        if found.is_some_and(|k| k.eq_ignore_ascii_case(KEYWORD)) {
            self.at.rest_of_line();
        } else {
            self.at.go_to(here);
        }
    }

    /// METADATA runs to the next empty line, but for the names of the components of the array
    /// before it, which are one a line and may be empty.
    fn skip_metadata(&mut self) {
        self.at.rest_of_line();
        while !self.at.rest().is_empty() {
            let line = self.at.rest_of_line().trim_ascii();
            if line.is_empty() {
                break;
            }
            if line.eq_ignore_ascii_case(b"COMPONENT_NAMES") {
                for _ in 0..self.last_components {
                    self.at.rest_of_line();
                }
            }
        }
    }

    /// Colours: fractions in ASCII, bytes in binary.
    fn colours(&mut self, rows: usize, width: usize, name: &str) -> Parse<(Vec<f64>, ScalarType)> {
        self.at.rest_of_line();
        let count = rows.checked_mul(width).ok_or_else(|| self.too_many(name))?;
        let values = if self.ascii {
            let fractions = self.numbers(count, ScalarType::F64, name)?;
            let byte = |x: f64| (255.0 * x).round().clamp(0.0, 255.0);
            fractions.into_iter().map(byte).collect()
        } else {
            self.numbers(count, ScalarType::U8, name)?
        };
        Ok((values, ScalarType::U8))
    }

    /// `tuples` × `components` values of the type that VTK calls `kind`; `None` when they are
    /// strings, which are passed over.
    fn values(
        &mut self,
        tuples: usize,
        components: usize,
        kind: &str,
        of: &str,
    ) -> Parse<Option<(Vec<f64>, ScalarType)>> {
        self.last_components = components;
        let count = tuples
            .checked_mul(components)
            .ok_or_else(|| self.too_many(of))?;
        let scalar = match kind.to_ascii_lowercase().as_str() {
            "char" | "signed_char" => ScalarType::I8,
            "unsigned_char" => ScalarType::U8,
            "short" => ScalarType::I16,
            "unsigned_short" => ScalarType::U16,
            // vtkIdType is written with 32 bits whatever its width in memory.
            "int" | "vtkidtype" => ScalarType::I32,
            "unsigned_int" => ScalarType::U32,
            "long" | "vtktypeint64" => ScalarType::I64,
            "unsigned_long" | "vtktypeuint64" => ScalarType::U64,
            "float" => ScalarType::F32,
            "double" => ScalarType::F64,
            "bit" => return self.bits(count, of).map(Some),
            "string" | "utf8_string" => return self.skip_strings(count, of).map(|()| None),
            _ => {
                return Err(self
                    .at
                    .error(format_args!("{of} has the unknown type {kind:?}")));
            }
        };
        Ok(Some((self.numbers(count, scalar, of)?, scalar)))
    }

    fn numbers(&mut self, count: usize, scalar: ScalarType, of: &str) -> Parse<Vec<f64>> {
        if !self.ascii {
            let length = count
                .checked_mul(scalar::size(scalar))
                .ok_or_else(|| self.too_many(of))?;
            let bytes = self.at.take(length, format_args!("{of}"))?;
            return Ok(scalar::decode(bytes, scalar, true));
        }
        // A number and the space behind it take two bytes at least.
        self.at.check_count(
            count as i64,
            format_args!("the number of values in {of}"),
            2,
        )?;
        let mut values = Vec::with_capacity(count);
        for i in 0..count {
            let value = self
                .at
                .number(format_args!("value {i} of {count} in {of}"))?;
            // What was a float32 keeps the value it had.
            values.push(if scalar == ScalarType::F32 {
                f64::from(value as f32)
            } else {
                value
            });
        }
        Ok(values)
    }

    fn bits(&mut self, count: usize, of: &str) -> Parse<(Vec<f64>, ScalarType)> {
        if self.ascii {
            return Ok((self.numbers(count, ScalarType::U8, of)?, ScalarType::U8));
        }
        let bytes = self.at.take(count.div_ceil(8), format_args!("{of}"))?;
        let bit = |i: usize| f64::from(bytes[i / 8] >> (7 - i % 8) & 1);
        Ok(((0..count).map(bit).collect(), ScalarType::U8))
    }

    /// Strings are lines in ASCII; in binary each follows its length, of 1, 2, 4 or 8 bytes as
    /// its first two bits tell.
    fn skip_strings(&mut self, count: usize, of: &str) -> Parse<()> {
        for _ in 0..count {
            if self.at.rest().is_empty() {
                return Err(self
                    .at
                    .error(format_args!("the file ends within the strings of {of}")));
            }
            if self.ascii {
                self.at.rest_of_line();
                continue;
            }
            let width = match self.at.rest()[0] >> 6 {
                3 => 1,
                2 => 2,
                1 => 4,
                _ => 8,
            };
            let head = self
                .at
                .take(width, format_args!("the length of a string of {of}"))?;
            let length = head.iter().enumerate().fold(0u64, |n, (i, b)| {
                n << 8 | u64::from(if i == 0 { b & 0x3f } else { *b })
            });
            let length = usize::try_from(length).map_err(|_| self.too_many(of))?;
            self.at.take(length, format_args!("a string of {of}"))?;
        }
        Ok(())
    }

    fn too_many(&self, of: &str) -> String {
        self.at
            .error(format_args!("{of} is larger than any file can be"))
    }

    fn finish(self) -> Parse<RawMesh> {
        let mut mesh = self.mesh;
        let missing = |what: &str| format!("the file ends, and there is no {what} in it");
        if !self.has_points {
            return Err(missing("POINTS section"));
        }
        let (nodes, ends) = self.cells.ok_or_else(|| missing("CELLS section"))?;
        let kinds = self.kinds.ok_or_else(|| missing("CELL_TYPES section"))?;
        if kinds.len() != ends.len() {
            return Err(format!(
                "there are {} CELLS, but {} CELL_TYPES",
                ends.len(),
                kinds.len()
            ));
        }
        mesh.add_cells(&kinds, &nodes, &ends, 0)?;
        Ok(mesh)
    }
}

/// VTK writes names with %XX for what is not plain text.
fn decoded(name: &str) -> String {
    let bytes = name.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let code = (bytes[i] == b'%')
            .then(|| name.get(i + 1..i + 3))
            .flatten()
            .and_then(|hex| u8::from_str_radix(hex, 16).ok());
        out.push(code.unwrap_or(bytes[i]));
        i += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned()
}
