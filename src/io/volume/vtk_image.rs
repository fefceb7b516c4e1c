//! Reader for VTK images: XML (`.vti`), and legacy files with `STRUCTURED_POINTS` (`.vtk`).
//!
//! Their coordinates are those of the meshes and surfaces that VTK writes with them; they are
//! taken as RAS, in mm. Values at cells are voxels with their centres at those of the cells.

use super::voxels::{decode, extent};
use crate::io::cursor::ParseResult;
use crate::io::vtk_legacy;
use crate::io::vtk_xml::{Outline, section_of};
use crate::io::{is_vtk_xml, scalar};
use crate::mesh::{Field, Location, ScalarType};
use crate::volume::Volume;
use glam::{DAffine3, DMat3, DVec3};

/// The type of the XML files.
const KIND: &str = "ImageData";

/// Whether a file is a VTK image, by its content.
pub(super) fn is_image(bytes: &[u8]) -> bool {
    is_vtk_xml(bytes, KIND) || vtk_legacy::holds(bytes, "STRUCTURED_POINTS")
}

/// Parses the bytes of `file` as a volume. Of several arrays reads number `number`, counted from 0
/// over those with one component; without it, the one that the file states as its scalars.
pub(super) fn read(file: &[u8], number: Option<usize>) -> ParseResult<Volume> {
    match vtk_legacy::holds(file, "STRUCTURED_POINTS") {
        true => read_legacy(file, number),
        false => read_xml(file, number),
    }
}

fn read_legacy(file: &[u8], number: Option<usize>) -> ParseResult<Volume> {
    let image = vtk_legacy::read_image(file)?;
    let all = image.fields.iter().map(|f| (f.name.as_str(), f.location));
    let one = |f: &&Field| f.components == 1;
    let arrays: Vec<_> = all
        .zip(&image.fields)
        .filter(|(_, f)| one(f))
        .map(|(at, _)| at)
        .collect();
    // The first attribute is that of the scalars.
    let names: Vec<&str> = arrays.iter().map(|(name, _)| *name).collect();
    let chosen = chosen(&names, Some(0), number);
    let chosen = chosen.map_err(|e| match image.warnings.is_empty() {
        true => e,
        false => format!("{e}; {}", image.warnings.join("; ")),
    })?;
    let fields: Vec<&Field> = image.fields.iter().filter(one).collect();
    let field = fields[chosen];
    let grid = Grid {
        first: [0; 3],
        points: image.points,
        to_world: DAffine3::from_mat3_translation(
            DMat3::from_diagonal(image.spacing),
            image.origin,
        ),
    };
    let mut volume = grid.volume(field.location, &field.values, field.scalar_type)?;
    volume.notes = image.warnings;
    if number.is_none() {
        volume.notes.extend(chosen_note(&names, chosen));
    }
    Ok(volume)
}

/// Returns the note of the array that was read, if there are others.
fn chosen_note(names: &[&str], chosen: usize) -> Option<String> {
    (names.len() > 1).then(|| {
        format!(
            "the array {:?} of {} arrays is read; select another with --volume K: {}",
            names[chosen],
            names.len(),
            numbered(names)
        )
    })
}

fn read_xml(file: &[u8], number: Option<usize>) -> ParseResult<Volume> {
    let outline = Outline::read(file, &[KIND])?;
    let first = outline.pieces.first().ok_or("file has no <Piece>")?;
    let mut arrays = Vec::new();
    let mut active = None;
    for location in [Location::Node, Location::Cell] {
        let section = section_of(location);
        for array in first.arrays.iter().filter(|a| a.section == section) {
            if array.components != 1 || scalar::from_vtk_xml_name(&array.type_name).is_none() {
                continue;
            }
            if active.is_none() && first.scalars.get(section) == Some(&array.name) {
                active = Some(arrays.len());
            }
            arrays.push((array.name.as_str(), location));
        }
    }
    let names: Vec<&str> = arrays.iter().map(|(name, _)| *name).collect();
    let chosen = chosen(&names, active, number)?;
    let (name, location) = arrays[chosen];
    let mut notes = outline.warnings.clone();
    if number.is_none() {
        notes.extend(chosen_note(&names, chosen));
    }
    let mut volume = assembled(&outline, name, location)?;
    volume.notes = notes;
    Ok(volume)
}

