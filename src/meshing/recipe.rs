//! Meshing of files: a mesh with regions, names and intensities.

use super::domain_source::{
    INTENSITY, MILLIMETRE, Regions, Surfaces, check_label_map, common_frame,
};
use super::size_field::read_size_field;
use super::tetgen;
use crate::io::{self, Kind};
use crate::mesh::{AnatomicalFrame, Field, Length, Location, ScalarType, TetMesh, TriMesh};
use crate::mesher::{
    Domain, MeshOptions, MeshReport, MeshedDomain, Spacing, SurfaceDomain, ThresholdRange,
    mesh_domain,
};
use crate::progress::ProgressScope;
use crate::volume::Volume;
use crate::{Error, ProgressFn, Result, no_progress};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use web_time::Instant;

/// Default number of tets.
const DEFAULT_TETS: usize = 50_000;

/// The labels of a volume that become regions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Labels {
    /// All except 0.
    All,
    /// These.
    These(Vec<i64>),
}

/// Target size of the tets as entered by a user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TargetSize {
    /// Edges at boundaries have about this length.
    Edge(Length),
    /// About this many tets.
    Tets(usize),
}

/// Input and options of the mesher.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshingConfig {
    /// One volume, or closed surfaces, one per region; later ones lie inside earlier ones.
    pub input: Vec<PathBuf>,
    /// Regions from the labels of a volume; by default all labels of a label map.
    pub labels: Option<Labels>,
    /// Regions above a threshold, each up to the next threshold.
    pub above: Vec<ThresholdRange>,
    /// Regions between thresholds.
    pub between: Vec<ThresholdRange>,
    /// Target size of the tets; by default about 50,000 tets.
    pub size: Option<TargetSize>,
    /// Ratio of the edges away from boundaries to those at boundaries.
    pub grading: Option<f64>,
    /// File of the edge lengths of the tets by place, in place of `grading`; see
    /// [`SizeField::of_mesh`](crate::mesher::SizeField::of_mesh) and
    /// [`SizeField::of_volume`](crate::mesher::SizeField::of_volume). Without a target size the lengths are
    /// those of the file, otherwise in proportion to them.
    pub size_field: Option<PathBuf>,
    /// Components of regions below this volume, in cubic units of the input, are merged into their
    /// surroundings.
    pub min_island: Option<f64>,
    /// Pairs of regions, by name or label, whose interface is split; see
    /// [`TetMesh::split_interface`].
    pub split_interfaces: Vec<[String; 2]>,
    /// Which volume of an input of several (times, echoes, components) is meshed, counted from 0;
    /// also that of intensities.
    pub number: Option<usize>,
    /// Unit of surface files in metres; volumes are in mm.
    pub unit: Option<f64>,
    /// Frame of reference of surface files that do not state theirs. Without it, their coordinates
    /// are kept, or taken as LPS where they meet files of a known frame.
    pub frame: Option<AnatomicalFrame>,
    /// Whether the mesh meets files of a known frame, besides the other surfaces and `intensities`.
    pub meets_scan: bool,
    /// Volumes sampled at the nodes, by the name of the field.
    pub intensities: Vec<(String, PathBuf)>,
    /// Whether to use the installed program TetGen.
    pub tetgen: bool,
}

/// A generated mesh with its report.
#[derive(Debug)]
pub struct MeshingResult {
    /// The mesh: cell field `label`, node fields of intensities, names of its regions, its unit.
    pub mesh: TetMesh,
    /// Statistics of the meshing.
    pub report: RecipeReport,
    /// Repairs and warnings, one sentence each.
    pub notes: Vec<String>,
}

/// Statistics of the meshing and the quality.
#[derive(Clone, Debug, serde::Serialize)]
pub struct RecipeReport {
    /// The regions of the mesh.
    pub regions: Vec<RegionSummary>,
    /// Report of the lattice mesher, if it was used.
    pub mesher: Option<MeshReport>,
    /// Total time, including reading, in seconds.
    pub seconds: f64,
}

