//! The numbers the engine computes in: f32 where speed counts, f64 where truth does.

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
    /// Four of them in one register: what is written out lane by lane the compiler takes apart.
    type Lanes: Lane;
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// ½.
    const HALF: Self;
    /// Square of a length, in local units, below which two nodes are in the same place.
    const MIN_DISTANCE_SQUARED: Self;
    /// Change of a squared length, in local units, that is as good as none.
    const MIN_LENGTH_CHANGE: Self;
    /// What sums of energies are wrong by at most, over themselves: rounding.
    const ENERGY_ROUNDING: f64;
    /// Movement in one step, in units of the body's extent, that positions do not show.
    const NEGLIGIBLE: f64;

    /// Four numbers, and back.
    fn lanes(a: &[Self; 4]) -> Self::Lanes;
    /// What [`Real::lanes`] took.
    fn array(a: Self::Lanes) -> [Self; 4];
    /// The same number four times.
    fn splat(self) -> Self::Lanes;
    /// a·b over all four, four times.
    fn dot(a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    /// The nearest number to `x`.
    fn from_f64(x: f64) -> Self;
    /// 0 or 1.
    fn of_bit(bit: u32) -> Self;
    /// The same number as f64.
    fn to_f64(self) -> f64;
    /// The square root.
    fn sqrt(self) -> Self;
    /// The larger of both; `other` where `self` is not a number.
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
                // Signed: of that SSE2 has a conversion.
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
