//! Static equilibria in float64 on the CPU engine; their error is the model error.

use super::reference_motion::ReferenceMotion;
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, TetMesh};
use crate::physics::{
    CgSettings, CpuTets, DiscreteModel, Material, MaterialModel, Precision, Simulator, SolverKind,
    VolumetricFormulation,
};
use crate::{Error, Result};
use glam::DVec3;

/// Length of a step, s: so long that inertia is negligible.
const STEP: f64 = 100.0;

/// Maximum number of steps to reach equilibrium.
const MAX_STEPS: u32 = 100;

/// Returns the material models to compare: names, and materials of Young's modulus `young` (Pa).
pub(super) fn materials(young: f64) -> Vec<(String, Material)> {
    use ElementOrder::{Linear, Quadratic};
    use MaterialModel::{Corotated, NeoHookean};
    use VolumetricFormulation::{NodalAveraged, PerTet};
    let springs = ("springs".to_owned(), Material::from_young(young));
    let elements = [
        (NeoHookean, 0.25, PerTet, Linear),
        (Corotated, 0.25, PerTet, Linear),
        (NeoHookean, 0.45, PerTet, Linear),
        (NeoHookean, 0.49, PerTet, Linear),
        (NeoHookean, 0.49, NodalAveraged, Linear),
        (NeoHookean, 0.45, PerTet, Quadratic),
        (NeoHookean, 0.49, PerTet, Quadratic),
    ];
    let elements = elements.map(|(model, poisson, volume, order)| {
        let kind = match (volume, order) {
            (_, Quadratic) => ", quadratic",
            (NodalAveraged, Linear) => ", averaged",
            (PerTet, Linear) => "",
        };
        let material = Material {
            model,
            poisson,
            volume,
            order,
            ..Material::from_young(young)
        };
        (format!("{} {poisson}{kind}", model.name()), material)
    });
    std::iter::once(springs).chain(elements).collect()
}

/// Returns `mesh` with the nodes that elements of this order have.
///
/// # Errors
/// As [`TetMesh::with_mid_edge_nodes`].
pub(super) fn mesh_of_order(mesh: TetMesh, order: ElementOrder) -> Result<TetMesh> {
    match order {
        ElementOrder::Linear => Ok(mesh),
        ElementOrder::Quadratic => mesh.with_mid_edge_nodes(),
    }
}

/// Returns Poisson's ratio of `material`; spring networks have ¼.
pub(super) fn poisson(material: &Material) -> f64 {
    match material.model {
        MaterialModel::Springs => 0.25,
        _ => material.poisson,
    }
}

/// How close to its equilibrium a body comes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Convergence {
    /// Stopping criteria of each step.
    pub settings: CgSettings,
    /// Motion in the last step, relative to the displacement.
    pub change: f64,
}

impl Convergence {
    /// Fully converged.
    pub fn exact() -> Convergence {
        Convergence {
            settings: ReferenceMotion::converged_scheme(SolverKind::Implicit).1,
            change: 1e-7,
        }
    }
}

/// Returns the equilibrium of `mesh` made of `material`, starting from `start` (one position per
/// node), with the nodes `held` fixed there, under `gravity` (m/s²).
///
/// # Errors
/// An error if the engine fails; [`Error::Input`] if the body does not come to rest.
pub(super) fn at_rest(
    gpu: &Gpu,
    mesh: &TetMesh,
    material: &Material,
    (start, held): (&[DVec3], &[u32]),
    gravity: DVec3,
    convergence: Convergence,
) -> Result<CpuTets> {
    let discrete_model = DiscreteModel::new(mesh, material)?;
    let how = (SolverKind::Implicit, convergence.settings);
    let own = (mesh.clone(), discrete_model);
    let mut body = CpuTets::of_model(gpu, own, material, how, Precision::Double)?;
    body.set_positions(start)?;
    body.pin_nodes(held)?;
    body.loads_mut().set_gravity(gravity);
    let mut before = start.to_vec();
    for _ in 0..MAX_STEPS {
        body.run(1, STEP)?;
        let now = body.positions()?;
        let way = |(a, b): (&DVec3, &DVec3)| a.distance(*b);
        let moved = now.iter().zip(&before).map(way).fold(0.0, f64::max);
        let sunk = now.iter().zip(&mesh.nodes).map(way).fold(0.0, f64::max);
        if moved <= convergence.change * sunk {
            return Ok(body);
        }
        before = now;
    }
    Err(Error::Input(format!(
        "a body of {} tets does not reach static equilibrium in {MAX_STEPS} steps",
        mesh.tets.len()
    )))
}

/// A bar of square section clamped at one end, bending under its own weight.
#[derive(Clone, Copy, Debug)]
pub struct Cantilever {
    /// Length, m.
    pub length: f64,
    /// Side of the section, m.
    pub width: f64,
    /// Young's modulus, Pa.
    pub young: f64,
    /// Mass per volume, kg/m³.
    pub density: f64,
    /// m/s².
    pub gravity: f64,
}

/// Fraction of gravity that loads the bar: small enough for a linear response.
const GRAVITY_SCALE: f64 = 1e-4;

impl Cantilever {
    /// Returns the deflection of its free end, m, at Poisson's ratio `poisson` by Timoshenko beam
    /// theory: w L⁴/8EI + w L²/2kGA with Cowper's k = 10 (1 + ν)/(12 + 11 ν) of a rectangle.
    pub fn analytic_tip(&self, poisson: f64) -> f64 {
        let area = self.width * self.width;
        let inertia = area * area / 12.0;
        let load = self.density * self.gravity * area;
        let shear = self.young / (2.0 * (1.0 + poisson));
        let cowper = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson);
        load * self.length.powi(4) / (8.0 * self.young * inertia)
            + load * self.length.powi(2) / (2.0 * cowper * shear * area)
    }

    /// Returns the simulated deflection, m, of `mesh` (the bar along x from 0) made of `material`,
    /// scaled to the full load.
    ///
    /// # Errors
    /// An error if the engine fails; [`Error::Input`] if the body does not come to rest.
    pub fn measured_tip(&self, gpu: &Gpu, mesh: &TetMesh, material: &Material) -> Result<f64> {
        let slack = 1e-9 * self.length;
        let nodes = (0u32..).zip(&mesh.nodes);
        let held: Vec<u32> = nodes.filter(|n| n.1.x < slack).map(|n| n.0).collect();
        let gravity = GRAVITY_SCALE * self.gravity * DVec3::NEG_Z;
        let start = (mesh.nodes.as_slice(), held.as_slice());
        let body = at_rest(gpu, mesh, material, start, gravity, Convergence::exact())?;
        Ok(self.tip(mesh, &body.positions()?) / GRAVITY_SCALE)
    }

    /// Returns the mean deflection of the free end of `mesh` with its nodes at `now`, m.
    pub(super) fn tip(&self, mesh: &TetMesh, now: &[DVec3]) -> f64 {
        let end = self.length - 1e-9 * self.length;
        let nodes = mesh.nodes.iter().zip(now);
        let ways = nodes.filter(|(rest, _)| rest.x > end);
        let ways: Vec<f64> = ways.map(|(rest, x)| rest.z - x.z).collect();
        ways.iter().sum::<f64>() / ways.len().max(1) as f64
    }
}
