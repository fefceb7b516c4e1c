//! Perspective and orthographic cameras in float64, in the units of the mesh file.

use crate::mesh::TetMesh;
use crate::{Error, Result};
use glam::{DVec2, DVec3};

/// Projection of a [`Camera`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Pinhole camera: rays diverge from the eye.
    Perspective {
        /// Full vertical field of view, in degrees.
        fov: f64,
    },
    /// Parallel rays that start in the plane through the eye.
    Orthographic {
        /// Height of the view, in file units.
        height: f64,
    },
}

/// Camera: eye, target, up direction and projection; lengths in file units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye. Nothing behind it is visible, for an orthographic camera as well.
    pub eye: DVec3,
    /// Point at the centre of the image.
    pub look_at: DVec3,
    /// Up direction in the image.
    pub up: DVec3,
    /// Perspective or orthographic projection.
    pub projection: Projection,
}

/// A ray (half-line), in file units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start point.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// Fraction of the image filled by a mesh that is fitted into view.
const FIT_FRACTION: f64 = 0.92;
/// Fraction of the image filled by a mesh that fills the view.
const FILL_FRACTION: f64 = 0.93;
/// Vertical field of view of fitted cameras, in degrees.
const FRAMING_FOV: f64 = 30.0;

impl Camera {
    /// Creates a perspective camera with a vertical field of view of `fov` degrees.
    pub fn perspective(eye: DVec3, look_at: DVec3, up: DVec3, fov: f64) -> Camera {
        Camera {
            eye,
            look_at,
            up,
            projection: Projection::Perspective { fov },
        }
    }

    /// Creates an orthographic camera with a view height of `height` file units.
    pub fn orthographic(eye: DVec3, look_at: DVec3, up: DVec3, height: f64) -> Camera {
        Camera {
            eye,
            look_at,
            up,
            projection: Projection::Orthographic { height },
        }
    }

    /// Returns a camera slightly above and to the side that shows all of `mesh` in a square image.
    pub fn fit_mesh(mesh: &TetMesh) -> Camera {
        Camera::fit_mesh_in(mesh, [1, 1])
    }

    /// As [`Camera::fit_mesh`], for an image of `size` pixels (width, height).
    pub fn fit_mesh_in(mesh: &TetMesh, size: [u32; 2]) -> Camera {
        Camera::fit_points(mesh, &mesh.nodes, size)
    }

    /// As [`Camera::fit_mesh_in`], fitting `points` instead of the nodes of the mesh, such as all
    /// positions of a moving body.
    pub fn fit_points(mesh: &TetMesh, points: &[DVec3], size: [u32; 2]) -> Camera {
        let (low, high) = mesh.bounds();
        let extent = high - low;
        // The longest axis is horizontal or vertical in the image, never along the view.
        let upright = extent.z > extent.x.max(extent.y);
        let (up, long, short) = match (upright, extent.x >= extent.y, extent.x >= extent.z) {
            (true, true, _) => (DVec3::Z, DVec3::X, DVec3::NEG_Y),
            (true, false, _) => (DVec3::Z, DVec3::Y, DVec3::X),
            (false, _, true) => (DVec3::Y, DVec3::X, DVec3::Z),
            (false, _, false) => (DVec3::Y, DVec3::NEG_Z, DVec3::X),
        };
        let back = (short + 0.5 * long + 0.4 * up).normalize();
        let (low, high) = crate::mesh::bounds(points);
        let extent = high - low;
        let mut camera = Camera::perspective((low + high) / 2.0, DVec3::ZERO, up, FRAMING_FOV);
        camera.look_at = camera.eye - back;
        let axes = camera.axes();
        let aspect = f64::from(size[0].max(1)) / f64::from(size[1].max(1));
        let slope = (FRAMING_FOV.to_radians() / 2.0).tan() * FIT_FRACTION;
        let distance = points
            .iter()
            .map(|p| {
                let q = *p - camera.eye;
                let side = (q.dot(axes.right).abs() / aspect).max(q.dot(axes.up).abs());
                side / slope - q.dot(axes.forward)
            })
            .fold(extent.length().max(f64::MIN_POSITIVE) * 1e-3, f64::max);
        camera.look_at = camera.eye;
        camera.eye = camera.look_at + back * distance;
        camera
    }

    /// As [`Camera::fit_points`], centred and close enough that the points fill the picture.
    pub(crate) fn fill_points(mesh: &TetMesh, points: &[DVec3], size: [u32; 2]) -> Camera {
        let mut camera = Camera::fit_points(mesh, points, size);
        let axes = camera.axes();
        let slope = axes.half_height * FILL_FRACTION;
        let middle = camera.look_at;
        // The eye is the apex of the narrowest pyramid around the points: A and B bound the side
        // faces, which touch a point each (half-width w at distance d: w = slope · d).
        let along = |side: DVec3, slope: f64| {
            let reach = |sign: f64| {
                let of = |p: &DVec3| (*p - middle).dot(sign * side - slope * axes.forward);
                points.iter().map(of).fold(f64::NEG_INFINITY, f64::max)
            };
            let (a, b) = (reach(1.0), reach(-1.0));
            (0.5 * (a - b), 0.5 * (a + b) / slope)
        };
        let (x, far) = along(axes.right, slope * axes.aspect(size));
        let (y, deep) = along(axes.up, slope);
        let distance = far.max(deep);
        if x.is_finite() && y.is_finite() && distance.is_finite() && distance > 0.0 {
            camera.look_at = middle + x * axes.right + y * axes.up;
            camera.eye = camera.look_at - distance * axes.forward;
        }
        camera
    }

