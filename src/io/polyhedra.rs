//! Splits polyhedra into tets.
//!
//! Faces are fanned by the rule of the other cells (see [`super::raw_mesh`]), so the tets conform
//! across shared faces. The tets join the faces to the node of smallest number, or, where that
//! gives flat or inverted tets, to a new node inside.

use crate::mesh::signed_volume;
use glam::DVec3;
use std::collections::BTreeMap;

/// Smallest volume of a tet, as a share of its polyhedron's.
const MIN_TET_VOLUME_RATIO: f64 = 1e-9;

/// The tets of a polyhedron.
pub(super) struct Split {
    /// A new node has the number of nodes of the mesh.
    pub tets: Vec<[u32; 4]>,
    /// The position of the new node, if there is one.
    pub centre: Option<DVec3>,
}

/// Splits the polyhedron of faces with the nodes `corners`, of which each has its number of `sizes`.
/// Faces may have any orientation. `None` if the faces do not enclose a volume, or if no point was
/// found that sees all of them.
pub(super) fn split(corners: &[u32], sizes: &[u32], nodes: &[DVec3]) -> Option<Split> {
    let mut faces = rings(corners, sizes);
    orient(&mut faces)?;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for face in &faces {
        triangulate(face, nodes, &mut triangles);
    }
    let apex = triangles.iter().flatten().copied().min()?;
    let at = |v: u32| nodes[v as usize];
    let volume = |t: &[u32; 3], top: DVec3| signed_volume([at(t[0]), at(t[2]), at(t[1]), top]);
    let total: f64 = triangles.iter().map(|t| volume(t, at(apex))).sum();
    if total < 0.0 {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    let least = MIN_TET_VOLUME_RATIO * total.abs();
    if least.is_nan() || least <= 0.0 {
        return None;
    }
    let joined = |apex: u32, triangles: &[[u32; 3]]| {
        let tets = triangles.iter().map(|t| [t[0], t[2], t[1], apex]);
        tets.collect::<Vec<_>>()
    };
    let away: Vec<[u32; 3]> = triangles
        .iter()
        .filter(|t| !t.contains(&apex))
        .copied()
        .collect();
    if away.iter().all(|t| volume(t, at(apex)) > least) {
        return Some(Split {
            tets: joined(apex, &away),
            centre: None,
        });
    }
    let number = u32::try_from(nodes.len()).ok()?;
    let sees_all = |centre: &DVec3| triangles.iter().all(|t| volume(t, *centre) > least);
    let mean = centre(&triangles, nodes);
    let centre = Some(mean)
        .filter(sees_all)
        .or_else(|| Some(deepest_point(&triangles, nodes, mean)).filter(sees_all))?;
    Some(Split {
        tets: joined(number, &triangles),
        centre: Some(centre),
    })
}

/// Returns the faces without repeated nodes and without collapsed faces.
fn rings(corners: &[u32], sizes: &[u32]) -> Vec<Vec<u32>> {
    let mut start = 0;
    let faces = sizes.iter().map(|size| {
        let end = (start + *size as usize).min(corners.len());
        let mut ring = corners[start..end].to_vec();
        start = end;
        ring.dedup();
        while ring.len() > 1 && ring.first() == ring.last() {
            ring.pop();
        }
        ring
    });
    faces.filter(|ring| ring.len() > 2).collect()
}

/// Turns the faces so that adjacent ones have the same orientation. `None` unless they are one
/// closed surface.
fn orient(faces: &mut [Vec<u32>]) -> Option<()> {
    // The faces at each edge, and whether they go along it upwards.
    let mut edges: BTreeMap<(u32, u32), Vec<(usize, bool)>> = BTreeMap::new();
    for (f, face) in faces.iter().enumerate() {
        for (i, a) in face.iter().enumerate() {
            let b = face[(i + 1) % face.len()];
            edges
                .entry((*a.min(&b), *a.max(&b)))
                .or_default()
                .push((f, *a < b));
        }
    }
    let mut neighbours: Vec<Vec<(usize, bool)>> = vec![Vec::new(); faces.len()];
    for at in edges.values() {
        let [(f, up), (g, other)] = at[..] else {
            return None;
        };
        let alike = up != other;
        neighbours[f].push((g, alike));
        neighbours[g].push((f, alike));
    }
    let mut flipped: Vec<Option<bool>> = vec![None; faces.len()];
    *flipped.first_mut()? = Some(false);
    let mut open = vec![0];
    while let Some(f) = open.pop() {
        let own = flipped[f]?;
        for (g, alike) in &neighbours[f] {
            let wanted = own == *alike;
            match flipped[*g] {
                Some(known) if known != wanted => return None,
                Some(_) => {}
                None => {
                    flipped[*g] = Some(wanted);
                    open.push(*g);
                }
            }
        }
    }
    for (face, flip) in faces.iter_mut().zip(flipped) {
        if flip? {
            face.reverse();
        }
    }
    Some(())
}

/// Adds the triangles of a face, in its orientation: a fan from its node of smallest number, or,
/// if the face is concave, from the first node by number that sees all of it.
fn triangulate(face: &[u32], nodes: &[DVec3], triangles: &mut Vec<[u32; 3]>) {
    // The same order of nodes for both cells of a face makes their sums, thus their fans, the same.
    let n = face.len();
    let smallest = (0..n).min_by_key(|i| face[*i]).unwrap_or(0);
    let backwards = face[(smallest + n - 1) % n] < face[(smallest + 1) % n];
    let turned = |i: usize| match backwards {
        false => face[(smallest + i) % n],
        true => face[(smallest + n - i) % n],
    };
    let ring: Vec<u32> = (0..n).map(turned).collect();
    let at = |i: usize| nodes[ring[i % n] as usize] - nodes[ring[0] as usize];
    let area: DVec3 = (0..n).map(|i| at(i).cross(at(i + 1))).sum();
    let fans = |apex: &usize| {
        (1..n - 1).all(|i| {
            let [p, q, r] = [at(*apex), at(apex + i), at(apex + i + 1)];
            (q - p).cross(r - p).dot(area) > 0.0
        })
    };
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|i| ring[*i]);
    let apex = order.into_iter().find(fans).unwrap_or(0);
    for i in 1..n - 1 {
        let [a, b, c] = [apex, apex + i, apex + i + 1].map(|i| ring[i % n]);
        triangles.push(if backwards { [a, c, b] } else { [a, b, c] });
    }
}

