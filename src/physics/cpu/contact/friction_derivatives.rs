//! Derivatives of friction forces in a step whose lagged normal forces and normals have converged:
//! they are those at the displacements themselves, and the forces depend on displacements, on
//! velocities, on the poses and gaps of tools and on the stiffness behind the boundary.

use super::boundary_surface::ContactPoint;
use super::candidates::CollisionCandidate;
use super::contact_derivatives::{
    PAIR_DIFFERENCE_STEP, PairTangent, ToolDerivatives, WeightDerivatives,
};
use super::self_contact::SelfContactTerm;
use super::tool_contact::{ToolContact, ToolState};
use crate::physics::cpu::differences::{gradient, jacobian};
use crate::physics::cpu::term::StateRef;
use crate::physics::cpu::vectors::{V4, add, to_dvec, to_v4};
use glam::{DMat3, DQuat, DVec3};

/// Step of differences by the rotation of a tool.
const ROTATION_STEP: f64 = 1e-5;

/// Relative step of differences by the speed below which friction is static.
const SPEED_STEP: f64 = 1e-4;

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
        for (s, state, _) in self.rubbing(at).filter(|(s, ..)| s.tool as usize == tool) {
            let step = PAIR_DIFFERENCE_STEP * state.gap;
            let slope = jacobian(step, |by| self.force_at((s, state), at, by));
            let Some(friction) = self.friction_at(s, state, self.point(s, at.u)) else {
                continue;
            };
            let velocity = Self::velocity(s, at.v);
            let tangent = friction.tangent(velocity, self.static_friction_speed, false);
            let by = [-(slope.transpose() * direction), tangent * direction];
            all.extend(s.corners().map(|(i, w)| (i, by.map(|by| w * by))));
        }
        all
    }

    /// Returns the points with friction, with their tools and the friction force of each.
    fn rubbing(
        &self,
        at: StateRef<'_, f64>,
    ) -> impl Iterator<Item = (&ContactPoint, &ToolState, DVec3)> {
        let force = move |s: &'_ ContactPoint, tool: &ToolState| {
            let friction = self.friction_at(s, tool, self.point(s, at.u))?;
            Some(friction.force(Self::velocity(s, at.v), self.static_friction_speed))
        };
        self.contact_points.iter().filter_map(move |s| {
            let tool = &self.tools[s.tool as usize];
            let force = (tool.friction > 0.0).then(|| force(s, tool))??;
            Some((s, tool, force))
        })
    }

    /// Returns the friction force on a point that is `by` from its position, with a tool.
    fn force_at(
        &self,
        (s, tool): (&ContactPoint, &ToolState),
        at: StateRef<'_, f64>,
        by: DVec3,
    ) -> DVec3 {
        let friction = self.friction_at(s, tool, self.point(s, at.u) + by);
        friction.map_or(DVec3::ZERO, |friction| {
            friction.force(Self::velocity(s, at.v), self.static_friction_speed)
        })
    }

    /// Returns the derivative of y·f by the speed below which friction is static.
    fn speed_derivative(
        &self,
        (s, tool): (&ContactPoint, &ToolState),
        at: StateRef<'_, f64>,
        y: DVec3,
    ) -> f64 {
        let speed = self.static_friction_speed;
        let friction = self.friction_at(s, tool, self.point(s, at.u));
        let velocity = Self::velocity(s, at.v);
        let value = |by: DVec3| friction.map_or(0.0, |f| y.dot(f.force(velocity, speed + by.x)));
        gradient(SPEED_STEP * speed, value).x
    }

    /// Returns the derivatives of the friction forces.
    pub fn friction_tangents(&self, at: StateRef<'_, f64>) -> Vec<FrictionTangent> {
        let tangent = |(s, tool, _): (&ContactPoint, &ToolState, DVec3)| {
            let (nodes, weights) = s.spread();
            let friction = self.friction_at(s, tool, self.point(s, at.u))?;
            let velocity = Self::velocity(s, at.v);
            let step = PAIR_DIFFERENCE_STEP * tool.gap;
            let slope = jacobian(step, |by| self.force_at((s, tool), at, by));
            let block = |a: usize, b: usize| slope * (-weights[a] * weights[b]);
            Some(FrictionTangent {
                nodes,
                weights,
                by_velocity: friction.tangent(velocity, self.static_friction_speed, false),
                missing: DMat3::ZERO,
                by_position: std::array::from_fn(|a| std::array::from_fn(|b| block(a, b))),
            })
        };
        self.rubbing(at).filter_map(tangent).collect()
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
        let whole = self.face_weights();
        for (s, tool, f) in self.rubbing(at) {
            let number = s.tool as usize;
            let mut y: DVec3 = s.corners().map(|(i, w)| w * to_dvec(lambda[i])).sum();
            if let Some((_, direction)) = force.filter(|(of, _)| *of == number) {
                y -= direction;
            }
            let value = |changed: &ToolState| y.dot(self.force_at((s, changed), at, DVec3::ZERO));
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
            weights.static_speed += self.speed_derivative((s, tool), at, y);
            weights.add_point(s, f.dot(y), &whole);
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
            let mut by_position = [[DMat3::ZERO; 4]; 4];
            for (a, b) in (0..4).flat_map(|a| (0..4).map(move |b| (a, b))) {
                let force = |by: DVec3| {
                    let mut x = x;
                    x[b] += by;
                    self.friction_forces(pair, &x, v)[a]
                };
                by_position[a][b] = jacobian(step, force) * -1.0;
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
