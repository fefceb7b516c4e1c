//! The domain described by a meshing configuration, and the names of its regions.

use super::{Labels, MeshingConfig};
use crate::io::{self, Kind};
use crate::mesh::{AnatomicalFrame, TriMesh};
use crate::mesher::{
    ClosedSurface, Domain, LabelDomain, MeshReport, SurfaceDomain, ThresholdDomain, two_digits,
};
use crate::number_format::significant;
use crate::volume::Volume;
use crate::{Error, Result};
use std::path::Path;

/// Unit of the world coordinates of volumes, in metres.
pub(super) const MILLIMETRE: f64 = 1e-3;
/// The node field of the values of the volume itself.
pub(super) const INTENSITY: &str = "intensity";

/// The regions of a domain: label, name and volume.
pub(super) struct Regions {
    pub labels: Vec<i64>,
    pub names: Vec<Option<String>>,
    pub volumes: Vec<Option<f64>>,
    /// The number of voxels of each region of a label map; empty for other domains.
    pub voxels: Vec<usize>,
    /// The fraction of them that smoothing removes.
    pub smoothed_fractions: Vec<f64>,
    pub notes: Vec<String>,
}

impl Regions {
    /// Adds the voxels of a label map to an error of the mesher, if these are so few that nothing of
    /// them may be left.
    pub(super) fn with_voxels(&self, error: Error) -> Error {
        /// Maximum numbers of regions that are named, and of their voxels.
        const MAX_LISTED_REGIONS: usize = 10;
        const MAX_LISTED_VOXELS: usize = 1000;
        let few = (1..=MAX_LISTED_REGIONS).contains(&self.voxels.len());
        let total: usize = self.voxels.iter().sum();
        match error {
            Error::Input(what) if few && total <= MAX_LISTED_VOXELS => {
                let labels = self.labels.iter().zip(&self.voxels);
                let named = labels.map(|(label, voxels)| with_count(*label, *voxels));
                let named: Vec<String> = named.collect();
                Error::Input(format!("{what}; labels: {}", named.join(", ")))
            }
            other => other,
        }
    }

    /// Returns the note about a region without tets.
    pub(super) fn lost(&self, region: usize, report: &MeshReport) -> String {
        let name = self.names[region].as_ref();
        let name = name.map_or(String::new(), |name| format!(" \"{name}\""));
        let voxels = match self.voxels.get(region) {
            Some(1) => " (1 voxel)".to_owned(),
            Some(n) => format!(" ({n} voxels)"),
            None => String::new(),
        };
        let advice = match report.resolving_edge.filter(|e| *e < report.edge) {
            Some(edge) => format!("--edge {} keeps it", two_digits(edge)),
            None => "decrease the edge length or increase the number of tets".to_owned(),
        };
        format!(
            "region {}{name}{voxels} has no tets at an edge length of {}: it is thinner; {advice}",
            self.labels[region],
            significant(report.edge)
        )
    }
}

/// Returns a label with the number of its voxels.
fn with_count(label: i64, voxels: usize) -> String {
    match voxels {
        1 => format!("{label} (1 voxel)"),
        _ => format!("{label} ({voxels} voxels)"),
    }
}

/// Returns notes about the regions that smoothing would remove.
fn thin_notes(domain: &LabelDomain) -> Vec<String> {
    /// Maximum number of regions in the note.
    const MAX_LISTED_REGIONS: usize = 10;
    let thin = domain.thin_regions();
    if thin.is_empty() {
        return Vec::new();
    }
    let named: Vec<String> = thin
        .iter()
        .take(MAX_LISTED_REGIONS)
        .map(|(label, voxels)| with_count(*label, *voxels))
        .collect();
    let more = match thin.len() > MAX_LISTED_REGIONS {
        true => format!(" and {} more", thin.len() - MAX_LISTED_REGIONS),
        false => String::new(),
    };
    vec![format!(
        "regions of lone or diagonal voxels are kept as rounded blobs: {}{more}; check that these \
        labels are meant",
        named.join(", ")
    )]
}

