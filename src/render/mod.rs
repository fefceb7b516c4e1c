//! Seeing inside: cameras, transfer functions, and the raycaster that walks the tets.
//!
//! Nothing here knows of physics: positions are an array on the GPU that anyone may write.

mod camera;
mod compare;
#[cfg(not(target_arch = "wasm32"))]
mod film;
mod first_hit;
mod flip;
mod geometry;
mod image;
mod inside;
mod intervals;
mod light;
mod peel;
mod pick;
mod presets;
mod quality;
mod ray_integral;
mod raycast_options;
mod raycast_report;
mod raycaster;
mod scan;
mod shadows;
mod surface;
mod table;
mod tet_geometry;
mod tiles;
mod transfer;
mod view;
mod xray;

pub use camera::{Camera, Projection, Ray};
pub use compare::ImageDifference;
#[cfg(not(target_arch = "wasm32"))]
pub use film::Animation;
pub use first_hit::{Hit, closest_hit};
pub use geometry::{Geometry, Scalars, TableStatistics, local_positions};
pub use image::{Background, BitDepth, Image};
pub use inside::{Isosurface, Lighting, Plane, PlaneKind, Sections};
pub use intervals::{RaySegment, RaySegments, ReferenceSegment, composite_intervals};
pub use light::{Light, node_gradients, shade, shade_surface};
pub use pick::Pick;
pub use ray_integral::{ReferenceRaycaster, Segment, segment_integral};
pub use raycast_options::{MeshAccess, Mode, RaycastOptions, RaycastReport, Target, Traversal};
pub use raycaster::{Raycaster, RegionAppearance};
pub use scan::{LabelAppearance, MAX_SCANS, Scan, ScanAppearance};
pub use shadows::{DEFAULT_STRENGTH, node_shadows};
pub use surface::{Shading, Surface, SurfaceColour, SurfaceTarget};
pub use table::{TableKind, TableTexel};
pub use tet_geometry::{tet_gradient, tet_planes};
pub use transfer::{ResolvedTransfer, TransferFunction};
pub use xray::Xray;

pub(crate) use peel::{CACHED_SIZES, attachment};
pub(crate) use pick::PickRay;
pub(crate) use surface::{ClipPlanes, depth_target, downsampled};
pub(crate) use tiles::draw_in_tiles;
pub(crate) use transfer::named_colour;
pub(crate) use view::{CameraTransform, ImageRegion, View};
