//! Loads the mesh of a scene's `[mesh]`, and selects the displayed scalar field.

use super::regions::Regions;
use super::{JoinEntry, LabelsEntry, MeshSource, Scene, missing_values};
use crate::generate;
use crate::generate::Lump;
use crate::io::{self, Kind};
use crate::mesh::{
    AnatomicalFrame, ElementOrder, Field, Location, TetCut, TetMesh, Topology, depth_field,
};
use crate::meshing::{Labels, MeshingConfig, TargetSize};
use crate::physics::BodyField;
use crate::render::{Scalars, TransferFunction};
use crate::{Error, ProgressFn, Result, no_progress};
use glam::{DQuat, DVec3};
use std::path::Path;

/// Prefixes of reference numbers set by readers: labels, not quantities.
const LABEL_FIELDS: [&str; 3] = ["gmsh:", "medit:", "tetgen:"];
/// Field that is the share of each tet in the estimated error of a body at rest, or of a press.
pub const ERROR_FIELD: &str = "error";
/// Transfer function of pictures without another one.
pub(super) const DEFAULT_PRESET: &str = "tissue";
/// A body whose mean chord is below this fraction of its extent is thin.
const THICK_CHORD_RATIO: f64 = 0.1;
/// Largest number of tetrahedra of a generator.
const MAX_TETS: usize = 20_000_000;

impl MeshSource {
    /// Reads or generates the mesh.
    ///
    /// # Errors
    /// [`Error::Input`] if not exactly one of a file and a generator is given, or the generator is
    /// unknown; otherwise an error of reading.
    pub fn load(&self) -> Result<TetMesh> {
        self.load_with_progress(&no_progress)
    }

    /// As [`MeshSource::load`], and reports the current task and its completed fraction to
    /// `progress` while a volume or surface is meshed or a phantom is generated.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; as [`MeshSource::load`].
    pub fn load_with_progress(&self, progress: ProgressFn) -> Result<TetMesh> {
        self.load_beside(&|| false, progress)
    }

    /// As [`MeshSource::load_with_progress`]; `meets_scan` is whether the mesh is combined with
    /// files of a known frame of reference.
    fn load_beside(&self, meets_scan: &dyn Fn() -> bool, progress: ProgressFn) -> Result<TetMesh> {
        let mut mesh = self.welded(meets_scan, progress)?;
        if !self.join.is_empty() {
            let others = self.join.iter().enumerate();
            let meets = || mesh.frame.is_some() || meets_scan();
            let others = others.map(|(k, other)| other.load(k, self.frame, &meets, progress));
            let mut others: Vec<(String, TetMesh)> = others.collect::<Result<_>>()?;
            // With ten-node tets in one mesh, all get them.
            let mut all = std::iter::once(&mesh).chain(others.iter().map(|(_, mesh)| mesh));
            if all.any(|mesh| mesh.order == ElementOrder::Quadratic) {
                mesh = mesh.with_mid_edge_nodes()?;
                for (_, other) in &mut others {
                    *other = other.with_mid_edge_nodes()?;
                }
            }
            let first = ("first".to_owned(), &mesh);
            let rest = others.iter().map(|(name, mesh)| (name.clone(), mesh));
            let parts: Vec<(String, &TetMesh)> = std::iter::once(first).chain(rest).collect();
            mesh = TetMesh::merge_meshes(&parts)?;
        }
        for [first, second] in &self.split {
            let doubles = mesh.split_interface(first.label(&mesh)?, second.label(&mesh)?)?;
            if let Some(gap) = self.split_gap {
                mesh.open_interface_gap(&doubles, gap)?;
            }
        }
        Ok(mesh)
    }

    /// Returns the lump of a generated organ.
    fn lump(&self) -> Result<Option<Lump>> {
        let lump_keys = [self.lump_mm, self.depth_mm, self.contrast];
        if lump_keys.iter().any(Option::is_some)
            && !self.generate.as_deref().is_some_and(generate::has_lump)
        {
            return Err(Error::Input(
                "lump_mm, depth_mm and contrast of [mesh] require generate = \"breast\" or \"liver\"; remove them".into(),
            ));
        }
        let usual = Lump::default();
        let lump = Lump {
            diameter: self.lump_mm.map_or(usual.diameter, |mm| 1e-3 * mm),
            depth: self.depth_mm.map_or(usual.depth, |mm| 1e-3 * mm),
            contrast: self.contrast.unwrap_or(usual.contrast),
        };
        Ok(Some(lump).filter(|lump| lump.diameter != 0.0))
    }

