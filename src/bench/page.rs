//! The page of a report, in Markdown.

use super::{GOLDEN, Machine, Outcome, PARTS, Part, Report, Row};
use crate::number_format::rounded;
use std::fmt::Write;

/// A chart: its part and its file name without extension.
pub(super) type ChartName = (String, String);

/// Returns the page.
pub(super) fn markdown(report: &Report, charts: &[ChartName]) -> String {
    let mut text = String::from("# Palpate on this machine\n\n");
    text += &summary(report);
    text += "\n| | |\n| --- | --- |\n";
    for (name, value) in facts(report) {
        line(&mut text, &[name.into(), value]);
    }
    if !report.machine.optimised {
        text += "\n**This build is not optimised: its times are of no use. Build with `cargo build \
            --release`.**\n";
    }
    text += "\nValues are medians of the repetitions, with the smallest and the largest in \
        brackets. Times better: above 1, this machine is faster or needs less.\n";
    for part in PARTS {
        let rows: Vec<&Row> = report.rows.iter().filter(|r| r.part == part.name).collect();
        if !rows.is_empty() {
            section(&mut text, report, part, &rows, charts);
        }
    }
    text
}

/// Returns the result of the golden comparisons and of the run, in a few sentences.
fn summary(report: &Report) -> String {
    let (failed, passed) = (report.golden_failures().count(), report.golden_passes());
    let mut text = match (failed, passed) {
        (0, 0) => "No golden comparison was made.\n".to_owned(),
        (0, passed) => format!("All {passed} golden comparisons are within their bounds.\n"),
        (failed, passed) => format!(
            "**Outside their bounds: {failed} of {} golden comparisons. This adapter draws or moves \
            differently than the tests allow.** They are the first rows below.\n",
            failed + passed
        ),
    };
    let count = |outcome| {
        let rows = report.rows.iter();
        rows.filter(|row| row.part != GOLDEN && row.outcome == outcome)
            .count()
    };
    let (failures, left_out) = (count(Outcome::Failed), count(Outcome::LeftOut));
    if failures > 0 {
        let _ = writeln!(
            text,
            "{failures} rows failed; their notes give the reasons."
        );
    }
    if left_out > 0 {
        let _ = writeln!(text, "{left_out} rows were left out for lack of memory.");
    }
    if report.ended_early {
        text += "The run was interrupted: rows are missing.\n";
    }
    text
}

/// Returns the table at the head of the page.
fn facts(report: &Report) -> Vec<(&'static str, String)> {
    let machine = &report.machine;
    let of_cpu = |m: &Machine| {
        let memory = rounded(m.memory_gb, 3);
        format!("{}, {} threads, {memory} GB of memory", m.cpu, m.threads)
    };
    let extent = if report.quick { "quick" } else { "full" };
    let mut facts = vec![
        ("adapter", machine.adapter_line()),
        ("processor", of_cpu(machine)),
        ("system", machine.system.clone()),
        ("Palpate", machine.palpate.clone()),
        ("date", report.date.clone()),
        ("run", format!("{extent}, {:.0} s", report.seconds)),
    ];
    if let Some(reference) = &report.reference {
        let (file, machine) = (reference.file.display(), &reference.machine);
        let line = format!(
            "{file}: {}; {}; Palpate {}; {}",
            machine.adapter_line(),
            of_cpu(machine),
            machine.palpate,
            reference.date
        );
        facts.push(("reference", line));
    }
    facts
}

/// Adds the table and the charts of a part.
fn section(text: &mut String, report: &Report, part: &Part, rows: &[&Row], charts: &[ChartName]) {
    let _ = write!(text, "\n## {}\n\n{}\n", part.title, part.about);
    let mut units: Vec<&str> = Vec::new();
    for row in rows {
        if !units.contains(&row.unit.as_str()) {
            units.push(&row.unit);
        }
    }
    for unit in units {
        let rows: Vec<&Row> = rows.iter().copied().filter(|r| r.unit == unit).collect();
        table(text, report, unit, &rows);
    }
    for (_, chart) in charts.iter().filter(|(name, _)| name == part.name) {
        let _ = write!(text, "\n![{}: {chart}]({chart}.svg)\n", part.title);
    }
}

/// Adds a table of rows with the same unit; columns without entries are left out.
fn table(text: &mut String, report: &Report, unit: &str, rows: &[&Row]) {
    let has = |of: fn(&Row) -> bool| rows.iter().any(|row| of(row));
    let has_size = has(|r| r.size.is_some());
    let has_bound = has(|r| r.bound.is_some());
    let has_paper = has(|r| r.paper.is_some());
    let has_reference = report.reference.is_some() && !has_bound;
    let mut header = vec!["what".to_owned(), "on".to_owned()];
    if has_size {
        header.push("size".into());
    }
    header.push(unit.into());
    if has_bound {
        header.push("bound".into());
    }
    if has_paper {
        header.extend(["paper".into(), "times better".into()]);
    }
    if has_reference {
        header.extend(["reference".into(), "times better".into()]);
    }
    header.extend(["outcome".into(), "note".into()]);
    text.push('\n');
    line(text, &header);
    line(text, &vec!["---".to_owned(); header.len()]);
    for row in rows {
        let short = |value: Option<f64>| value.map_or(String::new(), |v| rounded(v, 4));
        let mut cells = vec![row.what.clone(), row.on.clone()];
        if has_size {
            let size = row
                .size
                .map(|n| format!("{} {}", grouped(n), row.size_unit));
            cells.push(size.unwrap_or_default());
        }
        cells.push(with_range(row));
        if has_bound {
            cells.push(short(row.bound));
        }
        let times = |value| row.times_better_than(value).map(|t| rounded(t, 3));
        if has_paper {
            cells.extend([short(row.paper), times(row.paper).unwrap_or_default()]);
        }
        if has_reference {
            cells.push(short(row.reference));
            cells.push(times(row.reference).unwrap_or_default());
        }
        let outcome = row.outcome.word();
        cells.push(match row.outcome {
            Outcome::Measured | Outcome::Passed => outcome.into(),
            _ => format!("**{outcome}**"),
        });
        cells.push(row.note.clone());
        line(text, &cells);
    }
}

/// Returns the median, and the range of several repetitions.
fn with_range(row: &Row) -> String {
    let Some(median) = row.median else {
        return "–".into();
    };
    let short = |x: f64| rounded(x, 4);
    match (row.low, row.high) {
        (Some(low), Some(high)) if row.repetitions > 1 => format!(
            "{} ({}–{}, {}×)",
            short(median),
            short(low),
            short(high),
            row.repetitions
        ),
        _ => short(median),
    }
}

/// Returns a number with its thousands separated by commas.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Adds a line of a table.
fn line(text: &mut String, cells: &[String]) {
    let cells = cells.iter().map(|cell| cell.replace('|', "\\|"));
    let cells: Vec<String> = cells.map(|cell| cell.replace('\n', " ")).collect();
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_and_ranges_shown() {
        assert_eq!(grouped(7), "7");
        assert_eq!(grouped(112_299), "112,299");
        assert_eq!(grouped(15_768_648), "15,768,648");
        let one = Row::new("a", "gpu", "ms").value(2.0);
        assert_eq!(with_range(&one), "2");
        let spread = super::super::Spread::from_samples(vec![1.0, 2.0, 4.0]);
        assert_eq!(with_range(&one.spread(spread)), "2 (1–4, 3×)");
    }
}