/// Returns the mean of the nodes.
fn centre(triangles: &[[u32; 3]], nodes: &[DVec3]) -> DVec3 {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let sum: DVec3 = used.iter().map(|v| nodes[*v as usize]).sum();
    sum / used.len() as f64
}

/// Returns the point deepest behind the planes of all triangles, approximately: from `start`, by
/// steps of decreasing length away from the nearest plane.
fn deepest_point(triangles: &[[u32; 3]], nodes: &[DVec3], start: DVec3) -> DVec3 {
    const STEPS: u32 = 300;
    let planes: Vec<(DVec3, DVec3)> = triangles
        .iter()
        .map(|t| t.map(|v| nodes[v as usize]))
        .map(|[a, b, c]| (a, (b - a).cross(c - a).normalize_or_zero()))
        .filter(|(_, normal)| *normal != DVec3::ZERO)
        .collect();
    let size = planes
        .iter()
        .map(|(a, _)| a.distance(start))
        .fold(0.0, f64::max);
    let (mut point, mut best) = (start, (f64::NEG_INFINITY, start));
    for step in 0..STEPS {
        let depths = planes.iter().map(|(a, n)| (n.dot(*a - point), *n));
        let nearest = depths.min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((depth, normal)) = nearest else {
            break;
        };
        if depth > best.0 {
            best = (depth, point);
        }
        point -= normal * size * 0.2 / f64::from(step + 1).powf(0.7);
    }
    best.1
}