    fn welded(&self, meets_scan: &dyn Fn() -> bool, progress: ProgressFn) -> Result<TetMesh> {
        let lump = self.lump()?;
        match (&self.file, &self.generate) {
            (Some(file), None) if io::detect_kind(file)? == Kind::Mesh => {
                if self.volume.is_some() {
                    return Err(Error::Input(format!(
                        "[mesh] volume selects one of the volumes of a file, and {} is a mesh; remove it",
                        file.display()
                    )));
                }
                let mut mesh = io::read(file)?;
                if let (Some(frame), None) = (self.frame, mesh.frame) {
                    mesh.convert_to_ras(frame);
                }
                Ok(mesh)
            }
            (Some(_), None) => self.made(meets_scan(), progress),
            (None, Some(name)) => match self.tets {
                Some(tets) if !(1..=MAX_TETS).contains(&tets) => Err(Error::Input(format!(
                    "tets must be in [1, {MAX_TETS}], got {tets}"
                ))),
                tets => generate::by_name_with_progress(name, tets, lump, progress),
            },
            _ => Err(Error::Input(
                "[mesh] must have either file = \"…\" or generate = \"…\"".into(),
            )),
        }
    }
}

impl JoinEntry {
    /// Returns the transformed mesh and its name; `number` counts from 0.
    fn load(
        &self,
        number: usize,
        frame: Option<AnatomicalFrame>,
        meets_scan: &dyn Fn() -> bool,
        progress: ProgressFn,
    ) -> Result<(String, TetMesh)> {
        let source = MeshSource {
            frame,
            file: self.file.clone(),
            generate: self.generate.clone(),
            tets: self.tets,
            ..MeshSource::default()
        };
        let name = self.name.clone();
        let name = name.unwrap_or_else(|| format!("mesh{}", number + 2));
        let mut mesh = source.welded(meets_scan, progress)?;
        let axis = DVec3::from(self.axis.unwrap_or([0.0, 0.0, 1.0])).normalize_or_zero();
        let turn = DQuat::from_axis_angle(axis, self.turn.unwrap_or(0.0).to_radians());
        let offset = DVec3::from(self.offset.unwrap_or_default());
        if axis == DVec3::ZERO || !(turn.is_finite() && offset.is_finite()) {
            return Err(Error::Input(format!(
                "the [[mesh.join]] {name} has an invalid transform: `turn` and `offset` must be finite, and `axis` must not be zero"
            )));
        }
        mesh.nodes.iter_mut().for_each(|p| *p = turn * *p + offset);
        Ok((name, mesh))
    }
}

impl MeshSource {
    /// Meshes a volume or a closed surface.
    fn made(&self, meets_scan: bool, progress: ProgressFn) -> Result<TetMesh> {
        let recipe = MeshingConfig {
            meets_scan,
            ..self.recipe()?
        };
        let made = recipe.mesh(progress)?;
        let mut mesh = made.mesh;
        mesh.repairs.warnings.extend(made.notes);
        Ok(mesh)
    }

    /// Returns the meshing configuration of the file.
    pub(super) fn recipe(&self) -> Result<MeshingConfig> {
        let Some(file) = &self.file else {
            return Err(Error::Input(
                "[mesh] must have file = \"…\" here: a volume, a closed surface or a tet mesh"
                    .into(),
            ));
        };
        Ok(MeshingConfig {
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
                        "[mesh] has both `edge` and `tets`; remove one of them".into(),
                    ));
                }
                (Some(edge), None) => Some(TargetSize::Edge(edge)),
                (None, tets) => tets.map(TargetSize::Tets),
            },
            grading: self.grading,
            min_island: self.min_island,
            number: self.volume,
            unit: self.unit.as_ref().map(|u| u.metres()).transpose()?,
            frame: self.frame,
            ..MeshingConfig::default()
        })
    }
}

/// The scalar field displayed in a picture.
#[derive(Clone, Debug)]
pub struct ScalarField {
    /// Its name.
    pub name: String,
    /// One value per node.
    pub values: Vec<f64>,
    /// One value per tetrahedron for a cell field, constant within it; `values` are the means
    /// around each node.
    pub cells: Option<Vec<f64>>,
    /// Smallest and largest value.
    pub range: (f64, f64),
    /// Why the field was selected by default; for regions, the colour of each.
    pub note: Option<String>,
    /// Default transfer function of the field, such as that of regions.
    pub transfer: Option<TransferFunction>,
    /// Name and scalar of each region, for a region field.
    pub regions: Vec<(String, f64)>,
}

