//! Derived fields of a body: strain and stress of each tet in float64, computed on request.
//!
//! With F the deformation gradient of a tet, J = det F and P = ∂Ψ/∂F of its constitutive model:
//!
//! - σ = P Fᵀ/J, the Cauchy stress (Bonet & Wood 2008, "Nonlinear Continuum Mechanics for Finite
//!   Element Analysis", equation 5.45); stresses are those of the passive material, without muscles
//!   and damping;
//! - `stress_1` ≥ `stress_2` ≥ `stress_3`, its eigenvalues, tension positive;
//! - `von_mises` = √(3/2 s:s), s = σ − ⅓ tr σ I;
//! - `strain`, the largest eigenvalue of the Green–Lagrange strain ½(FᵀF − I);
//! - `energy_density` = Ψ, per volume at rest.

use super::model::elements::eigen;
use super::{ConstitutiveModel, DiscreteModel, Element, Engine, Simulator};
use crate::parallel;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::fmt;
use std::str::FromStr;

/// Lower bound of |J| in the computation of stress, which is undefined for flat tets.
const MIN_ABS_J: f64 = 1e-3;

/// Strains below this are rounding errors on engines that store positions in float32.
const F32_STRAIN_NOISE: f64 = 1e-5;

/// Strains below this are rounding errors of the float64 positions of the CPU engine, which stores
/// displacements.
const F64_STRAIN_NOISE: f64 = 1e-12;

/// A scalar field derived from the node positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BodyField {
    /// Distance of each node from its rest position, in file units.
    Displacement,
    /// Von Mises stress, Pa.
    VonMises,
    /// The largest principal Cauchy stress, Pa.
    Stress1,
    /// The middle principal Cauchy stress, Pa.
    Stress2,
    /// The smallest principal Cauchy stress, Pa.
    Stress3,
    /// The largest principal Green–Lagrange strain.
    Strain,
    /// Volume ratio J.
    J,
    /// Elastic energy per volume at rest, J/m³.
    EnergyDensity,
}

impl BodyField {
    /// All fields.
    pub const ALL: [BodyField; 8] = [
        BodyField::Displacement,
        BodyField::VonMises,
        BodyField::Stress1,
        BodyField::Stress2,
        BodyField::Stress3,
        BodyField::Strain,
        BodyField::J,
        BodyField::EnergyDensity,
    ];

