//! Where markers are over time, in the motion of a scene from its start.

use super::recorded_body::RecordedBody;
use super::recording::Recorded;
use crate::gpu::Gpu;
use crate::mesh::TetMesh;
use crate::progress::ProgressScope;
use crate::scene::Scene;
use crate::{Error, ProgressFn, Result};
use glam::DVec3;

/// Residual to which steps are solved unless the scene says: lagged friction converges, so that what is
/// predicted changes smoothly with the unknowns.
const STEP_TOLERANCE: f64 = 1e-8;
/// Longest time step of a scene that has none, s.
const LONGEST_STEP: f64 = 0.0025;

/// Returns the position at a time between rows of a track; `None` outside of them.
pub(super) fn position_at(times: &[f64], track: &[DVec3], time: f64) -> Option<DVec3> {
    let next = times.partition_point(|t| *t < time);
    let (to, end) = (times.get(next)?, track.get(next)?);
    if *to == time {
        return Some(*end);
    }
    let before = next.checked_sub(1)?;
    let share = (time - times[before]) / (to - times[before]);
    Some(track[before].lerp(*end, share))
}

impl RecordedBody {
    /// Returns how far each marker has moved at each time, m, in three components, for each take. Steps are
    /// `finer` times as short as those of the scene.
    ///
    /// # Errors
    /// As a simulation step.
    pub fn motion(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        finer: u32,
        progress: ProgressFn,
    ) -> Result<Vec<f64>> {
        let Recorded::Motion { times, takes, .. } = &self.recorded else {
            return Ok(Vec::new());
        };
        let mut scene = scene.clone();
        scene.solver.tolerance.get_or_insert(STEP_TOLERANCE);
        let mut body = self.body(gpu, (&scene, mesh), super::recorded_body::scheme_of(&scene))?;
        let longest = scene.solver.dt.unwrap_or(LONGEST_STEP) / f64::from(finer);
        let (mut numbers, mut now) = (Vec::new(), 0.0);
        let end = times.last().copied().unwrap_or(0.0);
        for time in times {
            // Rounding of times adds no step.
            let steps = ((time - now) / longest - 1e-6).ceil().max(1.0);
            body.motion.dt = (time - now) / steps;
            body.motion.run(steps as u32, &mut |_| {})?;
            now = *time;
            for marker in 0..body.markers() {
                numbers.extend(body.displacement(marker)?.to_array());
            }
            ProgressScope::begin(progress, "moving", now / end)?.check_cancelled()?;
        }
        // Each take has the same prediction.
        Ok(numbers.repeat(takes.len()))
    }

    /// Returns the error of the displacements of a motion by the mesh and by the length of its steps, relative
    /// to the largest.
    ///
    /// # Errors
    /// As a simulation step; [`Error::Input`] for markers that do not move.
    pub fn error_of_motion(
        &self,
        (gpu, scene, mesh): (&Gpu, &Scene, &TetMesh),
        (finer_scene, finer, factor): (&Scene, &TetMesh, f64),
        progress: ProgressFn,
    ) -> Result<f64> {
        let own = self.motion((gpu, scene, mesh), 1, progress)?;
        let shorter = self.motion((gpu, scene, mesh), 2, progress)?;
        let better = self.motion((gpu, finer_scene, finer), 1, progress)?;
        let largest = |of: &mut dyn Iterator<Item = f64>| of.map(f64::abs).fold(0.0, f64::max);
        let scale = largest(&mut own.iter().copied());
        if scale == 0.0 {
            return Err(Error::Input(
                "the markers do not move in the scene; give it the tools, loads and motions of the recording".into(),
            ));
        }
        let off = |other: &[f64]| largest(&mut own.iter().zip(other).map(|(a, b)| a - b));
        // The error of a scheme of first order is twice the difference.
        Ok((factor * off(&better) + 2.0 * off(&shorter)) / scale)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn positions_between_rows_are_interpolated() {
        let track = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 2.0, 0.0)];
        let at = |time: f64| position_at(&[0.1, 0.2, 0.4], &track, time);
        assert!(
            at(0.35)
                .unwrap()
                .abs_diff_eq(DVec3::new(1.0, 1.5, 0.0), 1e-12)
        );
        assert_eq!((at(0.1), at(0.4)), (Some(track[0]), Some(track[2])));
        assert_eq!((at(0.05), at(0.45)), (None, None));
    }
}
