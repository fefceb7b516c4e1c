//! Values of a tissue, or of what is no tissue: read and changed by name.

use super::{MaterialEntry, TissueEntry, TissueTable};
use crate::mesh::{Location, TetMesh};
use crate::physics::{Material, Stiffness};
use crate::{Error, Result};

impl MaterialEntry {
    /// Returns Young's modulus of a tissue, or of regions without one, Pa.
    ///
    /// # Errors
    /// [`Error::Input`] for a tissue that the material lacks, or one without Young's modulus.
    pub(crate) fn young_of(&self, tissue: Option<&str>) -> Result<f64> {
        match tissue {
            Some(name) => Ok(self.tissue(name)?.parameters(name, self)?.stiffness),
            None if self.stiffness.is_some() => Err(Error::Input(
                "springs of one `stiffness` have no Young's modulus; set `young` instead".into(),
            )),
            None => Ok(self
                .young
                .unwrap_or_else(|| match Material::soft_tissue().stiffness {
                    Stiffness::Young(young) | Stiffness::Uniform(young) => young,
                })),
        }
    }

    /// As [`MaterialEntry::young_of`], for Poisson's ratio.
    pub(crate) fn poisson_of_tissue(&self, tissue: Option<&str>) -> Result<f64> {
        match tissue {
            Some(name) => Ok(self.tissue(name)?.parameters(name, self)?.poisson),
            None => Ok(self.poisson.unwrap_or(Material::soft_tissue().poisson)),
        }
    }

    /// Sets Young's modulus of a tissue, or of regions without one, Pa.
    pub(crate) fn set_young(&mut self, tissue: Option<&str>, young: f64) {
        match tissue {
            None => self.young = Some(young),
            Some(name) => self.change_tissue(name, |table| table.young = Some(young)),
        }
    }

    /// As [`MaterialEntry::set_young`], for Poisson's ratio.
    pub(crate) fn set_poisson(&mut self, tissue: Option<&str>, poisson: f64) {
        match tissue {
            None => self.poisson = Some(poisson),
            Some(name) => self.change_tissue(name, |table| table.poisson = Some(poisson)),
        }
    }

    /// As [`MaterialEntry::young_of`], for the density, kg/m³.
    pub(crate) fn density_of(&self, tissue: Option<&str>) -> Result<f64> {
        match tissue {
            Some(name) => Ok(self.tissue(name)?.parameters(name, self)?.density),
            None => Ok(self.density.unwrap_or(Material::soft_tissue().density)),
        }
    }

    /// As [`MaterialEntry::set_young`], for the density, kg/m³.
    pub(crate) fn set_density(&mut self, tissue: Option<&str>, density: f64) {
        match tissue {
            None => self.density = Some(density),
            Some(name) => self.change_tissue(name, |table| table.density = Some(density)),
        }
    }

    /// Returns the damping ratio.
    ///
    /// # Errors
    /// [`Error::Input`] without one, whose reference frequency is part of it.
    pub(crate) fn damping_ratio_at(&self) -> Result<f64> {
        self.damping_ratio.filter(|_| self.damping_hz.is_some()).ok_or_else(|| {
            Error::Input("a damping ratio is identified at a frequency; set one and a first value in the scene ([material] damping_ratio = 0.05, damping_hz = 5)".into())
        })
    }

    fn tissue(&self, name: &str) -> Result<&TissueEntry> {
        self.tissues.get(name).ok_or_else(|| {
            let known: Vec<&str> = self.tissues.keys().map(String::as_str).collect();
            Error::Input(format!(
                "[material] has no tissue \"{name}\"{}",
                match known.is_empty() {
                    true => "; it has none".to_owned(),
                    false => format!("; its tissues are {}", known.join(", ")),
                }
            ))
        })
    }

    fn change_tissue(&mut self, name: &str, change: impl FnOnce(&mut TissueTable)) {
        if let Some(tissue) = self.tissues.get_mut(name) {
            let mut table = tissue.table();
            change(&mut table);
            *tissue = TissueEntry::Table(table);
        }
    }

    /// Returns the tets of `mesh` that consist of a tissue that is not rigid, or of none.
    ///
    /// # Errors
    /// [`Error::Input`] for a tissue that the material lacks, or a rigid one.
    pub(crate) fn tets_of(&self, tissue: Option<&str>, mesh: &TetMesh) -> Result<Vec<u32>> {
        let (material, _) = self.material(mesh, true)?;
        let labels = match &material.region_field {
            Some(name) => mesh.field(name, Location::Cell),
            None => None,
        };
        let label = |t: u32| labels.map(|field| field.values[t as usize].round() as i64);
        let all = 0..mesh.tets.len() as u32;
        let Some(name) = tissue else {
            let is_free = |t: &u32| label(*t).is_none_or(|l| !material.regions.contains_key(&l));
            return Ok(all.filter(is_free).collect());
        };
        let entry = self.tissue(name)?;
        if entry.is_rigid() {
            return Err(Error::Input(format!(
                "{name} is rigid and has no stiffness; remove `rigid`"
            )));
        }
        let (chosen, _) = entry.resolve(name, mesh, self)?;
        let is_chosen = |t: &u32| label(*t).is_some_and(|l| chosen.contains(&l));
        Ok(all.filter(is_chosen).collect())
    }
}
