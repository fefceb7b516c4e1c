//! What a body is made of: stiffness, mass, damping.

use crate::physics::VolumetricFormulation;
use crate::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::str::FromStr;

/// What a body of tets resists deformation with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MaterialModel {
    /// Springs along the edges, as in the papers: ν = ¼, and no sense of volume.
    #[default]
    Springs,
    /// Linear tets of stable Neo-Hookean material (Smith, de Goes & Kim 2018), for large strains.
    NeoHookean,
    /// Linear tets of corotated material (Stomakhin et al. 2012), linear but for rotations.
    Corotated,
}

impl MaterialModel {
    /// All of them.
    pub const ALL: [MaterialModel; 3] = [
        MaterialModel::Springs,
        MaterialModel::NeoHookean,
        MaterialModel::Corotated,
    ];

    /// The name, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            MaterialModel::Springs => "springs",
            MaterialModel::NeoHookean => "neo-hookean",
            MaterialModel::Corotated => "corotated",
        }
    }
}

impl fmt::Display for MaterialModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for MaterialModel {
    type Err = Error;

    fn from_str(name: &str) -> Result<MaterialModel> {
        let known = MaterialModel::ALL.into_iter().find(|m| m.name() == name);
        known.ok_or_else(|| {
            Error::Input(format!(
                "there is no material model \"{name}\"; there are springs, neo-hookean and corotated"
            ))
        })
    }
}

/// Where the stiffness of the springs comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// Young's modulus E in Pa: κ_ij = E·ΣV_t / L_ij² over the tets t around the edge, which
    /// gives the body the modulus E (at Poisson's ratio ¼) whatever the mesh.
    Young(f64),
    /// One spring constant κ in N/m for every edge, as in the paper: finer meshes are stiffer.
    Uniform(f64),
}

/// Which part of the relative velocity of a spring's ends is damped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Damping {
    /// The part along the spring: −κ_d x̂x̂ᵀ(v_i − v_j). The default, because it leaves rigid
    /// motion alone: a free body keeps its momentum and its spin.
    #[default]
    Axial,
    /// All of it, −κ_d(v_i − v_j), as in the paper (equation 3); it brakes rigid rotation too.
    Relative,
}

/// What the tets of one region are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionMaterial {
    /// In place of the number in [`Material::stiffness`]: Pa or N/m, as that is.
    pub stiffness: f64,
    /// Mass per volume, kg/m³.
    pub density: f64,
    /// Poisson's ratio, of elements.
    pub poisson: f64,
}

/// What a body is made of, and in which unit its mesh is given.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// What resists deformation.
    pub model: MaterialModel,
    /// Stiffness of the springs, or Young's modulus of the elements.
    pub stiffness: Stiffness,
    /// Poisson's ratio ν of elements; springs have ¼.
    pub poisson: f64,
    /// What changes of volume of elements are measured on.
    pub volume: VolumetricFormulation,
    /// Mass per volume, kg/m³.
    pub density: f64,
    /// Damping constant κ_d of every spring, N·s/m.
    pub damping: f64,
    /// Damping in proportion to stiffness, in seconds: adds `damping_time · κ` to each spring's
    /// κ_d, which damps meshes of any size and fineness alike.
    pub damping_time: f64,
    /// α of Rayleigh damping, 1/s, of elements: a force −α m v on every node.
    pub mass_damping: f64,
    /// What is damped.
    pub damping_kind: Damping,
    /// A cell field whose values are labels of regions; see [`Material::regions`].
    pub region_field: Option<String>,
    /// What the tets of some labels are made of instead.
    pub regions: BTreeMap<i64, RegionMaterial>,
    /// Labels of the regions that move as rigid bodies: of elements, by implicit schemes.
    pub rigid: BTreeSet<i64>,
    /// A field of factors on the stiffness, of the tets or else of the nodes; what lies between
    /// nodes takes their mean.
    pub stiffness_scale_field: Option<String>,
    /// Metres in one unit of the mesh file: 0.001 for a mesh in millimetres.
    pub length_unit: f64,
}

/// Poisson's ratio where nothing is said: soft tissue hardly changes its volume, and linear tets
/// lock where they must not at all.
pub(crate) const DEFAULT_POISSON: f64 = 0.4;

/// Poisson's ratio of linear tets is at most this.
const MAX_POISSON: f64 = 0.499;

fn check_poisson(ratio: f64, place: &str) -> Result<()> {
    match (0.0..=MAX_POISSON).contains(&ratio) {
        true => Ok(()),
        false => Err(Error::Input(format!(
            "material: a Poisson's ratio of {ratio}{place} makes no sense here; give a number from 0 to {MAX_POISSON}"
        ))),
    }
}

impl Material {
    /// A material of Young's modulus `young` (Pa) with the density of water, undamped.
    pub fn from_young(young: f64) -> Material {
        Material {
            model: MaterialModel::default(),
            stiffness: Stiffness::Young(young),
            poisson: DEFAULT_POISSON,
            volume: VolumetricFormulation::default(),
            density: 1000.0,
            damping: 0.0,
            damping_time: 0.0,
            mass_damping: 0.0,
            damping_kind: Damping::default(),
            region_field: None,
            regions: BTreeMap::new(),
            rigid: BTreeSet::new(),
            stiffness_scale_field: None,
            length_unit: 1.0,
        }
    }

