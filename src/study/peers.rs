//! The picture that Palpate and VTK draw for comparison (`benches/peers/cube.py`): the benchmark cube,
//! whose corners are 0 and 1.

use crate::Result;
use crate::render::{Camera, TransferFunction};
use glam::DVec3;

/// Returns its transfer function.
///
/// # Errors
/// None: the points are valid.
pub(crate) fn peers_transfer() -> Result<TransferFunction> {
    TransferFunction::new(
        vec![
            [0.0, 0.1, 0.1, 0.8],
            [0.5, 0.1, 0.9, 0.3],
            [1.0, 0.9, 0.2, 0.1],
        ],
        vec![
            [0.0, 0.0],
            [0.45, 0.0],
            [0.55, 3.5],
            [0.65, 0.5],
            [1.0, 8.0],
        ],
    )
}

/// Returns its camera, before the first turn.
pub(crate) fn peers_camera() -> Camera {
    let middle = DVec3::splat(0.5);
    Camera::perspective(middle + DVec3::new(1.3, 0.8, 2.0), middle, DVec3::Y, 30.0)
}
