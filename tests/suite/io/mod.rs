//! Reading and writing meshes. Tests in `data` read real files.

mod abaqus;
mod cells;
mod data;
mod encode;
mod encode_others;
mod errors;
mod gmsh;
mod parse;
mod robust;
mod sample;
mod surfaces;
mod variants;
mod volume_files;
mod volume_repairs;
mod volume_series;
mod volumes;
#[cfg(feature = "dicom")]
mod volumes_dicom;
mod write;
mod writers;
