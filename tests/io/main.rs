//! Reading and writing meshes. Tests in `data` read the real files in `../shared/data`.
#![allow(clippy::unwrap_used)]

mod data;
