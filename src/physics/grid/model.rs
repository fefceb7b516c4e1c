//! Masses and springs of a grid body, in float64 and SI units.

use super::shape::{GridShape, SPRING_KINDS};
use crate::mesh::{LocalFrame, TetMesh};
use crate::mesher::Domain;
use crate::physics::grid::reference::GridReference;
use crate::physics::loads::force_balance::{ForceBalance, ForceSums};
use crate::physics::{Energy, Loads, Material, MaterialModel, RegionMaterial, Stiffness};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// The particles of a [`GridShape`] with masses and spring constants.
#[derive(Clone, Debug)]
pub struct GridModel {
    /// The grid and its particles.
    pub shape: GridShape,
    /// The springs of each particle; see [`GridShape::springs`].
    pub springs: Vec<u32>,
    /// Mass of each particle, kg; 0 for empty grid points.
    pub masses: Vec<f64>,
    /// κ of the springs of each kind, N/m: the spring force is κ (l − L).
    ///
    /// Equation 2 of the paper assumes a spacing of 1 and has the factor ½k; κ is that ½k.
    pub stiffness: [f64; SPRING_KINDS],
    /// Stiffness of each particle relative to the body's; a spring takes the mean of its two ends.
    pub stiffness_scales: Vec<f64>,
    /// The local frame of the GPU's positions.
    pub frame: LocalFrame,
    /// Metres per file unit.
    pub length_unit: f64,
    /// Damping rate γ, 1/s: every particle is subject to the force −γ m v.
    pub damping: f64,
}

impl GridModel {
    /// The model of about `particles` particles inside `domain`, made of `material`.
    ///
    /// # Errors
    /// As [`GridShape::from_domain_with_count`] and [`GridModel::new`].
    pub fn from_domain(
        domain: &dyn Domain,
        particles: usize,
        material: &Material,
    ) -> Result<GridModel> {
        let shape = GridShape::from_domain_with_count(domain, particles, DMat3::IDENTITY)?;
        GridModel::new(shape, material)
    }

    /// The model of `shape` made of `material`. Each particle has the mass of one cell.
    ///
    /// For a Young's modulus, the κ of each kind are chosen such that the grid is isotropic with
    /// that modulus and a Poisson ratio of ¼, for any spacing; with equal spacing s, all κ are 0.4
    /// E s. For a uniform stiffness, all κ equal it. `damping_time`, `damping` and
    /// `stiffness_scale_field` of the material do not apply; `regions` apply by the regions of the
    /// particles.
    ///
    /// # Errors
    /// [`Error::Input`] if a material parameter is out of range, or the spacing is too anisotropic
    /// for a Young's modulus.
    pub fn new(shape: GridShape, material: &Material) -> Result<GridModel> {
        material.check()?;
        if material.model != MaterialModel::Springs {
            return Err(Error::Input(format!(
                "a grid body supports springs only, not {}; simulate tets, or remove the material model",
                material.model
            )));
        }
        let unit = material.length_unit;
        let cell = (shape.spacing * unit).to_array().iter().product::<f64>();
        let (Stiffness::Young(common) | Stiffness::Uniform(common)) = material.stiffness;
        let rest = RegionMaterial {
            stiffness: common,
            density: material.density,
            poisson: material.poisson,
        };
        let of = |region: u16| {
            let known = material.regions.get(&shape.label(region));
            known.copied().unwrap_or(rest)
        };
        // If only regions have stiffnesses, the first one is the reference stiffness of the body.
        let body = match common > 0.0 {
            true => common,
            false => material
                .regions
                .values()
                .map(|r| r.stiffness)
                .fold(0.0, f64::max),
        };
        let stiffness = match material.stiffness {
            Stiffness::Uniform(_) => [body; SPRING_KINDS],
            Stiffness::Young(_) => isotropic_stiffness(shape.spacing * unit, body)?,
        };
        let over = |k: f64| if body > 0.0 { k / body } else { 0.0 };
        let masses: Vec<f64> = shape
            .regions
            .iter()
            .map(|r| if *r == 0 { 0.0 } else { of(*r).density * cell })
            .collect();
        if !masses.iter().all(|m| m.is_finite()) || !stiffness.iter().all(|k| k.is_finite()) {
            return Err(Error::Input(format!(
                "the masses or stiffnesses of the grid overflow with a length unit of {unit} m; check the length unit"
            )));
        }
        Ok(GridModel {
            springs: shape.springs(),
            masses,
            stiffness,
            stiffness_scales: shape
                .regions
                .iter()
                .map(|r| if *r == 0 { 0.0 } else { over(of(*r).stiffness) })
                .collect(),
            frame: shape.frame(),
            length_unit: unit,
            damping: 1.0,
            shape,
        })
    }

