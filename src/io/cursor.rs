//! Cursor over the bytes of a file: reads words, numbers and blocks, with errors that state the
//! position.

use std::fmt::Arguments;

/// Result of a parser; the error is a sentence without the file name, which [`super::read`]
/// prepends.
pub(super) type ParseResult<T> = std::result::Result<T, String>;

/// Reads `bytes` sequentially.
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    position: usize,
    comment: Option<u8>,
    /// Whether errors state byte offsets instead of line numbers.
    pub binary: bool,
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8]) -> Cursor<'a> {
        Cursor {
            bytes,
            position: 0,
            comment: None,
            binary: false,
        }
    }

    /// Creates a cursor that treats everything from `#` to the end of the line as white space.
    pub fn with_comments(bytes: &'a [u8]) -> Cursor<'a> {
        Cursor {
            comment: Some(b'#'),
            ..Cursor::new(bytes)
        }
    }

    /// Returns the bytes not read yet.
    pub fn rest(&self) -> &'a [u8] {
        &self.bytes[self.position..]
    }

    /// Returns the position of the cursor, for [`Cursor::go_to`].
    pub fn position(&self) -> usize {
        self.position
    }

    /// Moves to `position`, at most the end.
    pub fn go_to(&mut self, position: usize) {
        self.position = position.min(self.bytes.len());
    }

    /// Returns the error `what`, prefixed with the position of the cursor.
    pub fn error(&self, what: impl std::fmt::Display) -> String {
        self.error_at(self.position, what)
    }

    /// Returns the error `what`, prefixed with `position`.
    pub fn error_at(&self, position: usize, what: impl std::fmt::Display) -> String {
        if self.binary {
            format!("byte {position}: {what}")
        } else {
            let before = &self.bytes[..position.min(self.bytes.len())];
            let line = 1 + before.iter().filter(|b| **b == b'\n').count();
            format!("line {line}: {what}")
        }
    }

    pub fn skip_space(&mut self) {
        while let Some(b) = self.bytes.get(self.position) {
            if b.is_ascii_whitespace() || *b == 0x0b {
                self.position += 1;
            } else if Some(*b) == self.comment {
                self.rest_of_line();
            } else {
                break;
            }
        }
    }

    /// Returns the rest of this line without its line end; the cursor moves to the next line.
    pub fn rest_of_line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let length = rest.iter().position(|b| *b == b'\n');
        self.go_to(self.position + length.map_or(rest.len(), |n| n + 1));
        rest[..length.unwrap_or(rest.len())].trim_ascii_end()
    }

    /// Returns the next line with content other than white space and comments, without its comment,
    /// and its position.
    pub fn line(&mut self) -> Option<(usize, &'a [u8])> {
        self.skip_space();
        if self.rest().is_empty() {
            return None;
        }
        let start = self.position;
        let line = self.rest_of_line();
        let comment = line.iter().position(|b| Some(*b) == self.comment);
        Some((
            start,
            line[..comment.unwrap_or(line.len())].trim_ascii_end(),
        ))
    }

    /// Returns the next run of characters between white space; `None` at the end.
    pub fn token(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        let rest = self.rest();
        let length = rest
            .iter()
            .position(|b| b.is_ascii_whitespace() || Some(*b) == self.comment)
            .unwrap_or(rest.len());
        self.position += length;
        (length > 0).then_some(&rest[..length])
    }

    /// Returns the next token without consuming it.
    pub fn peek(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        let position = self.position;
        let token = self.token();
        self.position = position;
        token
    }

    /// Returns the next token as text.
    pub fn word(&mut self, what: Arguments) -> ParseResult<&'a str> {
        match self.token() {
            Some(token) => std::str::from_utf8(token).map_err(|_| {
                self.error(format_args!(
                    "expected {what}, found bytes that are not UTF-8"
                ))
            }),
            None => Err(self.error(format_args!("unexpected end of file, expected {what}"))),
        }
    }

    pub fn number(&mut self, what: Arguments) -> ParseResult<f64> {
        let token = match self.token() {
            Some(token) => token,
            None => return Err(self.error(format_args!("unexpected end of file, expected {what}"))),
        };
        number(token).ok_or_else(|| self.error(not_a("a number", what, token)))
    }

    pub fn integer(&mut self, what: Arguments) -> ParseResult<i64> {
        let token = match self.token() {
            Some(token) => token,
            None => return Err(self.error(format_args!("unexpected end of file, expected {what}"))),
        };
        integer(token).ok_or_else(|| self.error(not_a("an integer", what, token)))
    }

    /// Reads the next token as a number of items of at least `least_bytes` each; it is checked
    /// against the rest of the file, so it is safe to use for an allocation.
    pub fn count(&mut self, what: Arguments, least_bytes: usize) -> ParseResult<usize> {
        let count = self.integer(what)?;
        self.validate_count(count, what, least_bytes)
    }

    /// Checks that `count` items of at least `least_bytes` each can still follow.
    pub fn validate_count(
        &self,
        count: i64,
        what: Arguments,
        least_bytes: usize,
    ) -> ParseResult<usize> {
        let left = self.rest().len();
        usize::try_from(count)
            .ok()
            .filter(|n| {
                n.checked_mul(least_bytes)
                    .is_some_and(|b| b <= left + least_bytes)
            })
            .ok_or_else(|| {
                self.error(format_args!(
                    "{what} is {count}, but only {left} bytes are left in the file (invalid count \
                    or truncated file)"
                ))
            })
    }

    /// Returns the next `length` bytes.
    pub fn take(&mut self, length: usize, what: Arguments) -> ParseResult<&'a [u8]> {
        let rest = self.rest();
        let Some(block) = rest.get(..length) else {
            return Err(self.error(format_args!(
                "{what} must have {length} bytes, but the file ends after {}",
                rest.len()
            )));
        };
        self.position += length;
        Ok(block)
    }
}

