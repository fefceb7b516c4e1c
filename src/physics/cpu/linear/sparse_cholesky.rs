//! Sparse Cholesky factorisation in 6×6 blocks, for the coarse matrix.
//!
//! The matrix is ordered by nested dissection, analysed once per pattern, factorised in f64 when
//! its values change, and stored in the engine's precision for solving.

use crate::physics::cpu::scalar::Real;

/// Unknowns per block.
pub const DOF_PER_GROUP: usize = 6;

/// A 6×6 block in f64, by columns.
pub type Block = [[f64; DOF_PER_GROUP]; DOF_PER_GROUP];

/// A vector of a block's unknowns, padded.
pub type Vec6Padded<T> = [T; 8];

/// A block stored for solving: columns, padded.
type PackedBlock<T> = [Vec6Padded<T>; DOF_PER_GROUP];

/// The factor L of A = L Lᵀ.
#[derive(Clone, Debug)]
pub struct SparseCholesky<T> {
    /// The group eliminated k-th, and the inverse order.
    order: Vec<u32>,
    inverse_order: Vec<u32>,
    /// Column k has the rows `rows[starts[k]..starts[k + 1]]`, ascending, beginning with the
    /// diagonal.
    starts: Vec<usize>,
    rows: Vec<u32>,
    /// Columns before k that contain row k, with the position of that row in them.
    ahead: Vec<(u32, u32)>,
    row_starts: Vec<usize>,
    /// In f64: A, then L, with L⁻¹ on the diagonal.
    factor_f64: Vec<Block>,
    factor: Vec<PackedBlock<T>>,
    vector: Vec<Vec6Padded<T>>,
    places: Vec<u32>,
}

impl<T: Real> SparseCholesky<T> {
    /// Analyses the pattern of a matrix of `groups` block rows with the given off-diagonal pairs of
    /// groups, each pair in both orders, sorted.
    pub fn new(groups: usize, pairs: &[(u32, u32)]) -> SparseCholesky<T> {
        let mut starts = vec![0usize; groups + 1];
        for (a, _) in pairs {
            starts[*a as usize + 1] += 1;
        }
        for g in 0..groups {
            starts[g + 1] += starts[g];
        }
        let around = |g: u32| &pairs[starts[g as usize]..starts[g as usize + 1]];
        let mut order = Vec::with_capacity(groups);
        let mut mark = vec![0u32; groups];
        let mut stamp = 0;
        nested_dissection(
            (0..groups as u32).collect(),
            &around,
            &mut order,
            &mut mark,
            &mut stamp,
        );
        let mut inverse_order = vec![0u32; groups];
        for (k, g) in order.iter().enumerate() {
            inverse_order[*g as usize] = k as u32;
        }
        // The rows of a column are its own, and those of the columns whose first row it is.
        let mut columns: Vec<Vec<u32>> = Vec::with_capacity(groups);
        let mut children: Vec<Vec<u32>> = vec![Vec::new(); groups];
        let mut seen = vec![u32::MAX; groups];
        for k in 0..groups as u32 {
            let mut rows = vec![k];
            seen[k as usize] = k;
            let own = around(order[k as usize])
                .iter()
                .map(|p| inverse_order[p.1 as usize]);
            let inherited = children[k as usize]
                .iter()
                .flat_map(|c| columns[*c as usize].iter().copied());
            for r in own.chain(inherited) {
                if r > k && seen[r as usize] != k {
                    seen[r as usize] = k;
                    rows.push(r);
                }
            }
            rows.sort_unstable();
            if let Some(parent) = rows.get(1) {
                children[*parent as usize].push(k);
            }
            columns.push(rows);
        }
        let mut ahead = vec![Vec::new(); groups];
        let (mut starts, mut rows) = (vec![0], Vec::new());
        for (k, column) in columns.into_iter().enumerate() {
            for (n, r) in column.iter().enumerate().skip(1) {
                ahead[*r as usize].push((k as u32, (rows.len() + n) as u32));
            }
            rows.extend(column);
            starts.push(rows.len());
        }
        let mut row_starts = vec![0];
        for list in &ahead {
            row_starts.push(row_starts[row_starts.len() - 1] + list.len());
        }
        SparseCholesky {
            ahead: ahead.into_iter().flatten().collect(),
            row_starts,
            factor_f64: vec![[[0.0; DOF_PER_GROUP]; DOF_PER_GROUP]; rows.len()],
            factor: vec![[[T::ZERO; 8]; DOF_PER_GROUP]; rows.len()],
            vector: vec![[T::ZERO; 8]; groups],
            places: vec![0; groups],
            order,
            inverse_order,
            starts,
            rows,
        }
    }

