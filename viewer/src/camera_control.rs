//! Orbit camera.

use glam::{DMat3, DQuat, DVec2, DVec3};
use palpate::render::{Camera, Projection};

/// Orbit angle in radians for a pointer motion across the picture.
const ORBIT_RADIANS: f64 = std::f64::consts::PI;
/// Minimum distance of the eye from its focus, relative to the body's size.
const NEAREST: f64 = 1e-3;
/// Maximum distance.
const FARTHEST: f64 = 100.0;
/// Fraction of the picture's height that a fitted body fills.
const FIT_FRACTION: f64 = 0.9;

/// A standard view, named by the position of the eye: right, left, anterior, posterior, superior,
/// inferior.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Side {
    Right,
    Left,
    Anterior,
    Posterior,
    Superior,
    Inferior,
}

impl Side {
    /// All views with their short and long names.
    pub const ALL: [(Side, &'static str, &'static str); 6] = [
        (Side::Right, "R", "Right"),
        (Side::Left, "L", "Left"),
        (Side::Anterior, "A", "Anterior (front)"),
        (Side::Posterior, "P", "Posterior (back)"),
        (Side::Superior, "S", "Superior (top)"),
        (Side::Inferior, "I", "Inferior (bottom)"),
    ];

    /// Returns the direction towards the eye and the up vector, in RAS.
    fn axes(self) -> [DVec3; 2] {
        match self {
            Side::Right => [DVec3::X, DVec3::Z],
            Side::Left => [DVec3::NEG_X, DVec3::Z],
            Side::Anterior => [DVec3::Y, DVec3::Z],
            Side::Posterior => [DVec3::NEG_Y, DVec3::Z],
            Side::Superior => [DVec3::Z, DVec3::Y],
            Side::Inferior => [DVec3::NEG_Z, DVec3::Y],
        }
    }
}

/// A camera that orbits the point it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Focus, in file units.
    pub focus: DVec3,
    /// Orientation: axes right, up, and towards the eye.
    pub turn: DQuat,
    /// Distance from the focus to the eye, in file units.
    pub distance: f64,
    /// Vertical opening angle, in degrees.
    pub fov: f64,
    /// Whether the projection is orthographic, with the same height of the view at the focus.
    pub orthographic: bool,
    /// Size of the body, in file units.
    size: f64,
}

impl Orbit {
    /// Returns the orbit of `camera` for a body of `size`, the diagonal of its bounds.
    pub fn of(camera: &Camera, size: f64) -> Orbit {
        let back = (camera.eye - camera.look_at).normalize_or(DVec3::Z);
        let mut distance = camera.eye.distance(camera.look_at);
        let (fov, orthographic) = match camera.projection {
            Projection::Perspective { fov } => (fov, false),
            Projection::Orthographic { height } => {
                distance = height / (2.0 * half_slope(30.0));
                (30.0, true)
            }
        };
        Orbit {
            focus: camera.look_at,
            turn: turn_of(back, camera.up),
            distance,
            fov,
            orthographic,
            size: size.max(f64::MIN_POSITIVE),
        }
    }

    /// Returns the camera.
    pub fn camera(&self) -> Camera {
        let eye = self.focus + self.turn * DVec3::Z * self.distance;
        let up = self.turn * DVec3::Y;
        match self.orthographic {
            false => Camera::perspective(eye, self.focus, up, self.fov),
            true => {
                // In an orthographic view the eye is moved back, so that the whole body is in front
                // of it.
                let eye = self.focus + self.turn * DVec3::Z * (self.distance + 4.0 * self.size);
                Camera::orthographic(eye, self.focus, up, self.height())
            }
        }
    }

    /// Returns the height of the view at the focus, in file units.
    pub fn height(&self) -> f64 {
        2.0 * self.distance * half_slope(self.fov)
    }

    /// Orbits by a pointer motion in fractions of the picture's height: to the right, and down.
    pub fn orbit(&mut self, moved: DVec2) {
        let aside = DQuat::from_axis_angle(DVec3::Y, -ORBIT_RADIANS * moved.x);
        let over = DQuat::from_axis_angle(DVec3::X, -ORBIT_RADIANS * moved.y);
        self.turn = (self.turn * aside * over).normalize();
    }

    /// Rolls the picture counter-clockwise by an angle in radians.
    pub fn roll(&mut self, angle: f64) {
        self.turn = (self.turn * DQuat::from_axis_angle(DVec3::Z, -angle)).normalize();
    }

    /// Pans with the pointer, by a motion in fractions of the picture's height.
    pub fn pan(&mut self, moved: DVec2) {
        let across = DVec3::new(-moved.x, moved.y, 0.0) * self.height();
        self.focus += self.turn * across;
    }

    /// Zooms in by `factor`; 2 halves the distance.
    pub fn zoom(&mut self, factor: f64) {
        let distance = self.distance / factor.clamp(0.01, 100.0);
        self.distance = distance.clamp(NEAREST * self.size, FARTHEST * self.size);
    }

    /// Moves by `forward` and `aside`, relative to the body's size.
    pub fn dolly(&mut self, forward: f64, aside: f64) {
        self.focus += self.turn * DVec3::new(aside, 0.0, -forward) * self.size;
    }

    /// Looks from a standard side at the same focus, from the same distance.
    pub fn look_from(&mut self, side: Side) {
        let [back, up] = side.axes();
        self.turn = turn_of(back, up);
    }

