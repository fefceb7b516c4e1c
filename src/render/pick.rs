//! Picking: from a pixel to the visible surface node, tet and point.
//!
//! One ray is tested against every boundary triangle at the current positions, with the same sign
//! tests as the start of the raycaster's rays. The readback is 36 bytes. If the positions come from
//! the CPU, the test runs on the CPU and does not wait for the GPU.

use super::closest_hit::Hit;
use super::geometry::Geometry;
use super::view::{CameraTransform, ImageRegion, View};
use super::{Camera, Ray};
use crate::gpu::{Array, Gpu};
use crate::mesh::{FACES, LocalFrame};
use crate::{Error, Result};
use glam::{DVec2, DVec3, Vec3};

mod gpu_data {
    use super::View;
    crate::gpu_struct! {
        /// Parameters of `shaders/render/pick.wgsl`.
        pub(super) struct Pick {
            pub view: View,
            pub pixel: [f32; 2],
            pub triangles: u32,
            pub _pad: u32,
        }
    }
}

/// Boundary point of a mesh seen at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// The node of the face closest to the point.
    pub node: u32,
    /// The tet of the face, as numbered in the mesh.
    pub tet: u32,
    /// Local face index: opposite corner 0, 1, 2 or 3.
    pub face: u32,
    /// Nodes of the face, counter-clockwise seen from outside.
    pub nodes: [u32; 3],
    /// Barycentric coordinates of the point; the sum is 1.
    pub weights: [f64; 3],
    /// Intersection point, in file units.
    pub point: DVec3,
    /// Distance from the ray origin, in file units.
    pub distance: f64,
}

/// Closest intersection of a ray with a list of triangles.
pub(crate) struct FirstHit {
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric coordinates.
    pub weights: [f64; 3],
    /// Intersection point, in file units.
    pub point: DVec3,
    /// Closest corner: 0, 1 or 2.
    pub corner: usize,
    /// Distance along the ray, in file units.
    pub distance: f64,
}

/// Words of the shader result.
const RESULT_WORDS: usize = 9;

impl Geometry {
    /// Returns the boundary point seen at `pixel` of an image of `size` pixels, at the current
    /// positions: the first face hit by its ray ([`Camera::ray`]), two-sided; `None` if the ray
    /// misses. Waits and reads back 36 bytes; intended for the start of a grab, not for every
    /// frame.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid camera or a point outside the image; [`Error::Gpu`] if the
    /// device fails.
    pub fn pick(&self, camera: &Camera, pixel: DVec2, size: [u32; 2]) -> Result<Option<Pick>> {
        let looked = PickRay {
            camera,
            pixel,
            size,
            frame: &self.frame,
        };
        let hit = looked.first_hit(&self.gpu, &self.positions, 1, &self.boundary)?;
        Ok(hit.and_then(|hit| self.picked(&hit)))
    }

    /// As [`Geometry::pick`], for node `positions` in file units; runs on the CPU without waiting
    /// for the GPU.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid camera, a point outside the image, or positions that do not
    /// match the mesh.
    pub fn pick_positions(
        &self,
        positions: &[DVec3],
        camera: &Camera,
        pixel: DVec2,
        size: [u32; 2],
    ) -> Result<Option<Pick>> {
        check(camera, pixel, size)?;
        if positions.len() != self.positions.len() as usize {
            return Err(Error::Input(format!(
                "number of positions must equal the number of nodes, got {} for {}",
                positions.len(),
                self.positions.len()
            )));
        }
        let ray = camera.ray(pixel, size);
        let corners = self.boundary_faces.iter().map(|&[a, b, c, _]| [a, b, c]);
        let triangles: Vec<[u32; 3]> = corners.collect();
        let Some(hit) = Hit::closest(positions, &triangles, ray) else {
            return Ok(None);
        };
        let point = ray.origin + hit.distance * ray.direction;
        let away = |corner: &usize| {
            positions[triangles[hit.triangle][*corner] as usize].distance_squared(point)
        };
        let corner = (0..3).min_by(|a, b| away(a).total_cmp(&away(b)));
        Ok(self.picked(&FirstHit {
            triangle: hit.triangle as u32,
            weights: hit.weights,
            point,
            corner: corner.unwrap_or(0),
            distance: hit.distance,
        }))
    }

