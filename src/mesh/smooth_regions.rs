//! A mesh for pictures whose regions have smooth boundaries: tets that several regions share are divided
//! where the interpolated shares of the regions are equal.

use super::finer_space::FinerSpace;
use super::region_shares::{Shares, add, blend, largest, normalise, share_of, tet_shares};
use super::{ElementOrder, FACES, Field, Location, TET_EDGES, TetMesh, signed_volume};
use crate::{Result, parallel};
use glam::DVec3;
use std::collections::BTreeMap;

/// Rounds of smoothing of the shares of a mesh without a label volume, and the weight of the
/// neighbours in each.
const ROUNDS: usize = 1;
const NEIGHBOURS: f64 = 0.3;
/// Rounds in which the shares of thin regions grow, by how much in each, and the part of its volume below
/// which a region is thin: boundaries of other regions stay where the mesh has them.
const THIN: f64 = 0.7;
const VOLUME_ROUNDS: usize = 12;
const VOLUME_STEP: f64 = 0.06;
/// Share above which a region is far from its boundaries.
const CLEAR: f64 = 0.9;
/// Nodes that a region without others gets have this part of its largest share at a node.
const KEPT: f64 = 0.9;
/// Least distance of a boundary from a node along an edge, relative to its length.
const NEAREST: f64 = 0.04;
/// Largest number of tets after the division of those at boundaries.
const MAX_TETS: usize = 3_000_000;

/// A volume of labels around a body at rest.
#[derive(Clone, Copy)]
pub(crate) struct LabelShares<'a> {
    /// Returns the shares of labels around a point, within about a distance. What is missing of their sum
    /// of 1 is outside of the volume.
    pub shares: &'a (dyn Fn(DVec3, f64) -> Vec<(i64, f64)> + Sync),
    /// Distance of its voxels, in the unit of the mesh.
    pub voxel: f64,
}

/// Nodes that carry a point, and their weights, of sum 1.
pub(super) type Carriers = ([u32; 4], [f64; 4]);

/// A mesh that is drawn in place of another.
pub(crate) struct SmoothRegions {
    /// The divided mesh; its tets are linear.
    pub mesh: TetMesh,
    /// Nodes of the other mesh that carry each node, and their weights.
    pub weights: Vec<Carriers>,
}

impl SmoothRegions {
    /// Returns vectors at the nodes of the drawn mesh, given those at the nodes of the other.
    pub fn vectors(&self, of: &[DVec3]) -> Vec<DVec3> {
        let at = |(nodes, weights): &Carriers| {
            let parts = nodes.iter().zip(weights);
            parts.map(|(v, w)| *w * of[*v as usize]).sum()
        };
        self.weights.iter().map(at).collect()
    }

    /// Returns values at the nodes of the drawn mesh, given those at the nodes of the other.
    pub fn values(&self, of: &[f64]) -> Vec<f64> {
        let at = |(nodes, weights): &Carriers| {
            let parts = nodes.iter().zip(weights);
            parts.map(|(v, w)| *w * of[*v as usize]).sum()
        };
        self.weights.iter().map(at).collect()
    }
}

impl TetMesh {
    /// Returns this mesh, at rest, with boundaries of the regions of `field` (whole numbers in the tets)
    /// that do not follow its faces. The shares of the regions are those of `volume` where a label volume
    /// is known; then tets at boundaries are divided into eight first, and what the mesh leaves out of
    /// the volume at its own boundary is added. Otherwise they are the shares of the solid angle at the
    /// nodes, smoothed.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the divided mesh would have too many nodes.
    pub(crate) fn with_smooth_regions(
        &self,
        field: &Field,
        volume: Option<LabelShares>,
    ) -> Result<SmoothRegions> {
        let mut values: Vec<i64> = field.values.iter().map(|v| *v as i64).collect();
        let labels = values.clone();
        values.sort_unstable();
        values.dedup();
        let number = |label: &i64| values.binary_search(label).unwrap_or_default() as u32;
        let plain = TetMesh {
            order: ElementOrder::Linear,
            ..self.clone()
        };
        let own: Vec<u32> = labels.iter().map(number).collect();
        let mut drawn = Divided {
            weights: (0..self.nodes.len() as u32)
                .map(|v| ([v; 4], [1.0, 0.0, 0.0, 0.0]))
                .collect(),
            shares: tet_shares(&plain, &own),
            regions: own,
            mesh: plain,
            field: field.name.clone(),
        };
        match volume {
            Some(volume) => {
                // Also where the tets miss a layer that is thinner than they are.
                drawn.take_shares(&volume, &values);
                let mixed = drawn.mixed_tets();
                let many = 8 * mixed.iter().filter(|m| **m).count() + mixed.len() > MAX_TETS;
                if !many {
                    drawn.divide(&mixed, &values)?;
                }
                drawn.add_fringe(&volume, &values);
                drawn.take_shares(&volume, &values);
            }
            None => {
                (0..ROUNDS).for_each(|_| drawn.smooth());
                drawn.keep_volumes();
            }
        }
        drawn.keep_regions(values.len());
        drawn.split(&values);
        Ok(SmoothRegions {
            mesh: drawn.mesh,
            weights: drawn.weights,
        })
    }
}

