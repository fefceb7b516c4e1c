//! What is measured of a body at rest under its loads, apart from recordings of markers: displacement
//! fields, reactions of supports and volumes of regions.

use super::data::Observed;
use crate::mesh::{Location, TetMesh};
use crate::physics::Quantity;
use crate::scene::{LabelOrName, Region};
use crate::{Error, Result, io};
use glam::DVec3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Largest number of points of a displacement field that are compared, unless set.
const POINTS: usize = 40;
/// Largest distance of its points from the body, relative to the diagonal of the body.
const MAX_DISTANCE: f64 = 0.05;
/// Millilitres in a m³, and metres in a millimetre.
const MILLILITRES: f64 = 1e6;
const MILLIMETRE: f64 = 1e-3;

/// A measured displacement field: a mesh with vectors at its nodes, in its own unit, which is that of the
/// body; or a volume of vectors in millimetres, LPS.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DisplacementsEntry {
    file: PathBuf,
    /// Field of the nodes; default `displacement`.
    field: Option<String>,
    /// Whether the nodes of the file are where they have moved to, not where they were at rest.
    #[serde(default)]
    moved: bool,
    /// Number of points that are compared.
    points: Option<usize>,
    /// Points at rest and vectors, in file units, instead of a file.
    #[serde(skip)]
    given: Option<Vec<(DVec3, DVec3)>>,
}

/// A measured force on supports.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ReactionEntry {
    /// The fixed nodes.
    on: Region,
    direction: [f64; 3],
    newton: f64,
}

/// A measured volume of a region.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VolumeEntry {
    region: LabelOrName,
    ml: f64,
}

/// Points of the body at rest, in file units, and how far they move, m.
#[derive(Clone, Debug, Default)]
pub(super) struct PointDisplacements {
    pub places: Vec<DVec3>,
    pub displacements: Vec<DVec3>,
}

/// Reactions and volumes.
#[derive(Clone, Debug, Default)]
pub(super) struct Readings {
    pub reactions: Vec<ReactionEntry>,
    pub volumes: Vec<VolumeEntry>,
}

impl DisplacementsEntry {
    /// Returns an entry for a file by itself.
    pub fn of_file(file: &Path) -> DisplacementsEntry {
        DisplacementsEntry {
            file: file.to_owned(),
            field: None,
            moved: false,
            points: None,
            given: None,
        }
    }

    /// Returns an entry of points at rest and vectors, in file units.
    pub fn of_points(points: Vec<(DVec3, DVec3)>) -> DisplacementsEntry {
        DisplacementsEntry {
            points: Some(points.len()),
            given: Some(points),
            ..DisplacementsEntry::of_file(Path::new(""))
        }
    }

    /// Reads points that are spread over the field, evenly by number, for a body whose unit is `unit` metres.
    ///
    /// # Errors
    /// [`Error::Format`] or [`Error::Io`] naming the file and what it lacks.
    pub fn read(&self, folder: &Path, unit: f64) -> Result<PointDisplacements> {
        if let Some(given) = &self.given {
            return Ok(self.spread(given.clone(), unit));
        }
        let path = folder.join(&self.file);
        if is_volume(&path) {
            return self.of_volume(&path, unit);
        }
        let mesh = io::read(&path)?;
        let name = self.field.as_deref().unwrap_or("displacement");
        let field = mesh.field(name, Location::Node);
        let field = field.filter(|field| field.components == 3).ok_or_else(|| {
            Error::format(
                &path,
                format!(
                    "the mesh has no vectors \"{name}\" at its nodes; name the field (`field`)"
                ),
            )
        })?;
        let vectors = field.values.as_chunks::<3>().0.iter();
        let vectors = vectors.map(|v| DVec3::from(*v));
        let known = mesh.nodes.iter().copied().zip(vectors);
        let known: Vec<(DVec3, DVec3)> = known.filter(|(_, v)| v.is_finite()).collect();
        if known.is_empty() {
            return Err(Error::format(
                &path,
                format!("no vector of \"{name}\" is finite"),
            ));
        }
        Ok(self.spread(known, unit))
    }

    /// Reads the vectors of a volume, in millimetres along the axes of LPS, at the centres of its voxels; those
    /// that are 0 are outside of the body, or held.
    fn of_volume(&self, path: &Path, unit: f64) -> Result<PointDisplacements> {
        let component = |n: usize| io::read_volume_number(path, Some(n));
        let [x, y, z] = [component(0)?, component(1)?, component(2)?];
        let mut known = Vec::new();
        for n in 0..x.voxels() {
            let vector = DVec3::new(-x.value(n), -y.value(n), z.value(n));
            if vector.is_finite() && vector != DVec3::ZERO {
                let [wide, deep, _] = x.size;
                let at = x.centre(n % wide, n / wide % deep, n / (wide * deep));
                known.push((MILLIMETRE / unit * at, MILLIMETRE / unit * vector));
            }
        }
        match known.is_empty() {
            true => Err(Error::format(
                path,
                "all vectors of the displacement field are 0; it needs millimetres (LPS) in three components, as palpate warp --displacement writes it".to_owned(),
            )),
            false => Ok(self.spread(known, unit)),
        }
    }

