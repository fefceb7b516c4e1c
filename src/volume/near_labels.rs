//! Label maps whose values are integers but for rounding, as left by scaling or resampling.

use super::{MAX_LABELS, Raw, Volume};
use std::collections::BTreeMap;

/// Largest distance of a label in floating point from an integer.
const FLOAT_TOLERANCE: f64 = 1e-3;
/// The same for scaled integers, whose distance is up to half a step of the scaling.
const STEP_TOLERANCE: f64 = 1e-2;

impl Volume {
    /// Rounds the values of a label map that are integers but for rounding, with a note. Volumes of
    /// other values, and those with integers, stay as they are.
    pub fn round_near_labels(&mut self) {
        let Some((labels, farthest)) = self.near_labels() else {
            return;
        };
        let rounded = (0..self.voxels()).map(|n| self.value(n).round() as i64);
        self.raw = Raw::of_labels(rounded, labels.keys().copied());
        (self.slope, self.intercept) = (1.0, 0.0);
        self.notes.push(format!(
            "values within {farthest:.1e} of {} integers were rounded to them: a label map",
            labels.len()
        ));
    }

    /// Returns the labels that all values are near to, with one value each, and the largest distance
    /// from them; `None` if there are other values, or if all are integers.
    fn near_labels(&self) -> Option<(BTreeMap<i64, f64>, f64)> {
        let float = matches!(self.raw, Raw::F32(_) | Raw::F64(_));
        let tolerance = match float {
            true => FLOAT_TOLERANCE,
            false => (0.51 * self.slope.abs()).clamp(FLOAT_TOLERANCE, STEP_TOLERANCE),
        };
        if !float && (self.slope.fract(), self.intercept.fract()) == (0.0, 0.0) {
            return None;
        }
        let mut labels: BTreeMap<i64, f64> = BTreeMap::new();
        let mut farthest = 0f64;
        let mut last = f64::NAN;
        for n in 0..self.voxels() {
            let value = self.value(n);
            if value == last {
                continue;
            }
            last = value;
            let label = value.round();
            let off = (value - label).abs();
            if !(off <= tolerance && label.abs() <= 1e15) {
                return None;
            }
            farthest = farthest.max(off);
            let first = *labels.entry(label as i64).or_insert(value);
            // Scaling gives each label one value; neighbouring values of a fine scale are not labels.
            if labels.len() > MAX_LABELS || (!float && first != value) {
                return None;
            }
        }
        // Small values alone, such as displacements in metres, are not the label 0.
        let some = labels.keys().any(|label| *label != 0);
        (some && farthest > 0.0).then_some((labels, farthest))
    }
}

impl Raw {
    /// Encodes labels in the smallest type of a few that holds `all` of them.
    pub(crate) fn of_labels(
        labels: impl Iterator<Item = i64>,
        all: impl Iterator<Item = i64>,
    ) -> Raw {
        let [low, high] = all.fold([0, 0], |[low, high], l| [low.min(l), high.max(l)]);
        if low >= 0 && high <= i64::from(u8::MAX) {
            Raw::U8(labels.map(|l| l as u8).collect())
        } else if low >= i64::from(i16::MIN) && high <= i64::from(i16::MAX) {
            Raw::I16(labels.map(|l| l as i16).collect())
        } else {
            Raw::I64(labels.collect())
        }
    }
}
