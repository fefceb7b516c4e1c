//! Averaged nodal volumes, which avoid volumetric locking of linear tets as Poisson's ratio nears
//! ½: the volume around a node is penalised instead of that of each tet.
//!
//! From the λ of each tet, the part λ̂ above [`Elements::per_tet_lambda_ratio`] μ is removed and
//! replaced by the energy ½ Σ_a Λ_a θ_a², where a runs over the nodes (at interfaces, over each
//! node once per region), θ_a = Σ_t Λ_t (J_t − 1)/(4 Λ_a) is the mean volumetric strain of the tets
//! t around it, Λ_t = V_t λ̂_t and Λ_a = Σ_t Λ_t/4 (Bonet & Burton 1998, "A simple average nodal
//! pressure tetrahedral element", written as an energy). For uniform F this equals the energy of
//! the tets; in general it is at most that. The mean is weighted by λ, so that soft tets do not
//! change the resistance of stiff neighbours.

use super::elements::{ConstitutiveModel, Element, ElementHessian, Elements};
use crate::parallel;
use crate::{Error, Result};
use glam::DVec3;
use rayon::slice::ParallelSliceMut;
use std::fmt;
use std::str::FromStr;

/// Default of [`Elements::per_tet_lambda_ratio`]: tets with ν up to ¼ keep their own volume.
const DEFAULT_PER_TET_LAMBDA_RATIO: f64 = 1.0;

/// Formulation of the volumetric strain of finite elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum VolumetricFormulation {
    /// Per tet: locks as Poisson's ratio nears ½.
    #[default]
    PerTet,
    /// Averaged over the tets of a region around each node: no locking, but steps take longer.
    NodalAveraged,
}

impl VolumetricFormulation {
    /// All variants.
    pub const ALL: [VolumetricFormulation; 2] = [
        VolumetricFormulation::PerTet,
        VolumetricFormulation::NodalAveraged,
    ];

    /// The name, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            VolumetricFormulation::PerTet => "per-tet",
            VolumetricFormulation::NodalAveraged => "averaged",
        }
    }
}

impl fmt::Display for VolumetricFormulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for VolumetricFormulation {
    type Err = Error;

    fn from_str(name: &str) -> Result<VolumetricFormulation> {
        let known = VolumetricFormulation::ALL
            .into_iter()
            .find(|m| m.name() == name);
        known.ok_or_else(|| {
            Error::Input(format!(
                "unknown volume \"{name}\"; expected per-tet or averaged"
            ))
        })
    }
}

/// A nodal volume: a node and the tets of one region around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NodalVolume {
    pub node: u32,
    /// Stiffness Λ_a, J.
    pub stiffness: f64,
}

/// No nodal volume.
pub(crate) const NO_NODAL_VOLUME: u32 = u32::MAX;

/// The nodal volumes of a set of elements.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct NodalVolumes {
    /// Ordered by node.
    pub cells: Vec<NodalVolume>,
    /// The nodal volume at each corner of each tet, or [`NO_NODAL_VOLUME`] for all four.
    pub of_tet: Vec<[u32; 4]>,
}

impl Default for Elements {
    fn default() -> Elements {
        Elements {
            law: ConstitutiveModel::default(),
            volume: VolumetricFormulation::default(),
            per_tet_lambda_ratio: DEFAULT_PER_TET_LAMBDA_RATIO,
            tets: Vec::new(),
            mid_edges: Vec::new(),
            rigid: Vec::new(),
            mass_damping: 0.0,
        }
    }
}

impl Elements {
    /// Returns λ̂ of a tet, Pa.
    pub(crate) fn averaged_lambda(&self, tet: &Element) -> f64 {
        let [mu, lambda] = tet.small_strain(self.law);
        match self.volume {
            VolumetricFormulation::PerTet => 0.0,
            VolumetricFormulation::NodalAveraged => {
                (lambda - self.per_tet_lambda_ratio * mu).max(0.0)
            }
        }
    }

