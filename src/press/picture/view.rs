//! The view of a picture that the CPU draws.

use glam::{DVec2, DVec3};

/// Direction towards the key light: to the right, upwards, and towards the eye.
const LAMP: [f64; 3] = [-0.55, 0.75, 0.62];

/// A camera with its axes, for a picture of `size` samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub eye: DVec3,
    pub look_at: DVec3,
    pub right: DVec3,
    pub up: DVec3,
    pub forward: DVec3,
    /// Half of the height of the picture: at distance 1 of a perspective camera, or in file units.
    half: f64,
    perspective: bool,
    size: [u32; 2],
}

impl View {
    /// Creates a perspective view with a vertical field of view of `fov` degrees.
    pub fn perspective(eye: DVec3, look_at: DVec3, up: DVec3, fov: f64, size: [u32; 2]) -> View {
        let half = (0.5 * fov.to_radians()).tan();
        View::new((eye, look_at, up), half, true, size)
    }

    /// Creates an orthographic view of `height` file units.
    pub fn orthographic(
        eye: DVec3,
        look_at: DVec3,
        up: DVec3,
        height: f64,
        size: [u32; 2],
    ) -> View {
        View::new((eye, look_at, up), 0.5 * height, false, size)
    }

    fn new(
        (eye, look_at, up): (DVec3, DVec3, DVec3),
        half: f64,
        perspective: bool,
        size: [u32; 2],
    ) -> View {
        let forward = (look_at - eye).normalize_or(DVec3::NEG_Z);
        let right = forward
            .cross(up)
            .normalize_or(forward.any_orthonormal_vector());
        View {
            eye,
            look_at,
            right,
            up: right.cross(forward),
            forward,
            half,
            perspective,
            size,
        }
    }

    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// Returns the distance before which nothing is drawn.
    pub fn near(&self) -> f64 {
        match self.perspective {
            true => 1e-3 * self.eye.distance(self.look_at),
            false => f64::NEG_INFINITY,
        }
    }

    /// Returns the unit direction towards the key light.
    pub fn lamp(&self) -> DVec3 {
        (LAMP[0] * self.right + LAMP[1] * self.up - LAMP[2] * self.forward).normalize()
    }

    /// Returns the size of a sample at a depth, in file units.
    pub fn pixel_at(&self, depth: f64) -> f64 {
        let half = if self.perspective {
            self.half * depth
        } else {
            self.half
        };
        2.0 * half / f64::from(self.size[1])
    }

    /// Returns the sample position of a point, and its depth along the view.
    pub fn project(&self, p: DVec3) -> DVec3 {
        let to = p - self.eye;
        let depth = to.dot(self.forward);
        let flat = DVec2::new(to.dot(self.right), -to.dot(self.up)) / self.pixel_at(depth);
        let middle = DVec2::new(f64::from(self.size[0]), f64::from(self.size[1])) / 2.0;
        (middle + flat).extend(depth)
    }

    /// Returns the point at the centre of a sample at a depth.
    pub fn unproject(&self, [x, y]: [u32; 2], depth: f64) -> DVec3 {
        let scale = self.pixel_at(depth);
        let right = f64::from(x) + 0.5 - 0.5 * f64::from(self.size[0]);
        let down = f64::from(y) + 0.5 - 0.5 * f64::from(self.size[1]);
        self.eye + depth * self.forward + scale * (right * self.right - down * self.up)
    }
}
