//! Tool contact: an energy term that keeps points of the boundary of a body out of tools.
//!
//! E = Σ A K ĝ b(d/ĝ) over boundary points with a distance d < ĝ from a tool, where b is the
//! barrier of incremental potential contact (Li et al. 2020), A the area of a point and K the
//! Young's modulus behind it. The pressure is K |b'|, so the distance stays close to ĝ even under
//! high pressure. Friction is Coulomb's, with lagged normal forces and normals from the previous
//! iterate (section 5 there), as a potential of the velocities.

use super::boundary_surface::{BoundarySurface, ContactPoint};
use crate::physics::contact::{Barrier, FrictionMollifier, Shape, SurfaceDistance};
use crate::physics::cpu::linear::point_blocks::PointBlocks;
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{V4, add};
use crate::physics::cpu::vectors::{outer_product, to_dvec, to_v4};
use glam::{DMat3, DQuat, DVec3};

/// Pose of a tool, in local units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::physics::cpu) struct LocalToolPose {
    pub position: DVec3,
    pub rotation: DQuat,
}

impl LocalToolPose {
    /// Returns the pose interpolated between this one and `to`.
    pub fn between(&self, to: &LocalToolPose, share: f64) -> LocalToolPose {
        if share >= 1.0 {
            return *to;
        }
        LocalToolPose {
            position: self.position.lerp(to.position, share),
            rotation: self.rotation.slerp(to.rotation, share),
        }
    }

    /// Transforms `p` to the tool's frame.
    pub fn to_local(self, p: DVec3) -> DVec3 {
        self.rotation.inverse() * (p - self.position)
    }

    /// Transforms `p` from the tool's frame.
    pub fn to_world(self, p: DVec3) -> DVec3 {
        self.position + self.rotation * p
    }

    /// Returns the exact components.
    pub fn numbers(&self) -> [f64; 7] {
        let ([a, b, c], [x, y, z, w]) = (self.position.to_array(), self.rotation.to_array());
        [a, b, c, x, y, z, w]
    }

    /// Restores a pose from [`LocalToolPose::numbers`].
    pub fn of_numbers([a, b, c, x, y, z, w]: [f64; 7]) -> LocalToolPose {
        LocalToolPose {
            position: DVec3::new(a, b, c),
            rotation: DQuat::from_array([x, y, z, w]),
        }
    }
}

/// A tool in local units.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct ToolState {
    pub shape: Shape,
    /// Poses at the start of the step, at present, and at its end.
    pub from: LocalToolPose,
    pub at: LocalToolPose,
    pub to: LocalToolPose,
    pub friction: f64,
    /// ĝ.
    pub gap: f64,
    /// Number of teleports.
    pub teleport_count: u64,
}

impl ToolState {
    /// Returns the surface distance of `p`.
    pub fn touch(&self, p: DVec3) -> SurfaceDistance {
        let touch = self.shape.surface_distance(self.at.to_local(p));
        let rotation = DMat3::from_quat(self.at.rotation);
        SurfaceDistance {
            distance: touch.distance,
            normal: rotation * touch.normal,
            curvature: rotation * touch.curvature * rotation.transpose(),
        }
    }

    /// Returns the signed distance of `p`.
    pub fn distance(&self, p: DVec3) -> f64 {
        self.shape.distance(self.at.to_local(p))
    }

    /// Returns an upper bound of the displacement in the step of its points within `reach` of its
    /// origin.
    pub fn max_travel(&self, reach: f64) -> f64 {
        let arm = self.shape.bounding_radius().min(reach);
        let angle = self.from.rotation.angle_between(self.to.rotation);
        self.from.position.distance(self.to.position) + angle * arm
    }
}

/// Friction data of a point, from the previous iterate.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::physics::cpu) struct ToolFriction {
    pub normal: DVec3,
    /// μ times the normal force.
    pub max_force: f64,
    /// Velocity of the tool at the point.
    pub tool_velocity: DVec3,
}

impl ToolFriction {
    /// Returns the tangential velocity relative to the tool of a point with the velocity `v`.
    pub fn slide(&self, v: DVec3) -> DVec3 {
        let relative_velocity = v - self.tool_velocity;
        relative_velocity - self.normal * self.normal.dot(relative_velocity)
    }

