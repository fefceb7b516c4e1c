//! Contraction of the adjoint solution with the derivatives by each parameter.

use super::equilibrium::Equilibrium;
use super::quantities::{PreparedQuantity, StateFunction, prepare};
use super::rest_positions::rest_position_slope;
use super::slopes::MaterialSlopes;
use crate::physics::cpu::{AdjointSolution, StaticAdjoint};
use crate::physics::model::stiffness_numbers::EdgeShares;
use crate::physics::{ConstitutiveModel, Element, Gradient, Parameter, Quantity};
use crate::{Error, Result};
use std::cell::OnceCell;

/// The derivatives of one quantity of a body.
pub(super) struct Sensitivity<'a> {
    pub body: &'a Equilibrium<'a>,
    pub solution: AdjointSolution,
    pub function: Option<Box<dyn StateFunction>>,
    pub slopes: MaterialSlopes,
    first_tets: Vec<u32>,
    stiffness_numbers: OnceCell<Vec<f64>>,
    edge_shares: OnceCell<EdgeShares>,
}

/// Returns a quantity of `body` and its derivatives by `parameters`; `adjoint` is the engine's body.
///
/// # Errors
/// [`Error::Input`] for an unknown node, tet, tool or region, or an unstable equilibrium.
pub(super) fn gradient(
    body: &Equilibrium<'_>,
    adjoint: &mut dyn StaticAdjoint,
    quantity: &Quantity,
    parameters: &[Parameter],
) -> Result<Gradient> {
    let (seed, value, function) = match prepare(quantity, body)? {
        PreparedQuantity::Force(seed, value) => (*seed, value, None),
        PreparedQuantity::Function(function) => {
            let seed = crate::physics::cpu::AdjointSeed {
                gradient: function.gradient(body),
                amplitudes: body.amplitudes,
                ..Default::default()
            };
            let value = function.value(body, body.network, &body.x);
            (seed, value, Some(function))
        }
    };
    let solution = adjoint.adjoint(&seed)?;
    let sensitivity = Sensitivity {
        slopes: MaterialSlopes::new(body, &solution, function.as_deref()),
        first_tets: body.first_tets(),
        stiffness_numbers: OnceCell::new(),
        edge_shares: OnceCell::new(),
        body,
        solution,
        function,
    };
    let derivatives = parameters.iter().map(|p| sensitivity.by_parameter(p));
    Ok(Gradient {
        value,
        derivatives: derivatives.collect::<Result<_>>()?,
        imbalance: 0.0,
        iterations: sensitivity.solution.iterations,
    })
}

