//! One run of a study: device, output folder and progress.

use super::csv_table::{Cell, CsvTable, Row};
use crate::Result;
use crate::gpu::Gpu;
use crate::io::atomic_write;
use std::io::Write;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Context of a study run.
pub struct Run<'a> {
    /// The device to measure on.
    pub gpu: &'a Gpu,
    /// The folder for CSV, charts and findings; it exists.
    pub dir: &'a Path,
    /// Fewer and smaller points, for a quick look and for CI.
    pub quick: bool,
    /// Receives the current measurement and the completed fraction.
    pub progress: &'a (dyn Fn(&str, f64) + Sync),
    /// Receives notes for the user, a sentence each.
    pub note: &'a (dyn Fn(&str) + Sync),
    /// Set from outside to stop early; measured points are kept and charted.
    pub stop: &'a AtomicBool,
}

impl Run<'_> {
    /// Whether the run has to stop early.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Measures each of `points` (settings) that `NAME.csv` does not have yet from this adapter,
    /// and adds a row for it: settings, results, adapter, date. Stops early when the run is
    /// stopped. Returns the rows of the measured points, in order.
    ///
    /// # Errors
    /// As `measure`; an error if a file cannot be written or has other columns.
    pub fn measure(
        &self,
        name: &str,
        settings: &[&str],
        results: &[&str],
        points: &[Vec<Cell>],
        mut measure: impl FnMut(&[Cell]) -> Result<Vec<Cell>>,
    ) -> Result<Vec<Row>> {
        let path = self.dir.join(format!("{name}.csv"));
        let adapter = self.gpu.adapter_name();
        let mut sheet = CsvTable::open(&path, settings, results)?;
        let mut rows = Vec::with_capacity(points.len());
        for (i, point) in points.iter().enumerate() {
            if sheet.row(point, &adapter).is_none() && !self.stopped() {
                (self.progress)(name, i as f64 / points.len() as f64);
                let results = measure(point)?;
                sheet.push(point, &results, &adapter)?;
            }
            rows.extend(sheet.row(point, &adapter));
        }
        Ok(rows)
    }

    /// Reports a note to the user.
    pub fn report_note(&self, text: &str) {
        (self.note)(text);
    }

    /// Writes `NAME.md`: a heading, the findings, and the `charts`, given by file name.
    ///
    /// # Errors
    /// An error if a file cannot be written.
    pub fn write_findings(
        &self,
        name: &str,
        title: &str,
        text: &str,
        charts: &[&str],
    ) -> Result<()> {
        let path = self.dir.join(format!("{name}.md"));
        let unfinished = match self.stopped() {
            true => "\n\nStopped early: some points are missing.",
            false => "",
        };
        let charts = charts.iter().map(|c| format!("\n![{c}]({c}.svg)\n"));
        let charts: String = charts.collect();
        atomic_write(&path, |file| {
            let adapter = self.gpu.adapter_name();
            write!(
                file,
                "# {title}\n\n{text}{unfinished}\n\nMeasured on {adapter}.\n{charts}"
            )
            .map_err(crate::Error::io(&path))
        })
    }
}
