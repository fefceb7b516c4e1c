//! Measurements: force against depth, maps of stiffness, and recordings of markers.

use super::readings::DisplacementsEntry;
use super::recording::Recording;
use crate::press::{FIT_FRACTION, step_depths};
#[cfg(feature = "study")]
use crate::scene::MassEntry;
use crate::{Error, Result};
use glam::DVec3;
use serde::Deserialize;
use std::path::Path;

/// The quantity of maps.
pub(super) const STIFFNESS: &str = "stiffness";
/// Largest number of depths of a curve that are compared, evenly spread.
const MAX_DEPTHS: usize = 8;

/// Measured numbers, with how they were measured.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Its file, for messages.
    pub name: String,
    pub(super) kind: ExperimentKind,
}

/// What was done to the body.
#[derive(Clone, Debug)]
pub(super) enum ExperimentKind {
    /// It was pressed.
    Presses(Presses),
    /// Markers on it were filmed.
    Recording(Box<Recording>),
}

/// A curve of force against depth, or a map of stiffness. Lengths are in file units of the body, depths
/// in metres.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Presses {
    /// Whether it is a map.
    pub is_map: bool,
    /// Metres per unit of the places and the radius; `None` for those of the body.
    pub length_unit_m: Option<f64>,
    /// Radius of the fingertip.
    pub radius: f64,
    pub places: Vec<Place>,
}

/// A place that was pressed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    pub at: DVec3,
    pub outward: DVec3,
    /// Depths to which the fingertip goes one after the other, m.
    pub depths: Vec<f64>,
    pub observed: Vec<Observed>,
}

/// A measured number; of a press a weighted sum of the forces at the depths of a place.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Observed {
    /// What it is, such as `force`.
    pub quantity: String,
    /// Its place, in file units.
    pub at: DVec3,
    /// Weights by number of the depth.
    pub weights: Vec<(usize, f64)>,
    /// The largest depth, m.
    pub depth: f64,
    /// In the unit of the quantity.
    pub value: f64,
    /// What the noise is relative to.
    pub scale: f64,
}

/// What the JSON file beside the numbers says about a press.
#[derive(Deserialize)]
struct CurveConditions {
    at: [f64; 3],
    direction: [f64; 3],
    radius_m: f64,
    length_unit_m: Option<f64>,
}

/// What the JSON file says about a map; lengths in file units.
#[derive(Deserialize)]
struct MapConditions {
    radius: f64,
    depth: f64,
    direction: [f64; 3],
    length_unit_m: f64,
}

