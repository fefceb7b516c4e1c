//! A bent ball with an embedded scan: its reference image and its raycaster.

use super::phantom;
use crate::Result;
use crate::gpu::Gpu;
use crate::mesh::{LocalFrame, TetMesh, Topology};
use crate::parallel;
use crate::render::{
    AbsoluteTransferFunction, Camera, Geometry, Image, RaycastOptions, Raycaster,
    ReferenceRaycaster, Scan, local_positions,
};
use glam::{DVec2, DVec3};

/// Bend radius of the z-axis.
const BEND: f64 = 1.0;
/// Radius of the ball at rest.
pub(crate) const BALL: f64 = 0.5;
const BOUNDING_RADIUS: f64 = 0.6;
/// Samples per voxel of the reference image.
pub(super) const REFERENCE_SAMPLES_PER_VOXEL: f64 = 8.0;
/// Opacity at which a ray of the reference image terminates.
const OPAQUE: f64 = 1.0 - 1e-6;

/// How a mesh represents the scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScanRepresentation {
    /// The mesh carries the scan.
    Scan,
    /// Nodal values: means over the cells of the nodes.
    Means,
    /// Nodal values: samples of the scan at the nodes.
    Samples,
}

/// Returns the deformed position of `p`.
fn bent(p: DVec3) -> DVec3 {
    let (sin, cos) = (p.z / BEND).sin_cos();
    let r = BEND + p.x;
    DVec3::new(r * cos - BEND, p.y, r * sin)
}

/// Returns the rest position of `p`.
fn unbent(p: DVec3) -> DVec3 {
    let r = (p.x + BEND).hypot(p.z);
    DVec3::new(r - BEND, p.y, BEND * p.z.atan2(p.x + BEND))
}

/// The scan, and how it is rendered.
pub(crate) struct Subject {
    scan: Scan,
    transfer: AbsoluteTransferFunction,
    pub camera: Camera,
    pub size: [u32; 2],
}