/// The domain described by a meshing configuration.
pub(crate) struct DomainDescription<'a> {
    /// The domain.
    pub domain: &'a dyn Domain,
    /// The label of each region.
    pub labels: Vec<i64>,
    /// The name of each region, if it has one.
    pub names: Vec<Option<String>>,
    /// Unit of the domain in metres, if known.
    pub unit: Option<f64>,
    /// Frame of reference of the domain, if known.
    pub frame: Option<AnatomicalFrame>,
    /// The source volume, if its values are intensities.
    pub volume: Option<&'a Volume>,
    /// Repairs and warnings, one sentence each.
    pub notes: Vec<String>,
}

/// The surfaces of a configuration, as read and closed.
pub(super) struct Surfaces {
    pub surfaces: Vec<TriMesh>,
    pub closed: Vec<ClosedSurface>,
    pub regions: Regions,
    pub notes: Vec<String>,
}

impl SurfaceDomain {
    /// Reads the closed surface in the file at `path` as a domain of one region.
    ///
    /// # Errors
    /// As [`read_surface`](crate::io::read_surface) and [`ClosedSurface::new`].
    pub fn read(path: impl AsRef<Path>) -> Result<SurfaceDomain> {
        let surface = io::read_surface(path)?;
        SurfaceDomain::new(vec![ClosedSurface::new(&surface)?])
    }
}

impl MeshingConfig {
    /// Passes the domain described by the configuration to `use_`: that of a volume, of closed
    /// surfaces, or of the boundary of a tet mesh.
    ///
    /// # Errors
    /// As [`MeshingConfig::mesh`], and the errors of `use_`.
    pub(crate) fn with_domain<R>(
        &self,
        use_: impl FnOnce(DomainDescription) -> Result<R>,
    ) -> Result<R> {
        let Some(first) = self.input.first() else {
            return Err(Error::Input(
                "no input to mesh; give a volume, a surface or a mesh".into(),
            ));
        };
        match io::detect_kind(first)? {
            Kind::Volume => self.with_volume_domain(first, |domain, regions, volume, by_value| {
                use_(DomainDescription {
                    domain,
                    labels: regions.labels,
                    names: regions.names,
                    unit: Some(MILLIMETRE),
                    frame: Some(AnatomicalFrame::Ras),
                    volume: by_value.then_some(volume),
                    notes: volume.notes.iter().cloned().chain(regions.notes).collect(),
                })
            }),
            Kind::Surface => {
                let found = self.read_surfaces()?;
                let frame = common_frame(&found.surfaces);
                use_(DomainDescription {
                    domain: &SurfaceDomain::new(found.closed)?,
                    labels: found.regions.labels,
                    names: found.regions.names,
                    unit: self.unit,
                    frame,
                    volume: None,
                    notes: found.notes,
                })
            }
            Kind::Mesh => {
                let mesh = io::read(first)?;
                let closed = ClosedSurface::new(&mesh.boundary_surface(None)?)?;
                use_(DomainDescription {
                    domain: &SurfaceDomain::new(vec![closed])?,
                    labels: vec![1],
                    names: vec![None],
                    unit: self.unit.or(mesh.length_unit),
                    frame: mesh.frame,
                    volume: None,
                    notes: mesh.repairs.warnings,
                })
            }
        }
    }

    /// Passes on the domain of a volume, its regions, and whether they are defined by thresholds
    /// instead of labels.
    pub(super) fn with_volume_domain<R>(
        &self,
        file: &Path,
        use_: impl FnOnce(&dyn Domain, Regions, &Volume, bool) -> Result<R>,
    ) -> Result<R> {
        if self.input.len() > 1 {
            return Err(Error::Input(format!(
                "{} is a volume and must be the only input; add further volumes as intensities \
                with --intensity",
                file.display()
            )));
        }
        let volume = io::read_volume_number(file, self.number)?;
        let windows = self.windows();
        if !windows.is_empty() {
            if self.labels.is_some() {
                return Err(Error::Input(
                    "labels and thresholds are mutually exclusive; give one of them".into(),
                ));
            }
            let domain = ThresholdDomain::new(&volume, &windows)?;
            return use_(&domain, Regions::of_windows(&windows), &volume, true);
        }
        let labels = match &self.labels {
            Some(Labels::These(labels)) => Some(labels.as_slice()),
            Some(Labels::All) => None,
            None => {
                check_label_map(file, &volume)?;
                None
            }
        };
        let domain = LabelDomain::new(&volume, labels)?;
        let regions = Regions {
            labels: domain.labels().to_vec(),
            names: domain
                .labels()
                .iter()
                .map(|l| volume.label_names.get(l).cloned())
                .collect(),
            volumes: domain.voxel_volumes().into_iter().map(Some).collect(),
            voxels: domain.voxel_counts().to_vec(),
            smoothed_fractions: domain.smoothed_fractions(),
            notes: thin_notes(&domain),
        };
        use_(&domain, regions, &volume, false)
    }

