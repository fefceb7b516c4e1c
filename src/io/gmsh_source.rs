//! Numbers and sections of a Gmsh file, ASCII or binary.

use super::cursor::{Cursor, ParseResult};
use super::gmsh;
use std::fmt::Arguments;

/// A `.msh` file being read.
pub(super) struct Source<'a> {
    at: Cursor<'a>,
    ascii: bool,
    big_endian: bool,
    /// Size of a `size_t` in bytes.
    size_bytes: usize,
}

impl<'a> Source<'a> {
    pub fn new(bytes: &'a [u8]) -> Source<'a> {
        Source {
            at: Cursor::new(bytes),
            ascii: true,
            big_endian: false,
            size_bytes: 8,
        }
    }

    pub fn ascii(&self) -> bool {
        self.ascii
    }

    /// Returns the position in the file, for [`Source::go_to`].
    pub fn position(&self) -> usize {
        self.at.position()
    }

    pub fn go_to(&mut self, position: usize) {
        self.at.go_to(position);
    }

    pub fn error(&self, what: impl std::fmt::Display) -> String {
        self.at.error(what)
    }

    /// Reads `$Name` up to the end of its line; `None` at the end of the file.
    pub fn next_section(&mut self) -> ParseResult<Option<&'a str>> {
        let Some(token) = self.at.token() else {
            return Ok(None);
        };
        let name = std::str::from_utf8(token)
            .ok()
            .and_then(|t| t.strip_prefix('$'));
        let Some(name) = name.filter(|n| !n.starts_with("End") && !n.starts_with("END")) else {
            let shown = String::from_utf8_lossy(&token[..token.len().min(40)]);
            return Err(self.error(format_args!(
                "expected the $Name of a section, found {shown:?}"
            )));
        };
        self.at.rest_of_line();
        Ok(Some(name))
    }

    pub fn end_of_section(&mut self, name: &str) -> ParseResult<()> {
        let token = self.at.word(format_args!("$End{name}"))?;
        // Version 1 has $ENDNOD and $ENDELM.
        let end = token.strip_prefix("$End").or(token.strip_prefix("$END"));
        if end == Some(name) {
            return Ok(());
        }
        let shown: String = token.chars().take(40).collect();
        Err(self.error(format_args!("expected $End{name}, found {shown:?}")))
    }

    /// Moves past `$End<name>`; returns the content before it.
    pub fn skip_section(&mut self, name: &str) -> ParseResult<&'a [u8]> {
        let end = format!("$End{name}");
        let rest = self.at.rest();
        let found = rest.windows(end.len()).position(|w| w == end.as_bytes());
        let Some(position) = found else {
            return Err(self.error(format_args!(
                "unexpected end of file in ${name}, expected {end}"
            )));
        };
        self.at.go_to(self.at.position() + position + end.len());
        Ok(&rest[..position])
    }

    /// Reads the content of $MeshFormat; returns the version, as coded in [`gmsh`].
    pub fn mesh_format(&mut self) -> ParseResult<u32> {
        let version = self.at.word(format_args!("the version of the format"))?;
        let major = match version.split_once('.').unwrap_or((version, "0")) {
            ("2", _) => gmsh::V2,
            ("4", minor) if minor.starts_with('0') => gmsh::V4_0,
            ("4", minor) if minor.starts_with('1') => gmsh::V4_1,
            _ => {
                return Err(self.error(format_args!(
                    "MSH version {version} is not supported; use version 1, 2, 4.0 or 4.1 (convert \
                    with gmsh -format msh41)"
                )));
            }
        };
        self.ascii = match self.at.integer(format_args!("the file type"))? {
            0 => true,
            1 => false,
            other => {
                return Err(self.error(format_args!(
                    "file type is {other}, expected 0 (ASCII) or 1 (binary)"
                )));
            }
        };
        self.size_bytes = match self.at.integer(format_args!("the data size"))? {
            4 if !self.ascii => 4,
            8 => 8,
            other if self.ascii => other.clamp(4, 8) as usize,
            other => return Err(self.error(format_args!("data size is {other}, expected 4 or 8"))),
        };
        if !self.ascii {
            self.at.rest_of_line();
            self.at.binary = true;
            let one = self.at.take(4, format_args!("the byte-order marker 1"))?;
            self.big_endian = match one {
                [1, 0, 0, 0] => false,
                [0, 0, 0, 1] => true,
                _ => {
                    return Err(self.error(format_args!(
                        "expected the byte-order marker 1, found the bytes {one:?}"
                    )));
                }
            };
        }
        Ok(major)
    }

    /// Returns the next `N` bytes, in little-endian order.
    fn bytes<const N: usize>(&mut self, what: Arguments) -> ParseResult<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.at.take(N, what)?);
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    pub fn int(&mut self, what: Arguments) -> ParseResult<i32> {
        if !self.ascii {
            return Ok(i32::from_le_bytes(self.bytes(what)?));
        }
        let value = self.at.integer(what)?;
        i32::try_from(value)
            .map_err(|_| self.error(format_args!("{what} is {value}, expected a 32-bit integer")))
    }

    pub fn size(&mut self, what: Arguments) -> ParseResult<u64> {
        if !self.ascii {
            return Ok(match self.size_bytes {
                4 => u64::from(u32::from_le_bytes(self.bytes(what)?)),
                _ => u64::from_le_bytes(self.bytes(what)?),
            });
        }
        let value = self.at.integer(what)?;
        u64::try_from(value)
            .map_err(|_| self.error(format_args!("{what} is {value}, expected an integer ≥ 0")))
    }

    pub fn double(&mut self, what: Arguments) -> ParseResult<f64> {
        if self.ascii {
            self.at.number(what)
        } else {
            Ok(f64::from_le_bytes(self.bytes(what)?))
        }
    }

    /// Reads a `size_t`, the number of following items of at least `least_bytes` each.
    pub fn count(&mut self, what: Arguments, least_bytes: usize) -> ParseResult<usize> {
        let count = self.size(what)?;
        self.at
            .validate_count(i64::try_from(count).unwrap_or(i64::MAX), what, least_bytes)
    }

    /// Like [`Source::count`], for counts that are text in binary files, too.
    pub fn ascii_count(&mut self, what: Arguments, least_bytes: usize) -> ParseResult<usize> {
        let count = self.at.count(what, least_bytes)?;
        self.at.rest_of_line();
        Ok(count)
    }

    /// Returns the rest of a line.
    pub fn line(&mut self) -> String {
        String::from_utf8_lossy(self.at.rest_of_line())
            .trim()
            .to_string()
    }
}
