//! Entries of scans embedded in the body.

use crate::scene::Preloaded;
use crate::scene::keywords;
#[cfg(feature = "cli")]
use crate::scene::schema;
use crate::volume::Volume;
use serde::de::{Error as _, MapAccess, SeqAccess, Visitor, value};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A volume embedded in the body, rendered in place of its fields at the volume's own resolution.
/// It is located by its header in RAS mm, with the body at rest in it; set `unit` of `[mesh]` if
/// the unit of the mesh is not the millimetre.
///
/// ```toml
/// [[scan]]                # or one table [scan]; of several, isosurfaces, slices and projections
/// file = "ct.nrrd"        # use the first one
/// transfer = "bone"       # a preset, a JSON file or the JSON itself
/// range = [-200, 1500]    # default: the range of the values
///
/// [[scan]]
/// file = "labels.nii.gz"
/// labels = true           # one colour per label; default: true for up to 64 integers
///
/// [scan.label.femur]      # by name or number
/// colour = "wheat"
/// opacity = 0.5           # over the mean chord length of the label
///
/// [scan.label.3]
/// hidden = true
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ScanEntry {
    /// The volume, relative to the scene file, in any supported format.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["ct.nrrd"])))]
    pub file: PathBuf,
    /// Which volume of a file of several (times, echoes, components) is displayed, counted from 0.
    #[serde(rename = "volume")]
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [2])))]
    pub number: Option<usize>,
    /// Name in the legend; default: the name of the file.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["CT"])))]
    pub name: Option<String>,
    /// Transfer function; default for the first scan: that of `[picture]`.
    #[serde(default, deserialize_with = "keywords::transfer")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::transfer", extend("examples" = ["bone"])))]
    pub transfer: Option<String>,
    /// Smallest and largest value; values outside are clamped.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "of the scan", "examples" = [[-200.0, 1500.0]])))]
    pub range: Option<[f64; 2]>,
    /// Whether the values are labels.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [true])))]
    pub labels: Option<bool>,
    /// Appearance of labels, by name or number.
    #[serde(default)]
    pub label: BTreeMap<String, LabelAppearanceEntry>,
    /// The volume, if it was loaded already.
    #[serde(skip)]
    pub volume: Preloaded<Volume>,
}

impl ScanEntry {
    /// Returns its transfer function if that is a file.
    pub(in crate::scene) fn transfer_file(&mut self) -> Option<&mut String> {
        self.transfer.as_mut().filter(|t| t.ends_with(".json"))
    }
}

/// Appearance of a label of a scan.
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LabelAppearanceEntry {
    /// Colour name, or #RRGGBB; by default each label has its own colour.
    #[serde(default, deserialize_with = "keywords::colour")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::text", extend("examples" = ["wheat", "#d04030"])))]
    pub colour: Option<String>,
    /// Opacity over the mean chord length of the label, from 0 to 1.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 0.0, "maximum" = 1.0, "examples" = [0.6])))]
    pub opacity: Option<f64>,
    /// Whether it is not drawn.
    #[serde(default)]
    pub hidden: bool,
}

/// Deserialises `[scan]` or several `[[scan]]`.
pub(in crate::scene) fn scans<'de, D: Deserializer<'de>>(
    from: D,
) -> Result<Vec<ScanEntry>, D::Error> {
    struct OneOrMore;
    impl<'de> Visitor<'de> for OneOrMore {
        type Value = Vec<ScanEntry>;

        fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
            f.write_str("a table [scan], or [[scan]] entries")
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
            let one = ScanEntry::deserialize(value::MapAccessDeserializer::new(map))?;
            Ok(vec![one])
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
            let mut all = Vec::new();
            while let Some(one) = seq.next_element()? {
                all.push(one);
            }
            match all.len() <= crate::render::MAX_SCANS {
                true => Ok(all),
                false => Err(A::Error::custom(format!(
                    "{} scans given, but a picture shows at most {}",
                    all.len(),
                    crate::render::MAX_SCANS
                ))),
            }
        }
    }
    from.deserialize_any(OneOrMore)
}
