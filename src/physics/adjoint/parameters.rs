//! Contraction of the adjoint solution with the derivatives by each parameter.

use super::equilibrium::Equilibrium;
use super::quantities::{StateFunction, prepare};
use super::rest_positions::{check_rest_position, rest_position_slope};
use super::slopes::MaterialSlopes;
use crate::physics::cpu::{AdjointSolution, StaticAdjoint};
use crate::physics::model::stiffness_numbers::EdgeShares;
use crate::physics::{ConstitutiveModel, Element, Gradient, Parameter, Quantity};
use crate::{Error, Result};
use std::cell::OnceCell;

/// Numbers that Young's moduli are derived from, made when they are needed.
pub(super) struct ModelNumbers {
    first_tets: Vec<u32>,
    stiffness_numbers: OnceCell<Vec<f64>>,
    edge_shares: OnceCell<EdgeShares>,
}

impl ModelNumbers {
    pub fn new(body: &Equilibrium<'_>) -> ModelNumbers {
        ModelNumbers {
            first_tets: body.first_tets(),
            stiffness_numbers: OnceCell::new(),
            edge_shares: OnceCell::new(),
        }
    }
}

/// The derivatives of one quantity of a body by what acts at one state.
pub(super) struct Sensitivity<'a> {
    pub body: &'a Equilibrium<'a>,
    pub solution: AdjointSolution,
    pub function: Option<Box<dyn StateFunction>>,
    pub slopes: MaterialSlopes,
    numbers: &'a ModelNumbers,
}

/// Returns a quantity of `body` and its derivatives by `parameters`; `adjoint` is the engine's
/// body.
///
/// # Errors
/// [`Error::Input`] for an unknown node, tet, tool or region, or an unstable equilibrium.
pub(super) fn gradient(
    body: &Equilibrium<'_>,
    adjoint: &mut dyn StaticAdjoint,
    quantity: &Quantity,
    parameters: &[Parameter],
) -> Result<Gradient> {
    for parameter in parameters {
        body.check_parameter(parameter)?;
        if let Parameter::InitialPosition { .. } | Parameter::InitialVelocity { .. } = parameter {
            return Err(Error::Input(
                "a body at rest does not depend on where it began; take the gradient of a motion"
                    .into(),
            ));
        }
        let of_motion = match parameter {
            Parameter::ToolFriction { .. } => "friction",
            Parameter::DampingTime | Parameter::MassDamping => "damping",
            _ => continue,
        };
        return Err(Error::Input(format!(
            "{of_motion} has no part in a body at rest; take the gradient of a motion"
        )));
    }
    let (seed, value, function) = prepare(quantity, body)?.into_seed(body);
    let solution = adjoint.adjoint(&seed)?;
    let iterations = solution.iterations;
    let numbers = ModelNumbers::new(body);
    let sensitivity = Sensitivity::new(body, &numbers, solution, function);
    let derivatives = parameters.iter().map(|p| sensitivity.by_parameter(p));
    Ok(Gradient {
        value,
        derivatives: derivatives.collect::<Result<_>>()?,
        imbalance: 0.0,
        iterations,
    })
}

impl Equilibrium<'_> {
    /// Checks that the body depends on a parameter.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown or unsuitable parameter.
    pub fn check_parameter(&self, parameter: &Parameter) -> Result<()> {
        match parameter {
            Parameter::Young { tets } | Parameter::Density { tets } => self.check_tets(tets),
            Parameter::Poisson { tets } => {
                self.check_tets(tets)?;
                self.network.elements().map(|_| ()).ok_or_else(|| {
                    Error::Input(
                        "Poisson's ratio of springs is ¼; use --material neo-hookean (or corotated)"
                            .into(),
                    )
                })
            }
            Parameter::Load { node, .. } => self.check_nodes([*node]),
            Parameter::InitialPosition { node, .. } | Parameter::InitialVelocity { node, .. } => {
                self.check_nodes([*node])?;
                match self.fixed[*node as usize] {
                    false => Ok(()),
                    true => Err(Error::Input(format!(
                        "node {node} is fixed; its position is that of a support"
                    ))),
                }
            }
            Parameter::Gravity { .. } => Ok(()),
            Parameter::Amplitude(id) if id.0 < self.amplitudes.len() => Ok(()),
            Parameter::Amplitude(id) => Err(Error::Input(format!(
                "unknown amplitude {}: this body has no such pressure or muscle",
                id.0
            ))),
            Parameter::ToolPosition { tool, .. } | Parameter::ToolRotation { tool, .. } => {
                self.check_tool(*tool)
            }
            Parameter::ToolFriction { tool } => {
                self.check_tool(*tool)?;
                match self.tools[tool.0].friction > 0.0 {
                    true => Ok(()),
                    false => Err(Error::Input(format!(
                        "tool {} has no friction, so that there is no derivative by it; give it a coefficient above 0",
                        tool.0
                    ))),
                }
            }
            Parameter::MassDamping => Ok(()),
            Parameter::DampingTime => match self.network.damping_time > 0.0 {
                true => Ok(()),
                false => Err(Error::Input(
                    "the body has no stiffness-proportional damping, so that there is no derivative by it; set some ([material] damping_ratio, damping_hz)".into(),
                )),
            },
            Parameter::Support { nodes, .. } => self.check_fixed(nodes),
            Parameter::RestPosition { node, .. } => check_rest_position(self, *node),
        }
    }
}

