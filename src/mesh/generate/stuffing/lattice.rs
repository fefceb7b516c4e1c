//! The body-centred cubic lattice that is laid over a solid.

use crate::{Error, Result};
use glam::DVec3;

/// A body-centred cubic lattice: first the corners of all cells, then their centres.
pub(super) struct Lattice {
    cells: [usize; 3],
    corners: usize,
}

impl Lattice {
    pub(super) fn new(cells: [usize; 3]) -> Result<Lattice> {
        let corners = cells
            .iter()
            .try_fold(1usize, |product, n| product.checked_mul(n.checked_add(1)?))
            .filter(|n| *n <= u32::MAX as usize / 48);
        match corners {
            Some(corners) if cells.iter().all(|n| *n > 1) => Ok(Lattice { cells, corners }),
            _ => Err(Error::Input(format!(
                "a lattice of {} × {} × {} cells is too small or too large to be filled; change the resolution",
                cells[0], cells[1], cells[2]
            ))),
        }
    }

    pub(super) fn points(&self) -> usize {
        self.corners + self.cells.iter().product::<usize>()
    }

    fn corner(&self, [i, j, k]: [usize; 3]) -> usize {
        i + (self.cells[0] + 1) * (j + (self.cells[1] + 1) * k)
    }

    fn centre(&self, [i, j, k]: [usize; 3]) -> usize {
        self.corners + i + self.cells[0] * (j + self.cells[1] * k)
    }

    /// The grid coordinates of a point, and whether it is a centre.
    fn coordinates(&self, point: usize) -> ([usize; 3], bool) {
        let is_centre = point >= self.corners;
        let (index, along) = match is_centre {
            true => (point - self.corners, self.cells),
            false => (point, self.cells.map(|n| n + 1)),
        };
        let (row, plane) = (along[0], along[0] * along[1]);
        ([index % row, index % plane / row, index / plane], is_centre)
    }

    pub(super) fn position(&self, point: usize) -> DVec3 {
        let (at, is_centre) = self.coordinates(point);
        DVec3::from(at.map(|i| i as f64)) + if is_centre { 0.5 } else { 0.0 }
    }

    /// Whether the edge between two lattice neighbours is a long one.
    pub(super) fn is_long(&self, a: usize, b: usize) -> bool {
        (a < self.corners) == (b < self.corners)
    }

    /// The up to 14 lattice points that share an edge with `point`.
    pub(super) fn neighbours(&self, point: usize) -> impl Iterator<Item = usize> {
        let (at, is_centre) = self.coordinates(point);
        let own = self.cells.map(|n| if is_centre { n } else { n + 1 });
        let other = self.cells.map(|n| if is_centre { n + 1 } else { n });
        let shifted = move |steps: [isize; 3], limit: [usize; 3]| {
            let mut to = [0; 3];
            for axis in 0..3 {
                to[axis] = at[axis].checked_add_signed(steps[axis])?;
                if to[axis] >= limit[axis] {
                    return None;
                }
            }
            Some(to)
        };
        let long = (0..6).filter_map(move |n: usize| {
            let mut steps = [0; 3];
            steps[n / 2] = if n.is_multiple_of(2) { -1 } else { 1 };
            let to = shifted(steps, own)?;
            Some(if is_centre {
                self.centre(to)
            } else {
                self.corner(to)
            })
        });
        let short = (0..8).filter_map(move |n: usize| {
            let bit = |axis: usize| (n >> axis & 1) as isize - isize::from(!is_centre);
            let to = shifted([bit(0), bit(1), bit(2)], other)?;
            Some(if is_centre {
                self.corner(to)
            } else {
                self.centre(to)
            })
        });
        long.chain(short)
    }

    /// Every tet of the lattice: two neighbouring centres and an edge of the face between them.
    pub(super) fn for_each_tet(&self, mut visit: impl FnMut([usize; 4])) {
        let [nx, ny, nz] = self.cells;
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    for axis in 0..3 {
                        let cell = [i, j, k];
                        let mut next = cell;
                        next[axis] += 1;
                        if next[axis] >= self.cells[axis] {
                            continue;
                        }
                        let face = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[u, v]| {
                            let mut corner = next;
                            corner[(axis + 1) % 3] += u;
                            corner[(axis + 2) % 3] += v;
                            self.corner(corner)
                        });
                        for side in 0..4 {
                            visit([
                                self.centre(cell),
                                self.centre(next),
                                face[side],
                                face[(side + 1) % 4],
                            ]);
                        }
                    }
                }
            }
        }
    }
}
