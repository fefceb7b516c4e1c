//! Partitioned meshes: VTK parallel XML unstructured grids (`.pvtu`), an index of `.vtu` files.
//!
//! Reading merges the pieces into one mesh: nodes of several pieces are identified by their
//! `GlobalNodeIds`, otherwise by position; ghost cells (`vtkGhostType`) are dropped. Written pieces
//! contain ghost cells, the tets of their neighbours at their nodes, so that a piece can be
//! rendered alone, and the caller's data about the whole mesh.

use super::cursor::ParseResult;
use super::join::{CELL_IDS, DUPLICATE, GHOSTS, NODE_IDS, PieceData, joined};
use super::raw_mesh::RawMesh;
use super::vtu_tags::{attribute, for_each_tag};
use super::vtu_write::{self, escaped};
use super::{scalar, vtu};
use crate::mesh::{Field, Location, MeshPiece, ScalarType};
use crate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The type in the first tag of an index.
pub(super) const KIND: &str = "PUnstructuredGrid";
/// Prefix of fields that are internal to Palpate and do not belong to the mesh.
pub(crate) const PRIVATE_PREFIX: &str = "palpate:";
/// Array of a piece that stores data about the whole mesh, as bytes.
const WHOLE_MESH_ARRAY: &str = "palpate:whole";

/// Returns the files of the pieces listed by the index at `path`, in its order.
///
/// # Errors
/// An error if the index cannot be read, is damaged, or lists no pieces.
pub fn piece_files(path: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
    let path = path.as_ref();
    let bytes = super::content(path)?;
    let files = index(&bytes).map_err(|e| Error::format(path, e))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    Ok(files.iter().map(|file| folder.join(file)).collect())
}

/// Parses the files listed by an index.
pub(super) fn index(bytes: &[u8]) -> ParseResult<Vec<String>> {
    let mut files = Vec::new();
    for_each_tag(bytes, |tag| {
        match tag.name().as_ref() {
            b"VTKFile" => {
                let kind = attribute(tag, "type").unwrap_or_default();
                if kind != KIND {
                    return Err(format!(
                        "VTK file contains {kind:?}, expected \"{KIND}\" (a mesh in pieces)"
                    ));
                }
            }
            b"Piece" => {
                let source = attribute(tag, "Source").filter(|s| !s.is_empty());
                let piece = files.len();
                files.push(source.ok_or_else(|| {
                    format!("piece {piece} (counted from 0) has no attribute Source")
                })?);
            }
            _ => {}
        }
        Ok(())
    })?;
    match files.is_empty() {
        true => Err("file has no pieces (<Piece> tags)".into()),
        false => Ok(files),
    }
}

/// Reads the pieces of the mesh with the index `bytes` at `path` as one mesh.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<RawMesh> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let files = index(bytes).map_err(|e| Error::format(path, e))?;
    let pieces = files.iter().map(|file| {
        let file = folder.join(file);
        let bytes = super::content(&file)?;
        let piece = vtu::read(&bytes).and_then(PieceData::new);
        piece.map_err(|e| Error::format(&file, e))
    });
    let pieces: Vec<PieceData> = pieces.collect::<Result<_>>()?;
    joined(pieces).map_err(|e| Error::format(path, e))
}

/// Writes pieces, each to a file in the folder of the index at `path` (`NAME_0000.vtu` and so on),
/// and finally the index: it exists only if all pieces do. `piece` returns each piece in turn, and
/// `whole` is the data about the whole mesh stored in each of them.
///
/// # Errors
/// The errors of `piece`, an error for invalid fields, or if a file cannot be written.
pub(crate) fn write_pieces(
    path: impl AsRef<Path>,
    count: usize,
    whole: &[u8],
    mut piece: impl FnMut(usize) -> Result<MeshPiece>,
) -> Result<()> {
    let path = path.as_ref();
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut files = Vec::with_capacity(count);
    let mut arrays: Vec<Field> = Vec::new();
    for k in 0..count {
        let piece = piece(k)?;
        let ids = |name, location, ids: &[u32]| Field {
            scalar_type: ScalarType::I64,
            ..Field::scalar(name, location, ids.iter().map(|i| f64::from(*i)).collect())
        };
        let ghost = |t: usize| if t < piece.owned_tets { 0.0 } else { DUPLICATE };
        let extra = [
            ids(NODE_IDS, Location::Node, &piece.nodes),
            ids(CELL_IDS, Location::Cell, &piece.tets),
            Field {
                scalar_type: ScalarType::U8,
                ..Field::scalar(
                    GHOSTS,
                    Location::Cell,
                    (0..piece.tets.len()).map(ghost).collect(),
                )
            },
        ];
        let file = format!("{name}_{k:04}.vtu");
        let mesh = &piece.mesh;
        vtu_write::write_with_array(
            &path.with_file_name(&file),
            mesh,
            &mesh.nodes,
            &extra,
            Some((WHOLE_MESH_ARRAY, whole)),
        )?;
        files.push(file);
        let all = mesh
            .fields
            .iter()
            .filter(|f| !f.name.starts_with(PRIVATE_PREFIX));
        list_arrays(all.chain(&extra), &mut arrays);
    }
    let text = index_text(&arrays, &files);
    super::atomic_write(path, |file| {
        file.write_all(text.as_bytes()).map_err(Error::io(path))
    })
}

