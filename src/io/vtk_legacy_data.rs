//! Values of a legacy VTK file, ASCII or binary.

use super::cursor::{Cursor, ParseResult};
use super::raw_mesh::index;
use super::scalar;
use crate::mesh::ScalarType;

/// Source of the values of a file.
pub(super) struct Values<'a> {
    pub at: Cursor<'a>,
    pub ascii: bool,
    /// Whether a word that is no number was found among values.
    pub bad_token: bool,
    /// Number of components of the last array.
    last_components: usize,
}

impl<'a> Values<'a> {
    pub fn new(at: Cursor<'a>, ascii: bool) -> Values<'a> {
        Values {
            at,
            ascii,
            bad_token: false,
            last_components: 0,
        }
    }

    pub fn components(&mut self, what: std::fmt::Arguments) -> ParseResult<usize> {
        let count = self.at.integer(what)?;
        usize::try_from(count)
            .ok()
            .filter(|c| (1..=1 << 16).contains(c))
            .ok_or_else(|| {
                self.at
                    .error(format_args!("{what} must be 1 to 65536, got {count}"))
            })
    }

    /// Returns the rest of a header line: the type of the values that follow.
    pub fn type_name(&mut self, of: &str) -> ParseResult<String> {
        let name = self.at.word(format_args!("the type of {of}"))?.to_string();
        self.at.rest_of_line();
        Ok(name)
    }

    /// Skips METADATA up to the next empty line, except for the names of the components of the
    /// preceding array, which are one per line and may be empty.
    pub fn skip_metadata(&mut self) {
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

    /// Reads colours: fractions in ASCII, bytes in binary.
    pub fn colours(
        &mut self,
        rows: usize,
        width: usize,
        name: &str,
    ) -> ParseResult<(Vec<f64>, ScalarType)> {
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

    /// Reads `tuples` × `components` values of the VTK type `kind`; `None` for strings, which are
    /// skipped.
    pub fn values(
        &mut self,
        tuples: usize,
        components: usize,
        kind: &str,
        of: &str,
    ) -> ParseResult<Option<(Vec<f64>, ScalarType)>> {
        self.last_components = components;
        let count = tuples
            .checked_mul(components)
            .ok_or_else(|| self.too_many(of))?;
        let scalar = match kind.to_ascii_lowercase().as_str() {
            "char" | "signed_char" | "vtktypeint8" => ScalarType::I8,
            "unsigned_char" | "vtktypeuint8" => ScalarType::U8,
            "short" | "vtktypeint16" => ScalarType::I16,
            "unsigned_short" | "vtktypeuint16" => ScalarType::U16,
            // vtkIdType is written with 32 bits whatever its width in memory.
            "int" | "vtkidtype" | "vtktypeint32" => ScalarType::I32,
            "unsigned_int" | "vtktypeuint32" => ScalarType::U32,
            "long" | "vtktypeint64" => ScalarType::I64,
            "unsigned_long" | "vtktypeuint64" => ScalarType::U64,
            "float" | "vtktypefloat32" => ScalarType::F32,
            "double" | "vtktypefloat64" => ScalarType::F64,
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

    pub fn numbers(&mut self, count: usize, scalar: ScalarType, of: &str) -> ParseResult<Vec<f64>> {
        if !self.ascii {
            let length = count
                .checked_mul(scalar::size(scalar))
                .ok_or_else(|| self.too_many(of))?;
            let bytes = self.at.take(length, format_args!("{of}"))?;
            return Ok(scalar::decode(bytes, scalar, true));
        }
        // A number and the space after it take at least two bytes.
        self.at.validate_count(
            count as i64,
            format_args!("the number of values in {of}"),
            2,
        )?;
        let mut values = Vec::with_capacity(count);
        for i in 0..count {
            let value = self.at.number(format_args!("value {i} of {count} in {of}"));
            if value.is_err() {
                self.bad_token = !self.at.rest().trim_ascii().is_empty();
            }
            let value = value?;
            // A float32 keeps its value.
            values.push(if scalar == ScalarType::F32 {
                f64::from(value as f32)
            } else {
                value
            });
        }
        Ok(values)
    }

    pub fn bits(&mut self, count: usize, of: &str) -> ParseResult<(Vec<f64>, ScalarType)> {
        if self.ascii {
            return Ok((self.numbers(count, ScalarType::U8, of)?, ScalarType::U8));
        }
        let bytes = self.at.take(count.div_ceil(8), format_args!("{of}"))?;
        let bit = |i: usize| f64::from(bytes[i / 8] >> (7 - i % 8) & 1);
        Ok(((0..count).map(bit).collect(), ScalarType::U8))
    }

    /// Skips strings: lines in ASCII; in binary each follows its length, of 1, 2, 4 or 8 bytes as
    /// encoded in its first two bits.
    pub fn skip_strings(&mut self, count: usize, of: &str) -> ParseResult<()> {
        for _ in 0..count {
            if self.at.rest().is_empty() {
                return Err(self.at.error(format_args!(
                    "unexpected end of file within the strings of {of}"
                )));
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

    /// Returns the error of a count that overflows.
    pub fn too_many(&self, of: &str) -> String {
        self.at
            .error(format_args!("size of {of} exceeds the addressable range"))
    }

    /// Reads cells of versions up to 4: the number of nodes, then the nodes.
    pub fn counted_cells(&self, count: usize, list: &[f64]) -> ParseResult<(Vec<f64>, Vec<usize>)> {
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

    /// Reads cells of version 5: `count` offsets (one more than cells), then all nodes.
    pub fn split_cells(
        &mut self,
        count: usize,
        size: usize,
    ) -> ParseResult<(Vec<f64>, Vec<usize>)> {
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

    /// Skips the LOOKUP_TABLE line that most writers put before SCALARS.
    pub fn skip_table_name(&mut self) {
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
}