impl Experiment {
    /// Reads the results of `palpate press`, or measurements of the same form: a folder, `press.csv`
    /// (columns `depth_m`, `force_n` and perhaps `phase`, of which `load` is used) with `press.json` (`at`,
    /// `direction`, `radius_m`), or `map.csv` (columns `x`, `y`, `z`, `stiffness`) with `map.json` (`radius`,
    /// `depth`, `direction`, `length_unit_m`); a recording of markers, or other measurements of a body at rest
    /// (`.toml`); or a mesh with the node field `displacement` (`.vtu` and the other formats).
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Io`] naming the file and what it lacks.
    pub fn read(path: impl AsRef<Path>) -> Result<Vec<Experiment>> {
        let path = path.as_ref();
        if path.is_dir() {
            let files = ["press.csv", "map.csv"].map(|name| path.join(name));
            let there: Vec<_> = files.iter().filter(|file| file.exists()).collect();
            if there.is_empty() {
                return Err(Error::Format {
                    path: path.to_owned(),
                    what: "the folder has neither press.csv nor map.csv; give the folder of a press (palpate press --out)".into(),
                });
            }
            let read = there.into_iter().map(Experiment::read);
            return Ok(read.collect::<Result<Vec<_>>>()?.concat());
        }
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            return Ok(vec![Experiment {
                name: path.display().to_string(),
                kind: ExperimentKind::Recording(Box::new(Recording::read(path)?)),
            }]);
        }
        if path.extension().is_none_or(|extension| extension != "csv") {
            return Ok(vec![Experiment {
                name: path.display().to_string(),
                kind: ExperimentKind::Recording(Box::new(Recording::of_displacements(
                    DisplacementsEntry::of_file(path),
                ))),
            }]);
        }
        let table = NumberTable::read(path)?;
        let about = path.with_extension("json");
        let one = match table.columns(&["x", "y", "z", "stiffness"]) {
            Some(columns) => map(path, &table, columns, &about)?,
            None => {
                let columns = table.columns(&["depth_m", "force_n"]).ok_or_else(|| {
                    Error::format(path, "expected the columns depth_m and force_n of a curve, or x, y, z and stiffness of a map".to_owned())
                })?;
                curve(path, &table, columns, &about)?
            }
        };
        Ok(vec![one])
    }

    /// Returns a curve of force (N) against depth (m) of a fingertip of `radius` that advanced from `at`
    /// along `direction`; lengths in file units of the body.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers that are not finite, or no depth above 0.
    pub fn curve(
        name: &str,
        (at, direction, radius): (DVec3, DVec3, f64),
        samples: &[[f64; 2]],
    ) -> Result<Experiment> {
        let mut samples: Vec<[f64; 2]> = samples.iter().copied().filter(|s| s[0] > 0.0).collect();
        // Up to the largest depth.
        let deepest = samples.iter().map(|s| s[0]).fold(0.0, f64::max);
        let end = samples.iter().position(|s| s[0] >= deepest);
        samples.truncate(end.map_or(0, |k| k + 1));
        samples.dedup_by(|b, a| b[0] <= a[0]);
        let bad = samples.iter().flatten().any(|x| !x.is_finite());
        let direction_is_given = direction.is_finite() && direction.length() > 0.0;
        if samples.is_empty()
            || bad
            || !direction_is_given
            || !(radius.is_finite() && radius > 0.0)
            || !at.is_finite()
        {
            return Err(Error::Input(format!(
                "{name}: a curve needs finite forces at depths above 0, a place, a direction and a positive radius"
            )));
        }
        let strongest = samples.iter().map(|s| s[1].abs()).fold(0.0, f64::max);
        if strongest == 0.0 {
            return Err(Error::Input(format!(
                "{name}: all forces are 0; the fingertip has not touched the body, press deeper"
            )));
        }
        let every = samples.len().div_ceil(MAX_DEPTHS);
        let kept: Vec<[f64; 2]> = samples.iter().rev().step_by(every).rev().copied().collect();
        let observed = kept.iter().enumerate().map(|(k, [depth, force])| Observed {
            quantity: "force".into(),
            at,
            weights: vec![(k, 1.0)],
            depth: *depth,
            value: *force,
            scale: strongest,
        });
        let place = Place {
            at,
            outward: -direction.normalize(),
            observed: observed.collect(),
            depths: kept.iter().map(|s| s[0]).collect(),
        };
        Ok(Experiment::presses(name, false, radius, vec![place]))
    }

    /// Returns a map of the `stiffnesses` (N/m) at `points` that a fingertip of `radius` measured along
    /// `direction` to a `depth` (m); the others in file units of the body. Stiffnesses that are not
    /// finite are left out.
    ///
    /// # Errors
    /// [`Error::Input`] without a finite stiffness.
    pub fn map(
        name: &str,
        (direction, radius, depth): (DVec3, f64, f64),
        points: &[(DVec3, f64)],
    ) -> Result<Experiment> {
        let sound = |x: f64| x.is_finite() && x > 0.0;
        if !(sound(radius) && sound(depth) && direction.length() > 0.0) {
            return Err(Error::Input(format!(
                "{name}: a map needs a direction, a positive radius and a positive depth"
            )));
        }
        let measured = points.iter().filter(|(at, k)| at.is_finite() && sound(*k));
        let places: Vec<Place> = measured
            .map(|(at, stiffness)| Place {
                at: *at,
                outward: -direction.normalize(),
                // They follow from the radius in metres, which is not known yet.
                depths: Vec::new(),
                observed: vec![Observed {
                    quantity: STIFFNESS.into(),
                    at: *at,
                    weights: Vec::new(),
                    depth,
                    value: *stiffness,
                    scale: *stiffness,
                }],
            })
            .collect();
        if places.is_empty() {
            return Err(Error::Input(format!(
                "{name}: the map has no stiffness above 0; press where the body can be measured"
            )));
        }
        Ok(Experiment::presses(name, true, radius, places))
    }

    /// Returns measured displacements of points of a body at rest under the loads of its scene: their places
    /// on the unloaded body and how far they moved, in file units.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers that are not finite, or no point.
    pub fn displacements(name: &str, points: &[(DVec3, DVec3)]) -> Result<Experiment> {
        let is_finite = |(at, moved): &(DVec3, DVec3)| at.is_finite() && moved.is_finite();
        if points.is_empty() || !points.iter().all(is_finite) {
            return Err(Error::Input(format!(
                "{name}: displacements need a point at least, and finite numbers"
            )));
        }
        let entry = DisplacementsEntry::of_points(points.to_vec());
        Ok(Experiment {
            name: name.to_owned(),
            kind: ExperimentKind::Recording(Box::new(Recording::of_displacements(entry))),
        })
    }

    /// Adds weights that the body carried to measurements at rest.
    #[cfg(feature = "study")]
    pub(crate) fn with_masses(mut self, masses: &[MassEntry]) -> Experiment {
        if let ExperimentKind::Recording(recording) = &mut self.kind {
            recording.masses.extend(masses.iter().cloned());
        }
        self
    }

    fn presses(name: &str, is_map: bool, radius: f64, places: Vec<Place>) -> Experiment {
        Experiment {
            name: name.to_owned(),
            kind: ExperimentKind::Presses(Presses {
                is_map,
                length_unit_m: None,
                radius,
                places,
            }),
        }
    }

    fn with_unit(mut self, unit: Option<f64>) -> Experiment {
        if let ExperimentKind::Presses(presses) = &mut self.kind {
            presses.length_unit_m = unit;
        }
        self
    }

    /// Whether it is a map of stiffness.
    pub(super) fn is_map(&self) -> bool {
        matches!(&self.kind, ExperimentKind::Presses(presses) if presses.is_map)
    }

    /// Whether it is a recording of markers.
    pub fn is_recording(&self) -> bool {
        matches!(self.kind, ExperimentKind::Recording(_))
    }
}

impl Presses {
    /// Returns the presses with lengths in units of `unit` metres, in which the body is, and the depths of
    /// a map.
    pub(super) fn in_unit(&self, unit: f64) -> Presses {
        let factor = self.length_unit_m.map_or(1.0, |own| own / unit);
        let mut other = self.clone();
        other.radius *= factor;
        for place in &mut other.places {
            place.at *= factor;
            place.observed.iter_mut().for_each(|own| own.at *= factor);
            if self.is_map {
                for own in &mut place.observed {
                    place.depths = step_depths(own.depth, unit * other.radius).collect();
                    own.weights = line_weights(&place.depths, own.depth);
                }
            }
        }
        other
    }
}

/// Returns the weights of the forces at the steps to a depth in the slope of the line that a map fits to the
/// deeper ones; one in their middle has none.
fn line_weights(depths: &[f64], deepest: f64) -> Vec<(usize, f64)> {
    let fitted = depths.iter().copied().enumerate();
    let fitted: Vec<(usize, f64)> = fitted
        .filter(|(_, d)| *d >= FIT_FRACTION * deepest)
        .collect();
    let mean = fitted.iter().map(|(_, d)| d).sum::<f64>() / fitted.len() as f64;
    let spread: f64 = fitted.iter().map(|(_, d)| (d - mean).powi(2)).sum();
    let weights = fitted.iter().map(|(k, d)| (*k, (d - mean) / spread));
    weights.filter(|(_, by)| by * by * spread > 1e-9).collect()
}

fn curve(
    path: &Path,
    table: &NumberTable,
    columns: Vec<usize>,
    about: &Path,
) -> Result<Experiment> {
    let conditions: CurveConditions = read_json(about)?;
    let unit = conditions.length_unit_m.unwrap_or(1.0);
    let samples: Vec<[f64; 2]> = table
        .loading()
        .map(|row| [row[columns[0]], row[columns[1]]])
        .collect();
    let place = (
        DVec3::from(conditions.at),
        DVec3::from(conditions.direction),
        conditions.radius_m / unit,
    );
    let found = Experiment::curve(&path.display().to_string(), place, &samples)?;
    Ok(found.with_unit(conditions.length_unit_m))
}

fn map(path: &Path, table: &NumberTable, columns: Vec<usize>, about: &Path) -> Result<Experiment> {
    let conditions: MapConditions = read_json(about)?;
    let points: Vec<(DVec3, f64)> = table
        .loading()
        .map(|row| {
            let [x, y, z, k] = [0, 1, 2, 3].map(|c| row[columns[c]]);
            (DVec3::new(x, y, z), k)
        })
        .collect();
    let how = (
        DVec3::from(conditions.direction),
        conditions.radius,
        conditions.depth * conditions.length_unit_m,
    );
    let found = Experiment::map(&path.display().to_string(), how, &points)?;
    Ok(found.with_unit(Some(conditions.length_unit_m)))
}

fn read_json<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    serde_json::from_str(&text).map_err(|e| {
        let what = format!(
            "{e}; it must say where and how was pressed (docs/how-to/identify.md), as palpate press writes it"
        );
        Error::format(path, what)
    })
}

/// Rows of numbers; text that is none is NaN.
pub(super) struct NumberTable {
    names: Vec<String>,
    pub rows: Vec<Vec<f64>>,
    /// Of each row the text in the column `phase`.
    phases: Vec<Option<String>>,
}

impl NumberTable {
    /// Reads a CSV file.
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Io`].
    pub fn read(path: &Path) -> Result<NumberTable> {
        let wrong = |e: csv::Error| Error::format(path, e.to_string());
        let file = std::fs::File::open(path).map_err(Error::io(path))?;
        let mut reader = csv::Reader::from_reader(file);
        let names: Vec<String> = reader
            .headers()
            .map_err(wrong)?
            .iter()
            .map(|name| name.trim().to_owned())
            .collect();
        let phase = names.iter().position(|name| name == "phase");
        let (mut rows, mut phases) = (Vec::new(), Vec::new());
        for record in reader.records() {
            let record = record.map_err(wrong)?;
            let numbers = record.iter().map(|x| x.trim().parse().unwrap_or(f64::NAN));
            rows.push(numbers.collect());
            phases.push(phase.and_then(|k| record.get(k)).map(str::to_owned));
        }
        match rows.is_empty() {
            true => Err(Error::format(
                path,
                "the file has no rows of numbers; it needs one at least".to_owned(),
            )),
            false => Ok(NumberTable {
                names,
                rows,
                phases,
            }),
        }
    }

    /// Returns the numbers of the columns of these names, if all are there.
    pub fn columns(&self, wanted: &[&str]) -> Option<Vec<usize>> {
        let of = |name: &&str| self.names.iter().position(|own| own == name);
        wanted.iter().map(of).collect()
    }

    /// Returns the rows of loading: all without a column `phase`.
    fn loading(&self) -> impl Iterator<Item = &Vec<f64>> {
        let rows = self.rows.iter().zip(&self.phases);
        let load = rows.filter(|(_, phase)| phase.as_deref().is_none_or(|phase| phase == "load"));
        load.map(|(row, _)| row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weights are those of the slope that `palpate press --map` fits.
    #[test]
    fn slope_of_map_is_that_of_line() {
        let depths: Vec<f64> = step_depths(0.006, 0.012).collect();
        let weights = line_weights(&depths, 0.006);
        let all = [0.00392, 0.00496, 0.006];
        let force = |d: f64| 400.0 * d.powf(1.5);
        let pairs = all.iter().map(|d| (d - all[1]) * force(*d));
        let line = pairs.sum::<f64>() / (2.0 * 0.00104f64.powi(2));
        let slope: f64 = weights.iter().map(|(k, by)| by * force(depths[*k])).sum();
        assert_eq!((depths.len(), weights.len()), (6, 2));
        assert!((slope / line - 1.0).abs() < 1e-9, "{slope} {line}");
    }
}
