//! Selection of the faces that a blade opens.

use crate::mesh::{Blade, BoundaryFace, NO_NEIGHBOUR, TetMesh, Topology};
use crate::parallel;
use glam::DVec3;
use std::collections::HashMap;

/// Returns the faces whose two tets have their centroids on different sides of the blade, sorted.
/// `corners` returns the nodes that count as those of a tet.
pub(super) fn faces_crossing_blade(
    mesh: &TetMesh,
    topology: &Topology,
    positions: &[DVec3],
    (blade, corners): (&Blade, &(impl Fn(usize) -> [u32; 4] + Sync)),
) -> Vec<[BoundaryFace; 2]> {
    let (low, high) = blade.bounds();
    // Bit mask of the six planes of the bounding box of the blade that a node lies beyond, and, for
    // a tet, of those that all its nodes lie beyond: two tets with a common bit are not separated.
    let node_beyond = parallel::map(positions.len(), |v| {
        let p = positions[v];
        (p.cmplt(low).bitmask() | p.cmpgt(high).bitmask() << 3) as u8
    });
    let beyond = parallel::map(mesh.tets.len(), |t| {
        let nodes = corners(t).into_iter();
        nodes.fold(0xff, |all, v| all & node_beyond[v as usize])
    });
    let centroid = |t: usize| {
        let corners = corners(t).map(|v| positions[v as usize]);
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
            .separates(centroid(t), centroid(other))
            .then_some([here, there])
    };
    parallel::collect(mesh.tets.len(), |range, faces| {
        for t in range {
            faces.extend((0..4).filter_map(|face| across(t, face)));
        }
    })
}

/// Drops the faces around tets that would be cut off individually: such a tet stays with its
/// neighbours wherever its centroid lies. Of two adjacent ones, both stay.
pub(super) fn skip_isolated_tets(topology: &Topology, faces: &mut Vec<[BoundaryFace; 2]>) {
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
