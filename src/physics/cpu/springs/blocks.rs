//! Blocks of 64 springs in structure-of-arrays layout, and the inner loops over them.
//!
//! One loop gathers the differences of the springs' ends, one computes in SIMD lanes, one scatters
//! the results.

use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::{SymMat3, V4, add, sub};

/// Number of springs in a block.
pub(in crate::physics::cpu) const BLOCK_SIZE: usize = 64;

/// One vector per spring.
pub(in crate::physics::cpu) type BlockVectors<T> = [V4<T>; BLOCK_SIZE];

/// A block of springs; the padding of the last block of a list has zero stiffness.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct Block<T> {
    pub i: [u32; BLOCK_SIZE],
    pub j: [u32; BLOCK_SIZE],
    pub rest: [[T; BLOCK_SIZE]; 3],
    pub length: [T; BLOCK_SIZE],
    /// |D|² − L².
    pub squared_stretch: [T; BLOCK_SIZE],
    pub stiffness: [T; BLOCK_SIZE],
    /// Number of actual springs, without padding.
    pub count: usize,
}

/// Each spring's part of A as q qᵀ + b I, stored as q and b: added to the diagonal blocks of its
/// ends, and subtracted from the blocks between them.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct SpringHessians<T>(pub [V4<T>; BLOCK_SIZE]);

impl<T: Real> Block<T> {
    /// Computes b_j − a_i.
    #[inline(always)]
    pub fn differences(&self, [a, b]: [&[V4<T>]; 2], out: &mut BlockVectors<T>) {
        for ((o, i), j) in out.iter_mut().zip(&self.i).zip(&self.j) {
            *o = sub(b[*j as usize], a[*i as usize]);
        }
    }

    /// Adds the results to nodes i and, if `both` ends are in the chunk, subtracts them from nodes
    /// j.
    #[inline(always)]
    pub fn scatter(&self, both: bool, shares: &BlockVectors<T>, out: &mut [V4<T>]) {
        for ((s, i), j) in shares.iter().zip(&self.i).zip(&self.j) {
            let (i, j) = (*i as usize, *j as usize);
            out[i] = add(out[i], *s);
            if both {
                out[j] = sub(out[j], *s);
            }
        }
    }

    /// Returns d, |d|² and 1/((|d| + L) |d|) of spring n with the difference e, and |d|² − L².
    #[inline(always)]
    pub(super) fn lengths(&self, n: usize, e: V4<T>) -> ([T; 3], T, T, T) {
        let d = [
            self.rest[0][n] + e[0],
            self.rest[1][n] + e[1],
            self.rest[2][n] + e[2],
        ];
        // The fourth lane is zero; including it makes one vector load of all four.
        let square = (d[0] * d[0] + d[1] * d[1]) + (d[2] * d[2] + e[3] * e[3]);
        let square = square.max(T::MIN_DISTANCE_SQUARED);
        let l = square.sqrt();
        let over = T::ONE / ((l + self.length[n]) * l);
        // |d|² − L².
        let gain = e[0] * (self.rest[0][n] + d[0])
            + e[1] * (self.rest[1][n] + d[1])
            + e[2] * (self.rest[2][n] + d[2]);
        let gain = gain + self.squared_stretch[n];
        // Values at a wave front would be subnormal, and ten times as slow.
        let some = gain > T::MIN_LENGTH_CHANGE || gain < -T::MIN_LENGTH_CHANGE;
        (d, square, over, if some { gain } else { T::ZERO })
    }