/// Reads the array `name` of all pieces.
fn assembled(outline: &Outline, name: &str, location: Location) -> ParseResult<Volume> {
    let grid = Grid::of(outline)?;
    let pieces = outline.pieces.iter().map(|piece| {
        let array = piece.array(section_of(location), name);
        let array = array.ok_or_else(|| format!("array {name:?} is missing in a piece"))?;
        let part = Grid {
            first: extent_of(piece.text("Extent"), "Extent")?.0,
            points: extent_of(piece.text("Extent"), "Extent")?.1,
            ..grid
        };
        let (values, scalar) = outline.values(array, Some(part.items(location)?))?;
        Ok((part, values, scalar))
    });
    let mut pieces: Vec<(Grid, Vec<f64>, ScalarType)> = pieces.collect::<ParseResult<_>>()?;
    if let [(part, values, scalar)] = &pieces[..]
        && (part.first, part.points) == (grid.first, grid.points)
    {
        return grid.volume(location, values, *scalar);
    }
    let given: usize = pieces.iter().map(|(_, values, _)| values.len()).sum();
    let wanted = grid.items(location)?;
    if given < wanted {
        return Err(format!(
            "the pieces have {given} values of the {wanted} in WholeExtent"
        ));
    }
    let mut all = vec![f64::NAN; wanted];
    let mut scalar = pieces[0].2;
    for (part, values, kind) in &mut pieces {
        if *kind != scalar {
            scalar = ScalarType::F64;
        }
        grid.insert(location, part, values, &mut all)?;
    }
    grid.volume(location, &all, scalar)
}

/// Returns the index of the array to read, of those with these names.
fn chosen(names: &[&str], active: Option<usize>, number: Option<usize>) -> ParseResult<usize> {
    if names.is_empty() {
        return Err("file has no numeric array with one component; expected an image with a value for each voxel".into());
    }
    match number {
        Some(k) if k < names.len() => Ok(k),
        Some(k) => Err(format!(
            "there is no array {k}; the file has {}",
            numbered(names)
        )),
        None if names.len() == 1 => Ok(0),
        None => active.ok_or_else(|| {
            format!(
                "file has several arrays and states none as its scalars; select one with --volume \
                K: {}",
                numbered(names)
            )
        }),
    }
}

/// Returns a list of the names with their numbers.
fn numbered(names: &[&str]) -> String {
    let named = names.iter().enumerate();
    let named: Vec<String> = named.map(|(k, name)| format!("{k} {name:?}")).collect();
    named.join(", ")
}

/// The points of an image, or of a piece of it.
#[derive(Clone, Copy)]
struct Grid {
    /// The index of the first point along each axis.
    first: [i64; 3],
    points: [usize; 3],
    /// From the indices of points to positions.
    to_world: DAffine3,
}

impl Grid {
    fn of(outline: &Outline) -> ParseResult<Grid> {
        let text = |name: &str| outline.dataset.get(name).map(String::as_str);
        let vector = |name: &str, usual: DVec3| match text(name) {
            None => Ok(usual),
            Some(given) => numbers::<3>(given, name).map(DVec3::from_array),
        };
        let turn = match text("Direction") {
            None => DMat3::IDENTITY,
            Some(given) => DMat3::from_cols_array(&numbers::<9>(given, "Direction")?).transpose(),
        };
        let (first, points) = extent_of(text("WholeExtent"), "WholeExtent")?;
        let spacing = vector("Spacing", DVec3::ONE)?;
        let origin = vector("Origin", DVec3::ZERO)?;
        let scale = DMat3::from_diagonal(spacing);
        Ok(Grid {
            first,
            points,
            to_world: DAffine3::from_mat3_translation(turn * scale, origin),
        })
    }

