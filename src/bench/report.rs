//! The report of a benchmark, as JSON, CSV, a page and charts.

use super::{GOLDEN, Machine, Outcome, Row, charts, page};
use crate::io::atomic_write;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Columns of `bench.csv`.
const COLUMNS: [&str; 17] = [
    "part",
    "what",
    "on",
    "size",
    "size_unit",
    "unit",
    "median",
    "low",
    "high",
    "repetitions",
    "paper",
    "times_better_than_paper",
    "reference",
    "times_better_than_reference",
    "bound",
    "outcome",
    "note",
];

/// The report that rows are compared with.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Reference {
    /// Its file.
    pub file: PathBuf,
    /// Its machine.
    pub machine: Machine,
    /// Its date.
    pub date: String,
}

/// The measured rows, and what they were measured on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Report {
    /// Date and time of the start, UTC.
    pub date: String,
    /// Whether fewer and smaller cases were measured.
    pub quick: bool,
    /// Whether it was interrupted.
    pub ended_early: bool,
    /// Seconds from start to end.
    pub seconds: f64,
    /// The machine.
    pub machine: Machine,
    /// The report that rows are compared with.
    pub reference: Option<Reference>,
    /// The rows: golden comparisons that do not pass first, then in the order of the parts.
    pub rows: Vec<Row>,
}

impl Report {
    /// A report without rows, dated now.
    pub fn new(machine: Machine, quick: bool) -> Report {
        let now = time::OffsetDateTime::now_utc();
        let (hour, minute, _) = now.to_hms();
        Report {
            date: format!("{} {hour:02}:{minute:02} UTC", now.date()),
            quick,
            machine,
            ..Report::default()
        }
    }

    /// Reads the `bench.json` of another run.
    ///
    /// # Errors
    /// An error if the file cannot be read or is no report with rows.
    pub fn read(path: &Path) -> Result<Report> {
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let wrong = |what: String| {
            Error::format(
                path,
                format!("{what}; expected the bench.json of `palpate bench`"),
            )
        };
        let report: Report =
            serde_json::from_str(&text).map_err(|e| wrong(format!("not a report: {e}")))?;
        match report.rows.is_empty() {
            true => Err(wrong("the report has no rows".into())),
            false => Ok(report),
        }
    }

    /// Adds rows, with the values of the same rows in `reference`.
    pub fn add(&mut self, rows: Vec<Row>, reference: Option<&Report>) {
        for mut row in rows {
            let mut others = reference.iter().flat_map(|r| &r.rows);
            let same = others.find(|other| other.is_same_as(&row));
            row.reference = same.and_then(|same| same.median);
            self.rows.push(row);
        }
        self.rows.sort_by_key(|row| !is_golden_failure(row));
    }

    /// Returns the golden comparisons that do not pass.
    pub fn golden_failures(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| is_golden_failure(row))
    }

    /// Returns the number of golden comparisons that pass.
    pub fn golden_passes(&self) -> usize {
        let golden = self.rows.iter().filter(|row| row.part == GOLDEN);
        golden.filter(|row| row.outcome == Outcome::Passed).count()
    }

    /// Writes `bench.json` to the folder.
    ///
    /// # Errors
    /// An error if the file cannot be written.
    pub fn write_json(&self, dir: &Path) -> Result<()> {
        let path = dir.join("bench.json");
        atomic_write(&path, |file| {
            serde_json::to_writer_pretty(&mut *file, self)
                .map_err(|e| Error::format(&path, e.to_string()))?;
            writeln!(file).map_err(Error::io(&path))
        })
    }

    /// Writes `bench.json`, `bench.csv`, `bench.md` and its charts to the folder.
    ///
    /// # Errors
    /// An error if a file cannot be written.
    pub fn write(&self, dir: &Path) -> Result<()> {
        self.write_json(dir)?;
        self.write_csv(&dir.join("bench.csv"))?;
        let charts = charts::draw(self, dir)?;
        let path = dir.join("bench.md");
        let text = page::markdown(self, &charts);
        atomic_write(&path, |file| {
            file.write_all(text.as_bytes()).map_err(Error::io(&path))
        })
    }

    fn write_csv(&self, path: &Path) -> Result<()> {
        atomic_write(path, |file| {
            let mut writer = csv::Writer::from_writer(file);
            let wrong = |e: csv::Error| Error::format(path, e.to_string());
            writer.write_record(COLUMNS).map_err(wrong)?;
            for row in &self.rows {
                writer.write_record(record(row)).map_err(wrong)?;
            }
            writer.flush().map_err(Error::io(path))
        })
    }
}

