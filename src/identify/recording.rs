//! Recordings of a body: how far markers move from its rest shape until it hangs at rest, or how it swings;
//! and other measurements of it at rest.

use super::data::NumberTable;
use super::marker_motion::position_at;
use super::readings::{
    DisplacementsEntry, PointDisplacements, ReactionEntry, Readings, VolumeEntry,
};
use super::swing::{Swing, extremes_from_first};
use crate::scene::MassEntry;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Largest distance of markers from their places after the best rotation and shift, relative to the
/// distances between them.
const MAX_MISPLACED: f64 = 0.2;

/// A file of a recording.
///
/// ```toml
/// takes = ["beam_52g_a.csv", "beam_52g_b.csv"]   # columns time_s, NAME_x_mm, NAME_y_mm, NAME_z_mm, …
/// straight = [0.0, 0.2]                # s: when the body has its rest shape
/// at_rest = [5.0, 6.0]                 # s: when it is at rest under its loads
/// axes = ["z", "-y", "x"]              # axes of the file along x, y and z of the body; fitted without
/// swing = "tip1"                       # compare period and decay of this marker, not the rest positions
/// motion = [0.3, 0.4, 0.5]             # s: or where the markers are then, in the motion of the scene, which
///                                      # starts at the end of `straight`
///
/// [[marker]]
/// name = "tip1"
/// at = [0.1, 0.015, 0.036]             # its place at rest, in file units of the body
///
/// [[mass]]                             # loads in addition to those of the scene
/// on = { x_above = 0.099, z_above = 0.029 }
/// kg = 0.052
///
/// # Of a body at rest, beside takes or without:
/// [displacements]
/// file = "measured.vtu"                # its node field `displacement`, in file units of the body
///
/// [[reaction]]
/// on = { x_below = 0.001 }             # fixed nodes
/// direction = [0.0, 0.0, -1.0]
/// newton = 1.02
///
/// [[volume]]
/// region = "lung"
/// ml = 410.0
/// ```
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RecordingFile {
    #[serde(default)]
    takes: Vec<PathBuf>,
    straight: Option<[f64; 2]>,
    at_rest: Option<[f64; 2]>,
    axes: Option<[String; 3]>,
    swing: Option<String>,
    #[serde(default)]
    motion: Vec<f64>,
    #[serde(default)]
    marker: Vec<MarkerEntry>,
    #[serde(default)]
    mass: Vec<MassEntry>,
    displacements: Option<DisplacementsEntry>,
    #[serde(default)]
    reaction: Vec<ReactionEntry>,
    #[serde(default)]
    volume: Vec<VolumeEntry>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MarkerEntry {
    name: String,
    at: [f64; 3],
}

/// What was measured of a body, and how it was loaded.
#[derive(Clone, Debug)]
pub(super) struct Recording {
    /// The folder of its file.
    folder: PathBuf,
    displacements: Option<DisplacementsEntry>,
    /// Reactions and volumes.
    pub readings: Readings,
    /// Masses in addition to those of the scene.
    pub masses: Vec<MassEntry>,
    markers: Vec<MarkerEntry>,
    takes: Vec<Take>,
    straight: [f64; 2],
    at_rest: [f64; 2],
    /// From the axes of the files to those of the body, if known.
    rotation: Option<DMat3>,
    /// Number of the marker whose swing is compared.
    swing: Option<usize>,
    /// Times at which a motion is compared, s.
    motion: Vec<f64>,
}

/// One take: times, s, and positions of each marker, m, in the frame of the file.
#[derive(Clone, Debug)]
struct Take {
    file: PathBuf,
    times: Vec<f64>,
    positions: Vec<Vec<DVec3>>,
}

/// A recording in the frame of the body.
#[derive(Clone, Debug)]
pub(super) enum Recorded {
    /// Places of the markers, in file units, and for each take how far they moved, m; the same of a
    /// displacement field; and what else was measured.
    AtRest {
        places: Vec<DVec3>,
        displacements: Vec<Vec<DVec3>>,
        field: PointDisplacements,
    },
    /// The place of a marker, in file units, and its swing in each take.
    Swing { place: DVec3, takes: Vec<Swing> },
    /// The places of the markers, in file units, times from the start of the scene, s, and for each take how
    /// far each marker has moved at each time, m.
    Motion {
        places: Vec<DVec3>,
        times: Vec<f64>,
        takes: Vec<Vec<Vec<DVec3>>>,
    },
}

impl Recording {
    /// Reads a recording and its takes, whose paths are relative to the file.
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Io`] naming the file and what it lacks.
    pub fn read(path: &Path) -> Result<Recording> {
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        let file: RecordingFile = toml::from_str(&text).map_err(|e| {
            Error::format(path, format!("{e} (recordings: docs/how-to/identify.md)"))
        })?;
        let wrong = |what: String| Error::format(path, what);
        check_motion(&file).map_err(wrong)?;
        let readings = Readings {
            reactions: file.reaction,
            volumes: file.volume,
        };
        readings.check().map_err(wrong)?;
        let has_readings = file.displacements.is_some() || !readings.observed().is_empty();
        let markers = (file.takes.is_empty(), file.marker.is_empty());
        if markers != (false, false) && !(has_readings && markers == (true, true)) {
            return Err(wrong(
                "a recording needs `takes`, files of marker positions, and a [[marker]] at least; without them, [displacements], a [[reaction]] or a [[volume]]"
                    .into(),
            ));
        }
        let over_time = file.swing.is_some() || !file.motion.is_empty();
        if over_time && has_readings {
            return Err(wrong(
                "a swing or a motion is compared by itself; put [displacements], [[reaction]] and [[volume]] into a file of their own".into(),
            ));
        }
        let when = |given: Option<[f64; 2]>, key: &str| match (given, file.takes.is_empty()) {
            (Some(given), _) => Ok(given),
            (None, true) => Ok([0.0; 2]),
            (None, false) => Err(wrong(format!("takes need `{key}`, from when to when, s"))),
        };
        let (straight, at_rest) = (
            when(file.straight, "straight")?,
            match file.motion.is_empty() {
                true => when(file.at_rest, "at_rest")?,
                false => [0.0; 2],
            },
        );
        let rotation = match &file.axes {
            Some(axes) => Some(rotation_of(axes).ok_or_else(|| {
                wrong("axes must be x, y and z once each, perhaps with a minus, and right-handed, such as [\"z\", \"-y\", \"x\"]".into())
            })?),
            None if !file.marker.is_empty() && file.marker.len() < 3 => {
                return Err(wrong(
                    "the frame of the recording is fitted to three markers or more; name them, or set `axes`".into(),
                ));
            }
            None => None,
        };
        let swing = match &file.swing {
            None => None,
            Some(name) => {
                let found = file.marker.iter().position(|marker| marker.name == *name);
                Some(found.ok_or_else(|| wrong(format!("swing = \"{name}\" is no [[marker]]")))?)
            }
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        let takes = file.takes.iter();
        let takes = takes.map(|take| Take::read(&folder.join(take), &file.marker));
        Ok(Recording {
            takes: takes.collect::<Result<_>>()?,
            folder: folder.to_owned(),
            displacements: file.displacements,
            readings,
            masses: file.mass,
            markers: file.marker,
            straight,
            at_rest,
            rotation,
            swing,
            motion: file.motion,
        })
    }

    /// Returns a displacement field of a body under the loads of the scene.
    pub fn of_displacements(entry: DisplacementsEntry) -> Recording {
        Recording {
            folder: PathBuf::new(),
            displacements: Some(entry),
            readings: Readings::default(),
            masses: Vec::new(),
            markers: Vec::new(),
            takes: Vec::new(),
            straight: [0.0; 2],
            at_rest: [0.0; 2],
            rotation: None,
            swing: None,
            motion: Vec::new(),
        }
    }

    /// Returns what was recorded in the frame of a body whose file unit is `unit` metres.
    ///
    /// # Errors
    /// [`Error::Format`] for a take without rows at the stated times, or whose markers are not at their
    /// places, or that does not swing.
    pub fn in_body(&self, unit: f64) -> Result<Recorded> {
        let places: Vec<DVec3> = self.markers.iter().map(|m| DVec3::from(m.at)).collect();
        let mut displacements = Vec::new();
        let mut swings = Vec::new();
        let mut motions = Vec::new();
        for take in &self.takes {
            let straight = take.means(self.straight, "straight")?;
            if !self.motion.is_empty() {
                let rotation = match self.rotation {
                    Some(rotation) => rotation,
                    None => take.fitted_rotation(&straight, &places, unit)?,
                };
                motions.push(take.moved_at(&self.motion, (&straight, rotation))?);
                continue;
            }
            let rest = take.means(self.at_rest, "at_rest")?;
            let rotation = match self.rotation {
                Some(rotation) => rotation,
                None => take.fitted_rotation(&straight, &places, unit)?,
            };
            let moved = straight.iter().zip(&rest);
            displacements.push(moved.map(|(from, to)| rotation * (*to - *from)).collect());
            if let Some(marker) = self.swing {
                let track: Vec<DVec3> = take.positions[marker]
                    .iter()
                    .map(|p| rotation * (*p - rest[marker]))
                    .collect();
                let released = take.times.partition_point(|t| *t < self.straight[1]);
                let drop = rotation * (rest[marker] - straight[marker]);
                let swing = extremes_from_first((&take.times, &track), released, drop);
                swings.push(swing.ok_or_else(|| {
                    Error::format(
                        &take.file,
                        format!(
                            "the marker {} does not swing: it has no two lowest points after {} s",
                            self.markers[marker].name, self.straight[1]
                        ),
                    )
                })?);
            }
        }
        if !motions.is_empty() {
            let start = self.straight[1];
            return Ok(Recorded::Motion {
                places,
                times: self.motion.iter().map(|time| time - start).collect(),
                takes: motions,
            });
        }
        Ok(match self.swing {
            None => Recorded::AtRest {
                places,
                displacements,
                field: match &self.displacements {
                    Some(entry) => entry.read(&self.folder, unit)?,
                    None => PointDisplacements::default(),
                },
            },
            Some(marker) => Recorded::Swing {
                place: places[marker],
                takes: swings,
            },
        })
    }

    /// Names of the markers.
    pub fn names(&self) -> Vec<&str> {
        self.markers.iter().map(|m| m.name.as_str()).collect()
    }
}

impl Take {
    fn read(path: &Path, markers: &[MarkerEntry]) -> Result<Take> {
        let table = NumberTable::read(path)?;
        let column = |name: &str| {
            table
                .columns(&[name])
                .and_then(|found| found.first().copied())
        };
        let time = column("time_s").ok_or_else(|| {
            Error::format(
                path,
                "expected a column time_s, and NAME_x_mm, NAME_y_mm and NAME_z_mm of each marker",
            )
        })?;
        let mut columns = Vec::new();
        for marker in markers {
            let found = [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)]
                .into_iter()
                .find_map(|(unit, metres)| {
                    let of = |axis: &str| column(&format!("{}_{axis}_{unit}", marker.name));
                    Some(([of("x")?, of("y")?, of("z")?], metres))
                });
            columns.push(found.ok_or_else(|| {
                Error::format(path, format!("the marker {0} has no columns {0}_x_mm, {0}_y_mm and {0}_z_mm (or in m or cm)", marker.name))
            })?);
        }
        let mut take = Take {
            file: path.to_owned(),
            times: Vec::new(),
            positions: vec![Vec::new(); markers.len()],
        };
        for row in &table.rows {
            let number = |k: usize| row.get(k).copied().unwrap_or(f64::NAN);
            let here: Vec<DVec3> = columns
                .iter()
                .map(|([x, y, z], metres)| *metres * DVec3::new(number(*x), number(*y), number(*z)))
                .collect();
            // Rows in which a marker was not seen are left out.
            if number(time).is_finite() && here.iter().all(|p| p.is_finite()) {
                take.times.push(number(time));
                take.positions
                    .iter_mut()
                    .zip(here)
                    .for_each(|(own, p)| own.push(p));
            }
        }
        Ok(take)
    }

    /// Returns the mean positions of the markers between two times.
    fn means(&self, [from, to]: [f64; 2], key: &str) -> Result<Vec<DVec3>> {
        let rows: Vec<usize> = (0..self.times.len())
            .filter(|k| (from..=to).contains(&self.times[*k]))
            .collect();
        if rows.is_empty() {
            return Err(Error::format(
                &self.file,
                format!(
                    "no row with all markers is between {from} and {to} s ({key}); its times are {} to {} s",
                    self.times.first().unwrap_or(&f64::NAN),
                    self.times.last().unwrap_or(&f64::NAN)
                ),
            ));
        }
        let mean =
            |track: &Vec<DVec3>| rows.iter().map(|k| track[*k]).sum::<DVec3>() / rows.len() as f64;
        Ok(self.positions.iter().map(mean).collect())
    }

    /// Returns at each time how far each marker is from its position `straight`, after a rotation, m.
    fn moved_at(
        &self,
        times: &[f64],
        (straight, rotation): (&[DVec3], DMat3),
    ) -> Result<Vec<Vec<DVec3>>> {
        let at = |time: &f64| {
            let tracks = self.positions.iter().zip(straight);
            let moved = tracks.map(|(track, from)| {
                position_at(&self.times, track, *time).map(|to| rotation * (to - *from))
            });
            moved.collect::<Option<Vec<_>>>().ok_or_else(|| {
                Error::format(
                    &self.file,
                    format!(
                        "no rows with all markers are around {time} s (motion); its times are {} to {} s",
                        self.times.first().unwrap_or(&f64::NAN),
                        self.times.last().unwrap_or(&f64::NAN)
                    ),
                )
            })
        };
        times.iter().map(at).collect()
    }

    /// Returns the rotation that, with a shift, takes the markers closest to their places (Kabsch 1976, "A
    /// solution for the best rotation to relate two sets of vectors").
    fn fitted_rotation(&self, from: &[DVec3], places: &[DVec3], unit: f64) -> Result<DMat3> {
        let count = from.len() as f64;
        let to: Vec<DVec3> = places.iter().map(|p| *p * unit).collect();
        let centre = |points: &[DVec3]| points.iter().copied().sum::<DVec3>() / count;
        let (a, b) = (centre(from), centre(&to));
        let vector = |p: DVec3| Vector3::new(p.x, p.y, p.z);
        let mut covariance = Matrix3::zeros();
        for (p, q) in from.iter().zip(&to) {
            covariance += vector(*q - b) * vector(*p - a).transpose();
        }
        let svd = covariance.svd(true, true);
        let (u, v) = (svd.u.unwrap_or_default(), svd.v_t.unwrap_or_default());
        let handed = (u * v).determinant().signum();
        let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, handed)) * v;
        let column = |k: usize| DVec3::new(rotation[(0, k)], rotation[(1, k)], rotation[(2, k)]);
        let rotation = DMat3::from_cols(column(0), column(1), column(2));
        let off = from.iter().zip(&to);
        let off: f64 = off
            .map(|(p, q)| (rotation * (*p - a) + b).distance_squared(*q))
            .sum();
        let spread: f64 = to.iter().map(|q| q.distance_squared(b)).sum();
        if (off / spread).sqrt() <= MAX_MISPLACED {
            return Ok(rotation);
        }
        Err(Error::format(
            &self.file,
            format!(
                "the markers are {} mm (root mean square) from their places in the scene at any rotation; check `at`, the unit of the mesh ([mesh] unit) and `straight`",
                crate::number_format::significant(1e3 * (off / count).sqrt())
            ),
        ))
    }
}

/// Checks the times of a motion.
fn check_motion(file: &RecordingFile) -> std::result::Result<(), String> {
    if file.motion.is_empty() {
        return Ok(());
    }
    if file.swing.is_some() {
        return Err("a recording is compared by its swing or by its motion, not both; remove `swing` or `motion`".into());
    }
    let start = file.straight.map_or(0.0, |[_, end]| end);
    let times = std::iter::once(&start).chain(&file.motion);
    match times.clone().all(|time| time.is_finite()) && times.is_sorted_by(|a, b| a < b) {
        true => Ok(()),
        false => Err(format!(
            "motion must be increasing times after the start at {start} s, the end of `straight`"
        )),
    }
}

/// Returns the rotation into a body of whose axes x, y and z these are along axes of the file; `None` if
/// they are no right-handed axes.
fn rotation_of(axes: &[String; 3]) -> Option<DMat3> {
    let axis = |name: &String| {
        let (sign, name) = match name.strip_prefix('-') {
            Some(name) => (-1.0, name),
            None => (1.0, name.as_str()),
        };
        let axis = match name {
            "x" => DVec3::X,
            "y" => DVec3::Y,
            "z" => DVec3::Z,
            _ => return None,
        };
        Some(sign * axis)
    };
    let rows = DMat3::from_cols(axis(&axes[0])?, axis(&axes[1])?, axis(&axes[2])?);
    (rows.determinant() == 1.0).then(|| rows.transpose())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_right_handed() {
        let axes = |text: &str| {
            let names: Vec<String> = text.split(' ').map(str::to_owned).collect();
            rotation_of(&names.try_into().unwrap())
        };
        let turned = axes("z -y x").unwrap() * DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(turned, DVec3::new(3.0, -2.0, 1.0));
        assert!(axes("z y x").is_none() && axes("x x y").is_none() && axes("x y w").is_none());
    }

    /// The rotation of three markers is found, and markers elsewhere are refused.
    #[test]
    fn frame_is_fitted() {
        let places = [
            DVec3::ZERO,
            DVec3::new(30.0, 0.0, 5.0),
            DVec3::new(0.0, 20.0, 0.0),
        ];
        let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(-1.1);
        let from: Vec<DVec3> = places
            .iter()
            .map(|p| turn.transpose() * (*p * 1e-3) + DVec3::X)
            .collect();
        let take = Take {
            file: "a.csv".into(),
            times: Vec::new(),
            positions: Vec::new(),
        };
        let found = take.fitted_rotation(&from, &places, 1e-3).unwrap();
        assert!((found - turn).abs_diff_eq(DMat3::ZERO, 1e-9));
        let why = take
            .fitted_rotation(&from, &places, 1.0)
            .unwrap_err()
            .to_string();
        assert!(why.contains("[mesh] unit"), "{why}");
    }
}
