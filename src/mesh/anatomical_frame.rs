//! Axes of coordinates relative to a patient: RAS, as scans have here, or LPS.

use super::{Field, ScalarType, TetMesh, TriMesh};
use crate::{Error, Result};
use glam::DVec3;
use std::fmt;
use std::str::FromStr;

/// The frame of reference of coordinates: which way their axes x and y point. Axis z points to the
/// head (superior) in both.
///
/// Volumes are read in RAS. Surfaces of 3D Slicer are in LPS since version 5.0, and say so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AnatomicalFrame {
    /// To the right and to the front (anterior).
    Ras,
    /// To the left and to the back (posterior).
    Lps,
}

/// Number of bytes at the start of a file in which a frame is looked for.
const HEAD: usize = 4096;
/// What 3D Slicer writes in the header or a comment before the name of the frame.
const TAG: &[u8] = b"SPACE=";

/// Warning for a surface without a stated frame that is combined with a scan.
const SILENT_AS_LPS: &str = "states no frame of reference and meets a file in RAS: taken as LPS, as \
    3D Slicer does; if its axes are those of the scan, set --frame ras, or frame = \"ras\" in the scene";

impl AnatomicalFrame {
    /// Returns the frame stated in the header or the first comments of a file, `SPACE=LPS` or
    /// `SPACE=RAS`, as 3D Slicer writes it.
    pub(crate) fn stated_in(bytes: &[u8]) -> Option<AnatomicalFrame> {
        let head = bytes[..bytes.len().min(HEAD)].to_ascii_uppercase();
        let start = head.windows(TAG.len()).position(|w| w == TAG)? + TAG.len();
        match head.get(start..start + 3)? {
            b"RAS" => Some(AnatomicalFrame::Ras),
            b"LPS" => Some(AnatomicalFrame::Lps),
            _ => None,
        }
    }

    /// Returns the statement of this frame for a header or comment.
    pub(crate) fn statement(self) -> String {
        format!("SPACE={self}")
    }
}

impl fmt::Display for AnatomicalFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AnatomicalFrame::Ras => "RAS",
            AnatomicalFrame::Lps => "LPS",
        })
    }
}

impl FromStr for AnatomicalFrame {
    type Err = Error;

    fn from_str(text: &str) -> Result<AnatomicalFrame> {
        match text.to_ascii_lowercase().as_str() {
            "ras" => Ok(AnatomicalFrame::Ras),
            "lps" => Ok(AnatomicalFrame::Lps),
            _ => Err(Error::Input(format!(
                "unknown frame of reference \"{text}\"; use ras or lps"
            ))),
        }
    }
}

/// Converts positions and vectors between RAS and LPS: half a turn about z. Fields of three
/// floating-point numbers, and those of normals, are vectors.
fn turn(points: &mut [DVec3], fields: &mut [Field]) {
    let half_turn = |p: &mut DVec3| (p.x, p.y) = (-p.x, -p.y);
    points.iter_mut().for_each(half_turn);
    for field in fields {
        let real = matches!(field.scalar_type, ScalarType::F32 | ScalarType::F64);
        let corner_normals = field.components == 9 && field.name.eq_ignore_ascii_case("normal");
        if field.components == 3 && real || corner_normals {
            for vector in field.values.as_chunks_mut::<3>().0 {
                (vector[0], vector[1]) = (-vector[0], -vector[1]);
            }
        } else if field.components == 1 && ["nx", "ny"].contains(&field.name.as_str()) {
            field.values.iter_mut().for_each(|x| *x = -*x);
        }
    }
}

impl TriMesh {
    /// Converts coordinates of the frame `found` to RAS.
    pub fn convert_to_ras(&mut self, found: AnatomicalFrame) {
        if found == AnatomicalFrame::Lps {
            turn(&mut self.vertices, &mut self.fields);
        }
        self.frame = Some(AnatomicalFrame::Ras);
    }

    /// Converts the surface to RAS, in which it meets a scan. Coordinates of an unknown frame are
    /// taken as LPS, which a note reports.
    pub fn meet_ras(&mut self) {
        if self.frame.is_none() {
            self.notes.push(format!("surface {SILENT_AS_LPS}"));
            self.convert_to_ras(AnatomicalFrame::Lps);
        }
    }
}

impl TetMesh {
    /// Converts coordinates of the frame `found` to RAS.
    pub fn convert_to_ras(&mut self, found: AnatomicalFrame) {
        if found == AnatomicalFrame::Lps {
            turn(&mut self.nodes, &mut self.fields);
        }
        self.frame = Some(AnatomicalFrame::Ras);
    }
}
