//! Loads the scans of a scene, ready to be embedded.

use super::regions::colour_of;
use super::{LabelAppearanceEntry, ScalarField, ScanEntry, Scene, Unit};
use crate::mesh::TetMesh;
use crate::render::{LabelAppearance, Scan, ScanAppearance, TransferFunction, named_colour};
use crate::volume::Volume;
use crate::{Error, Result, io};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Largest number of different integers in a scan that is taken for a label map by default.
const MAX_LABEL_VALUES: usize = 64;
/// Default opacity over the mean chord length of a label: for a single scan, and for several scans.
const SINGLE_SCAN_OPACITY: f64 = 0.9;
const MULTI_SCAN_OPACITY: f64 = 0.5;
/// Transmittance of a label of opacity 1.
const CLEAR: f64 = 1e-4;
/// Average ratio of the surface area of voxels to that of the smooth surface they approximate.
const VOXEL_SURFACE_RATIO: f64 = 1.5;
/// Half width of the scalar range with the colour of one label in a legend.
const PLATEAU: f64 = 0.35;

/// The scans of a scene.
pub(super) struct SceneScans {
    pub scans: Vec<Scan>,
    /// Field of the first scan, for a legend; its values are not at the nodes.
    pub seen: ScalarField,
    pub notes: Vec<String>,
}

impl Scene {
    /// Returns the scans embedded in the body of the scene; `None` without scans.
    /// Long because it sets every property of a scan once.
    pub(super) fn scans(&self, mesh: &TetMesh) -> Result<Option<SceneScans>> {
        if self.scan.is_empty() {
            return Ok(None);
        }
        let unit = self.mesh.unit.as_ref().map(Unit::metres).transpose()?;
        let units_per_mm = 1e-3 / unit.or(mesh.length_unit).unwrap_or(1e-3);
        let mut notes = Vec::new();
        if self.picture.field.is_some() {
            notes.push("rendering the scan; --field and [picture] field are ignored".to_owned());
        }
        if self.mesh.file.is_some() && mesh.frame.is_none() {
            notes.push(
                "mesh states no frame of reference: its coordinates are taken as RAS, as those of \
                the scan; otherwise set --frame lps, or frame = \"lps\" in [mesh]"
                    .to_owned(),
            );
        }
        // In these modes the first scan is taken for values, unless it is set to labels.
        let mode = self.picture.mode.as_deref();
        let sums_values = matches!(mode, Some("mip" | "minip" | "mean" | "xray"));
        let mut read = Vec::new();
        for entry in &self.scan {
            let volume = match &entry.volume.0 {
                Some(volume) => volume.clone(),
                None => Arc::new(io::read_volume_number(&entry.file, entry.number)?),
            };
            let with_name = |note: &String| format!("{}: {note}", entry.called());
            notes.extend(volume.notes.iter().map(with_name));
            let named = |e| Error::Input(format!("[scan] {}: {e}", entry.file.display()));
            let values = sums_values && read.is_empty();
            let labels = entry.has_labels(&volume, values).map_err(named)?;
            read.push((entry, volume, labels));
        }
        let alone = read.len() == 1;
        let (mut scans, mut seen) = (Vec::new(), None);
        for (k, (entry, volume, labels)) in read.into_iter().enumerate() {
            let named = |e| Error::Input(format!("[scan] {}: {e}", entry.file.display()));
            let name = entry.called();
            let (look, field) = match labels {
                Some(labels) => {
                    notes.extend(entry.labels_note(&name, labels.len()));
                    let opacity = if alone {
                        SINGLE_SCAN_OPACITY
                    } else {
                        MULTI_SCAN_OPACITY
                    };
                    let looks = entry.label_looks(&volume, &labels, opacity, units_per_mm);
                    let looks = looks.map_err(named)?;
                    let field = label_field(&name, &volume, &looks)?;
                    if alone && looks.is_empty() {
                        return Err(Error::Input(format!(
                            "[scan] {name}: all labels are hidden"
                        )));
                    }
                    (ScanAppearance::Labels(looks), field)
                }
                None => {
                    let (transfer, range) = self.scan_transfer(entry, k == 0)?;
                    let look = ScanAppearance::Values {
                        transfer: transfer.clone(),
                        range: range.map(|[low, high]| (low, high)),
                    };
                    (look, value_field(&name, transfer))
                }
            };
            let scan = Scan {
                volume,
                units_per_mm,
                appearance: look,
            };
            let field = ScalarField {
                range: match field.regions.len() {
                    0 => scan.range(),
                    n => (0.0, n as f64 - 1.0),
                },
                values: vec![0.0; mesh.nodes.len()],
                ..field
            };
            seen.get_or_insert(field);
            scans.push(scan);
        }
        Ok(seen.map(|seen| SceneScans { scans, seen, notes }))
    }

