//! Tools that press on a body: a term of its energy that keeps points of its boundary out of them.
//!
//! E = Σ A K ĝ b(d/ĝ) over points of the boundary whose distance d from a tool is less than ĝ, b
//! being the barrier of incremental potential contact (Li et al. 2020), A the area that a point
//! stands for and K the Young's modulus of what lies behind it: pressure is K |b'|, so that even
//! what is pressed hard stands off by nearly ĝ. Friction is Coulomb's, with the normal forces and
//! normals of the iterate before (section 5 there), as a potential of velocities.

use super::contact_blocks::Blocks;
use super::contact_hull::{Hull, Sample};
use super::pool::Plan;
use super::real::Real;
use super::terms::{At, Share, Term};
use super::vectors::{V4, add};
use crate::physics::contact::{Barrier, Shape, Slip, Touch};
use glam::{DMat3, DQuat, DVec3};

/// Where a tool is, local units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ToolPlace {
    pub place: DVec3,
    pub turn: DQuat,
}

impl ToolPlace {
    /// Between this and `to`.
    pub fn between(&self, to: &ToolPlace, share: f64) -> ToolPlace {
        if share >= 1.0 {
            return *to;
        }
        ToolPlace {
            place: self.place.lerp(to.place, share),
            turn: self.turn.slerp(to.turn, share),
        }
    }

    /// Where `p` is in its frame.
    pub fn inward(&self, p: DVec3) -> DVec3 {
        self.turn.inverse() * (p - self.place)
    }

    /// Where what is `p` in its frame is.
    pub fn outward(&self, p: DVec3) -> DVec3 {
        self.place + self.turn * p
    }

    /// As numbers, to the bit.
    pub fn numbers(&self) -> [f64; 7] {
        let ([a, b, c], [x, y, z, w]) = (self.place.to_array(), self.turn.to_array());
        [a, b, c, x, y, z, w]
    }

    /// What [`ToolPlace::numbers`] gave.
    pub fn of_numbers([a, b, c, x, y, z, w]: [f64; 7]) -> ToolPlace {
        ToolPlace {
            place: DVec3::new(a, b, c),
            turn: DQuat::from_array([x, y, z, w]),
        }
    }
}

/// A tool in local units.
#[derive(Clone, Debug)]
pub(super) struct Pressing {
    pub shape: Shape,
    /// Where it was at the start of the step, where it is in it, and where it goes.
    pub from: ToolPlace,
    pub at: ToolPlace,
    pub to: ToolPlace,
    pub friction: f64,
    /// ĝ.
    pub gap: f64,
    /// How often it was put elsewhere.
    pub jumps: u64,
}

impl Pressing {
    /// Where `p` stands to it.
    pub fn touch(&self, p: DVec3) -> Touch {
        let touch = self.shape.touch(self.at.inward(p));
        let turn = DMat3::from_quat(self.at.turn);
        Touch {
            distance: touch.distance,
            normal: turn * touch.normal,
            curvature: turn * touch.curvature * turn.transpose(),
        }
    }

    /// The distance of `p`.
    pub fn distance(&self, p: DVec3) -> f64 {
        self.shape.distance(self.at.inward(p))
    }

    /// How far it goes in the step at most where it is within `reach` of its origin.
    pub fn way(&self, reach: f64) -> f64 {
        let arm = self.shape.radius().min(reach);
        let angle = self.from.turn.angle_between(self.to.turn);
        self.from.place.distance(self.to.place) + angle * arm
    }
}

/// What a point's friction goes by: those of the iterate before.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rub {
    pub normal: DVec3,
    /// μ times the normal force.
    pub limit: f64,
    /// Velocity of the tool there.
    pub drift: DVec3,
}

/// The tools of a body.
pub(super) struct Contact<T> {
    pub tools: Vec<Pressing>,
    pub hull: Hull,
    /// Points that may come near in the step.
    pub samples: Vec<Sample>,
    /// Whether they were chosen since this was looked at last: friction goes by them.
    pub chosen: bool,
    /// Those with a node in each chunk.
    pub homes: Vec<Vec<u32>>,
    pub rubs: Vec<Rub>,
    /// The speed below which friction holds.
    pub least_speed: f64,
    /// Time over which the tools go from where they were.
    pub time: f64,
    firsts: Vec<usize>,
    blocks: Blocks<T>,
    projected: bool,
}

impl<T: Real> Contact<T> {
    /// No tools yet, on a boundary.
    pub fn new(hull: Hull, plan: &Plan, least_speed: f64) -> Contact<T> {
        let chunks = plan.chunks();
        Contact {
            tools: Vec::new(),
            hull,
            samples: Vec::new(),
            chosen: false,
            homes: vec![Vec::new(); chunks],
            rubs: Vec::new(),
            least_speed,
            time: 0.0,
            firsts: (0..chunks).map(|c| plan.range(c).start).collect(),
            blocks: Blocks::new(chunks),
            projected: false,
        }
    }

