//! Builds the material of a body from a scene's `[material]`.

mod deserialize;
#[cfg(feature = "identify")]
mod tissue_values;

use super::element_order::OrderChoice;
use super::keywords::{DAMPING_KINDS, unknown_keyword_error};
use super::region::LabelOrName;
use crate::mesh::{Location, TetMesh};
use crate::physics::{
    Damping, Material, MaterialModel, RegionMaterial, Stiffness, Tissue, VolumetricFormulation,
};
#[cfg(feature = "cli")]
use crate::scene::schema;
use crate::{Error, Result};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Material of the body. Stiffness is Young's modulus unless `stiffness` is given.
///
/// Every other key is a tissue, with the regions of the mesh that consist of it:
///
/// ```toml
/// [material]
/// young = 3e4                        # regions without a tissue
/// bone = ["femur", "tibia", 7]       # regions by name, or by the value of the field `label`
///
/// [material.cartilage]               # every region with "cartilage" in its name
/// young = 1e6                        # replaces the published value
///
/// [material.marrow]
/// rigid = true                       # finite elements only: connected regions move as one body
/// ```
///
/// Tissues of [`TISSUES`](crate::physics::TISSUES) have published values; others need `young`.
#[derive(Clone, Debug, Default)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
pub struct MaterialEntry {
    /// `springs`, `neo-hookean` or `corotated`; default: `neo-hookean` for tetrahedral bodies
    /// without spring stiffness or damping, and `springs` for grids and cages.
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::material_model", extend("examples" = ["corotated"])))]
    pub model: Option<MaterialModel>,
    /// Young's modulus in Pa; springs have ν = ¼.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "Pa", "default" = 30_000.0, "exclusiveMinimum" = 0.0, "examples" = [2e4])))]
    pub young: Option<f64>,
    /// Poisson's ratio, for finite elements.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0.4, "minimum" = 0.0, "maximum" = 0.499, "examples" = [0.45])))]
    pub poisson: Option<f64>,
    /// Volumetric formulation of finite elements: `per-tet`, or `averaged`, which avoids volumetric
    /// locking as ν approaches ½.
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::volume", extend("default" = "per-tet", "examples" = ["averaged"])))]
    pub volume: Option<VolumetricFormulation>,
    /// Order of finite elements: 1 (linear tets), 2 (quadratic tets, each with ten nodes), which need
    /// far fewer tets for the same error, or `auto`; default: 1, and for a single press `auto`. Of
    /// ten-node tets in a file, order 1 uses the corners and order 2 the mid-edge nodes, too.
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::order", extend("examples" = [2, "auto"])))]
    pub order: Option<OrderChoice>,
    /// One spring stiffness κ for all edges, in N/m (the paper's); instead of `young`.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "N/m", "exclusiveMinimum" = 0.0, "examples" = [3000.0])))]
    pub stiffness: Option<f64>,
    /// Field of the tetrahedra, or else of the nodes, that scales the stiffness.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["stiffness"])))]
    pub stiffness_field: Option<String>,
    /// Density in kg/m³.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "kg/m³", "default" = 1060.0, "exclusiveMinimum" = 0.0, "examples" = [1000.0])))]
    pub density: Option<f64>,
    /// Damping κ_d of each spring, in N·s/m.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "N·s/m", "minimum" = 0.0, "examples" = [0.5])))]
    pub damping: Option<f64>,
    /// Damping ratio ζ at `damping_hz`, for finite elements; see [`Material::with_damping_ratio`].
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 0.0, "examples" = [0.05])))]
    pub damping_ratio: Option<f64>,
    /// Reference frequency of `damping_ratio`, Hz.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "Hz", "exclusiveMinimum" = 0.0, "examples" = [2.0])))]
    pub damping_hz: Option<f64>,
    /// `axial` or `relative` (the paper's).
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::damping_kind", extend("examples" = ["relative"])))]
    pub damping_kind: Option<String>,
    /// Largest ratio of the stiffness of a tissue to that of the softest one: implicit steps take
    /// longer for larger ratios, and above some hundreds the difference is not visible.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 1.0, "examples" = [300.0])))]
    pub max_stiffness_ratio: Option<f64>,
    /// Tissues by name.
    #[cfg_attr(feature = "cli", schemars(flatten))]
    pub(crate) tissues: Tissues,
}

type Tissues = BTreeMap<String, TissueEntry>;