/// A mesh in progress.
pub(super) struct Divided {
    pub mesh: TetMesh,
    /// Name of the field of the regions.
    field: String,
    pub weights: Vec<Carriers>,
    /// Region of each tet, by number.
    pub regions: Vec<u32>,
    pub shares: Vec<Shares>,
}

impl Divided {
    /// Returns which tets are in several regions.
    fn mixed_tets(&self) -> Vec<bool> {
        let mixed = |tet: &[u32; 4]| {
            let [a, ..] = tet.map(|v| largest(&self.shares[v as usize]));
            let far = |v: &u32| {
                let own = &self.shares[*v as usize];
                largest(own) != a || share_of(own, a) < CLEAR
            };
            tet.iter().any(far)
        };
        self.mesh.tets.iter().map(mixed).collect()
    }

    /// Divides the chosen tets into eight, and their neighbours as far as these must fit them.
    fn divide(&mut self, chosen: &[bool], values: &[i64]) -> Result<()> {
        let before = self.mesh.nodes.len();
        let finer = FinerSpace::locally(&self.mesh, chosen)?;
        let middles = finer.edges_of_middles();
        for [a, b] in &middles {
            let [from, to] = [a, b].map(|v| self.mesh.nodes[*v as usize]);
            let mixed = self.carry(&[(*a, 0.5), (*b, 0.5)], from.midpoint(to));
            self.weights.push(mixed);
            let both = [*a, *b].map(|v| self.shares[v as usize].clone());
            self.shares.push(blend((&both[0], &both[1]), 0.5));
        }
        debug_assert_eq!(before + middles.len(), finer.mesh.nodes.len());
        self.mesh = finer.mesh;
        let field = self.mesh.field(&self.field, Location::Cell);
        let labels = field.map(|f| f.values.clone()).unwrap_or_default();
        let number = |v: &f64| values.binary_search(&(*v as i64)).unwrap_or_default() as u32;
        self.regions = labels.iter().map(number).collect();
        Ok(())
    }

    /// Returns the mean length of the edges at each node.
    pub fn mean_edges(&self) -> Vec<f64> {
        let mut edges = vec![(0.0, 0usize); self.mesh.nodes.len()];
        for [a, b] in self.mesh.edges() {
            let length = self.mesh.nodes[a as usize].distance(self.mesh.nodes[b as usize]);
            for v in [a, b] {
                edges[v as usize].0 += length;
                edges[v as usize].1 += 1;
            }
        }
        let mean = |(sum, count): &(f64, usize)| sum / *count.max(&1) as f64;
        edges.iter().map(mean).collect()
    }

    /// Sets the shares at the nodes to those of a label volume, where it has labels of the mesh.
    fn take_shares(&mut self, volume: &LabelShares, values: &[i64]) {
        let edges = self.mean_edges();
        self.shares = parallel::map(self.mesh.nodes.len(), |v| {
            let own = &self.shares[v];
            let mut shares = Shares::new();
            for (label, share) in (volume.shares)(self.mesh.nodes[v], edges[v]) {
                if let Ok(region) = values.binary_search(&label) {
                    add(&mut shares, region as u32, share);
                }
            }
            normalise(&mut shares);
            if shares.is_empty() {
                own.clone()
            } else {
                shares
            }
        });
    }

