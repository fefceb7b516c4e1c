//! Expansion of patterns of numbered data files.

/// Maximum number of files of a pattern.
const MOST_FILES: i64 = 100_000;

/// Expands `NAME%03d FIRST LAST STEP` to file names.
pub(super) fn numbered(pattern: &str) -> Option<Vec<String>> {
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
    if !(0..MOST_FILES).contains(&count) {
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
