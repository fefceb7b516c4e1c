//! The units of a body's arrays on the GPU, chosen so that no size of model overflows f32.

use super::discrete_model::DiscreteModel;
use super::elements::Element;

/// Local units: the body's extent, its mean nodal mass, and the time in which a mean mass on a
/// mean spring, or the mean element where there are no springs, turns by one radian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalUnits {
    /// Metres.
    pub length: f64,
    /// Kilograms.
    pub mass: f64,
    /// Seconds.
    pub time: f64,
}

impl LocalUnits {
    /// The units that suit `network`.
    pub fn from_model(network: &DiscreteModel) -> LocalUnits {
        let mass = mean(network.masses.iter().copied());
        // Young's modulus lies between 2 μ and 3 μ, the edge of a regular tet is 2.04 ∛V.
        let of_element = |e: &Element| 5.0 * e.lame_parameters[0] * e.volume.cbrt();
        let stiffness = mean(network.springs.iter().map(|s| s.stiffness))
            .or_else(|| mean(network.elements.tets.iter().map(of_element)));
        let time = match (mass, stiffness) {
            (Some(m), Some(k)) => (m / k).sqrt(),
            _ => 1.0,
        };
        LocalUnits {
            length: network.frame.scale * network.length_unit,
            mass: mass.unwrap_or(1.0),
            time: if time.is_normal() { time } else { 1.0 },
        }
    }

    /// N/m.
    pub fn stiffness(&self) -> f64 {
        self.mass / (self.time * self.time)
    }

    /// N·s/m.
    pub fn damping(&self) -> f64 {
        self.mass / self.time
    }

    /// N.
    pub fn force(&self) -> f64 {
        self.stiffness() * self.length
    }

    /// m/s².
    pub fn acceleration(&self) -> f64 {
        self.length / (self.time * self.time)
    }

    /// m/s.
    pub fn velocity(&self) -> f64 {
        self.length / self.time
    }

    /// J.
    pub fn energy(&self) -> f64 {
        self.force() * self.length
    }
}

/// The mean of the positive values, if there are any.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values
        .filter(|v| *v > 0.0)
        .fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}
