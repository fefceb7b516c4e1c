//! How far a body may go before it touches, and how it makes way for tools that move.

use super::contact::{Contact, Pressing, ToolPlace};
use super::contact_hull::Near;
use super::pool::Plan;
use super::real::Real;
use super::vectors::V4;
use glam::DVec3;
use std::collections::BTreeMap;

/// Points go so deep into a tool between two iterations at most, over half of its thickness: they
/// come out again where they went in.
const DEEP: f64 = 0.25;

/// Tools move on by this part of an edge of the body's boundary between two iterations at most.
const STRIDE: f64 = 0.5;

/// And so many times in a step at most.
const MOST_STAGES: f64 = 64.0;

/// Points nearer to a tool that moves than the first part of its gap are pushed to the second.
const NEAREST: f64 = 0.1;
const PUSHED: f64 = 0.8;

/// Tools that push move on by this part of half of their thickness at a time.
const FINE: f64 = 0.25;

/// Rounds in which points that share nodes are pushed.
const ROUNDS: usize = 60;

/// A step is refused that leaves a point inside a tool by more than this part of the tool's size, or
/// of the edges of the body's boundary.
const PIERCED: f64 = 0.02;

/// Steps of conservative advancement of one point.
const ADVANCES: usize = 60;

impl<T: Real> Contact<T> {
    /// Begins a step of `time`: takes the points that may come near while no node moves by more
    /// than `margin`. In how many stages tools are to go their way; 0 where none comes near.
    pub fn begin(
        &mut self,
        u: &[V4<T>],
        (free, plan): (&[T], &Plan),
        (time, margin): (f64, f64),
    ) -> u32 {
        self.time = time;
        self.stage(0.0);
        self.choose(u, (free, plan), margin.max(self.hull.edge));
        // Nothing was weighed yet by others.
        self.chosen = false;
        if self.samples.is_empty() {
            return 0;
        }
        self.rub(u);
        let far = |tool: &Pressing| tool.way(self.hull.reach(tool.from.place, u));
        let way = self.tools.iter().map(far).fold(0.0, f64::max);
        (way / (STRIDE * self.hull.edge))
            .ceil()
            .clamp(1.0, MOST_STAGES) as u32
    }

    fn choose(&mut self, u: &[V4<T>], with: (&[T], &Plan), margin: f64) {
        let hull = &mut self.hull;
        let tools = &self.tools;
        let near = |tool| Near {
            tool,
            extra: Pressing::way(tool, hull.reach(tool.from.place, u)) + tool.gap,
        };
        let all: Vec<Near<'_>> = tools.iter().map(near).collect();
        let (free, plan) = with;
        self.samples = hull.choose((u, free, plan), margin, &all);
        self.chosen = true;
        for home in &mut self.homes {
            home.clear();
        }
        for (k, s) in self.samples.iter().enumerate() {
            s.chunks().for_each(|c| self.homes[c].push(k as u32));
        }
        self.rubs.clear();
    }

    /// Has the tools that share of their way from where they were.
    pub fn stage(&mut self, share: f64) {
        for tool in &mut self.tools {
            tool.at = tool.from.between(&tool.to, share);
        }
    }

    /// Leaves the tools where they went.
    pub fn keep(&mut self) {
        for tool in &mut self.tools {
            tool.from = tool.to;
            tool.at = tool.to;
        }
    }

    /// The part of the way from the displacements `from` to `to` on which no point goes too deep into
    /// a tool: by conservative advancement, for no distance changes faster than its point moves.
    pub fn way(&mut self, from: &[V4<T>], to: &[V4<T>], with: (&[T], &Plan)) -> f64 {
        let moved = self.hull.moved(to);
        if moved > self.hull.margin {
            self.choose(from, with, 2.0 * moved);
            self.rub(from);
        }
        let ways = self.samples.iter().map(|s| {
            let ends = [self.point(s, from), self.point(s, to)];
            way_of(&self.tools[s.tool as usize], ends)
        });
        ways.fold(1.0, f64::min)
    }

    /// Whether any point is inside a tool by more than what its stiffness explains.
    pub fn pierced(&self, u: &[V4<T>]) -> bool {
        self.samples.iter().any(|s| {
            let tool = &self.tools[s.tool as usize];
            let most = PIERCED * tool.shape.size().min(self.hull.edge);
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
            let way = tool.way(self.hull.reach(tool.from.place, u)) * (to - from);
            way / (FINE * tool.shape.half_thickness())
        });
        let moves = ways.fold(1.0, f64::max).ceil().min(1e4) as usize;
        let mut pushed = BTreeMap::new();
        for k in 1..=moves {
            self.stage(from + (to - from) * k as f64 / moves as f64);
            for _ in 0..ROUNDS {
                if !self.push_once(u, free, &mut pushed) {
                    break;
                }
            }
        }
        pushed.into_iter().collect()
    }

    fn push_once(&self, u: &[V4<T>], free: &[T], pushed: &mut BTreeMap<usize, DVec3>) -> bool {
        let mut any = false;
        for s in &self.samples {
            let tool = &self.tools[s.tool as usize];
            let by = |i: usize| pushed.get(&i).copied().unwrap_or_default();
            let p: DVec3 = s
                .corners()
                .map(|(i, w)| w * (self.hull.place(i, u) + by(i)))
                .sum();
            if tool.distance(p) >= NEAREST * tool.gap {
                continue;
            }
            let touch = tool.touch(p);
            let moves = |(i, w): (usize, f64)| w * w * free[i].wide();
            let all: f64 = s.corners().map(moves).sum();
            let far = PUSHED * tool.gap - touch.distance;
            for (i, w) in s.corners().filter(|(i, _)| free[*i] > T::ZERO) {
                *pushed.entry(i).or_default() += far * w / all * touch.normal;
            }
            any = true;
        }
        any
    }

    /// Puts a tool elsewhere, without a way.
    pub fn jump(&mut self, tool: usize, place: ToolPlace) {
        if let Some(tool) = self.tools.get_mut(tool) {
            (tool.from, tool.at, tool.to) = (place, place, place);
        }
    }
}

/// The part of the way between two places on which a point does not go too deep into a tool.
fn way_of(tool: &Pressing, [a, b]: [DVec3; 2]) -> f64 {
    let (length, deep) = (a.distance(b), DEEP * tool.shape.half_thickness());
    // Of what is deeper already nothing is gained by waiting.
    let start = tool.distance(a) + deep;
    if deep.is_infinite() || start <= 0.0 {
        return 1.0;
    }
    let (mut t, mut free) = (0.0, start);
    for _ in 0..ADVANCES {
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
