//! A ball in the body with another stiffness, smooth in its position and size.

use super::unknown::{Kind, ScaledUnknown};
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::{Error, Result};
use glam::DVec3;

/// Name of the field of stiffness factors.
pub(super) const FACTOR_FIELD: &str = "lump_stiffness";

/// A ball, in file units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lump {
    pub middle: DVec3,
    pub diameter: f64,
    pub contrast: f64,
}

/// The elements of a mesh, as far as a lump concerns them.
pub(super) struct LumpElements {
    /// Tets of each element: one, or the eight pieces of a quadratic tet.
    pieces: usize,
    middles: Vec<DVec3>,
    /// Edge lengths of regular tets of their volumes.
    sizes: Vec<f64>,
    /// Factors of the scene itself.
    own: Vec<f64>,
}

/// The derivative of the stiffness factor of an element by the middle, the diameter and the contrast.
pub(super) struct FactorSlope {
    pub by_middle: DVec3,
    pub by_diameter: f64,
    pub by_contrast: f64,
}

impl Lump {
    /// Returns the lump of the values of `unknowns`; `None` if it is not among them.
    pub fn of(
        unknowns: &[ScaledUnknown],
        values: &[f64],
        (low, high): (DVec3, DVec3),
    ) -> Option<Lump> {
        let mut found = None;
        for (unknown, value) in unknowns.iter().zip(values) {
            let lump = found.get_or_insert(Lump {
                middle: 0.5 * (low + high),
                diameter: 0.1 * (high - low).max_element(),
                contrast: 1.0,
            });
            match unknown.kind {
                Kind::LumpPosition(k) => lump.middle[k] = *value,
                Kind::LumpDiameter => lump.diameter = *value,
                Kind::LumpContrast => lump.contrast = *value,
                _ => {}
            }
        }
        found.filter(|_| unknowns.iter().any(|unknown| unknown.kind.is_lump()))
    }
}

impl LumpElements {
    /// Prepares the elements of `mesh`, whose stiffness a `field` of the scene may multiply.
    ///
    /// # Errors
    /// [`Error::Input`] for a field that does not exist.
    pub fn new(mesh: &TetMesh, field: Option<&str>) -> Result<LumpElements> {
        let pieces = match mesh.order {
            ElementOrder::Linear => 1,
            ElementOrder::Quadratic => 8,
        };
        let count = mesh.tets.len() / pieces;
        let mut middles = Vec::with_capacity(count);
        let mut sizes = Vec::with_capacity(count);
        for group in mesh.tets.chunks(pieces) {
            let corners = group.iter().flatten().map(|v| mesh.nodes[*v as usize]);
            middles.push(corners.sum::<DVec3>() / (4 * pieces) as f64);
        }
        for element in 0..count {
            let tets = pieces * element..pieces * (element + 1);
            let volume: f64 = tets.map(|t| mesh.tet_volume(t).abs()).sum();
            sizes.push((6.0 * std::f64::consts::SQRT_2 * volume).cbrt());
        }
        Ok(LumpElements {
            own: own_factors(mesh, field)?,
            pieces,
            middles,
            sizes,
        })
    }

    /// Middles of the elements, in file units.
    pub fn middles(&self) -> &[DVec3] {
        &self.middles
    }

    /// The factor of the scene for each tet, and the number of tets of an element.
    pub fn own_factors(&self) -> (&[f64], usize) {
        (&self.own, self.pieces)
    }

    /// Returns the share of an element within the lump, about: 1 more than half an edge inside of its
    /// surface, 0 as far outside, linear between.
    fn share(&self, element: usize, lump: &Lump) -> f64 {
        let outside = self.middles[element].distance(lump.middle) - 0.5 * lump.diameter;
        (0.5 - outside / self.sizes[element]).clamp(0.0, 1.0)
    }

    /// Returns the field of stiffness factors of all tets.
    pub fn field(&self, lump: &Lump) -> Field {
        let factor = |t: usize| {
            let share = self.share(t / self.pieces, lump);
            self.own[t] * (1.0 + (lump.contrast - 1.0) * share)
        };
        let values = (0..self.own.len()).map(factor).collect();
        Field::scalar(FACTOR_FIELD, Location::Cell, values)
    }

