//! Block CSR rows of a chunk's nodes in a sparse matrix of 3×3 blocks.
//!
//! The matrix is symmetric and translations are in its null space: only the blocks above the
//! diagonal are accumulated; those below are their transposes, and each diagonal block is minus the
//! sum of the others in its row.

use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{Mat3Columns, SymMat3, V4, sum_f64, zero};
use glam::DMat3;
use std::ops::Range;

/// No slot.
pub(in crate::physics::cpu) const NO_SLOT: u32 = u32::MAX;

/// Flag of a slot whose block is added transposed.
pub(in crate::physics::cpu) const TRANSPOSED_FLAG: u32 = 1 << 31;

/// Rows in CSR format: columns ascending, each a node of the body.
#[derive(Clone, Debug, Default)]
pub(in crate::physics::cpu) struct BlockCsr<T> {
    nodes: Range<usize>,
    starts: Vec<u32>,
    columns: Vec<u32>,
    /// Slot of each row's diagonal block.
    diagonal: Vec<u32>,
    /// Slot above the diagonal that this one is the transpose of, or [`NO_SLOT`].
    mirror: Vec<u32>,
    /// One block per slot, columns padded.
    pub values: Vec<Mat3Columns<T>>,
}

impl<T: Real> BlockCsr<T> {
    /// Creates the rows `nodes` of a matrix that couples the nodes of each element.
    pub fn new<'a>(nodes: Range<usize>, elements: impl Iterator<Item = &'a [u32]>) -> BlockCsr<T> {
        let mut entries: Vec<(u32, u32)> = nodes.clone().map(|i| (i as u32, i as u32)).collect();
        for element in elements {
            for i in element.iter().filter(|i| nodes.contains(&(**i as usize))) {
                entries.extend(element.iter().map(|j| (*i, *j)));
            }
        }
        entries.sort_unstable();
        entries.dedup();
        let count = entries.len();
        let mut rows = BlockCsr {
            starts: vec![0],
            columns: entries.iter().map(|e| e.1).collect(),
            diagonal: Vec::with_capacity(nodes.len()),
            mirror: vec![NO_SLOT; count],
            values: vec![[zero(); 3]; count],
            nodes,
        };
        for (k, (i, j)) in entries.iter().enumerate() {
            if i == j {
                rows.diagonal.push(k as u32);
            }
            if entries.get(k + 1).is_none_or(|next| next.0 != *i) {
                rows.starts.push(k as u32 + 1);
            }
        }
        for (k, (i, j)) in entries.iter().enumerate() {
            if j < i {
                rows.mirror[k] = rows.slot(*j, *i).unwrap_or(NO_SLOT);
            }
        }
        rows
    }

    /// Returns the slot to which the block K_ij is added: above the diagonal if the row of the
    /// smaller node is here, else below it if the row of the larger one is, else [`NO_SLOT`].
    pub fn entry_slot(&self, i: u32, j: u32) -> u32 {
        let above = (i.min(j), i.max(j));
        let below = (above.1, above.0);
        let flagged = |place: (u32, u32)| {
            let flag = if place == (i, j) { 0 } else { TRANSPOSED_FLAG };
            self.slot(place.0, place.1).map(|slot| slot | flag)
        };
        flagged(above).or_else(|| flagged(below)).unwrap_or(NO_SLOT)
    }

    fn slot(&self, i: u32, j: u32) -> Option<u32> {
        let row = (i as usize).checked_sub(self.nodes.start)?;
        let from = *self.starts.get(row)? as usize;
        let to = *self.starts.get(row + 1)? as usize;
        let found = self.columns[from..to].binary_search(&j).ok()?;
        Some((from + found) as u32)
    }

    /// Adds a block above the diagonal.
    #[inline(always)]
    pub fn add(&mut self, slot: u32, block: &Mat3Columns<T>) {
        add(&mut self.values[slot as usize], block);
    }

    /// Adds a block at a slot from [`BlockCsr::entry_slot`].
    #[inline(always)]
    pub fn add_placed(&mut self, place: u32, block: &Mat3Columns<T>) {
        if place == NO_SLOT {
            return;
        }
        match place & TRANSPOSED_FLAG {
            0 => self.add(place, block),
            _ => self.add(place & !TRANSPOSED_FLAG, &transposed(block)),
        }
    }

    /// Fills in the blocks below and on the diagonal.
    pub fn finish(&mut self) {
        for (row, own) in self.diagonal.iter().enumerate() {
            let mut sum = [T::ZERO.splat(); 3];
            for k in self.starts[row] as usize..self.starts[row + 1] as usize {
                if k as u32 == *own {
                    continue;
                }
                let from = self.mirror[k];
                if from != NO_SLOT {
                    self.values[k] = transposed(&self.values[from as usize]);
                }
                for (s, c) in sum.iter_mut().zip(&self.values[k]) {
                    *s = *s - T::lanes(c);
                }
            }
            self.values[*own as usize] = sum.map(T::array);
        }
    }

    /// Fills in the blocks below the diagonal, and those on it from `diagonal`.
    pub fn finish_with_diagonal(&mut self, diagonal: &[SymMat3<T>]) {
        for k in 0..self.values.len() {
            let from = self.mirror[k];
            if from != NO_SLOT {
                self.values[k] = transposed(&self.values[from as usize]);
            }
        }
        for (own, d) in self.diagonal.iter().zip(diagonal) {
            let o = T::ZERO;
            let columns = [
                [d[0], d[3], d[4], o],
                [d[3], d[1], d[5], o],
                [d[4], d[5], d[2], o],
            ];
            self.values[*own as usize] = columns;
        }
    }

    /// Adds the diagonal blocks to those of the chunk's nodes.
    pub fn add_diagonal(&self, out: &mut [SymMat3<T>]) {
        for (d, own) in out.iter_mut().zip(&self.diagonal) {
            let [x, y, z] = self.values[*own as usize];
            for (d, m) in d.iter_mut().zip([x[0], y[1], z[2], y[0], z[0], z[1]]) {
                *d += m;
            }
        }
    }

    /// Adds `values` times p to the chunk's nodes; the fourth lanes are arbitrary.
    #[inline]
    pub fn multiply(&self, values: &[Mat3Columns<T>], p: &[V4<T>], y: &mut [V4<T>]) {
        self.each_product(values, p, y, |y, sum| {
            *y = T::array(T::lanes(y) + sum);
            0.0
        });
    }

    /// Subtracts `values` times w from the vectors of the chunk's nodes. Returns their part of
    /// w·values w.
    pub fn subtract_product(&self, values: &[Mat3Columns<T>], w: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        let first = self.nodes.start;
        let mut node = first;
        self.each_product(values, w, f, |f, sum| {
            *f = T::array(T::lanes(f) - sum);
            let product = T::array(T::lanes(&w[node]) * sum);
            node += 1;
            sum_f64(product)
        })
    }

    #[inline(always)]
    fn each_product(
        &self,
        values: &[Mat3Columns<T>],
        p: &[V4<T>],
        y: &mut [V4<T>],
        mut take: impl FnMut(&mut V4<T>, T::Lanes) -> f64,
    ) -> f64 {
        let (mut from, mut all) = (0, 0.0);
        for (y, to) in y.iter_mut().zip(&self.starts[1..]) {
            let to = *to as usize;
            // One accumulator per column, to avoid a serial dependency.
            let mut sums = [T::ZERO.splat(); 3];
            for (block, j) in values[from..to].iter().zip(&self.columns[from..to]) {
                let p = &p[*j as usize];
                for (k, sum) in sums.iter_mut().enumerate() {
                    *sum = *sum + T::lanes(&block[k]) * p[k].splat();
                }
            }
            all += take(y, sums[0] + (sums[1] + sums[2]));
            from = to;
        }
        all
    }

    /// Visits the blocks above the diagonal.
    pub fn visit_upper_blocks(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.pairs_of(self.nodes.clone(), visit);
    }

    /// As [`BlockCsr::visit_upper_blocks`], for the rows `nodes`.
    pub fn pairs_of(&self, nodes: Range<usize>, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for i in nodes.start.max(self.nodes.start)..nodes.end.min(self.nodes.end) {
            let row = i - self.nodes.start;
            for k in self.diagonal[row] as usize + 1..self.starts[row + 1] as usize {
                let wide = |c: V4<T>| glam::DVec3::new(c[0].to_f64(), c[1].to_f64(), c[2].to_f64());
                let [x, y, z] = self.values[k].map(wide);
                visit([i as u32, self.columns[k]], &DMat3::from_cols(x, y, z));
            }
        }
    }
}

#[inline(always)]
fn add<T: Real>(to: &mut Mat3Columns<T>, block: &Mat3Columns<T>) {
    for (to, b) in to.iter_mut().zip(block) {
        *to = T::array(T::lanes(to) + T::lanes(b));
    }
}

#[inline(always)]
fn transposed<T: Real>([x, y, z]: &Mat3Columns<T>) -> Mat3Columns<T> {
    let o = T::ZERO;
    [
        [x[0], y[0], z[0], o],
        [x[1], y[1], z[1], o],
        [x[2], y[2], z[2], o],
    ]
}
