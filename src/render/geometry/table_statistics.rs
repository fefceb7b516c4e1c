//! What tables go by of a mesh: how long segments are, and which scalars are frequent.

use super::{Geometry, Scalars, share};
use crate::mesh::{FACES, TET_EDGES, TetMesh};
use crate::parallel;

/// Parts of the range of scalars that are told apart where it is asked what is frequent, and tets that
/// are looked at for it.
const HISTOGRAM_BINS: usize = 256;
const TETS_OF_SPREAD: usize = 1 << 16;

/// What the tables of pictures are made for, of a mesh with a scalar. Pieces of a mesh take over
/// those of the whole, so that all are drawn by one table.
#[derive(Clone, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct TableStatistics {
    /// The longest edge, in the mesh's unit.
    pub longest_edge: f64,
    /// Mean length of a random ray in a tet, in the mesh's unit.
    pub mean_chord: f64,
    /// Smallest and largest scalar; apart by 1 where they are equal.
    pub range: (f64, f64),
    /// The share of the volume whose scalar lies in each of equal parts of the range.
    pub spread: Vec<f64>,
}

impl TableStatistics {
    /// Those of `mesh` with these scalars.
    pub fn new(mesh: &TetMesh, scalars: Scalars) -> TableStatistics {
        let range = scalar_range(scalars.values());
        TableStatistics {
            longest_edge: longest_edge(mesh),
            mean_chord: mean_chord(mesh),
            range,
            spread: scalar_histogram(mesh, scalars, range).to_vec(),
        }
    }

    /// The same with the scalars seen in another range, whose ends stand for all that is beyond them.
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
    /// Has tables made for what these say, in place of its own mesh: of a piece of a mesh, those of
    /// the whole. Its range of scalars stays; see [`Geometry::set_scalars`].
    pub fn set_table_statistics(&mut self, measures: &TableStatistics) {
        self.longest_edge = measures.longest_edge / self.frame.scale;
        self.mean_chord = measures.mean_chord / self.frame.scale;
        self.spread = measures.spread.as_slice().into();
    }
}

/// Smallest and largest scalar, apart by 1 where they are equal.
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

/// The longest edge, of parts by several threads.
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

/// Four times the volume over the surface, of all tets together: the mean chord of convex bodies
/// (Cauchy).
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

/// The share of the volume whose scalar lies in each of [`HISTOGRAM_BINS`] equal parts of the range: of every
/// so many tets in large meshes.
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
    let whole: f64 = spread.iter().sum();
    let each = |part: &mut f64| *part /= whole.max(f64::MIN_POSITIVE);
    spread.iter_mut().for_each(each);
    spread.into()
}
