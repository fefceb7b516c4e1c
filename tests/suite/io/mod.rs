//! Reading and writing meshes. Tests in `data` read real files.

mod abaqus;
mod abaqus_assemblies;
mod cases_meshes;
mod cells;
mod data;
mod encode;
mod encode_others;
mod encodings;
mod errors;
mod gmsh;
mod gmsh_partitions;
mod other_meshes;
mod parse;
mod polyhedra;
mod robust;
mod sample;
mod space;
mod surface_repairs;
mod surfaces;
mod ten_node;
mod variants;
mod volume_files;
mod volume_repairs;
mod volume_series;
mod volumes;
#[cfg(feature = "dicom")]
mod volumes_dicom;
mod vtk_attributes;
mod vtk_images;
mod vtk_pieces;
mod write;
mod writers;
