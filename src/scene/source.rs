//! From a scene's `[mesh]` and `field` to a mesh and the scalar that is seen.

use super::{LabelsEntry, MeshSource, Scene};
use crate::io::{self, Kind};
use crate::mesh::{Field, Location, TetMesh, Topology, depth_field, generate};
use crate::mesher::{Labels, Recipe, Size};
use crate::render::Scalars;
use crate::{Error, Result};

/// Names that readers give to reference numbers: labels, not quantities.
const LABEL_FIELDS: [&str; 3] = ["gmsh:", "medit:", "tetgen:"];
/// The most tets that a scene may ask a generator for.
const MOST_TETS: usize = 20_000_000;

impl MeshSource {
    /// Reads or generates the mesh.
    ///
    /// # Errors
    /// [`Error::Input`] when neither or both of a file and a generator are named, or the
    /// generator is not known; otherwise what reading gives.
    pub fn load(&self) -> Result<TetMesh> {
        match (&self.file, &self.generate) {
            (Some(file), None) if io::kind(file)? == Kind::Mesh => io::read(file),
            (Some(_), None) => self.made(),
            (None, Some(name)) => match self.tets {
                Some(tets) if !(1..=MOST_TETS).contains(&tets) => Err(Error::Input(format!(
                    "tets = {tets} cannot be generated; ask for 1 to {MOST_TETS}"
                ))),
                tets => generate::by_name(name, tets),
            },
            _ => Err(Error::Input(
                "[mesh] needs either file = \"…\" or generate = \"…\"".into(),
            )),
        }
    }
}

impl MeshSource {
    /// The mesh of a volume or a closed surface.
    fn made(&self) -> Result<TetMesh> {
        let made = self.recipe()?.mesh(&|_, _| {})?;
        let mut mesh = made.mesh;
        mesh.repairs.warnings.extend(made.notes);
        Ok(mesh)
    }

    /// What to make of the file.
    pub(super) fn recipe(&self) -> Result<Recipe> {
        let Some(file) = &self.file else {
            return Err(Error::Input(
                "[mesh] needs file = \"…\" here: a volume, a closed surface or a tet mesh".into(),
            ));
        };
        Ok(Recipe {
            input: vec![file.clone()],
            labels: self.labels.as_ref().map(|labels| match labels {
                LabelsEntry::All(_) => Labels::All,
                LabelsEntry::These(labels) => Labels::These(labels.clone()),
            }),
            above: self.above.clone(),
            between: self.between.clone(),
            size: match (self.edge, self.tets) {
                (Some(_), Some(_)) => {
                    return Err(Error::Input(
                        "[mesh] has both `edge` and `tets`; give one of them".into(),
                    ));
                }
                (Some(edge), None) => Some(Size::Edge(edge)),
                (None, tets) => tets.map(Size::Tets),
            },
            grading: self.grading,
            min_island: self.min_island,
            unit: self.unit.as_ref().map(|u| u.metres()).transpose()?,
            ..Recipe::default()
        })
    }
}

/// The scalar that a picture shows, one value a node.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Its name.
    pub name: String,
    /// One value a node.
    pub values: Vec<f64>,
    /// One value a tet, constant in it, where the field is one of cells; `values` are their
    /// means around each node.
    pub cells: Option<Vec<f64>>,
    /// Smallest and largest value.
    pub range: (f64, f64),
    /// How it was come by, when nobody asked for it.
    pub note: Option<String>,
}

impl Seen {
    /// The values, as a geometry takes them.
    pub fn scalars(&self) -> Scalars<'_> {
        match &self.cells {
            Some(cells) => Scalars::Cells(cells),
            None => Scalars::Nodes(&self.values),
        }
    }
}

impl Scene {
    /// The scalar to see: the field named by the scene, else the first scalar node field that
    /// varies, else the cell field `label` if it does, else the depth below the surface. Vectors
    /// are seen by their length.
    ///
    /// # Errors
    /// [`Error::Input`] listing the fields when the one named does not exist or is not finite.
    pub fn seen(&self, mesh: &TetMesh, topology: &Topology) -> Result<Seen> {
        let found = || first_scalar(mesh).or_else(|| labels(mesh)).cloned();
        let (field, note) = match &self.picture.field {
            Some(name) => (named_field(mesh, name)?, None),
            None => match found() {
                Some(field) => (field, None),
                None => (
                    depth_field(mesh, topology),
                    Some("the mesh has no scalar field that varies: seen is the depth below its surface".to_owned()),
                ),
            },
        };
        let scalars = tuple_lengths(&field);
        let (values, cells) = match field.location {
            Location::Node => (scalars, None),
            Location::Cell => (means_around_nodes(mesh, &scalars), Some(scalars)),
        };
        if let Some(bad) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::Input(format!(
                "field \"{}\" is not a finite number at node {bad}, so it cannot be drawn",
                field.name
            )));
        }
        let range = cells
            .as_ref()
            .unwrap_or(&values)
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
                (a.min(*v), b.max(*v))
            });
        Ok(Seen {
            name: field.name,
            values,
            cells,
            range,
            note,
        })
    }
}

fn named_field(mesh: &TetMesh, name: &str) -> Result<Field> {
    let found = mesh
        .field(name, Location::Node)
        .or_else(|| mesh.field(name, Location::Cell));
    found.cloned().ok_or_else(|| {
        let names: Vec<&str> = mesh.fields.iter().map(|f| f.name.as_str()).collect();
        Error::Input(match names.as_slice() {
            [] => format!("there is no field \"{name}\": the mesh has none"),
            _ => format!(
                "there is no field \"{name}\"; there are {}",
                names.join(", ")
            ),
        })
    })
}

fn first_scalar(mesh: &TetMesh) -> Option<&Field> {
    mesh.fields.iter().find(|f| {
        f.location == Location::Node
            && f.components == 1
            && f.range().is_some_and(|(low, high)| low < high)
            && !LABEL_FIELDS.iter().any(|prefix| f.name.starts_with(prefix))
    })
}

/// The labels of the regions, if there are several.
fn labels(mesh: &TetMesh) -> Option<&Field> {
    let field = mesh.field("label", Location::Cell)?;
    let varies = field.range().is_some_and(|(low, high)| low < high);
    (field.components == 1 && varies).then_some(field)
}

/// One number for each tuple: vectors by their length.
fn tuple_lengths(field: &Field) -> Vec<f64> {
    match field.components {
        1 => field.values.clone(),
        n => field
            .values
            .chunks_exact(n)
            .map(|tuple| tuple.iter().map(|x| x * x).sum::<f64>().sqrt())
            .collect(),
    }
}

/// The volume-weighted mean around each node.
fn means_around_nodes(mesh: &TetMesh, scalars: &[f64]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); mesh.nodes.len()];
    for (t, (tet, value)) in mesh.tets.iter().zip(scalars).enumerate() {
        let weight = mesh.tet_volume(t);
        for v in tet {
            let sum = &mut sums[*v as usize];
            *sum = (sum.0 + weight * value, sum.1 + weight);
        }
    }
    // Nodes of no tet, as grids have them, are never seen.
    let unseen = scalars.first().copied().unwrap_or(0.0);
    sums.iter()
        .map(|(sum, weight)| if *weight > 0.0 { sum / weight } else { unseen })
        .collect()
}
