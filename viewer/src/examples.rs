//! Examples bundled with the viewer.

use crate::document::Document;
use crate::platform;
use palpate::{Error, Result};

/// A bundled example.
pub struct Example {
    /// Display name.
    pub name: &'static str,
    /// Scene text.
    text: &'static str,
    /// Files that the scene reads.
    files: &'static [(&'static str, &'static [u8])],
}

const LIMB: (&str, &[u8]) = ("limb.json", include_bytes!("../../data/limb.json"));
/// The example shown at start has a precomputed mesh, so that it opens fast.
const LIMB_MESH: (&str, &[u8]) = ("limb_10k.vtu", include_bytes!("../../data/limb_10k.vtu"));

/// All examples.
pub const EXAMPLES: &[Example] = &[
    Example {
        name: "Limb",
        text: include_str!("../examples/limb.toml"),
        files: &[LIMB, LIMB_MESH],
    },
    Example {
        name: "Knee",
        text: include_str!("../examples/knee.toml"),
        files: &[
            ("knee.nrrd", include_bytes!("../../data/knee.nrrd")),
            ("knee.json", include_bytes!("../../data/knee.json")),
        ],
    },
    Example {
        name: "Heart",
        text: include_str!("../examples/heart.toml"),
        files: &[
            ("heart.nrrd", include_bytes!("../../data/heart.nrrd")),
            ("heart.json", include_bytes!("../../data/heart.json")),
        ],
    },
    Example {
        name: "Head",
        text: include_str!("../examples/head.toml"),
        files: &[
            ("head_ct.mha", include_bytes!("../../data/head_ct.mha")),
            ("head_ct.json", include_bytes!("../../data/head_ct.json")),
        ],
    },
    Example {
        name: "Foot",
        text: include_str!("../examples/foot.toml"),
        files: &[LIMB],
    },
    Example {
        name: "Breast with a lump",
        text: include_str!("../examples/breast.toml"),
        files: &[],
    },
];

impl Example {
    /// Returns the example of this name or first word, case-insensitive.
    ///
    /// # Errors
    /// [`Error::Input`] with the available names.
    pub fn named(name: &str) -> Result<&'static Example> {
        let called = |e: &&Example| {
            let first = e.name.split(' ').next().unwrap_or_default();
            [e.name, first].iter().any(|n| n.eq_ignore_ascii_case(name))
        };
        let found = EXAMPLES.iter().find(called);
        found.ok_or_else(|| {
            let all: Vec<String> = EXAMPLES.iter().map(|e| e.name.to_lowercase()).collect();
            Error::Input(format!(
                "unknown example \"{name}\"; available examples: {}",
                all.join(", ")
            ))
        })
    }

    /// Opens the example and stores its files in the folder that its scene refers to.
    ///
    /// # Errors
    /// [`Error::Io`] if the files cannot be written.
    pub fn open(&self) -> Result<Document> {
        let folder = platform::bundle_files(self.files)?;
        let mut document = Document::new(self.name.to_owned(), folder, self.text)?;
        document.bundled_files = self.files;
        Ok(document)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn examples_parse_and_their_files_load() {
        for example in EXAMPLES {
            let scene = example.open().unwrap().scene().unwrap();
            assert!(
                scene.mesh.load().unwrap().tets.len() > 3000,
                "{}",
                example.name
            );
        }
        assert!(Example::named("knee").is_ok());
        let Err(wrong) = Example::named("nose") else {
            panic!("\"nose\" must be rejected");
        };
        assert!(wrong.to_string().contains("breast with a lump"), "{wrong}");
    }
}
