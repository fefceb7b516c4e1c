//! The device, GPU-resident arrays, passes, shader composition, read-back and timing.
//!
//! A pass is prepared once and recorded every step, and reads as a sentence: read these, write
//! those, with these parameters, over this many items (see [`Gpu::pass`]). Bind-group layouts are
//! reflected from the WGSL and held against that sentence when the pass is prepared, so a wrong
//! order, format or struct layout is an error then and never a wrong picture later.

mod array;
mod binding;
mod device;
mod draw;
mod layout;
mod loads;
mod pass;
mod readback;
mod record;
mod ring;
mod scan_marks;
mod shader;
mod texture;
mod timing;

#[cfg(feature = "study")]
pub(crate) use array::array_size;
pub use array::{Array, Positions, ROW_TEXELS, Texel, Version};
pub use binding::{Bind, Resource};
pub use device::{ADAPTER_VARIABLE, Gpu, submit_time};
pub use draw::{Draw, DrawBuilder};
pub use layout::{GpuStruct, check_layout};
pub use loads::texture_loads;
pub use pass::{Pass, PassBuilder};
pub use readback::PendingReadback;
pub use record::Recorder;
pub(crate) use ring::ReadbackRing;
pub(crate) use scan_marks::BitmaskPrefixSum;
pub use shader::{add_shader, compose, parse, shader_names};