    /// Adds to the shares of regions that lose much of their volume, so that thin layers do not vanish.
    fn keep_volumes(&mut self) {
        let count = 1 + self.regions.iter().copied().max().unwrap_or(0) as usize;
        let (mut wanted, mut of_nodes) = (vec![0.0; count], vec![0.0; self.mesh.nodes.len()]);
        for (t, region) in self.regions.iter().enumerate() {
            let volume = self.mesh.tet_volume(t).abs();
            wanted[*region as usize] += volume;
            self.mesh.tets[t]
                .iter()
                .for_each(|v| of_nodes[*v as usize] += 0.25 * volume);
        }
        for _ in 0..VOLUME_ROUNDS {
            let mut found = vec![0.0; count];
            for (shares, volume) in self.shares.iter().zip(&of_nodes) {
                if !shares.is_empty() {
                    found[largest(shares) as usize] += volume;
                }
            }
            let missing = |r: u32| {
                let [wanted, found] = [&wanted, &found].map(|v| v[r as usize]);
                if found < THIN * wanted {
                    VOLUME_STEP
                } else {
                    0.0
                }
            };
            for shares in &mut self.shares {
                shares.iter_mut().for_each(|s| s.1 += missing(s.0));
            }
        }
    }

    /// Gives each of the `count` regions at least the nodes that it has most of, so that none vanishes.
    fn keep_regions(&mut self, count: usize) {
        let mut found = vec![false; count];
        for shares in self.shares.iter().filter(|s| !s.is_empty()) {
            found[largest(shares) as usize] = true;
        }
        if found.iter().all(|found| *found) {
            return;
        }
        let of_tets = tet_shares(&self.mesh, &self.regions);
        for region in (0..count as u32).filter(|r| !found[*r as usize]) {
            let share = |shares: &Shares| share_of(shares, region);
            let most = of_tets.iter().map(share).fold(0.0, f64::max);
            for (own, of_tets) in self.shares.iter_mut().zip(&of_tets) {
                if most > 0.0 && share(of_tets) >= KEPT * most {
                    let lead = share_of(own, largest(own)) - share_of(own, region);
                    add(own, region, lead + 0.1);
                }
            }
        }
    }

    /// Moves the shares of each node towards the mean of its neighbours.
    fn smooth(&mut self) {
        let mut sums: Vec<(Shares, f64)> = vec![(Vec::new(), 0.0); self.shares.len()];
        for [a, b] in self.mesh.edges() {
            for (to, from) in [(a, b), (b, a)] {
                let (sum, count) = &mut sums[to as usize];
                self.shares[from as usize]
                    .iter()
                    .for_each(|s| add(sum, s.0, s.1));
                *count += 1.0;
            }
        }
        for (own, (sum, count)) in self.shares.iter_mut().zip(&mut sums) {
            if *count > 0.0 {
                sum.iter_mut().for_each(|s| s.1 /= *count);
                *own = blend((own, sum), NEIGHBOURS);
            }
        }
    }

    /// Divides the tets whose corners are in several regions along the boundaries between these.
    fn split(&mut self, values: &[i64]) {
        let nearest: Vec<u32> = self.shares.iter().map(largest).collect();
        let mut places: BTreeMap<[u32; 3], u32> = BTreeMap::new();
        let (mut tets, mut regions, mut parents) = (Vec::new(), Vec::new(), Vec::new());
        for (t, tet) in std::mem::take(&mut self.mesh.tets).into_iter().enumerate() {
            let corners = tet.map(|v| nearest[v as usize]);
            if corners.iter().all(|r| *r == corners[0]) {
                tets.push(tet);
                regions.push(corners[0]);
                parents.push(t);
                continue;
            }
            let (faces, points) = self.divided_faces(tet, &nearest, &mut places);
            let centre = self.centre(&points);
            for (face, region) in faces {
                tets.push([face[0], face[2], face[1], centre]);
                regions.push(region);
                parents.push(t);
            }
        }
        self.mesh.tets = tets;
        self.regions = regions;
        let of_nodes = &self.weights;
        for field in &mut self.mesh.fields {
            let n = field.components;
            if field.location == Location::Cell {
                let own = parents
                    .iter()
                    .flat_map(|t| field.values[n * t..n * (t + 1)].to_vec());
                field.values = own.collect();
                if field.name == self.field {
                    field.values = self
                        .regions
                        .iter()
                        .map(|r| values[*r as usize] as f64)
                        .collect();
                }
            } else {
                let first = field.values.clone();
                let known = first.len() / n.max(1);
                let of = |v: usize, k: usize| {
                    let (nodes, weights) = &of_nodes[v];
                    (0..4)
                        .map(|i| weights[i] * first[n * nodes[i] as usize + k])
                        .sum::<f64>()
                };
                let more = (known..of_nodes.len()).flat_map(|v| (0..n).map(move |k| (v, k)));
                field.values.extend(more.map(|(v, k)| of(v, k)));
            }
        }
    }