    /// Reads a surface, converted to RAS if its frame is known.
    pub(super) fn read_surface(&self, file: &Path) -> Result<TriMesh> {
        let mut surface = io::read_surface(file)?;
        if let (Some(frame), None) = (self.frame, surface.frame) {
            surface.convert_to_ras(frame);
        }
        Ok(surface)
    }

    pub(super) fn read_surfaces(&self) -> Result<Surfaces> {
        if self.labels.is_some() || !self.windows().is_empty() {
            return Err(Error::Input(
                "labels and thresholds apply to volumes only; omit them, each surface encloses one \
                region".into(),
            ));
        }
        let mut found = Surfaces {
            surfaces: Vec::new(),
            closed: Vec::new(),
            regions: Regions {
                labels: Vec::new(),
                names: Vec::new(),
                volumes: Vec::new(),
                voxels: Vec::new(),
                smoothed_fractions: Vec::new(),
                notes: Vec::new(),
            },
            notes: Vec::new(),
        };
        let surfaces = self.input.iter().map(|file| self.read_surface(file));
        let mut surfaces: Vec<TriMesh> = surfaces.collect::<Result<_>>()?;
        // A scan is in RAS, and so are surfaces that state their frame.
        if self.meets_scan
            || !self.intensities.is_empty()
            || surfaces.iter().any(|s| s.frame.is_some())
        {
            surfaces.iter_mut().for_each(TriMesh::meet_ras);
        }
        for (file, surface) in self.input.iter().zip(surfaces) {
            let with_file = |note: &String| format!("{}: {note}", file.display());
            found.notes.extend(surface.notes.iter().map(with_file));
            let closed =
                ClosedSurface::new(&surface).map_err(|e| Error::format(file, e.to_string()))?;
            found.notes.extend(closed.notes().iter().map(with_file));
            let regions = &mut found.regions;
            regions.labels.push(found.surfaces.len() as i64 + 1);
            let stem = file.file_stem().unwrap_or_default();
            regions
                .names
                .push(Some(stem.to_string_lossy().into_owned()));
            // The part inside a later surface belongs to the latter.
            let alone = self.input.len() == 1;
            regions.volumes.push(alone.then(|| closed.volume()));
            found.surfaces.push(surface);
            found.closed.push(closed);
        }
        Ok(found)
    }
}

/// Returns the frame of reference of a mesh of these surfaces, if that of each is known.
pub(super) fn common_frame(surfaces: &[TriMesh]) -> Option<AnatomicalFrame> {
    let first = surfaces.first()?.frame;
    first.filter(|_| surfaces.iter().all(|s| s.frame == first))
}

/// Rejects a volume without a definition of its regions.
pub(super) fn check_label_map(file: &Path, volume: &Volume) -> Result<()> {
    const MAX_UNNAMED_LABELS: usize = 64;
    let labels = volume.labels();
    if labels
        .as_ref()
        .is_some_and(|l| l.len() <= MAX_UNNAMED_LABELS)
        || !volume.label_names.is_empty()
    {
        return Ok(());
    }
    let (low, high) = volume.range().unwrap_or((0.0, 0.0));
    Err(Error::Input(format!(
        "{} has values from {low} to {high} and is not a label map; define regions by a threshold \
        (--above {:.0}), a range (--between {:.0}..{:.0}) or labels (--labels all)",
        file.display(),
        low + 0.3 * (high - low),
        low + 0.3 * (high - low),
        low + 0.6 * (high - low),
    )))
}
