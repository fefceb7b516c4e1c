//! Subdivision of each tet of the cut lattice.
//!
//! At an interface of two regions: the stencils of Labelle & Shewchuk, *Isosurface stuffing*
//! (2007), on both sides. At a junction of three or four: the faces of the tet are subdivided
//! first, depending on the face alone, and connected to an interior point.

use super::cut::{CutLattice, ON_BOUNDARY};
use super::domain::Sampler;
use super::junction::{Junctions, face_key};
use super::lattice::LatticeMesh;
use crate::mesh::{FACES, TetQuality, signed_volume};
use glam::DVec3;

/// A tet and its region.
pub(super) type Piece = ([u32; 4], u16);

/// Minimum dihedral angle of a tet with four snapped corners to stay in the body: the bound that
/// Labelle & Shewchuk prove for the others.
const MIN_DIHEDRAL: f64 = 10.7;
const MAX_DIHEDRAL: f64 = 164.8;

/// Subdivides tets. The nodes are numbered: lattice points, cuts, face points, interior points.
pub(super) struct Stencils<'a> {
    pub lattice: &'a LatticeMesh,
    pub cut: &'a CutLattice,
    pub junctions: &'a Junctions,
    pub nodes: &'a [DVec3],
}

/// The corners of a tet by region.
pub(super) struct Corners {
    /// The regions in the order of the corners, and their corners.
    pub groups: Vec<(u16, Vec<u32>)>,
    /// The corners on a boundary.
    pub zero: Vec<u32>,
}

impl Corners {
    pub(super) fn of(cut: &CutLattice, tet: [u32; 4]) -> Corners {
        let (mut groups, mut zero) = (Vec::<(u16, Vec<u32>)>::new(), Vec::new());
        for p in tet {
            let region = cut.region[p as usize];
            if region == ON_BOUNDARY {
                zero.push(p);
            } else if let Some(group) = groups.iter_mut().find(|g| g.0 == region) {
                group.1.push(p);
            } else {
                groups.push((region, vec![p]));
            }
        }
        Corners { groups, zero }
    }

    /// Whether the stencil has an interior point.
    pub(super) fn needs_interior_point(&self, lattice: &LatticeMesh) -> bool {
        match &self.groups[..] {
            [(_, one), (_, other)] => match (&one[..], &other[..]) {
                ([a, b], [c, d]) => {
                    let near = forced(lattice, [*a, *b], [*c, *d]);
                    let far = forced(lattice, [*c, *d], [*a, *b]);
                    // The opposite one connects the same cuts.
                    matches!((near, far), (Some(n), Some(f)) if n != f)
                }
                _ => false,
            },
            groups => groups.len() > 2 && self.zero.is_empty(),
        }
    }
}

/// Returns which diagonal splits the quad that remains of a face with `a` and `b` in one region and
/// `d` in another: true for the one from `a` to the cut next to `b`.
///
/// Both tets at the face must choose the same diagonal, so it depends on the face alone. The
/// diagonal that avoids the cut of a long edge gives better tets.
fn first_diagonal(lattice: &LatticeMesh, a: u32, b: u32, d: u32) -> bool {
    match (lattice.is_long(a, d), lattice.is_long(b, d)) {
        (true, false) => true,
        (false, true) => false,
        _ => a < b,
    }
}

/// For `a`, `b` on one side and `c`, `d` on the other: whether the quad of the cuts must be split
/// between those of a–c and b–d (true) or of a–d and b–c (false), if the faces determine it.
fn forced(lattice: &LatticeMesh, [a, b]: [u32; 2], [c, d]: [u32; 2]) -> Option<bool> {
    let on_c = first_diagonal(lattice, a, b, c);
    let on_d = first_diagonal(lattice, a, b, d);
    (on_c != on_d).then_some(on_d)
}