    /// Converts a hit to mesh indices.
    fn picked(&self, hit: &FirstHit) -> Option<Pick> {
        let [a, b, c, code] = *self.boundary_faces.get(hit.triangle as usize)?;
        let nodes = [a, b, c];
        // The storage order of tets differs from the mesh order.
        let tet = self.tet_order.iter().position(|slot| *slot == code / 4)?;
        Some(Pick {
            node: nodes[hit.corner],
            tet: tet as u32,
            face: code % FACES.len() as u32,
            nodes,
            weights: hit.weights,
            point: hit.point,
            distance: hit.distance,
        })
    }
}

/// Rejects an invalid camera and points outside the image.
fn check(camera: &Camera, pixel: DVec2, size: [u32; 2]) -> Result<()> {
    camera.check()?;
    let picture = DVec2::new(f64::from(size[0]), f64::from(size[1]));
    let inside = pixel.cmpge(DVec2::ZERO) & pixel.cmple(picture);
    match inside.all() {
        true => Ok(()),
        false => Err(Error::Input(format!(
            "pixel {pixel} is outside the image of {} × {} pixels",
            size[0], size[1]
        ))),
    }
}

/// A ray through a point of an image, and the local frame of the target.
pub(crate) struct PickRay<'a> {
    pub camera: &'a Camera,
    pub pixel: DVec2,
    pub size: [u32; 2],
    pub frame: &'a LocalFrame,
}

impl PickRay<'_> {
    /// Returns the first of `triangles` (rgba32uint, three corners) hit by the ray; corner i is
    /// item i · `stride` of `positions`. Waits and reads back.
    ///
    /// # Errors
    /// As [`Geometry::pick`].
    pub fn first_hit(
        &self,
        gpu: &Gpu,
        positions: &Array,
        stride: u32,
        triangles: &Array,
    ) -> Result<Option<FirstHit>> {
        check(self.camera, self.pixel, self.size)?;
        let view = CameraTransform::new(self.camera, self.frame, ImageRegion::full(self.size));
        let params = gpu_data::Pick {
            view: view.to_gpu(),
            pixel: self.pixel.as_vec2().to_array(),
            triangles: triangles.len(),
            _pad: 0,
        };
        let mut nothing = [0; RESULT_WORDS];
        nothing[..2].fill(u32::MAX);
        let found = gpu.buffer_of("ray hit", &nothing)?;
        let mut work = gpu.start_recording();
        for (stage, items) in [(0, triangles.len()), (1, triangles.len()), (2, 1)] {
            gpu.pass("render/pick")
                .constant("PASS", f64::from(stage))
                .constant("TRIANGLES_PER_INVOCATION", f64::from(stride))
                .read(positions)
                .read(triangles)
                .write(&found)
                .params(&params)
                .dispatch_items(items)?
                .record(&mut work);
        }
        work.submit()?;
        let found: Vec<u32> = gpu.read_buffer(&found)?;
        Ok(self.decode_hit(&found, triangles.len()))
    }

    fn decode_hit(&self, found: &[u32], triangles: u32) -> Option<FirstHit> {
        let &[_, triangle, a, b, c, x, y, z, corner] = found else {
            return None;
        };
        let float = |bits: u32| f32::from_bits(bits);
        let local = Vec3::new(float(x), float(y), float(z));
        let point = self.frame.to_file(local);
        let Ray { origin, direction } = self.camera.ray(self.pixel, self.size);
        (triangle < triangles).then(|| FirstHit {
            triangle,
            weights: [a, b, c].map(|w| f64::from(float(w))),
            point,
            corner: corner.min(2) as usize,
            distance: (point - origin).dot(direction),
        })
    }
}