impl ScalarField {
    /// Returns the regions of `field`, numbered from 0, with their colours; with `unasked` the note
    /// names an alternative field.
    fn regions(
        mesh: &TetMesh,
        topology: &Topology,
        field: &Field,
        unasked: bool,
    ) -> Result<ScalarField> {
        let regions = Regions::new(mesh, topology, field)?;
        let also = first_scalar(mesh).filter(|_| unasked);
        let also = also.map(|f| format!("; show the scalar field with --field \"{}\"", f.name));
        Ok(ScalarField {
            name: field.name.clone(),
            values: mesh.volume_weighted_node_means(&regions.numbers),
            range: (0.0, (regions.count - 1) as f64),
            cells: Some(regions.numbers),
            note: Some(regions.legend + also.as_deref().unwrap_or("")),
            transfer: Some(regions.transfer),
            regions: names_of_regions(mesh, field)
                .enumerate()
                .map(|(i, (name, _))| (name, i as f64))
                .collect(),
        })
    }

    /// Applies a cut of the mesh: duplicated nodes get the values of their originals.
    pub(super) fn apply_cut(&mut self, cut: &TetCut) {
        for [_, from] in &cut.duplicated_nodes {
            self.values.push(self.values[*from as usize]);
        }
        if let Some(cells) = self.cells.as_mut().filter(|_| !cut.removed.is_empty()) {
            let mut removed = cut.removed.iter().peekable();
            let mut t = 0..;
            cells.retain(|_| removed.next_if_eq(&&t.next().unwrap_or(u32::MAX)).is_none());
        }
    }

    /// Returns the values in the form that a geometry takes.
    pub fn scalars(&self) -> Scalars<'_> {
        match &self.cells {
            Some(cells) => Scalars::Cells(cells),
            None => Scalars::Nodes(&self.values),
        }
    }
}

impl Scene {
    /// Reads or generates the mesh of a scene of one body. A surface that states no frame of
    /// reference is taken as LPS if it meets scans, or skins that state theirs.
    ///
    /// # Errors
    /// As [`MeshSource::load_with_progress`].
    pub fn load_mesh(&self, progress: ProgressFn) -> Result<TetMesh> {
        self.mesh.load_beside(&|| self.meets_scan(), progress)
    }

    /// Whether the scene has scans, or skins whose frame of reference is known.
    pub(super) fn meets_scan(&self) -> bool {
        // Errors of reading are reported where the skin is loaded.
        let is_known = |file: &Path| match io::detect_kind(file) {
            Ok(Kind::Volume) => true,
            Ok(Kind::Surface) => io::read_surface(file).is_ok_and(|s| s.frame.is_some()),
            _ => false,
        };
        !self.scan.is_empty() || self.skin.iter().any(|skin| is_known(&skin.file))
    }

    /// Returns the default transfer function of a body that is thin relative to its extent, with an
    /// extinction at which it is as opaque as a thick one; `None` for others and with a given one.
    fn transfer_of_thin_body(
        &self,
        mesh: &TetMesh,
        topology: &Topology,
    ) -> Result<Option<TransferFunction>> {
        let (low, high) = mesh.bounds();
        let thick = THICK_CHORD_RATIO * (high - low).max_element();
        let chord = topology.mean_chord(mesh);
        if self.picture.transfer.is_some() || chord >= thick || chord <= 0.0 {
            return Ok(None);
        }
        let transfer = TransferFunction::preset(DEFAULT_PRESET)?;
        Ok(Some(transfer.scale_extinction(thick / chord)))
    }

