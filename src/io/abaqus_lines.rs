//! Lines of Abaqus input files: keywords with parameters, and comma-separated words.

use super::abaqus_sets::Member;
use super::cursor::ParseResult;

/// A keyword with its parameters; names in upper case.
pub(super) struct Card {
    pub keyword: String,
    parameters: Vec<(String, String)>,
}

impl Card {
    pub fn new(line: &str) -> Card {
        let mut quoted = false;
        let mut words = line[1..].split(|c| {
            quoted ^= c == '"';
            c == ',' && !quoted
        });
        let upper = |word: &str| {
            let words: Vec<&str> = word.split_whitespace().collect();
            words.join(" ").to_ascii_uppercase()
        };
        let keyword = upper(words.next().unwrap_or_default());
        let parameters = words
            .map(|word| {
                let (name, value) = word.split_once('=').unwrap_or((word, ""));
                let value = value.trim().trim_matches('"').to_owned();
                (upper(name), value)
            })
            .collect();
        Card {
            keyword,
            parameters,
        }
    }

    pub fn get(&self, name: &str) -> Option<&str> {
        let found = self.parameters.iter().find(|(n, _)| n == name);
        found.map(|(_, value)| value.as_str())
    }

    /// Returns the name of a set, if one is given.
    pub fn set(&self, name: &str) -> Option<&str> {
        self.get(name).filter(|value| !value.is_empty())
    }
}

/// Parses the members on a line of a set: numbers and names, or with `generate` a first number, a
/// last number and an increment.
pub(super) fn members<'a>(
    words: impl Iterator<Item = &'a [u8]>,
    generate: bool,
) -> ParseResult<Vec<Member>> {
    let words = words.filter(|word| !word.is_empty());
    if !generate {
        return Ok(words.map(|word| instance_member(word).1).collect());
    }
    let numbers = words
        .map(|word| tag(word, "a number of a range"))
        .collect::<ParseResult<Vec<u64>>>()?;
    match numbers[..] {
        [first, last] => Ok(vec![Member::Range(first, last, 1)]),
        [first, last, step] if step > 0 => Ok(vec![Member::Range(first, last, step)]),
        _ => Err("expected a range FIRST, LAST, STEP with STEP ≥ 1".into()),
    }
}

/// Parses a member of a set: a number or the name of a set, possibly after the name of an instance
/// and a full stop.
pub(super) fn instance_member(word: &[u8]) -> (Option<String>, Member) {
    if let Ok(number) = tag(word, "") {
        return (None, Member::One(number));
    }
    let text = String::from_utf8_lossy(word);
    let (instance, name) = match text.rsplit_once('.') {
        Some((instance, name)) => (Some(instance.trim_matches('"').to_owned()), name),
        None => (None, &*text),
    };
    let member = match name.parse() {
        Ok(number) => Member::One(number),
        Err(_) => Member::Named(name.trim_matches('"').to_owned()),
    };
    (instance, member)
}

/// Parses a word as the number of a node or element.
pub(super) fn tag(word: &[u8], what: &str) -> ParseResult<u64> {
    let text = std::str::from_utf8(word).ok();
    text.and_then(|t| t.parse().ok())
        .ok_or_else(|| format!("expected {what}, found {}", shown(word)))
}

/// Formats a word for error messages.
pub(super) fn shown(word: &[u8]) -> String {
    format!("{:?}", String::from_utf8_lossy(&word[..word.len().min(40)]))
}
