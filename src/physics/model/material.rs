//! Materials: stiffness, mass and damping.

use crate::mesh::ElementOrder;
use crate::physics::VolumetricFormulation;
use crate::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::str::FromStr;

/// The kind of elastic model of a tetrahedral body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MaterialModel {
    /// Springs along the edges, as in the papers: ν = ¼, no volume preservation.
    #[default]
    Springs,
    /// Linear tets of stable Neo-Hookean material (Smith, de Goes & Kim 2018), for large strains.
    NeoHookean,
    /// Linear tets of corotated material (Stomakhin et al. 2012): linear elasticity in the rotated
    /// frame.
    Corotated,
}

impl MaterialModel {
    /// All models.
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
                "unknown material model \"{name}\"; expected springs, neo-hookean or corotated"
            ))
        })
    }
}

/// The stiffness of springs or elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// Young's modulus E in Pa: κ_ij = E·ΣV_t / L_ij² over the tets t around the edge, which gives
    /// the body the modulus E (at Poisson's ratio ¼) for any mesh.
    Young(f64),
    /// One spring constant κ in N/m for all edges, as in the paper: finer meshes are stiffer.
    Uniform(f64),
}

/// The damped component of the relative velocity of a spring's ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Damping {
    /// The axial component: −κ_d x̂x̂ᵀ(v_i − v_j). The default, because it does not damp rigid
    /// motion: a free body keeps its linear and angular momentum.
    #[default]
    Axial,
    /// The whole relative velocity, −κ_d(v_i − v_j), as in the paper (equation 3); damps rigid
    /// rotation too.
    Relative,
}

/// The material of the tets of one region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionMaterial {
    /// Replaces the number in [`Material::stiffness`]: Pa or N/m, in the same sense.
    pub stiffness: f64,
    /// Density, kg/m³.
    pub density: f64,
    /// Poisson's ratio of elements.
    pub poisson: f64,
}

/// The material of a body, and the length unit of its mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The elastic model.
    pub model: MaterialModel,
    /// Stiffness of the springs, or Young's modulus of the elements.
    pub stiffness: Stiffness,
    /// Poisson's ratio ν of elements; that of springs is ¼.
    pub poisson: f64,
    /// Formulation of the volumetric strain of elements.
    pub volume: VolumetricFormulation,
    /// Order of the elements; [`ElementOrder::Quadratic`] requires a mesh with mid-edge nodes
    /// ([`TetMesh::with_mid_edge_nodes`](crate::mesh::TetMesh::with_mid_edge_nodes)).
    pub order: ElementOrder,
    /// Density, kg/m³.
    pub density: f64,
    /// Damping constant κ_d of every spring, N·s/m.
    pub damping: f64,
    /// Stiffness-proportional damping, s: adds `damping_time · κ` to each spring's κ_d, which damps
    /// meshes of any size and resolution alike.
    pub damping_time: f64,
    /// α of Rayleigh damping of elements, 1/s: a force −α m v on every node.
    pub mass_damping: f64,
    /// The damped velocity component.
    pub damping_kind: Damping,
    /// Cell field of region labels; see [`Material::regions`].
    pub region_field: Option<String>,
    /// Materials of individual regions, by label.
    pub regions: BTreeMap<i64, RegionMaterial>,
    /// Labels of the regions that move as rigid bodies: for elements, with implicit schemes.
    pub rigid: BTreeSet<i64>,
    /// Field of stiffness factors on the tets or nodes; springs and tets take the mean of their
    /// nodes' factors.
    pub stiffness_scale_field: Option<String>,
    /// Metres per unit of the mesh file: 0.001 for a mesh in millimetres.
    pub length_unit: f64,
}

/// Default Poisson's ratio: soft tissue is nearly incompressible, but linear tets lock as ν nears
/// ½.
pub(crate) const DEFAULT_POISSON: f64 = 0.4;

/// Maximum Poisson's ratio of linear tets.
const MAX_POISSON: f64 = 0.499;

fn check_poisson(ratio: f64, place: &str) -> Result<()> {
    match (0.0..=MAX_POISSON).contains(&ratio) {
        true => Ok(()),
        false => Err(Error::Input(format!(
            "material: Poisson's ratio{place} must be from 0 to {MAX_POISSON}, got {ratio}"
        ))),
    }
}

