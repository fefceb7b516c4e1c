//! Conversion of a discrete model to rapier's soft bodies, with checks for unsupported features.

use super::rigid_region::RigidRegion;
use super::units::Scale;
use crate::physics::model::rigid_region::node_owners;
use crate::physics::{ConstitutiveModel, DiscreteModel, Element, Elements, VolumetricFormulation};
use crate::{Error, Result};
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::prelude::{SoftBodyCellModel, SoftBodyMaterial};

/// Maximum number of distinct stiffnesses; each costs a pass over all tets at construction.
const MAX_STIFFNESS_GROUPS: usize = 256;

/// Relative difference below which two stiffnesses or Poisson's ratios count as equal.
const SAME: f64 = 1e-6;

/// Particles and cells in rapier's units, and the rigid regions.
#[derive(Clone, Debug)]
pub(super) struct SoftBodyModel {
    pub scale: Scale,
    /// The node of each particle, ascending: all nodes except those of rigid regions that belong to
    /// no soft tet.
    pub nodes: Vec<u32>,
    /// The particle of each node, if any.
    pub particles: Vec<Option<u32>>,
    /// The rigid region of each node, if any.
    pub owners: Vec<Option<u32>>,
    pub bones: Vec<RigidRegion>,
    /// Rest positions of the particles.
    pub rest: Vec<Vector>,
    pub masses: Vec<f32>,
    /// The particles of every tet.
    pub tets: Vec<[u32; 4]>,
    pub model: SoftBodyCellModel,
    pub material: SoftBodyMaterial,
    /// Tets whose stiffness differs from `material`: groups with their stiffness ratio.
    pub groups: Vec<(Vec<u32>, f32)>,
    /// α of the mass-proportional damping force −α m v, 1/s.
    pub mass_damping: f32,
}

impl SoftBodyModel {
    /// Converts `model`, whose boundary has these faces.
    ///
    /// # Errors
    /// [`Error::Input`] if rapier does not support the model: springs, no soft tets, averaged
    /// volume, several Poisson's ratios, or more than a few hundred stiffnesses.
    pub fn new(model: &DiscreteModel, boundary: &[[u32; 3]]) -> Result<SoftBodyModel> {
        let refused = |what: &str| Err(Error::Input(format!("rapier {what}")));
        let Some(elements) = model.elements() else {
            return refused(
                "supports finite elements only, but the body is made of springs; use --material neo-hookean (or corotated), or --engine cpu",
            );
        };
        if elements.order() == 2 {
            return refused("has no elements of order 2; use order 1, or --engine cpu");
        }
        if elements.tets.is_empty() {
            return refused(
                "requires a soft body, but the whole body is rigid; leave a region soft, or use --engine cpu",
            );
        }
        if elements.volume != VolumetricFormulation::PerTet {
            return refused(
                "does not support averaged volumes; remove `volume`, or use --engine cpu",
            );
        }
        let law = elements.law;
        let [young, poisson] = constants(&elements.tets[0], law);
        let ratios = elements.tets.iter().map(|t| constants(t, law)[1]);
        if let Some(other) = ratios.into_iter().find(|r| (r - poisson).abs() > SAME) {
            return refused(&format!(
                "supports one Poisson's ratio per body, but this one has {poisson:.4} and {other:.4}; give all regions the same, or use --engine cpu"
            ));
        }
        let scale = Scale::from_model(model);
        let count = model.rest_positions.len();
        let mut soft = vec![elements.rigid.is_empty(); count];
        for v in elements.tets.iter().flat_map(|t| &t.nodes) {
            soft[*v as usize] = true;
        }
        let owners = node_owners(&elements.rigid, count)?;
        let bones = elements.rigid.iter();
        let bones = bones.map(|body| RigidRegion::new(model, body, boundary, &soft, scale));
        let bones = bones.collect::<Result<Vec<RigidRegion>>>()?;
        let is_particle = |v: &u32| soft[*v as usize] || owners[*v as usize].is_none();
        let nodes: Vec<u32> = (0..count as u32).filter(is_particle).collect();
        let mut particles = vec![None; count];
        for (p, v) in (0u32..).zip(&nodes) {
            particles[*v as usize] = Some(p);
        }
        let mass = |v: &u32| {
            let share = owners[*v as usize].map_or(1.0, |_| RigidRegion::PARTICLE);
            (share * model.masses[*v as usize] / scale.mass) as f32
        };
        let rest = nodes.iter().map(|v| model.rest_positions[*v as usize]);
        let cell = |t: &Element| t.nodes.map(|v| particles[v as usize].unwrap_or_default());
        Ok(SoftBodyModel {
            rest: rest.map(|x| scale.vector(x)).collect(),
            masses: nodes.iter().map(mass).collect(),
            tets: elements.tets.iter().map(cell).collect(),
            model: match law {
                ConstitutiveModel::NeoHookean => SoftBodyCellModel::NeoHookean,
                ConstitutiveModel::Corotated => SoftBodyCellModel::Corotational,
            },
            material: SoftBodyMaterial {
                young_modulus: scale.stress(young),
                poisson_ratio: poisson as f32,
                elastic_damping_ratio: damping_ratio(model, elements) as f32,
                ..SoftBodyMaterial::default()
            },
            groups: groups(&elements.tets, law, young)?,
            mass_damping: elements.mass_damping as f32,
            nodes,
            particles,
            owners,
            bones,
            scale,
        })
    }
}

