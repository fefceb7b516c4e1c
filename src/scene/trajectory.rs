//! Paths of attachments and cutters: places at times, linear between them.

use super::TimeSeries;
use crate::{Error, Result, files};
use glam::{DQuat, DVec3};
use std::path::Path;

/// Refuses a path of fewer than `least` places, or whose times do not increase.
pub(super) fn check(path: &[[f64; 4]], least: usize, what: &str) -> Result<()> {
    let ordered = path.windows(2).all(|w| w[0][0] < w[1][0]);
    let finite = path.iter().flatten().all(|x| x.is_finite());
    if path.len() < least || !ordered || !finite {
        return Err(Error::Input(format!(
            "the path of a {what} should be a list of at least {least} [time, x, y, z], the times increasing"
        )));
    }
    Ok(())
}

/// The value at `time` of what has values at times, linear between them and the same beyond.
pub(super) fn value_at(keys: &[[f64; 2]], time: f64) -> f64 {
    let after = keys.partition_point(|key| key[0] <= time);
    let before = after.checked_sub(1).and_then(|n| keys.get(n));
    match (before, keys.get(after)) {
        (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (time - a[0]) / (b[0] - a[0]),
        (Some(only), None) | (None, Some(only)) => only[1],
        (None, None) => 0.0,
    }
}

/// The header of a path in a file.
const HEADER: &str = "time_s,x,y,z";

/// Reads a path from a CSV file.
pub(super) fn read_path(file: &Path) -> Result<Vec<[f64; 4]>> {
    let text = files::read_text(file)?;
    let mut lines = text.lines().enumerate();
    let header = lines.next().map(|(_, line)| line.replace(' ', ""));
    if header.as_deref() != Some(HEADER) {
        return Err(Error::format(
            file,
            format!("line 1: a path begins with the line {HEADER}"),
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
                        "line {}: four numbers {HEADER} are expected, not \"{line}\"",
                        i + 1
                    ),
                ));
            }
        }
    }
    check(&path, 1, "move").map_err(|e| Error::format(file, e.to_string()))?;
    Ok(path)
}

/// The second difference of places over the two steps of length `dt` that end at `time`.
pub(super) fn second_difference(place: impl Fn(f64) -> DVec3, time: f64, dt: f64) -> DVec3 {
    (place(time) - 2.0 * place(time - dt) + place(time - 2.0 * dt)) / (dt * dt)
}

/// Where a path is at `time`.
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

/// How something is moved and turned as time goes on.
#[derive(Clone, Debug)]
pub(super) struct RigidTrajectory {
    path: Vec<[f64; 4]>,
    turn: Vec<[f64; 2]>,
    axis: DVec3,
}

impl RigidTrajectory {
    /// The way of a `what` with a path, or the file of one, and with a turn about an axis.
    ///
    /// # Errors
    /// [`Error::Input`] for what makes no sense, and what reading the file gives.
    pub fn new(
        what: &str,
        (path, file): (Option<&[[f64; 4]]>, Option<&Path>),
        (turn, axis): (Option<&[[f64; 2]]>, Option<[f64; 3]>),
    ) -> Result<RigidTrajectory> {
        let path = match (path, file) {
            (Some(_), Some(_)) => {
                return Err(Error::Input(format!(
                    "a [[{what}]] has both `path` and `file`; give one of them"
                )));
            }
            (Some(path), None) => path.to_vec(),
            (None, Some(file)) => read_path(file)?,
            (None, None) => vec![[0.0; 4]],
        };
        check(&path, 1, what)?;
        let turn = turn.unwrap_or_default().to_vec();
        if !turn.is_empty() {
            TimeSeries::Keys(turn.clone()).check("turn")?;
        }
        let unit = DVec3::from(axis.unwrap_or([0.0, 0.0, 1.0])).normalize_or_zero();
        if unit == DVec3::ZERO || axis.is_some() == turn.is_empty() {
            return Err(Error::Input(format!(
                "a [[{what}]] turns about an `axis`, a direction, by a `turn`, a list of [time, degrees]; give both or neither"
            )));
        }
        Ok(RigidTrajectory {
            path,
            turn,
            axis: unit,
        })
    }

    /// How it is turned at `time`, and by how much it has moved.
    pub fn at(&self, time: f64) -> (DQuat, DVec3) {
        let turned = match self.turn.is_empty() {
            true => DQuat::IDENTITY,
            false => DQuat::from_axis_angle(self.axis, value_at(&self.turn, time).to_radians()),
        };
        (turned, position_at(&self.path, time))
    }

    /// Whether it is not always the same.
    pub fn is_moving(&self) -> bool {
        let places = self.path.windows(2).any(|w| w[0][1..] != w[1][1..]);
        places || self.turn.windows(2).any(|w| w[0][1] != w[1][1])
    }
}
