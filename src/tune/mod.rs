//! Finds the cheapest simulation and rendering settings of a scene for a given accuracy.
//!
//! The reference is the converged motion of the fine body, of quadratic tets if it supports them, and
//! its image with the finest table at full size. Candidates of motion (cage, order of the elements,
//! solver, time step, solver tolerance) and of the image
//! (size, table) are each timed on this machine by a short probe; then they are compared with the
//! reference in order of cost ([`SearchResult::cheapest`]), until one is accurate enough. So the choice is the
//! cheapest of all candidates, and a looser tolerance never costs more.

mod motion;
mod motion_point;
mod picture;
mod refined;
mod search;
mod write;

pub use motion::{Cost, MotionSearch};
pub use motion_point::{Body, MotionPoint};
pub(crate) use picture::PicturePoint;
pub(crate) use picture::PictureSearch;
pub use refined::tune_file;
pub use search::{Candidates, SearchResult};
pub use write::{Change, EntryValue};

use crate::gpu::Gpu;
use crate::scene::Scene;
use crate::{Error, ProgressFn, Result};
use std::path::Path;

/// Accuracy and speed that a scene is tuned to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TuneTarget {
    /// Maximum error: of motion, the RMS distance from the reference positions relative to the RMS
    /// reference displacement; of an image, the RMS difference of its values.
    pub error: f64,
    /// Required images per second, for motion in real time.
    pub fps: Option<f64>,
    /// Simulated duration compared with the reference solution, s.
    pub seconds: f64,
}

/// A tuned scene, or the closest candidate if the target cannot be met.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// Result of the motion search; `None` without a solver.
    pub motion: Option<SearchResult<MotionPoint>>,
    /// Result of the image search.
    pub picture: SearchResult<PicturePoint>,
    /// Milliseconds per second of motion, and per image.
    pub cost: [f64; 2],
    /// Whether error and frame rate meet the target.
    pub target_met: bool,
    /// The choices, and trade-offs if the target is not met; one sentence each.
    pub notes: Vec<String>,
    /// The scene with the chosen settings.
    pub scene: Scene,
    /// Whether its mesh was refined first ([`tune_file`]).
    pub has_refined_mesh: bool,
}

/// Finds the cheapest settings for `scene` on `gpu` that meet the target `wanted`; calls `progress`
/// with the current task and its completed fraction.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::Input`] for an invalid target, a grid body, a scene with cuts, or
/// one without visible motion; otherwise as [`Stage::new`](crate::scene::Stage::new).
pub fn tune(gpu: &Gpu, scene: &Scene, wanted: &TuneTarget, progress: ProgressFn) -> Result<Tuned> {
    let sound = |x: f64| x.is_finite() && x > 0.0;
    if !sound(wanted.error) || !sound(wanted.seconds) || !wanted.fps.is_none_or(sound) {
        return Err(Error::Input(format!(
            "error, duration and frame rate must be positive and finite, got {}, {} s{}",
            wanted.error,
            wanted.seconds,
            match wanted.fps {
                Some(fps) => format!(" and {fps} images per second"),
                None => String::new(),
            }
        )));
    }
    let mut tuned = scene.clone();
    let mut notes = Vec::new();
    let mut cost = [0.0; 2];
    let (motion, there) = match &scene.solver.name {
        None => (None, None),
        Some(_) => {
            let mut motions = MotionSearch::new(gpu, scene, wanted.seconds, Cost::Time, progress)?;
            let found =
                SearchResult::cheapest(&mut motions, wanted.error, &|f| progress("motion", f))?;
            cost[0] = found.cost;
            notes.push(found.summary("motion", "ms per simulated second", wanted.error));
            found.point.apply(&mut tuned);
            (Some(found), Some(motions.final_reference()))
        }
    };
    let mut pictures = PictureSearch::new(gpu, scene, there)?;
    let picture = SearchResult::cheapest(&mut pictures, wanted.error, &|f| progress("picture", f))?;
    cost[1] = picture.cost;
    notes.push(picture.summary("image", "ms per image", wanted.error));
    picture.point.apply(&mut tuned);
    let accurate = picture.met && motion.as_ref().is_none_or(|m| m.met);
    let mut met = accurate;
    if let Some(fps) = wanted.fps {
        let busy = cost[0] + fps * cost[1];
        let possible = (1000.0 - cost[0]).max(0.0) / cost[1];
        if busy > 1000.0 {
            met = false;
            notes.push(format!(
                "target of {fps} images per second not met: motion and images take {busy:.0} ms per second; {}",
                match possible >= 1.0 {
                    true => format!("reduce it to {possible:.0}, or increase the error"),
                    false => "the motion alone is slower than real time; increase the error, or use a coarser mesh or a faster machine".to_owned(),
                }
            ));
            for (found, what) in [
                motion
                    .as_ref()
                    .map(|m| (m.pareto_front.as_slice(), "motion")),
                Some((picture.pareto_front.as_slice(), "image")),
            ]
            .into_iter()
            .flatten()
            {
                let budget = match what {
                    "motion" => 500.0,
                    _ => 500.0 / fps,
                };
                let affordable = found.iter().filter(|(cost, _)| *cost <= budget);
                if let Some((cost, error)) = affordable.min_by(|a, b| a.1.total_cmp(&b.1)) {
                    notes.push(format!(
                        "at half that time, the {what} has an error of {:.2} % ({cost:.2} ms)",
                        100.0 * error
                    ));
                }
            }
        }
    }
    Ok(Tuned {
        motion,
        picture,
        cost,
        target_met: met,
        notes,
        scene: tuned,
        has_refined_mesh: false,
    })
}

impl Tuned {
    /// Returns the changes of the scene file, in order.
    pub fn changes(&self) -> Vec<Change> {
        write::changes(self)
    }

    /// Writes the scene file `from` with the chosen settings as `to`; adjusts the paths of files
    /// that it refers to.
    ///
    /// # Errors
    /// As reading and writing a scene.
    pub fn write(&self, from: &Path, to: &Path) -> Result<()> {
        write::write(self, from, to)
    }
}
