//! Scans that the body carries, as a scene file has them.

use crate::scene::Preloaded;
use crate::scene::keywords;
use crate::volume::Volume;
use serde::de::{Error as _, MapAccess, SeqAccess, Visitor, value};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A volume that the body carries, shown in place of its fields at the volume's own resolution. It
/// lies where its header says, in RAS mm, and the body at rest in it; a mesh whose unit is not the
/// millimetre says so (`unit` of `[mesh]`).
///
/// ```toml
/// [scan]                  # or [[scan]], for several: the first is the one that isosurfaces, slices
/// file = "ct.nrrd"        # and projections see
/// transfer = "bone"       # a preset, a JSON file or the JSON itself
/// range = [-200, 1500]    # of what occurs, where nothing is said
///
/// [[scan]]
/// file = "labels.nii.gz"
/// labels = true           # a colour a label; where nothing is said so are up to 64 whole numbers
///
/// [scan.label.femur]      # by name or number
/// colour = "wheat"
/// opacity = 0.5           # of a ray's mean way through it
///
/// [scan.label.3]
/// hidden = true
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScanEntry {
    /// The volume, beside the scene file: any that is read.
    pub file: PathBuf,
    /// What it is called in a legend; its file's name where nothing is said.
    pub name: Option<String>,
    /// What shows its values; of the first scan that of `[picture]` where nothing is said.
    #[serde(default, deserialize_with = "keywords::transfer")]
    pub transfer: Option<String>,
    /// Smallest and largest value, which stand for what is beyond them.
    pub range: Option<[f64; 2]>,
    /// Whether its values are labels.
    pub labels: Option<bool>,
    /// What labels look like, by name or number.
    #[serde(default)]
    pub label: BTreeMap<String, LabelAppearanceEntry>,
    /// The volume, where it was read already.
    #[serde(skip)]
    pub volume: Preloaded<Volume>,
}

/// What a label of a scan looks like.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelAppearanceEntry {
    /// A colour's name, or #RRGGBB; one of its own where nothing is said.
    #[serde(default, deserialize_with = "keywords::colour")]
    pub colour: Option<String>,
    /// What a ray's mean way through it hides, from 0 to 1.
    pub opacity: Option<f64>,
    /// Whether it is not drawn.
    #[serde(default)]
    pub hidden: bool,
}

/// `[scan]` or several `[[scan]]`.
pub(in crate::scene) fn scans<'de, D: Deserializer<'de>>(
    from: D,
) -> Result<Vec<ScanEntry>, D::Error> {
    struct OneOrMore;
    impl<'de> Visitor<'de> for OneOrMore {
        type Value = Vec<ScanEntry>;

        fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
            f.write_str("a table [scan], or several [[scan]]")
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
                    "{} scans: a picture has up to {}",
                    all.len(),
                    crate::render::MAX_SCANS
                ))),
            }
        }
    }
    from.deserialize_any(OneOrMore)
}
