//! How the unknowns depend on parameters of the engine.

use super::forward::MeasuredBody;
use super::lump::FactorSlope;
use super::unknown::Kind;
use crate::physics::{AmplitudeId, Parameter, Simulator};
use crate::{Error, Result};
use glam::DVec3;

/// By what forces have derivatives.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum DerivedBy {
    Nothing,
    Unknowns,
    /// Also by the logarithm of the stiffness of each element.
    UnknownsAndElements,
}

/// One number's parameters: which of the engine's parameters it takes, with factors.
pub(super) struct Chain {
    pub parameters: Vec<Parameter>,
    /// For each unknown, numbers of parameters with factors.
    pub terms: Vec<Vec<(usize, f64)>>,
}

impl MeasuredBody<'_> {
    /// Returns how the unknowns depend on parameters of the engine.
    pub(super) fn chain(
        &self,
        (values, by): (&[f64], DerivedBy),
        simulator: &dyn Simulator,
    ) -> Result<Chain> {
        let by_elements = by == DerivedBy::UnknownsAndElements;
        let mut chain = Chain {
            parameters: Vec::new(),
            terms: vec![Vec::new(); self.unknowns.len()],
        };
        for (k, unknown) in self.unknowns.iter().enumerate() {
            let Some(parameter) = parameter_of(&unknown.kind, &self.tets[k]) else {
                continue;
            };
            chain.terms[k].push((chain.parameters.len(), 1.0));
            chain.parameters.push(parameter);
        }
        let lump = self.lump_of(values);
        if lump.is_none() && self.grid.is_none() && !by_elements {
            return Ok(chain);
        }
        let elements = simulator.model().and_then(|model| model.elements());
        let elements = elements.ok_or_else(|| {
            Error::Input(
                "a lump or a stiffness that varies needs finite elements; remove `stiffness` and `damping` of springs".into(),
            )
        })?;
        let numbers = elements.of_tets(simulator.mesh());
        let grid = self.grid.as_ref();
        let factors = match (lump, grid) {
            (Some(lump), _) => Some(self.lump.field(&lump).values),
            (None, Some(_)) => self.grid_field(values).map(|field| field.values),
            (None, None) => None,
        };
        // Young's modulus of an element without the field: the derivative by a parameter is by that.
        let of_tissue = |tets: &[u32]| {
            let tet = *tets.first()? as usize;
            let [mu, lambda] = elements.tets[numbers[tet]?].small_strain(elements.law);
            let young = mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu);
            Some(young / factors.as_ref().map_or(1.0, |factors| factors[tet]))
        };
        for (tets, slope) in lump.map(|lump| self.lump.slopes(&lump)).unwrap_or_default() {
            let Some(young) = of_tissue(&tets) else {
                continue;
            };
            for (k, unknown) in self.unknowns.iter().enumerate() {
                let by = slope.by(&unknown.kind);
                if by != 0.0 {
                    chain.terms[k].push((chain.parameters.len(), young * by));
                }
            }
            chain.parameters.push(Parameter::Young { tets });
        }
        if by_elements || grid.is_some() {
            let elements = self.lump.tets().into_iter().enumerate();
            for (element, tets) in elements {
                // Rigid elements have no stiffness.
                let term = of_tissue(&tets).map(|young| (chain.parameters.len(), young));
                if let Some((grid, (parameter, young))) = grid.zip(term) {
                    for (node, weight) in grid.weights_of(element) {
                        let k = self.grid_nodes.start + node;
                        // By the factor itself, not its logarithm.
                        let by = young * weight / values[k];
                        chain.terms[k].push((parameter, by));
                    }
                }
                if by_elements {
                    chain.terms.push(term.into_iter().collect());
                }
                if term.is_some() {
                    chain.parameters.push(Parameter::Young { tets });
                }
            }
        }
        Ok(chain)
    }

    /// As [`MeasuredBody::chain`], of a motion: also by the damping ratio.
    pub(super) fn chain_of_motion(
        &self,
        values: &[f64],
        simulator: &dyn Simulator,
    ) -> Result<Chain> {
        let mut chain = self.chain((values, DerivedBy::Unknowns), simulator)?;
        let Some(model) = simulator.model() else {
            return Ok(chain);
        };
        let rate = model
            .elements()
            .map_or(0.0, |elements| elements.mass_damping);
        for (k, unknown) in self.unknowns.iter().enumerate() {
            if unknown.kind != Kind::DampingRatio {
                continue;
            }
            // Both are in proportion to it.
            let own = [
                (Parameter::DampingTime, model.damping_time),
                (Parameter::MassDamping, rate),
            ];
            for (parameter, value) in own {
                chain.terms[k].push((chain.parameters.len(), value / values[k]));
                chain.parameters.push(parameter);
            }
        }
        Ok(chain)
    }
}

/// Returns the parameter of the engine that an unknown of a tissue or a load is.
fn parameter_of(kind: &Kind, tets: &[u32]) -> Option<Parameter> {
    let tets = || tets.to_vec();
    Some(match kind {
        Kind::Young(_) => Parameter::Young { tets: tets() },
        Kind::Poisson(_) => Parameter::Poisson { tets: tets() },
        Kind::Density(_) => Parameter::Density { tets: tets() },
        Kind::Gravity(axis) => Parameter::Gravity {
            direction: DVec3::AXES[*axis],
        },
        Kind::Pressure(n) => Parameter::Amplitude(AmplitudeId::from_index(*n)),
        _ => return None,
    })
}

impl FactorSlope {
    /// Returns d ln f by an unknown.
    fn by(&self, kind: &Kind) -> f64 {
        match kind {
            Kind::LumpPosition(axis) => self.by_middle.dot(DVec3::AXES[*axis]),
            Kind::LumpDiameter => self.by_diameter,
            Kind::LumpContrast => self.by_contrast,
            _ => 0.0,
        }
    }
}

impl Chain {
    pub fn by_unknowns(&self, derivatives: &[f64]) -> Vec<f64> {
        let of = |terms: &Vec<(usize, f64)>| -> f64 {
            terms
                .iter()
                .map(|(k, factor)| factor * derivatives[*k])
                .sum()
        };
        self.terms.iter().map(of).collect()
    }
}