/// A region of a generated mesh.
#[derive(Clone, Debug, serde::Serialize)]
pub struct RegionSummary {
    /// Its value in the cell field `label`.
    pub label: i64,
    /// Its name, if it has one.
    pub name: Option<String>,
    /// Number of its tets.
    pub tets: usize,
    /// Their volume, in cubic units of the mesh.
    pub volume: f64,
    /// The volume in the input: that of its voxels, or the one enclosed by its surface.
    pub input_volume: Option<f64>,
    /// The fraction of its voxels that the smoothing of a label map removes at any edge length.
    pub smoothed_fraction: f64,
}

/// Meshes the file at `path` with about `tets` tets: a closed surface, or a label map. Use
/// [`MeshingConfig`] for anything else.
///
/// # Errors
/// As [`MeshingConfig::mesh`].
pub fn mesh_file(path: impl AsRef<Path>, tets: usize) -> Result<TetMesh> {
    let recipe = MeshingConfig {
        input: vec![path.as_ref().to_path_buf()],
        size: Some(TargetSize::Tets(tets)),
        ..MeshingConfig::default()
    };
    Ok(recipe.mesh(&no_progress)?.mesh)
}

impl MeshingConfig {
    /// Generates the mesh, with reports to `progress`.
    ///
    /// # Errors
    /// An [`Error::Cancelled`]; the errors of reading; an [`Error::Input`] for a configuration that
    /// does not match its input; otherwise as [`mesh_domain`].
    pub fn mesh(&self, progress: ProgressFn) -> Result<MeshingResult> {
        let started = Instant::now();
        let Some(first) = self.input.first() else {
            return Err(Error::Input(
                "no input to mesh; give a volume or a surface".into(),
            ));
        };
        ProgressScope::begin(progress, "reading", 0.0)?;
        let kind = io::detect_kind(first)?;
        if self.number.is_some() && kind != Kind::Volume && self.intensities.is_empty() {
            return Err(Error::Input(format!(
                "the number of a volume (`volume`) applies to volumes only, and {} is none; omit it",
                first.display()
            )));
        }
        let mut made = match kind {
            Kind::Volume => self.mesh_volume(first, progress)?,
            Kind::Surface => self.mesh_surfaces(progress)?,
            Kind::Mesh => {
                return Err(Error::Input(format!(
                    "{} is already a tetrahedral mesh; give a volume or a closed surface, or \
                    extract a surface of the mesh with --out NAME.ply",
                    first.display()
                )));
            }
        };
        for (name, file) in &self.intensities {
            ProgressScope::begin(progress, "intensities", 0.95)?;
            let volume = self.read_intensity(file)?;
            let with_file = |note: &String| format!("{}: {note}", file.display());
            made.notes.extend(volume.notes.iter().map(with_file));
            let field = volume.onto_nodes(&made.mesh, name);
            made.mesh.set_field(field)?;
        }
        made.mesh.split_interfaces(&self.split_interfaces)?;
        made.report.seconds = started.elapsed().as_secs_f64();
        Ok(made)
    }