    /// Returns the elements that a ball reaches, with their shares within it.
    pub fn shares(&self, ball: &Lump) -> Vec<(usize, f64)> {
        let all = 0..self.middles.len();
        let shares = all.map(|element| (element, self.share(element, ball)));
        shares.filter(|(_, share)| *share > 0.0).collect()
    }

    /// Returns the tets of each element.
    pub fn tets(&self) -> Vec<Vec<u32>> {
        let of = |e: usize| (self.pieces * e..self.pieces * (e + 1)).map(|t| t as u32);
        (0..self.middles.len()).map(|e| of(e).collect()).collect()
    }

    /// Returns at most `count` middles of elements, from all over the body.
    pub fn spread_middles(&self, count: usize) -> Vec<DVec3> {
        let every = self.middles.len().div_ceil(count.max(1)).max(1);
        self.middles.iter().step_by(every).copied().collect()
    }

    /// Returns the tets of the elements that the lump reaches, and the slopes of their factors over the
    /// factors: d ln f.
    pub fn slopes(&self, lump: &Lump) -> Vec<(Vec<u32>, FactorSlope)> {
        let reached = (0..self.middles.len()).filter_map(|element| {
            let share = self.share(element, lump);
            if share <= 0.0 {
                return None;
            }
            let factor = 1.0 + (lump.contrast - 1.0) * share;
            // Of the share by the distance of the surface.
            let edge = match share < 1.0 {
                true => (lump.contrast - 1.0) / self.sizes[element] / factor,
                false => 0.0,
            };
            let away = (self.middles[element] - lump.middle).normalize_or_zero();
            let tets = self.pieces * element..self.pieces * (element + 1);
            let slope = FactorSlope {
                by_middle: edge * away,
                by_diameter: 0.5 * edge,
                by_contrast: share / factor,
            };
            Some((tets.map(|t| t as u32).collect(), slope))
        });
        reached.collect()
    }
}

/// Returns the stiffness factor of each tet by a field of cells or nodes; 1 without one.
fn own_factors(mesh: &TetMesh, field: Option<&str>) -> Result<Vec<f64>> {
    let Some(name) = field else {
        return Ok(vec![1.0; mesh.tets.len()]);
    };
    if let Some(field) = mesh.field(name, Location::Cell) {
        return Ok(field.values.clone());
    }
    let field = mesh.field(name, Location::Node).ok_or_else(|| {
        Error::Input(format!(
            "the mesh has no field \"{name}\" ([material] stiffness_field)"
        ))
    })?;
    let mean = |tet: &[u32; 4]| tet.iter().map(|v| field.values[*v as usize]).sum::<f64>() / 4.0;
    Ok(mesh.tets.iter().map(mean).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::generate;

    /// Slopes of factors are those of differences.
    #[test]
    fn slopes_match_differences() {
        let mesh = generate::bar_of_about(900, DVec3::new(0.3, 0.1, 0.1)).unwrap();
        let elements = LumpElements::new(&mesh, None).unwrap();
        let lump = Lump {
            middle: DVec3::new(0.151, 0.052, 0.047),
            diameter: 0.07,
            contrast: 4.0,
        };
        let factors = |lump: Lump| elements.field(&lump).values;
        let middle = factors(lump);
        let h = 1e-7;
        let difference = |change: &dyn Fn(&mut Lump, f64)| -> Vec<f64> {
            let [mut up, mut down] = [lump; 2];
            change(&mut up, h);
            change(&mut down, -h);
            let pairs = factors(up).into_iter().zip(factors(down));
            pairs
                .zip(&middle)
                .map(|((u, d), f)| (u - d) / (2.0 * h) / f)
                .collect()
        };
        let by_x = difference(&|lump, h| lump.middle.x += h);
        let by_diameter = difference(&|lump, h| lump.diameter += h);
        let by_contrast = difference(&|lump, h| lump.contrast += h);
        let slopes = elements.slopes(&lump);
        assert!(slopes.len() > 20, "{}", slopes.len());
        for (tets, slope) in slopes {
            let t = tets[0] as usize;
            for (found, wanted) in [
                (slope.by_middle.x, by_x[t]),
                (slope.by_diameter, by_diameter[t]),
                (slope.by_contrast, by_contrast[t]),
            ] {
                assert!(
                    (found - wanted).abs() < 1e-5 * (1.0 + wanted.abs()),
                    "{found} {wanted}"
                );
            }
        }
    }
}
