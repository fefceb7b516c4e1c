//! Continuous collision detection (CCD) with tools, and push-out for moving tools.

use super::boundary_surface::ToolNeighbourhood;
use super::tool_contact::{LocalToolPose, ToolContact, ToolState};
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use glam::DVec3;
use std::collections::BTreeMap;

/// Maximum penetration of a point between two iterations, over half of the tool's thickness: so
/// that points leave on the side where they entered.
const MAX_ITERATION_PENETRATION: f64 = 0.25;

/// Maximum advance of tools between two iterations, over the mean boundary edge length.
const MAX_STAGE_ADVANCE: f64 = 0.5;

/// Maximum number of such advances in a step.
const MAX_STAGES: f64 = 64.0;

/// Fraction of the gap of a moving tool below which points are pushed out.
const PUSH_OUT_BELOW: f64 = 0.1;

/// Fraction of the gap to which these points are pushed out.
const PUSH_OUT_TO: f64 = 0.8;

/// Advance of a tool per push-out substep, over half of its thickness.
const PUSH_SUBSTEP: f64 = 0.25;

/// Maximum number of push-out rounds, for points that share nodes.
const MAX_PUSH_OUT_ROUNDS: usize = 60;

/// Maximum penetration of a point at the end of a step, over the smaller of the tool's feature size
/// and the mean boundary edge length; a step beyond it is rejected.
const MAX_PENETRATION_RATIO: f64 = 0.02;

/// Maximum number of conservative advancement steps of a point, as in `contact_ccd.wgsl`.
const MAX_POINT_CCD_ITERATIONS: usize = 60;

impl<T: Real> ToolContact<T> {
    /// Begins a step of `time`: selects the points that may come near tools while no node moves by
    /// more than `margin`. Returns the number of stages of the tools' motion; 0 if no point comes
    /// near.
    pub fn begin(
        &mut self,
        u: &[V4<T>],
        (free, plan): (&[T], &Partition),
        (time, margin): (f64, f64),
    ) -> u32 {
        self.time = time;
        self.set_tool_fraction(0.0);
        self.build_candidates(u, (free, plan), margin.max(self.hull.edge));
        // No caller has evaluated the previous candidates.
        self.candidates_changed = false;
        if self.contact_points.is_empty() {
            return 0;
        }
        self.update_lagged_friction(u);
        let max_travel_of =
            |tool: &ToolState| tool.max_travel(self.hull.max_distance_from(tool.from.position, u));
        let travel = self.tools.iter().map(max_travel_of).fold(0.0, f64::max);
        (travel / (MAX_STAGE_ADVANCE * self.hull.edge))
            .ceil()
            .clamp(1.0, MAX_STAGES) as u32
    }

    fn build_candidates(&mut self, u: &[V4<T>], with: (&[T], &Partition), margin: f64) {
        let hull = &mut self.hull;
        let tools = &self.tools;
        let near = |tool| ToolNeighbourhood {
            tool,
            extra: ToolState::max_travel(tool, hull.max_distance_from(tool.from.position, u))
                + tool.gap,
        };
        let all: Vec<ToolNeighbourhood<'_>> = tools.iter().map(near).collect();
        let (free, plan) = with;
        self.contact_points = hull.build_candidates((u, free, plan), margin, &all);
        self.candidates_changed = true;
        for home in &mut self.chunk_points {
            home.clear();
        }
        for (k, s) in self.contact_points.iter().enumerate() {
            s.chunks().for_each(|c| self.chunk_points[c].push(k as u32));
        }
        self.lagged_friction.clear();
    }

    /// Moves the tools to the fraction `share` of their motion in the step.
    pub fn set_tool_fraction(&mut self, share: f64) {
        for tool in &mut self.tools {
            tool.at = tool.from.between(&tool.to, share);
        }
    }

    /// Keeps the tools at their final poses.
    pub fn commit_tools(&mut self) {
        for tool in &mut self.tools {
            tool.from = tool.to;
            tool.at = tool.to;
        }
    }