fn not_a(kind: &str, what: Arguments, token: &[u8]) -> String {
    let shown = String::from_utf8_lossy(&token[..token.len().min(40)]);
    format!("expected {what} ({kind}), found {shown:?}")
}

/// Parses a token as a floating-point number; also in Fortran notation, `1.0D+03`, and the values
/// that are not numbers as Windows programs print them, `-1.#IND` or `nan(ind)`.
pub(super) fn number(token: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(token).ok()?;
    text.parse().ok().or_else(|| not_finite(text)).or_else(|| {
        let exponent = text.find(['d', 'D'])?;
        (exponent > 0).then_some(())?;
        text.replace(['d', 'D'], "e").parse().ok()
    })
}

/// Parses an infinite value or NaN as the C library of Windows prints it, in its older form
/// (`1.#INF`, `-1.#IND00`, `1.#QNAN`; rounded to a digit, `1.#J` and `1.#R`) or its newer one.
fn not_finite(text: &str) -> Option<f64> {
    let (negative, size) = match text.strip_prefix(['-', '+']) {
        Some(size) => (text.starts_with('-'), size),
        None => (false, text),
    };
    let size = size.to_ascii_lowercase();
    let old = size.strip_prefix("1.#").or(size.strip_prefix("1#"));
    let infinity = if negative {
        f64::NEG_INFINITY
    } else {
        f64::INFINITY
    };
    match old {
        Some(kind) if ["inf", "j"].contains(&kind.trim_end_matches('0')) => Some(infinity),
        Some(kind) => ["qnan", "snan", "nan", "ind", "r"]
            .contains(&kind.trim_end_matches('0'))
            .then_some(f64::NAN),
        None => (size.starts_with("nan(") && size.ends_with(')')).then_some(f64::NAN),
    }
}

/// Parses a token as an integer.
pub(super) fn integer(token: &[u8]) -> Option<i64> {
    std::str::from_utf8(token).ok()?.parse().ok()
}
