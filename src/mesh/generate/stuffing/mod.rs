//! Isosurface stuffing: tets of good shape that fill an implicit solid.
//!
//! After Labelle & Shewchuk, *Isosurface stuffing: fast tetrahedral meshes with good dihedral
//! angles* (2007). A body-centred cubic lattice is laid over the solid. Lattice points that lie
//! close to its surface are moved onto it; edges that still cross it are cut there, and each
//! tet with cut edges is filled by one of a few stencils. With their warping thresholds, used
//! below, they prove a bound of 10.7° on the dihedral angles; the solids here stay above 15°.

mod clean;
mod lattice;

use crate::Result;
use crate::mesh::signed_volume;
use clean::keep_sound_part;
use glam::DVec3;
use lattice::Lattice;
use rayon::prelude::*;
use std::collections::HashMap;

/// A point is moved when a long edge (lattice step 1) is cut within this part of its length.
const WARP_LONG: f64 = 0.24999;

/// The same for a short edge, which runs from a corner to a centre of a cell.
const WARP_SHORT: f64 = 0.41189;

/// What [`stuff`] makes.
pub(super) struct Filled {
    pub nodes: Vec<DVec3>,
    pub tets: Vec<[u32; 4]>,
}

/// The nodes and tets that fill {p : inside(p) > 0} within the lattice cells [0, `cells`], in
/// lattice coordinates. The solid must keep a cell away from the sides. Pieces other than the
/// largest, and tets that hang together by less than a face, are left out.
pub(super) fn stuff(cells: [usize; 3], inside: impl Fn(DVec3) -> f64 + Sync) -> Result<Filled> {
    let lattice = Lattice::new(cells)?;
    let mut value: Vec<f64> = (0..lattice.points())
        .into_par_iter()
        .map(|i| inside(lattice.position(i)))
        .collect();
    // Points moved onto the surface; the others stay where the lattice has them.
    let warped: HashMap<usize, DVec3> = (0..lattice.points())
        .into_par_iter()
        .filter_map(|i| Some((i, warp(&lattice, &value, i, &inside)?)))
        .collect();
    for &i in warped.keys() {
        value[i] = 0.0;
    }
    let mut filling = Filling {
        lattice: &lattice,
        inside: &inside,
        value: &value,
        warped: &warped,
        nodes: Vec::new(),
        lattice_nodes: HashMap::new(),
        cut_nodes: HashMap::new(),
        tets: Vec::new(),
    };
    lattice.for_each_tet(|tet| filling.fill(tet));
    let (nodes, tets) = (filling.nodes, filling.tets);
    keep_sound_part(nodes, tets)
}

/// Where the surface crosses the edge from `a` (inside) to `b` (outside), as a fraction of it.
fn crossing(
    lattice: &Lattice,
    value: &[f64],
    [a, b]: [usize; 2],
    inside: &impl Fn(DVec3) -> f64,
) -> f64 {
    let (from, to) = (lattice.position(a), lattice.position(b));
    let (mut low, mut f_low) = (0.0, value[a]);
    let (mut high, mut f_high) = (1.0, value[b]);
    let (mut t, mut moved_last) = (0.5, None);
    // False position after Illinois; ten rounds reach rounding on anything smooth.
    for _ in 0..10 {
        t = (low * f_high - high * f_low) / (f_high - f_low);
        let f = inside(from.lerp(to, t));
        if f.abs() < 1e-12 * (value[a] - value[b]) {
            break;
        }
        // An end that stays twice in a row counts half, or it would stay for good.
        if f > 0.0 {
            (low, f_low) = (t, f);
            f_high *= if moved_last == Some(true) { 0.5 } else { 1.0 };
        } else {
            (high, f_high) = (t, f);
            f_low *= if moved_last == Some(false) { 0.5 } else { 1.0 };
        }
        moved_last = Some(f > 0.0);
    }
    t.clamp(1e-3, 1.0 - 1e-3)
}

/// Where point `i` moves to, if the surface comes close enough along one of its edges.
fn warp(
    lattice: &Lattice,
    value: &[f64],
    i: usize,
    inside: &impl Fn(DVec3) -> f64,
) -> Option<DVec3> {
    let mut nearest: Option<(f64, DVec3)> = None;
    for j in lattice.neighbours(i) {
        if value[i] * value[j] >= 0.0 {
            continue;
        }
        let edge = if value[i] > 0.0 { [i, j] } else { [j, i] };
        let t = crossing(lattice, value, edge, inside);
        let point = lattice.position(edge[0]).lerp(lattice.position(edge[1]), t);
        let part = if edge[0] == i { t } else { 1.0 - t };
        let limit = match lattice.is_long(i, j) {
            true => WARP_LONG,
            false => WARP_SHORT,
        };
        let distance = point.distance(lattice.position(i));
        if part < limit && nearest.is_none_or(|n| distance < n.0) {
            nearest = Some((distance, point));
        }
    }
    nearest.map(|n| n.1)
}

/// The nodes and tets made so far.
struct Filling<'a, F> {
    lattice: &'a Lattice,
    inside: &'a F,
    value: &'a [f64],
    warped: &'a HashMap<usize, DVec3>,
    nodes: Vec<DVec3>,
    lattice_nodes: HashMap<usize, u32>,
    cut_nodes: HashMap<[usize; 2], u32>,
    tets: Vec<[u32; 4]>,
}