    /// Returns the triangles of the faces of a tet, seen from outside in the order of its corners, each
    /// with its region, and the points on its edges where two regions meet.
    fn divided_faces(
        &mut self,
        tet: [u32; 4],
        nearest: &[u32],
        places: &mut BTreeMap<[u32; 3], u32>,
    ) -> (Vec<([u32; 3], u32)>, Vec<u32>) {
        let mut points = Vec::new();
        for [i, j] in TET_EDGES {
            let (a, b) = (tet[i].min(tet[j]), tet[i].max(tet[j]));
            if nearest[a as usize] != nearest[b as usize] {
                points.push(self.crossing([a, b], nearest, places));
            }
        }
        let mut faces = Vec::new();
        for face in FACES.map(|f| f.map(|k| tet[k])) {
            let own = face.map(|v| nearest[v as usize]);
            let middles: Vec<Option<u32>> = (0..3)
                .map(|k| {
                    let [a, b] = [face[k], face[(k + 1) % 3]];
                    let edge = [a.min(b), a.max(b)];
                    (own[k] != own[(k + 1) % 3]).then(|| self.crossing(edge, nearest, places))
                })
                .collect();
            match middles[..] {
                [Some(p), Some(q), Some(r)] => {
                    // Three regions meet at the middle of the face.
                    let mut key = face;
                    key.sort_unstable();
                    let middle = match places.get(&key) {
                        Some(middle) => *middle,
                        None => {
                            let middle = self.centre(&[p, q, r]);
                            places.insert(key, middle);
                            middle
                        }
                    };
                    let around = [(face[0], p, r), (face[1], q, p), (face[2], r, q)];
                    for (k, (corner, after, before)) in around.into_iter().enumerate() {
                        faces.push(([corner, after, middle], own[k]));
                        faces.push(([corner, middle, before], own[k]));
                    }
                }
                _ => match (0..3).find(|k| middles[*k].is_some() && middles[(k + 2) % 3].is_some())
                {
                    Some(k) => {
                        // Corner k is alone in its region.
                        let (Some(p), Some(q)) = (middles[k], middles[(k + 2) % 3]) else {
                            continue;
                        };
                        let [a, b, c] = [face[k], face[(k + 1) % 3], face[(k + 2) % 3]];
                        faces.push(([a, p, q], own[k]));
                        let other = own[(k + 1) % 3];
                        // The same diagonal from both sides of the face.
                        if b < c {
                            faces.push(([p, b, q], other));
                            faces.push(([b, c, q], other));
                        } else {
                            faces.push(([p, b, c], other));
                            faces.push(([p, c, q], other));
                        }
                    }
                    None => faces.push((face, own[0])),
                },
            }
        }
        (faces, points)
    }

    /// Returns the point of an edge between two regions where their shares are equal.
    fn crossing(
        &mut self,
        [a, b]: [u32; 2],
        nearest: &[u32],
        places: &mut BTreeMap<[u32; 3], u32>,
    ) -> u32 {
        let key = [a, b, u32::MAX];
        if let Some(known) = places.get(&key) {
            return *known;
        }
        let [p, q] = [a, b].map(|v| nearest[v as usize]);
        let lead =
            |v: u32| share_of(&self.shares[v as usize], p) - share_of(&self.shares[v as usize], q);
        let (from, to) = (lead(a), lead(b));
        let at = if from - to > 0.0 {
            from / (from - to)
        } else {
            0.5
        };
        let at = at.clamp(NEAREST, 1.0 - NEAREST);
        let place = self.mesh.nodes[a as usize].lerp(self.mesh.nodes[b as usize], at);
        let mixed = self.carry(&[(a, 1.0 - at), (b, at)], place);
        let point = self.push(place, mixed);
        places.insert(key, point);
        point
    }

    /// Adds the mean of some nodes.
    fn centre(&mut self, points: &[u32]) -> u32 {
        let share = 1.0 / points.len() as f64;
        let all = points.iter().map(|v| self.mesh.nodes[*v as usize]);
        let place = share * all.sum::<DVec3>();
        let of: Vec<(u32, f64)> = points.iter().map(|v| (*v, share)).collect();
        let carried = self.carry(&of, place);
        self.push(place, carried)
    }