    /// Returns the number of voxels along each axis.
    fn size(&self, location: Location) -> [usize; 3] {
        match location {
            Location::Node => self.points,
            Location::Cell => self.points.map(|n| n.saturating_sub(1).max(1)),
        }
    }

    /// Returns the number of voxels.
    fn items(&self, location: Location) -> ParseResult<usize> {
        Ok(extent(self.size(location), ScalarType::F64)?.0)
    }

    /// Inserts the values of a piece among those of the whole image.
    fn insert(
        &self,
        location: Location,
        part: &Grid,
        values: &[f64],
        all: &mut [f64],
    ) -> ParseResult<()> {
        let [size, own] = [self.size(location), part.size(location)];
        let mut start = [0; 3];
        for axis in 0..3 {
            let offset = part.first[axis].checked_sub(self.first[axis]);
            let offset = offset.and_then(|offset| usize::try_from(offset).ok());
            start[axis] = offset
                .filter(|o| {
                    o.checked_add(own[axis])
                        .is_some_and(|end| end <= size[axis])
                })
                .ok_or("the Extent of a piece lies outside WholeExtent")?;
        }
        for (row, values) in values.chunks_exact(own[0]).enumerate() {
            let [j, k] = [row % own[1] + start[1], row / own[1] + start[2]];
            let to = start[0] + size[0] * (j + size[1] * k);
            all[to..to + own[0]].copy_from_slice(values);
        }
        Ok(())
    }

    /// Returns the image as a volume.
    fn volume(
        &self,
        location: Location,
        values: &[f64],
        scalar_type: ScalarType,
    ) -> ParseResult<Volume> {
        let size = self.size(location);
        let voxels = self.items(location)?;
        if values.len() != voxels {
            return Err(format!(
                "the image has {voxels} voxels, but the array {} values",
                values.len()
            ));
        }
        let volume = self.to_world.matrix3.determinant();
        if !volume.is_finite() || volume == 0.0 || !self.to_world.translation.is_finite() {
            return Err(format!(
                "spacing must be finite and not 0, and the origin finite; the axes are {} and the \
                origin is {}",
                self.to_world.matrix3, self.to_world.translation
            ));
        }
        let half = match location {
            Location::Node => DVec3::ZERO,
            Location::Cell => DVec3::from_array(self.points.map(|n| if n > 1 { 0.5 } else { 0.0 })),
        };
        let first = DVec3::from_array(self.first.map(|i| i as f64)) + half;
        Ok(Volume {
            size,
            raw: decode(&scalar::encode(values, scalar_type), scalar_type, false),
            to_world: self.to_world * DAffine3::from_translation(first),
            ..Volume::default()
        })
    }
}

/// Parses the extent of a grid: its first index, and its number of points along each axis.
fn extent_of(text: Option<&str>, name: &str) -> ParseResult<([i64; 3], [usize; 3])> {
    let text = text.ok_or_else(|| format!("file has no attribute {name}"))?;
    let wrong = || format!("{name} must be the first and last index along each axis, got {text:?}");
    let ends: Option<Vec<i64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
    let [a, b, c, d, e, f] = ends.ok_or_else(wrong)?[..] else {
        return Err(wrong());
    };
    let count = |first: i64, last: i64| {
        let steps = last.checked_sub(first).and_then(|n| n.checked_add(1))?;
        usize::try_from(steps).ok().filter(|n| *n > 0)
    };
    let points = [count(a, b), count(c, d), count(e, f)];
    let [Some(i), Some(j), Some(k)] = points else {
        return Err(wrong());
    };
    Ok(([a, c, e], [i, j, k]))
}

/// Parses the `N` numbers of an attribute.
fn numbers<const N: usize>(text: &str, name: &str) -> ParseResult<[f64; N]> {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or_else(|| format!("{name} must be {N} numbers, got {text:?}"))
}
