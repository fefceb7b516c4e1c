//! Files that an Abaqus input file includes: `*INCLUDE, INPUT=FILE`, and `INPUT=FILE` of *NODE,
//! *ELEMENT, *NSET and *ELSET.
//!
//! Their content is inserted before the file is parsed, between two comments that keep the numbers of
//! lines in errors right.

use super::abaqus::is_abaqus;
use super::abaqus_lines::Card;
use super::cursor::ParseResult;
use crate::{Error, Result};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Comments before and after an included file; the first is followed by its name.
const BEGIN: &str = "**\u{1}include ";
const END: &str = "**\u{1}end";

/// Maximum number of files that include each other.
const DEEPEST: usize = 16;

/// Maximum size of a file with all that it includes, in bytes.
const MAX_BYTES: usize = i32::MAX as usize;

/// Returns the content of the file `path` with all files that it includes, if it is an Abaqus input
/// file; otherwise `bytes`.
///
/// # Errors
/// An error if an included file cannot be read.
pub(super) fn expand(path: &Path, bytes: Vec<u8>) -> Result<Vec<u8>> {
    let abaqus = super::volume::extension(path) == "inp" || is_abaqus(&bytes);
    let includes = || cards(&bytes).any(|(_, line)| included(&line).is_some());
    if !abaqus || !includes() {
        return Ok(bytes);
    }
    let mut whole = Vec::with_capacity(bytes.len());
    let mut open = vec![path.to_owned()];
    insert(&bytes, &mut open, &mut whole).map_err(|e| Error::format(path, e))?;
    Ok(whole)
}

/// Iterates over the keyword lines with the numbers of their lines.
fn cards(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let lines = (1..).zip(bytes.split(|b| *b == b'\n'));
    lines
        .filter(|(_, line)| is_card(line))
        .map(|(number, line)| (number, String::from_utf8_lossy(line.trim_ascii())))
}

fn is_card(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    line.starts_with(b"*") && !line.starts_with(b"**")
}

/// Returns the keyword and the file that a keyword line includes.
fn included(line: &str) -> Option<(String, String)> {
    let card = Card::new(line);
    let keyword = card.keyword.as_str();
    let file = match keyword {
        "INCLUDE" | "NODE" | "ELEMENT" | "NSET" | "ELSET" => card.set("INPUT")?,
        _ => return None,
    };
    Some((card.keyword.clone(), file.to_owned()))
}

/// Appends `bytes`, the content of the last file of `open`, to `whole`.
fn insert(bytes: &[u8], open: &mut Vec<PathBuf>, whole: &mut Vec<u8>) -> ParseResult<()> {
    let mut rest = bytes.split_inclusive(|b| *b == b'\n').peekable();
    let mut number = 0;
    while let Some(line) = rest.next() {
        number += 1;
        if !is_card(line) {
            whole.extend_from_slice(line);
            continue;
        }
        let mut card = String::from_utf8_lossy(line.trim_ascii()).into_owned();
        let mut lines = 1;
        // A keyword line that ends with a comma continues on the next line.
        while card.ends_with(',')
            && let Some(next) = rest.next_if(|next| {
                let next = next.trim_ascii_start();
                next.first()
                    .is_some_and(|b| b.is_ascii_alphabetic() || *b == b'"')
            })
        {
            card.push_str(&String::from_utf8_lossy(next.trim_ascii()));
            lines += 1;
        }
        let Some((keyword, file)) = included(&card) else {
            whole.extend_from_slice(card.as_bytes());
            whole.extend(std::iter::repeat_n(b'\n', lines));
            number += lines - 1;
            continue;
        };
        if keyword != "INCLUDE" {
            whole.extend_from_slice(without_input(&card).as_bytes());
        }
        whole.extend(std::iter::repeat_n(b'\n', lines));
        let (path, content) = fetch(&file, open).map_err(|e| {
            let verb = match keyword.as_str() {
                "INCLUDE" => "names",
                _ => "reads",
            };
            format!("line {number}: *{keyword} {verb} the file {file}{e}")
        })?;
        number += lines - 1;
        if whole.len() + content.len() > MAX_BYTES {
            return Err(format!(
                "line {number}: included files have more than {MAX_BYTES} bytes together; \
                include each once"
            ));
        }
        whole.extend_from_slice(format!("{BEGIN}{file}\n").as_bytes());
        open.push(path);
        insert(&content, open, whole).map_err(|e| format!("{file}, {e}"))?;
        open.pop();
        whole.extend_from_slice(format!("\n{END}\n").as_bytes());
    }
    Ok(())
}

/// Returns a keyword line without the parameter INPUT.
fn without_input(card: &str) -> String {
    let mut quoted = false;
    let words = card.split(|c| {
        quoted ^= c == '"';
        c == ',' && !quoted
    });
    let kept: Vec<&str> = words
        .filter(|word| {
            let name = word.split('=').next().unwrap_or_default();
            !name.trim().eq_ignore_ascii_case("INPUT")
        })
        .collect();
    kept.join(",")
}

/// Reads an included file: relative to the file that includes it, or to the first one.
fn fetch(name: &str, open: &[PathBuf]) -> ParseResult<(PathBuf, Vec<u8>)> {
    if open.len() > DEEPEST {
        return Err(format!(
            ", but more than {DEEPEST} files include each other already"
        ));
    }
    let name = name.replace('\\', "/");
    let beside = |file: &Path| file.with_file_name("").join(&name);
    let last = Path::new(&name).file_name().unwrap_or_default();
    let candidates = [
        open.last().map(|file| beside(file)),
        open.first().map(|file| beside(file)),
        // An absolute path of another machine.
        open.first().map(|file| file.with_file_name(last)),
    ];
    let mut candidates = candidates.into_iter().flatten();
    let first = candidates.next().unwrap_or_default();
    let path = match crate::files::exists(&first) {
        true => first,
        false => candidates
            .find(|path| crate::files::exists(path))
            .unwrap_or(first),
    };
    if open.contains(&path) {
        return Err(", which includes itself; remove one of the two".into());
    }
    match super::content(&path) {
        Ok(content) => Ok((path, content)),
        Err(e) => Err(format!(
            ", which cannot be read: {e}; put it into the folder of this file or insert its content here"
        )),
    }
}

/// Numbers of lines in a file with its included files.
#[derive(Default)]
pub(super) struct Lines {
    number: usize,
    /// The included files that are open, and the last line of the file that includes each.
    open: Vec<(String, usize)>,
}

impl Lines {
    /// Moves to the next line; returns whether it belongs to a file, not to the inserted comments.
    pub fn next(&mut self, line: &[u8]) -> bool {
        if let Some(name) = line.strip_prefix(BEGIN.as_bytes()) {
            let name = String::from_utf8_lossy(name).into_owned();
            self.open.push((name, self.number));
            self.number = 0;
        } else if line.starts_with(END.as_bytes()) {
            if let Some((_, number)) = self.open.pop() {
                self.number = number;
            }
        } else {
            self.number += 1;
            return true;
        }
        false
    }

    /// Returns the position for errors.
    pub fn position(&self) -> String {
        let files: String = self
            .open
            .iter()
            .map(|(name, _)| format!("{name}, "))
            .collect();
        format!("{files}line {}", self.number)
    }
}
