//! Camera in the local frame, in the layout of the shaders (`shaders/lib/view.wgsl`).

use super::{Camera, Projection};
use crate::mesh::LocalFrame;
use glam::{DMat4, DVec2, DVec4};

/// Region of an image that is drawn at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ImageRegion {
    /// Size of the whole image, in pixels.
    pub picture: [u32; 2],
    /// Pixel of the image at the upper left corner of the region.
    pub corner: [u32; 2],
    /// Size of the region.
    pub size: [u32; 2],
}

impl ImageRegion {
    /// Returns the region of a whole image.
    pub fn full(size: [u32; 2]) -> ImageRegion {
        ImageRegion {
            picture: size,
            corner: [0, 0],
            size,
        }
    }
}

pub(crate) mod gpu_data {
    crate::gpu_struct! {
        /// Layout of `shaders/lib/view.wgsl`.
        pub(crate) struct View {
            pub right: [f32; 4],
            pub up: [f32; 4],
            pub forward: [f32; 4],
            pub slope: [f32; 4],
            pub base: [f32; 4],
            pub clip: [f32; 4],
            pub depth: [f32; 4],
            pub scalar: [f32; 2],
            pub near: f32,
            pub unit: f32,
            pub opacity: f32,
            pub nodes: u32,
            pub corners: u32,
            pub max_steps: u32,
            pub layers: u32,
            pub table_max_depth: f32,
            pub pixel: [f32; 2],
            pub light: [f32; 4],
            pub xray: [f32; 4],
        }
    }
}

pub(crate) use gpu_data::View;

/// Near plane distance of a perspective camera, in local units.
const NEAR_PLANE: f64 = 1e-5;
/// Offset of rays from the pixel centre, in pixels and at most in local units: a view along an axis
/// of a regular mesh would otherwise send many rays exactly through nodes and edges, where sign
/// tests are undecided.
const PIXEL_OFFSET: [f64; 2] = [0.61 / 256.0, 2.0e-6];
/// Distance from the local origin along the view beyond which objects may be clipped, in local
/// units; it bounds the depth range of distant and of orthographic cameras.
const FAR_DISTANCE: f64 = 32.0;

/// Mesh-independent camera data, in f64.
pub(crate) struct CameraTransform {
    axes: [DVec4; 3],
    slope: DVec4,
    base: DVec4,
    clip: DVec4,
    depth: DVec4,
    near: f64,
    scale: f64,
    pixel: DVec2,
}

impl CameraTransform {
    /// Creates the view of `camera` in `frame`, for the region `window` of its image.
    pub fn new(camera: &Camera, frame: &LocalFrame, window: ImageRegion) -> CameraTransform {
        let axes = camera.axes();
        // From the eye to the local origin, in local units.
        let away = (frame.origin - camera.eye) / frame.scale;
        let distance = away.dot(axes.forward);
        let aspect = axes.aspect(window.picture);
        let half = match camera.projection {
            Projection::Perspective { .. } => {
                DVec2::new(axes.half_height * aspect, axes.half_height)
            }
            Projection::Orthographic { .. } => {
                DVec2::new(axes.half_height * aspect, axes.half_height) / frame.scale
            }
        };
        let size = |s: [u32; 2]| DVec2::new(f64::from(s[0].max(1)), f64::from(s[1].max(1)));
        let (picture, corner) = (
            size(window.picture),
            DVec2::new(f64::from(window.corner[0]), f64::from(window.corner[1])),
        );
        // Pixel p of the region is at plane * p + offset in the view plane, y upwards.
        let plane = DVec2::new(2.0, -2.0) * half / picture;
        let offset = plane * corner + DVec2::new(-1.0, 1.0) * half;
        let line = DVec4::new(plane.x, plane.y, offset.x, offset.y);
        let across = match camera.projection {
            Projection::Perspective { .. } => distance.abs().max(NEAR_PLANE),
            Projection::Orthographic { .. } => 1.0,
        };
        let aside = (PIXEL_OFFSET[0] * plane.x).min(PIXEL_OFFSET[1] / across);
        let line = line + aside * DVec4::new(0.0, 0.0, 0.647, 1.0);
        let shrink = picture / size(window.size);
        let shift = (picture - 2.0 * corner) / size(window.size);
        let clip = (shrink / half).extend(shift.x - 1.0).extend(1.0 - shift.y);
        let (slope, base, depth, near) = match camera.projection {
            Projection::Perspective { .. } if distance > 2.0 * FAR_DISTANCE => {
                // Distant camera: a depth range close to the mesh, from 1 at its near end to 0.
                let near = distance - FAR_DISTANCE;
                let share = near / (2.0 * FAR_DISTANCE);
                (
                    line,
                    line * distance,
                    DVec4::new(-share, share * FAR_DISTANCE, 1.0, distance),
                    near,
                )
            }
            Projection::Perspective { .. } => (
                line,
                line * distance,
                DVec4::new(0.0, NEAR_PLANE, 1.0, distance),
                NEAR_PLANE,
            ),
            Projection::Orthographic { .. } => {
                let near = (distance - FAR_DISTANCE).max(0.0);
                let range = (distance + FAR_DISTANCE).max(1.0) - near;
                let depth = DVec4::new(-1.0 / range, 1.0 - (distance - near) / range, 0.0, 1.0);
                (DVec4::ZERO, line, depth, near)
            }
        };
        CameraTransform {
            axes: [
                axes.right.extend(away.dot(axes.right)),
                axes.up.extend(away.dot(axes.up)),
                axes.forward.extend(0.0),
            ],
            slope,
            base,
            clip,
            depth,
            near: near - distance,
            scale: frame.scale,
            pixel: 2.0 / size(window.size),
        }
    }

