//! CSV tables of studies: each measured point with its settings, results, adapter and date.

use crate::io::atomic_write;
use crate::{Error, Result};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Columns after those of the study.
const PROVENANCE_COLUMNS: [&str; 2] = ["adapter", "date"];

/// One entry of a [`Row`].
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// A text.
    Text(String),
    /// A number, in the unit of its column.
    Number(f64),
}

impl Cell {
    /// Returns the number; NaN for a text.
    pub fn number(&self) -> f64 {
        match self {
            Cell::Number(value) => *value,
            Cell::Text(_) => f64::NAN,
        }
    }

    /// Returns the text; empty for a number.
    pub fn text(&self) -> &str {
        match self {
            Cell::Text(text) => text,
            Cell::Number(_) => "",
        }
    }

    fn parse(entry: &str) -> Cell {
        match entry.parse() {
            Ok(value) => Cell::Number(value),
            Err(_) => Cell::Text(entry.to_owned()),
        }
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Cell::Text(text) => text.fmt(f),
            // The shortest form that parses back to the same number.
            Cell::Number(value) => value.fmt(f),
        }
    }
}

/// Rounds a number to so many significant digits.
pub(super) fn significant(value: f64, digits: usize) -> f64 {
    let text = format!("{value:.*e}", digits - 1);
    text.parse().unwrap_or(value)
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Cell {
        Cell::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(value: f64) -> Cell {
        Cell::Number(value)
    }
}

impl From<usize> for Cell {
    fn from(value: usize) -> Cell {
        Cell::Number(value as f64)
    }
}

/// A measured point: its settings and results by column name.
#[derive(Clone, Debug)]
pub struct Row(HashMap<String, Cell>);

impl Row {
    /// Returns the number in `column`; NaN if there is none.
    pub fn number(&self, column: &str) -> f64 {
        self.0.get(column).map_or(f64::NAN, Cell::number)
    }

    /// Returns the text in `column`; empty if there is none.
    pub fn text(&self, column: &str) -> &str {
        self.0.get(column).map_or("", Cell::text)
    }
}

/// The CSV of a study, in memory and on disk.
pub(super) struct CsvTable {
    path: PathBuf,
    columns: Vec<String>,
    settings: usize,
    entries: Vec<Vec<String>>,
    /// Index of each point in `entries`, by its settings and adapter.
    places: HashMap<Vec<String>, usize>,
}

impl CsvTable {
    /// Opens the table at `path` with its existing rows.
    pub fn open(path: &Path, settings: &[&str], results: &[&str]) -> Result<CsvTable> {
        let columns = settings.iter().chain(results).chain(&PROVENANCE_COLUMNS);
        let columns: Vec<String> = columns.map(|c| (*c).to_owned()).collect();
        let mut sheet = CsvTable {
            path: path.to_path_buf(),
            columns,
            settings: settings.len(),
            entries: Vec::new(),
            places: HashMap::new(),
        };
        if path.exists() {
            sheet.read()?;
        }
        Ok(sheet)
    }

    fn read(&mut self) -> Result<()> {
        let wrong = |e: csv::Error| Error::format(&self.path, e.to_string());
        let mut reader = csv::Reader::from_path(&self.path).map_err(wrong)?;
        if reader.headers().map_err(wrong)?.iter().ne(&self.columns) {
            return Err(Error::format(
                &self.path,
                format!(
                    "columns must be those of this study ({}); move the file away, or set another folder with --out",
                    self.columns.join(", ")
                ),
            ));
        }
        let mut entries = Vec::new();
        for record in reader.records() {
            entries.push(record.map_err(wrong)?.iter().map(str::to_owned).collect());
        }
        entries.into_iter().for_each(|entry| self.add(entry));
        Ok(())
    }

    fn add(&mut self, entry: Vec<String>) {
        let mut key = entry[..self.settings].to_vec();
        key.push(entry[entry.len() - PROVENANCE_COLUMNS.len()].clone());
        self.places.insert(key, self.entries.len());
        self.entries.push(entry);
    }

    /// Returns the row of a point on `adapter`, if it was measured.
    pub fn row(&self, settings: &[Cell], adapter: &str) -> Option<Row> {
        let mut key: Vec<String> = settings.iter().map(Cell::to_string).collect();
        key.push(adapter.to_owned());
        let entry = &self.entries[*self.places.get(&key)?];
        let cells = entry.iter().map(|e| Cell::parse(e));
        Some(Row(self.columns.iter().cloned().zip(cells).collect()))
    }

    /// Adds a point and writes the file.
    pub fn push(&mut self, settings: &[Cell], results: &[Cell], adapter: &str) -> Result<()> {
        if settings.len() + results.len() + PROVENANCE_COLUMNS.len() != self.columns.len() {
            return Err(Error::Input(format!(
                "row of {} must fill all columns: got {} settings and {} results for {} columns",
                self.path.display(),
                settings.len(),
                results.len(),
                self.columns.len() - PROVENANCE_COLUMNS.len()
            )));
        }
        let date = time::OffsetDateTime::now_utc().date().to_string();
        let cells = settings.iter().chain(results).map(Cell::to_string);
        self.add(cells.chain([adapter.to_owned(), date]).collect());
        atomic_write(&self.path, |file| {
            let mut writer = csv::Writer::from_writer(file);
            let wrong = |e: csv::Error| Error::format(&self.path, e.to_string());
            writer.write_record(&self.columns).map_err(wrong)?;
            for entry in &self.entries {
                writer.write_record(entry).map_err(wrong)?;
            }
            writer.flush().map_err(Error::io(&self.path))
        })
    }
}
