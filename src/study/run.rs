//! One run of a study: what it measures on, where it writes, how far it is.

use super::csv_table::{Cell, CsvTable, Row};
use crate::Result;
use crate::gpu::Gpu;
use crate::io::atomic_write;
use std::io::Write;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Where a study runs, and how.
pub struct Run<'a> {
    /// What is measured on.
    pub gpu: &'a Gpu,
    /// The folder for CSV, charts and findings; it exists.
    pub dir: &'a Path,
    /// Few and small points, for a look and for CI.
    pub quick: bool,
    /// Told what is being measured and which fraction of it is done.
    pub progress: &'a (dyn Fn(&str, f64) + Sync),
    /// Told what a user should know, a sentence each.
    pub note: &'a (dyn Fn(&str) + Sync),
    /// Set from outside to end early: what was measured is kept, and drawn.
    pub stop: &'a AtomicBool,
}

impl Run<'_> {
    /// Whether the run is to end early.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Measures each of `points`, its settings, that `NAME.csv` does not have yet from this
    /// adapter, and adds a row for it: settings, results, adapter, date. Ends early when the run
    /// is stopped. Returns the rows of those points that are measured, in order.
    ///
    /// # Errors
    /// Whatever `measure` returns, a file that cannot be written, or one of other columns.
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

    /// Tells the user something beside the result.
    pub fn report_note(&self, text: &str) {
        (self.note)(text);
    }

    /// Writes `NAME.md`: a heading, what was found in numbers, and the `charts`, by the names
    /// they were saved under.
    ///
    /// # Errors
    /// A file that cannot be written.
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
