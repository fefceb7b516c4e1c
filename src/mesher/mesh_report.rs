//! What is told of a filling.

use super::{IslandReport, NonManifoldReport, OptimiserReport};
use crate::mesh::{DIHEDRAL_BINS, dihedral_angles, signed_volume};
use crate::parallel;
use glam::DVec3;
use web_time::Instant;

/// Bins of the angles from which the 1st percentile is read: a hundredth of a degree each.
const FINE_BINS: usize = 18_000;

/// How a mesh was made, and how good it is.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct MeshReport {
    /// The lattice's edge at region boundaries.
    pub edge: f64,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of tets.
    pub tets: usize,
    /// The regions, rising.
    pub regions: Vec<RegionReport>,
    /// The smallest dihedral angle, in degrees.
    pub min_dihedral: f64,
    /// The largest dihedral angle, in degrees.
    pub max_dihedral: f64,
    /// One tet in a hundred has a smaller dihedral angle than this, in degrees.
    pub first_percentile: f64,
    /// Number of dihedral angles in 0–10°, 10–20°, … 170–180°; six angles a tet.
    pub dihedral_histogram: [usize; DIHEDRAL_BINS],
    /// Lattice points moved onto a boundary.
    pub snapped_nodes: usize,
    /// Faces of the lattice in which three regions meet.
    pub triple_points: usize,
    /// Tets of the lattice in which three or four regions meet.
    pub quadruple_points: usize,
    /// Islands given to their neighbours or dropped, by region.
    pub islands: Vec<IslandReport>,
    /// What was done where a boundary was no manifold.
    pub pinches: NonManifoldReport,
    /// What was done about the worst tets.
    pub optimiser: OptimiserReport,
    /// What each stage took, in seconds.
    pub seconds: Vec<(&'static str, f64)>,
    /// The most memory the process has held so far, in bytes, where the system tells.
    pub peak_memory: Option<u64>,
    #[serde(skip)]
    started: Option<Instant>,
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
    pub(super) fn start(edge: f64) -> MeshReport {
        MeshReport {
            edge,
            started: Some(Instant::now()),
            ..MeshReport::default()
        }
    }

    /// Notes that `stage` ends now.
    pub(super) fn stage(&mut self, stage: &'static str) {
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
                let angles = dihedral_angles(corners(tet));
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
        // Not below the smallest of all, which lies within the same bin in a small mesh.
        self.first_percentile = upper.max(min);
        (self.min_dihedral, self.max_dihedral) = (min, max);
        self.dihedral_histogram = histogram;
        self.stage("quality");
        self.peak_memory = peak_memory();
    }
}

/// The most memory the process has held, where /proc tells.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    kilobytes.checked_mul(1024)
}