impl<'a> Sensitivity<'a> {
    /// Creates the derivatives of the quantity whose adjoint is `solution`; `function` is the
    /// quantity itself, unless it is a force.
    pub fn new(
        body: &'a Equilibrium<'a>,
        numbers: &'a ModelNumbers,
        solution: AdjointSolution,
        function: Option<Box<dyn StateFunction>>,
    ) -> Sensitivity<'a> {
        Sensitivity {
            slopes: MaterialSlopes::new(body, &solution, function.as_deref()),
            body,
            numbers,
            solution,
            function,
        }
    }

    /// Returns the derivative by a parameter that [`Equilibrium::check_parameter`] has checked.
    ///
    /// # Errors
    /// [`Error::Input`] for a rest position at which the body has no model.
    pub fn by_parameter(&self, parameter: &Parameter) -> Result<f64> {
        let (body, solution) = (self.body, &self.solution);
        let unit = body.network.length_unit;
        Ok(match parameter {
            Parameter::Young { tets } => self.by_young(tets)?,
            Parameter::Poisson { tets } => self.by_poisson(tets),
            Parameter::Density { tets } => {
                let of_tet = |t: &u32| {
                    let nodes = body.mesh.tets[*t as usize];
                    let sum: f64 = nodes.iter().map(|v| self.slopes.masses[*v as usize]).sum();
                    let volume = body.mesh.tet_volume(*t as usize).abs() * unit.powi(3);
                    0.25 * volume * sum
                };
                tets.iter().map(of_tet).sum()
            }
            Parameter::Load { node, direction } => solution.loads[*node as usize].dot(*direction),
            Parameter::Gravity { direction } => {
                let nodes = body.network.masses.iter().zip(&solution.loads);
                nodes.map(|(m, l)| m * l.dot(*direction)).sum()
            }
            Parameter::Amplitude(id) => solution.amplitudes[id.0],
            Parameter::ToolPosition { tool, direction } => {
                solution.tools[tool.0].translation.dot(*direction) * unit
            }
            Parameter::ToolRotation { tool, axis } => solution.tools[tool.0].rotation.dot(*axis),
            Parameter::ToolFriction { tool } => solution.tools[tool.0].friction,
            Parameter::DampingTime => solution.damping[0],
            Parameter::MassDamping => solution.damping[1],
            Parameter::Support { nodes, direction } => {
                let supports = nodes.iter().map(|v| solution.supports[*v as usize]);
                supports.map(|s| s.dot(*direction)).sum::<f64>() * unit
            }
            Parameter::RestPosition { node, direction } => {
                rest_position_slope(self, *node, *direction)?
            }
            // A motion adds them at its start.
            Parameter::InitialPosition { .. } | Parameter::InitialVelocity { .. } => 0.0,
        })
    }

    /// Returns λ times the forces of each node per mass, without the energy of terms.
    pub fn mass_force_slopes(&self) -> Vec<f64> {
        super::slopes::mass_slopes(self.body, &self.solution, false)
    }

    fn by_young(&self, tets: &[u32]) -> Result<f64> {
        let body = self.body;
        if body.network.elements().is_none() {
            return self.by_spring_stiffness(tets);
        }
        let numbers = match self.numbers.stiffness_numbers.get() {
            Some(numbers) => numbers,
            None => {
                let found = body.network.stiffness_numbers(body.mesh, body.material)?;
                self.numbers.stiffness_numbers.get_or_init(|| found)
            }
        };
        let of_element = |t: usize| {
            let [a, b] = body.network.tets()[t].lame_parameters;
            let [by_a, by_b] = self.slopes.lame[t];
            (by_a * a + by_b * b) / numbers[self.numbers.first_tets[t] as usize]
        };
        Ok(self.elements_in(tets).map(of_element).sum())
    }

    fn by_spring_stiffness(&self, tets: &[u32]) -> Result<f64> {
        let shares = match self.numbers.edge_shares.get() {
            Some(shares) => shares,
            None => {
                let found = self
                    .body
                    .network
                    .edge_shares(self.body.mesh, self.body.material)?;
                self.numbers.edge_shares.get_or_init(|| found)
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

    fn by_poisson(&self, tets: &[u32]) -> f64 {
        let Some(elements) = self.body.network.elements() else {
            return 0.0;
        };
        let of_element = |t: usize| {
            let slope = poisson_slope(&elements.tets[t], elements.law);
            let each = self.slopes.lame[t].iter().zip(slope);
            each.map(|(by, slope)| by * slope).sum::<f64>()
        };
        self.elements_in(tets).map(of_element).sum()
    }

    /// Returns the elements whose material is that of these tets.
    fn elements_in(&self, tets: &[u32]) -> impl Iterator<Item = usize> {
        let is_first = |t: &u32| {
            let element = self.body.element_of_tet[*t as usize]?;
            (self.numbers.first_tets[element] == *t).then_some(element)
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