    /// Returns the force on a point with the velocity `v`.
    pub fn force(&self, v: DVec3, static_friction_speed: f64) -> DVec3 {
        let slide = self.slide(v);
        let slip = FrictionMollifier::at(slide.length(), static_friction_speed);
        -self.max_force * slip.slope_over_speed * slide
    }

    /// Returns a force whose derivatives at `base` are those of [`ToolFriction::force`], without its
    /// kink at the static friction speed.
    pub fn linearised(&self, base: &ToolFriction, v: DVec3, static_friction_speed: f64) -> DVec3 {
        let slide = base.slide(v);
        let slip = FrictionMollifier::at(slide.length(), static_friction_speed);
        let by_slide = slip.direction_slope(slide) * self.slide(v);
        -self.max_force * slip.slope_over_speed * slide - base.max_force * by_slide
    }

    /// Returns minus the derivative of the force by `v`, bounded below if `projected`.
    pub fn tangent(&self, v: DVec3, static_friction_speed: f64, projected: bool) -> DMat3 {
        let slide = self.slide(v);
        let slip = FrictionMollifier::at(slide.length(), static_friction_speed);
        let along = slide.normalize_or_zero();
        let plane = DMat3::IDENTITY - outer_product(self.normal);
        let isotropic = plane * slip.slope_over_speed;
        let second_derivative = match projected {
            true => slip.projected_hessian(),
            false => slip.second_derivative,
        };
        let along_slip = outer_product(along) * (second_derivative - slip.slope_over_speed);
        (isotropic + along_slip) * self.max_force
    }
}

/// The tools of a body.
pub(in crate::physics::cpu) struct ToolContact<T> {
    pub tools: Vec<ToolState>,
    pub hull: BoundarySurface,
    /// Points that may come near a tool in the step.
    pub contact_points: Vec<ContactPoint>,
    /// Whether the points were selected again since the last query; friction depends on them.
    pub candidates_changed: bool,
    /// Indices of the points with a node in each chunk.
    pub chunk_points: Vec<Vec<u32>>,
    pub lagged_friction: Vec<ToolFriction>,
    /// Regularisation speed of the friction.
    pub static_friction_speed: f64,
    /// Duration of the tools' motion.
    pub time: f64,
    chunk_starts: Vec<usize>,
    blocks: PointBlocks<T>,
    projected: bool,
}

impl<T: Real> ToolContact<T> {
    /// Creates the term for a boundary, without tools.
    pub fn new(
        hull: BoundarySurface,
        plan: &Partition,
        static_friction_speed: f64,
    ) -> ToolContact<T> {
        let chunks = plan.chunks();
        ToolContact {
            tools: Vec::new(),
            hull,
            contact_points: Vec::new(),
            candidates_changed: false,
            chunk_points: vec![Vec::new(); chunks],
            lagged_friction: Vec::new(),
            static_friction_speed,
            time: 0.0,
            chunk_starts: (0..chunks).map(|c| plan.range(c).start).collect(),
            blocks: PointBlocks::new(chunks),
            projected: false,
        }
    }

    /// Returns the position of a point.
    pub fn point(&self, s: &ContactPoint, u: &[V4<T>]) -> DVec3 {
        s.corners()
            .map(|(i, w)| w * self.hull.position(i, u))
            .sum::<DVec3>()
    }

    /// Returns the tool of a point and its surface distance, or `None` beyond the gap.
    pub(super) fn active_distance(
        &self,
        s: &ContactPoint,
        u: &[V4<T>],
    ) -> Option<(&ToolState, SurfaceDistance)> {
        let tool = &self.tools[s.tool as usize];
        let p = self.point(s, u);
        // Avoids the rotations for distant points.
        if tool.distance(p) >= tool.gap {
            return None;
        }
        Some((tool, tool.touch(p)))
    }

    /// Returns the normal force of the tool on an active point.
    pub(super) fn contact_force(
        &self,
        s: &ContactPoint,
        tool: &ToolState,
        touch: &SurfaceDistance,
    ) -> DVec3 {
        -s.area_stiffness
            * Barrier::clamped(touch.distance / tool.gap).first_derivative
            * touch.normal
    }

