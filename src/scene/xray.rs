//! X-ray pictures of a scene: what its numbers stand for, and the film.

use super::{Scene, Unit, XrayEntry};
use crate::mesh::TetMesh;
use crate::render::{Image, Xray};
use crate::{Error, Result};

/// Where CT numbers are offset so that none is negative, water is here and air at 1000 below it.
const OFFSET: f64 = 1024.0;
/// A scan whose values begin below this has Hounsfield's units.
const AIRY: f64 = -200.0;

impl Scene {
    /// The source of X-rays, and what the numbers that are seen stand for, which lie in `range`.
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
                "nothing says what a unit of the mesh is: X-rays take it for a millimetre (--unit)"
                    .into(),
            );
        }
        let (water, air) = match (water, air) {
            (None, None) if range.0 > AIRY => {
                notes.push(format!(
                    "values begin at {}, so they are taken for CT numbers with water at {OFFSET} and air at {}; [xray] water and air say otherwise",
                    range.0,
                    OFFSET - 1000.0
                ));
                (OFFSET, OFFSET - 1000.0)
            }
            (water, air) => {
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

/// The film that pictures of a stage are on: what attenuates so much is white, the same in all of
/// them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RadiographFilm {
    white: Option<f32>,
}

impl RadiographFilm {
    pub fn new(entry: &XrayEntry) -> Result<RadiographFilm> {
        match entry.white {
            Some(white) if !(white > 0.0 && white.is_finite()) => Err(Error::Input(format!(
                "[xray] white = {white}: the ∫ μ dl that is white on the film, a positive number, is expected"
            ))),
            white => Ok(RadiographFilm {
                white: white.map(|w| w as f32),
            }),
        }
    }

    /// `image`, which holds ∫ μ dl, as the film shows it, and what is white: where nothing says,
    /// the most there is in the first picture.
    pub fn develop(&mut self, image: &Image) -> (Image, f32) {
        let most = || image.values.iter().copied().fold(0.0, f32::max);
        let white = *self.white.get_or_insert_with(most);
        (image.in_grey(white), white)
    }
}
