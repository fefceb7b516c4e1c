//! The finger of a press picture.

use super::super::finger::Finger;
use super::raster::{Kind, Raster, Surfel};
use super::view::View;
use glam::DVec3;

/// Draws a finger.
pub(super) fn draw_finger(finger: &Finger, raster: &mut Raster, view: &View) {
    for corners in Finger::quads() {
        for [i, j, k] in [[0, 1, 2], [0, 2, 3]] {
            let of = [corners[i], corners[j], corners[k]];
            let x = of.map(|place| finger.point(place));
            let normals = of.map(|place| finger.normal(place));
            raster.triangle(view, x, |w| {
                let mean = |f: &dyn Fn(usize) -> f64| -> f64 { (0..3).map(|c| w[c] * f(c)).sum() };
                let (nail, colour) = Finger::look([mean(&|c| of[c][0]), mean(&|c| of[c][1])]);
                let normal = (0..3).map(|c| w[c] * normals[c]).sum::<DVec3>();
                Some(Surfel {
                    kind: if nail { Kind::Nail } else { Kind::Finger },
                    colour,
                    normal: normal.normalize_or(finger.along),
                })
            });
        }
    }
}
