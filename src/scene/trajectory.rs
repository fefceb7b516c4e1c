//! Piecewise linear paths of grabs, cuts, moves and tools.

use super::TimeSeries;
use crate::{Error, Result, files};
use glam::{DQuat, DVec3};
use std::path::Path;

/// Rejects a path with fewer than `least` points, or whose times do not increase.
pub(super) fn check(path: &[[f64; 4]], least: usize, what: &str) -> Result<()> {
    let ordered = path.windows(2).all(|w| w[0][0] < w[1][0]);
    let finite = path.iter().flatten().all(|x| x.is_finite());
    if path.len() < least || !ordered || !finite {
        return Err(Error::Input(format!(
            "the path of a {what} must be a list of at least {least} [time, x, y, z] with increasing times"
        )));
    }
    Ok(())
}

/// Returns the value at `time` by linear interpolation, constant outside the range of times.
pub(super) fn value_at(keys: &[[f64; 2]], time: f64) -> f64 {
    let after = keys.partition_point(|key| key[0] <= time);
    let before = after.checked_sub(1).and_then(|n| keys.get(n));
    match (before, keys.get(after)) {
        (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (time - a[0]) / (b[0] - a[0]),
        (Some(only), None) | (None, Some(only)) => only[1],
        (None, None) => 0.0,
    }
}

/// Header of a path file.
const HEADER: &str = "time_s,x,y,z";

/// Reads a path from a CSV file.
pub(super) fn read_path(file: &Path) -> Result<Vec<[f64; 4]>> {
    let text = files::read_text(file)?;
    let mut lines = text.lines().enumerate();
    let header = lines.next().map(|(_, line)| line.replace(' ', ""));
    if header.as_deref() != Some(HEADER) {
        return Err(Error::format(
            file,
            format!("line 1: a path file must begin with the line {HEADER}"),
        ));
    }
    let mut path = Vec::new();
    for (i, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let numbers: std::result::Result<Vec<f64>, _> =
            line.split(',').map(|cell| cell.trim().parse()).collect();
        match numbers.ok().map(<[f64; 4]>::try_from) {
            Some(Ok(row)) => path.push(row),
            _ => {
                return Err(Error::format(
                    file,
                    format!(
                        "line {}: expected four numbers {HEADER}, got \"{line}\"",
                        i + 1
                    ),
                ));
            }
        }
    }
    check(&path, 1, "move").map_err(|e| Error::format(file, e.to_string()))?;
    Ok(path)
}

/// Returns the acceleration as the second difference of positions over the two steps of length `dt`
/// that end at `time`.
pub(super) fn second_difference(place: impl Fn(f64) -> DVec3, time: f64, dt: f64) -> DVec3 {
    (place(time) - 2.0 * place(time - dt) + place(time - 2.0 * dt)) / (dt * dt)
}

/// Returns the position on a path at `time`.
pub(super) fn position_at(path: &[[f64; 4]], time: f64) -> DVec3 {
    let place = |p: &[f64; 4]| DVec3::new(p[1], p[2], p[3]);
    let after = path.partition_point(|p| p[0] <= time);
    match (
        after.checked_sub(1).and_then(|n| path.get(n)),
        path.get(after),
    ) {
        (Some(a), Some(b)) => place(a).lerp(place(b), (time - a[0]) / (b[0] - a[0])),
        (Some(only), None) | (None, Some(only)) => place(only),
        (None, None) => DVec3::ZERO,
    }
}

/// Translation and rotation over time.
#[derive(Clone, Debug, Default)]
pub(super) struct RigidTrajectory {
    path: Vec<[f64; 4]>,
    turn: Vec<[f64; 2]>,
    axis: DVec3,
}

impl RigidTrajectory {
    /// Creates the trajectory of a `what` from a path or a path file, and a rotation about an axis.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid entries, or an error of reading the file.
    pub fn new(
        what: &str,
        (path, file): (Option<&[[f64; 4]]>, Option<&Path>),
        (turn, axis): (Option<&[[f64; 2]]>, Option<[f64; 3]>),
    ) -> Result<RigidTrajectory> {
        let path = match (path, file) {
            (Some(_), Some(_)) => {
                return Err(Error::Input(format!(
                    "a [[{what}]] has both `path` and `file`; remove one of them"
                )));
            }
            (Some(path), None) => path.to_vec(),
            (None, Some(file)) => read_path(file)?,
            (None, None) => vec![[0.0; 4]],
        };
        check(&path, 1, what)?;
        let turn = turn.unwrap_or_default().to_vec();
        if !turn.is_empty() {
            TimeSeries::Keys(turn.clone()).check("rotation")?;
        }
        let unit = DVec3::from(axis.unwrap_or([0.0, 0.0, 1.0])).normalize_or_zero();
        if unit == DVec3::ZERO || axis.is_some() == turn.is_empty() {
            return Err(Error::Input(format!(
                "the rotation of a [[{what}]] must have both `axis`, a direction, and `rotation`, a list of [time, degrees]"
            )));
        }
        Ok(RigidTrajectory {
            path,
            turn,
            axis: unit,
        })
    }

    /// Returns the rotation and the translation at `time`.
    pub fn at(&self, time: f64) -> (DQuat, DVec3) {
        let turned = match self.turn.is_empty() {
            true => DQuat::IDENTITY,
            false => DQuat::from_axis_angle(self.axis, value_at(&self.turn, time).to_radians()),
        };
        (turned, position_at(&self.path, time))
    }

    /// Whether it changes over time.
    pub fn is_moving(&self) -> bool {
        let places = self.path.windows(2).any(|w| w[0][1..] != w[1][1..]);
        places || self.turn.windows(2).any(|w| w[0][1] != w[1][1])
    }
}