    /// Validates the camera.
    ///
    /// # Errors
    /// An error if a number is not finite, the eye coincides with the target, the field of view is
    /// not between 0° and 180°, or the height is not positive.
    pub fn check(&self) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(format!("camera: {what}")));
        if !(self.eye.is_finite() && self.look_at.is_finite() && self.up.is_finite()) {
            return wrong("eye, look-at point and up direction must be finite".into());
        }
        if self.eye == self.look_at {
            return wrong("eye and look-at point coincide; move one of them".into());
        }
        match self.projection {
            Projection::Perspective { fov } if !(fov > 0.0 && fov < 180.0) => wrong(format!(
                "field of view must be > 0 and < 180 degrees, got {fov}"
            )),
            Projection::Orthographic { height } if !(height > 0.0 && height.is_finite()) => wrong(
                format!("view height must be positive and finite, got {height}"),
            ),
            _ => Ok(()),
        }
    }

    /// Returns the camera rotated by `degrees` about the up axis through the target,
    /// counter-clockwise seen from above.
    pub fn orbited(&self, degrees: f64) -> Camera {
        let turn = glam::DQuat::from_axis_angle(self.up.normalize(), degrees.to_radians());
        Camera {
            eye: self.look_at + turn * (self.eye - self.look_at),
            ..*self
        }
    }

    /// Returns the ray through the point `pixel` of an image of `size` pixels; (0, 0) is the upper
    /// left corner of the image, and (0.5, 0.5) the centre of the first pixel.
    pub fn ray(&self, pixel: DVec2, size: [u32; 2]) -> Ray {
        let axes = self.axes();
        let (half, aspect) = (axes.half_height, axes.aspect(size));
        let x = (2.0 * pixel.x / f64::from(size[0]) - 1.0) * half * aspect;
        let y = (1.0 - 2.0 * pixel.y / f64::from(size[1])) * half;
        let across = axes.right * x + axes.up * y;
        match self.projection {
            Projection::Perspective { .. } => Ray {
                origin: self.eye,
                direction: (axes.forward + across).normalize(),
            },
            Projection::Orthographic { .. } => Ray {
                origin: self.eye + across,
                direction: axes.forward,
            },
        }
    }

    /// Whether a sphere (centre, radius) is certainly outside the view of an image of `size`
    /// pixels.
    pub(crate) fn is_outside_view(&self, (middle, radius): (DVec3, f64), size: [u32; 2]) -> bool {
        let [width, height] = size.map(f64::from);
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        let rays = corners.map(|[x, y]| self.ray(DVec2::new(x, y), size));
        let inside = self.ray(0.5 * DVec2::new(width, height), size);
        let inside = inside.origin + inside.direction;
        (0..4).any(|k| {
            let (ray, next) = (rays[k], rays[(k + 1) % 4]);
            // Outward normal of the side plane spanned by both rays.
            let over = next.origin + next.direction - ray.origin;
            let out = ray.direction.cross(over).normalize_or_zero();
            let out = out * -out.dot(inside - ray.origin).signum();
            out.dot(middle - ray.origin) > 1.001 * radius
        })
    }

    /// Returns the unit axes of the camera and half the height of its view.
    pub(crate) fn axes(&self) -> Axes {
        let forward = (self.look_at - self.eye).normalize();
        let side = forward.cross(self.up);
        // An up direction along the view is degenerate: use any perpendicular direction.
        let right = if side.length() > 1e-9 * self.up.length() {
            side.normalize()
        } else {
            forward.any_orthonormal_vector()
        };
        Axes {
            right,
            up: right.cross(forward),
            forward,
            half_height: match self.projection {
                Projection::Perspective { fov } => (fov.to_radians() / 2.0).tan(),
                Projection::Orthographic { height } => height / 2.0,
            },
        }
    }
}

/// Axes of a camera.
pub(crate) struct Axes {
    /// Right direction in the image.
    pub right: DVec3,
    /// Up direction in the image.
    pub up: DVec3,
    /// View direction.
    pub forward: DVec3,
    /// Half the view height: at distance 1 (perspective) or at any distance (orthographic).
    pub half_height: f64,
}

