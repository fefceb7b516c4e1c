//! Wanted edge lengths by place: from a volume of lengths, or from the tets of another mesh.

use crate::mesh::{Bvh, ElementOrder, Location, PIECES, TetMesh};
use crate::volume::Volume;
use crate::{Error, Result};
use glam::{DAffine3, DVec3};

/// Name of a cell field of edge lengths, in file units.
pub(crate) const EDGE_LENGTH: &str = "edge_length";
/// Name of a cell field of shares in an error.
const ERROR: &str = "error";
/// Largest factor by which tets are made larger or smaller because of their error.
const MOST_CHANGED: f64 = 4.0;
/// Share of the elements of a mesh that may be small only because a boundary cuts them.
const CUT_SHARE: f64 = 0.02;
/// Edge length of an element, relative to what is compared, that counts by itself.
const FAR_SMALLER: f64 = 0.125;
/// Largest number of doublings from the smallest to the largest edge length of a mesh.
const MAX_LEVELS: f64 = 10.0;

/// Wanted edge lengths of tets, by place. Where it says nothing, tets are as large as its largest, or
/// twice as large as those beside.
#[derive(Clone, Debug)]
pub struct SizeField {
    source: Source,
    smallest: f64,
    largest: f64,
}

#[derive(Clone, Debug)]
enum Source {
    /// Wanted edge lengths of elements and their own, with their centroids.
    Elements {
        lengths: Vec<f64>,
        own: Vec<f64>,
        tree: Bvh,
    },
    /// Edge lengths of voxels.
    Voxels {
        volume: Box<Volume>,
        from_world: DAffine3,
    },
}

impl SizeField {
    /// Returns the field of a volume whose values are edge lengths in mm; of other values than positive
    /// ones it says nothing.
    ///
    /// # Errors
    /// [`Error::Input`] for a volume without positive values.
    pub fn of_volume(volume: Volume) -> Result<SizeField> {
        let values = (0..volume.voxels()).map(|n| volume.value(n));
        let [smallest, largest] = extremes(values);
        let from_world = volume.to_world.inverse();
        SizeField {
            source: Source::Voxels {
                volume: Box::new(volume),
                from_world,
            },
            smallest,
            largest,
        }
        .checked()
    }

    /// Returns the field of the elements of a mesh, in its unit: of the cell field `edge_length` if it
    /// has one. Otherwise their own size, which is changed if there is a cell field `error` of shares
    /// in an error, as in the file `error.vtu` of a press: to the size at which elements of that order
    /// have equal shares, (η̄/η)^(1/(2p + 3)) times the own one, by at most a factor of four.
    ///
    /// # Errors
    /// [`Error::Input`] for a field without positive lengths.
    pub fn of_mesh(mesh: &TetMesh) -> Result<SizeField> {
        let pieces = match mesh.order {
            ElementOrder::Linear => 1,
            ElementOrder::Quadratic => PIECES,
        };
        let elements = mesh.tets.len() / pieces;
        let field = |name: &str| -> Option<Vec<f64>> {
            let own = mesh.fields.iter().find(|field| {
                field.name == name && field.location == Location::Cell && field.components == 1
            })?;
            Some((0..elements).map(|e| own.values[pieces * e]).collect())
        };
        let own_length = |e: usize| {
            let volume: f64 = (pieces * e..pieces * (e + 1))
                .map(|t| mesh.tet_volume(t).abs())
                .sum();
            // A tet of the lattice with leaves of side s has the volume s³/12.
            (12.0 * volume).cbrt()
        };
        let own: Vec<f64> = (0..elements).map(own_length).collect();
        let lengths: Vec<f64> = match (field(EDGE_LENGTH), field(ERROR)) {
            (Some(lengths), _) => lengths,
            (None, Some(errors)) => with_equal_errors(&own, &errors, mesh.order),
            (None, None) => own.clone(),
        };
        let centre = |e: usize| {
            let corners = mesh.tets[pieces * e..pieces * (e + 1)].as_flattened();
            let sum: DVec3 = corners.iter().map(|v| mesh.nodes[*v as usize]).sum();
            sum / corners.len() as f64
        };
        let mut tree = Bvh::new(elements, centre);
        tree.refit(|e| [centre(e); 2]);
        let [mut smallest, largest] = extremes(lengths.iter().copied());
        if field(EDGE_LENGTH).is_none() && field(ERROR).is_none() {
            let mut sorted = lengths.clone();
            sorted.sort_by(f64::total_cmp);
            let first = (CUT_SHARE * elements as f64) as usize;
            smallest = sorted.get(first).map_or(smallest, |own| own.max(smallest));
        }
        SizeField {
            source: Source::Elements { lengths, own, tree },
            smallest,
            largest,
        }
        .checked()
    }