    /// The name, as in scenes and files.
    pub fn name(self) -> &'static str {
        match self {
            BodyField::Displacement => "displacement",
            BodyField::VonMises => "von_mises",
            BodyField::Stress1 => "stress_1",
            BodyField::Stress2 => "stress_2",
            BodyField::Stress3 => "stress_3",
            BodyField::Strain => "strain",
            BodyField::J => "J",
            BodyField::EnergyDensity => "energy_density",
        }
    }

    /// The unit of its values; empty for ratios.
    pub fn unit(self) -> &'static str {
        match self {
            BodyField::Displacement => "in the mesh's unit",
            BodyField::Strain | BodyField::J => "",
            BodyField::EnergyDensity => "J/m³",
            _ => "Pa",
        }
    }

    /// Whether it depends on the positions only, not on the material.
    fn is_kinematic(self) -> bool {
        matches!(
            self,
            BodyField::Displacement | BodyField::Strain | BodyField::J
        )
    }

    /// Checks that the body has this field.
    ///
    /// # Errors
    /// [`Error::Input`] for stress or energy of springs, of a grid, or of a mesh embedded in a
    /// cage.
    pub fn check(self, body: &dyn Simulator) -> Result<()> {
        if self.is_kinematic() {
            return Ok(());
        }
        let members = body.members();
        if !members.is_empty() {
            let mut each = members.iter();
            return each.try_for_each(|m| m.with_body_name(self.check(m.simulator.as_ref())));
        }
        if body.coarse_body().is_some() {
            return Err(Error::Input(format!(
                "{self} is not available for a mesh embedded in a cage, because only the cage is simulated; remove [cage], or show displacement, strain or J"
            )));
        }
        match body.model() {
            Some(discrete_model) if discrete_model.elements().is_some() => Ok(()),
            Some(_) => Err(Error::Input(format!(
                "{self} is not available for a body of springs, which have no stress; use --material neo-hookean (or corotated), or show displacement, strain or J"
            ))),
            None => Err(Error::Input(format!(
                "{self} is not available for a grid body, which is made of springs; simulate tets with --material neo-hookean, or show displacement, strain or J"
            ))),
        }
    }

    /// Returns one value per tet of the body's mesh, from the state read back; for displacements,
    /// the length of the mean.
    ///
    /// # Errors
    /// As [`BodyField::check`], and errors of reading back.
    pub fn per_tet(self, body: &dyn Simulator) -> Result<Vec<f64>> {
        self.check(body)?;
        let members = body.members();
        if members.is_empty() {
            return self.in_own_tets(body);
        }
        let each = members
            .iter()
            .map(|m| m.with_body_name(self.per_tet(m.simulator.as_ref())));
        Ok(each.collect::<Result<Vec<_>>>()?.concat())
    }

    /// Returns one value per node: the mean over the tets around it, weighted by volume at rest;
    /// for displacements, the node's own.
    ///
    /// # Errors
    /// As [`BodyField::per_tet`].
    pub fn per_node(self, body: &dyn Simulator) -> Result<Vec<f64>> {
        if self == BodyField::Displacement {
            let positions = body.positions()?.into_iter().zip(&body.mesh().nodes);
            return Ok(positions.map(|(x, rest)| x.distance(*rest)).collect());
        }
        Ok(body.mesh().volume_weighted_node_means(&self.per_tet(body)?))
    }

    /// Difference of values that may be a rounding error.
    pub fn noise_floor(self, body: &dyn Simulator) -> f64 {
        let stiffest = |discrete_model: &DiscreteModel| {
            let lame = discrete_model.tets().iter().map(|e| e.lame_parameters[0]);
            lame.fold(0.0, f64::max)
        };
        let members = body.members().iter();
        // There are members, or a model, or neither.
        let networks = members.filter_map(|m| m.simulator.model());
        let stiffness = networks
            .chain(body.model())
            .map(stiffest)
            .fold(0.0, f64::max);
        let strain = match body.engine() == Engine::Cpu && body.coarse_body().is_none() {
            true => F64_STRAIN_NOISE,
            false => F32_STRAIN_NOISE,
        };
        strain
            * match self {
                BodyField::Strain | BodyField::J => 1.0,
                BodyField::Displacement => {
                    let (low, high) = body.mesh().bounds();
                    (high - low).max_element()
                }
                BodyField::EnergyDensity => stiffness * strain,
                _ => stiffness,
            }
    }

    fn in_own_tets(self, body: &dyn Simulator) -> Result<Vec<f64>> {
        let (mesh, positions) = (body.mesh(), body.positions()?);
        let now = |t: usize| mesh.tets[t].map(|v| positions[v as usize]);
        if self == BodyField::Displacement {
            let of_tet = |t: usize| {
                let moved = now(t).iter().sum::<DVec3>() - mesh.tet_nodes(t).iter().sum::<DVec3>();
                0.25 * moved.length()
            };
            return Ok(parallel::map(mesh.tets.len(), of_tet));
        }
        let model = body.model().and_then(|n| Some((n, n.elements()?)));
        let is_linear = model.is_none_or(|(_, elements)| elements.order() == 1);
        if self.is_kinematic() && is_linear {
            let of_tet = |t: usize| self.of_deformation(&deformation(&mesh.tet_nodes(t), &now(t)));
            return Ok(parallel::map(mesh.tets.len(), of_tet));
        }
        let Some((discrete_model, elements)) = model else {
            return self.check(body).map(|()| Vec::new());
        };
        let metres: Vec<DVec3> = positions
            .iter()
            .map(|p| discrete_model.to_metres(*p))
            .collect();
        // The averaged nodal volumes require all tets.
        let shared = match self {
            BodyField::EnergyDensity => elements.averaged_energy_densities(&metres),
            _ => elements.averaged_pressures(&metres),
        };
        let of_element = |(t, element): (usize, Option<usize>)| {
            let Some(number) = element else {
                return match self.is_kinematic() {
                    true => self.of_deformation(&deformation(&mesh.tet_nodes(t), &now(t))),
                    false => 0.0,
                };
            };
            {
                let e = elements.without_averaged_lambda(&elements.tets[number]);
                let f = match elements.order() {
                    1 => e.deformation_gradient(&e.node_positions(&metres)),
                    _ => elements.deformation_of_piece(number, &mesh.tets[t], &metres),
                };
                self.of_material(&e, (elements.law, shared[number]), &f)
            }
        };
        let numbers = elements.of_tets(mesh);
        Ok(parallel::map(numbers.len(), |t| {
            of_element((t, numbers[t]))
        }))
    }

    /// Evaluates a field that depends on F only.
    fn of_deformation(self, f: &DMat3) -> f64 {
        match self {
            _ if !f.is_finite() => f64::from(u8::from(self == BodyField::J)),
            BodyField::J => f.determinant(),
            _ => principal_values(&((f.transpose() * *f - DMat3::IDENTITY) * 0.5))[0],
        }
    }

    /// Evaluates the field of an element with its nodes at `corners`, m; `shared` is the
    /// contribution of the averaged nodal volumes: a pressure (Pa, positive in tension), or for
    /// energies an energy density (J/m³).
    pub fn of_element(
        self,
        element: &Element,
        (law, shared): (ConstitutiveModel, f64),
        corners: &[DVec3; 4],
    ) -> f64 {
        self.of_material(
            element,
            (law, shared),
            &element.deformation_gradient(corners),
        )
    }

    /// As [`BodyField::of_element`], at the deformation gradient `f`.
    fn of_material(
        self,
        element: &Element,
        (law, shared): (ConstitutiveModel, f64),
        f: &DMat3,
    ) -> f64 {
        if self.is_kinematic() {
            return self.of_deformation(f);
        }
        if self == BodyField::EnergyDensity {
            return element.energy_density(law, f) + shared;
        }
        let j = f.determinant();
        let j = j.abs().max(MIN_ABS_J).copysign(j);
        let [a, b, c] =
            principal_values(&(element.stress(law, f, shared) * f.transpose() * (1.0 / j)));
        match self {
            BodyField::Stress1 => a,
            BodyField::Stress2 => b,
            BodyField::Stress3 => c,
            _ => (0.5 * ((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2))).sqrt(),
        }
    }
}

impl fmt::Display for BodyField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for BodyField {
    type Err = Error;

    fn from_str(name: &str) -> Result<BodyField> {
        let known = BodyField::ALL.into_iter().find(|f| f.name() == name);
        known.ok_or_else(|| {
            let names = BodyField::ALL.map(BodyField::name);
            Error::Input(format!(
                "unknown computed field \"{name}\"; expected one of {}",
                names.join(", ")
            ))
        })
    }
}

/// Returns F of a tet.
fn deformation(rest: &[DVec3; 4], now: &[DVec3; 4]) -> DMat3 {
    let edges = |p: &[DVec3; 4]| DMat3::from_cols(p[1] - p[0], p[2] - p[0], p[3] - p[0]);
    edges(now) * edges(rest).inverse()
}

/// Returns the eigenvalues of a symmetric matrix in descending order.
fn principal_values(m: &DMat3) -> [f64; 3] {
    let columns = m.to_cols_array_2d();
    let symmetric =
        std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (columns[i][j] + columns[j][i])));
    let mut values = eigen(symmetric).0;
    values.sort_by(|a, b| b.total_cmp(a));
    values
}
