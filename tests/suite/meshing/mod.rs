//! Meshing of files.

mod tetgen;
