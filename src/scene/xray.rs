//! X-ray pictures of a scene: calibration of the scalars, and the film.

use super::{Scene, Unit, XrayEntry};
use crate::mesh::TetMesh;
use crate::render::{Image, Xray};
use crate::{Error, Result};

/// Scalar of water for CT numbers offset to be non-negative; air is 1000 below it.
const OFFSET: f64 = 1024.0;
/// Non-negative CT numbers that reach this value are taken to be offset.
const REACHED: f64 = 1000.0;

impl Scene {
    /// Returns the X-ray source and the calibration of the displayed scalars, whose range is
    /// `range`.
    pub(super) fn xray(
        &self,
        mesh: &TetMesh,
        range: (f64, f64),
        notes: &mut Vec<String>,
    ) -> Result<Xray> {
        let XrayEntry {
            energy, water, air, ..
        } = self.xray;
        let usual = Xray::default();
        let unit = self.mesh.unit.as_ref().map(Unit::metres).transpose()?;
        let unit = unit.or(mesh.length_unit);
        if unit.is_none() {
            notes.push(
                "length unit of the mesh for X-rays: mm (assumed); override with --unit".into(),
            );
        }
        let (water, air) = match (water, air) {
            (None, None) if range.0 >= 0.0 && range.1 >= REACHED => {
                notes.push(format!(
                    "values begin at {}, so they are interpreted as CT numbers with water at {OFFSET} and air at {}; override with [xray] water and air",
                    range.0,
                    OFFSET - 1000.0
                ));
                (OFFSET, OFFSET - 1000.0)
            }
            (water, air) => {
                if range.0 >= 0.0 && (water, air) == (None, None) {
                    notes.push(format!(
                        "values from {} to {} are interpreted as Hounsfield units, 0 for water and -1000 for air; override with [xray] water and air",
                        range.0, range.1
                    ));
                }
                let water = water.unwrap_or(usual.water);
                (water, air.unwrap_or(water - 1000.0))
            }
        };
        Ok(Xray {
            energy: energy.unwrap_or(usual.energy),
            water,
            air,
            cm_per_unit: 100.0 * unit.unwrap_or(1e-3),
        })
    }
}

/// Film of the pictures of a stage: the attenuation shown as white, common to all of them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RadiographFilm {
    white: Option<f32>,
}

impl RadiographFilm {
    pub fn new(entry: &XrayEntry) -> Result<RadiographFilm> {
        match entry.white_level {
            Some(white) if !(white > 0.0 && white.is_finite()) => Err(Error::Input(format!(
                "[xray] white_level (∫ μ dl shown as white on the film) must be positive, got {white}"
            ))),
            white => Ok(RadiographFilm {
                white: white.map(|w| w as f32),
            }),
        }
    }

    /// Returns `image`, which contains ∫ μ dl, as a film picture, and the value shown as white: by
    /// default the largest value of the first picture that is not empty.
    pub fn develop(&mut self, image: &Image) -> (Image, f32) {
        let most = || image.values.iter().copied().fold(0.0, f32::max);
        let white = self.white.unwrap_or_else(most);
        // An empty picture does not set the white value.
        self.white = Some(white).filter(|white| *white > 0.0);
        (image.to_grey(white), white)
    }
}
