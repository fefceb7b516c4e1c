//! What is written beside pictures.

use serde::Deserialize;
use std::path::PathBuf;

/// What a run writes with its meshes, and beside them.
///
/// ```toml
/// [output]
/// fields = ["von_mises", "J", "stress_1@nodes"]  # computed of the body; in tets, or at the nodes
/// reactions = "reactions.csv"    # what the body exerts on pins and grabs, for each frame
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputEntry {
    /// Fields computed of the body that go into its meshes: names of
    /// [`BodyField`](crate::physics::BodyField), one value a tet; with `@nodes` behind a name the
    /// means around each node. `displacement` and `velocity` are always there.
    #[serde(default)]
    pub fields: Vec<String>,
    /// A CSV file, in the folder of the output, of what the body exerts on everything that holds
    /// it: see [`ReactionLog`](crate::scene::ReactionLog).
    pub reactions: Option<PathBuf>,
}
