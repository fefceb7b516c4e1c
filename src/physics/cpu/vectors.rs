//! Vectors and 3×3 blocks, padded to four lanes for SIMD.

use super::scalar::Real;
use glam::{DMat3, DVec3};

/// x, y, z and a lane that is always zero.
pub type V4<T> = [T; 4];

/// A 3×3 block as three columns.
pub type Mat3Columns<T> = [V4<T>; 3];

/// A symmetric 3×3 block: xx, yy, zz, xy, xz, yz, and two unused lanes.
pub type SymMat3<T> = [T; 8];

/// The zero vector.
#[inline(always)]
pub fn zero<T: Real>() -> V4<T> {
    [T::ZERO; 4]
}

/// a + b.
#[inline(always)]
pub fn add<T: Real>(a: V4<T>, b: V4<T>) -> V4<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]
}

/// a − b.
#[inline(always)]
pub fn sub<T: Real>(a: V4<T>, b: V4<T>) -> V4<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]]
}

/// s a.
#[inline(always)]
pub fn scale<T: Real>(s: T, a: V4<T>) -> V4<T> {
    [s * a[0], s * a[1], s * a[2], s * a[3]]
}

/// a + s b.
#[inline(always)]
pub fn add_scaled<T: Real>(a: V4<T>, s: T, b: V4<T>) -> V4<T> {
    [
        a[0] + s * b[0],
        a[1] + s * b[1],
        a[2] + s * b[2],
        a[3] + s * b[3],
    ]
}

/// Returns the sum of the lanes, in f64.
#[inline(always)]
pub fn sum_f64<T: Real>(a: V4<T>) -> f64 {
    (a[0].to_f64() + a[1].to_f64()) + (a[2].to_f64() + a[3].to_f64())
}

/// Returns a·b, in f64.
#[inline(always)]
pub fn dot_f64<T: Real>(a: V4<T>, b: V4<T>) -> f64 {
    sum_f64([a[0] * b[0], a[1] * b[1], a[2] * b[2], T::ZERO])
}

/// Returns a × b.
#[inline(always)]
pub fn cross<T: Real>(a: V4<T>, b: V4<T>) -> V4<T> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
        T::ZERO,
    ]
}

/// Returns m a.
#[inline(always)]
pub fn apply<T: Real>(m: &Mat3Columns<T>, a: V4<T>) -> V4<T> {
    add_scaled(add_scaled(scale(a[0], m[0]), a[1], m[1]), a[2], m[2])
}

/// Returns m a for a symmetric block.
#[inline(always)]
pub fn apply_symmetric<T: Real>(m: &SymMat3<T>, a: V4<T>) -> V4<T> {
    [
        m[0] * a[0] + m[3] * a[1] + m[4] * a[2],
        m[3] * a[0] + m[1] * a[1] + m[5] * a[2],
        m[4] * a[0] + m[5] * a[1] + m[2] * a[2],
        T::ZERO,
    ]
}

/// Converts a vector to multiples of `unit`.
pub fn from_metres<T: Real>(v: DVec3, unit: f64) -> V4<T> {
    let v = v / unit;
    [
        T::from_f64(v.x),
        T::from_f64(v.y),
        T::from_f64(v.z),
        T::ZERO,
    ]
}

/// Converts a vector from multiples of `unit`.
pub fn to_metres<T: Real>(v: V4<T>, unit: f64) -> DVec3 {
    DVec3::new(v[0].to_f64(), v[1].to_f64(), v[2].to_f64()) * unit
}

/// As [`inverse`], and whether the block is positive definite.
pub fn inverse_definite<T: Real>(m: &SymMat3<T>) -> (Mat3Columns<T>, bool) {
    let [a, b, c, d, e, f, ..] = m.map(Real::to_f64);
    let minor = a * b - d * d;
    let determinant = c * minor - f * (a * f - d * e) - e * (b * e - d * f);
    let definite = a > 0.0 && minor > 0.0 && determinant > 0.0;
    (inverse(m), definite)
}

/// Returns the inverse of a positive definite symmetric block; if the block is not positive
/// definite in the precision of T, that of its diagonal.
pub fn inverse<T: Real>(m: &SymMat3<T>) -> Mat3Columns<T> {
    let m = m.map(Real::to_f64);
    // Scaled to its largest entry, so that the determinant stays in range.
    let largest = m[0].max(m[1]).max(m[2]);
    let [a, b, c, d, e, f] = [m[0], m[1], m[2], m[3], m[4], m[5]].map(|x| x / largest);
    let xx = b * c - f * f;
    let xy = e * f - d * c;
    let xz = d * f - e * b;
    let yy = a * c - e * e;
    let yz = d * e - a * f;
    let zz = a * b - d * d;
    let determinant = a * xx + d * xy + e * xz;
    let safe = determinant > 1e-14;
    let over = 1.0 / (determinant * largest);
    let z = T::ZERO;
    if safe {
        let [xx, xy, xz, yy, yz, zz] = [xx, xy, xz, yy, yz, zz].map(|x| T::from_f64(x * over));
        [[xx, xy, xz, z], [xy, yy, yz, z], [xz, yz, zz, z]]
    } else {
        // The node is nearly unconstrained in some direction.
        let [x, y, w] = [m[0], m[1], m[2]].map(|x| T::from_f64(1.0 / x));
        [[x, z, z, z], [z, y, z, z], [z, z, w, z]]
    }
}

/// `v` in f64.
pub fn to_dvec<T: Real>(v: V4<T>) -> DVec3 {
    DVec3::new(v[0].to_f64(), v[1].to_f64(), v[2].to_f64())
}

/// `v` as the engine keeps it.
pub fn to_v4<T: Real>(v: DVec3) -> V4<T> {
    [
        T::from_f64(v.x),
        T::from_f64(v.y),
        T::from_f64(v.z),
        T::ZERO,
    ]
}

/// n nᵀ.
pub fn outer_product(n: DVec3) -> DMat3 {
    DMat3::from_cols(n * n.x, n * n.y, n * n.z)
}

/// a bᵀ.
pub fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Σ a·b: lanes of 32 vectors at a time, these in f64.
pub fn dot<T: Real>(a: &[V4<T>], b: &[V4<T>]) -> f64 {
    let mut sum = 0.0;
    for (a, b) in a.chunks(32).zip(b.chunks(32)) {
        let mut lanes = [T::ZERO; 4];
        for (a, b) in a.iter().zip(b) {
            for n in 0..4 {
                lanes[n] += a[n] * b[n];
            }
        }
        sum += sum_f64(lanes);
    }
    sum
}
