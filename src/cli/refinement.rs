//! `--within`: the meshes on the way, in words, and the stage of a refined scene.

use super::progress;
use clap::Args;
use palpate::Error;
use palpate::accuracy::{ErrorParts, Round};
use palpate::gpu::Gpu;
use palpate::number_format::{rounded, significant};
use palpate::scene::{AccuracyEntry, OrderChoice, Scene, Stage};

/// Flags of the elements and of the error that a number may have; each overrides a value of the scene file.
#[derive(Args, Clone, Debug, Default)]
pub struct AccuracyFlags {
    /// Set the order of the finite elements: 1 (linear tets), 2 (quadratic tets, far fewer of which
    /// have the same error) or auto (2 for at most 30,000 tets) [default: 1; auto for a single press]
    #[arg(long, value_name = "N", help_heading = "Accuracy")]
    pub order: Option<OrderChoice>,
    #[command(flatten)]
    pub within: WithinFlags,
}

/// Flags of the error that a number may have; each overrides a value of the scene file.
#[derive(Args, Clone, Debug, Default)]
pub struct WithinFlags {
    /// Refine the mesh where it is too coarse, and raise the order of its elements, until the error of
    /// a number is at most this share of it, such as 2%: of the largest force of a press, otherwise
    /// --of
    #[arg(long, value_name = "PERCENT", value_parser = percent, help_heading = "Accuracy")]
    pub within: Option<f64>,
    /// Set the number for --within: displacement (the largest), energy, volume, or the name of a pin or
    /// tool, for the force on it [default: displacement]
    #[arg(long, value_name = "NUMBER", help_heading = "Accuracy")]
    pub of: Option<String>,
    /// Set the largest number of elements for --within [default: 300000]
    #[arg(long, value_name = "N", help_heading = "Accuracy")]
    pub max_tets: Option<usize>,
}

impl WithinFlags {
    /// Overrides the values of a scene.
    ///
    /// # Errors
    /// [`Error::Input`] for flags that have no effect without --within.
    pub fn apply_to(&self, scene: &mut Scene) -> palpate::Result<()> {
        let entry = &mut scene.accuracy;
        entry.within = self.within.or(entry.within);
        entry.of = self.of.clone().or(entry.of.take());
        entry.max_tets = self.max_tets.or(entry.max_tets);
        match (entry.within, &self.of, self.max_tets) {
            (None, Some(_), _) | (None, _, Some(_)) => Err(Error::Input(
                "--of and --max-tets belong to --within, such as --within 2%".into(),
            )),
            _ => Ok(()),
        }
    }
}

pub(super) fn percent(text: &str) -> Result<f64, String> {
    AccuracyEntry::parse_share(text).map_err(|e| e.to_string())
}

/// Returns a line about a mesh on the way, with what the number is and its unit.
pub fn in_words(round: &Round, (what, unit): (&str, &str)) -> String {
    let number = match round.error.zip(round.share()) {
        Some((mesh, share)) => {
            let error = ErrorParts {
                mesh,
                ..ErrorParts::default()
            };
            let number = error.around(round.value, unit);
            format!("{number} ({:.1} %)", 100.0 * share)
        }
        None => format!("{} {unit}", significant(round.value)),
    };
    let line = format!(
        "{} tets of order {}: {what} {number}, {} s",
        round.elements,
        round.order,
        rounded(round.seconds, 2)
    );
    // Numbers without a unit.
    line.replace("  ", " ").replace(" , ", ", ")
}

/// Returns what the number is that a scene is refined for, and its unit.
pub fn unit(scene: &Scene) -> (&'static str, &'static str) {
    match scene.accuracy.of.as_deref() {
        None | Some("displacement") => ("largest displacement", ""),
        Some("energy") => ("elastic energy", "J"),
        Some("volume") => ("volume ratio", ""),
        Some(_) => ("force", "N"),
    }
}

/// Creates the stage of `scene`: on a refined mesh if it asks for that. Also returns why its number is
/// not as exact as wanted, if so.
pub fn stage(gpu: &Gpu, scene: &Scene) -> palpate::Result<(Stage, Option<String>)> {
    if scene.accuracy.within.is_none() {
        let stage = progress::with_message("preparing", || Stage::new(gpu, scene))?;
        return Ok((stage, None));
    }
    let unit = unit(scene);
    let mut on_round = |round: &Round| super::print_notes(&[in_words(round, unit)]);
    progress::with_stages(|progress| Stage::refined(gpu, scene, &mut on_round, progress))
}

/// Fails if a number is not as exact as wanted.
pub fn check(missed: Option<String>) -> anyhow::Result<()> {
    match missed {
        Some(why) => anyhow::bail!("the number is not as exact as wanted (--within): {why}"),
        None => Ok(()),
    }
}
