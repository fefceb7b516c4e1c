//! Statistics of a volume.

use super::Volume;
use crate::number_format::significant;
use std::fmt;

/// Statistics of a volume.
#[derive(Clone, Debug, serde::Serialize)]
pub struct VolumeDescription {
    /// Voxels along i, j, k.
    pub size: [usize; 3],
    /// Distance between voxel centres, mm.
    pub spacing: [f64; 3],
    /// Nearest anatomical directions of i, j and k: L or R, P or A, I or S; `LPS` for an image that
    /// runs to the left, posterior and superior.
    pub orientation: String,
    /// Largest angle between a voxel axis and the nearest world axis, degrees.
    #[serde(rename = "obliqueness")]
    pub obliquity_degrees: f64,
    /// World-aligned bounding box of all voxels, RAS in mm: lower and upper corner.
    pub bounds: [[f64; 3]; 2],
    /// The type of the stored numbers.
    pub scalar_type: String,
    /// Scaling of stored numbers to values: factor and offset.
    pub scaling: [f64; 2],
    /// Smallest and largest value.
    pub range: Option<[f64; 2]>,
    /// What was repaired or assumed in reading, one sentence each.
    pub notes: Vec<String>,
    /// The labels, if the volume has at most a few dozen distinct integer values.
    pub labels: Vec<LabelDescription>,
}

/// One label of a volume.
#[derive(Clone, Debug, serde::Serialize)]
pub struct LabelDescription {
    /// Its value.
    pub label: i64,
    /// Its name, if the file has one.
    pub name: Option<String>,
    /// Its colour, RGB from 0 to 1, if the file has one.
    pub colour: Option<[f64; 3]>,
    /// Number of its voxels.
    pub voxels: usize,
    /// Their volume, mm³.
    pub volume: f64,
}

/// Maximum number of distinct values for which labels are listed; otherwise only the range is.
const SHOWN_LABELS: usize = 64;

impl VolumeDescription {
    /// Describes `volume`.
    pub fn new(volume: &Volume) -> VolumeDescription {
        let axes = volume.to_world.matrix3;
        let mut orientation = String::new();
        let mut obliquity_degrees = 0f64;
        for axis in [axes.x_axis, axes.y_axis, axes.z_axis] {
            let nearest = axis.abs().max_position();
            let letters = [["L", "R"], ["P", "A"], ["I", "S"]][nearest];
            orientation += letters[usize::from(axis[nearest] > 0.0)];
            let cosine = axis[nearest].abs() / axis.length();
            obliquity_degrees = obliquity_degrees.max(cosine.min(1.0).acos().to_degrees());
        }
        let (low, high) = volume.bounds();
        let labels = volume.labels().filter(|l| l.len() <= SHOWN_LABELS);
        let labels = labels.unwrap_or_default().into_iter();
        VolumeDescription {
            size: volume.size,
            spacing: volume.spacing().to_array(),
            orientation,
            obliquity_degrees,
            bounds: [low.to_array(), high.to_array()],
            scalar_type: format!("{:?}", volume.raw.scalar_type()).to_lowercase(),
            scaling: [volume.slope, volume.intercept],
            notes: volume.notes.clone(),
            range: volume.range().map(|(low, high)| [low, high]),
            labels: labels
                .map(|(label, voxels)| LabelDescription {
                    label,
                    name: volume.label_names.get(&label).cloned(),
                    colour: volume.label_colours.get(&label).copied(),
                    voxels,
                    volume: voxels as f64 * volume.voxel_volume(),
                })
                .collect(),
        }
    }
}

impl fmt::Display for VolumeDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [i, j, k] = self.size;
        writeln!(
            f,
            "volume        {i} × {j} × {k} voxels of {}",
            self.scalar_type
        )?;
        let [x, y, z] = self.spacing.map(significant);
        writeln!(f, "spacing       {x} × {y} × {z} mm")?;
        write!(f, "orientation   {}", self.orientation)?;
        match self.obliquity_degrees < 0.01 {
            true => writeln!(f)?,
            false => writeln!(f, ", up to {:.1}° oblique", self.obliquity_degrees)?,
        }
        let [low, high] = self.bounds.map(|corner| corner.map(significant).join(", "));
        writeln!(f, "bounds (RAS)  [{low}] to [{high}] mm")?;
        let [slope, intercept] = self.scaling;
        if self.scaling != [1.0, 0.0] {
            writeln!(f, "scaling       value = {slope} · stored + {intercept}")?;
        }
        match self.range {
            Some([low, high]) => writeln!(f, "values        {low} to {high}")?,
            None => writeln!(f, "values        no finite value")?,
        }
        for note in &self.notes {
            writeln!(f, "note          {note}")?;
        }
        for label in &self.labels {
            let name = label.name.as_deref().unwrap_or("");
            writeln!(
                f,
                "label {:<7} {:>9} voxels {:>12} mm³  {name}",
                label.label,
                label.voxels,
                significant(label.volume)
            )?;
        }
        Ok(())
    }
}