/// A tissue and its regions.
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(
    untagged,
    expecting = "neither a key of [material] nor a tissue: a tissue must be a list of regions, or a table with some of `regions`, `young`, `poisson`, `density` and `rigid`"
)]
pub(crate) enum TissueEntry {
    /// Regions by label or name.
    Regions(Vec<LabelOrName>),
    /// Regions and material parameters.
    Table(TissueTable),
}

/// A tissue with its own parameters.
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct TissueTable {
    /// Regions by label or name; default: those whose names contain the name of the tissue.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [["femur", 6]])))]
    pub regions: Option<Vec<LabelOrName>>,
    /// Young's modulus in Pa.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "Pa", "exclusiveMinimum" = 0.0, "examples" = [1e6])))]
    pub young: Option<f64>,
    /// Poisson's ratio, for finite elements.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 0.0, "maximum" = 0.499, "examples" = [0.45])))]
    pub poisson: Option<f64>,
    /// Density in kg/m³.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "kg/m³", "exclusiveMinimum" = 0.0, "examples" = [1200.0])))]
    pub density: Option<f64>,
    /// Whether its regions are rigid bodies: requires finite elements and an implicit scheme. Such
    /// a tissue needs no `young`.
    #[serde(default)]
    pub rigid: bool,
}

impl MaterialEntry {
    /// Checks that a body of springs has no rigid tissues.
    fn check_rigid(&self, model: MaterialModel) -> Result<()> {
        let rigid = self.tissues.iter().find(|(_, tissue)| tissue.is_rigid());
        match (rigid, model) {
            (Some((name, _)), MaterialModel::Springs) => Err(Error::Input(format!(
                "`{name}` is rigid, but springs do not support rigid regions; set model = \"neo-hookean\" (or \"corotated\"), and remove the stiffness and damping of springs"
            ))),
            _ => Ok(()),
        }
    }

    /// Returns the material model. Default: finite elements for tetrahedral bodies, and springs for
    /// bodies that support only these or with a spring stiffness or damping.
    pub(super) fn model(&self, of_tets: bool) -> MaterialModel {
        let damping = self.damping.is_some_and(|damping| damping != 0.0);
        let of_springs = self.stiffness.is_some() || damping || self.damping_kind.is_some();
        self.model.unwrap_or(match of_tets && !of_springs {
            true => MaterialModel::NeoHookean,
            false => MaterialModel::Springs,
        })
    }

    /// Returns the name of each tissue that is not rigid, and Young's modulus in Pa if the entry
    /// states it.
    pub fn soft_tissues(&self) -> impl Iterator<Item = (&str, Option<f64>)> {
        let soft = self.tissues.iter().filter(|(_, tissue)| !tissue.is_rigid());
        soft.map(|(name, tissue)| match tissue {
            TissueEntry::Regions(_) => (name.as_str(), None),
            TissueEntry::Table(table) => (name.as_str(), table.young),
        })
    }

    /// Returns Poisson's ratio of regions without a tissue.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid material.
    pub fn poisson_of(&self, mesh: &TetMesh) -> Result<f64> {
        Ok(self.material(mesh, true)?.0.poisson)
    }

    /// Returns the material of a tetrahedral body (or lattice) or of a particle grid, and notes of
    /// the tissues of its regions. Defaults are those of [`Material::soft_tissue`], except for the
    /// model.
    pub(super) fn material(
        &self,
        mesh: &TetMesh,
        of_tets: bool,
    ) -> Result<(Material, Vec<String>)> {
        let mut material = match (self.young, self.stiffness) {
            (Some(_), Some(_)) => {
                return Err(Error::Input(
                    "the material has both `young` and `stiffness`; remove one of them".into(),
                ));
            }
            (None, Some(kappa)) => Material {
                stiffness: Stiffness::Uniform(kappa),
                damping_time: 0.0,
                ..Material::soft_tissue()
            },
            (Some(young), None) => Material {
                stiffness: Stiffness::Young(young),
                ..Material::soft_tissue()
            },
            (None, None) => Material::soft_tissue(),
        };
        material.model = self.model(of_tets);
        if let Some(poisson) = self.poisson {
            material.poisson = poisson;
        }
        self.check_rigid(material.model)?;
        if let Some(volume) = self.volume {
            material.volume = volume;
        }
        material.stiffness_scale_field = self.stiffness_field.clone();
        if let Some(density) = self.density {
            material.density = density;
        }
        if let Some(damping) = self.damping {
            material.damping = damping;
            material.damping_time = 0.0;
        }
        if let Some((ratio, frequency)) = self.ratio(material.model)? {
            material = material.with_damping_ratio(ratio, frequency);
        }
        material.damping_kind = match self.damping_kind.as_deref() {
            None => Damping::default(),
            Some("axial") => Damping::Axial,
            Some("relative") => Damping::Relative,
            Some(other) => {
                return Err(unknown_keyword_error("damping kind", &DAMPING_KINDS, other));
            }
        };
        let notes = self.add_tissues(mesh, &mut material)?;
        Ok((material, notes))
    }

