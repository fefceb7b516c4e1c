//! Friction of a pair in self-contact.

use super::candidates::CollisionCandidate;
use super::self_contact::{ActivePair, SelfContactTerm};
use crate::physics::contact::FrictionMollifier;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::outer_product;
use glam::{DMat3, DVec3};

/// Friction data of a pair, from the previous iterate.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairFriction {
    pub weights: [f64; 4],
    pub normal: DVec3,
    /// μ times the normal force.
    pub max_force: f64,
}

impl PairFriction {
    /// Returns the tangential velocity of the first primitive relative to the second, with the four
    /// nodes at the velocities `v`.
    pub fn slide(&self, v: [DVec3; 4]) -> DVec3 {
        let off: DVec3 = self.weights.iter().zip(v).map(|(w, v)| *w * v).sum();
        off - self.normal * self.normal.dot(off)
    }

    /// Returns the force on the first primitive.
    pub fn force(&self, v: [DVec3; 4], static_friction_speed: f64) -> DVec3 {
        let slide = self.slide(v);
        let slip = FrictionMollifier::at(slide.length(), static_friction_speed);
        -self.max_force * slip.slope_over_speed * slide
    }

    /// Returns a force whose derivatives at `base` are those of [`PairFriction::force`], without its
    /// kink at the static friction speed.
    pub fn linearised(
        &self,
        base: &PairFriction,
        v: [DVec3; 4],
        static_friction_speed: f64,
    ) -> DVec3 {
        let slide = base.slide(v);
        let slip = FrictionMollifier::at(slide.length(), static_friction_speed);
        let by_slide = slip.direction_slope(slide) * self.slide(v);
        -self.max_force * slip.slope_over_speed * slide - base.max_force * by_slide
    }

    /// Returns the secant stiffness of the force in all tangential directions.
    pub fn secant(&self, v: [DVec3; 4], static_friction_speed: f64) -> DMat3 {
        let speed = self.slide(v).length();
        let slip = FrictionMollifier::at(speed, static_friction_speed);
        let plane = DMat3::IDENTITY - outer_product(self.normal);
        plane * (self.max_force * slip.slope_over_speed)
    }

    /// Returns minus the derivative of the force by the relative velocity.
    pub fn tangent(&self, v: [DVec3; 4], static_friction_speed: f64) -> DMat3 {
        let slide = self.slide(v);
        let slip = FrictionMollifier::at(slide.length(), static_friction_speed);
        let along = outer_product(slide.normalize_or_zero());
        let excess = self.max_force * (slip.second_derivative - slip.slope_over_speed);
        self.secant(v, static_friction_speed) + along * excess
    }
}

impl<T: Real> SelfContactTerm<T> {
    /// Returns the linearisation of the force by the relative velocity: the secant stiffness, since
    /// with the exact derivative sliding pairs would oscillate in steps of few iterations.
    pub(super) fn friction_block(&self, friction: &PairFriction, v: [DVec3; 4]) -> DMat3 {
        match self.is_exact {
            true => friction.tangent(v, self.static_friction_speed),
            false => friction.secant(v, self.static_friction_speed),
        }
    }

    /// Returns the friction data of an active pair.
    pub(super) fn friction_at(
        &self,
        pair: &CollisionCandidate,
        active: &ActivePair,
    ) -> PairFriction {
        let force = pair.weight * active.mollifier * active.barrier.first_derivative.abs();
        PairFriction {
            weights: active.weights,
            normal: active.normal,
            max_force: self.friction * force,
        }
    }
}