impl Sensitivity<'_> {
    /// Returns the derivative by a parameter.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown or unsuitable parameter.
    fn by_parameter(&self, parameter: &Parameter) -> Result<f64> {
        let (body, solution) = (self.body, &self.solution);
        let unit = body.network.length_unit;
        match parameter {
            Parameter::Young { tets } => self.by_young(tets),
            Parameter::Poisson { tets } => self.by_poisson(tets),
            Parameter::Density { tets } => {
                body.check_tets(tets)?;
                let of_tet = |t: &u32| {
                    let nodes = body.mesh.tets[*t as usize];
                    let sum: f64 = nodes.iter().map(|v| self.slopes.masses[*v as usize]).sum();
                    let volume = body.mesh.tet_volume(*t as usize).abs() * unit.powi(3);
                    0.25 * volume * sum
                };
                Ok(tets.iter().map(of_tet).sum())
            }
            Parameter::Load { node, direction } => {
                body.check_nodes([*node])?;
                Ok(solution.loads[*node as usize].dot(*direction))
            }
            Parameter::Gravity { direction } => {
                let nodes = body.network.masses.iter().zip(&solution.loads);
                Ok(nodes.map(|(m, l)| m * l.dot(*direction)).sum())
            }
            Parameter::Amplitude(id) => {
                let found = solution.amplitudes.get(id.0).copied();
                found.ok_or_else(|| {
                    Error::Input(format!(
                        "unknown amplitude {}: this body has no such pressure or muscle",
                        id.0
                    ))
                })
            }
            Parameter::ToolPosition { tool, direction } => {
                body.check_tool(*tool)?;
                Ok(solution.tools[tool.0].translation.dot(*direction) * unit)
            }
            Parameter::ToolRotation { tool, axis } => {
                body.check_tool(*tool)?;
                Ok(solution.tools[tool.0].rotation.dot(*axis))
            }
            Parameter::Support { nodes, direction } => {
                body.check_fixed(nodes)?;
                let supports = nodes.iter().map(|v| solution.supports[*v as usize]);
                Ok(supports.map(|s| s.dot(*direction)).sum::<f64>() * unit)
            }
            Parameter::RestPosition { node, direction } => {
                rest_position_slope(self, *node, *direction)
            }
        }
    }

    /// Returns λ times the forces of each node per mass, without the energy of terms.
    pub fn mass_force_slopes(&self) -> Vec<f64> {
        super::slopes::mass_slopes(self.body, &self.solution, false)
    }

    fn by_young(&self, tets: &[u32]) -> Result<f64> {
        let body = self.body;
        body.check_tets(tets)?;
        if self.body.network.elements().is_none() {
            return self.by_spring_stiffness(tets);
        }
        let numbers = match self.stiffness_numbers.get() {
            Some(numbers) => numbers,
            None => {
                let found = body.network.stiffness_numbers(body.mesh, body.material)?;
                self.stiffness_numbers.get_or_init(|| found)
            }
        };
        let of_element = |t: usize| {
            let [a, b] = body.network.tets()[t].lame_parameters;
            let [by_a, by_b] = self.slopes.lame[t];
            (by_a * a + by_b * b) / numbers[self.first_tets[t] as usize]
        };
        Ok(self.elements_in(tets).map(of_element).sum())
    }

    fn by_spring_stiffness(&self, tets: &[u32]) -> Result<f64> {
        let shares = match self.edge_shares.get() {
            Some(shares) => shares,
            None => {
                let found = self
                    .body
                    .network
                    .edge_shares(self.body.mesh, self.body.material)?;
                self.edge_shares.get_or_init(|| found)
            }
        };
        let mut chosen = vec![false; self.body.mesh.tets.len()];
        tets.iter().for_each(|t| chosen[*t as usize] = true);
        let of_edge = |(slope, shares): (&f64, &Vec<(u32, f64)>)| -> f64 {
            let own = shares.iter().filter(|(t, _)| chosen[*t as usize]);
            own.map(|(_, share)| slope * share).sum()
        };
        Ok(self.slopes.edges.iter().zip(shares).map(of_edge).sum())
    }

    fn by_poisson(&self, tets: &[u32]) -> Result<f64> {
        self.body.check_tets(tets)?;
        let Some(elements) = self.body.network.elements() else {
            return Err(Error::Input(
                "Poisson's ratio of springs is ¼; use --material neo-hookean (or corotated)".into(),
            ));
        };
        let of_element = |t: usize| {
            let slope = poisson_slope(&elements.tets[t], elements.law);
            let each = self.slopes.lame[t].iter().zip(slope);
            each.map(|(by, slope)| by * slope).sum::<f64>()
        };
        Ok(self.elements_in(tets).map(of_element).sum())
    }

    /// Returns the elements whose material is that of these tets.
    fn elements_in(&self, tets: &[u32]) -> impl Iterator<Item = usize> {
        let is_first = |t: &u32| {
            let element = self.body.element_of_tet[*t as usize]?;
            (self.first_tets[element] == *t).then_some(element)
        };
        tets.iter().filter_map(is_first)
    }
}

/// Returns the derivatives of the Lamé parameters of an element, as they enter the energy, by
/// Poisson's ratio at constant Young's modulus.
fn poisson_slope(element: &Element, law: ConstitutiveModel) -> [f64; 2] {
    let [mu, lambda] = element.small_strain(law);
    let young = mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu);
    let ratio = 0.5 * lambda / (lambda + mu);
    let by_mu = -0.5 * young / (1.0 + ratio).powi(2);
    let by_lambda =
        young * (1.0 + 2.0 * ratio * ratio) / ((1.0 + ratio) * (1.0 - 2.0 * ratio)).powi(2);
    match law {
        ConstitutiveModel::NeoHookean => [by_mu, by_lambda + by_mu],
        ConstitutiveModel::Corotated => [by_mu, by_lambda],
    }
}