    /// Selects the displayed scalar field: the field set in the scene; otherwise, without a
    /// transfer function, the regions ([`TetMesh::region_field`]) if there are several; otherwise
    /// the first node field that varies, the labels of the regions, or the depth below the surface.
    /// Vectors are displayed by their magnitude. A region field has one colour per region, unless
    /// the scene has a transfer function.
    ///
    /// # Errors
    /// [`Error::Input`] listing the fields if the field of the scene does not exist, or if none of
    /// its values is finite.
    pub fn scalar_field(&self, mesh: &TetMesh, topology: &Topology) -> Result<ScalarField> {
        // X-rays depend on the values of the field, not on its transfer function.
        let xray = self.picture.mode.as_deref() == Some("xray");
        let plain = self.picture.transfer.is_none() && !xray;
        let regions = || mesh.region_field();
        let found = || match plain {
            true => regions().or_else(|| first_scalar(mesh)),
            false => first_scalar(mesh).or_else(regions),
        };
        let (field, note) = match &self.picture.field {
            Some(name) => (named_field(mesh, name)?, None),
            None => match found() {
                Some(field) => (field.clone(), None),
                None => (
                    depth_field(mesh, topology),
                    Some(
                        "no varying scalar field; rendering the depth below the surface".to_owned(),
                    ),
                ),
            },
        };
        if plain && mesh.is_region_field(&field) {
            return ScalarField::regions(mesh, topology, &field, self.picture.field.is_none());
        }
        let mut scalars = magnitudes(&field);
        let missing = missing_values::fill(mesh, field.location, &mut scalars);
        let missing = missing.map_err(|e| Error::Input(format!("field \"{}\" {e}", field.name)))?;
        let missing = missing.map(|what| format!("field \"{}\": {what}", field.name));
        let note = match (note, missing) {
            (Some(note), Some(missing)) => Some(format!("{note}; {missing}")),
            (note, missing) => note.or(missing),
        };
        let (values, cells) = match field.location {
            Location::Node => (scalars, None),
            Location::Cell => (mesh.volume_weighted_node_means(&scalars), Some(scalars)),
        };
        if let Some(bad) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::Input(format!(
                "field \"{}\" must be finite to be rendered, but is not at node {bad}",
                field.name
            )));
        }
        let all = cells.as_ref().unwrap_or(&values).iter();
        let found = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(*v), b.max(*v))
        });
        let range = self.picture.range.filter(|_| !xray);
        let range = range.map_or_else(|| widened(found), |[low, high]| (low, high));
        let regions = match mesh.is_region_field(&field) {
            true => names_of_regions(mesh, &field).collect(),
            false => Vec::new(),
        };
        Ok(ScalarField {
            name: field.name,
            values,
            cells,
            range,
            note,
            transfer: self.transfer_of_thin_body(mesh, topology)?,
            regions,
        })
    }
}

/// Returns the name (or the label, if unnamed) and the label of each region of `field`.
fn names_of_regions<'a>(
    mesh: &'a TetMesh,
    field: &Field,
) -> impl Iterator<Item = (String, f64)> + use<'a> {
    let labels: Vec<i64> = mesh.regions_of(field).into_keys().collect();
    labels.into_iter().map(|label| {
        let name = mesh.region_names.get(&label).cloned();
        (name.unwrap_or_else(|| label.to_string()), label as f64)
    })
}

fn named_field(mesh: &TetMesh, name: &str) -> Result<Field> {
    let found = mesh
        .field(name, Location::Node)
        .or_else(|| mesh.field(name, Location::Cell));
    found.cloned().ok_or_else(|| {
        if name.parse::<BodyField>().is_ok() {
            return Error::Input(format!(
                "the mesh has no field \"{name}\", and computing it requires a simulated body; set a solver, such as --solver implicit"
            ));
        }
        if name == ERROR_FIELD {
            return Error::Input(
                "the mesh has no field \"error\"; it is estimated for bodies at rest by palpate render --field error with a solver, and for presses by palpate press (error.png)".into(),
            );
        }
        let names: Vec<&str> = mesh.fields.iter().map(|f| f.name.as_str()).collect();
        Error::Input(match names.as_slice() {
            [] => format!("unknown field \"{name}\": the mesh has no fields"),
            _ => format!(
                "unknown field \"{name}\"; available: {}",
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

/// Returns one number per tuple: the magnitude of a vector.
pub(super) fn magnitudes(field: &Field) -> Vec<f64> {
    match field.components {
        1 => field.values.clone(),
        n => field
            .values
            .chunks_exact(n)
            .map(|tuple| tuple.iter().map(|x| x * x).sum::<f64>().sqrt())
            .collect(),
    }
}

/// Widens the range of a constant field by a tenth on both sides, so that its colour is that of the
/// middle of the legend.
fn widened((low, high): (f64, f64)) -> (f64, f64) {
    if low < high {
        return (low, high);
    }
    let margin = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
    (low - margin, high + margin)
}