    /// Returns the transfer function and the range of a scan that displays values; those of the
    /// picture are the defaults of the first scan.
    fn scan_transfer(
        &self,
        entry: &ScanEntry,
        first: bool,
    ) -> Result<(TransferFunction, Option<[f64; 2]>)> {
        let named = |e| Error::Input(format!("[scan] {}: {e}", entry.file.display()));
        let transfer = match (&entry.transfer, &self.picture.transfer) {
            (Some(own), _) => self.named_transfer(own).map_err(named)?,
            (None, Some(shared)) if first => self.named_transfer(shared)?,
            _ => TransferFunction::preset("scan")?,
        };
        let range = entry.range.or(self.picture.range.filter(|_| first));
        // X-rays depend on the values, not on their display range.
        let range = range.filter(|_| self.picture.mode.as_deref() != Some("xray"));
        Ok((transfer, range))
    }
}

impl ScanEntry {
    /// Returns a note of a scan that is taken for labels without being set so.
    fn labels_note(&self, name: &str, count: usize) -> Option<String> {
        self.labels.is_none().then(|| {
            format!(
                "{name} is rendered as labels: it has {count} different integer values; override with labels = false"
            )
        })
    }

    /// Returns its labels with their voxel counts if it displays labels; `values` is whether it
    /// displays values by default.
    fn has_labels(&self, volume: &Volume, values: bool) -> Result<Option<BTreeMap<i64, usize>>> {
        if !self.label.is_empty() && self.labels == Some(false) {
            return Err(Error::Input(
                "label entries conflict with labels = false; remove one of them".into(),
            ));
        }
        let asked = self.labels.unwrap_or(!self.label.is_empty());
        if self.labels == Some(false) || (values && !asked) {
            return Ok(None);
        }
        let labels = volume.labels();
        match (asked, labels) {
            (true, Some(labels)) => Ok(Some(labels)),
            (true, None) => Err(Error::Input(
                "it is not a label map: its values are not integers, or there are too many different ones".into(),
            )),
            (false, labels) => {
                let few = |labels: &BTreeMap<i64, usize>| {
                    labels.len() <= MAX_LABEL_VALUES && (self.transfer.is_none() && self.range.is_none())
                };
                Ok(labels.filter(few))
            }
        }
    }

    /// Returns its name, or by default that of its file.
    fn called(&self) -> String {
        let stem = || {
            self.file
                .file_stem()
                .map(|s| s.to_string_lossy().into_owned())
        };
        let file = || stem().unwrap_or_else(|| "scan".into());
        let name = self.name.clone().unwrap_or_else(file);
        name.strip_suffix(".nii")
            .map_or(name.clone(), str::to_owned)
    }

