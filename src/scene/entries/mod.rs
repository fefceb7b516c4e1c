//! The entries of a scene file, deserialised with serde.

mod acting;
mod body;
mod inside;
mod joint;
mod load;
mod output;
mod picture;
mod scan;
mod tool;

pub use acting::{FibreEntry, MoveEntry, MuscleEntry, PressureEntry, TimeSeries};
pub use body::{
    AllKeyword, BodyEntry, GridEntry, JoinEntry, LabelsEntry, Lengths, MeshSource, Unit,
};
pub use inside::{IsosurfaceEntry, PlaneEntry};
pub use joint::{AxisEntry, EmptyEntry, JointEntry};
pub use load::{CutEntry, FloorEntry, ForceEntry, GrabEntry, MassEntry, SkinEntry};
pub use output::OutputEntry;
pub use picture::{CameraEntry, LightEntry, PictureEntry, RegionAppearanceEntry, XrayEntry};
pub(in crate::scene) use scan::scans;
pub use scan::{LabelAppearanceEntry, ScanEntry};
pub use tool::{BoxEntry, CapsuleEntry, ContactEntry, PlaneShapeEntry, SphereEntry, ToolEntry};
