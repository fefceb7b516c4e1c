//! The entries of a scene file, deserialised with serde.

mod accuracy;
mod acting;
mod body;
mod inside;
mod joint;
mod load;
mod output;
mod picture;
mod scan;
mod tool;

pub use accuracy::AccuracyEntry;
pub(crate) use acting::{FibreEntry, MoveEntry, MuscleEntry, PressureEntry, TimeSeries};
pub use body::{BodyEntry, JoinEntry, MeshSource, Unit};
pub(crate) use body::{GridEntry, LabelsEntry, Lengths};
pub use inside::{IsosurfaceEntry, PlaneEntry};
pub(crate) use joint::JointEntry;
pub use load::SkinEntry;
pub(crate) use load::{CutEntry, FloorEntry, ForceEntry, GrabEntry, MassEntry};
pub use output::OutputEntry;
pub use picture::{CameraEntry, LightEntry, PictureEntry, RegionAppearanceEntry, XrayEntry};
pub(in crate::scene) use scan::scans;
pub use scan::{LabelAppearanceEntry, ScanEntry};
pub(crate) use tool::{ContactEntry, SphereEntry, ToolEntry, ToolSurface};