    /// Converts to the shader layout; mesh and table fields are zero.
    pub fn to_gpu(&self) -> View {
        let f = |v: DVec4| v.as_vec4().to_array();
        View {
            right: f(self.axes[0]),
            up: f(self.axes[1]),
            forward: f(self.axes[2]),
            slope: f(self.slope),
            base: f(self.base),
            clip: f(self.clip),
            depth: f(self.depth),
            near: self.near as f32,
            unit: self.scale as f32,
            pixel: self.pixel.as_vec2().to_array(),
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// Returns the matrix from file coordinates to clip space, for drawing other objects.
    pub fn clip_from_file(&self, frame: &LocalFrame) -> DMat4 {
        let camera =
            DMat4::from_cols(self.axes[0], self.axes[1], self.axes[2], DVec4::W).transpose();
        let (c, d) = (self.clip, self.depth);
        let clip = DMat4::from_cols(
            DVec4::new(c.x, 0.0, 0.0, 0.0),
            DVec4::new(0.0, c.y, 0.0, 0.0),
            DVec4::new(c.z * d.z, c.w * d.z, d.x, d.z),
            DVec4::new(c.z * d.w, c.w * d.w, d.y, d.w),
        );
        let local = DMat4::from_scale((1.0 / frame.scale) * glam::DVec3::ONE)
            * DMat4::from_translation(-frame.origin);
        clip * camera * local
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn clip_space_matches_camera_rays() {
        let frame = LocalFrame {
            origin: DVec3::new(10.0, 20.0, -5.0),
            scale: 4.0,
        };
        let window = ImageRegion {
            picture: [300, 200],
            corner: [100, 40],
            size: [120, 90],
        };
        let eye = DVec3::new(15.0, 24.0, 9.0);
        for far in [1.0, 400.0] {
            let eye = frame.origin + (eye - frame.origin) * far;
            for camera in [
                Camera::perspective(eye, frame.origin, DVec3::Y, 35.0 / far),
                Camera::orthographic(eye, frame.origin, DVec3::Y, 5.0),
            ] {
                let view = CameraTransform::new(&camera, &frame, window);
                let pixel = DVec2::new(130.5, 77.25);
                let ray = camera.ray(pixel, window.picture);
                let t = (frame.origin - ray.origin).dot(ray.direction) + 0.3;
                let clip =
                    view.clip_from_file(&frame) * (ray.origin + ray.direction * t).extend(1.0);
                let at = DVec2::new(
                    (clip.x / clip.w + 1.0) * 60.0 + 100.0,
                    (1.0 - clip.y / clip.w) * 45.0 + 40.0,
                );
                assert!((at - pixel).length() < 1e-6, "{camera:?}: {at}");
                assert!((0.0..=1.0).contains(&(clip.z / clip.w)));
                // The same line in camera space: (x, y) = origin + slope z.
                let inside = pixel - DVec2::new(100.0, 40.0);
                let line = |v: DVec4| DVec2::new(v.x * inside.x + v.z, v.y * inside.y + v.w);
                let local = (ray.origin + ray.direction * t - frame.origin) / frame.scale;
                let [x, y, z] = view.axes.map(|a| a.truncate().dot(local) + a.w);
                let seen = line(view.base) + line(view.slope) * z;
                assert!((seen - DVec2::new(x, y)).length() < 3e-6, "{camera:?}");
            }
        }
    }
}
