//! The local frame in which a mesh is stored as f32 on the GPU.

use super::{TetMesh, bounds};
use glam::{DVec3, Vec3};

/// Maps file coordinates (f64) to local ones (f32): bounds centred at 0, largest extent 1.
///
/// All data on the GPU uses this frame, so neither the position of a model nor its units reduce
/// accuracy: x_local = (x − origin) / scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFrame {
    /// The file coordinates of the local origin.
    pub origin: DVec3,
    /// File units in one local unit; always finite and above 0.
    pub scale: f64,
}

impl Default for LocalFrame {
    fn default() -> LocalFrame {
        LocalFrame {
            origin: DVec3::ZERO,
            scale: 1.0,
        }
    }
}

impl LocalFrame {
    /// Returns the frame of a box given by its lower and upper corners.
    ///
    /// A box without extent gets the scale 1.
    pub fn from_bounds(low: DVec3, high: DVec3) -> LocalFrame {
        let extent = (high - low).max_element();
        LocalFrame {
            origin: 0.5 * low + 0.5 * high,
            scale: if extent.is_normal() && extent > 0.0 {
                extent
            } else {
                1.0
            },
        }
    }

    /// Returns the frame of a mesh, from the bounds of its nodes.
    pub fn from_mesh(mesh: &TetMesh) -> LocalFrame {
        let (low, high) = bounds(&mesh.nodes);
        LocalFrame::from_bounds(low, high)
    }

    /// Converts the point `p` from file to local coordinates.
    pub fn to_local(&self, p: DVec3) -> Vec3 {
        ((p - self.origin) / self.scale).as_vec3()
    }

    /// Converts the local point `p` to file coordinates.
    pub fn to_file(&self, p: Vec3) -> DVec3 {
        self.origin + p.as_dvec3() * self.scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distant_tiny_model_keeps_its_shape() {
        let origin = DVec3::new(4e6, -3e5, 2e6);
        for size in [1e-3, 1.0, 1e9] {
            let frame = LocalFrame::from_bounds(origin, origin + size * DVec3::new(1.0, 0.5, 0.25));
            assert_eq!(frame.scale.log10().round(), size.log10());
            let p = origin + size * DVec3::new(0.3, 0.2, 0.1);
            let back = frame.to_file(frame.to_local(p));
            assert!((back - p).length() <= 1e-7 * size.max(1e-2), "{size}");
            assert!(frame.to_local(p).abs().max_element() <= 0.5);
        }
    }

    #[test]
    fn zero_extent_gives_finite_frame() {
        let frame = LocalFrame::from_bounds(DVec3::ONE, DVec3::ONE);
        assert_eq!(frame.to_local(DVec3::ONE), Vec3::ZERO);
    }
}