    /// Sets the matrix to zero.
    pub fn clear(&mut self) {
        self.factor_f64.fill([[0.0; DOF_PER_GROUP]; DOF_PER_GROUP]);
    }

    /// Returns the index of the block between two groups, and whether the stored block is the
    /// transposed (b, a). `None` if the pair is not in the pattern.
    pub fn block_index(&self, a: u32, b: u32) -> Option<(usize, bool)> {
        let [p, q] = [a, b].map(|g| self.inverse_order[g as usize]);
        let (row, column) = (p.max(q), p.min(q) as usize);
        let rows = &self.rows[self.starts[column]..self.starts[column + 1]];
        let n = rows.binary_search(&row).ok()?;
        Some((self.starts[column] + n, p < q))
    }

    /// Returns a block of the matrix to add to.
    pub fn block_mut(&mut self, place: usize) -> &mut Block {
        &mut self.factor_f64[place]
    }

    /// Factorises the matrix assembled since [`SparseCholesky::clear`]. Returns whether it is
    /// positive definite; if not, it cannot be used for solving.
    pub fn factorise(&mut self) -> bool {
        for k in 0..self.order.len() {
            let own = self.starts[k]..self.starts[k + 1];
            for (n, r) in self.rows[own.clone()].iter().enumerate() {
                self.places[*r as usize] = (own.start + n) as u32;
            }
            for a in self.row_starts[k]..self.row_starts[k + 1] {
                let (j, at) = self.ahead[a];
                let end = self.starts[j as usize + 1];
                let (done, open) = self.factor_f64.split_at_mut(own.start);
                let across = &done[at as usize];
                let below = at as usize..end;
                for (block, row) in done[below.clone()].iter().zip(&self.rows[below]) {
                    let place = self.places[*row as usize] as usize;
                    subtract_product(block, across, &mut open[place - own.start]);
                }
            }
            let Some(inverse) = inverse_factor(&self.factor_f64[own.start]) else {
                return false;
            };
            self.factor_f64[own.start] = inverse;
            for m in own.start + 1..own.end {
                self.factor_f64[m] = times_transposed(&self.factor_f64[m], &inverse);
            }
        }
        for (kept, work) in self.factor.iter_mut().zip(&self.factor_f64) {
            for (to, from) in kept.iter_mut().zip(work) {
                for (to, from) in to.iter_mut().zip(from) {
                    *to = T::from_f64(*from);
                }
            }
        }
        true
    }

    /// Solves A x = b in place.
    pub fn solve(&mut self, x: &mut [Vec6Padded<T>]) {
        let y = &mut self.vector;
        for (y, g) in y.iter_mut().zip(&self.order) {
            *y = x[*g as usize];
        }
        for k in 0..self.order.len() {
            let (from, to) = (self.starts[k], self.starts[k + 1]);
            let mine = times(&self.factor[from], &y[k]);
            y[k] = mine;
            for (block, r) in self.factor[from + 1..to]
                .iter()
                .zip(&self.rows[from + 1..to])
            {
                let other = &mut y[*r as usize];
                for c in 0..DOF_PER_GROUP {
                    for r in 0..8 {
                        other[r] -= block[c][r] * mine[c];
                    }
                }
            }
        }
        for k in (0..self.order.len()).rev() {
            let (from, to) = (self.starts[k], self.starts[k + 1]);
            let mut sums = [[T::ZERO; 8]; DOF_PER_GROUP];
            for (block, r) in self.factor[from + 1..to]
                .iter()
                .zip(&self.rows[from + 1..to])
            {
                let other = &y[*r as usize];
                for c in 0..DOF_PER_GROUP {
                    for r in 0..8 {
                        sums[c][r] += block[c][r] * other[r];
                    }
                }
            }
            let mut mine = y[k];
            for c in 0..DOF_PER_GROUP {
                let s = sums[c];
                mine[c] -= (s[0] + s[1]) + (s[2] + s[3]) + (s[4] + s[5]);
            }
            let mut out = [T::ZERO; 8];
            for (o, column) in out.iter_mut().zip(&self.factor[from]) {
                for (c, m) in column.iter().zip(&mine) {
                    *o += *c * *m;
                }
            }
            y[k] = out;
        }
        for (y, g) in y.iter().zip(&self.order) {
            x[*g as usize] = *y;
        }
    }
}