    /// Returns the fraction of the path between the displacements `from` and `to` on which no point
    /// penetrates a tool too deeply: conservative advancement, since no distance changes faster
    /// than its point moves.
    pub fn collision_free_fraction(
        &mut self,
        from: &[V4<T>],
        to: &[V4<T>],
        with: (&[T], &Partition),
    ) -> f64 {
        let moved = self.hull.max_displacement_since(to);
        if moved > self.hull.margin {
            self.build_candidates(from, with, 2.0 * moved);
            self.update_lagged_friction(from);
        }
        let times_of_impact = self.contact_points.iter().map(|s| {
            let ends = [self.point(s, from), self.point(s, to)];
            point_tool_toi(&self.tools[s.tool as usize], ends)
        });
        times_of_impact.fold(1.0, f64::min)
    }

    /// Whether any point penetrates a tool by more than its stiffness explains.
    pub fn exceeds_penetration_limit(&self, u: &[V4<T>]) -> bool {
        self.contact_points.iter().any(|s| {
            let tool = &self.tools[s.tool as usize];
            let most = MAX_PENETRATION_RATIO * tool.shape.feature_size().min(self.hull.edge);
            tool.distance(self.point(s, u)) < -most
        })
    }

    /// Returns the node displacements that push the nodes at `u` out of tools that move from one
    /// fraction of their motion to another, along the tools' normals. Leaves the tools at the
    /// second fraction.
    pub fn push_out(
        &mut self,
        u: &[V4<T>],
        free: &[T],
        [from, to]: [f64; 2],
    ) -> Vec<(usize, DVec3)> {
        let ways = self.tools.iter().map(|tool| {
            let travel =
                tool.max_travel(self.hull.max_distance_from(tool.from.position, u)) * (to - from);
            travel / (PUSH_SUBSTEP * tool.shape.half_thickness())
        });
        let moves = ways.fold(1.0, f64::max).ceil().min(1e4) as usize;
        let mut pushed = BTreeMap::new();
        for k in 1..=moves {
            self.set_tool_fraction(from + (to - from) * k as f64 / moves as f64);
            for _ in 0..MAX_PUSH_OUT_ROUNDS {
                if !self.push_once(u, free, &mut pushed) {
                    break;
                }
            }
        }
        pushed.into_iter().collect()
    }

    fn push_once(&self, u: &[V4<T>], free: &[T], pushed: &mut BTreeMap<usize, DVec3>) -> bool {
        let mut any = false;
        for s in &self.contact_points {
            let tool = &self.tools[s.tool as usize];
            let by = |i: usize| pushed.get(&i).copied().unwrap_or_default();
            let p: DVec3 = s
                .corners()
                .map(|(i, w)| w * (self.hull.position(i, u) + by(i)))
                .sum();
            if tool.distance(p) >= PUSH_OUT_BELOW * tool.gap {
                continue;
            }
            let touch = tool.touch(p);
            let mobility = |(i, w): (usize, f64)| w * w * free[i].to_f64();
            let all: f64 = s.corners().map(mobility).sum();
            let push_out = PUSH_OUT_TO * tool.gap - touch.distance;
            for (i, w) in s.corners().filter(|(i, _)| free[*i] > T::ZERO) {
                *pushed.entry(i).or_default() += push_out * w / all * touch.normal;
            }
            any = true;
        }
        any
    }

    /// Teleports a tool.
    pub fn teleport(&mut self, tool: usize, pose: LocalToolPose) {
        if let Some(tool) = self.tools.get_mut(tool) {
            (tool.from, tool.at, tool.to) = (pose, pose, pose);
        }
    }
}

/// Returns the fraction of the path between two positions on which a point does not penetrate a
/// tool too deeply.
fn point_tool_toi(tool: &ToolState, [a, b]: [DVec3; 2]) -> f64 {
    let (length, allowed_penetration) = (
        a.distance(b),
        MAX_ITERATION_PENETRATION * tool.shape.half_thickness(),
    );
    // Points that are already deeper are not limited.
    let initial_clearance = tool.distance(a) + allowed_penetration;
    if allowed_penetration.is_infinite() || initial_clearance <= 0.0 {
        return 1.0;
    }
    let (mut t, mut clearance) = (0.0, initial_clearance);
    for _ in 0..MAX_POINT_CCD_ITERATIONS {
        if length * (1.0 - t) <= clearance {
            return 1.0;
        }
        // Converged.
        if clearance <= 1e-2 * initial_clearance.min(allowed_penetration) {
            break;
        }
        t += clearance / length;
        clearance = tool.distance(a.lerp(b, t)) + allowed_penetration;
    }
    t
}
