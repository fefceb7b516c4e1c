//! X-rays: how strongly what CT numbers stand for attenuates them.
//!
//! What reaches the film behind a body is I = I₀ exp(−∫ μ dl) (Beer and Lambert); a picture holds
//! ∫ μ dl. A body that is squeezed is denser by as much as it is smaller: μ is that of the body at
//! rest over J, so that it attenuates as much in all however it is bent.
//!
//! Mass attenuation coefficients are those of J. H. Hubbell and S. M. Seltzer, Tables of X-Ray Mass
//! Attenuation Coefficients (NISTIR 5632; <https://physics.nist.gov/xaamdi>): liquid water of 1 g/cm³,
//! and cortical bone after ICRU 44 of 1.92 g/cm³, interpolated between logarithms.

use crate::{Error, Result};

/// keV; cm²/g of water; cm²/g of cortical bone.
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
/// g/cm³ of cortical bone.
const BONE_DENSITY: f64 = 1.92;
/// What scanners' CT numbers are made at, keV: the effective energy of 120 kV.
const CT_EFFECTIVE_ENERGY_KEV: f64 = 70.0;

/// An X-ray source, and what the numbers of a picture's scalar stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Xray {
    /// Energy of the source, 20 to 150 keV.
    pub energy: f64,
    /// The scalar of water: 0 in Hounsfield's units.
    pub water: f64,
    /// The scalar of air, below that of water: −1000 in Hounsfield's units.
    pub air: f64,
    /// Centimetres in a unit of the mesh.
    pub cm_per_unit: f64,
}

impl Default for Xray {
    /// 60 keV, Hounsfield's units, a mesh in millimetres.
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
    /// Whether numbers make sense.
    pub(super) fn check(&self) -> Result<()> {
        let wrong = |what: String| Err(Error::Input(what));
        let [low, high] = [COEFFICIENTS[0][0], COEFFICIENTS[COEFFICIENTS.len() - 1][0]];
        if !(low..=high).contains(&self.energy) {
            return wrong(format!(
                "X-rays of {} keV: choose from {low} to {high}",
                self.energy
            ));
        }
        if !(self.water.is_finite() && self.air.is_finite() && self.air < self.water) {
            return wrong(format!(
                "water at {} and air at {} make no sense as CT numbers: air is below water",
                self.water, self.air
            ));
        }
        if !(self.cm_per_unit.is_finite() && self.cm_per_unit > 0.0) {
            return wrong(format!(
                "a unit of the mesh of {} cm makes no sense",
                self.cm_per_unit
            ));
        }
        Ok(())
    }

    /// What attenuates where the scalar has a value, per unit of the mesh, at rest: none up to air,
    /// linear from there to water and beyond it. Beyond water what is denser is taken for bone, whose
    /// share follows from its CT number at the energy that scanners have.
    pub fn attenuation(&self, value: f64) -> f64 {
        let [water, rise] = self.slopes();
        let beyond = (value - self.water) / (self.water - self.air);
        water * self.cm_per_unit * (1.0 + beyond * if beyond > 0.0 { rise } else { 1.0 }).max(0.0)
    }

    /// Attenuation of water, per cm, and how much steeper it rises beyond water than up to it.
    fn slopes(&self) -> [f64; 2] {
        let beyond = |energy: f64| {
            let [water, bone] = coefficients(energy);
            bone / water - 1.0
        };
        let [water, _] = coefficients(self.energy);
        [water, beyond(self.energy) / beyond(CT_EFFECTIVE_ENERGY_KEV)]
    }

    /// As `lib/xray.wgsl` reads it, scalars being shares of a range.
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

/// Attenuation of water and of bone, per cm.
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
    fn water_air_and_bone_attenuate_as_the_tables_say() {
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
        // Cortical bone has this number at 70 keV, and attenuates as itself at every energy.
        let [water, bone] = coefficients(CT_EFFECTIVE_ENERGY_KEV);
        let number = 1000.0 * (bone / water - 1.0);
        assert!((1000.0..2000.0).contains(&number), "{number}");
        for [energy, _, of_bone] in COEFFICIENTS {
            let found = at(energy).attenuation(number);
            approx::assert_relative_eq!(found, BONE_DENSITY * of_bone, max_relative = 1e-9);
        }
        // Between rows as well, and above all falling.
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