    /// Returns the appearance of each label; 0 is the background.
    fn label_looks(
        &self,
        volume: &Volume,
        labels: &BTreeMap<i64, usize>,
        opacity: f64,
        units_per_mm: f64,
    ) -> Result<BTreeMap<i64, LabelAppearance>> {
        let mut entries: BTreeMap<i64, &LabelAppearanceEntry> = BTreeMap::new();
        for (name, entry) in &self.label {
            let by_name = volume.label_names.iter().find(|(_, own)| *own == name);
            let label = by_name.map(|(label, _)| *label).or(name.parse().ok());
            let label = label.filter(|l| labels.contains_key(l)).ok_or_else(|| {
                let all: Vec<String> = labels
                    .keys()
                    .map(|l| match volume.label_names.get(l) {
                        Some(name) => format!("{l} ({name})"),
                        None => l.to_string(),
                    })
                    .collect();
                Error::Input(format!(
                    "no voxel has the label {name}; available: {}",
                    all.join(", ")
                ))
            })?;
            if entries.insert(label, entry).is_some() {
                return Err(Error::Input(format!(
                    "label {label} has two entries, by name and by number; remove one of them"
                )));
            }
        }
        let chord_lengths = mean_chord_lengths(volume, labels);
        let mut looks = BTreeMap::new();
        let shown = labels.keys().filter(|label| **label != 0);
        for (i, label) in shown.enumerate() {
            let entry = entries.get(label).copied();
            if entry.is_some_and(|entry| entry.hidden) {
                continue;
            }
            let colour = match entry.and_then(|entry| entry.colour.as_deref()) {
                Some(name) => named_colour(name)?,
                None => match volume.label_colours.get(label) {
                    Some(own) => *own,
                    None => colour_of(i).map(|c| f64::from(c) / 255.0),
                },
            };
            let opacity = entry.and_then(|entry| entry.opacity).unwrap_or(opacity);
            if !(0.0..=1.0).contains(&opacity) {
                return Err(Error::Input(format!(
                    "opacity of label {label} (over its mean chord length) must be in [0, 1], got {opacity}"
                )));
            }
            let chord_length = chord_lengths.get(label).copied().unwrap_or(1.0) * units_per_mm;
            let extinction = (1.0 - opacity).max(CLEAR).ln().abs() / chord_length;
            looks.insert(*label, LabelAppearance { colour, extinction });
        }
        Ok(looks)
    }
}

/// Returns the mean chord length of rays through each label, mm: 4V/S (Cauchy).
fn mean_chord_lengths(volume: &Volume, labels: &BTreeMap<i64, usize>) -> BTreeMap<i64, f64> {
    let axes = volume.to_world.matrix3;
    let (x, y, z) = (axes.x_axis, axes.y_axis, axes.z_axis);
    let areas = [y.cross(z), z.cross(x), x.cross(y)].map(|a| a.length());
    let size = volume.size;
    let strides = [1, size[0], size[0] * size[1]];
    let own: Vec<i64> = labels.keys().copied().collect();
    let place = |n: usize| own.partition_point(|l| *l < volume.value(n) as i64);
    let mut sums = vec![[0.0f64; 2]; own.len() + 1];
    let voxel = volume.voxel_volume();
    for n in 0..volume.voxels() {
        let here = place(n);
        let at = [n % size[0], n / strides[1] % size[1], n / strides[2]];
        let mut bare = 0.0;
        for k in 0..3 {
            if at[k] == 0 {
                bare += areas[k];
            }
            match at[k] + 1 < size[k] {
                false => bare += areas[k],
                true => {
                    let there = place(n + strides[k]);
                    if there != here {
                        bare += areas[k];
                        sums[there][1] += areas[k];
                    }
                }
            }
        }
        sums[here] = [sums[here][0] + voxel, sums[here][1] + bare];
    }
    let chord_length = |[volume, surface]: [f64; 2]| {
        4.0 * volume * VOXEL_SURFACE_RATIO / surface.max(f64::MIN_POSITIVE)
    };
    own.iter()
        .copied()
        .zip(sums.into_iter().map(chord_length))
        .collect()
}

/// Returns the legend field of values.
fn value_field(name: &str, transfer: TransferFunction) -> ScalarField {
    ScalarField {
        name: name.to_owned(),
        values: Vec::new(),
        cells: None,
        range: (0.0, 1.0),
        note: None,
        transfer: Some(transfer),
        regions: Vec::new(),
    }
}

/// Returns the legend field of labels: their colours, by index in order.
fn label_field(
    name: &str,
    volume: &Volume,
    looks: &BTreeMap<i64, LabelAppearance>,
) -> Result<ScalarField> {
    let (mut colour, mut extinction) = (Vec::new(), Vec::new());
    let mut regions = Vec::new();
    for (i, (label, look)) in looks.iter().enumerate() {
        let [r, g, b] = look.colour;
        for end in [i as f64 - PLATEAU, i as f64 + PLATEAU] {
            colour.push([end, r, g, b]);
            extinction.push([end, look.extinction]);
        }
        let called = volume.label_names.get(label).cloned();
        regions.push((called.unwrap_or_else(|| label.to_string()), i as f64));
    }
    if regions.is_empty() {
        return Ok(value_field(name, TransferFunction::preset("scan")?));
    }
    Ok(ScalarField {
        regions,
        ..value_field(name, TransferFunction::new(colour, extinction)?)
    })
}
