//! Continuous collision detection (CCD) with tools, and push-out for moving tools.

use super::boundary_surface::ToolNeighbourhood;
use super::tool_contact::{LocalToolPose, ToolContact, ToolState};
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::vectors::V4;
use glam::DVec3;
use std::collections::BTreeMap;

/// Points go so deep into a tool between two iterations at most, over half of its thickness: they
/// come out again where they went in.
const MAX_ITERATION_PENETRATION: f64 = 0.25;

/// Tools move on by this part of an edge of the body's boundary between two iterations at most.
const MAX_STAGE_ADVANCE: f64 = 0.5;

/// And so many times in a step at most.
const MAX_STAGES: f64 = 64.0;

/// Points nearer to a tool that moves than the first part of its gap are pushed to the second.
const PUSH_OUT_BELOW: f64 = 0.1;
const PUSH_OUT_TO: f64 = 0.8;

/// Tools that push move on by this part of half of their thickness at a time.
const PUSH_SUBSTEP: f64 = 0.25;

/// Rounds in which points that share nodes are pushed.
const MAX_PUSH_OUT_ROUNDS: usize = 60;

/// A step is refused that leaves a point inside a tool by more than this part of the tool's size, or
/// of the edges of the body's boundary.
const MAX_PENETRATION_RATIO: f64 = 0.02;

/// Largest number of conservative advancement steps of one point.
const MAX_CCD_ITERATIONS: usize = 60;

impl<T: Real> ToolContact<T> {
    /// Begins a step of `time`: takes the points that may come near while no node moves by more
    /// than `margin`. In how many stages tools are to go their way; 0 where none comes near.
    pub fn begin(
        &mut self,
        u: &[V4<T>],
        (free, plan): (&[T], &Partition),
        (time, margin): (f64, f64),
    ) -> u32 {
        self.time = time;
        self.set_tool_fraction(0.0);
        self.build_candidates(u, (free, plan), margin.max(self.hull.edge));
        // Nothing was weighed yet by others.
        self.candidates_changed = false;
        if self.contact_points.is_empty() {
            return 0;
        }
        self.update_friction(u);
        let far =
            |tool: &ToolState| tool.max_travel(self.hull.max_distance_from(tool.from.place, u));
        let way = self.tools.iter().map(far).fold(0.0, f64::max);
        (way / (MAX_STAGE_ADVANCE * self.hull.edge))
            .ceil()
            .clamp(1.0, MAX_STAGES) as u32
    }

    fn build_candidates(&mut self, u: &[V4<T>], with: (&[T], &Partition), margin: f64) {
        let hull = &mut self.hull;
        let tools = &self.tools;
        let near = |tool| ToolNeighbourhood {
            tool,
            extra: ToolState::max_travel(tool, hull.max_distance_from(tool.from.place, u))
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

    /// Has the tools that share of their way from where they were.
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
            self.update_friction(from);
        }
        let ways = self.contact_points.iter().map(|s| {
            let ends = [self.point(s, from), self.point(s, to)];
            point_tool_toi(&self.tools[s.tool as usize], ends)
        });
        ways.fold(1.0, f64::min)
    }

    /// Whether any point penetrates a tool by more than its stiffness explains.
    pub fn exceeds_penetration_limit(&self, u: &[V4<T>]) -> bool {
        self.contact_points.iter().any(|s| {
            let tool = &self.tools[s.tool as usize];
            let most = MAX_PENETRATION_RATIO * tool.shape.feature_size().min(self.hull.edge);
            tool.distance(self.point(s, u)) < -most
        })
    }

    /// How the nodes at `u` make way for tools that go from one share of their way to another,
    /// where they have to: each node and by how much, pushed along the tools' normals. Tools are
    /// at the second after.
    pub fn push_out(
        &mut self,
        u: &[V4<T>],
        free: &[T],
        [from, to]: [f64; 2],
    ) -> Vec<(usize, DVec3)> {
        let ways = self.tools.iter().map(|tool| {
            let way =
                tool.max_travel(self.hull.max_distance_from(tool.from.place, u)) * (to - from);
            way / (PUSH_SUBSTEP * tool.shape.half_thickness())
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
            let moves = |(i, w): (usize, f64)| w * w * free[i].to_f64();
            let all: f64 = s.corners().map(moves).sum();
            let far = PUSH_OUT_TO * tool.gap - touch.distance;
            for (i, w) in s.corners().filter(|(i, _)| free[*i] > T::ZERO) {
                *pushed.entry(i).or_default() += far * w / all * touch.normal;
            }
            any = true;
        }
        any
    }

    /// Teleports a tool.
    pub fn teleport(&mut self, tool: usize, place: LocalToolPose) {
        if let Some(tool) = self.tools.get_mut(tool) {
            (tool.from, tool.at, tool.to) = (place, place, place);
        }
    }
}

/// The part of the way between two places on which a point does not go too deep into a tool.
fn point_tool_toi(tool: &ToolState, [a, b]: [DVec3; 2]) -> f64 {
    let (length, deep) = (
        a.distance(b),
        MAX_ITERATION_PENETRATION * tool.shape.half_thickness(),
    );
    // Of what is deeper already nothing is gained by waiting.
    let start = tool.distance(a) + deep;
    if deep.is_infinite() || start <= 0.0 {
        return 1.0;
    }
    let (mut t, mut free) = (0.0, start);
    for _ in 0..MAX_CCD_ITERATIONS {
        if length * (1.0 - t) <= free {
            return 1.0;
        }
        // As good as there.
        if free <= 1e-2 * start.min(deep) {
            break;
        }
        t += free / length;
        free = tool.distance(a.lerp(b, t)) + deep;
    }
    t
}
