//! Derivatives of friction forces in a step whose lagged normal forces and normals have converged:
//! they are those at the displacements themselves, and the forces depend on displacements, on
//! velocities, on the poses and gaps of tools and on the stiffness behind the boundary.

use super::boundary_surface::ContactPoint;
use super::candidates::CollisionCandidate;
use super::contact_derivatives::{
    PAIR_DIFFERENCE_STEP, PairTangent, ToolDerivatives, WeightDerivatives,
};
use super::self_contact::SelfContactTerm;
use super::tool_contact::{ToolContact, ToolFriction, ToolState};
use crate::physics::contact::FrictionMollifier;
use crate::physics::cpu::differences::{gradient, jacobian};
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::{V4, add, to_dvec, to_v4};
use glam::{DMat3, DQuat, DVec3};

/// Step of differences by the rotation of a tool.
const ROTATION_STEP: f64 = 1e-5;

/// A boundary point in contact with a tool that has friction.
struct RubbingPoint<'a> {
    s: &'a ContactPoint,
    tool: &'a ToolState,
    place: DVec3,
    velocity: DVec3,
    friction: ToolFriction,
}

/// Minus the derivatives of the friction forces on the nodes of a point or a pair.
pub(in crate::physics::cpu) struct FrictionTangent {
    pub nodes: [u32; 4],
    pub weights: [f64; 4],
    /// By the weighted sum of velocities, of the force of weight 1.
    pub by_velocity: DMat3,
    /// What the term's linearisation lacks of it.
    pub missing: DMat3,
    /// Block a, b: of the force on node a by the displacement of node b.
    pub by_position: [[DMat3; 4]; 4],
}

impl FrictionTangent {
    /// Returns what the matrix of a step of coefficient `gamma` has besides the term's
    /// linearisation; the part by positions only if wanted.
    pub fn correction(&self, gamma: f64, with_positions: bool) -> PairTangent {
        let block = |a: usize, b: usize| {
            let by_velocity = self.missing * (self.weights[a] * self.weights[b] / gamma);
            match with_positions {
                true => self.by_position[a][b] + by_velocity,
                false => by_velocity,
            }
        };
        let blocks = std::array::from_fn(|a| std::array::from_fn(|b| block(a, b)));
        (self.nodes, blocks)
    }

    /// Adds minus the derivative of the forces by velocities times `p` to `y`.
    pub fn add_velocity_product(&self, p: &[V4<f64>], y: &mut [V4<f64>]) {
        let nodes = self.nodes.map(|i| i as usize);
        let each = nodes.iter().zip(self.weights);
        let along: DVec3 = each.clone().map(|(i, w)| w * to_dvec(p[*i])).sum();
        let force = self.by_velocity * along;
        for (i, w) in each {
            y[*i] = add(y[*i], to_v4(w * force));
        }
    }
}

impl ToolContact<f64> {
    /// Returns minus the derivatives of the sum of the friction forces of a tool on the body along
    /// a direction, by the positions and by the velocities of nodes.
    pub fn tool_friction_gradient(
        &self,
        at: StateRef<'_, f64>,
        (tool, direction): (usize, DVec3),
    ) -> Vec<(usize, [DVec3; 2])> {
        let mut all = Vec::new();
        for point in self.rubbing(at).filter(|p| p.s.tool as usize == tool) {
            let [by_place, by_velocity] = self.point_slopes(&point);
            let by = [-(by_place.transpose() * direction), by_velocity * direction];
            all.extend(point.s.corners().map(|(i, w)| (i, by.map(|by| w * by))));
        }
        all
    }

    /// Returns the points in contact with a tool that has friction.
    fn rubbing<'a>(
        &'a self,
        at: StateRef<'a, f64>,
    ) -> impl Iterator<Item = RubbingPoint<'a>> + use<'a> {
        self.contact_points.iter().filter_map(move |s| {
            let tool = &self.tools[s.tool as usize];
            let place = self.point(s, at.u);
            let friction = self.friction_at(s, tool, place)?;
            (tool.friction > 0.0).then_some(RubbingPoint {
                s,
                tool,
                place,
                velocity: Self::velocity(s, at.v),
                friction,
            })
        })
    }

    /// Returns a force with the derivatives of the friction force on a point by its place and by
    /// its tool, of which `tool` is a changed one.
    fn linearised(&self, point: &RubbingPoint<'_>, tool: &ToolState, by: DVec3) -> DVec3 {
        let friction = self.friction_at(point.s, tool, point.place + by);
        friction.map_or(DVec3::ZERO, |friction| {
            friction.linearised(&point.friction, point.velocity, self.static_friction_speed)
        })
    }

    /// Returns the derivative of the friction force on a point by its place, and minus that by its
    /// velocity.
    fn point_slopes(&self, point: &RubbingPoint<'_>) -> [DMat3; 2] {
        let step = PAIR_DIFFERENCE_STEP * point.tool.gap;
        let by_place = jacobian(step, |by| self.linearised(point, point.tool, by));
        let speed = self.static_friction_speed;
        let by_velocity = point.friction.tangent(point.velocity, speed, false);
        [by_place, by_velocity]
    }

    /// Returns the derivatives of the friction forces.
    pub fn friction_tangents(&self, at: StateRef<'_, f64>) -> Vec<FrictionTangent> {
        let tangent = |point: RubbingPoint<'_>| {
            let (nodes, weights) = point.s.spread();
            let [by_place, by_velocity] = self.point_slopes(&point);
            let block = |a: usize, b: usize| by_place * (-weights[a] * weights[b]);
            FrictionTangent {
                nodes,
                weights,
                by_velocity,
                missing: DMat3::ZERO,
                by_position: std::array::from_fn(|a| std::array::from_fn(|b| block(a, b))),
            }
        };
        self.rubbing(at).map(tangent).collect()
    }

    /// Adds the derivatives of friction forces to those of normal forces, as
    /// [`ToolContact::force_derivatives`].
    pub fn add_friction_derivatives(
        &self,
        at: StateRef<'_, f64>,
        lambda: &[V4<f64>],
        force: Option<(usize, DVec3)>,
        (weights, all): (&mut WeightDerivatives, &mut [ToolDerivatives]),
    ) {
        let (whole, speed) = (self.face_weights(), self.static_friction_speed);
        for point in self.rubbing(at) {
            let (s, tool) = (point.s, point.tool);
            let number = s.tool as usize;
            let mut y: DVec3 = s.corners().map(|(i, w)| w * to_dvec(lambda[i])).sum();
            if let Some((_, direction)) = force.filter(|(of, _)| *of == number) {
                y -= direction;
            }
            let value = |tool: &ToolState| y.dot(self.linearised(&point, tool, DVec3::ZERO));
            let step = PAIR_DIFFERENCE_STEP * tool.gap;
            let to = &mut all[number];
            to.translation += gradient(step, |by| value(&tool.shifted(by)));
            to.rotation += gradient(ROTATION_STEP, |by| value(&tool.turned(by)));
            let by_gap = gradient(step, |by| {
                value(&ToolState {
                    gap: tool.gap + by.x,
                    ..tool.clone()
                })
            });
            to.gap += by_gap.x;
            let slide = point.friction.slide(point.velocity);
            let slope = FrictionMollifier::slope_by_threshold(slide.length(), speed);
            weights.static_speed -= point.friction.max_force * slope * slide.dot(y);
            let f = point.friction.force(point.velocity, speed);
            weights.add_point(s, f.dot(y), &whole);
            // The force is in proportion to the coefficient.
            to.friction += f.dot(y) / tool.friction;
        }
    }
}

