//! SIMD abstraction of four lanes for the element kernels: one tetrahedron per lane.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Four scalars in a register.
pub trait Lane:
    Copy
    + Send
    + Sync
    + std::fmt::Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + 'static
{
    /// Jacobi sweeps that diagonalise 3×3 matrices to full precision.
    const SWEEPS: usize;
    /// Square of a negligible off-diagonal entry relative to the diagonal ones.
    const OFF_DIAGONAL_TOLERANCE: f64;
    /// Square of the cosine below which vectors are orthogonal up to rounding.
    const ORTHOGONALITY_TOLERANCE: f64;
    /// Square of a value negligible relative to 1.
    const TINY: f64;
    /// Broadcasts `x` to all lanes.
    fn splat(x: f64) -> Self;
    /// Returns the square root.
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    fn abs(self) -> Self;
    /// Returns the larger.
    fn max(self, other: Self) -> Self;
    /// Returns `yes` in lanes where `self` > `than`, else `no`.
    fn select_greater(self, than: Self, yes: Self, no: Self) -> Self;
    /// Whether any lane of `self` is greater than that of `than`.
    fn any_above(self, than: Self) -> bool;
    /// Transposes: lane j of row i becomes lane i of row j.
    fn transpose(rows: [Self; 4]) -> [Self; 4];
}

macro_rules! lane {
    ($vector:ty, $matrix:ty, $real:ty, $sweeps:expr, $round:expr, $skew:expr, $tiny:expr) => {
        impl Lane for $vector {
            const SWEEPS: usize = $sweeps;
            const OFF_DIAGONAL_TOLERANCE: f64 = $round;
            const ORTHOGONALITY_TOLERANCE: f64 = $skew;
            const TINY: f64 = $tiny;
            #[inline(always)]
            fn splat(x: f64) -> Self {
                <$vector>::splat(x as $real)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.abs()
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                self.max(other)
            }
            #[inline(always)]
            fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
                <$vector>::select(self.cmpgt(than), yes, no)
            }
            #[inline(always)]
            fn any_above(self, than: Self) -> bool {
                self.cmpgt(than).any()
            }
            #[inline(always)]
            fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
                let m = <$matrix>::from_cols(a, b, c, d).transpose();
                [m.x_axis, m.y_axis, m.z_axis, m.w_axis]
            }
        }
    };
}

lane!(glam::Vec4, glam::Mat4, f32, 4, 1e-14, 1e-11, 1e-13);
lane!(glam::DVec4, glam::DMat4, f64, 6, 1e-31, 1e-26, 1e-30);
