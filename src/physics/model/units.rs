//! Local units of a body's arrays, chosen so that models of any size avoid f32 overflow.

use super::discrete_model::DiscreteModel;
use super::elements::Element;

/// Local units: the body's extent, its mean nodal mass, and 1/ω of a mean mass on a spring
/// with the mean stiffness of the edges (or of the elements if there are no edges).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalUnits {
    /// Metres per unit of length.
    pub length: f64,
    /// Kilograms per unit of mass.
    pub mass: f64,
    /// Seconds per unit of time.
    pub time: f64,
}

impl LocalUnits {
    /// The units derived from `model`.
    pub fn from_model(model: &DiscreteModel) -> LocalUnits {
        let mass = mean(model.masses.iter().copied());
        // Young's modulus lies between 2 μ and 3 μ; the edge of a regular tet is 2.04 ∛V.
        let of_element = |e: &Element| 5.0 * e.lame_parameters[0] * e.volume.cbrt();
        let stiffness = mean(model.edges.iter().map(|e| e.stiffness))
            .or_else(|| mean(model.tets().iter().map(of_element)));
        let time = match (mass, stiffness) {
            (Some(m), Some(k)) => (m / k).sqrt(),
            _ => 1.0,
        };
        LocalUnits {
            length: model.frame.scale * model.length_unit,
            mass: mass.unwrap_or(1.0),
            time: if time.is_normal() { time } else { 1.0 },
        }
    }

    /// Unit of stiffness, N/m.
    pub fn stiffness(&self) -> f64 {
        self.mass / (self.time * self.time)
    }

    /// Unit of damping, N·s/m.
    pub fn damping(&self) -> f64 {
        self.mass / self.time
    }

    /// Unit of force, N.
    pub fn force(&self) -> f64 {
        self.stiffness() * self.length
    }

    /// Unit of acceleration, m/s².
    pub fn acceleration(&self) -> f64 {
        self.length / (self.time * self.time)
    }

    /// Unit of velocity, m/s.
    pub fn velocity(&self) -> f64 {
        self.length / self.time
    }

    /// Unit of energy, J.
    pub fn energy(&self) -> f64 {
        self.force() * self.length
    }
}

/// The mean of the positive values; `None` if there are none.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values
        .filter(|v| *v > 0.0)
        .fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}
