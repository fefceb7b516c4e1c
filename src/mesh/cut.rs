//! Cutting a mesh open: the faces nearest to a blade lose their link, and nodes are doubled where
//! that leaves their tets in several fans. Tets stay whole, and none is lost.

use super::{Blade, BoundaryFace, FACES, Groups, Location, NO_NEIGHBOUR, TET_EDGES};
use super::{TetMesh, Topology};
use crate::{Error, Result};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// What a cut, or the removal of tets, changed in a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetCut {
    /// Faces opened, each as its two tets see it. Both are boundary now. Of a removal: the faces
    /// laid bare, the second of each that of a tet now gone, both numbered as they were before.
    pub opened: Vec<[BoundaryFace; 2]>,
    /// Each new node, and the node it is a double of. New nodes come last, in this order.
    pub doubled: Vec<[u32; 2]>,
    /// Tets whose nodes or neighbours have changed, ascending.
    pub tets: Vec<u32>,
    /// Nodes that were doubled, and their doubles, ascending.
    pub nodes: Vec<u32>,
    /// The tets at these nodes, ascending.
    pub star: Vec<u32>,
    /// The edges at these nodes before the cut, sorted.
    pub edges_before: Vec<[u32; 2]>,
    /// The edges at these nodes now, each with every tet around it, sorted.
    pub around: Vec<([u32; 2], u32)>,
    /// Tets that were removed, ascending, by their numbers before; those that stay keep their
    /// order. After a removal `tets`, `star` and edges are not listed.
    pub removed: Vec<u32>,
}

impl TetCut {
    /// Whether nothing was hit, and nothing has changed.
    pub fn is_empty(&self) -> bool {
        self.opened.is_empty() && self.removed.is_empty()
    }
}

/// Cuts `mesh`, whose nodes stand at `positions` now, along `blade`: opens every face whose two
/// tets have their centroids on different sides of it, and doubles the nodes around which that
/// parts the tets. A blade right through a body so leaves it in two pieces; where a cut ends
/// within, its two sides stay joined at the nodes of its tip.
///
/// A face none of whose nodes is doubled cannot gape and stays closed, and no tet is cut off all
/// alone unless its neighbour is. Two sweeps in a row open
/// what one along both would. Fields at nodes are copied to the doubles. Nodes at which fans only
/// touch, before the cut, stay as they are. Nothing is changed on an error.
///
/// # Errors
/// [`Error::Input`] when `topology` or `positions` are not those of `mesh`; [`Error::Mesh`] when
/// there would be more nodes than can be indexed.
pub fn cut(
    mesh: &mut TetMesh,
    topology: &mut Topology,
    positions: &[DVec3],
    blade: &Blade,
) -> Result<TetCut> {
    check(mesh, topology)?;
    if positions.len() != mesh.nodes.len() {
        return Err(Error::Input(format!(
            "{} positions given for the {} nodes of the mesh that is to be cut",
            positions.len(),
            mesh.nodes.len()
        )));
    }
    let mut faces = faces_across(mesh, topology, positions, blade);
    keep_chips(topology, &mut faces);
    for [a, b] in &faces {
        topology.neighbours[a.tet as usize][a.face as usize] = NO_NEIGHBOUR;
        topology.neighbours[b.tet as usize][b.face as usize] = NO_NEIGHBOUR;
    }
    let parted = part_nodes(mesh, topology, &faces, &[]);
    let (opened, closed): (Vec<_>, Vec<_>) = faces
        .into_iter()
        .partition(|[a, b]| sorted_face(mesh, *a) != sorted_face(mesh, *b));
    for [a, b] in closed {
        topology.neighbours[a.tet as usize][a.face as usize] = 4 * b.tet + b.face;
        topology.neighbours[b.tet as usize][b.face as usize] = 4 * a.tet + a.face;
    }
    let mut bare: Vec<BoundaryFace> = opened.iter().flatten().copied().collect();
    bare.sort_unstable();
    splice(&mut topology.boundary, |f| *f, &[], &bare);
    let mut tets: Vec<u32> = bare.iter().map(|f| f.tet).collect();
    let renamed = parted.star.iter().zip(&parted.before);
    tets.extend(
        renamed
            .filter(|(t, before)| mesh.tets[**t as usize] != **before)
            .map(|(t, _)| *t),
    );
    tets.sort_unstable();
    tets.dedup();
    let mut touched = vec![false; mesh.nodes.len()];
    for v in parted.doubled.iter().flatten() {
        touched[*v as usize] = true;
    }
    let around = edges_around(mesh, &parted.star, &touched);
    let mut edges: Vec<[u32; 2]> = around.iter().map(|(edge, _)| *edge).collect();
    edges.dedup();
    let edges_before = edges_as_they_were(&edges, &parted.doubled);
    splice(&mut topology.edges, |e| *e, &edges_before, &edges);
    let at_touched = |t: &u32| mesh.tets[*t as usize].iter().any(|v| touched[*v as usize]);
    let star = parted.star.into_iter().filter(at_touched).collect();
    Ok(TetCut {
        nodes: both(&parted.doubled),
        star,
        opened,
        doubled: parted.doubled,
        tets,
        edges_before,
        around,
        removed: Vec::new(),
    })
}