    /// Whether any damping is set.
    pub(super) fn says_damping(&self) -> bool {
        self.damping.is_some() || self.damping_ratio.is_some()
    }

    /// Returns the damping ratio and its reference frequency.
    fn ratio(&self, model: MaterialModel) -> Result<Option<(f64, f64)>> {
        let wrong = |why: String| Err(Error::Input(why));
        let (ratio, frequency) = match (self.damping_ratio, self.damping_hz) {
            (None, None) => return Ok(None),
            (Some(ratio), Some(frequency)) => (ratio, frequency),
            _ => {
                return wrong("a damping ratio requires its reference frequency; set both `damping_ratio` and `damping_hz`, such as damping_ratio = 0.05 and damping_hz = 2".into());
            }
        };
        if self.damping.is_some() {
            return wrong(
                "the material has both `damping` and `damping_ratio`; remove one of them".into(),
            );
        }
        if model == MaterialModel::Springs {
            return wrong("a damping ratio requires finite elements; for a tetrahedral body set model = \"neo-hookean\" (or --material neo-hookean) and Young's modulus, for springs set `damping`".into());
        }
        let sound = ratio >= 0.0 && ratio.is_finite() && frequency > 0.0 && frequency.is_finite();
        match sound {
            true => Ok(Some((ratio, frequency))),
            false => wrong(format!(
                "the damping ratio must be ≥ 0 and its frequency positive, got {ratio} at {frequency} Hz"
            )),
        }
    }

    fn add_tissues(&self, mesh: &TetMesh, material: &mut Material) -> Result<Vec<String>> {
        if self.tissues.is_empty() {
            return Ok(Vec::new());
        }
        if self.stiffness.is_some() {
            return Err(Error::Input(
                "tissues require `young`, not `stiffness`: their stiffness is a Young's modulus"
                    .into(),
            ));
        }
        let labels = mesh.field("label", Location::Cell);
        let Some(labels) = labels.or_else(|| mesh.region_field()) else {
            return Err(Error::Input(
                "tissues require a cell field of integer region labels, such as `label`; the mesh has none".into(),
            ));
        };
        material.region_field = Some(labels.name.clone());
        let mut made = Vec::new();
        for (name, entry) in &self.tissues {
            let (chosen, region) = entry.resolve(name, mesh, self)?;
            for label in chosen {
                if material.regions.insert(label, region).is_some() {
                    return Err(Error::Input(format!(
                        "region {} is assigned to two tissues, \"{name}\" and another; assign it to one",
                        described(mesh, label)
                    )));
                }
                if entry.is_rigid() {
                    material.rigid.insert(label);
                }
                made.push((label, name));
            }
        }
        let rest = labels
            .values
            .iter()
            .any(|l| !material.regions.contains_key(&(l.round() as i64)));
        self.limit_stiffness(material, rest)?;
        Ok(made
            .iter()
            .map(|(label, name)| {
                let region = material.regions[label];
                if material.rigid.contains(label) {
                    return format!(
                        "{} is {name}, rigid: {} kg/m³",
                        described(mesh, *label),
                        region.density
                    );
                }
                format!(
                    "{} is {name}: {:.3e} Pa,{} {} kg/m³",
                    described(mesh, *label),
                    region.stiffness,
                    match material.model {
                        MaterialModel::Springs => String::new(),
                        _ => format!(" ν = {},", region.poisson),
                    },
                    region.density
                )
            })
            .collect())
    }

