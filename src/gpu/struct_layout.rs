//! Structs shared with the GPU: validates their layout in Rust against that in WGSL.

use super::shader;
use crate::{Error, Result};
use wgpu::naga;

/// A `#[repr(C)]` struct shared with the GPU; declared by [`gpu_struct!`](crate::gpu_struct).
pub trait GpuStruct: bytemuck::Pod {
    /// The struct's name, in Rust and in WGSL.
    const NAME: &'static str;
    /// Name and byte offset of every member, in order.
    const MEMBERS: &'static [(&'static str, usize)];
}

/// Declares a struct shared with the GPU: `#[repr(C)]`, `Pod`, and a [`GpuStruct`].
///
/// Members whose names begin with `_` are padding and need no counterpart in WGSL.
#[macro_export]
macro_rules! gpu_struct {
    ($(#[$doc:meta])* $vis:vis struct $name:ident { $($(#[$mdoc:meta])* $mvis:vis $member:ident : $ty:ty),* $(,)? }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
        $vis struct $name { $($(#[$mdoc])* $mvis $member: $ty),* }

        impl $crate::gpu::GpuStruct for $name {
            const NAME: &'static str = stringify!($name);
            const MEMBERS: &'static [(&'static str, usize)] =
                &[$((stringify!($member), ::core::mem::offset_of!($name, $member))),*];
        }
    };
}

/// Compares the Rust layout of `T` with the struct of the same name in shader `name`: size, member
/// names and offsets. Needs no GPU.
///
/// # Errors
/// [`Error::Gpu`] with the first difference.
pub fn check_layout<T: GpuStruct>(name: &str) -> Result<()> {
    let module = shader::Shaders::parse(name)?;
    let found = module
        .types
        .iter()
        .find(|(_, t)| t.name.as_deref() == Some(T::NAME));
    match found {
        Some((_, ty)) => compare::<T>(name, &ty.inner),
        None => Err(Error::Gpu(format!(
            "shaders/{name}.wgsl has no struct {}",
            T::NAME
        ))),
    }
}

/// Compares the Rust layout of `T` with a type of the parsed shader `name`.
pub(super) fn compare<T: GpuStruct>(name: &str, inner: &naga::TypeInner) -> Result<()> {
    let wrong =
        |what: String| Error::Gpu(format!("shaders/{name}.wgsl, struct {}: {what}", T::NAME));
    let naga::TypeInner::Struct { members, span } = inner else {
        return Err(wrong("must be a struct in WGSL".into()));
    };
    if *span as usize != size_of::<T>() {
        return Err(wrong(format!(
            "size is {span} bytes in WGSL, {} in Rust",
            size_of::<T>()
        )));
    }
    let visible = |member: &str| !member.starts_with('_');
    let wgsl: Vec<(&str, usize)> = members
        .iter()
        .map(|m| (m.name.as_deref().unwrap_or(""), m.offset as usize))
        .filter(|m| visible(m.0))
        .collect();
    let rust: Vec<(&str, usize)> = T::MEMBERS
        .iter()
        .copied()
        .filter(|m| visible(m.0))
        .collect();
    if wgsl != rust {
        return Err(wrong(format!(
            "members and offsets are {wgsl:?} in WGSL, {rust:?} in Rust"
        )));
    }
    Ok(())
}
