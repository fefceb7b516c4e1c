//! Spring forces on a regular grid of particles, row by row in SIMD lanes: the inner loops of
//! [`super::body`].
//!
//! Every spring is computed once, from the particle at its lower end, for a run of consecutive
//! particles at a time: their neighbours of a kind all have the same offset in memory.

use crate::physics::cpu::scalar::Real;
use std::ops::Range;

/// Three arrays: x, y and z of every particle.
pub type SoaVec3<T> = [Vec<T>; 3];

/// A kind of spring in local units.
#[derive(Clone, Copy, Debug)]
pub struct SpringKind<T> {
    /// Index offset from a particle to its neighbour.
    pub offset: isize,
    /// Rest vector from a particle to its neighbour.
    pub rest: [T; 3],
    /// Rest length.
    pub length: T,
    /// κ.
    pub stiffness: T,
}

/// Forward springs of one kind from consecutive particles.
#[derive(Clone, Copy, Debug)]
pub struct SpringRun {
    /// The first particle.
    pub first: usize,
    /// Number of particles.
    pub count: usize,
    /// Index of the spring kind.
    pub kind: usize,
    /// Whether the particles, and their neighbours, belong to the slab.
    pub owned: [bool; 2],
}

/// Consecutive rows of the grid, with the forces on their particles.
#[derive(Clone, Debug)]
pub struct Slab<T> {
    /// Runs with an end in the slab.
    pub runs: Vec<SpringRun>,
    /// Runs of particles to move, in the numbering of the whole grid.
    pub particles: Vec<Range<usize>>,
    /// Forces on all particles of the slab, beginning with its first.
    pub forces: SoaVec3<T>,
    scratch: SoaVec3<T>,
}

impl<T: Real> Slab<T> {
    /// Creates a slab of `length` particles, with runs of at most `longest`.
    pub fn new(
        runs: Vec<SpringRun>,
        particles: Vec<Range<usize>>,
        length: usize,
        longest: usize,
    ) -> Slab<T> {
        let zeros = |n: usize| std::array::from_fn(|_| vec![T::ZERO; n]);
        Slab {
            runs,
            particles,
            forces: zeros(length),
            scratch: zeros(longest),
        }
    }

    /// Writes the spring forces at the displacements `u` into [`Slab::forces`]. `factors` and
    /// `springs` are those of all particles; `first` is the slab's first particle.
    pub fn spring_forces(
        &mut self,
        first: usize,
        kinds: &[SpringKind<T>; 9],
        u: &SoaVec3<T>,
        factors: &[T],
        springs: &[u32],
    ) {
        for f in &mut self.forces {
            f.fill(T::ZERO);
        }
        for run in &self.runs {
            let (i, n) = (run.first, run.count);
            let kind = &kinds[run.kind];
            let j = i.wrapping_add_signed(kind.offset);
            let [sx, sy, sz] = self.scratch.each_mut().map(|s| &mut s[..n]);
            pull(
                kind,
                2 * run.kind as u32,
                u.each_ref().map(|a| (&a[i..i + n], &a[j..j + n])),
                (&factors[i..i + n], &factors[j..j + n]),
                &springs[i..i + n],
                [sx, sy, sz],
            );
            for (f, share) in self.forces.iter_mut().zip(&self.scratch) {
                if run.owned[0] {
                    for (f, s) in f[i - first..i - first + n].iter_mut().zip(&share[..n]) {
                        *f += *s;
                    }
                }
                if run.owned[1] {
                    for (f, s) in f[j - first..j - first + n].iter_mut().zip(&share[..n]) {
                        *f -= *s;
                    }
                }
            }
        }
    }
}

/// Computes the forces of the forward springs of one kind on their first particles.
#[inline(never)]
fn pull<T: Real>(
    kind: &SpringKind<T>,
    bit: u32,
    [x, y, z]: [(&[T], &[T]); 3],
    factors: (&[T], &[T]),
    springs: &[u32],
    [sx, sy, sz]: [&mut [T]; 3],
) {
    let n = springs.len();
    let (xa, xb) = (&x.0[..n], &x.1[..n]);
    let (ya, yb) = (&y.0[..n], &y.1[..n]);
    let (za, zb) = (&z.0[..n], &z.1[..n]);
    let (fa, fb) = (&factors.0[..n], &factors.1[..n]);
    let (sx, sy, sz) = (&mut sx[..n], &mut sy[..n], &mut sz[..n]);
    let [rx, ry, rz] = kind.rest;
    let half = T::HALF * kind.stiffness;
    for m in 0..n {
        let (ex, ey, ez) = (xb[m] - xa[m], yb[m] - ya[m], zb[m] - za[m]);
        let (dx, dy, dz) = (rx + ex, ry + ey, rz + ez);
        let l = (dx * dx + dy * dy + dz * dz)
            .max(T::MIN_DISTANCE_SQUARED)
            .sqrt();
        // |d|² − L², without cancellation.
        let gain = ex * (rx + dx) + ey * (ry + dy) + ez * (rz + dz);
        // Values at a wave front would be subnormal, and ten times as slow.
        let some = gain > T::MIN_LENGTH_CHANGE || gain < -T::MIN_LENGTH_CHANGE;
        let gain = if some { gain } else { T::ZERO };
        let there = T::of_bit(springs[m] >> bit & 1);
        let k = half * (fa[m] + fb[m]) * there;
        let c = k * gain / ((l + kind.length) * l);
        sx[m] = c * dx;
        sy[m] = c * dy;
        sz[m] = c * dz;
    }
}
