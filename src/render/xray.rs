//! X-ray attenuation from CT numbers.
//!
//! The intensity behind a body is I = I₀ exp(−∫ μ dl) (Beer-Lambert law); an image contains ∫ μ dl.
//! Deformation conserves mass: μ is the value at rest divided by J, so that the total attenuation
//! does not depend on the deformation.
//!
//! Mass attenuation coefficients are from J. H. Hubbell and S. M. Seltzer, Tables of X-Ray Mass
//! Attenuation Coefficients (NISTIR 5632; <https://physics.nist.gov/xaamdi>): liquid water of 1
//! g/cm³, and cortical bone (ICRU 44) of 1.92 g/cm³, with log-log interpolation.

use crate::{Error, Result};

/// Energy in keV; mass attenuation in cm²/g of water and of cortical bone.
const COEFFICIENTS: [[f64; 3]; 8] = [
    [20.0, 0.8096, 4.001],
    [30.0, 0.3756, 1.331],
    [40.0, 0.2683, 0.6655],
    [50.0, 0.2269, 0.4242],
    [60.0, 0.2059, 0.3148],
    [80.0, 0.1837, 0.2229],
    [100.0, 0.1707, 0.1855],
    [150.0, 0.1505, 0.1480],
];
/// Density of cortical bone, in g/cm³.
const BONE_DENSITY: f64 = 1.92;
/// Energy to which CT numbers refer, in keV: the effective energy at 120 kV.
const CT_EFFECTIVE_ENERGY_KEV: f64 = 70.0;

/// X-ray source, and calibration of the displayed scalar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Xray {
    /// Photon energy of the source, 20 to 150 keV.
    pub energy: f64,
    /// Scalar of water: 0 HU.
    pub water: f64,
    /// Scalar of air, below that of water: −1000 HU.
    pub air: f64,
    /// Centimetres per mesh unit.
    pub cm_per_unit: f64,
}

impl Default for Xray {
    /// 60 keV, Hounsfield units, a mesh in millimetres.
    fn default() -> Xray {
        Xray {
            energy: 60.0,
            water: 0.0,
            air: -1000.0,
            cm_per_unit: 0.1,
        }
    }
}

impl Xray {
    /// Validates the parameters.
    pub(super) fn check(&self) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(what));
        let [low, high] = [COEFFICIENTS[0][0], COEFFICIENTS[COEFFICIENTS.len() - 1][0]];
        if !(low..=high).contains(&self.energy) {
            return wrong(format!(
                "X-ray energy must be {low} to {high} keV, got {}",
                self.energy
            ));
        }
        if !(self.water.is_finite() && self.air.is_finite() && self.air < self.water) {
            return wrong(format!(
                "CT numbers of water and air must be finite, and air below water, got {} and {}",
                self.water, self.air
            ));
        }
        if !(self.cm_per_unit.is_finite() && self.cm_per_unit > 0.0) {
            return wrong(format!(
                "mesh unit must be positive and finite, got {} cm",
                self.cm_per_unit
            ));
        }
        Ok(())
    }

    /// Returns the attenuation at rest for a scalar value, per mesh unit: 0 up to air, then linear
    /// to water and from there with another slope. Values above water are mixtures with bone, whose
    /// fraction follows from the CT number at the effective energy of scanners.
    pub fn attenuation(&self, value: f64) -> f64 {
        let [water, rise] = self.slopes();
        let beyond = (value - self.water) / (self.water - self.air);
        water * self.cm_per_unit * (1.0 + beyond * if beyond > 0.0 { rise } else { 1.0 }).max(0.0)
    }

    /// Returns the attenuation of water, per cm, and the ratio of the slope above water to that
    /// below.
    fn slopes(&self) -> [f64; 2] {
        let beyond = |energy: f64| {
            let [water, bone] = coefficients(energy);
            bone / water - 1.0
        };
        let [water, _] = coefficients(self.energy);
        [water, beyond(self.energy) / beyond(CT_EFFECTIVE_ENERGY_KEV)]
    }

    /// Returns the layout of `lib/xray.wgsl`, for scalars normalised to a range.
    pub(super) fn to_gpu(self, (low, high): (f64, f64)) -> [f32; 4] {
        let share = |value: f64| (value - low) / (high - low);
        let [water, rise] = self.slopes();
        [
            share(self.air) as f32,
            share(self.water) as f32,
            (water * self.cm_per_unit) as f32,
            rise as f32,
        ]
    }
}

/// Returns the attenuation of water and of bone, per cm.
fn coefficients(energy: f64) -> [f64; 2] {
    let after = COEFFICIENTS.partition_point(|row| row[0] <= energy);
    let after = after.clamp(1, COEFFICIENTS.len() - 1);
    let [a, b] = [COEFFICIENTS[after - 1], COEFFICIENTS[after]];
    let w = (energy / a[0]).ln() / (b[0] / a[0]).ln();
    let between = |k: usize| (a[k].ln() + w * (b[k] / a[k]).ln()).exp();
    [between(1), BONE_DENSITY * between(2)]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn attenuation_matches_nist_tables() {
        let at = |energy| Xray {
            energy,
            cm_per_unit: 1.0,
            ..Xray::default()
        };
        approx::assert_relative_eq!(at(60.0).attenuation(0.0), 0.2059, max_relative = 1e-12);
        approx::assert_relative_eq!(at(80.0).attenuation(0.0), 0.1837, max_relative = 1e-12);
        assert_eq!(at(60.0).attenuation(-1000.0), 0.0);
        assert_eq!(at(60.0).attenuation(-3000.0), 0.0);
        approx::assert_relative_eq!(at(60.0).attenuation(-500.0), 0.10295, max_relative = 1e-12);
        // Cortical bone has this number at 70 keV, and its own attenuation at every energy.
        let [water, bone] = coefficients(CT_EFFECTIVE_ENERGY_KEV);
        let number = 1000.0 * (bone / water - 1.0);
        assert!((1000.0..2000.0).contains(&number), "{number}");
        for [energy, _, of_bone] in COEFFICIENTS {
            let found = at(energy).attenuation(number);
            approx::assert_relative_eq!(found, BONE_DENSITY * of_bone, max_relative = 1e-9);
        }
        // Also between rows, and decreasing with energy.
        let falling = (20..150).map(|e| at(f64::from(e)).attenuation(400.0));
        assert!(falling.collect::<Vec<_>>().windows(2).all(|p| p[1] < p[0]));
        for wrong in [
            at(10.0),
            Xray {
                air: 5.0,
                ..at(60.0)
            },
            Xray {
                cm_per_unit: 0.0,
                ..at(60.0)
            },
        ] {
            wrong.check().unwrap_err();
        }
    }
}