    /// Returns the velocity of a point.
    pub(super) fn velocity(s: &ContactPoint, v: &[V4<T>]) -> DVec3 {
        s.corners().map(|(i, w)| w * to_dvec(v[i])).sum()
    }

    /// Stores the normal forces, normals and tool velocities at the displacements `u` for friction.
    /// Returns the relative change of the forces.
    pub fn update_lagged_friction(&mut self, u: &[V4<T>]) -> f64 {
        let mut lagged_friction = std::mem::take(&mut self.lagged_friction);
        lagged_friction.resize(self.contact_points.len(), ToolFriction::default());
        let (mut change, mut all) = (0.0, 0.0);
        if self.damped() && self.time > 0.0 {
            for (s, friction) in self.contact_points.iter().zip(&mut lagged_friction) {
                let before = std::mem::take(friction);
                if self.tools[s.tool as usize].friction > 0.0 {
                    *friction = self.lagged_friction_of(s, u).unwrap_or_default();
                }
                let vector = |r: &ToolFriction| r.max_force * r.normal;
                change += vector(friction).distance(vector(&before));
                all += friction.max_force;
            }
        }
        self.lagged_friction = lagged_friction;
        match change > 0.0 {
            true => change / all.max(change),
            false => 0.0,
        }
    }

    fn lagged_friction_of(&self, s: &ContactPoint, u: &[V4<T>]) -> Option<ToolFriction> {
        self.friction_at(s, &self.tools[s.tool as usize], self.point(s, u))
    }

    /// Returns the friction data of a point at `p` with a tool, or `None` beyond the gap.
    pub(super) fn friction_at(
        &self,
        s: &ContactPoint,
        tool: &ToolState,
        p: DVec3,
    ) -> Option<ToolFriction> {
        if tool.distance(p) >= tool.gap {
            return None;
        }
        let touch = tool.touch(p);
        let local_point = tool.at.to_local(p);
        let moved = tool.to.to_world(local_point) - tool.from.to_world(local_point);
        Some(ToolFriction {
            normal: touch.normal,
            max_force: tool.friction * self.contact_force(s, tool, &touch).length(),
            tool_velocity: moved / self.time,
        })
    }

    /// Returns whether any point is in contact at the displacements `u`.
    #[cfg(test)]
    pub fn has_contact(&self, u: &[V4<T>]) -> bool {
        self.contact_points
            .iter()
            .any(|s| self.active_distance(s, u).is_some())
    }

    /// Returns Σ λ² w²/m over points, with the normal forces λ and the inverse blocks `over`: the
    /// scale of the residual when contact supports all loads.
    pub fn residual_scale(&self, u: &[V4<T>], over: impl Fn(usize, DVec3) -> f64) -> f64 {
        let of = |s: &ContactPoint| {
            let force = self
                .active_distance(s, u)
                .map(|(tool, touch)| self.contact_force(s, tool, &touch));
            force.map_or(0.0, |f| s.corners().map(|(i, w)| over(i, w * f)).sum())
        };
        self.contact_points.iter().map(of).sum()
    }

    /// Returns the force of the body on each tool, and its moment about the origin of the tool's
    /// shape.
    pub fn reactions(&self, at: StateRef<'_, T>) -> Vec<[DVec3; 2]> {
        let mut sums = vec![[DVec3::ZERO; 2]; self.tools.len()];
        for (k, s) in self.contact_points.iter().enumerate() {
            let Some((tool, touch)) = self.active_distance(s, at.u) else {
                continue;
            };
            let mut force = self.contact_force(s, tool, &touch);
            if let Some(friction) = self
                .lagged_friction
                .get(k)
                .filter(|friction| friction.max_force > 0.0)
            {
                force += friction.force(Self::velocity(s, at.v), self.static_friction_speed);
            }
            let [sum, moment] = &mut sums[s.tool as usize];
            *sum -= force;
            *moment -= (self.point(s, at.u) - tool.at.position).cross(force);
        }
        sums
    }