    /// Extracts the surface described by the configuration, at the full resolution of its input,
    /// smoothed by `rounds` iterations: the isosurface of a volume's one threshold or range, the
    /// boundary of the union of its labels, the boundary of the labels of a tet mesh (of all of it
    /// if none are given), or a surface as it is.
    ///
    /// # Errors
    /// The errors of reading; an [`Error::Input`] for a configuration that does not match its
    /// input.
    pub fn extract_surface(&self, rounds: u32, progress: ProgressFn) -> Result<TriMesh> {
        let [file] = self.input.as_slice() else {
            return Err(Error::Input(format!(
                "extracting a surface requires exactly one input file, got {}",
                self.input.len()
            )));
        };
        ProgressScope::begin(progress, "reading", 0.0)?;
        let windows = self.windows();
        let kind = io::detect_kind(file)?;
        if kind != Kind::Volume && !windows.is_empty() {
            return Err(Error::Input(format!(
                "thresholds apply to volumes only, and {} is not a volume; omit them",
                file.display()
            )));
        }
        let surface = match kind {
            Kind::Surface => self.read_surface(file)?,
            Kind::Mesh => {
                let labels = match &self.labels {
                    Some(Labels::These(labels)) => Some(labels.as_slice()),
                    _ => None,
                };
                io::read(file)?.boundary_surface(labels)?
            }
            Kind::Volume => {
                let volume = io::read_volume_number(file, self.number)?;
                ProgressScope::begin(progress, "surface", 0.3)?;
                let mut surface = match (windows.as_slice(), &self.labels) {
                    ([window], None) => volume.isosurface(window.low, window.high)?,
                    ([], Some(Labels::These(labels))) => volume.label_surface(labels)?,
                    ([], _) => {
                        check_label_map(file, &volume)?;
                        let labels = volume.labels().unwrap_or_default();
                        let all: Vec<i64> = labels.into_keys().filter(|l| *l != 0).collect();
                        volume.label_surface(&all)?
                    }
                    _ => {
                        return Err(Error::Input(
                            "extracting a surface requires exactly one threshold, one range or a \
                            list of labels"
                                .into(),
                        ));
                    }
                };
                surface.notes.extend(volume.notes);
                surface
            }
        };
        ProgressScope::begin(progress, "smoothing", 0.7)?;
        Ok(match rounds {
            0 => surface,
            rounds => surface.smoothed(rounds),
        })
    }

    /// Returns the requested ranges: each threshold extends up to the next.
    pub fn windows(&self) -> Vec<ThresholdRange> {
        let mut windows = self.above.clone();
        windows.sort_by(|a, b| a.low.total_cmp(&b.low));
        for n in 1..windows.len() {
            windows[n - 1].high = windows[n].low;
        }
        windows.extend(self.between.iter().cloned());
        windows
    }

    /// Reads a volume of intensities; of several the one requested.
    fn read_intensity(&self, file: &Path) -> Result<Volume> {
        let alone = io::read_volume(file);
        alone.or_else(|e| match self.number {
            Some(_) => io::read_volume_number(file, self.number),
            None => Err(e),
        })
    }

    fn mesh_volume(&self, file: &Path, progress: ProgressFn) -> Result<MeshingResult> {
        if self.tetgen {
            return Err(Error::Input(
                "TetGen meshes surfaces only; extract a surface of the volume first with --out \
                NAME.ply"
                    .into(),
            ));
        }
        self.with_volume_domain(file, |domain, regions, volume, by_value| {
            let mut made = self.fill(domain, regions, Some(MILLIMETRE), progress)?;
            made.mesh.frame = Some(AnatomicalFrame::Ras);
            if by_value {
                ProgressScope::begin(progress, "intensities", 0.9)?;
                let field = volume.onto_nodes(&made.mesh, INTENSITY);
                made.mesh.set_field(field)?;
            }
            made.notes.extend(volume.notes.iter().cloned());
            Ok(made)
        })
    }

    fn mesh_surfaces(&self, progress: ProgressFn) -> Result<MeshingResult> {
        let Surfaces {
            surfaces,
            closed,
            regions,
            notes,
        } = self.read_surfaces()?;
        let frame = common_frame(&surfaces);
        if self.tetgen && self.size_field.is_some() {
            return Err(Error::Input(
                "TetGen takes no size field here; omit one of the two (--with, --size-field)"
                    .into(),
            ));
        }
        let mut made = match self.tetgen {
            true => {
                let filling = tetgen(&surfaces, self.spacing(self.unit)?, progress)?;
                regions.name(filling, self.unit)?
            }
            false => self.fill(&SurfaceDomain::new(closed)?, regions, self.unit, progress)?,
        };
        made.mesh.frame = frame;
        made.notes.extend(notes);
        Ok(made)
    }