/// Adds the fields of a piece to the arrays of the index, with a type that holds those of all
/// pieces.
fn list_arrays<'a>(fields: impl Iterator<Item = &'a Field>, arrays: &mut Vec<Field>) {
    for field in fields {
        let exact = scalar::is_lossless(&field.values, field.scalar_type);
        let kind = if exact {
            field.scalar_type
        } else {
            ScalarType::F64
        };
        let same = |f: &&mut Field| (&f.name, f.location) == (&field.name, field.location);
        match arrays.iter_mut().find(same) {
            Some(known) if known.scalar_type != kind => known.scalar_type = ScalarType::F64,
            Some(_) => {}
            None => arrays.push(Field {
                name: field.name.clone(),
                values: Vec::new(),
                scalar_type: kind,
                ..*field
            }),
        }
    }
}

/// Returns the text of an index of pieces with these arrays in these files.
fn index_text(arrays: &[Field], files: &[String]) -> String {
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"{KIND}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n<{KIND} GhostLevel=\"1\">\n"
    );
    for (section, location) in [
        ("PPointData", Location::Node),
        ("PCellData", Location::Cell),
    ] {
        text += &format!("<{section}>\n");
        for array in arrays.iter().filter(|a| a.location == location) {
            text += &format!(
                "<PDataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\"/>\n",
                scalar::vtk_xml_name(array.scalar_type),
                escaped(&array.name),
                array.components
            );
        }
        text += &format!("</{section}>\n");
    }
    text += "<PPoints>\n<PDataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"/>\n</PPoints>\n";
    for file in files {
        text += &format!("<Piece Source=\"{}\"/>\n", escaped(file));
    }
    text += &format!("</{KIND}>\n</VTKFile>\n");
    text
}

/// Reads piece `number` listed by the index at `path`, as written by [`write_pieces`], and the data
/// about the whole mesh stored in it.
///
/// # Errors
/// An error if a file cannot be read or is damaged, for a number out of range, and for pieces
/// written by another program.
pub(crate) fn read_piece(path: impl AsRef<Path>, number: usize) -> Result<(MeshPiece, Vec<u8>)> {
    let path = path.as_ref();
    let files = piece_files(path)?;
    let Some(file) = files.get(number) else {
        return Err(Error::format(
            path,
            format!(
                "piece {number} does not exist; index must be < {} (counted from 0)",
                files.len()
            ),
        ));
    };
    let foreign = || {
        let path = path.display();
        Error::format(
            file,
            format!(
                "piece has no data about its neighbours and the whole mesh; write the pieces with \
                `palpate convert {path} OUT.pvtu --pieces {}`",
                files.len()
            ),
        )
    };
    let bytes = super::content(file)?;
    let (raw, whole) =
        vtu::read_with_array(&bytes, WHOLE_MESH_ARRAY).map_err(|e| Error::format(file, e))?;
    let whole = whole.ok_or_else(foreign)?;
    let mut mesh = raw.into_tets().map_err(|e| Error::format(file, e))?;
    let mut take = |name: &str, location| -> Option<Vec<f64>> {
        let is = |f: &Field| (f.name.as_str(), f.location, f.components) == (name, location, 1);
        let place = mesh.fields.iter().position(is)?;
        Some(mesh.fields.remove(place).values)
    };
    let ids = |values: Vec<f64>| -> Option<Vec<u32>> {
        let id = |v: &f64| super::raw_mesh::index(*v).and_then(|i| u32::try_from(i).ok());
        values.iter().map(id).collect()
    };
    let nodes = take(NODE_IDS, Location::Node).and_then(ids);
    let tets = take(CELL_IDS, Location::Cell).and_then(ids);
    let ghosts = take(GHOSTS, Location::Cell).ok_or_else(foreign)?;
    let own = ghosts.iter().take_while(|g| **g == 0.0).count();
    // Nodes in the order of the whole mesh ensure identical decisions where two pieces meet.
    let rising = |ids: &Vec<u32>| ids.windows(2).all(|w| w[0] < w[1]);
    let nodes = nodes.filter(rising).ok_or_else(foreign)?;
    let tets = tets.ok_or_else(foreign)?;
    if own == 0 || ghosts[own..].contains(&0.0) {
        return Err(foreign());
    }
    let piece = MeshPiece {
        mesh,
        owned_tets: own,
        nodes,
        tets,
    };
    Ok((piece, whole))
}

/// Whether `path` has the extension of an index of pieces.
pub fn is_pieces(path: impl AsRef<Path>) -> bool {
    super::extension(path.as_ref()) == "pvtu"
}

/// Rejects an index where a mesh in one file is needed.
pub(super) fn reject_index(_: &[u8]) -> ParseResult<RawMesh> {
    Err(
        "expected a single file, found an index of mesh pieces (.pvtu); give for example a .vtu \
        file"
            .into(),
    )
}
