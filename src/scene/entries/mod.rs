//! The entries of a scene file, as serde reads them.

mod body;
mod load;
mod picture;

pub use body::{All, BodyEntry, GridEntry, LabelsEntry, Lengths, MeshSource, Unit};
pub use load::{CutEntry, FloorEntry, ForceEntry, GrabEntry, SkinEntry};
pub use picture::{CameraEntry, LightEntry, PictureEntry};