    /// Returns a tet without its λ̂.
    pub(crate) fn without_averaged_lambda(&self, tet: &Element) -> Element {
        let [mu, second] = tet.lame_parameters;
        Element {
            lame_parameters: [mu, second - self.averaged_lambda(tet)],
            ..*tet
        }
    }

    /// Returns the nodal volumes; empty for [`VolumetricFormulation::PerTet`].
    pub(crate) fn cells(&self) -> NodalVolumes {
        if self.volume == VolumetricFormulation::PerTet {
            return NodalVolumes::default();
        }
        let mut corners = parallel::collect(self.tets.len(), |range, corners| {
            for t in range {
                let e = &self.tets[t];
                if self.averaged_lambda(e) > 0.0 {
                    corners.extend((0..4).map(|a| (e.nodes[a], e.region, t as u32, a)));
                }
            }
        });
        corners.par_sort_unstable();
        let mut all = NodalVolumes {
            cells: Vec::new(),
            of_tet: vec![[NO_NODAL_VOLUME; 4]; self.tets.len()],
        };
        for around in corners.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let mut stiffness = 0.0;
            for (_, _, t, a) in around {
                let tet = &self.tets[*t as usize];
                all.of_tet[*t as usize][*a] = all.cells.len() as u32;
                stiffness += 0.25 * tet.volume * self.averaged_lambda(tet);
            }
            all.cells.push(NodalVolume {
                node: around[0].0,
                stiffness,
            });
        }
        all
    }

    /// Returns θ of every nodal volume with the nodes at `x`, m.
    fn volume_strains(&self, cells: &NodalVolumes, x: &[DVec3]) -> Vec<f64> {
        let mut changes = vec![0.0; cells.cells.len()];
        for (tet, corners) in self.tets.iter().zip(&cells.of_tet) {
            let growth = tet
                .deformation_gradient(&tet.node_positions(x))
                .determinant()
                - 1.0;
            for c in corners.iter().filter(|c| **c != NO_NODAL_VOLUME) {
                changes[*c as usize] += 0.25 * tet.volume * self.averaged_lambda(tet) * growth;
            }
        }
        for (change, cell) in changes.iter_mut().zip(&cells.cells) {
            *change /= cell.stiffness;
        }
        changes
    }

    /// Returns the pressure in each tet with the nodes at `x` (m) in addition to its own
    /// constitutive model, Pa: λ̂ times the mean θ of its corners. Zero for
    /// [`VolumetricFormulation::PerTet`].
    pub fn averaged_pressures(&self, x: &[DVec3]) -> Vec<f64> {
        let cells = self.cells();
        self.pressures(&cells, &self.volume_strains(&cells, x))
    }

    fn pressures(&self, cells: &NodalVolumes, changes: &[f64]) -> Vec<f64> {
        if cells.cells.is_empty() {
            return vec![0.0; self.tets.len()];
        }
        let each = self.tets.iter().zip(&cells.of_tet);
        each.map(|(tet, corners)| {
            let of = |c: &u32| changes.get(*c as usize).copied().unwrap_or(0.0);
            0.25 * self.averaged_lambda(tet) * corners.iter().map(of).sum::<f64>()
        })
        .collect()
    }

    /// Returns for every tet with the nodes at `x` (m) its share of the energy of the nodal
    /// volumes, over its volume at rest, J/m³.
    pub fn averaged_energy_densities(&self, x: &[DVec3]) -> Vec<f64> {
        let cells = self.cells();
        let changes = self.volume_strains(&cells, x);
        let each = self.tets.iter().enumerate();
        each.map(|(t, tet)| {
            let corners = cells.of_tet.get(t).into_iter().flatten();
            let squares = corners.map(|c| changes.get(*c as usize).map_or(0.0, |j| j * j));
            0.125 * self.averaged_lambda(tet) * squares.sum::<f64>()
        })
        .collect()
    }

    /// Returns the energy with the nodes at `x` (m from the frame's origin), J.
    pub fn energy(&self, x: &[DVec3]) -> f64 {
        if self.order() == 2 {
            return parallel::sum(self.tets.len(), |t| {
                let element = self.quadratic_nodes(t).zip(self.quadratic_shape(t));
                element.map_or(0.0, |(nodes, shape)| {
                    shape.energy(&self.tets[t], self.law, &nodes.map(|v| x[v as usize]))
                })
            });
        }
        let own = parallel::sum(self.tets.len(), |t| {
            let e = &self.tets[t];
            self.without_averaged_lambda(e)
                .energy(self.law, &e.node_positions(x))
        });
        let cells = self.cells();
        let changes = self.volume_strains(&cells, x);
        let shared = cells.cells.iter().zip(changes);
        own + shared.map(|(c, j)| 0.5 * c.stiffness * j * j).sum::<f64>()
    }

    /// Returns the forces on the nodes at `x` (m), N.
    pub fn forces(&self, x: &[DVec3]) -> Vec<DVec3> {
        let mut f = vec![DVec3::ZERO; x.len()];
        if self.order() == 2 {
            for t in 0..self.tets.len() {
                let Some((nodes, shape)) = self.quadratic_nodes(t).zip(self.quadratic_shape(t))
                else {
                    continue;
                };
                let x = nodes.map(|v| x[v as usize]);
                let shares = shape.forces(&self.tets[t], self.law, &x);
                for (v, share) in nodes.iter().zip(shares) {
                    f[*v as usize] += share;
                }
            }
            return f;
        }
        for (tet, pressure) in self.tets.iter().zip(self.averaged_pressures(x)) {
            let shares = self.without_averaged_lambda(tet).forces_with_pressure(
                self.law,
                &tet.node_positions(x),
                pressure,
            );
            for (v, share) in tet.nodes.iter().zip(shares) {
                f[*v as usize] += share;
            }
        }
        f
    }

    /// Returns the Hessian of the energy with the nodes at `x` (m): blocks per tet in N/m, exact or
    /// projected to positive semidefinite per tet, and vectors v that contribute v vᵀ, for each
    /// nodal volume its nodes with entries in √(N/m).
    pub fn stiffness(
        &self,
        x: &[DVec3],
        projected: bool,
    ) -> (Vec<ElementHessian>, Vec<Vec<(u32, DVec3)>>) {
        let pressures = self.averaged_pressures(x);
        let blocks = self.tets.iter().zip(pressures).map(|(tet, pressure)| {
            let (own, corners) = (self.without_averaged_lambda(tet), tet.node_positions(x));
            match projected {
                true => own.projected_stiffness_under(self.law, &corners, pressure),
                false => own.stiffness_with_pressure(self.law, &corners, pressure),
            }
        });
        (blocks.collect(), self.volume_gradients(x))
    }

    /// Returns √Λ_a ∂θ_a/∂x of every nodal volume: the nodes it depends on, each once.
    pub(crate) fn volume_gradients(&self, x: &[DVec3]) -> Vec<Vec<(u32, DVec3)>> {
        let cells = self.cells();
        let mut slopes = vec![Vec::new(); cells.cells.len()];
        for (tet, corners) in self.tets.iter().zip(&cells.of_tet) {
            let share = 0.25 * tet.volume * self.averaged_lambda(tet);
            let cofactor = tet.cofactor(&tet.node_positions(x));
            for c in corners.iter().filter(|c| **c != NO_NODAL_VOLUME) {
                let over = share / cells.cells[*c as usize].stiffness.sqrt();
                let of_nodes = tet.nodes.iter().zip(tet.gradients());
                slopes[*c as usize].extend(of_nodes.map(|(v, g)| (*v, over * (cofactor * g))));
            }
        }
        for slope in &mut slopes {
            slope.sort_by_key(|(v, _)| *v);
            slope.dedup_by(|(v, more), (w, sum)| {
                let same = v == w;
                if same {
                    *sum += *more;
                }
                same
            });
        }
        slopes
    }
}
