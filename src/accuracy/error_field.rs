//! The error as a field on a body, and its picture.

use crate::Result;
use crate::mesh::{Field, Location, TetMesh};
use crate::scene::{ERROR_FIELD, Stage};

/// Colours of the field.
const COLOURS: &str = "viridis";
/// Rendering mode, unless the scene has one.
const MODE: &str = "surface";

/// Adds the field `error` to a mesh: the share of each tet in an error, %.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) if the shares do not fit the mesh.
pub(crate) fn with_error_field(mut mesh: TetMesh, shares: &[f64]) -> Result<TetMesh> {
    let field = Field::scalar(ERROR_FIELD, Location::Cell, shares.to_vec());
    mesh.set_field(field)?;
    Ok(mesh)
}

/// Adds the sizes of the elements of a mesh in place of its errors: the logarithm to base 2 of their
/// mean edge length over the largest one, so that a colour is a level of refinement.
///
/// # Errors
/// As [`with_error_field`].
pub(crate) fn with_size_field(mesh: TetMesh) -> Result<TetMesh> {
    let pieces = mesh.tets.len() / mesh.element_count().max(1);
    let volumes: Vec<f64> = (0..mesh.tets.len())
        .map(|t| mesh.tet_volume(t).abs())
        .collect();
    let volumes: Vec<f64> = volumes.chunks(pieces).map(|own| own.iter().sum()).collect();
    let largest = volumes.iter().copied().fold(0.0, f64::max);
    let level = |volume: &f64| (volume / largest).max(f64::MIN_POSITIVE).log2() / 3.0;
    let levels = volumes.iter().map(level);
    let sizes: Vec<f64> = levels
        .flat_map(|level| std::iter::repeat_n(level, pieces))
        .collect();
    with_error_field(mesh, &sizes)
}

/// Returns a static stage of `mesh`, the body of `stage` with the field `error`, seen as there.
///
/// # Errors
/// As [`Stage::with_mesh`].
pub(crate) fn error_stage(mesh: TetMesh, stage: &mut Stage) -> Result<Stage> {
    let (gpu, scene) = stage.origin();
    let (gpu, mut scene) = (gpu.clone(), scene.clone());
    scene.solver.name = None;
    scene.tool.clear();
    scene.picture.field = Some(ERROR_FIELD.into());
    scene.picture.transfer = Some(COLOURS.into());
    scene.picture.range = None;
    // Opaque: most of an error is in a few tets, which a translucent body hides.
    scene.picture.mode.get_or_insert_with(|| MODE.into());
    scene.picture.region.clear();
    let mut picture = Stage::with_mesh(&gpu, &scene, mesh)?;
    *picture.camera_mut() = *stage.camera_mut();
    Ok(picture)
}
