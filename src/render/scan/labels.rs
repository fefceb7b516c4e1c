//! Label maps: label numbering and appearance.

use crate::volume::Volume;
use crate::{Error, Result, parallel};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of distinct labels in a texture; same value as in `shaders/terms/scan.wgsl`.
const MAX_LABELS: usize = 1024;

/// Appearance of a label of a [`Scan`](super::Scan).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelAppearance {
    /// Red, green and blue, from 0 to 1.
    pub colour: [f64; 3],
    /// Extinction per length unit of the mesh.
    pub extinction: f64,
}

impl LabelAppearance {
    pub(super) fn check(&self, label: i64) -> Result<()> {
        let unit = |x: &f64| (0.0..=1.0).contains(x);
        let sound = self.colour.iter().all(unit)
            && self.extinction.is_finite()
            && (0.0..1e30).contains(&self.extinction);
        match sound {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "label {label}: colour components must be 0 to 1 and extinction finite and ≥ 0, got {:?} and {}",
                self.colour, self.extinction
            ))),
        }
    }
}

/// Distinct labels of a volume in ascending order; the index is the label number.
#[derive(Clone, Debug)]
pub(super) struct LabelIndex {
    labels: Vec<i64>,
}

impl LabelIndex {
    /// Collects the labels of `volume`.
    pub fn of(volume: &Volume) -> Result<LabelIndex> {
        let found = parallel::collect(volume.voxels(), |range, parts| {
            let mut chunk_labels: Option<BTreeSet<i64>> = Some(BTreeSet::new());
            let mut last = None;
            for n in range {
                let value = volume.value(n);
                if last == Some(value) {
                    continue;
                }
                last = Some(value);
                let whole = value.fract() == 0.0 && value.abs() < 1e15;
                chunk_labels =
                    chunk_labels.filter(|chunk_labels| whole && chunk_labels.len() <= MAX_LABELS);
                if let Some(chunk_labels) = &mut chunk_labels {
                    chunk_labels.insert(value as i64);
                }
            }
            parts.push(chunk_labels);
        });
        let mut all = BTreeSet::new();
        for part in found {
            match part {
                Some(labels) => all.extend(labels),
                None => all.extend(0..=MAX_LABELS as i64),
            }
        }
        if all.len() > MAX_LABELS {
            return Err(Error::Input(format!(
                "the scan is not a label map: label maps hold integers and at most {MAX_LABELS} distinct values; show its values"
            )));
        }
        Ok(LabelIndex {
            labels: all.into_iter().collect(),
        })
    }

    /// Returns the number of the label of a voxel value.
    pub fn number(&self, value: f64) -> usize {
        let below = self.labels.partition_point(|l| *l < value as i64);
        below.min(self.labels.len() - 1)
    }

    /// Returns the texel value of a label number: a fraction, so that neighbouring values stay
    /// accurate where texture filters round.
    pub fn to_texel(number: usize) -> f64 {
        number as f64 / MAX_LABELS as f64
    }

    /// Returns the label number of a texel value.
    pub fn from_texel(texel: f32) -> usize {
        (texel * MAX_LABELS as f32).round() as usize
    }

    /// Returns the appearance per label number; extinction 0 for labels that are not shown.
    pub fn appearances(&self, looks: &BTreeMap<i64, LabelAppearance>) -> Vec<LabelAppearance> {
        let unseen = LabelAppearance {
            colour: [0.0; 3],
            extinction: 0.0,
        };
        let look = |label| looks.get(label).copied().unwrap_or(unseen);
        self.labels.iter().map(look).collect()
    }
}