    /// Returns a step in s that is certainly stable: h = 2/ω, with ω² bounded by twice the largest
    /// sum of κ/m around a particle (Gershgorin). The true limit is slightly larger.
    pub fn conservative_step(&self) -> f64 {
        let worst = self
            .shape
            .particles()
            .map(|i| {
                let springs = self.springs[i];
                let count = |k: usize| f64::from((springs >> (2 * k) & 3).count_ones());
                let sum: f64 = (0..SPRING_KINDS)
                    .map(|k| count(k) * self.stiffness[k])
                    .sum();
                // A neighbour may be stiffer than the particle itself.
                let stiffest = self.stiffest_around(i, springs);
                2.0 * 0.5 * (self.stiffness_scales[i] + stiffest) * sum / self.masses[i]
            })
            .fold(0.0, f64::max);
        if worst > 0.0 {
            2.0 / worst.sqrt()
        } else {
            f64::INFINITY
        }
    }

    fn stiffest_around(&self, i: usize, springs: u32) -> f64 {
        let offsets = self.shape.offsets();
        (0..2 * SPRING_KINDS)
            .filter(|bit| springs >> bit & 1 == 1)
            .map(|bit| {
                let step = if bit % 2 == 0 { 1 } else { -1 } * offsets[bit / 2];
                self.stiffness_scales[(i as i64 + step) as usize]
            })
            .fold(self.stiffness_scales[i], f64::max)
    }

    /// Checks that `mesh` is the mesh of the complete cells; it may have additional fields.
    pub(crate) fn check_mesh(&self, mesh: &TetMesh) -> Result<()> {
        let own = self.shape.mesh(&self.springs)?;
        match own.tets == mesh.tets && own.nodes.len() == mesh.nodes.len() {
            true => Ok(()),
            false => Err(Error::Input(
                "the mesh of a grid body must consist of its cells; create it with GridShape::mesh"
                    .into(),
            )),
        }
    }

    /// Computes the energies at `positions` and `velocities`, in file units.
    pub(crate) fn energy(&self, positions: &[DVec3], velocities: &[DVec3]) -> Energy {
        let (offsets, lengths) = (self.shape.offsets(), self.shape.rest_lengths());
        let unit = self.length_unit;
        let (mut kinetic, mut elastic) = (0.0, 0.0);
        for i in self.shape.particles() {
            kinetic += 0.5 * self.masses[i] * (velocities[i] * unit).length_squared();
            for k in (0..SPRING_KINDS).filter(|k| self.springs[i] >> (2 * k) & 1 == 1) {
                let j = (i as i64 + offsets[k]) as usize;
                let stiffness =
                    0.5 * (self.stiffness_scales[i] + self.stiffness_scales[j]) * self.stiffness[k];
                let stretch = (positions[i].distance(positions[j]) - lengths[k]) * unit;
                elastic += 0.5 * stiffness * stretch * stretch;
            }
        }
        Energy {
            kinetic,
            elastic,
            total: kinetic + elastic,
        }
    }