impl Subject {
    /// Creates a scan with `voxels` voxels along each axis, rendered with `pixels` pixels.
    pub fn new(voxels: usize, pixels: usize) -> Result<Subject> {
        let scan = phantom::scan(voxels)?;
        let eye = DVec3::new(1.0, -2.0, 0.7);
        Ok(Subject {
            transfer: phantom::transfer()?.to_absolute(scan.range(), 1.0),
            scan,
            camera: Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 26.0),
            size: [pixels as u32; 2],
        })
    }

    /// Returns the bytes of the scan on the GPU: half floats.
    pub fn scan_bytes(&self) -> f64 {
        2.0 * self.scan.volume.voxels() as f64
    }

    /// Computes the float64 reference image of the bent scan, without any mesh.
    pub fn truth(&self) -> Image {
        let pixels =
            self.exact(1.0 / (REFERENCE_SAMPLES_PER_VOXEL * self.scan.volume.size[0] as f64));
        Image {
            size: self.size,
            channels: 4,
            values: pixels.into_iter().flatten().map(|v| v as f32).collect(),
        }
    }

    /// Returns pixels computed with samples `step` apart.
    fn exact(&self, step: f64) -> Vec<[f64; 4]> {
        let [width, height] = self.size.map(|n| n as usize);
        let to_voxel = self.scan.rest_to_voxel();
        parallel::map_coarse(width * height, |i| {
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let ray = self.camera.ray(pixel, self.size);
            let nearest = -ray.origin.dot(ray.direction);
            let aside = (ray.origin + nearest * ray.direction).length_squared();
            let half = (BOUNDING_RADIUS * BOUNDING_RADIUS - aside).max(0.0).sqrt();
            let mut sum = [0.0; 4];
            for n in 0..(2.0 * half / step).ceil() as usize {
                let t = nearest - half + (n as f64 + 0.5) * step;
                let rest = unbent(ray.origin + t * ray.direction);
                if rest.length_squared() > BALL * BALL {
                    continue;
                }
                let value = self.scan.volume.at_index(to_voxel.transform_point3(rest));
                let alpha = -(-step * self.transfer.extinction(value)).exp_m1();
                if alpha <= 0.0 {
                    continue;
                }
                let [r, g, b] = self.transfer.colour(value);
                let clear = 1.0 - sum[3];
                for (sum, seen) in sum.iter_mut().zip([r, g, b, 1.0]) {
                    *sum += clear * alpha * seen;
                }
                if sum[3] > OPAQUE {
                    break;
                }
            }
            sum
        })
    }

    /// Computes the float64 image of the scan carried by `mesh`, bent, with `samples` per voxel.
    pub fn exact_through(&self, mesh: &TetMesh, samples: f64) -> Vec<[f64; 4]> {
        let positions: Vec<DVec3> = mesh.nodes.iter().map(|p| bent(*p)).collect();
        let rays = ReferenceRaycaster::from_scan(mesh, &positions, &self.scan, samples);
        rays.render(&self.camera, self.size, |rays, ray| {
            rays.composite(ray, &self.transfer)
        })
    }

    /// Returns the raycaster of `mesh`, bent, and notes for the user.
    pub fn raycaster(
        &self,
        gpu: &Gpu,
        mesh: &TetMesh,
        knows: ScanRepresentation,
        options: RaycastOptions,
    ) -> Result<(Raycaster, Vec<String>)> {
        let frame = LocalFrame::from_mesh(mesh);
        let positions: Vec<DVec3> = mesh.nodes.iter().map(|p| bent(*p)).collect();
        let positions = local_positions(gpu, &frame, &positions)?;
        let topology = Topology::new(mesh);
        let volume = &self.scan.volume;
        let values = match knows {
            ScanRepresentation::Scan => vec![0.0; mesh.nodes.len()],
            ScanRepresentation::Means => volume.onto_nodes(mesh, "scan").values,
            ScanRepresentation::Samples => {
                parallel::map(mesh.nodes.len(), |v| volume.sample(mesh.nodes[v]))
            }
        };
        let mut geometry = Geometry::new(gpu, mesh, &topology, frame, &positions, &values)?;
        if knows == ScanRepresentation::Scan {
            geometry.store_rest_positions(mesh)?;
        }
        let mut caster = Raycaster::with_options(gpu, geometry, &phantom::transfer()?, options)?;
        let notes = match knows {
            ScanRepresentation::Scan => caster.set_scans(mesh, std::slice::from_ref(&self.scan))?,
            ScanRepresentation::Means | ScanRepresentation::Samples => Vec::new(),
        };
        Ok((caster, notes))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;

    /// Returns the RMS difference, in 1/255.
    fn rms_difference(a: &[[f64; 4]], b: &[[f64; 4]]) -> f64 {
        let pairs = a.as_flattened().iter().zip(b.as_flattened());
        let square: f64 = pairs.map(|(a, b)| (a - b).powi(2)).sum();
        255.0 * (square / (4 * a.len()) as f64).sqrt()
    }

    #[test]
    fn unbend_inverts_bend() {
        for p in [
            DVec3::ZERO,
            DVec3::new(0.3, -0.2, 0.35),
            DVec3::new(-0.4, 0.1, -0.3),
        ] {
            assert!(unbent(bent(p)).distance(p) < 1e-12, "{p}");
            assert!(bent(p).length() < BOUNDING_RADIUS, "{p}");
        }
        assert!(bent(DVec3::new(0.1, 0.0, 0.4)).distance(DVec3::new(0.1, 0.0, 0.4)) > 0.05);
    }

    /// The reference image has converged in its step length, and equals exact rays through many
    /// tets.
    #[test]
    fn exact_image_matches_fine_mesh_rays() {
        let subject = Subject::new(48, 40).unwrap();
        let voxel = 1.0 / 48.0;
        let pixels = subject.exact(voxel / REFERENCE_SAMPLES_PER_VOXEL);
        let finer = rms_difference(
            &pixels,
            &subject.exact(voxel / (4.0 * REFERENCE_SAMPLES_PER_VOXEL)),
        );
        assert!(finer < 0.1, "{finer}");
        let through_tets = |cells: usize| {
            let mesh = generate::ball(BALL, cells).unwrap();
            let all = subject.exact_through(&mesh, REFERENCE_SAMPLES_PER_VOXEL);
            rms_difference(&pixels, &all)
        };
        let [few, many] = [8, 24].map(through_tets);
        println!("{finer:.4} by steps, {few:.3} of few tets, {many:.3} of many");
        assert!(many < 0.5 && many < 0.5 * few, "{few} {many}");
    }
}
