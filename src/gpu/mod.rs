//! The device, GPU-resident arrays, passes, shader composition, read-back and timing.
//!
//! A pass is prepared once and recorded every step. Its declaration lists, in binding order, what
//! is read, what is written and the parameters, and the number of items (see [`Gpu::pass`]).
//! Bind-group layouts are reflected from the WGSL and validated against the declaration when the
//! pass is prepared, so a wrong order, format or struct layout is an error at that time instead of
//! a wrong image later.

mod array;
mod binding;
mod bitmask_prefix_sum;
mod device;
mod draw;
mod pass;
mod pipeline;
mod readback;
mod readback_ring;
mod record;
mod shader;
mod struct_layout;
mod texture;
mod texture_load_count;
mod timing;

#[cfg(feature = "study")]
pub(crate) use array::array_size;
pub use array::{Array, Positions, Texel, Version};
pub use binding::{Bind, Resource};
pub(crate) use bitmask_prefix_sum::BitmaskPrefixSum;
pub use device::Gpu;
pub(crate) use device::MOST_STORAGE_TEXTURES;
pub use draw::{Draw, DrawBuilder};
pub use pass::{Pass, PassBuilder};
pub use pipeline::PipelineDescription;
pub use readback::PendingReadback;
pub(crate) use readback_ring::ReadbackRing;
pub use record::Recorder;
pub use shader::Shaders;
pub use struct_layout::{GpuStruct, check_layout};
