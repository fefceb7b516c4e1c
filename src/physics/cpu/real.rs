//! The numbers the engine computes in: f32 where speed counts, f64 where truth does.

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
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// ½.
    const HALF: Self;
    /// Square of a length, in local units, below which two nodes are in the same place.
    const COINCIDENT: Self;
    /// Change of a squared length, in local units, that is as good as none.
    const NOTHING: Self;
    /// Movement in one step, in units of the body's extent, that positions do not show.
    const NEGLIGIBLE: f64;

    /// The nearest number to `x`.
    fn of(x: f64) -> Self;
    /// 0 or 1.
    fn of_bit(bit: u32) -> Self;
    /// The same number as f64.
    fn wide(self) -> f64;
    /// The square root.
    fn root(self) -> Self;
    /// The larger of both; `other` where `self` is not a number.
    #[inline(always)]
    fn or_more(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
}

macro_rules! real {
    ($real:ty, $coincident:expr, $nothing:expr, $negligible:expr) => {
        impl Real for $real {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const HALF: Self = 0.5;
            const COINCIDENT: Self = $coincident;
            const NOTHING: Self = $nothing;
            const NEGLIGIBLE: f64 = $negligible;

            #[inline(always)]
            fn of(x: f64) -> Self {
                x as $real
            }
            #[inline(always)]
            fn of_bit(bit: u32) -> Self {
                // Signed: of that SSE2 has a conversion.
                bit as i32 as $real
            }
            #[inline(always)]
            fn wide(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn root(self) -> Self {
                self.sqrt()
            }
        }
    };
}

real!(f32, 1e-24, 1e-20, 1e-9);
real!(f64, 1e-200, 1e-200, 1e-18);
