//! Mesh statistics for choosing and building tables: segment lengths and the scalar histogram.

use super::{Geometry, Scalars, share};
use crate::mesh::{FACES, TET_EDGES, TetMesh};
use crate::parallel;

/// Bins of the scalar histogram, and the maximum number of tets sampled for it.
const HISTOGRAM_BINS: usize = 256;
const TETS_OF_SPREAD: usize = 1 << 16;

/// Statistics of a mesh with a scalar field, from which tables are built. Pieces of a partitioned
/// mesh use those of the whole mesh, so that all are rendered with the same table.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct TableStatistics {
    /// Longest edge, in mesh units.
    pub longest_edge: f64,
    /// Mean chord length of random rays in the tets, in mesh units.
    pub mean_chord: f64,
    /// Smallest and largest scalar; the width is 1 for a constant field.
    pub range: (f64, f64),
    /// Histogram: volume fraction per equal-width bin of the range.
    pub spread: Vec<f64>,
}

impl TableStatistics {
    /// Computes the statistics of `mesh` with these scalars.
    pub fn new(mesh: &TetMesh, scalars: Scalars) -> TableStatistics {
        let range = scalar_range(scalars.values());
        TableStatistics {
            longest_edge: longest_edge(mesh),
            mean_chord: mean_chord(mesh),
            range,
            spread: scalar_histogram(mesh, scalars, range).to_vec(),
        }
    }

    /// Returns the statistics for another scalar range, to which scalars are clamped.
    pub fn with_range(&self, range: (f64, f64)) -> TableStatistics {
        let width = (self.range.1 - self.range.0) / self.spread.len().max(1) as f64;
        let mut moved = vec![0.0; HISTOGRAM_BINS];
        for (k, part) in self.spread.iter().enumerate() {
            let middle = self.range.0 + (k as f64 + 0.5) * width;
            let bin = (share(middle, range) * HISTOGRAM_BINS as f32) as usize;
            moved[bin.min(HISTOGRAM_BINS - 1)] += part;
        }
        TableStatistics {
            range,
            spread: moved,
            ..self.clone()
        }
    }
}

impl Geometry {
    /// Builds tables from `measures` instead of the statistics of the geometry's own mesh; used for
    /// a piece of a mesh with the statistics of the whole. Does not change the scalar range; see
    /// [`Geometry::set_scalars`].
    pub fn set_table_statistics(&mut self, measures: &TableStatistics) {
        self.longest_edge = measures.longest_edge / self.frame.scale;
        self.mean_chord = measures.mean_chord / self.frame.scale;
        self.spread = measures.spread.as_slice().into();
    }
}

/// Returns the smallest and largest scalar; the width is 1 for a constant field.
pub(super) fn scalar_range(scalars: &[f64]) -> (f64, f64) {
    let (low, high) = scalars
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| {
            (a.min(*s), b.max(*s))
        });
    if high > low {
        (low, high)
    } else {
        (low, low + 1.0)
    }
}

/// Returns the longest edge length (multi-threaded).
pub(super) fn longest_edge(mesh: &TetMesh) -> f64 {
    let longest = parallel::collect(mesh.tets.len(), |range, longest| {
        let edges = range.flat_map(|t| {
            let p = mesh.tet_nodes(t);
            TET_EDGES.map(|[a, b]| p[a].distance_squared(p[b]))
        });
        longest.push(edges.fold(0.0, f64::max));
    });
    longest.into_iter().fold(0.0, f64::max).sqrt()
}

/// Returns the mean chord length: four times the total volume divided by the total surface area of
/// all tets (Cauchy's formula for convex bodies).
pub(super) fn mean_chord(mesh: &TetMesh) -> f64 {
    let volume = parallel::sum(mesh.tets.len(), |t| mesh.tet_volume(t).abs());
    let surface = parallel::sum(mesh.tets.len(), |t| {
        let corners = mesh.tet_nodes(t);
        let areas = FACES.iter().map(|face| {
            let [p, q, r] = face.map(|k| corners[k]);
            0.5 * (q - p).cross(r - p).length()
        });
        areas.sum()
    });
    4.0 * volume / surface.max(f64::MIN_POSITIVE)
}

/// Returns the volume fraction per bin of the scalar range ([`HISTOGRAM_BINS`] equal bins); large
/// meshes are sampled with a stride.
pub(super) fn scalar_histogram(
    mesh: &TetMesh,
    scalars: Scalars,
    range: (f64, f64),
) -> std::sync::Arc<[f64]> {
    let mut spread = vec![0.0; HISTOGRAM_BINS];
    let every = mesh.tets.len().div_ceil(TETS_OF_SPREAD).max(1);
    for t in (0..mesh.tets.len()).step_by(every) {
        let middle = match scalars {
            Scalars::Nodes(values) => {
                mesh.tets[t].map(|v| values[v as usize]).iter().sum::<f64>() / 4.0
            }
            Scalars::Cells(values) => values[t],
        };
        let bin = (share(middle, range) * HISTOGRAM_BINS as f32) as usize;
        spread[bin.min(HISTOGRAM_BINS - 1)] += mesh.tet_volume(t).abs();
    }
    let volume: f64 = spread.iter().sum();
    let each = |part: &mut f64| *part /= volume.max(f64::MIN_POSITIVE);
    spread.iter_mut().for_each(each);
    spread.into()
}
