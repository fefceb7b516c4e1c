//! Generators of meshes.

mod foot;
mod limb;
mod shapes;
