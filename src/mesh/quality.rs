//! Quality of tets: dihedral angles, mean ratio, list of the worst.

use super::{FACES, TET_EDGES, TetMesh, signed_volume};
use crate::parallel;
use glam::DVec3;

/// Tets with a mean ratio below this are counted as slivers.
pub(crate) const SLIVER: f64 = 0.01;

/// Bins of [`QualityReport::dihedral_histogram`]: 10° each.
pub(crate) const DIHEDRAL_BINS: usize = 18;

/// Number of the worst tets listed by a [`QualityReport`].
const MAX_LISTED: usize = 10;

/// Quality measures of one tet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TetQuality {
    /// The smallest of its six dihedral angles, in degrees; 70.5 when regular.
    pub min_dihedral: f64,
    /// The largest of its six dihedral angles, in degrees.
    pub max_dihedral: f64,
    /// 6√2 V / l³ with l the root mean square of the edge lengths: 1 when regular, 0 when flat,
    /// negative when inverted.
    pub mean_ratio: f64,
}

/// A badly shaped tet.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct WorstTet {
    /// Its number.
    pub tet: usize,
    /// Its [`TetQuality::mean_ratio`].
    pub quality: f64,
    /// Its [`TetQuality::min_dihedral`].
    pub min_dihedral: f64,
    /// Its centroid.
    pub centroid: [f64; 3],
}

/// Quality statistics of all tets of a mesh.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct QualityReport {
    /// The smallest dihedral angle of the mesh, in degrees.
    pub min_dihedral: f64,
    /// The largest dihedral angle of the mesh, in degrees.
    pub max_dihedral: f64,
    /// Number of dihedral angles in 0–10°, 10–20°, … 170–180°; six angles per tet.
    pub dihedral_histogram: [usize; DIHEDRAL_BINS],
    /// The smallest [`TetQuality::mean_ratio`].
    pub min: f64,
    /// The mean [`TetQuality::mean_ratio`].
    pub mean: f64,
    /// Number of tets whose mean ratio is below 0.01.
    pub slivers: usize,
    /// The up to ten worst tets, the worst first.
    pub worst: Vec<WorstTet>,
}

impl TetQuality {
    /// Returns the six dihedral angles of the tet with corners `v`, in degrees, at the edges of
    /// [`TET_EDGES`]. Angles at a degenerate face are 0.
    pub fn dihedral_angles(v: [DVec3; 4]) -> [f64; 6] {
        let normals = FACES.map(|[a, b, c]| (v[b] - v[a]).cross(v[c] - v[a]));
        TET_EDGES.map(|[a, b]| {
            // The two faces at an edge are those opposite the other two corners.
            let mut faces = (0..4).filter(|f| *f != a && *f != b);
            let (Some(p), Some(q)) = (faces.next(), faces.next()) else {
                return 0.0;
            };
            let (n, m) = (normals[p], normals[q]);
            if n == DVec3::ZERO || m == DVec3::ZERO {
                return 0.0;
            }
            // atan2 stays exact where the arc cosine does not: near 0° and 180°.
            n.cross(m).length().atan2(-n.dot(m)).to_degrees()
        })
    }

    /// Returns the quality measures of the tet with corners `v`.
    pub fn new(v: [DVec3; 4]) -> TetQuality {
        quality_from(v, &TetQuality::dihedral_angles(v))
    }
}

fn quality_from(v: [DVec3; 4], angles: &[f64; 6]) -> TetQuality {
    let squares: f64 = TET_EDGES
        .iter()
        .map(|[a, b]| v[*a].distance_squared(v[*b]))
        .sum();
    let length = (squares / 6.0).sqrt();
    let shape = 6.0 * std::f64::consts::SQRT_2 * signed_volume(v) / length.powi(3);
    TetQuality {
        min_dihedral: angles.iter().copied().fold(f64::INFINITY, f64::min),
        max_dihedral: angles.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        mean_ratio: if shape.is_finite() { shape } else { 0.0 },
    }
}

impl QualityReport {
    /// Measures every tet of `mesh`, in parallel.
    pub fn new(mesh: &TetMesh) -> QualityReport {
        let chunk = 4096;
        let parts = parallel::map_coarse(mesh.tets.len().div_ceil(chunk), |c| {
            let end = mesh.tets.len().min((c + 1) * chunk);
            QualityReport::of(mesh, c * chunk..end)
        });
        let mut whole = QualityReport::empty();
        // Summed in the order of the tets, so the mean does not depend on the threads.
        for part in parts {
            whole.add(part);
        }
        if !mesh.tets.is_empty() {
            whole.mean /= mesh.tets.len() as f64;
        }
        whole
    }

    fn empty() -> QualityReport {
        QualityReport {
            min_dihedral: 180.0,
            max_dihedral: 0.0,
            dihedral_histogram: [0; DIHEDRAL_BINS],
            min: 1.0,
            mean: 0.0,
            slivers: 0,
            worst: Vec::new(),
        }
    }

    /// Measures a range of tets; `mean` is still the sum.
    fn of(mesh: &TetMesh, tets: std::ops::Range<usize>) -> QualityReport {
        let mut report = QualityReport::empty();
        for t in tets {
            let v = mesh.tet_nodes(t);
            let angles = TetQuality::dihedral_angles(v);
            for angle in angles {
                let bin = (angle / 180.0 * DIHEDRAL_BINS as f64) as usize;
                report.dihedral_histogram[bin.min(DIHEDRAL_BINS - 1)] += 1;
            }
            let q = quality_from(v, &angles);
            report.min_dihedral = report.min_dihedral.min(q.min_dihedral);
            report.max_dihedral = report.max_dihedral.max(q.max_dihedral);
            report.min = report.min.min(q.mean_ratio);
            report.mean += q.mean_ratio;
            report.slivers += usize::from(q.mean_ratio < SLIVER);
            report.worst.push(WorstTet {
                tet: t,
                quality: q.mean_ratio,
                min_dihedral: q.min_dihedral,
                centroid: (v.into_iter().sum::<DVec3>() / 4.0).to_array(),
            });
            if report.worst.len() > 32 * MAX_LISTED {
                report.keep_worst();
            }
        }
        report.keep_worst();
        report
    }

    fn add(&mut self, other: QualityReport) {
        self.min_dihedral = self.min_dihedral.min(other.min_dihedral);
        self.max_dihedral = self.max_dihedral.max(other.max_dihedral);
        for (own, more) in self
            .dihedral_histogram
            .iter_mut()
            .zip(other.dihedral_histogram)
        {
            *own += more;
        }
        self.min = self.min.min(other.min);
        self.mean += other.mean;
        self.slivers += other.slivers;
        self.worst.extend(other.worst);
        self.keep_worst();
    }

    fn keep_worst(&mut self) {
        self.worst
            .sort_by(|a, b| a.quality.total_cmp(&b.quality).then(a.tet.cmp(&b.tet)));
        self.worst.truncate(MAX_LISTED);
    }
}
