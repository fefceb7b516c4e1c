//! Volume rendering of tetrahedral meshes: cameras, transfer functions and the raycaster.
//!
//! This module does not depend on physics: positions are a GPU array that any code may write.

mod camera;
mod closest_hit;
mod compare;
mod depth_peeling;
#[cfg(not(target_arch = "wasm32"))]
mod film;
mod flip_metric;
mod geometry;
mod image;
mod image_tiles;
mod light;
mod path;
mod pick;
mod presets;
mod quality;
mod ray_integral;
mod ray_segments;
mod raycast_options;
mod raycast_report;
mod raycaster;
mod scan;
mod sections;
mod shadows;
mod surface;
mod table;
mod tet_geometry;
mod tissue_colours;
mod tissue_optics;
mod transfer_function;
mod view;
mod xray;

pub use camera::{Camera, Projection, Ray};
pub use closest_hit::Hit;
pub use compare::ImageDifference;
#[cfg(not(target_arch = "wasm32"))]
pub use film::Animation;
pub use geometry::{Geometry, Scalars, TableStatistics, local_positions};
pub use image::{Background, BitDepth, Image};
pub use light::Light;
pub use pick::Pick;
pub use ray_integral::{ReferenceRaycaster, Segment};
pub use ray_segments::{RaySegment, RaySegments, ReferenceSegment};
pub use raycast_options::{MeshAccess, Mode, RaycastOptions, RaycastReport, Target, Traversal};
pub use raycaster::{Raycaster, RegionAppearance};
pub(crate) use scan::MAX_SCANS;
pub use scan::{LabelAppearance, Scan, ScanAppearance};
pub use sections::{Isosurface, Lighting, Plane, PlaneKind, Sections};
pub use surface::{Shading, Surface, SurfaceColour, SurfaceTarget};
pub use table::{TableKind, TableTexel};
pub use transfer_function::{AbsoluteTransferFunction, TransferFunction};
pub use xray::Xray;

pub(crate) use depth_peeling::{CACHED_SIZES, attachment};
pub(crate) use image_tiles::draw_supersampled;
pub use path::ProgressivePaths;
pub(crate) use path::{Environment, PathOptions, PathTracer, Wall, linear_light};
pub(crate) use pick::PickRay;
pub(crate) use surface::{ClipPlanes, image_with_depth};
pub(crate) use tissue_colours::tissue_colour;
pub(crate) use transfer_function::named_colour;
pub(crate) use view::{CameraTransform, ImageRegion, View};