impl Material {
    /// An undamped material of Young's modulus `young` (Pa) with the density of water.
    pub fn from_young(young: f64) -> Material {
        Material {
            model: MaterialModel::default(),
            stiffness: Stiffness::Young(young),
            poisson: DEFAULT_POISSON,
            volume: VolumetricFormulation::default(),
            order: ElementOrder::default(),
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

    /// The material of the paper: one spring constant `stiffness` (N/m) for all springs, damping
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
    /// [`Error::Input`] that lists the names if `name` is unknown.
    pub fn preset(name: &str) -> Result<Material> {
        match name {
            "soft-tissue" => Ok(Material::soft_tissue()),
            "very-soft-tissue" => Ok(Material::very_soft_tissue()),
            "rubber" => Ok(Material::rubber()),
            _ => Err(Error::Input(format!(
                "unknown material \"{name}\"; expected soft-tissue, very-soft-tissue or rubber"
            ))),
        }
    }

    /// Returns this material, for elements, with Rayleigh damping of the damping ratio ζ = `ratio`
    /// (1 is critical) at `frequency` (Hz): α = ζω and β = ζ/ω, with ω = 2π times the frequency.
    /// Lower and higher frequencies are damped more, by the ratio ζ/2 (ω/ω' + ω'/ω) at ω'.
    pub fn with_damping_ratio(self, ratio: f64, frequency: f64) -> Material {
        let omega = std::f64::consts::TAU * frequency;
        Material {
            damping: 0.0,
            mass_damping: ratio * omega,
            damping_time: ratio / omega,
            ..self
        }
    }

    /// Checks that the material supports its order.
    fn check_order(&self) -> Result<()> {
        if self.order == ElementOrder::Linear {
            return Ok(());
        }
        if self.model == MaterialModel::Springs {
            return Err(Error::Input(
                "material: springs have no order 2; set model = \"neo-hookean\" or \"corotated\" (--material)"
                    .into(),
            ));
        }
        if self.volume != VolumetricFormulation::PerTet {
            return Err(Error::Input(format!(
                "material: quadratic tets (order 2) do not lock and have no volume \"{}\"; remove volume (--volume), or use order 1",
                self.volume
            )));
        }
        Ok(())
    }

    /// Validates the material.
    pub(crate) fn check(&self) -> Result<()> {
        let (Stiffness::Young(stiffness) | Stiffness::Uniform(stiffness)) = self.stiffness;
        // A body of springs without stiffness is a cloud of free masses; one of a material is not.
        let stiff = match self.stiffness {
            Stiffness::Young(young) => young > 0.0,
            Stiffness::Uniform(stiffness) => stiffness >= 0.0,
        };
        let numbers = [
            ("stiffness", stiffness, stiff),
            ("density", self.density, self.density > 0.0),
            ("damping", self.damping, self.damping >= 0.0),
            ("damping time", self.damping_time, self.damping_time >= 0.0),
            ("mass damping", self.mass_damping, self.mass_damping >= 0.0),
            ("length unit", self.length_unit, self.length_unit > 0.0),
        ];
        let uniform = matches!(self.stiffness, Stiffness::Uniform(_));
        if uniform && self.model != MaterialModel::Springs {
            return Err(Error::Input(format!(
                "material: {} requires Young's modulus, not a spring stiffness",
                self.model
            )));
        }
        let springs = self.model == MaterialModel::Springs;
        if springs && self.mass_damping != 0.0 {
            return Err(Error::Input(format!(
                "material: mass damping of {} 1/s is supported by elements only, not by springs; use neo-hookean or corotated",
                self.mass_damping
            )));
        }
        if !springs && self.damping != 0.0 {
            return Err(Error::Input(format!(
                "material: spring damping of {} N·s/m is not supported by {} elements; give a damping ratio at a frequency, or a damping time",
                self.damping, self.model
            )));
        }
        if springs && !self.rigid.is_empty() {
            return Err(Error::Input(
                "material: springs do not support rigid regions; use neo-hookean or corotated elements"
                    .into(),
            ));
        }
        if springs && self.volume != VolumetricFormulation::PerTet {
            return Err(Error::Input(format!(
                "material: springs do not support volume \"{}\"; set model = \"neo-hookean\" or \"corotated\" (--material), or remove volume",
                self.volume
            )));
        }
        self.check_order()?;
        check_poisson(self.poisson, "")?;
        for (name, value, fits) in numbers {
            if !value.is_finite() || !fits {
                return Err(Error::Input(format!(
                    "material: {name} must be a finite positive number, got {value}"
                )));
            }
        }
        for (label, region) in &self.regions {
            check_poisson(region.poisson, &format!(" in region {label}"))?;
            let numbers = [
                ("stiffness", region.stiffness, region.stiffness > 0.0),
                ("density", region.density, region.density > 0.0),
            ];
            for (name, value, fits) in numbers {
                if !value.is_finite() || !fits {
                    return Err(Error::Input(format!(
                        "material: {name} in region {label} must be a finite positive number, got {value}"
                    )));
                }
            }
        }
        Ok(())
    }
}
