//! Picking: from a pixel to the node, tet and point of the surface that are seen there.
//!
//! One ray is held against every triangle of the boundary where its nodes are now, with the sign
//! tests that the raycaster starts its rays by. What comes back is 36 bytes. Where the nodes came from
//! the processor it is held against them there, and nobody waits for the device.

use super::closest_hit::closest_hit;
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
        /// See `shaders/render/pick.wgsl`.
        pub(super) struct Pick {
            pub view: View,
            pub pixel: [f32; 2],
            pub triangles: u32,
            pub _pad: u32,
        }
    }
}

/// What a pixel shows of the boundary of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// The nearest to the point of the face's three nodes.
    pub node: u32,
    /// The tet that the face bounds, as numbered in the mesh.
    pub tet: u32,
    /// Which of its faces: opposite corner 0, 1, 2 or 3.
    pub face: u32,
    /// The face's nodes, counter-clockwise seen from outside.
    pub nodes: [u32; 3],
    /// Their weights at the point; the sum is 1.
    pub weights: [f64; 3],
    /// Where the ray meets the face, in file units.
    pub point: DVec3,
    /// How far along the ray that is from its origin, in file units.
    pub distance: f64,
}

/// What a ray meets first of a list of triangles.
pub(crate) struct FirstHit {
    /// Its place in the list.
    pub triangle: u32,
    /// Weights of its corners.
    pub weights: [f64; 3],
    /// Where, in file units.
    pub point: DVec3,
    /// The nearest corner: 0, 1 or 2.
    pub corner: usize,
    /// Along the ray, in file units.
    pub distance: f64,
}

/// Words that the shader finds.
const RESULT_WORDS: usize = 9;

impl Geometry {
    /// What is seen of the boundary at the point `pixel` of a picture of `size` pixels, where the
    /// nodes are now: the face that the ray through it ([`Camera::ray`]) meets first, from
    /// either side; none where it misses. Waits and reads 36 bytes back: for the start of a
    /// grab, not for every frame.
    ///
    /// # Errors
    /// [`Error::Input`] for a bad camera, or a point that does not lie in the picture;
    /// [`Error::Gpu`] when the device refuses.
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

    /// As [`Geometry::pick`] of nodes that are at `positions`, in file units, by the processor: it
    /// waits for nothing.
    ///
    /// # Errors
    /// [`Error::Input`] for a bad camera, a point that does not lie in the picture, or positions that
    /// are not the mesh's.
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
                "{} positions given for {} nodes",
                positions.len(),
                self.positions.len()
            )));
        }
        let ray = camera.ray(pixel, size);
        let corners = self.boundary_faces.iter().map(|&[a, b, c, _]| [a, b, c]);
        let triangles: Vec<[u32; 3]> = corners.collect();
        let Some(hit) = closest_hit(positions, &triangles, ray) else {
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

    /// What was met, by the numbers of the mesh.
    fn picked(&self, hit: &FirstHit) -> Option<Pick> {
        let [a, b, c, code] = *self.boundary_faces.get(hit.triangle as usize)?;
        let nodes = [a, b, c];
        // Tets are kept in another order than the mesh has them.
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

/// Refuses a camera that makes no sense, and points beside the picture.
fn check(camera: &Camera, pixel: DVec2, size: [u32; 2]) -> Result<()> {
    camera.check()?;
    let picture = DVec2::new(f64::from(size[0]), f64::from(size[1]));
    let inside = pixel.cmpge(DVec2::ZERO) & pixel.cmple(picture);
    match inside.all() {
        true => Ok(()),
        false => Err(Error::Input(format!(
            "{pixel} is no point of a picture of {} × {} pixels",
            size[0], size[1]
        ))),
    }
}

/// A ray through a point of a picture, and the local frame of what it is to meet.
pub(crate) struct PickRay<'a> {
    pub camera: &'a Camera,
    pub pixel: DVec2,
    pub size: [u32; 2],
    pub frame: &'a LocalFrame,
}

impl PickRay<'_> {
    /// The first of `triangles` (rgba32uint, three corners) that the ray meets; corner i is at
    /// item `stride` i of `positions`. Waits and reads back.
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
        let found = gpu.buffer_of("what a ray meets", &nothing)?;
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
        Ok(self.told(&found, triangles.len()))
    }

    fn told(&self, found: &[u32], triangles: u32) -> Option<FirstHit> {
        let &[_, triangle, a, b, c, x, y, z, corner] = found else {
            return None;
        };
        let float = |bits: u32| f32::from_bits(bits);
        let place = Vec3::new(float(x), float(y), float(z));
        let point = self.frame.to_file(place);
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