/// Orders both halves before their separator; the groups of a half are close in space, because
/// [`crate::physics::cpu::aggregation::Aggregates`] orders them.
fn nested_dissection<'a>(
    groups: Vec<u32>,
    around: &impl Fn(u32) -> &'a [(u32, u32)],
    out: &mut Vec<u32>,
    mark: &mut [u32],
    stamp: &mut u32,
) {
    if groups.len() <= 4 {
        out.extend(groups);
        return;
    }
    *stamp += 1;
    let mut left = groups;
    let right = left.split_off(left.len() / 2);
    left.iter().for_each(|g| mark[*g as usize] = *stamp);
    let touches = |g: &u32| around(*g).iter().any(|p| mark[p.1 as usize] == *stamp);
    let (between, right): (Vec<u32>, Vec<u32>) = right.into_iter().partition(touches);
    nested_dissection(left, around, out, mark, stamp);
    nested_dissection(right, around, out, mark, stamp);
    out.extend(between);
}

/// Computes c −= a bᵀ.
#[inline(always)]
fn subtract_product(a: &Block, b: &Block, c: &mut Block) {
    for (a, b) in a.iter().zip(b) {
        for (c, b) in c.iter_mut().zip(b) {
            for (c, a) in c.iter_mut().zip(a) {
                *c -= a * b;
            }
        }
    }
}

/// Returns a bᵀ.
fn times_transposed(a: &Block, b: &Block) -> Block {
    let mut out = [[0.0; DOF_PER_GROUP]; DOF_PER_GROUP];
    for (a, b) in a.iter().zip(b) {
        for (o, b) in out.iter_mut().zip(b) {
            for (o, a) in o.iter_mut().zip(a) {
                *o += a * b;
            }
        }
    }
    out
}

/// Returns L⁻¹ for a = L Lᵀ.
pub(in crate::physics::cpu) fn inverse_factor(a: &Block) -> Option<Block> {
    let mut l = *a;
    for k in 0..DOF_PER_GROUP {
        for j in 0..k {
            for i in k..DOF_PER_GROUP {
                l[k][i] -= l[j][i] * l[j][k];
            }
        }
        if !(l[k][k] > 0.0 && l[k][k].is_finite()) {
            return None;
        }
        let root = l[k][k].sqrt();
        for entry in &mut l[k][k..] {
            *entry /= root;
        }
    }
    let mut inverse = [[0.0; DOF_PER_GROUP]; DOF_PER_GROUP];
    for (c, column) in inverse.iter_mut().enumerate() {
        for r in c..DOF_PER_GROUP {
            let mut sum = f64::from(u8::from(r == c));
            for k in c..r {
                sum -= l[k][r] * column[k];
            }
            column[r] = sum / l[r][r];
        }
    }
    Some(inverse)
}

/// Returns m v.
#[inline(always)]
fn times<T: Real>(m: &PackedBlock<T>, v: &Vec6Padded<T>) -> Vec6Padded<T> {
    let mut out = [T::ZERO; 8];
    for c in 0..DOF_PER_GROUP {
        for r in 0..8 {
            out[r] += m[c][r] * v[c];
        }
    }
    out
}