/// Whether a row is a golden comparison that does not pass.
fn is_golden_failure(row: &Row) -> bool {
    row.part == GOLDEN && row.outcome != Outcome::Passed
}

/// Returns the entries of a row in the order of the columns.
fn record(row: &Row) -> [String; COLUMNS.len()] {
    let number = |value: Option<f64>| value.map_or(String::new(), |v| v.to_string());
    [
        row.part.clone(),
        row.what.clone(),
        row.on.clone(),
        row.size.map_or(String::new(), |n| n.to_string()),
        row.size_unit.clone(),
        row.unit.clone(),
        number(row.median),
        number(row.low),
        number(row.high),
        row.repetitions.to_string(),
        number(row.paper),
        number(row.times_better_than(row.paper)),
        number(row.reference),
        number(row.times_better_than(row.reference)),
        number(row.bound),
        row.outcome.word().into(),
        row.note.clone(),
    ]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn row(part: &str, what: &str, value: f64) -> Row {
        Row {
            part: part.into(),
            ..Row::new(what, "gpu", "ms").size(10, "tets").value(value)
        }
    }

    #[test]
    fn failed_golden_comparison_is_the_first_row() {
        let mut report = Report::default();
        let golden = |value: f64| Row {
            part: GOLDEN.into(),
            ..Row::new("picture", "gpu", "1/255")
                .bound(1.0)
                .judged(value, true)
        };
        report.add(vec![golden(0.5)], None);
        report.add(vec![row("raycast", "plain", 3.0)], None);
        assert_eq!(
            (report.golden_failures().count(), report.golden_passes()),
            (0, 1)
        );
        report.add(vec![golden(1.5)], None);
        assert_eq!(report.rows[0].outcome, Outcome::Differs);
        assert_eq!(
            (report.golden_failures().count(), report.golden_passes()),
            (1, 1)
        );
        assert!(page::markdown(&report, &[]).contains("**Outside their bounds: 1 of 2 golden"));
    }

    #[test]
    fn rows_get_the_values_of_the_same_rows_only() {
        let mut reference = Report::default();
        reference.add(
            vec![row("raycast", "plain", 8.0), row("raycast", "lit", 9.0)],
            None,
        );
        let mut report = Report::default();
        let mut other = row("raycast", "lit", 4.0);
        other.size = Some(20);
        report.add(vec![row("raycast", "plain", 4.0), other], Some(&reference));
        assert_eq!(report.rows[0].reference, Some(8.0));
        assert_eq!(report.rows[0].times_better_than(Some(8.0)), Some(2.0));
        assert_eq!(report.rows[1].reference, None);
    }

    #[test]
    fn report_survives_its_json() {
        let folder = tempfile::tempdir().unwrap();
        let mut report = Report::new(Machine::default(), true);
        report.add(vec![row("raycast", "plain", 8.0)], None);
        report.add(vec![row("raycast", "lit", f64::NAN)], None);
        report.write(folder.path()).unwrap();
        let read = Report::read(&folder.path().join("bench.json")).unwrap();
        // JSON has no NaN.
        assert_eq!(read.rows[1].median, None);
        assert_eq!(read.rows[0], report.rows[0]);
        let bad = folder.path().join("bad.json");
        std::fs::write(&bad, "{}").unwrap();
        let error = Report::read(&bad).unwrap_err().to_string();
        assert!(
            error.contains("no rows") && error.contains("bench.json"),
            "{error}"
        );
    }
}