    /// Where a point is.
    pub fn point(&self, s: &Sample, u: &[V4<T>]) -> DVec3 {
        s.corners()
            .map(|(i, w)| w * self.hull.place(i, u))
            .sum::<DVec3>()
    }

    /// The tool of a point, where that stands to it, and A K; none where it is too far.
    fn touched(&self, s: &Sample, u: &[V4<T>]) -> Option<(&Pressing, Touch)> {
        let tool = &self.tools[s.tool as usize];
        let p = self.point(s, u);
        // Without rotating anything for what is far.
        if tool.distance(p) >= tool.gap {
            return None;
        }
        Some((tool, tool.touch(p)))
    }

    /// The force on a point that touches, from the tool, without friction.
    fn push(&self, s: &Sample, tool: &Pressing, touch: &Touch) -> DVec3 {
        -s.weight * Barrier::at(touch.distance / tool.gap).slope * touch.normal
    }

    /// The velocity of a point, from that of the tool there, along its surface.
    fn sliding(&self, s: &Sample, rub: &Rub, v: &[V4<T>]) -> DVec3 {
        let own: DVec3 = s.corners().map(|(i, w)| w * wide(v[i])).sum();
        let off = own - rub.drift;
        off - rub.normal * rub.normal.dot(off)
    }

    /// The force of friction on a point.
    fn rubbing(&self, s: &Sample, rub: &Rub, v: &[V4<T>]) -> DVec3 {
        let slide = self.sliding(s, rub, v);
        -rub.limit * Slip::at(slide.length(), self.least_speed).slope_over * slide
    }

    /// Takes note of normal forces, normals and velocities of tools at the displacements `u`, for
    /// friction. By how much the forces changed, over themselves.
    pub fn rub(&mut self, u: &[V4<T>]) -> f64 {
        let mut rubs = std::mem::take(&mut self.rubs);
        rubs.resize(self.samples.len(), Rub::default());
        let (mut change, mut all) = (0.0, 0.0);
        if self.damped() && self.time > 0.0 {
            for (s, rub) in self.samples.iter().zip(&mut rubs) {
                let before = std::mem::take(rub);
                if self.tools[s.tool as usize].friction > 0.0 {
                    *rub = self.rub_of(s, u).unwrap_or_default();
                }
                let vector = |r: &Rub| r.limit * r.normal;
                change += vector(rub).distance(vector(&before));
                all += rub.limit;
            }
        }
        self.rubs = rubs;
        match change > 0.0 {
            true => change / all.max(change),
            false => 0.0,
        }
    }

    fn rub_of(&self, s: &Sample, u: &[V4<T>]) -> Option<Rub> {
        let (tool, touch) = self.touched(s, u)?;
        let own = tool.at.inward(self.point(s, u));
        let moved = tool.to.outward(own) - tool.from.outward(own);
        Some(Rub {
            normal: touch.normal,
            limit: tool.friction * self.push(s, tool, &touch).length(),
            drift: moved / self.time,
        })
    }

    /// Whether anything touches a tool at the displacements `u`.
    #[cfg(test)]
    pub fn touches(&self, u: &[V4<T>]) -> bool {
        self.samples.iter().any(|s| self.touched(s, u).is_some())
    }

    /// Σ λ² w²/m over points, λ being normal forces and `over` inverse blocks: what residuals are
    /// measured by where contact bears all that acts.
    pub fn weight(&self, u: &[V4<T>], over: impl Fn(usize, DVec3) -> f64) -> f64 {
        let of = |s: &Sample| {
            let force = self
                .touched(s, u)
                .map(|(tool, touch)| self.push(s, tool, &touch));
            force.map_or(0.0, |f| s.corners().map(|(i, w)| over(i, w * f)).sum())
        };
        self.samples.iter().map(of).sum()
    }

    /// Force of the body on each tool, and its moment about the origin of the tool's shape.
    pub fn reactions(&self, at: At<'_, T>) -> Vec<[DVec3; 2]> {
        let mut sums = vec![[DVec3::ZERO; 2]; self.tools.len()];
        for (k, s) in self.samples.iter().enumerate() {
            let Some((tool, touch)) = self.touched(s, at.u) else {
                continue;
            };
            let mut force = self.push(s, tool, &touch);
            if let Some(rub) = self.rubs.get(k).filter(|rub| rub.limit > 0.0) {
                force += self.rubbing(s, rub, at.v);
            }
            let [sum, moment] = &mut sums[s.tool as usize];
            *sum -= force;
            *moment -= (self.point(s, at.u) - tool.at.place).cross(force);
        }
        sums
    }

