//! Expansion of patterns of numbered data files.

use super::Fetch;

/// Returns the data files that a header names: the file of that name, or those of a pattern such as
/// `NAME%03d FIRST LAST STEP`; `None` if it is neither.
pub(super) fn data_files(named: &str, fetch: Fetch) -> Option<Vec<String>> {
    match named.contains('%') {
        // A file may have a percent sign in its name.
        true => numbered(named).or_else(|| fetch(named).ok().map(|_| vec![named.to_owned()])),
        false => Some(vec![named.to_owned()]),
    }
}

/// Maximum number of files of a pattern.
const MAX_FILES: i64 = 100_000;

/// Expands `NAME%03d FIRST LAST STEP` to file names.
fn numbered(pattern: &str) -> Option<Vec<String>> {
    let mut words = pattern.split_whitespace();
    let name = words.next()?;
    let numbers: Vec<i64> = words.map_while(|w| w.parse().ok()).collect();
    let (first, last, step) = match numbers[..] {
        [first, last] => (first, last, 1),
        [first, last, step] | [first, last, step, _] => (first, last, step),
        _ => return None,
    };
    let (before, after) = name.split_once('%')?;
    let (width, after) = after.split_once('d')?;
    let zeros = width.starts_with('0');
    let width: usize = match width {
        "" => 0,
        width => width.parse().ok().filter(|w| *w < 20)?,
    };
    let count = last.checked_sub(first)?.checked_div(step)?;
    if !(0..MAX_FILES).contains(&count) {
        return None;
    }
    let named = |n: i64| {
        let n = first + n * step;
        match zeros {
            true => format!("{before}{n:0width$}{after}"),
            false => format!("{before}{n:width$}{after}"),
        }
    };
    Some((0..=count).map(named).collect())
}
