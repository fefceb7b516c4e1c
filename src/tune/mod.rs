//! The cheapest way to simulate and draw a scene that is as accurate as asked for.
//!
//! Truth is the fine body's converged motion, and its picture with the finest table at full size.
//! Candidates of motion (cage, solver, step, tolerance of its iterations) and of the picture
//! (size, table) are timed on the machine at hand by a short probe each; then they are held
//! against truth from the cheapest on ([`cheapest`]), until one is accurate enough. So
//! the choice is the cheapest there is, and a looser tolerance never costs more.

mod motion;
mod picture;
mod search;
mod write;

pub use motion::{Body, Cost, MotionPoint, MotionSearch};
pub use picture::{PicturePoint, PictureSearch};
pub use search::{Candidates, SearchResult, cheapest};
pub use write::{Change, EntryValue};

use crate::gpu::Gpu;
use crate::scene::Scene;
use crate::{Error, ProgressFn, Result};
use std::path::Path;

/// What a scene is tuned to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TuneTarget {
    /// The largest error: of motion, the root mean square distance from the true places over that
    /// of the true displacements; of a picture, the root mean square difference of its values.
    pub error: f64,
    /// Pictures a second, of a body that moves as fast as in life.
    pub fps: Option<f64>,
    /// Seconds of motion that are held against truth.
    pub seconds: f64,
}

/// A scene tuned, or what comes nearest.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// What moves the body, if anything does.
    pub motion: Option<SearchResult<MotionPoint>>,
    /// How it is drawn.
    pub picture: SearchResult<PicturePoint>,
    /// Milliseconds for a second of motion, and for a picture.
    pub cost: [f64; 2],
    /// Whether tolerance and pictures a second are met.
    pub target_met: bool,
    /// What was chosen, and what would have to give where nothing meets what is wanted; a sentence
    /// each.
    pub notes: Vec<String>,
    /// The scene with what was chosen.
    pub scene: Scene,
}

/// Finds the cheapest settings for `scene` on `gpu` that meet what is `wanted`; `progress` is told
/// what is being done and the fraction of it that is done.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::Input`] for a tolerance that makes no sense, a scene whose body is a grid or is cut,
/// or one in which nothing moves as far as can be seen; otherwise as
/// [`Stage::new`](crate::scene::Stage::new).
pub fn tune(gpu: &Gpu, scene: &Scene, wanted: &TuneTarget, progress: ProgressFn) -> Result<Tuned> {
    let sound = |x: f64| x.is_finite() && x > 0.0;
    if !sound(wanted.error) || !sound(wanted.seconds) || !wanted.fps.is_none_or(sound) {
        return Err(Error::Input(format!(
            "an error of {}, {} s{} cannot all be; give positive numbers",
            wanted.error,
            wanted.seconds,
            match wanted.fps {
                Some(fps) => format!(" and {fps} pictures a second"),
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
            let found = cheapest(&mut motions, wanted.error, &|f| progress("motion", f))?;
            cost[0] = found.cost;
            notes.push(found.summary("motion", "ms for a second of it", wanted.error));
            found.point.apply(&mut tuned);
            (Some(found), Some(motions.final_reference()))
        }
    };
    let mut pictures = PictureSearch::new(gpu, scene, there)?;
    let picture = cheapest(&mut pictures, wanted.error, &|f| progress("picture", f))?;
    cost[1] = picture.cost;
    notes.push(picture.summary("picture", "ms each", wanted.error));
    picture.point.apply(&mut tuned);
    let accurate = picture.met && motion.as_ref().is_none_or(|m| m.met);
    let mut met = accurate;
    if let Some(fps) = wanted.fps {
        let busy = cost[0] + fps * cost[1];
        let possible = (1000.0 - cost[0]).max(0.0) / cost[1];
        if busy > 1000.0 {
            met = false;
            notes.push(format!(
                "{fps} pictures a second take {busy:.0} ms of each second: {}",
                match possible >= 1.0 {
                    true => format!("be content with {possible:.0}, or with a larger error"),
                    false => "the motion alone is slower than life; be content with a larger error, a coarser mesh, or a faster machine".to_owned(),
                }
            ));
            for (found, what) in [
                motion
                    .as_ref()
                    .map(|m| (m.pareto_front.as_slice(), "motion")),
                Some((picture.pareto_front.as_slice(), "picture")),
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
                        "within half of that time the {what} has an error of {:.2} % ({cost:.2} ms)",
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
    })
}

impl Tuned {
    /// What is to be changed in the file of the scene, in this order.
    pub fn changes(&self) -> Vec<Change> {
        write::changes(self)
    }

    /// Writes the scene file `from` again as `to`, with what was chosen; files that it names are
    /// found from there.
    ///
    /// # Errors
    /// As reading and writing a scene.
    pub fn write(&self, from: &Path, to: &Path) -> Result<()> {
        write::write(self, from, to)
    }
}