    /// Returns what carries the weighted mean of some nodes at a place: what carries these or, if that is
    /// more than one tet's nodes, the tet that carries one of them.
    fn carry(&self, of: &[(u32, f64)], place: DVec3) -> Carriers {
        let all: Vec<(&Carriers, f64)> = of
            .iter()
            .map(|(v, share)| (&self.weights[*v as usize], *share))
            .collect();
        if let Some(mixed) = mix_all(&all) {
            return mixed;
        }
        let is_tet = |nodes: &[u32; 4]| (0..4).all(|k| !nodes[..k].contains(&nodes[k]));
        let tet = all.iter().map(|(own, _)| own.0).find(is_tet);
        let nodes = tet.unwrap_or(all[0].0.0);
        (
            nodes,
            barycentric(nodes.map(|v| self.mesh.nodes[v as usize]), place),
        )
    }

    pub fn push(&mut self, place: DVec3, weights: Carriers) -> u32 {
        self.mesh.nodes.push(place);
        self.weights.push(weights);
        self.mesh.nodes.len() as u32 - 1
    }
}

/// Returns the weighted sum of nodes; `None` if more than four nodes carry them together.
pub(super) fn mix_all(of: &[(&Carriers, f64)]) -> Option<Carriers> {
    let mut found: Vec<(u32, f64)> = Vec::with_capacity(8);
    for ((nodes, weights), factor) in of {
        // Also those of weight 0, so that a node above the mesh keeps its tet.
        for (v, w) in nodes.iter().zip(weights) {
            match found.iter_mut().find(|own| own.0 == *v) {
                Some(own) => own.1 += factor * w,
                None => found.push((*v, factor * w)),
            }
        }
    }
    let first = found.first().map_or(0, |own| own.0);
    let at = |k: usize| found.get(k).copied().unwrap_or((first, 0.0));
    let carriers = ([0, 1, 2, 3].map(|k| at(k).0), [0, 1, 2, 3].map(|k| at(k).1));
    (found.len() <= 4).then_some(carriers)
}

