//! Camera and picture size of a stage.

use super::{NodeSource, Stage};
use crate::Result;
use crate::render::{Background, Camera};
use glam::DVec3;

impl Stage {
    /// Returns the camera.
    pub fn camera_mut(&mut self) -> &mut Camera {
        &mut self.looks.camera
    }

    /// Returns the width and height of the pictures, in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.looks.size
    }

    /// Returns the background of pictures in files.
    pub fn picture_background(&self) -> Background {
        self.looks.background
    }

    /// Sets the size of the pictures.
    pub fn set_size(&mut self, size: [u32; 2]) {
        self.looks.size = size;
        self.cached = None;
    }

    /// Frames the body in its current configuration and the points `also`, unless the scene sets
    /// the camera.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn fit_view(&mut self, also: &[DVec3]) -> Result<()> {
        if self.scene.camera.is_unset() {
            let mut points = self.seen()?;
            points.extend_from_slice(also);
            self.looks.camera = self.scene.camera(self.mesh(), &points, self.looks.size)?;
        }
        Ok(())
    }

    /// Frames the whole body at rest as `frame_all` does, unless the scene sets the camera.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an invalid camera.
    pub(crate) fn frame_all(&mut self) -> Result<()> {
        if self.scene.camera.is_unset() {
            let mut scene = self.scene.clone();
            scene.camera.frame_all = Some(true);
            let mesh = self.mesh();
            self.looks.camera = scene.camera(mesh, &mesh.nodes, self.looks.size)?;
        }
        Ok(())
    }

    /// As [`Stage::fit_view`], with margin for an orbiting camera: see [`Camera::orbited`].
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn fit_orbit(&mut self, also: &[DVec3]) -> Result<()> {
        if !self.scene.camera.is_unset() {
            return Ok(());
        }
        let mut points = self.seen()?;
        points.extend_from_slice(also);
        if let NodeSource::Simulated(motion) = &self.drive {
            points.extend(motion.motion_envelope.iter().flatten());
        }
        let round = turned_round(&points, self.looks.camera.up);
        let mut scene = self.scene.clone();
        scene.camera.frame_all = Some(true);
        let mut camera = scene.camera(self.mesh(), &round, self.looks.size)?;
        // With a legend, too, the camera orbits the centre of the body.
        let (low, high) = crate::mesh::bounds(&round);
        let aside = 0.5 * (low + high) - camera.look_at;
        camera.eye += aside;
        camera.look_at += aside;
        self.looks.camera = camera;
        Ok(())
    }

    /// Returns the positions of the nodes that can be visible.
    fn seen(&self) -> Result<Vec<DVec3>> {
        let positions = self.positions()?;
        // Grids have nodes without tetrahedra, which are never visible and may be anywhere.
        let mut seen = vec![false; positions.len()];
        for v in self.mesh().tets.iter().flatten() {
            seen[*v as usize] = true;
        }
        let seen = positions.iter().zip(&seen).filter(|(_, seen)| **seen);
        Ok(seen.map(|(x, _)| *x).collect())
    }
}

/// Returns points that bound `points` for any rotation about `up` through the centre of their
/// bounds: rings with the radius of the points at each height.
fn turned_round(points: &[DVec3], up: DVec3) -> Vec<DVec3> {
    const RINGS: usize = 48;
    const CORNERS: usize = 24;
    let up = up.normalize_or(DVec3::Z);
    let side = up.any_orthonormal_vector();
    let (low, high) = crate::mesh::bounds(points);
    let middle = 0.5 * (low + high);
    let height = |p: &DVec3| (*p - middle).dot(up);
    let heights = points.iter().map(height);
    let (bottom, top) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| {
        (a.min(h), b.max(h))
    });
    let slice = (top - bottom).max(f64::MIN_POSITIVE) / RINGS as f64;
    let mut wide = [None::<f64>; RINGS];
    for p in points {
        let h = height(p);
        let radius = (*p - middle - h * up).length();
        let ring = &mut wide[(((h - bottom) / slice) as usize).min(RINGS - 1)];
        *ring = Some(ring.map_or(radius, |r| r.max(radius)));
    }
    // A polygon around a circle has a larger circumradius.
    let around = 1.0 / (std::f64::consts::PI / CORNERS as f64).cos();
    let mut round = Vec::new();
    for (i, radius) in wide.iter().enumerate() {
        let Some(radius) = radius else { continue };
        for (end, corner) in (0..2).flat_map(|e| (0..CORNERS).map(move |c| (e, c))) {
            let angle = std::f64::consts::TAU * corner as f64 / CORNERS as f64;
            let out = glam::DQuat::from_axis_angle(up, angle) * side;
            let h = bottom + slice * (i + end) as f64;
            round.push(middle + h * up + around * radius * out);
        }
    }
    round
}