/// Takes `tets` out of `mesh`. Nodes around which that leaves several fans of tets are doubled,
/// so that what hangs together at a node only falls apart; nodes that no tet uses any more stay
/// in the list. The tets that are left keep their order, and so do fields in tets.
///
/// Takes time in proportion to the mesh, unlike [`cut`].
///
/// # Errors
/// [`Error::Input`] for tets that do not exist, for a `topology` that is not that of `mesh`, and
/// when no tet would be left.
pub fn remove(mesh: &mut TetMesh, topology: &mut Topology, tets: &[u32]) -> Result<TetCut> {
    check(mesh, topology)?;
    let count = mesh.tets.len();
    if let Some(bad) = tets.iter().find(|t| **t as usize >= count) {
        return Err(Error::Input(format!(
            "tet {bad} cannot be removed: there are {count} tets, counted from 0"
        )));
    }
    let mut gone = vec![false; count];
    tets.iter().for_each(|t| gone[*t as usize] = true);
    let removed: Vec<u32> = (0..count as u32).filter(|t| gone[*t as usize]).collect();
    if removed.is_empty() {
        return Ok(TetCut::default());
    }
    if removed.len() == count {
        return Err(Error::Input(format!(
            "all {count} tets would be removed; leave at least one"
        )));
    }
    let mut opened = Vec::new();
    for t in &removed {
        for face in 0..4 {
            let code = topology.neighbours[*t as usize][face];
            if code != NO_NEIGHBOUR && !gone[code as usize / 4] {
                topology.neighbours[*t as usize][face] = NO_NEIGHBOUR;
                topology.neighbours[code as usize / 4][code as usize % 4] = NO_NEIGHBOUR;
                let there = BoundaryFace {
                    tet: code / 4,
                    face: code % 4,
                };
                let here = BoundaryFace {
                    tet: *t,
                    face: face as u32,
                };
                opened.push([there, here]);
            }
        }
    }
    let parted = part_nodes(mesh, topology, &opened, &gone);
    let mut keep = gone.iter().map(|gone| !gone);
    mesh.tets.retain(|_| keep.next().unwrap_or(true));
    for field in &mut mesh.fields {
        if field.location == Location::Cell {
            let tuples = field.values.chunks_exact(field.components);
            let kept = tuples.zip(&gone).filter(|(_, gone)| !**gone);
            field.values = kept.flat_map(|(tuple, _)| tuple.to_vec()).collect();
        }
    }
    *topology = Topology::new(mesh);
    Ok(TetCut {
        opened,
        nodes: both(&parted.doubled),
        doubled: parted.doubled,
        removed,
        ..TetCut::default()
    })
}