    fn checked(self) -> Result<SizeField> {
        if !(self.smallest > 0.0 && self.smallest <= self.largest && self.largest.is_finite()) {
            return Err(Error::Input(
                "the size field has no positive edge length; give a volume of edge lengths in mm, or a mesh".into(),
            ));
        }
        Ok(self)
    }

    /// The smallest edge length.
    pub fn smallest(&self) -> f64 {
        self.smallest
    }

    /// Returns the number of doublings from the smallest to the largest edge length of tets.
    pub(super) fn levels(&self) -> u32 {
        let doublings = (self.largest / self.smallest).log2().round();
        doublings.min(MAX_LEVELS) as u32
    }

    /// Whether edge lengths in the box from `low` to `high` are below `length`: of a volume those of any
    /// voxel; of a mesh the mean, because tets that a boundary cuts are smaller than is wanted, or
    /// that of an element if it is far smaller.
    pub(super) fn is_finer_in(&self, low: DVec3, high: DVec3, length: f64) -> bool {
        if length <= self.smallest {
            return false;
        }
        match &self.source {
            Source::Elements { lengths, own, tree } => {
                let (mut volume, mut wanted, mut smallest) = (0.0, 0.0, f64::INFINITY);
                tree.for_each_overlapping(&[low, high], |e| {
                    let (length, own) = (lengths[e as usize], own[e as usize]);
                    if length > 0.0 && length.is_finite() {
                        volume += own.powi(3);
                        wanted += (own / length).powi(3);
                        smallest = smallest.min(length);
                    }
                });
                // In tets of a lattice: `wanted` of them in this volume.
                volume < wanted * length.powi(3) || smallest < FAR_SMALLER * length
            }
            Source::Voxels { volume, from_world } => {
                is_voxel_finer((volume, from_world), [low, high], length)
            }
        }
    }
}

/// Whether a voxel with its centre in a box, or the nearest to it, has a positive value below `length`.
fn is_voxel_finer(
    (volume, from_world): (&Volume, &DAffine3),
    bounds: [DVec3; 2],
    length: f64,
) -> bool {
    let corners = (0..8).map(|k| {
        let pick = |axis: usize| bounds[k >> axis & 1][axis];
        from_world.transform_point3(DVec3::new(pick(0), pick(1), pick(2)))
    });
    let [first, last] = corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[a, b], p| {
        [a.min(p), b.max(p)]
    });
    let range = |axis: usize| {
        let most = volume.size[axis] as f64 - 1.0;
        let (from, to) = (first[axis].round().max(0.0), last[axis].round().min(most));
        // Empty beside the volume.
        from as usize..(to + 1.0).max(from) as usize
    };
    let [size_x, size_y, _] = volume.size;
    range(2).any(|k| {
        range(1).any(|j| {
            range(0).any(|i| {
                let own = volume.value(i + size_x * (j + size_y * k));
                own > 0.0 && own < length
            })
        })
    })
}

/// Returns the smallest and the largest of the values that are positive and finite.
fn extremes(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values
        .filter(|value| *value > 0.0 && value.is_finite())
        .fold([f64::INFINITY, 0.0], |[low, high], value| {
            [low.min(value), high.max(value)]
        })
}

/// Returns the lengths at which elements of `order` have equal errors, as many as there are: the error
/// in energy of an element of size h is in proportion to h^(2p + 3).
fn with_equal_errors(own: &[f64], errors: &[f64], order: ElementOrder) -> Vec<f64> {
    let power = 1.0 / (2.0 * f64::from(order.number()) + 3.0);
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let factor = |error: f64| match error > 0.0 {
        true => (mean / error)
            .powf(power)
            .clamp(1.0 / MOST_CHANGED, MOST_CHANGED),
        false => MOST_CHANGED,
    };
    // Elements of size h have h⁻³ per volume; in sum as many as before.
    let sum: f64 = errors.iter().map(|error| factor(*error).powi(-3)).sum();
    let same = (sum / own.len().max(1) as f64).cbrt();
    own.iter()
        .zip(errors)
        .map(|(length, error)| same * factor(*error) * length)
        .collect()
}