/// Returns the barycentric coordinates of a point by a tet.
pub(super) fn barycentric(x: [DVec3; 4], p: DVec3) -> [f64; 4] {
    let all = signed_volume(x);
    [0, 1, 2, 3].map(|k| {
        let mut corners = x;
        corners[k] = p;
        signed_volume(corners) / all
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;
    use crate::mesh::{NO_NEIGHBOUR, Topology};

    /// A plane across a box, and the distance from it.
    fn distance(p: DVec3) -> f64 {
        (p - DVec3::new(0.52, 0.31, 0.27)).dot(DVec3::new(1.0, 0.35, -0.2).normalize())
    }

    /// A box of two regions, whose boundary follows the faces of its tets, near that plane.
    fn halves() -> (TetMesh, Field) {
        let mut mesh = generate::bar([8, 5, 5], DVec3::new(1.0, 0.6, 0.6)).unwrap();
        let centre = |t: usize| mesh.tet_nodes(t).iter().sum::<DVec3>() / 4.0;
        let label = |t: usize| if distance(centre(t)) > 0.0 { 7.0 } else { 3.0 };
        let labels = (0..mesh.tets.len()).map(label).collect();
        let field = Field::scalar("label", Location::Cell, labels);
        mesh.set_field(field.clone()).unwrap();
        (mesh, field)
    }

    /// Returns the largest distance from the plane of the corners of faces between the regions.
    fn roughness(mesh: &TetMesh) -> f64 {
        let labels = &mesh.field("label", Location::Cell).unwrap().values;
        let topology = Topology::new(mesh);
        let mut most = 0.0f64;
        for (t, across) in topology.neighbours.iter().enumerate() {
            for (face, other) in FACES.iter().zip(across) {
                if *other != NO_NEIGHBOUR && labels[*other as usize / 4] != labels[t] {
                    for k in face {
                        most = most.max(distance(mesh.nodes[mesh.tets[t][*k] as usize]).abs());
                    }
                }
            }
        }
        most
    }

    fn check(drawn: &SmoothRegions, of: &TetMesh) {
        let mesh = &drawn.mesh;
        assert!((0..mesh.tets.len()).all(|t| mesh.tet_volume(t) > 0.0));
        assert!((mesh.volume() / of.volume() - 1.0).abs() < 1e-9);
        // The same boundary, and no gap inside.
        let area = |mesh: &TetMesh| {
            let faces = Topology::new(mesh).boundary_triangles(mesh);
            let of = |f: &[u32; 3]| {
                let [a, b, c] = f.map(|v| mesh.nodes[v as usize]);
                0.5 * (b - a).cross(c - a).length()
            };
            faces.iter().map(of).sum::<f64>()
        };
        assert!((area(mesh) / area(of) - 1.0).abs() < 1e-9);
        for (p, (nodes, weights)) in mesh.nodes.iter().zip(&drawn.weights) {
            let carried: DVec3 = (0..4)
                .map(|k| weights[k] * of.nodes[nodes[k] as usize])
                .sum();
            assert!(carried.distance(*p) < 1e-12);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert_eq!(mesh.nodes.len(), drawn.weights.len());
    }

    #[test]
    fn boundaries_from_labels_of_tets_are_smoother_than_their_faces() {
        let (mesh, field) = halves();
        let drawn = mesh.with_smooth_regions(&field, None).unwrap();
        check(&drawn, &mesh);
        let [before, after] = [roughness(&mesh), roughness(&drawn.mesh)];
        assert!(before > 0.08, "{before}");
        assert!(after < 0.6 * before, "{before} {after}");
    }

    /// A label volume that is as large as the box.
    fn volume(shares: &(dyn Fn(DVec3, f64) -> Vec<(i64, f64)> + Sync)) -> LabelShares<'_> {
        LabelShares {
            shares,
            voxel: 0.02,
        }
    }

    fn is_in_box(p: DVec3) -> bool {
        let high = DVec3::new(1.0, 0.6, 0.6);
        p.cmpge(DVec3::splat(-1e-9)).all() && p.cmple(high + 1e-9).all()
    }

    #[test]
    fn boundaries_from_a_volume_follow_it() {
        let (mesh, field) = halves();
        let of_volume = |p: DVec3, edge: f64| {
            let share = (0.5 + 0.5 * distance(p) / edge).clamp(0.0, 1.0);
            match is_in_box(p) {
                true => vec![(3, 0.8 - 0.8 * share), (7, 0.8 * share), (99, 0.2)],
                false => vec![],
            }
        };
        let drawn = mesh
            .with_smooth_regions(&field, Some(volume(&of_volume)))
            .unwrap();
        check(&drawn, &mesh);
        let [before, after] = [roughness(&mesh), roughness(&drawn.mesh)];
        assert!(after < 0.25 * before, "{before} {after}");
        // A volume without labels of the mesh leaves the boundary where its nodes are.
        let nothing = |_: DVec3, _: f64| vec![(99, 1.0)];
        let unknown = mesh
            .with_smooth_regions(&field, Some(volume(&nothing)))
            .unwrap();
        check(&unknown, &mesh);
        assert!(roughness(&unknown.mesh) > 2.0 * after);
    }

    #[test]
    fn no_region_vanishes() {
        let (mut mesh, mut field) = halves();
        // A single tet.
        field.values.fill(3.0);
        field.values[170] = 7.0;
        mesh.set_field(field.clone()).unwrap();
        let nothing = |p: DVec3, _: f64| vec![(3i64, f64::from(u8::from(is_in_box(p))))];
        for of_volume in [None, Some(volume(&nothing))] {
            let drawn = mesh.with_smooth_regions(&field, of_volume).unwrap();
            check(&drawn, &mesh);
            let labels = &drawn.mesh.field("label", Location::Cell).unwrap().values;
            assert!(labels.contains(&7.0) && labels.contains(&3.0));
        }
    }

    #[test]
    fn thin_layers_keep_their_volume() {
        let (mut mesh, mut field) = halves();
        let layer = |t: usize| mesh.tet_nodes(t).iter().map(|p| p.x).sum::<f64>() / 4.0;
        field.values = (0..mesh.tets.len())
            .map(|t| {
                if (0.5..0.625).contains(&layer(t)) {
                    7.0
                } else {
                    3.0
                }
            })
            .collect();
        mesh.set_field(field.clone()).unwrap();
        let volume = |mesh: &TetMesh| -> f64 {
            let labels = &mesh.field("label", Location::Cell).unwrap().values;
            (0..mesh.tets.len())
                .filter(|t| labels[*t] == 7.0)
                .map(|t| mesh.tet_volume(t))
                .sum()
        };
        let drawn = mesh.with_smooth_regions(&field, None).unwrap();
        check(&drawn, &mesh);
        let ratio = volume(&drawn.mesh) / volume(&mesh);
        assert!((0.6..1.6).contains(&ratio), "{ratio}");
    }
}
