//! Cases: what a part measures one after the other, in the process that owns the device.

use super::machine::available_memory;
use super::{Outcome, Part, Row, Timing};
use crate::gpu::Gpu;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use std::path::Path;

/// What a case needs to measure.
pub struct Context<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Fewer and smaller cases, with fewer repetitions.
    pub quick: bool,
    /// Folder with golden pictures in place of those in the program.
    pub goldens: Option<&'a Path>,
}

impl Context<'_> {
    /// Returns how often calls are repeated.
    pub fn timing(&self) -> Timing {
        Timing::new(self.quick)
    }
}

type Measure = Box<dyn FnOnce(&Context, Row) -> Result<Vec<Row>>>;

/// One case: a row without values, and the function that measures it.
pub struct Case {
    /// The row; without values if the case fails.
    pub row: Row,
    /// Memory that it needs, in bytes.
    memory: u64,
    measure: Measure,
}

impl fmt::Debug for Case {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Case").field("row", &self.row).finish()
    }
}

impl Case {
    /// A case of one row.
    pub fn new(row: Row, measure: impl FnOnce(&Context, Row) -> Result<Row> + 'static) -> Case {
        Case::of_rows(row, |context, row| Ok(vec![measure(context, row)?]))
    }

    /// A case that measures several rows at once; `row` takes their place if it fails.
    pub fn of_rows(
        row: Row,
        measure: impl FnOnce(&Context, Row) -> Result<Vec<Row>> + 'static,
    ) -> Case {
        Case {
            row,
            memory: 0,
            measure: Box::new(measure),
        }
    }

    /// With the memory that it needs, in bytes; it is left out where less is available.
    pub fn memory(mut self, bytes: u64) -> Case {
        self.memory = bytes;
        self
    }

    /// Measures the case; returns its rows, and whether the device is lost.
    fn run(self, context: &Context) -> (Vec<Row>, bool) {
        if let Some(there) = available_memory().filter(|there| *there < self.memory) {
            let gigabytes = |bytes: u64| bytes as f64 * 1e-9;
            let reason = format!(
                "needs about {:.1} GB of memory, {:.1} GB are available",
                gigabytes(self.memory),
                gigabytes(there)
            );
            return (vec![self.row.ended(Outcome::LeftOut, reason)], false);
        }
        let label = self.row.clone();
        let measured = (self.measure)(context, self.row)
            // Errors that the driver reports later belong to this case, too.
            .and_then(|rows| context.gpu.wait().map(|()| rows));
        match measured {
            Ok(rows) => (rows, false),
            Err(error) => {
                let lost = matches!(error, Error::DeviceLost(_));
                let row = label.ended(Outcome::Failed, error.to_string());
                (vec![row], lost)
            }
        }
    }
}

/// The rows of a measured case, as sent from the process of a part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// Index of the case in its part.
    pub case: usize,
    /// Its rows.
    pub rows: Vec<Row>,
    /// Whether the device is lost, so that the next case needs another process.
    pub lost: bool,
}

/// Measures the cases of `part` with these indices, and sends the rows of each. Ends early if the
/// device is lost.
///
/// # Errors
/// As `send`. Errors of a case are sent as its row.
pub fn run_part(
    context: &Context,
    part: &Part,
    indices: Range<usize>,
    send: &mut dyn FnMut(&Message) -> Result<()>,
) -> Result<()> {
    let cases = (part.cases)(context.quick).into_iter().enumerate();
    for (case, todo) in cases.filter(|(k, _)| indices.contains(k)) {
        let (mut rows, lost) = todo.run(context);
        rows.iter_mut().for_each(|row| row.part = part.name.into());
        send(&Message { case, rows, lost })?;
        if lost {
            break;
        }
    }
    Ok(())
}