    /// Reduces stiffnesses above `max_stiffness_ratio` times that of the softest region; `rest` is whether
    /// some tetrahedra belong to no tissue.
    fn limit_stiffness(&self, material: &mut Material, rest: bool) -> Result<()> {
        let Some(max_ratio) = self.max_stiffness_ratio else {
            return Ok(());
        };
        if !max_ratio.is_finite() || max_ratio < 1.0 {
            return Err(Error::Input(format!(
                "max_stiffness_ratio (of two tissues) must be ≥ 1, got {max_ratio}"
            )));
        }
        let own = match material.stiffness {
            Stiffness::Young(young) if rest => young,
            _ => f64::INFINITY,
        };
        let soft = material
            .regions
            .iter()
            .filter(|(l, _)| !material.rigid.contains(l));
        let softest = soft.map(|(_, r)| r.stiffness).fold(own, f64::min);
        for region in material.regions.values_mut() {
            region.stiffness = region.stiffness.min(max_ratio * softest);
        }
        if let Stiffness::Young(young) = &mut material.stiffness {
            *young = young.min(max_ratio * softest);
        }
        Ok(())
    }
}

impl TissueEntry {
    pub(crate) fn is_rigid(&self) -> bool {
        matches!(self, TissueEntry::Table(table) if table.rigid)
    }

    fn table(&self) -> TissueTable {
        match self {
            TissueEntry::Regions(regions) => TissueTable {
                regions: Some(regions.clone()),
                ..TissueTable::default()
            },
            TissueEntry::Table(table) => table.clone(),
        }
    }

    /// Returns the parameters of the tissue `name`.
    fn parameters(&self, name: &str, entry: &MaterialEntry) -> Result<RegionMaterial> {
        let table = self.table();
        let default = Material::soft_tissue();
        let (young, poisson, density) = match (Tissue::by_name(name), table.young) {
            (Ok(tissue), young) => (
                young.unwrap_or(tissue.young),
                tissue.poisson,
                tissue.density,
            ),
            (Err(_), Some(young)) => {
                let density = entry.density.unwrap_or(default.density);
                (young, entry.poisson.unwrap_or(default.poisson), density)
            }
            // The stiffness of a rigid tissue has no effect.
            (Err(_), None) if table.rigid => {
                let density = entry.density.unwrap_or(default.density);
                let young = entry.young.unwrap_or(match default.stiffness {
                    Stiffness::Young(e) | Stiffness::Uniform(e) => e,
                });
                (young, default.poisson, density)
            }
            (Err(unknown), None) => {
                return Err(Error::Input(format!(
                    "{unknown}; a custom tissue requires `young` (Pa)"
                )));
            }
        };
        Ok(RegionMaterial {
            stiffness: young,
            density: table.density.unwrap_or(density),
            poisson: table.poisson.unwrap_or(poisson),
        })
    }

    /// Returns the labels of the tissue `name`, and its parameters.
    fn resolve(
        &self,
        name: &str,
        mesh: &TetMesh,
        entry: &MaterialEntry,
    ) -> Result<(Vec<i64>, RegionMaterial)> {
        let labels = match &self.table().regions {
            Some(regions) => regions
                .iter()
                .map(|r| r.label(mesh))
                .collect::<Result<Vec<i64>>>()?,
            None => named_like(name, mesh)?,
        };
        Ok((labels, self.parameters(name, entry)?))
    }
}

/// Returns the regions whose names contain the words of `name`.
fn named_like(name: &str, mesh: &TetMesh) -> Result<Vec<i64>> {
    let words = |text: &str| -> Vec<String> {
        text.split(|c: char| !c.is_alphanumeric())
            .filter(|w| !w.is_empty())
            .map(str::to_lowercase)
            .collect()
    };
    let wanted = words(name);
    let labels: Vec<i64> = mesh
        .region_names
        .iter()
        .filter(|(_, region)| words(region).windows(wanted.len()).any(|w| w == wanted))
        .map(|(label, _)| *label)
        .collect();
    if labels.is_empty() {
        let known: Vec<&str> = mesh.region_names.values().map(String::as_str).collect();
        return Err(Error::Input(format!(
            "no region of the mesh has \"{name}\" in its name ({}); list the regions: {name} = [LABEL, …]",
            match known.as_slice() {
                [] => "its regions have no names".to_owned(),
                _ => format!("the regions are {}", known.join(", ")),
            }
        )));
    }
    Ok(labels)
}

fn described(mesh: &TetMesh, label: i64) -> String {
    match mesh.region_names.get(&label) {
        Some(name) => format!("{name} ({label})"),
        None => format!("region {label}"),
    }
}