impl Stencils<'_> {
    /// Adds the tets that subdivide lattice tet `t`. Those outside are dropped unless they touch a
    /// boundary.
    pub(super) fn subdivide(&self, t: u32, sampler: &mut Sampler, out: &mut Vec<Piece>) {
        let tet = self.lattice.tets[t as usize];
        // Most tets lie in one region and are not subdivided.
        let first = self.cut.region[tet[0] as usize];
        if first != ON_BOUNDARY && tet.iter().all(|p| self.cut.region[*p as usize] == first) {
            if first != 0 {
                self.push(tet, first, out);
            }
            return;
        }
        let corners = Corners::of(self.cut, tet);
        match &corners.groups[..] {
            [] => self.push(tet, self.region_of_moved(tet, sampler), out),
            [(region, _)] => self.push(tet, *region, out),
            _ if corners.needs_interior_point(self.lattice) => {
                let middle = self.junctions.tet_point(t);
                self.cone(tet, middle, |_| true, out);
            }
            [(r, one), (s, other)] => {
                self.side(one, &corners.zero, other, *r, out);
                self.side(other, &corners.zero, one, *s, out);
            }
            // Three regions and a corner on their boundary: connected to that corner.
            _ => {
                if let Some(&zero) = corners.zero.first() {
                    self.cone(tet, zero, |face| !face.contains(&zero), out);
                }
            }
        }
    }

    /// Returns the region of a tet with all corners on boundaries.
    fn region_of_moved(&self, tet: [u32; 4], sampler: &mut Sampler) -> u16 {
        let corners = tet.map(|p| self.nodes[p as usize]);
        let region = sampler.region(corners.into_iter().sum::<DVec3>() / 4.0);
        let angles = TetQuality::dihedral_angles(corners);
        let good = angles
            .iter()
            .all(|a| (MIN_DIHEDRAL..MAX_DIHEDRAL).contains(a));
        let at_outside = tet.iter().all(|p| self.cut.sides[*p as usize][0] == 0);
        if good || !at_outside { region } else { 0 }
    }

    /// Adds the part of a tet on the side of the corners `plus`, separated from the corners
    /// `minus`.
    fn side(&self, plus: &[u32], zero: &[u32], minus: &[u32], region: u16, out: &mut Vec<Piece>) {
        match (plus, zero, minus) {
            ([a], _, _) => {
                let mut tet = [*a; 4];
                let others = zero.iter().copied();
                let cuts = minus.iter().map(|m| self.cut(*a, *m));
                for (corner, node) in tet[1..].iter_mut().zip(others.chain(cuts)) {
                    *corner = node;
                }
                self.push(tet, region, out);
            }
            ([a, b], [z], [d]) => {
                let quad = [*a, *b, self.cut(*b, *d), self.cut(*a, *d)];
                let first = first_diagonal(self.lattice, *a, *b, *d);
                self.pyramid(quad, first, *z, region, out);
            }
            ([a, b], _, [c, d]) => {
                let near = [*a, self.cut(*a, *c), self.cut(*a, *d)];
                let far = [*b, self.cut(*b, *c), self.cut(*b, *d)];
                let on_c = first_diagonal(self.lattice, *a, *b, *c);
                let on_d = first_diagonal(self.lattice, *a, *b, *d);
                let forced = forced(self.lattice, [*a, *b], [*c, *d])
                    .or_else(|| self::forced(self.lattice, [*c, *d], [*a, *b]));
                // The quad on the boundary belongs to this tet alone: its shorter diagonal.
                let length = |p: u32, q: u32| {
                    self.nodes[p as usize].distance_squared(self.nodes[q as usize])
                };
                let shorter = length(near[1], far[2]) <= length(near[2], far[1]);
                let diagonals = [on_c, forced.unwrap_or(shorter), !on_d];
                self.prism(near, far, diagonals, region, out);
            }
            ([a, b, c], _, [d]) => {
                let near = [*a, *b, *c];
                let far = near.map(|p| self.cut(p, *d));
                let diagonals = [(*a, *b), (*b, *c), (*c, *a)]
                    .map(|(p, q)| first_diagonal(self.lattice, p, q, *d));
                self.prism(near, far, diagonals, region, out);
            }
            _ => {}
        }
    }

    /// Adds the prism between the triangles `near` and `far`. Flag i: the quad between corners i
    /// and i+1 is split from near[i] to far[i+1], not from near[i+1] to far[i].
    fn prism(
        &self,
        near: [u32; 3],
        far: [u32; 3],
        first: [bool; 3],
        region: u16,
        out: &mut Vec<Piece>,
    ) {
        for i in 0..3 {
            let (next, last) = ((i + 1) % 3, (i + 2) % 3);
            // Two diagonals share a corner: a pyramid over the third quad with its apex there, and
            // the tet over the triangle at the other end.
            let (apex, triangle) = match (first[i], first[last]) {
                (true, false) => (near[i], far),
                (false, true) => (far[i], near),
                _ => continue,
            };
            let quad = [near[next], near[last], far[last], far[next]];
            self.pyramid(quad, first[next], apex, region, out);
            self.push([apex, triangle[0], triangle[1], triangle[2]], region, out);
            return;
        }
    }

    /// Adds the pyramid over `quad`, split along 0–2 if `first`, otherwise along 1–3.
    fn pyramid(&self, quad: [u32; 4], first: bool, apex: u32, region: u16, out: &mut Vec<Piece>) {
        for [a, b, c] in halves(quad, first) {
            self.push([apex, a, b, c], region, out);
        }
    }

    /// Connects the pieces of the selected faces of `tet` to `apex`.
    fn cone(
        &self,
        tet: [u32; 4],
        apex: u32,
        wanted: impl Fn(&[u32; 3]) -> bool,
        out: &mut Vec<Piece>,
    ) {
        let faces = FACES.map(|f| f.map(|i| tet[i]));
        for face in faces.iter().filter(|f| wanted(f)) {
            self.face_pieces(*face, |[a, b, c], region| {
                self.push([apex, a, b, c], region, out);
            });
        }
    }

    /// Enumerates the triangles that subdivide a face of the lattice without snapped corners, each
    /// with its region. They depend on the face alone.
    fn face_pieces(&self, face: [u32; 3], mut piece: impl FnMut([u32; 3], u16)) {
        let region = face.map(|p| self.cut.region[p as usize]);
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let (a, b, d) = (face[i], face[j], face[k]);
            if region[i] == region[j] && region[j] != region[k] {
                let quad = [a, b, self.cut(b, d), self.cut(a, d)];
                for half in halves(quad, first_diagonal(self.lattice, a, b, d)) {
                    piece(half, region[i]);
                }
                piece([quad[3], quad[2], d], region[k]);
                return;
            }
        }
        if region[0] == region[1] {
            piece(face, region[0]);
            return;
        }
        let middle = self.junctions.face_point(face_key(face));
        for i in 0..3 {
            let (a, b) = (face[i], face[(i + 1) % 3]);
            let cut = self.cut(a, b);
            piece([a, cut, middle], region[i]);
            piece([cut, b, middle], region[(i + 1) % 3]);
        }
    }

    /// Returns the node of the cut of the edge between two lattice points.
    fn cut(&self, a: u32, b: u32) -> u32 {
        let found = self.cut.edges.binary_search(&[a.min(b), a.max(b)]);
        // Every edge between two regions is cut, so the search cannot fail.
        let place = found.unwrap_or_else(|place| place);
        (self.cut.positions.len() + place) as u32
    }

    fn push(&self, mut tet: [u32; 4], region: u16, out: &mut Vec<Piece>) {
        if signed_volume(tet.map(|v| self.nodes[v as usize])) < 0.0 {
            tet.swap(2, 3);
        }
        out.push((tet, region));
    }
}

/// Returns the two triangles of a quad, split along 0–2 if `first`, otherwise along 1–3.
fn halves([p, q, r, s]: [u32; 4], first: bool) -> [[u32; 3]; 2] {
    match first {
        true => [[p, q, r], [p, r, s]],
        false => [[p, q, s], [q, r, s]],
    }
}