    /// Converts the target size to units of the input.
    fn spacing(&self, unit: Option<f64>) -> Result<Spacing> {
        Ok(match self.size.unwrap_or(TargetSize::Tets(DEFAULT_TETS)) {
            TargetSize::Edge(length) => Spacing::Edge(length.in_unit_of(unit)?),
            TargetSize::Tets(tets) => Spacing::Tets(tets),
        })
    }

    fn fill(
        &self,
        domain: &dyn Domain,
        regions: Regions,
        unit: Option<f64>,
        progress: ProgressFn,
    ) -> Result<MeshingResult> {
        let defaults = MeshOptions::default();
        let sizes = match &self.size_field {
            Some(file) => Some(Arc::new(read_size_field(file, domain.bounds(), unit)?)),
            None => None,
        };
        let options = MeshOptions {
            spacing: match (&sizes, self.size) {
                (Some(sizes), None) => Spacing::Edge(sizes.smallest()),
                _ => self.spacing(unit)?,
            },
            grading: self.grading.unwrap_or(defaults.grading),
            sizes,
            min_island: self.min_island.unwrap_or(defaults.min_island),
            ..defaults
        };
        let filling =
            mesh_domain(domain, &options, progress).map_err(|e| regions.with_voxels(e))?;
        regions.name(filling, unit)
    }
}

impl Regions {
    pub(super) fn of_windows(windows: &[ThresholdRange]) -> Regions {
        let name = |window: &ThresholdRange| {
            let range = match window.high.is_finite() {
                true => format!("{} to {}", window.low, window.high),
                false => format!("from {}", window.low),
            };
            Some(window.name.clone().unwrap_or(range))
        };
        Regions {
            labels: (1..=windows.len() as i64).collect(),
            names: windows.iter().map(name).collect(),
            volumes: vec![None; windows.len()],
            voxels: Vec::new(),
            smoothed_fractions: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Converts the meshed domain to a mesh with these labels and names.
    fn name(&self, filling: MeshedDomain, unit: Option<f64>) -> Result<MeshingResult> {
        let label_of = |region: u16| self.labels[usize::from(region) - 1];
        let values: Vec<f64> = filling
            .regions
            .iter()
            .map(|r| label_of(*r) as f64)
            .collect();
        let small = self.labels.iter().all(|l| (0..256).contains(l));
        let label = Field {
            scalar_type: if small {
                ScalarType::U8
            } else {
                ScalarType::I64
            },
            ..Field::scalar("label", Location::Cell, values)
        };
        let made = filling.report.regions.iter().map(|region| {
            let n = usize::from(region.region) - 1;
            RegionSummary {
                label: self.labels[n],
                name: self.names[n].clone(),
                tets: region.tets,
                volume: region.volume,
                input_volume: self.volumes[n],
                smoothed_fraction: self.smoothed_fractions.get(n).copied().unwrap_or(0.0),
            }
        });
        let regions: Vec<RegionSummary> = made.collect();
        let mut mesh = TetMesh::new(filling.nodes, filling.tets, vec![label], Vec::new())?;
        let named: BTreeMap<i64, String> = regions
            .iter()
            .filter_map(|r| Some((r.label, r.name.clone()?)))
            .collect();
        mesh.region_names = named;
        mesh.length_unit = unit;
        mesh.repairs.surface_distance = filling.report.surface_distance;
        let has_tets = |n: &usize| regions.iter().any(|r| r.label == self.labels[*n]);
        let lost = (0..self.labels.len()).filter(|n| !has_tets(n));
        let lost = lost.map(|n| self.lost(n, &filling.report));
        let notes = self.notes.iter().cloned().chain(lost).collect();
        Ok(MeshingResult {
            mesh,
            notes,
            report: RecipeReport {
                regions,
                mesher: Some(filling.report),
                seconds: 0.0,
            },
        })
    }
}