impl Axes {
    /// Returns the aspect ratio (width over height) of an image.
    pub fn aspect(&self, size: [u32; 2]) -> f64 {
        f64::from(size[0].max(1)) / f64::from(size[1].max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn central_ray_hits_look_at_and_up_points_up() {
        for projection in [
            Projection::Perspective { fov: 40.0 },
            Projection::Orthographic { height: 3.0 },
        ] {
            let camera = Camera {
                eye: DVec3::new(3.0, 2.0, 5.0),
                look_at: DVec3::new(0.5, -0.2, 0.1),
                up: DVec3::Y,
                projection,
            };
            let size = [200, 100];
            let middle = camera.ray(DVec2::new(100.0, 50.0), size);
            let t = (camera.look_at - middle.origin).dot(middle.direction);
            assert!((middle.origin + middle.direction * t).distance(camera.look_at) < 1e-12);
            let higher = camera.ray(DVec2::new(100.0, 20.0), size);
            let lift =
                (higher.origin + higher.direction * t) - (middle.origin + middle.direction * t);
            assert!(lift.y > 0.1, "{projection:?} {lift}");
        }
    }

    #[test]
    fn filled_views_touch_the_margins_of_the_picture() {
        // A lopsided body: bounds centred far from its silhouette.
        let mut mesh = crate::generate::bar([4, 2, 2], DVec3::new(1.0, 0.3, 0.2)).expect("a bar");
        mesh.nodes.iter_mut().for_each(|p| p.y += 0.8 * p.x * p.x);
        for size in [[400, 300], [200, 500]] {
            let extent = |camera: &Camera| {
                let axes = camera.axes();
                let half = axes.half_height * glam::DVec2::new(axes.aspect(size), 1.0);
                let mut range = [DVec2::INFINITY, DVec2::NEG_INFINITY];
                for p in &mesh.nodes {
                    let to = *p - camera.eye;
                    let at = DVec2::new(to.dot(axes.right), to.dot(axes.up))
                        / to.dot(axes.forward)
                        / half;
                    range = [range[0].min(at), range[1].max(at)];
                }
                range
            };
            let [low, high] = extent(&Camera::fill_points(&mesh, &mesh.nodes, size));
            let fills = |k: usize| {
                (low[k] + FILL_FRACTION).abs() < 1e-9 && (high[k] - FILL_FRACTION).abs() < 1e-9
            };
            assert!(fills(0) || fills(1), "{low} {high}");
            assert!(low.min_element() > -0.931 && high.max_element() < 0.931);
            let [low, high] = extent(&Camera::fit_points(&mesh, &mesh.nodes, size));
            let wide = (high - low).max_element();
            assert!(wide < 1.8, "{low} {high}");
        }
    }

    #[test]
    fn orthographic_height_is_in_file_units() {
        let camera = Camera::orthographic(DVec3::new(0.0, 0.0, 9.0), DVec3::ZERO, DVec3::Y, 4.0);
        let top = camera.ray(DVec2::new(50.0, 0.0), [100, 100]);
        let bottom = camera.ray(DVec2::new(50.0, 100.0), [100, 100]);
        assert!(((top.origin - bottom.origin).length() - 4.0).abs() < 1e-12);
        assert_eq!(top.direction, bottom.direction);
    }

    #[test]
    fn sphere_visibility_test_never_rejects_hit_spheres() {
        let size = [160, 90];
        let (eye, to) = (DVec3::new(3.0, 2.0, 5.0), DVec3::new(0.5, -0.2, 0.1));
        let cameras = [
            Camera::perspective(eye, to, DVec3::Y, 40.0),
            Camera::orthographic(eye, to, DVec3::Y, 3.0),
        ];
        let mut missed = [0; 2];
        for camera in cameras {
            for n in 0..400 {
                let turn = |k: f64| (f64::from(n) * k).sin();
                let middle = to + 6.0 * DVec3::new(turn(1.7), turn(2.9), turn(4.3));
                let ball = (middle, 0.2 + 0.1 * turn(0.7));
                let met = (0..40 * 24).any(|p| {
                    let pixel = DVec2::new(f64::from(p % 40), f64::from(p / 40));
                    let ray = camera.ray(pixel * DVec2::new(160.0 / 39.0, 90.0 / 23.0), size);
                    let along = (ball.0 - ray.origin).dot(ray.direction);
                    let near = ray.origin + along.max(0.0) * ray.direction;
                    near.distance(ball.0) <= ball.1
                });
                let misses = camera.is_outside_view(ball, size);
                assert!(!(met && misses), "{camera:?} {ball:?}");
                missed[usize::from(misses)] += 1;
            }
        }
        // Most points are outside the view, some are inside.
        assert!(missed[0] > 20 && missed[1] > 200, "{missed:?}");
    }

    #[test]
    fn check_rejects_invalid_cameras() {
        let good = Camera::perspective(DVec3::Z, DVec3::ZERO, DVec3::Y, 30.0);
        assert!(good.check().is_ok());
        let bad = [
            Camera {
                eye: DVec3::ZERO,
                ..good
            },
            Camera {
                up: DVec3::NAN,
                ..good
            },
            Camera {
                projection: Projection::Perspective { fov: 180.0 },
                ..good
            },
            Camera {
                projection: Projection::Orthographic { height: 0.0 },
                ..good
            },
        ];
        assert!(bad.iter().all(|c| c.check().is_err()));
    }
}