/// Returns Young's modulus (Pa) and Poisson's ratio of a tet.
fn constants(tet: &Element, law: ConstitutiveModel) -> [f64; 2] {
    let [mu, lambda] = tet.small_strain(law);
    let poisson = 0.5 * lambda / (lambda + mu);
    [2.0 * mu * (1.0 + poisson), poisson]
}

/// Groups the tets whose Young's modulus differs from `young` (Pa) by stiffness.
fn groups(tets: &[Element], law: ConstitutiveModel, young: f64) -> Result<Vec<(Vec<u32>, f32)>> {
    let factors = tets.iter().map(|t| constants(t, law)[0] / young);
    let mut others: Vec<(f64, u32)> = factors
        .zip(0u32..)
        .filter(|(factor, _)| (factor - 1.0).abs() > SAME)
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0));
    let alike = |a: &(f64, u32), b: &(f64, u32)| (b.0 - a.0).abs() <= SAME * a.0;
    let groups: Vec<(Vec<u32>, f32)> = others
        .chunk_by(alike)
        .map(|group| (group.iter().map(|g| g.1).collect(), group[0].0 as f32))
        .collect();
    match groups.len() < MAX_STIFFNESS_GROUPS {
        true => Ok(groups),
        false => Err(Error::Input(format!(
            "rapier supports up to {MAX_STIFFNESS_GROUPS} stiffnesses per body, but this one has {}; round the stiffness scale field, or use --engine cpu",
            groups.len() + 1
        ))),
    }
}

/// Returns the damping ratio that gives the tets of `elements` the damping time of `model` in the
/// volume average: rapier has one ratio for all tets.
fn damping_ratio(model: &DiscreteModel, elements: &Elements) -> f64 {
    let time = |t: &Element| damping_time_per_ratio(t, elements.law, &model.masses);
    let tets = elements.tets.iter().map(|t| (t.volume, time(t)));
    let (times, volume) = tets
        .filter(|(_, time)| *time > 0.0)
        .fold((0.0, 0.0), |(times, all), (volume, time)| {
            (times + volume * time, all + volume)
        });
    match times > 0.0 {
        true => model.damping_time * volume / times,
        false => 0.0,
    }
}

/// The damping time of every tet of `elements`, those of `model`, s.
pub(super) fn damping_times(
    model: &DiscreteModel,
    elements: &Elements,
) -> impl Iterator<Item = f64> {
    let ratio = damping_ratio(model, elements);
    let tets = elements.tets.iter();
    tets.map(move |t| ratio * damping_time_per_ratio(t, elements.law, &model.masses))
}

/// Returns the damping time of a tet with damping ratio 1 and these nodal masses (kg), s: two over
/// the mean angular frequency of its six strain modes.
fn damping_time_per_ratio(tet: &Element, law: ConstitutiveModel, masses: &[f64]) -> f64 {
    let [mu, lambda] = tet.small_strain(law);
    // Only the diagonal of G = Σ g gᵀ/m is used.
    let mut softness = DVec3::ZERO;
    for (v, g) in tet.nodes.iter().zip(tet.gradients()) {
        softness += g * g / masses[*v as usize];
    }
    let [x, y, z] = softness.to_array();
    let stretch = [x, y, z].map(|s| (2.0 * mu + lambda) * s);
    let shear = [x + y, x + z, y + z].map(|s| mu * s);
    let frequencies = stretch.into_iter().chain(shear);
    let sum: f64 = frequencies.map(|w| (tet.volume * w).sqrt()).sum();
    match sum > 0.0 && sum.is_finite() {
        true => 12.0 / sum,
        false => 0.0,
    }
}
