//! A rigid body by itself: the carriers of its mass, how it can move, and where it is.

use super::closest_rotation::closest_rotation;
use super::real::Real;
use super::vectors::V4;
pub(super) use crate::physics::rigid::Freedom;
use crate::physics::rigid::Moments;
use glam::{DMat3, DQuat, DVec3};
use std::ops::Range;

/// Carriers of a body.
pub(super) const CARRIERS: usize = 4;

/// Where they are: the corners of a regular tet.
pub(super) const CORNERS: [DVec3; CARRIERS] = [
    DVec3::new(1.0, 1.0, 1.0),
    DVec3::new(1.0, -1.0, -1.0),
    DVec3::new(-1.0, 1.0, -1.0),
    DVec3::new(-1.0, -1.0, 1.0),
];

/// Where a body is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// How far its centre is from where it rests.
    pub shift: DVec3,
    /// How it is turned.
    pub turn: DQuat,
}

impl Pose {
    pub const REST: Pose = Pose {
        shift: DVec3::ZERO,
        turn: DQuat::IDENTITY,
    };

    /// So much of the way to another.
    pub fn toward(&self, other: &Pose, share: f64) -> Pose {
        Pose {
            shift: self.shift.lerp(other.shift, share),
            turn: self.turn.slerp(other.turn, share),
        }
    }

    /// As numbers, to the bit.
    pub fn numbers(&self) -> [f64; 7] {
        let ([a, b, c], [x, y, z, w]) = (self.shift.to_array(), self.turn.to_array());
        [a, b, c, x, y, z, w]
    }

    /// What [`Pose::numbers`] gave.
    pub fn of_numbers([a, b, c, x, y, z, w]: [f64; 7]) -> Pose {
        Pose {
            shift: DVec3::new(a, b, c),
            turn: DQuat::from_array([x, y, z, w]),
        }
    }
}

/// A body. Lengths and masses in local units.
#[derive(Clone, Debug)]
pub(super) struct Rigid {
    /// Its nodes in the plan: those of the surface, then the carriers.
    pub nodes: Range<usize>,
    /// Its nodes inside, beyond the plan.
    pub inner: Range<usize>,
    /// Its centre of mass at rest.
    pub centre: DVec3,
    pub mass: f64,
    /// A, and A⁻¹.
    pub spread: DMat3,
    pub gather: DMat3,
    pub freedom: Freedom,
    /// Whether nothing soft hangs on it.
    pub alone: bool,
}

impl Rigid {
    /// What lengths are measured by: the radius of gyration.
    pub fn radius(&self) -> f64 {
        let a = self.spread;
        (a.x_axis.length_squared() + a.y_axis.length_squared() + a.z_axis.length_squared()).sqrt()
    }

    /// The carriers' slots.
    pub fn carriers(&self) -> Range<usize> {
        self.nodes.end - CARRIERS..self.nodes.end
    }

    /// The point it turns about, from its centre at rest; and which turns it makes in `pose`.
    pub fn pivot(&self, pose: &Pose) -> (DVec3, DMat3) {
        match self.freedom {
            Freedom::Free => (DVec3::ZERO, DMat3::IDENTITY),
            Freedom::Turns(at, None) => (at, DMat3::IDENTITY),
            Freedom::Turns(at, Some(axis)) => (at, outer(pose.turn * axis, pose.turn * axis)),
            Freedom::Fixed => (DVec3::ZERO, DMat3::ZERO),
        }
    }

    /// The pose after a turn by the rotation vector `by` about its pivot and a shift.
    pub fn moved(&self, from: &Pose, shift: DVec3, by: DVec3) -> Pose {
        let (pivot, _) = self.pivot(from);
        let turn = (DQuat::from_scaled_axis(by) * from.turn).normalize();
        Pose {
            shift: from.shift + shift + (from.turn * pivot - turn * pivot),
            turn,
        }
    }

    /// The pose that brings its carriers nearest to `targets`, of those that it can be in.
    pub fn nearest(&self, from: &Pose, targets: [DVec3; CARRIERS]) -> Pose {
        let arms = CORNERS.map(|t| self.spread * t);
        let (pivot, within) = self.pivot(from);
        let (at, free) = match self.freedom {
            Freedom::Fixed => return *from,
            Freedom::Free => (targets.iter().sum::<DVec3>() / CARRIERS as f64, true),
            Freedom::Turns(..) => (self.centre + from.shift + from.turn * pivot, false),
        };
        let mut m = DMat3::ZERO;
        for (x, r) in targets.iter().zip(arms) {
            m += outer(*x - at, r - pivot);
        }
        let turn = closest_rotation(&m, from.turn, within);
        Pose {
            shift: match free {
                true => at - self.centre,
                false => from.shift + (from.turn * pivot - turn * pivot),
            },
            turn,
        }
    }
}

/// The carriers of a body: where they are from its centre, and A.
pub(super) fn carriers(moments: &Moments) -> ([DVec3; CARRIERS], DMat3) {
    let (values, vectors) = moments.principal;
    let column = |k: usize| vectors[k] * (values[k] / moments.mass).sqrt();
    let spread = DMat3::from_cols(column(0), column(1), column(2));
    (CORNERS.map(|t| spread * t), spread)
}

/// a bᵀ.
pub(super) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// |a|² I − a aᵀ.
pub(super) fn inertia_of(a: DVec3) -> DMat3 {
    DMat3::from_diagonal(DVec3::splat(a.length_squared())) - outer(a, a)
}

/// The turn that `moment` gives what has this inertia, of the turns that there are.
pub(super) fn turned_by(inertia: DMat3, moment: DVec3, within: DMat3) -> DVec3 {
    let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
    let whole = within * inertia * within + (DMat3::IDENTITY - within) * trace;
    within * (whole.inverse() * (within * moment))
}

pub(super) fn wide<T: Real>(v: V4<T>) -> DVec3 {
    DVec3::new(v[0].wide(), v[1].wide(), v[2].wide())
}

pub(super) fn narrow<T: Real>(v: DVec3) -> V4<T> {
    [T::of(v.x), T::of(v.y), T::of(v.z), T::ZERO]
}