    /// Tells the corners of a point that are in a chunk, as numbers in it.
    #[inline]
    fn within<'a>(
        &'a self,
        chunk: usize,
        s: &'a Sample,
        count: usize,
    ) -> impl Iterator<Item = (usize, f64)> + 'a {
        let first = self.firsts[chunk];
        // Nodes before the chunk wrap around and are beyond its end.
        let own = s.corners().map(move |(i, w)| (i.wrapping_sub(first), w));
        own.filter(move |(i, _)| *i < count)
    }

    /// The points with a node in a chunk, and whether it is the one to count their energy.
    fn of_chunk(&self, chunk: usize) -> impl Iterator<Item = (usize, &Sample, bool)> {
        self.homes[chunk].iter().map(move |k| {
            let s = &self.samples[*k as usize];
            (*k as usize, s, s.home as usize == chunk)
        })
    }
}

impl<T: Real> Term<T> for Contact<T> {
    fn forces(&self, chunk: usize, at: At<'_, T>, f: &mut [V4<T>]) -> f64 {
        let energy = self.elastic(chunk, at.u, f);
        self.resist(chunk, at, f);
        energy
    }

    fn elastic(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        let mut energy = 0.0;
        for (_, s, counts) in self.of_chunk(chunk) {
            let Some((tool, touch)) = self.touched(s, u) else {
                continue;
            };
            let force = self.push(s, tool, &touch);
            for (i, w) in self.within(chunk, s, f.len()) {
                f[i] = add(f[i], narrow(w * force));
            }
            if counts {
                energy += s.weight * tool.gap * Barrier::at(touch.distance / tool.gap).value;
            }
        }
        energy
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        let own = self.of_chunk(chunk).filter(|(.., counts)| *counts);
        own.map(|(_, s, _)| {
            let tool = &self.tools[s.tool as usize];
            let gap = tool.distance(self.point(s, u)) / tool.gap;
            s.weight * tool.gap * Barrier::at(gap).value
        })
        .sum()
    }

    fn damped(&self) -> bool {
        self.tools.iter().any(|tool| tool.friction > 0.0)
    }

    fn resist(&self, chunk: usize, at: At<'_, T>, f: &mut [V4<T>]) -> f64 {
        let mut loss = 0.0;
        for (k, s, counts) in self.of_chunk(chunk) {
            let Some(rub) = self.rubs.get(k).filter(|rub| rub.limit > 0.0) else {
                continue;
            };
            let force = self.rubbing(s, rub, at.v);
            for (i, w) in self.within(chunk, s, f.len()) {
                f[i] = add(f[i], narrow(w * force));
            }
            if counts {
                let speed = self.sliding(s, rub, at.v).length();
                loss += rub.limit * Slip::at(speed, self.least_speed).value;
            }
        }
        loss
    }

    fn project(&mut self, projected: bool) {
        self.projected = projected;
    }

    fn linearise(&mut self, plan: &Plan, at: At<'_, T>, h: T, share: Share<'_, T>) {
        let h = h.wide();
        let mut blocks = std::mem::replace(&mut self.blocks, Blocks::new(0));
        blocks.clear();
        for (k, s) in self.samples.iter().enumerate() {
            let mut block = DMat3::ZERO;
            if let Some((tool, touch)) = self.touched(s, at.u) {
                let barrier = Barrier::at(touch.distance / tool.gap);
                block += outer(touch.normal) * (h * h * s.weight * barrier.bend / tool.gap);
                if !self.projected {
                    block += touch.curvature * (h * h * s.weight * barrier.slope);
                }
            }
            if let Some(rub) = self.rubs.get(k).filter(|rub| rub.limit > 0.0) {
                let slide = self.sliding(s, rub, at.v);
                let slip = Slip::at(slide.length(), self.least_speed);
                let along = slide.normalize_or_zero();
                let plane = DMat3::IDENTITY - outer(rub.normal);
                let across = plane * slip.slope_over;
                let bend = match self.projected {
                    true => slip.held(),
                    false => slip.bend,
                };
                let way = outer(along) * (bend - slip.slope_over);
                block += (across + way) * (h * rub.limit);
            }
            blocks.push(plan, s.spread(), &block, share.diagonal);
        }
        self.blocks = blocks;
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        self.blocks.multiply((chunk, self.firsts[chunk]), p, y);
    }

    fn pairs(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        self.blocks.pairs(visit);
    }

    fn contact(&self) -> Option<&Contact<T>> {
        Some(self)
    }

    fn contact_mut(&mut self) -> Option<&mut Contact<T>> {
        Some(self)
    }
}

pub(super) fn wide<T: Real>(v: V4<T>) -> DVec3 {
    DVec3::new(v[0].wide(), v[1].wide(), v[2].wide())
}

pub(super) fn narrow<T: Real>(v: DVec3) -> V4<T> {
    [T::of(v.x), T::of(v.y), T::of(v.z), T::ZERO]
}

pub(super) fn outer(n: DVec3) -> DMat3 {
    DMat3::from_cols(n * n.x, n * n.y, n * n.z)
}
