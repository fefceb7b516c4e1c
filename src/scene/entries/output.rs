//! Entry of the files written in addition to the pictures.

use serde::Deserialize;
use std::path::PathBuf;

/// Fields and files that a run writes with its meshes.
///
/// ```toml
/// [output]
/// fields = ["von_mises", "J", "stress_1@nodes"]  # computed for the body; per tet, or at the nodes
/// reactions = "reactions.csv"    # reactions at pins and grabs, for each frame
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct OutputEntry {
    /// Computed fields added to the meshes: names of [`BodyField`](crate::physics::BodyField), one
    /// value per tetrahedron; a name with the suffix `@nodes` gives the mean around each node.
    /// `displacement` and `velocity` are always written.
    #[serde(default)]
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [["von_mises", "J", "stress_1@nodes"]])))]
    pub fields: Vec<String>,
    /// CSV file, in the output folder, of the reactions at all supports: see
    /// [`ReactionLog`](crate::scene::ReactionLog).
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["reactions.csv"])))]
    pub reactions: Option<PathBuf>,
}