/// The nodes that were doubled and their doubles, ascending.
fn both(doubled: &[[u32; 2]]) -> Vec<u32> {
    let mut nodes: Vec<u32> = doubled.iter().flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

fn check(mesh: &TetMesh, topology: &Topology) -> Result<()> {
    if topology.neighbours.len() != mesh.tets.len() {
        return Err(Error::Input(format!(
            "the topology has {} tets, the mesh {}; give the mesh's own",
            topology.neighbours.len(),
            mesh.tets.len()
        )));
    }
    // As many again may be needed.
    if mesh.nodes.len() + 4 * mesh.tets.len() > u32::MAX as usize {
        return Err(Error::Mesh(
            "there are too many tets to double nodes within 32-bit indices; use a coarser mesh"
                .into(),
        ));
    }
    Ok(())
}

/// The faces whose two tets have their centroids on different sides of the blade, sorted.
fn faces_across(
    mesh: &TetMesh,
    topology: &Topology,
    positions: &[DVec3],
    blade: &Blade,
) -> Vec<[BoundaryFace; 2]> {
    let (low, high) = blade.bounds();
    // Which of the six planes of the blade's box a node lies beyond, and which all nodes of a tet
    // do: two tets that share one are not parted by the blade.
    let node_beyond: Vec<u8> = positions
        .par_iter()
        .map(|p| (p.cmplt(low).bitmask() | p.cmpgt(high).bitmask() << 3) as u8)
        .collect();
    let beyond: Vec<u8> = mesh
        .tets
        .par_iter()
        .map(|tet| {
            tet.iter()
                .fold(0xff, |all, v| all & node_beyond[*v as usize])
        })
        .collect();
    let centroid = |t: usize| {
        let corners = mesh.tets[t].map(|v| positions[v as usize]);
        corners.iter().sum::<DVec3>() / 4.0
    };
    let across = |t: usize, face: usize| {
        let code = topology.neighbours[t][face];
        let other = code as usize / 4;
        if code == NO_NEIGHBOUR || other <= t || beyond[t] & beyond[other] != 0 {
            return None;
        }
        let [here, there] =
            [(t, face), (other, code as usize % 4)].map(|(tet, face)| BoundaryFace {
                tet: tet as u32,
                face: face as u32,
            });
        blade
            .parts(centroid(t), centroid(other))
            .then_some([here, there])
    };
    (0..mesh.tets.len())
        .into_par_iter()
        .flat_map_iter(|t| (0..4).filter_map(move |face| across(t, face)))
        .collect()
}

/// Leaves out the faces around tets that would be cut off on their own: such a tet goes with its
/// neighbours, wherever its centroid lies. Of two that would be alone, both are.
fn keep_chips(topology: &Topology, faces: &mut Vec<[BoundaryFace; 2]>) {
    let mut links: HashMap<u32, usize> = HashMap::new();
    for face in faces.iter().flatten() {
        let linked = || {
            let across = topology.neighbours[face.tet as usize];
            across.iter().filter(|code| **code != NO_NEIGHBOUR).count()
        };
        *links.entry(face.tet).or_insert_with(linked) -= 1;
    }
    let alone = |face: &BoundaryFace| links.get(&face.tet) == Some(&0);
    faces.retain(|[a, b]| alone(a) == alone(b));
}

/// Nodes doubled, and the tets around the faces that were opened.
struct Parted {
    doubled: Vec<[u32; 2]>,
    star: Vec<u32>,
    /// Nodes of the tets of `star` as they were.
    before: Vec<[u32; 4]>,
}

/// Doubles every node around which the faces `opened`, which have lost their links, part a fan of
/// tets into several: the fan with the smallest tet keeps the node. Tets that are `gone` do not
/// count.
fn part_nodes(
    mesh: &mut TetMesh,
    topology: &Topology,
    opened: &[[BoundaryFace; 2]],
    gone: &[bool],
) -> Parted {
    let mut marked = vec![false; mesh.nodes.len()];
    for [face, _] in opened {
        for v in face_nodes(mesh, *face) {
            marked[v as usize] = true;
        }
    }
    let star: Vec<u32> = mesh
        .tets
        .par_iter()
        .enumerate()
        .filter(|(_, tet)| tet.iter().any(|v| marked[*v as usize]))
        .map(|(t, _)| t as u32)
        .collect();
    let before: Vec<[u32; 4]> = star.iter().map(|t| mesh.tets[*t as usize]).collect();
    // One more than the place in the star of each tet, 0 of those elsewhere.
    let mut place = vec![0u32; mesh.tets.len()];
    for (t, s) in star.iter().zip(1..) {
        place[*t as usize] = s;
    }
    // Corner i of the s-th tet of the star is item 4 s + i.
    let join = |groups: &mut Groups, here: BoundaryFace, other: u32| {
        let (s, o) = (place[here.tet as usize], place[other as usize]);
        if s == 0 || o == 0 {
            return;
        }
        for v in face_nodes(mesh, here) {
            let corner = |s: u32| {
                let i = before[s as usize].iter().position(|w| *w == v);
                i.map(|i| 4 * s + i as u32)
            };
            if let (true, Some(a), Some(b)) = (marked[v as usize], corner(s - 1), corner(o - 1)) {
                groups.join(a, b);
            }
        }
    };
    let mut after = Groups::new(4 * star.len());
    let mut whole = Groups::new(4 * star.len());
    for tet in &star {
        for (face, code) in (0..).zip(topology.neighbours[*tet as usize]) {
            if code != NO_NEIGHBOUR && code / 4 > *tet {
                let here = BoundaryFace { tet: *tet, face };
                join(&mut after, here, code / 4);
                join(&mut whole, here, code / 4);
            }
        }
    }
    for [here, there] in opened {
        join(&mut whole, *here, there.tet);
    }
    let mut fans: Vec<[u32; 3]> = Vec::new();
    for (s, tet) in before.iter().enumerate() {
        if gone.get(star[s] as usize) == Some(&true) {
            continue;
        }
        for (i, v) in tet.iter().enumerate().filter(|(_, v)| marked[**v as usize]) {
            let corner = (4 * s + i) as u32;
            fans.push([
                *v,
                whole.representative(corner),
                after.representative(corner),
            ]);
        }
    }
    let corners = fans.clone();
    fans.sort_unstable();
    fans.dedup();
    let mut doubled = Vec::new();
    let mut name: HashMap<u32, u32> = HashMap::new();
    for same in fans.chunk_by(|a, b| a[..2] == b[..2]) {
        for [old, _, fan] in &same[1..] {
            let new = (mesh.nodes.len() + doubled.len()) as u32;
            name.insert(*fan, new);
            doubled.push([new, *old]);
        }
    }
    let mut fan_of = corners.iter();
    for (s, tet) in before.iter().enumerate() {
        if gone.get(star[s] as usize) == Some(&true) {
            continue;
        }
        for (i, _) in tet.iter().enumerate().filter(|(_, v)| marked[**v as usize]) {
            if let Some(new) = fan_of.next().and_then(|[_, _, fan]| name.get(fan)) {
                mesh.tets[star[s] as usize][i] = *new;
            }
        }
    }
    for [_, old] in &doubled {
        mesh.nodes.push(mesh.nodes[*old as usize]);
        for field in &mut mesh.fields {
            if field.location == Location::Node {
                let at = *old as usize * field.components;
                field.values.extend_from_within(at..at + field.components);
            }
        }
    }
    Parted {
        doubled,
        star,
        before,
    }
}

fn face_nodes(mesh: &TetMesh, face: BoundaryFace) -> [u32; 3] {
    FACES[face.face as usize].map(|i| mesh.tets[face.tet as usize][i])
}

fn sorted_face(mesh: &TetMesh, face: BoundaryFace) -> [u32; 3] {
    let mut nodes = face_nodes(mesh, face);
    nodes.sort_unstable();
    nodes
}

/// The edges of `tets` that have a node among those `touched`, each with its tets, sorted.
fn edges_around(mesh: &TetMesh, tets: &[u32], touched: &[bool]) -> Vec<([u32; 2], u32)> {
    // As one number each, which sort faster than pairs do.
    let mut packed = Vec::with_capacity(6 * tets.len());
    for t in tets {
        let tet = mesh.tets[*t as usize];
        for [a, b] in TET_EDGES.map(|edge| edge.map(|i| tet[i])) {
            if touched[a as usize] || touched[b as usize] {
                let (low, high) = (u128::from(a.min(b)), u128::from(a.max(b)));
                packed.push(low << 64 | high << 32 | u128::from(*t));
            }
        }
    }
    packed.sort_unstable();
    let unpack = |p: u128| ([(p >> 64) as u32, (p >> 32) as u32], p as u32);
    packed.into_iter().map(unpack).collect()
}

/// What the sorted `edges` were before nodes were doubled, sorted.
fn edges_as_they_were(edges: &[[u32; 2]], doubled: &[[u32; 2]]) -> Vec<[u32; 2]> {
    let first = doubled.first().map_or(u32::MAX, |[new, _]| *new);
    let old = |v: u32| match v.checked_sub(first) {
        Some(k) => doubled[k as usize][1],
        None => v,
    };
    let mut edges: Vec<[u32; 2]> = edges
        .iter()
        .map(|edge| edge.map(old))
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// Takes the items with the keys `gone` out of `list` and puts `added` in; all are sorted by key.
/// What lies between is moved, not looked at.
pub(crate) fn splice<T: Copy, K: Ord + Copy>(
    list: &mut Vec<T>,
    key: impl Fn(&T) -> K,
    gone: &[K],
    added: &[T],
) {
    let position = |list: &[T], from: usize, wanted: K| {
        from + list[from..].partition_point(|item| key(item) < wanted)
    };
    let (mut from, mut to) = (0, 0);
    for wanted in gone {
        let at = position(list, from, *wanted);
        if from != to {
            list.copy_within(from..at, to);
        }
        to += at - from;
        let found = list.get(at).is_some_and(|item| key(item) == *wanted);
        from = at + usize::from(found);
    }
    list.copy_within(from.., to);
    list.truncate(to + list.len() - from);
    // From the end on, each added item moves what follows it to its final place.
    let mut end = list.len();
    list.extend_from_slice(added);
    for (k, item) in added.iter().enumerate().rev() {
        let at = list[..end].partition_point(|other| key(other) < key(item));
        list.copy_within(at..end, at + k + 1);
        list[at + k] = *item;
        end = at;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splicing_keeps_a_list_sorted() {
        let mut list = vec![1, 3, 5, 7, 9];
        splice(&mut list, |x| *x, &[3, 4, 9], &[0, 3, 6, 11]);
        assert_eq!(list, [0, 1, 3, 5, 6, 7, 11]);
        splice(&mut list, |x| *x, &[0, 11], &[]);
        assert_eq!(list, [1, 3, 5, 6, 7]);
        splice(&mut list, |x| *x, &[], &[]);
        assert_eq!(list, [1, 3, 5, 6, 7]);
    }
}
