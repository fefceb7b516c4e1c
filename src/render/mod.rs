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
pub use compare::Difference;
#[cfg(not(target_arch = "wasm32"))]
pub use film::Film;
pub use first_hit::{Hit, first_hit};
pub use geometry::{Geometry, Measures, Scalars, local_positions};
pub use image::{Background, BitDepth, Image};
pub use inside::{Inside, Isosurface, Lighting, Plane, PlaneKind};
pub use intervals::{ExactInterval, Interval, Intervals, composite_intervals};
pub use light::{Light, node_gradients, shade, shade_surface};
pub use pick::Pick;
pub use ray_integral::{RayReference, Segment, segment_integral};
pub use raycast_options::{Mode, RaycastOptions, RaycastReport, Reads, Target, Walk};
pub use raycaster::{Raycaster, RegionLooks};
pub use scan::{LabelLook, MOST_SCANS, Scan, ScanLook};
pub use shadows::{SHADOWS, node_shadows};
pub use surface::{Shading, Surface, SurfaceColour, SurfaceTarget};
pub use table::{TableForm, TableTexel};
pub use tet_geometry::{tet_gradient, tet_planes};
pub use transfer::{ResolvedTransfer, TransferFunction};
pub use xray::Xray;

pub(crate) use peel::{KEPT, attachment};
pub(crate) use pick::Look;
pub(crate) use surface::{Clips, averaged, depth_target};
pub(crate) use tiles::draw_in_tiles;
pub(crate) use transfer::named_colour;
pub(crate) use view::{LocalView, View, Window};