    /// Returns the balance of the static forces with the particles at `positions` (file units),
    /// which are rounded to `resolution`, m.
    pub(in crate::physics) fn force_balance(
        &self,
        loads: &Loads,
        positions: &[DVec3],
        resolution: f64,
    ) -> ForceBalance {
        let mut reference = self.reference();
        for (x, p) in reference.x.iter_mut().zip(positions) {
            *x = (*p - self.frame.origin) * self.length_unit;
        }
        let (external, fixed) = (
            loads.static_forces(&self.masses, positions),
            loads.fixed_nodes(),
        );
        let all: f64 = self.stiffness.iter().sum();
        let mut sums = ForceSums::default();
        for i in self.shape.particles() {
            let error = 2.0 * all * self.stiffness_scales[i] * resolution;
            sums.add(reference.spring_force(i), external[i], !fixed[i], error);
            sums.add_negligible(all, self.frame.scale * self.length_unit);
        }
        sums.balance()
    }

    /// The two particles of each spring.
    pub fn spring_pairs(&self) -> Vec<[u32; 2]> {
        let offsets = self.shape.offsets();
        let forward = self.shape.particles().flat_map(|i| {
            let kinds = (0..SPRING_KINDS).filter(move |k| self.springs[i] >> (2 * k) & 1 == 1);
            kinds.map(move |k| [i as u32, (i as i64 + offsets[k]) as u32])
        });
        forward.collect()
    }

    /// Rest positions of the particles, m from the frame's origin.
    pub(crate) fn rest_positions_m(&self) -> Vec<DVec3> {
        (0..self.shape.regions.len())
            .map(|i| (self.shape.rest_position(i) - self.frame.origin) * self.length_unit)
            .collect()
    }

    /// The particles at rest in float64, m from the frame's origin: the reference for the engines.
    pub fn reference(&self) -> GridReference {
        let x = self.rest_positions_m();
        GridReference {
            previous: x.clone(),
            springs: self.springs.clone(),
            inverse_masses: self
                .masses
                .iter()
                .map(|m| if *m > 0.0 { 1.0 / m } else { 0.0 })
                .collect(),
            factors: self.stiffness_scales.clone(),
            forces: vec![DVec3::ZERO; x.len()],
            offsets: self.shape.offsets(),
            lengths: self.shape.rest_lengths().map(|l| l * self.length_unit),
            stiffness: self.stiffness,
            gravity: DVec3::ZERO,
            damping: self.damping,
            particles: self.shape.particles().map(|i| i as u32).collect(),
            x,
        }
    }
}

/// Returns the κ of each kind for the Young's modulus `young` at `spacing` (m), for which the
/// stiffness tensor of the springs is isotropic with λ = μ = young / 2.5.
pub(crate) fn isotropic_stiffness(spacing: DVec3, young: f64) -> Result<[f64; SPRING_KINDS]> {
    let mu = young / 2.5;
    let s = spacing.to_array();
    let mut stiffness = [0.0; SPRING_KINDS];
    for (k, step) in GridShape::SPRING_OFFSETS.iter().enumerate() {
        let along: Vec<usize> = (0..3).filter(|a| step[*a] != 0).collect();
        stiffness[k] = match along.as_slice() {
            [a] => {
                let [b, c] = [(a + 1) % 3, (a + 2) % 3];
                let ratio = |o: usize| (s[*a] / s[o]).powi(2);
                mu * s[b] * s[c] / s[*a] * (3.0 - ratio(b) - ratio(c))
            }
            [a, b] => {
                let c = 3 - a - b;
                mu * s[c] * (s[*a] * s[*a] + s[*b] * s[*b]) / (2.0 * s[*a] * s[*b])
            }
            _ => 0.0,
        };
    }
    match stiffness.iter().all(|k| *k >= 0.0) {
        true => Ok(stiffness),
        false => Err(Error::Input(format!(
            "springs of a grid with a spacing of {spacing} m cannot have an isotropic stiffness; use spacings that differ less (by a factor of 1.2, or of 1.7 for one shorter axis), or one stiffness for all springs"
        ))),
    }
}
