//! Files of wanted edge lengths.

use super::domain_source::MILLIMETRE;
use crate::io::{self, Kind};
use crate::mesh::Location;
use crate::mesher::{EDGE_LENGTH, SizeField};
use crate::volume::Volume;
use crate::{Error, Result};
use glam::{DAffine3, DVec3};
use std::path::Path;

/// Reads the size field of a domain with these `bounds`, whose coordinates are in `unit` (metres; `None`
/// if it is unknown).
///
/// # Errors
/// Those of reading; [`Error::Input`] for a file without lengths, or of another place.
pub(super) fn read_size_field(
    file: &Path,
    (low, high): (DVec3, DVec3),
    unit: Option<f64>,
) -> Result<SizeField> {
    let wrong = |what: String| Error::Input(format!("{}: {what}", file.display()));
    let (field, (own_low, own_high)) = match io::detect_kind(file)? {
        Kind::Volume => {
            let volume = io::read_volume(file)?;
            let volume = in_unit(volume, unit.map_or(1.0, |unit| MILLIMETRE / unit));
            let bounds = volume.bounds();
            (SizeField::of_volume(volume), bounds)
        }
        Kind::Mesh => {
            let mut mesh = io::read(file)?;
            let units = mesh.length_unit.zip(unit);
            let factor = units.map_or(1.0, |(own, wanted)| own / wanted);
            mesh.nodes.iter_mut().for_each(|p| *p *= factor);
            let lengths = |field: &&mut crate::mesh::Field| {
                field.name == EDGE_LENGTH && field.location == Location::Cell
            };
            for field in mesh.fields.iter_mut().filter(lengths) {
                field.values.iter_mut().for_each(|length| *length *= factor);
            }
            (SizeField::of_mesh(&mesh), mesh.bounds())
        }
        Kind::Surface => {
            return Err(wrong(
                "a size field is a volume of edge lengths in mm, or a tet mesh; this is a surface"
                    .into(),
            ));
        }
    };
    if (own_low.cmpgt(high) | low.cmpgt(own_high)).any() {
        return Err(wrong(format!(
            "the size field ({own_low} to {own_high}) and the body ({low} to {high}) do not overlap; give one in the frame and unit of the body"
        )));
    }
    field.map_err(|error| match error {
        Error::Input(what) => wrong(what),
        other => other,
    })
}

/// Returns a volume of lengths with its place and values multiplied by `factor`.
fn in_unit(mut volume: Volume, factor: f64) -> Volume {
    volume.to_world = DAffine3::from_scale(DVec3::splat(factor)) * volume.to_world;
    volume.slope *= factor;
    volume.intercept *= factor;
    volume
}