impl<F: Fn(DVec3) -> f64> Filling<'_, F> {
    /// Fills one lattice tet as the signs of its corners ask.
    fn fill(&mut self, tet: [usize; 4]) {
        // Most of the lattice lies outside.
        if tet.iter().all(|p| self.value[*p] <= 0.0) {
            return;
        }
        let with = |wanted: fn(f64) -> bool| -> Vec<usize> {
            tet.into_iter().filter(|p| wanted(self.value[*p])).collect()
        };
        let (plus, minus) = (with(|f| f > 0.0), with(|f| f < 0.0));
        let zero = with(|f| f == 0.0);
        match (&plus[..], &zero[..], &minus[..]) {
            (_, _, []) => {
                let corners = tet.map(|p| self.node(p));
                self.push(corners);
            }
            ([a], _, _) => {
                let corners = tet.map(|p| match self.value[p] < 0.0 {
                    true => self.cut(*a, p),
                    false => self.node(p),
                });
                self.push(corners);
            }
            ([a, b], [z], [d]) => {
                let quad = [
                    self.node(*a),
                    self.node(*b),
                    self.cut(*b, *d),
                    self.cut(*a, *d),
                ];
                let apex = self.node(*z);
                self.pyramid(quad, self.first_diagonal(*a, *b, *d), apex);
            }
            ([a, b], _, [c, d]) => {
                let near = [self.node(*a), self.cut(*a, *c), self.cut(*a, *d)];
                let far = [self.node(*b), self.cut(*b, *c), self.cut(*b, *d)];
                let on_c = self.first_diagonal(*a, *b, *c);
                let on_d = self.first_diagonal(*a, *b, *d);
                // The quad on the surface belongs to this tet alone: its shorter diagonal.
                let length = |p: u32, q: u32| {
                    self.nodes[p as usize].distance_squared(self.nodes[q as usize])
                };
                let free = length(near[1], far[2]) <= length(near[2], far[1]);
                let free = if on_c == on_d { free } else { on_d };
                self.prism(near, far, [on_c, free, !on_d]);
            }
            ([a, b, c], _, [d, ..]) => {
                let near = [self.node(*a), self.node(*b), self.node(*c)];
                let far = [self.cut(*a, *d), self.cut(*b, *d), self.cut(*c, *d)];
                let diagonals = [
                    self.first_diagonal(*a, *b, *d),
                    self.first_diagonal(*b, *c, *d),
                    self.first_diagonal(*c, *a, *d),
                ];
                self.prism(near, far, diagonals);
            }
            _ => {}
        }
    }

    /// Which diagonal splits the quad that is left of a lattice face with `a` and `b` inside
    /// and `d` outside: true for the one from `a` to the cut next to `b`.
    ///
    /// Both tets at the face must come to the same answer, so it depends on the face alone. The
    /// diagonal that avoids the cut of a long edge makes the better tets.
    fn first_diagonal(&self, a: usize, b: usize, d: usize) -> bool {
        match (self.lattice.is_long(a, d), self.lattice.is_long(b, d)) {
            (true, false) => true,
            (false, true) => false,
            _ => a < b,
        }
    }

    /// The prism between the triangles `near` and `far`. Flag i: the quad between corners i and
    /// i+1 is split from near[i] to far[i+1], not from near[i+1] to far[i].
    fn prism(&mut self, near: [u32; 3], far: [u32; 3], first: [bool; 3]) {
        for i in 0..3 {
            let (next, last) = ((i + 1) % 3, (i + 2) % 3);
            // Two diagonals that meet in one corner: a pyramid over the third quad from there,
            // and the tet over the triangle at the other end.
            let (apex, triangle) = match (first[i], first[last]) {
                (true, false) => (near[i], far),
                (false, true) => (far[i], near),
                _ => continue,
            };
            let quad = [near[next], near[last], far[last], far[next]];
            self.pyramid(quad, first[next], apex);
            self.push([apex, triangle[0], triangle[1], triangle[2]]);
            return;
        }
    }

    /// The pyramid over `quad`, split along 0–2 when `first`, otherwise along 1–3.
    fn pyramid(&mut self, quad: [u32; 4], first: bool, apex: u32) {
        let [p, q, r, s] = quad;
        let halves = match first {
            true => [[p, q, r], [p, r, s]],
            false => [[p, q, s], [q, r, s]],
        };
        for [a, b, c] in halves {
            self.push([apex, a, b, c]);
        }
    }

    fn push(&mut self, mut tet: [u32; 4]) {
        if signed_volume(tet.map(|v| self.nodes[v as usize])) < 0.0 {
            tet.swap(2, 3);
        }
        self.tets.push(tet);
    }

    /// The node at lattice point `p`.
    fn node(&mut self, p: usize) -> u32 {
        let next = self.nodes.len() as u32;
        let index = *self.lattice_nodes.entry(p).or_insert(next);
        if index == next {
            let position = self.warped.get(&p).copied();
            self.nodes
                .push(position.unwrap_or_else(|| self.lattice.position(p)));
        }
        index
    }

    /// The node where the edge from `a` (inside) to `b` (outside) leaves the solid.
    fn cut(&mut self, a: usize, b: usize) -> u32 {
        let next = self.nodes.len() as u32;
        let index = *self.cut_nodes.entry([a, b]).or_insert(next);
        if index == next {
            let t = crossing(self.lattice, self.value, [a, b], self.inside);
            let (from, to) = (self.lattice.position(a), self.lattice.position(b));
            self.nodes.push(from.lerp(to, t));
        }
        index
    }
}
