//! Rows of the report: one measured quantity each.

use super::timing::Spread;
use serde::{Deserialize, Serialize};

/// How the measurement of a row ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It was measured.
    #[default]
    Measured,
    /// A golden comparison within its bounds.
    Passed,
    /// A golden comparison outside its bounds.
    Differs,
    /// It ended in an error or a crash; the note gives the reason.
    Failed,
    /// It was not started; the note gives the reason.
    LeftOut,
}

impl Outcome {
    /// Returns the outcome as a word.
    pub fn word(self) -> &'static str {
        match self {
            Outcome::Measured => "measured",
            Outcome::Passed => "passed",
            Outcome::Differs => "differs",
            Outcome::Failed => "failed",
            Outcome::LeftOut => "left out",
        }
    }
}

/// One measured quantity with its spread, next to the paper's and a reference file's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Row {
    /// The part of the benchmark.
    pub part: String,
    /// What was measured.
    pub what: String,
    /// Where it ran: `gpu`, `cpu`, or a loop.
    pub on: String,
    /// Size of the problem, in `size_unit`.
    pub size: Option<u64>,
    /// What is counted by `size`: tets, particles, faces.
    pub size_unit: String,
    /// Median of the repetitions, in `unit`.
    pub median: Option<f64>,
    /// Smallest repetition.
    pub low: Option<f64>,
    /// Largest repetition.
    pub high: Option<f64>,
    /// Number of repetitions.
    pub repetitions: usize,
    /// Unit of the values; those that end in `/s` are better if larger, the others if smaller.
    pub unit: String,
    /// Largest value of a golden comparison that passes.
    pub bound: Option<f64>,
    /// The paper's value for about this size.
    pub paper: Option<f64>,
    /// The value of the reference file.
    pub reference: Option<f64>,
    /// How the measurement ended.
    pub outcome: Outcome,
    /// Details in words: iterations, reasons.
    pub note: String,
}

impl Row {
    /// A row to be measured.
    pub fn new(what: impl Into<String>, on: &str, unit: &str) -> Row {
        Row {
            what: what.into(),
            on: on.into(),
            unit: unit.into(),
            ..Row::default()
        }
    }

    /// With the size of the problem.
    pub fn size(mut self, size: usize, unit: &str) -> Row {
        (self.size, self.size_unit) = (Some(size as u64), unit.into());
        self
    }

    /// With the paper's value, if there is one.
    pub fn paper(mut self, value: Option<f64>) -> Row {
        self.paper = value;
        self
    }

    /// With the largest value that passes.
    pub fn bound(mut self, bound: f64) -> Row {
        self.bound = Some(bound);
        self
    }

    /// With a note.
    pub fn note(mut self, note: impl Into<String>) -> Row {
        self.note = note.into();
        self
    }

    /// With the measured values.
    pub fn spread(mut self, spread: Spread) -> Row {
        self.median = Some(spread.median);
        self.low = Some(spread.low);
        self.high = Some(spread.high);
        self.repetitions = spread.repetitions;
        self
    }

    /// With a single value.
    pub fn value(self, value: f64) -> Row {
        self.spread(Spread::from_samples(vec![value]))
    }

    /// With the value of a golden comparison, which passes if the value is within the bound and
    /// `otherwise` holds.
    pub fn judged(mut self, value: f64, otherwise: bool) -> Row {
        // NaN is within no bound.
        let passes = otherwise && self.bound.is_some_and(|bound| value <= bound);
        self.outcome = match passes {
            true => Outcome::Passed,
            false => Outcome::Differs,
        };
        self.value(value)
    }

    /// That was not measured, with the reason.
    pub fn ended(mut self, outcome: Outcome, reason: impl Into<String>) -> Row {
        (self.outcome, self.note) = (outcome, reason.into());
        self
    }

    /// Whether larger values are better.
    pub fn is_rate(&self) -> bool {
        self.unit.ends_with("/s")
    }

    /// Returns how many times better the median is than `other`, if both are positive.
    pub fn times_better_than(&self, other: Option<f64>) -> Option<f64> {
        let (own, other) = (self.median?, other?);
        let times = match self.is_rate() {
            true => own / other,
            false => other / own,
        };
        (self.bound.is_none() && times.is_finite() && times > 0.0).then_some(times)
    }

    /// Whether `other` measures the same quantity.
    pub fn is_same_as(&self, other: &Row) -> bool {
        let key = |row: &Row| (row.size, row.size_unit.clone(), row.unit.clone());
        (&self.part, &self.what, &self.on) == (&other.part, &other.what, &other.on)
            && key(self) == key(other)
    }

    /// Returns the row in words, without its values.
    pub fn label(&self) -> String {
        let mut label = self.what.clone();
        if !self.on.is_empty() {
            label += &format!(", {}", self.on);
        }
        if let Some(size) = self.size {
            label += &format!(", {size} {}", self.size_unit);
        }
        label
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_row_passes_only_within_its_bounds() {
        let row = || Row::new("picture", "gpu", "1/255").bound(1.0);
        assert_eq!(row().judged(1.0, true).outcome, Outcome::Passed);
        assert_eq!(row().judged(1.1, true).outcome, Outcome::Differs);
        assert_eq!(row().judged(0.5, false).outcome, Outcome::Differs);
        assert_eq!(row().judged(f64::NAN, true).outcome, Outcome::Differs);
    }

    #[test]
    fn ratio_is_above_one_for_higher_rates_and_shorter_times() {
        let rate = Row::new("a", "gpu", "steps/s").value(30.0);
        assert_eq!(rate.times_better_than(Some(10.0)), Some(3.0));
        let time = Row::new("a", "gpu", "ms").value(5.0);
        assert_eq!(time.times_better_than(Some(10.0)), Some(2.0));
        assert_eq!(time.times_better_than(None), None);
        assert_eq!(time.times_better_than(Some(0.0)), None);
    }
}
