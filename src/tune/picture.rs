//! Image candidates: size and table.

use super::search::Candidates;
use crate::gpu::Gpu;
use crate::render::Image;
use crate::scene::{OutputEntry, Scene, Stage};
use crate::{Error, Result};
use glam::DVec3;
use std::fmt;

/// Sizes relative to that of the scene.
const SIZES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Table tolerances, in units of 1/255.
const TABLES: [f64; 4] = [4.0, 1.0, 0.25, 0.06];
/// Table tolerance of the reference.
const REFERENCE_TABLE: f64 = 0.01;

/// An image candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PicturePoint {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Tolerance of the table.
    pub accuracy: f64,
}

impl fmt::Display for PicturePoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        let accuracy = 255.0 * self.accuracy;
        write!(
            f,
            "{width} × {height} pixels, table tolerance {accuracy}/255"
        )
    }
}

impl PicturePoint {
    /// Applies the candidate to a scene.
    pub fn apply(&self, scene: &mut Scene) {
        scene.picture.size = Some(self.size);
        scene.picture.accuracy = Some(self.accuracy);
        scene.picture.quality = None;
    }
}

/// Image candidates of a scene, and the reference image.
pub(crate) struct PictureSearch {
    gpu: Gpu,
    scene: Scene,
    there: Option<Vec<DVec3>>,
    truth: Image,
    points: Vec<PicturePoint>,
    /// Stage of the last table tolerance.
    stage: Option<(f64, Stage)>,
}

impl PictureSearch {
    /// Renders the reference image of `scene` with its nodes at `there`, or at rest, with the
    /// finest table.
    ///
    /// # Errors
    /// As [`Stage::new`] and [`Stage::image`].
    pub fn new(gpu: &Gpu, scene: &Scene, there: Option<Vec<DVec3>>) -> Result<PictureSearch> {
        let mut scene = scene.clone();
        // The body is posed, not simulated.
        scene.solver.name = None;
        scene.cage = None;
        scene.grab.clear();
        scene.output = OutputEntry::default();
        let full = scene.picture.size.unwrap_or(crate::scene::DEFAULT_SIZE);
        let shared = |share: f64| full.map(|n| ((share * f64::from(n)).round() as u32).max(1));
        let points = SIZES.iter().flat_map(|share| {
            TABLES.map(|table| PicturePoint {
                size: shared(*share),
                accuracy: table / 255.0,
            })
        });
        let mut pictures = PictureSearch {
            gpu: gpu.clone(),
            scene,
            there,
            truth: Image {
                size: [0; 2],
                channels: 4,
                values: Vec::new(),
            },
            points: points.collect(),
            stage: None,
        };
        pictures.truth = pictures.draw(&PicturePoint {
            size: full,
            accuracy: REFERENCE_TABLE / 255.0,
        })?;
        Ok(pictures)
    }

    fn draw(&mut self, point: &PicturePoint) -> Result<Image> {
        self.stage(point)?.image()
    }

    fn stage(&mut self, point: &PicturePoint) -> Result<&mut Stage> {
        let kept = self.stage.take().filter(|s| s.0 == point.accuracy);
        let mut kept = match kept {
            Some(kept) => kept,
            None => {
                let mut scene = self.scene.clone();
                scene.picture.accuracy = Some(point.accuracy);
                let mut stage = Stage::new(&self.gpu, &scene)?;
                if let Some(there) = &self.there {
                    stage.set_positions(there)?;
                }
                (point.accuracy, stage)
            }
        };
        kept.1.set_size(point.size);
        Ok(&mut self.stage.insert(kept).1)
    }
}

impl Candidates for PictureSearch {
    type Point = PicturePoint;

    fn points(&self) -> Vec<PicturePoint> {
        let mut points = self.points.clone();
        // Groups candidates with the same table, because each table has its own stage.
        points.sort_by(|a, b| b.accuracy.total_cmp(&a.accuracy));
        points
    }

    fn cost(&mut self, point: &PicturePoint) -> Result<f64> {
        self.stage(point)?.frame_ms(2)
    }

    fn error(&mut self, point: &PicturePoint, _enough: f64) -> Result<f64> {
        let image = self.draw(point)?;
        let enlarged = enlarged(&image, self.truth.size);
        if enlarged.len() != self.truth.values.len() {
            return Err(Error::Input(
                "tuning needs images in mode composite; set mode = \"composite\"".into(),
            ));
        }
        let both = enlarged.iter().zip(&self.truth.values);
        let sum: f64 = both.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        Ok((sum / enlarged.len().max(1) as f64).sqrt())
    }
}

/// Returns the values of an image enlarged by bilinear interpolation.
fn enlarged(image: &Image, size: [u32; 2]) -> Vec<f32> {
    if image.size == size {
        return image.values.clone();
    }
    let [width, height] = image.size.map(|n| n as usize);
    let channels = image.values.len() / (width * height).max(1);
    let place = |i: u32, to: u32, from: usize| {
        let at = (f64::from(i) + 0.5) * from as f64 / f64::from(to) - 0.5;
        let at = at.clamp(0.0, from as f64 - 1.0);
        let low = (at.floor() as usize).min(from.saturating_sub(2));
        (low, (low + 1).min(from - 1), (at - low as f64) as f32)
    };
    let mut values = Vec::with_capacity(size[0] as usize * size[1] as usize * channels);
    for y in 0..size[1] {
        let (above, below, down) = place(y, size[1], height);
        for x in 0..size[0] {
            let (left, right, across) = place(x, size[0], width);
            for c in 0..channels {
                let at = |x: usize, y: usize| image.values[(x + width * y) * channels + c];
                let row = |y: usize| at(left, y) + across * (at(right, y) - at(left, y));
                values.push(row(above) + down * (row(below) - row(above)));
            }
        }
    }
    values
}