impl ToolState {
    /// Returns the tool with its path translated.
    fn shifted(&self, by: DVec3) -> ToolState {
        let mut tool = self.clone();
        for pose in [&mut tool.from, &mut tool.at, &mut tool.to] {
            pose.position += by;
        }
        tool
    }

    /// Returns the tool turned by a rotation vector about its origin, all along its path.
    fn turned(&self, by: DVec3) -> ToolState {
        let mut tool = self.clone();
        for pose in [&mut tool.from, &mut tool.at, &mut tool.to] {
            pose.rotation = (DQuat::from_scaled_axis(by) * pose.rotation).normalize();
        }
        tool
    }
}

impl SelfContactTerm<f64> {
    /// Returns the friction forces on the four nodes of a pair at `x` with the velocities `v`.
    fn friction_forces(
        &self,
        pair: &CollisionCandidate,
        x: &[DVec3; 4],
        v: [DVec3; 4],
    ) -> [DVec3; 4] {
        let Some(active) = Self::active_pair_at(pair, x) else {
            return [DVec3::ZERO; 4];
        };
        let friction = self.friction_at(pair, &active);
        let force = friction.force(v, self.static_friction_speed);
        friction.weights.map(|w| w * force)
    }

    /// Returns the derivatives of the friction forces.
    pub fn friction_tangents(&self, at: StateRef<'_, f64>) -> Vec<FrictionTangent> {
        let tangent = |pair: &CollisionCandidate| {
            let active = self.active_pair(pair, at.u)?;
            let friction = self.friction_at(pair, &active);
            let (x, v) = (self.positions(pair, at.u), Self::velocities(pair, at.v));
            let step = PAIR_DIFFERENCE_STEP * pair.features.closest_points(&x).distance;
            let force = friction.force(v, self.static_friction_speed);
            let mut by_position = [[DMat3::ZERO; 4]; 4];
            for (a, b) in (0..4).flat_map(|a| (0..4).map(move |b| (a, b))) {
                let linearised = |by: DVec3| {
                    let mut x = x;
                    x[b] += by;
                    let active = Self::active_pair_at(pair, &x);
                    active.map_or(DVec3::ZERO, |active| {
                        let changed = self.friction_at(pair, &active);
                        let speed = self.static_friction_speed;
                        changed.weights[a] * force
                            + friction.weights[a] * changed.linearised(&friction, v, speed)
                    })
                };
                by_position[a][b] = jacobian(step, linearised) * -1.0;
            }
            let by_velocity = friction.tangent(v, self.static_friction_speed);
            Some(FrictionTangent {
                nodes: pair.nodes,
                weights: friction.weights,
                by_velocity,
                missing: by_velocity - self.friction_block(&friction, v),
                by_position,
            })
        };
        match self.friction > 0.0 {
            true => self.pairs.iter().filter_map(tangent).collect(),
            false => Vec::new(),
        }
    }

    /// Adds the derivatives of the friction forces, with y = `lambda`, by the weights of the pairs.
    pub fn add_friction_weights(
        &self,
        at: StateRef<'_, f64>,
        lambda: &[V4<f64>],
        weights: &mut WeightDerivatives,
    ) {
        for pair in self.pairs.iter().filter(|_| self.friction > 0.0) {
            let (x, v) = (self.positions(pair, at.u), Self::velocities(pair, at.v));
            let forces = pair.nodes.iter().zip(self.friction_forces(pair, &x, v));
            let sum: f64 = forces
                .map(|(i, f)| f.dot(to_dvec(lambda[*i as usize])))
                .sum();
            weights.add_pair(pair, sum);
        }
    }
}