    /// Fits the box from `low` to `high` into a picture with the aspect ratio `aspect` (width over
    /// height).
    pub fn fit(&mut self, (low, high): (DVec3, DVec3), aspect: f64) {
        self.focus = 0.5 * (low + high);
        self.size = low.distance(high).max(f64::MIN_POSITIVE);
        let slope = half_slope(self.fov) * FIT_FRACTION;
        let axes = DMat3::from_quat(self.turn).transpose();
        let corners = (0..8).map(|k| {
            let pick = |axis: usize| [low, high][k >> axis & 1][axis];
            axes * (DVec3::new(pick(0), pick(1), pick(2)) - self.focus)
        });
        let needed = corners.map(|q| {
            let aside = q.y.abs().max(q.x.abs() / aspect.max(0.01));
            aside / slope + if self.orthographic { 0.0 } else { q.z }
        });
        self.distance = needed.fold(NEAREST * self.size, f64::max);
    }
}

/// Returns half the height of a view at distance 1.
fn half_slope(fov: f64) -> f64 {
    (0.5 * fov.to_radians()).tan()
}

/// Returns the rotation whose third axis is `back`, with `up` as near to upwards as possible.
fn turn_of(back: DVec3, up: DVec3) -> DQuat {
    let right = up.cross(back).try_normalize();
    let right = right.unwrap_or_else(|| back.any_orthonormal_vector());
    DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> Orbit {
        let camera = Camera::perspective(
            DVec3::new(1.0, -4.0, 2.0),
            DVec3::new(0.5, 0.0, 0.0),
            DVec3::Z,
            30.0,
        );
        Orbit::of(&camera, 2.0)
    }

    #[test]
    fn orbit_of_camera_round_trips() {
        let eye = DVec3::new(1.0, -4.0, 2.0);
        let camera = view().camera();
        assert!(camera.eye.distance(eye) < 1e-12);
        assert!(camera.look_at.distance(DVec3::new(0.5, 0.0, 0.0)) < 1e-12);
        assert!(camera.up.z > 0.8 && camera.up.dot(eye - camera.look_at).abs() < 1e-12);
    }

    #[test]
    fn orbiting_preserves_distance_and_is_reversible() {
        let mut orbit = view();
        orbit.orbit(DVec2::new(0.3, 0.0));
        assert!((orbit.camera().eye.distance(orbit.focus) - view().distance).abs() < 1e-12);
        assert!(orbit.camera().eye.distance(view().camera().eye) > 0.5);
        orbit.orbit(DVec2::new(-0.3, 0.0));
        assert!(orbit.camera().eye.distance(view().camera().eye) < 1e-9);
        // The pointer moves to the right, so the eye moves to the left.
        orbit.orbit(DVec2::new(0.1, 0.0));
        let right = view().turn * DVec3::X;
        assert!((orbit.camera().eye - view().camera().eye).dot(right) < 0.0);
    }

    #[test]
    fn panning_keeps_point_under_pointer() {
        let mut orbit = view();
        let size = [400, 300];
        let pixel = DVec2::new(100.0, 200.0);
        // At the distance of the focus.
        let seen = |orbit: &Orbit, pixel: DVec2| {
            let (camera, back) = (orbit.camera(), orbit.turn * DVec3::Z);
            let ray = camera.ray(pixel, size);
            ray.origin
                + ray.direction * ((orbit.focus - ray.origin).dot(back) / ray.direction.dot(back))
        };
        for orthographic in [false, true] {
            orbit.orthographic = orthographic;
            let before = seen(&orbit, pixel);
            let motion = DVec2::new(37.0, -21.0);
            orbit.pan(motion / 300.0);
            assert!(seen(&orbit, pixel + motion).distance(before) < 1e-9);
        }
    }

    #[test]
    fn fitted_body_fills_and_stays_within_picture() {
        let (low, high) = (DVec3::new(-3.0, -1.0, 0.0), DVec3::new(5.0, 1.0, 2.0));
        for (orthographic, size) in [(false, [400, 300]), (true, [300, 400])] {
            let mut orbit = view();
            orbit.orthographic = orthographic;
            orbit.fit((low, high), f64::from(size[0]) / f64::from(size[1]));
            let camera = orbit.camera();
            let mut most: f64 = 0.0;
            for k in 0..8 {
                let corner = DVec3::new(
                    [low.x, high.x][k & 1],
                    [low.y, high.y][k >> 1 & 1],
                    [low.z, high.z][k >> 2],
                );
                let local = orbit.turn.inverse() * (corner - orbit.focus);
                let deep = if orthographic {
                    orbit.distance
                } else {
                    orbit.distance - local.z
                };
                let half = deep * half_slope(orbit.fov);
                let aspect = f64::from(size[0]) / f64::from(size[1]);
                most = most
                    .max(local.y.abs() / half)
                    .max(local.x.abs() / half / aspect);
            }
            assert!((most - FIT_FRACTION).abs() < 1e-9, "{most}");
            camera.check().unwrap_or_else(|e| panic!("{e}"));
        }
    }

    #[test]
    fn standard_views_match_anatomical_axes() {
        for (side, letter, _) in Side::ALL {
            let mut orbit = view();
            orbit.look_from(side);
            let camera = orbit.camera();
            let back = (camera.eye - camera.look_at).normalize();
            let axis = match letter {
                "R" => DVec3::X,
                "L" => DVec3::NEG_X,
                "A" => DVec3::Y,
                "P" => DVec3::NEG_Y,
                "S" => DVec3::Z,
                _ => DVec3::NEG_Z,
            };
            assert!(back.distance(axis) < 1e-12, "{letter}");
        }
    }
}