    /// The paper's material: one spring constant `stiffness` (N/m) for all springs, damping
    /// `damping` (N·s/m) of the whole relative velocity, the density of water.
    pub fn uniform_springs(stiffness: f64, damping: f64) -> Material {
        Material {
            stiffness: Stiffness::Uniform(stiffness),
            damping,
            damping_kind: Damping::Relative,
            ..Material::from_young(0.0)
        }
    }

    /// Muscle and organs: E = 30 kPa, well damped.
    pub fn soft_tissue() -> Material {
        Material {
            density: 1060.0,
            damping_time: 0.02,
            ..Material::from_young(3e4)
        }
    }

    /// Fat and brain: E = 3 kPa, well damped.
    pub fn very_soft_tissue() -> Material {
        Material {
            density: 950.0,
            damping_time: 0.05,
            ..Material::from_young(3e3)
        }
    }

    /// Cartilage and firm rubber: E = 1 MPa.
    pub fn rubber() -> Material {
        Material {
            density: 1100.0,
            damping_time: 0.005,
            ..Material::from_young(1e6)
        }
    }

    /// A preset by name: `soft-tissue`, `very-soft-tissue`, `rubber`.
    ///
    /// # Errors
    /// [`Error::Input`] listing the names there are.
    pub fn preset(name: &str) -> Result<Material> {
        match name {
            "soft-tissue" => Ok(Material::soft_tissue()),
            "very-soft-tissue" => Ok(Material::very_soft_tissue()),
            "rubber" => Ok(Material::rubber()),
            _ => Err(Error::Input(format!(
                "there is no material \"{name}\"; there are soft-tissue, very-soft-tissue and rubber"
            ))),
        }
    }

    /// This material, of elements, so damped that a swing of `frequency` (Hz) has the damping ratio
    /// `ratio` (1 just does not swing): Rayleigh's α = ζω and β = ζ/ω, ω = 2π times the frequency.
    /// Slower and faster swings are damped more, ζ/2 (ω/ω' + ω'/ω) at ω'.
    pub fn with_damping_ratio(self, ratio: f64, frequency: f64) -> Material {
        let omega = std::f64::consts::TAU * frequency;
        Material {
            damping: 0.0,
            mass_damping: ratio * omega,
            damping_time: ratio / omega,
            ..self
        }
    }

    /// Refuses numbers that make no sense.
    pub(crate) fn check(&self) -> Result<()> {
        let (Stiffness::Young(stiffness) | Stiffness::Uniform(stiffness)) = self.stiffness;
        let numbers = [
            ("stiffness", stiffness, stiffness >= 0.0),
            ("density", self.density, self.density > 0.0),
            ("damping", self.damping, self.damping >= 0.0),
            ("damping time", self.damping_time, self.damping_time >= 0.0),
            ("mass damping", self.mass_damping, self.mass_damping >= 0.0),
            ("length unit", self.length_unit, self.length_unit > 0.0),
        ];
        let uniform = matches!(self.stiffness, Stiffness::Uniform(_));
        if uniform && self.model != MaterialModel::Springs {
            return Err(Error::Input(format!(
                "material: {} needs Young's modulus, and not a stiffness of springs",
                self.model
            )));
        }
        let springs = self.model == MaterialModel::Springs;
        if springs && self.mass_damping != 0.0 {
            return Err(Error::Input(format!(
                "material: a damping of the mass, {} 1/s, is for elements and not for springs; take neo-hookean or corotated",
                self.mass_damping
            )));
        }
        if !springs && self.damping != 0.0 {
            return Err(Error::Input(format!(
                "material: a damping of {} N·s/m is one of every spring, and {} elements have none; give a damping ratio at a frequency, or a damping time",
                self.damping, self.model
            )));
        }
        if springs && !self.rigid.is_empty() {
            return Err(Error::Input(
                "material: springs have no rigid regions; take neo-hookean or corotated elements"
                    .into(),
            ));
        }
        if springs && self.volume != VolumetricFormulation::PerTet {
            return Err(Error::Input(format!(
                "material: springs have no volume that could be {}; give model = \"neo-hookean\" or \"corotated\" (--material), or leave the volume out",
                self.volume
            )));
        }
        check_poisson(self.poisson, "")?;
        for (name, value, fits) in numbers {
            if !value.is_finite() || !fits {
                return Err(Error::Input(format!(
                    "material: a {name} of {value} makes no sense; give a finite positive number"
                )));
            }
        }
        for (label, region) in &self.regions {
            check_poisson(region.poisson, &format!(" in region {label}"))?;
            let numbers = [
                ("stiffness", region.stiffness, region.stiffness >= 0.0),
                ("density", region.density, region.density > 0.0),
            ];
            for (name, value, fits) in numbers {
                if !value.is_finite() || !fits {
                    return Err(Error::Input(format!(
                        "material: a {name} of {value} in region {label} makes no sense; give a finite positive number"
                    )));
                }
            }
        }
        Ok(())
    }
}