    /// Returns the corners of a point in a chunk, by their index within it.
    #[inline]
    fn corners_in_chunk<'a>(
        &'a self,
        chunk: usize,
        s: &'a ContactPoint,
        count: usize,
    ) -> impl Iterator<Item = (usize, f64)> + 'a {
        let first = self.chunk_starts[chunk];
        // Nodes before the chunk wrap around and are beyond its end.
        let corners = s.corners().map(move |(i, w)| (i.wrapping_sub(first), w));
        corners.filter(move |(i, _)| *i < count)
    }

    /// Returns the points with a node in a chunk, and whether the chunk counts their energy.
    fn points_of_chunk(&self, chunk: usize) -> impl Iterator<Item = (usize, &ContactPoint, bool)> {
        self.chunk_points[chunk].iter().map(move |k| {
            let s = &self.contact_points[*k as usize];
            (*k as usize, s, s.owner_chunk as usize == chunk)
        })
    }
}

impl<T: Real> Term<T> for ToolContact<T> {
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let energy = self.elastic_forces(chunk, at.u, f);
        self.damping_forces(chunk, at, f);
        energy
    }

    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        let mut energy = 0.0;
        for (_, s, counts) in self.points_of_chunk(chunk) {
            let Some((tool, touch)) = self.active_distance(s, u) else {
                continue;
            };
            let force = self.contact_force(s, tool, &touch);
            for (i, w) in self.corners_in_chunk(chunk, s, f.len()) {
                f[i] = add(f[i], to_v4(w * force));
            }
            if counts {
                energy +=
                    s.area_stiffness * tool.gap * Barrier::clamped(touch.distance / tool.gap).value;
            }
        }
        energy
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let counted = self.points_of_chunk(chunk).filter(|(.., counts)| *counts);
        counted
            .map(|(_, s, _)| {
                let tool = &self.tools[s.tool as usize];
                let gap = tool.distance(self.point(s, u)) / tool.gap;
                s.area_stiffness * tool.gap * Barrier::clamped(gap).value
            })
            .sum()
    }

    fn damped(&self) -> bool {
        self.tools.iter().any(|tool| tool.friction > 0.0)
    }

    fn is_friction(&self) -> bool {
        true
    }

    fn damping_forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let mut loss = 0.0;
        for (k, s, counts) in self.points_of_chunk(chunk) {
            let Some(friction) = self
                .lagged_friction
                .get(k)
                .filter(|friction| friction.max_force > 0.0)
            else {
                continue;
            };
            let velocity = Self::velocity(s, at.v);
            let force = friction.force(velocity, self.static_friction_speed);
            for (i, w) in self.corners_in_chunk(chunk, s, f.len()) {
                f[i] = add(f[i], to_v4(w * force));
            }
            if counts {
                let speed = friction.slide(velocity).length();
                loss += friction.max_force
                    * FrictionMollifier::at(speed, self.static_friction_speed).value;
            }
        }
        loss
    }

    fn set_psd_projection(&mut self, projected: bool) {
        self.projected = projected;
    }

    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    ) {
        let h = h.to_f64();
        let mut blocks = std::mem::replace(&mut self.blocks, PointBlocks::new(0));
        blocks.clear();
        for (k, s) in self.contact_points.iter().enumerate() {
            let mut block = DMat3::ZERO;
            if let Some((tool, touch)) = self.active_distance(s, at.u) {
                let barrier = Barrier::clamped(touch.distance / tool.gap);
                block += outer_product(touch.normal)
                    * (h * h * s.area_stiffness * barrier.second_derivative / tool.gap);
                if !self.projected {
                    block +=
                        touch.curvature * (h * h * s.area_stiffness * barrier.first_derivative);
                }
            }
            if let Some(friction) = self
                .lagged_friction
                .get(k)
                .filter(|friction| friction.max_force > 0.0)
            {
                let velocity = Self::velocity(s, at.v);
                let speed = self.static_friction_speed;
                block += friction.tangent(velocity, speed, self.projected) * h;
            }
            blocks.push(plan, s.spread(), &block, share.diagonal);
        }
        self.blocks = blocks;
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        self.blocks
            .multiply((chunk, self.chunk_starts[chunk]), p, y);
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.blocks.visit_off_diagonal(visit);
    }
}