    /// Computes the spring forces on nodes i, and κ times stretch², lane by lane.
    #[inline(always)]
    pub fn pull<const DAMPED: u8>(
        &self,
        damping: [T; 2],
        e: &BlockVectors<T>,
        w: &BlockVectors<T>,
        f: &mut BlockVectors<T>,
        energy: &mut [T; BLOCK_SIZE],
    ) {
        for n in 0..BLOCK_SIZE {
            let (d, square, over, gain) = self.lengths(n, e[n]);
            let k = self.stiffness[n];
            // Relative stretch.
            let s = gain * over;
            let mut along = k * s;
            energy[n] = along * s * square;
            let mut relative = T::ZERO;
            if DAMPED == 1 {
                let dw = d[0] * w[n][0] + d[1] * w[n][1] + d[2] * w[n][2];
                // Flushes negligible values to zero, as for the stretch.
                let some = dw > T::MIN_LENGTH_CHANGE || dw < -T::MIN_LENGTH_CHANGE;
                let dw = if some { dw } else { T::ZERO };
                along += (damping[0] + damping[1] * k) * dw / square;
            }
            if DAMPED == 2 {
                relative = damping[0] + damping[1] * k;
            }
            f[n] = [along * d[0], along * d[1], along * d[2], T::ZERO];
            if DAMPED == 2 {
                for axis in 0..3 {
                    f[n][axis] += relative * w[n][axis];
                }
            }
        }
        // The padding of a block would be damped, but its ends do not differ.
    }

    /// Computes the damping forces alone on nodes i.
    #[inline(always)]
    pub fn subtract_damping_forces(
        &self,
        damping: [T; 2],
        axial: bool,
        e: &BlockVectors<T>,
        w: &BlockVectors<T>,
        f: &mut BlockVectors<T>,
    ) {
        for n in 0..BLOCK_SIZE {
            let (d, square, _, _) = self.lengths(n, e[n]);
            let c = damping[0] + damping[1] * self.stiffness[n];
            let dw = d[0] * w[n][0] + d[1] * w[n][1] + d[2] * w[n][2];
            let along = c * dw / square;
            f[n] = match axial {
                true => [along * d[0], along * d[1], along * d[2], T::ZERO],
                false => [c * w[n][0], c * w[n][1], c * w[n][2], T::ZERO],
            };
        }
    }

    /// Computes the springs' parts of A, and κ((1 − t) n n·w + t w) with w the velocity difference.
    #[inline(always)]
    pub fn linearise(
        &self,
        (h, damping, axial): (T, [T; 2], bool),
        [e, w]: [&BlockVectors<T>; 2],
        links: &mut SpringHessians<T>,
        change: &mut BlockVectors<T>,
    ) {
        for n in 0..BLOCK_SIZE {
            let (d, square, over, gain) = self.lengths(n, e[n]);
            let k = self.stiffness[n];
            // A spring of zero length has no direction and resists displacement in all directions.
            let stretch = (gain * over).max(T::ZERO);
            let t = match self.length[n] > T::ZERO {
                true => stretch,
                false => T::ONE,
            };
            let c = h * (damping[0] + damping[1] * k);
            let (axial, relative) = match axial {
                true => (c, T::ZERO),
                false => (T::ZERO, c),
            };
            let stiff = k * (T::ONE - t);
            let q = ((h * h * stiff + axial) / square).max(T::ZERO).sqrt();
            let b = h * h * k * t + relative;
            links.0[n] = [q * d[0], q * d[1], q * d[2], b];
            let dw = d[0] * w[n][0] + d[1] * w[n][1] + d[2] * w[n][2];
            let along = stiff * dw / square;
            let across = k * t;
            change[n] = [
                along * d[0] + across * w[n][0],
                along * d[1] + across * w[n][1],
                along * d[2] + across * w[n][2],
                T::ZERO,
            ];
        }
        // The damping of padding must not contribute to its node.
        links.0[self.count..].fill([T::ZERO; 4]);
    }
}

impl<T: Real> SpringHessians<T> {
    /// Writes the 3×3 blocks.
    #[inline(always)]
    pub fn blocks(&self, out: &mut [SymMat3<T>; BLOCK_SIZE]) {
        for (out, [x, y, z, b]) in out.iter_mut().zip(self.0) {
            *out = [
                x * x + b,
                y * y + b,
                z * z + b,
                x * y,
                x * z,
                y * z,
                T::ZERO,
                T::ZERO,
            ];
        }
    }
}