    /// Returns some of these nodes and vectors, spread by number, with vectors in metres.
    fn spread(&self, known: Vec<(DVec3, DVec3)>, unit: f64) -> PointDisplacements {
        let count = self.points.unwrap_or(POINTS).clamp(1, known.len().max(1));
        let mut found = PointDisplacements::default();
        for n in 0..count.min(known.len()) {
            let (own, vector) = known[(2 * n + 1) * known.len() / (2 * count)];
            let at_rest = match self.moved {
                true => own - vector,
                false => own,
            };
            found.places.push(at_rest);
            found.displacements.push(unit * vector);
        }
        found
    }
}

/// Whether a file is a volume, by its name.
fn is_volume(path: &Path) -> bool {
    let name = path.to_string_lossy().to_lowercase();
    [".nii", ".nii.gz", ".mha", ".nrrd"]
        .iter()
        .any(|extension| name.ends_with(extension))
}

impl PointDisplacements {
    /// Checks that the points are of a body with these bounds, in file units.
    ///
    /// # Errors
    /// [`Error::Input`] for points of another body.
    pub fn check(&self, (low, high): (DVec3, DVec3)) -> Result<()> {
        let most = MAX_DISTANCE * low.distance(high);
        let outside = |p: &&DVec3| p.clamp(low, high).distance(**p) > most;
        match self.places.iter().find(outside) {
            None => Ok(()),
            Some(p) => Err(Error::Input(format!(
                "a point of the displacement field, {p}, is outside of the body ({low} to {high}, file units): the data are of another body, or in another unit or frame; set `moved = true` if the nodes of the file are where they have moved to"
            ))),
        }
    }
}

impl Readings {
    /// Returns the measured numbers.
    pub fn observed(&self) -> Vec<Observed> {
        let number = |quantity: String, value: f64| Observed {
            quantity,
            at: DVec3::ZERO,
            weights: Vec::new(),
            depth: 0.0,
            value,
            scale: value.abs(),
        };
        let reactions = self.reactions.iter();
        let reactions = reactions.map(|own| number("reaction (N)".into(), own.newton));
        let volumes = self.volumes.iter();
        let volumes = volumes.map(|own| number("volume (ml)".into(), own.ml));
        reactions.chain(volumes).collect()
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn check(&self) -> std::result::Result<(), String> {
        let sound = |x: f64| x.is_finite() && x != 0.0;
        for own in &self.reactions {
            let direction = DVec3::from(own.direction);
            let has_direction = direction.is_finite() && direction.length() > 0.0;
            if !(sound(own.newton) && has_direction) {
                return Err(
                    "a [[reaction]] needs a finite force `newton` other than 0, and a direction"
                        .into(),
                );
            }
        }
        match self.volumes.iter().all(|own| sound(own.ml) && own.ml > 0.0) {
            true => Ok(()),
            false => Err("a [[volume]] needs a positive volume `ml`".into()),
        }
    }

    /// Returns the quantities of a body, whose file unit is `unit` metres, with their factors to the units of
    /// the measured numbers.
    ///
    /// # Errors
    /// [`Error::Input`] for supports or regions that do not exist.
    pub fn quantities(&self, mesh: &TetMesh, unit: f64) -> Result<Vec<(Quantity, f64)>> {
        let mut all = Vec::new();
        for own in &self.reactions {
            let quantity = Quantity::PinReaction {
                nodes: own.on.nodes(mesh)?,
                direction: DVec3::from(own.direction).normalize(),
            };
            all.push((quantity, 1.0));
        }
        for own in &self.volumes {
            let label = own.region.label(mesh)?;
            let field = mesh.region_field().ok_or_else(|| {
                Error::Input("the mesh has no regions; a [[volume]] needs one".into())
            })?;
            let tets: Vec<u32> = (0..mesh.tets.len() as u32)
                .filter(|t| field.values[*t as usize] == label as f64)
                .collect();
            if tets.is_empty() {
                return Err(Error::Input(format!(
                    "region {label} has no tets ([[volume]])"
                )));
            }
            all.push((Quantity::Volume { tets }, unit.powi(3) * MILLILITRES));
        }
        Ok(all)
    }
}
