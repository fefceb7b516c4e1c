//! Statistics of a meshed domain.

use super::{IslandReport, NonManifoldReport, OptimiserReport};
use crate::mesh::{DIHEDRAL_BINS, TetQuality, signed_volume};
use crate::parallel;
use glam::DVec3;
use web_time::Instant;

/// Bins of the angles for the 1st percentile, 0.01° each.
const FINE_BINS: usize = 18_000;

/// Statistics of the meshing and the quality.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct MeshReport {
    /// The lattice's edge at region boundaries.
    pub edge: f64,
    /// An edge length at which every part of every region has tets, if known.
    pub resolving_edge: Option<f64>,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of tets.
    pub tets: usize,
    /// The regions, ascending.
    pub regions: Vec<RegionReport>,
    /// Root mean square and maximum of the distances between the boundary of the mesh and that of what
    /// was meshed, at up to 20,000 faces.
    pub surface_distance: Option<[f64; 2]>,
    /// The smallest dihedral angle, in degrees.
    pub min_dihedral: f64,
    /// The largest dihedral angle, in degrees.
    pub max_dihedral: f64,
    /// The 1st percentile of the smallest dihedral angle of a tet, in degrees.
    pub first_percentile: f64,
    /// Number of dihedral angles in 0–10°, 10–20°, … 170–180°; six angles per tet.
    pub dihedral_histogram: [usize; DIHEDRAL_BINS],
    /// Number of lattice points snapped to a boundary.
    pub snapped_nodes: usize,
    /// Number of lattice faces at which three regions meet.
    pub triple_points: usize,
    /// Number of lattice tets in which three or four regions meet.
    pub quadruple_points: usize,
    /// Islands merged into their neighbours or dropped, by region.
    pub islands: Vec<IslandReport>,
    /// Repairs of non-manifold boundaries.
    pub pinches: NonManifoldReport,
    /// Improvements of the worst tets.
    pub optimiser: OptimiserReport,
    /// Time of each stage, in seconds.
    pub seconds: Vec<(&'static str, f64)>,
    /// Peak memory of the process so far, in bytes, if the system reports it.
    pub peak_memory: Option<u64>,
    #[serde(skip)]
    started: Option<Instant>,
}

impl MeshReport {
    /// An edge length at which more thin parts are meshed, rounded down to two digits.
    pub fn finer_edge(&self) -> f64 {
        let half = 0.5 * self.edge;
        super::two_digits(self.resolving_edge.map_or(half, |e| half.min(e)))
    }
}

/// One region of a mesh.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct RegionReport {
    /// The region, from 1 on.
    pub region: u16,
    /// Number of its tets.
    pub tets: usize,
    /// Their volume.
    pub volume: f64,
}

impl MeshReport {
    pub(crate) fn start(edge: f64) -> MeshReport {
        MeshReport {
            edge,
            started: Some(Instant::now()),
            ..MeshReport::default()
        }
    }

    /// Records the end of `stage`.
    pub(crate) fn stage(&mut self, stage: &'static str) {
        if let Some(started) = self.started.replace(Instant::now()) {
            self.seconds.push((stage, started.elapsed().as_secs_f64()));
        }
    }

    /// Measures the finished mesh.
    pub(super) fn measure(&mut self, nodes: &[DVec3], tets: &[[u32; 4]], regions: &[u16]) {
        (self.nodes, self.tets) = (nodes.len(), tets.len());
        let corners = |tet: &[u32; 4]| tet.map(|v| nodes[v as usize]);
        let mut by_region: Vec<RegionReport> = Vec::new();
        for (tet, &region) in tets.iter().zip(regions) {
            if by_region.len() <= usize::from(region) {
                by_region.resize(usize::from(region) + 1, RegionReport::default());
            }
            let entry = &mut by_region[usize::from(region)];
            entry.region = region;
            entry.tets += 1;
            entry.volume += signed_volume(corners(tet));
        }
        by_region.retain(|r| r.tets > 0);
        self.regions = by_region;
        let none = || (vec![0u32; FINE_BINS], [0; DIHEDRAL_BINS], 180.0f64, 0.0f64);
        let parts = parallel::collect(tets.len(), |range, parts| {
            let (mut smallest, mut histogram, mut min, mut max) = none();
            for tet in &tets[range] {
                let angles = TetQuality::dihedral_angles(corners(tet));
                let (mut least, mut most) = (180.0f64, 0.0f64);
                for angle in angles {
                    let bin = (angle / 180.0 * DIHEDRAL_BINS as f64) as usize;
                    histogram[bin.min(DIHEDRAL_BINS - 1)] += 1;
                    (least, most) = (least.min(angle), most.max(angle));
                }
                let bin = (least / 180.0 * FINE_BINS as f64) as usize;
                smallest[bin.min(FINE_BINS - 1)] += 1;
                (min, max) = (min.min(least), max.max(most));
            }
            parts.push((smallest, histogram, min, max));
        });
        let (smallest, histogram, min, max) = parts.into_iter().fold(none(), |mut a, b| {
            a.0.iter_mut().zip(&b.0).for_each(|(a, b)| *a += b);
            a.1.iter_mut().zip(&b.1).for_each(|(a, b)| *a += b);
            (a.0, a.1, a.2.min(b.2), a.3.max(b.3))
        });
        let mut before = 0;
        let bin = smallest.iter().position(|n| {
            before += *n as usize;
            before * 100 >= tets.len()
        });
        let upper = (bin.unwrap_or(0) + 1) as f64 * 180.0 / FINE_BINS as f64;
        // At least the minimum, which lies within the same bin in a small mesh.
        self.first_percentile = upper.max(min);
        (self.min_dihedral, self.max_dihedral) = (min, max);
        self.dihedral_histogram = histogram;
        self.stage("quality");
        self.peak_memory = peak_memory();
    }
}

/// Returns the peak memory of the process, in bytes, if /proc reports it.
pub(crate) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    kilobytes.checked_mul(1024)
}
