//! Scalar types of the engine: f32 for speed, f64 for accuracy.

use super::simd::Lane;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// f32 or f64.
pub trait Real:
    Copy
    + Default
    + Debug
    + PartialEq
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + bytemuck::Pod
    + Serialize
    + DeserializeOwned
    + 'static
{
    /// Four scalars in one register: the compiler does not vectorise code written lane by lane.
    type Lanes: Lane;
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// ½.
    const HALF: Self;
    /// Squared length, in local units, below which two nodes coincide.
    const MIN_DISTANCE_SQUARED: Self;
    /// Negligible change of a squared length, in local units.
    const MIN_LENGTH_CHANGE: Self;
    /// Largest relative error of rounding a number.
    const UNIT_ROUNDOFF: f64;
    /// Relative rounding error of sums of energies.
    const ENERGY_ROUNDING: f64;
    /// Movement per step, in units of the body's extent, that positions do not resolve.
    const NEGLIGIBLE: f64;

    /// Loads four numbers into a register.
    fn lanes(a: &[Self; 4]) -> Self::Lanes;
    /// Inverse of [`Real::lanes`].
    fn array(a: Self::Lanes) -> [Self; 4];
    /// Broadcasts the number to four lanes.
    fn splat(self) -> Self::Lanes;
    /// Returns a·b over all four lanes, in every lane.
    fn dot(a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    /// Converts from f64, rounding to nearest.
    fn from_f64(x: f64) -> Self;
    /// Converts a bit to 0 or 1.
    fn of_bit(bit: u32) -> Self;
    /// Converts to f64.
    fn to_f64(self) -> f64;
    /// Returns the square root.
    fn sqrt(self) -> Self;
    /// Returns the larger of both; `other` if `self` is NaN.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
}

macro_rules! real {
    ($real:ty, $lanes:ty, $coincident:expr, $nothing:expr, $rounding:expr, $negligible:expr) => {
        impl Real for $real {
            type Lanes = $lanes;
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const HALF: Self = 0.5;
            const MIN_DISTANCE_SQUARED: Self = $coincident;
            const MIN_LENGTH_CHANGE: Self = $nothing;
            const UNIT_ROUNDOFF: f64 = 0.5 * <$real>::EPSILON as f64;
            const ENERGY_ROUNDING: f64 = $rounding;
            const NEGLIGIBLE: f64 = $negligible;

            #[inline(always)]
            fn lanes(a: &[Self; 4]) -> $lanes {
                <$lanes>::from_array(*a)
            }
            #[inline(always)]
            fn array(a: $lanes) -> [Self; 4] {
                a.to_array()
            }
            #[inline(always)]
            fn splat(self) -> $lanes {
                <$lanes>::splat(self)
            }
            #[inline(always)]
            fn dot(a: $lanes, b: $lanes) -> $lanes {
                <$lanes>::splat(a.dot(b))
            }
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as $real
            }
            #[inline(always)]
            fn of_bit(bit: u32) -> Self {
                // Via a signed integer, for which SSE2 has a conversion.
                bit as i32 as $real
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
        }
    };
}

real!(f32, glam::Vec4, 1e-24, 1e-20, 1e-6, 1e-9);
real!(f64, glam::DVec4, 1e-200, 1e-200, 1e-14, 1e-18);
