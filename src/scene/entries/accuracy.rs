//! Entry of how exact a number has to be.

#[cfg(feature = "cli")]
use crate::scene::schema;
use crate::{Error, Result};
use serde::{Deserialize, Deserializer, de};

/// How exact a number has to be: `palpate press` (at one point, and at each of a map), `render` and
/// `simulate` refine the mesh until it is, and the window refines for the force of a press that rests.
///
/// ```toml
/// [accuracy]
/// within = "2%"            # of the number
/// of = "displacement"      # the largest (the default), "energy", "volume", or the name of a pin or
///                          # tool, for the force on it; a press takes the largest force
/// max_tets = 300000        # the default
/// ```
#[derive(Clone, Debug, Default, Deserialize, PartialEq)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct AccuracyEntry {
    /// Largest error, relative to the number: `"2%"` in files is 0.02.
    #[serde(default, deserialize_with = "share")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::percentage", extend("examples" = ["2%"])))]
    pub within: Option<f64>,
    /// The number: `displacement`, `energy`, `volume`, or the name of a pin or tool.
    #[cfg_attr(feature = "cli", schemars(extend("default" = "displacement", "examples" = ["energy", "finger"])))]
    pub of: Option<String>,
    /// Largest number of elements of the mesh.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 300_000, "minimum" = 1, "examples" = [100_000])))]
    pub max_tets: Option<usize>,
}

impl AccuracyEntry {
    /// Largest number of elements by default.
    pub const MAX_TETS: usize = 300_000;

    /// Returns the share that a percentage such as `2%` is.
    ///
    /// # Errors
    /// [`Error::Input`] if it is none above 0 and up to 100.
    pub fn parse_share(text: &str) -> Result<f64> {
        let number = text
            .trim()
            .strip_suffix('%')
            .map(|n| n.trim().parse::<f64>());
        match number {
            Some(Ok(percent)) if percent > 0.0 && percent <= 100.0 => Ok(percent / 100.0),
            _ => Err(Error::Input(format!(
                "expected a percentage above 0 and up to 100, such as 2%, got \"{text}\""
            ))),
        }
    }
}

fn share<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<Option<f64>, D::Error> {
    let text = String::deserialize(from)?;
    let share = AccuracyEntry::parse_share(&text).map_err(de::Error::custom)?;
    Ok(Some(share))
}
