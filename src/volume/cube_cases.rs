//! The triangles of marching cubes in each of the 256 cases, made by rule.

use std::sync::LazyLock;

/// For each set of inside corners (bit n for corner n) the triangles, each corner an [`edge`] of
/// the cube. Corner n lies at (n & 1, n >> 1 & 1, n >> 2).
///
/// On a face, each run of inside corners is cut off by one segment, which depends on nothing but
/// the four corners, so that the cubes on both sides agree: diagonal corners are apart. The
/// segments of the six faces join to loops, each of which is divided into triangles by diagonals
/// that lie in no face, so that no other cube can have the same diagonal. Hence every edge of the
/// surface belongs to exactly two triangles, and the triangles at a vertex form a single fan.
pub(super) static CUBE_CASES: LazyLock<Vec<Vec<[u8; 3]>>> =
    LazyLock::new(|| (0..=255).map(|inside| triangles(&loops(inside))).collect());

/// There are 12, but [`edge`] numbers them up to this.
const EDGES: usize = 24;

/// The edge between neighbouring corners `a` and `b`: 8 · axis + lower corner.
fn edge(a: u8, b: u8) -> u8 {
    8 * (a ^ b).trailing_zeros() as u8 + (a & b)
}

/// The corners of each face, anticlockwise seen from outside the cube.
fn faces() -> impl Iterator<Item = [u8; 4]> {
    (0..6).map(|face| {
        let axis = face / 2;
        let [a, u, v] = [axis, (axis + 1) % 3, (axis + 2) % 3].map(|axis| 1u8 << axis);
        match face % 2 {
            0 => [0, v, u | v, u],
            _ => [a, a | u, a | u | v, a | v],
        }
    })
}

/// The loops of crossed edges, anticlockwise seen from where the surface faces.
fn loops(inside: u8) -> Vec<Vec<u8>> {
    let is_inside = |corner: u8| inside >> corner & 1 == 1;
    let mut next = [None; EDGES];
    for corners in faces() {
        let at = |i: usize| corners[i % 4];
        for first in (0..4).filter(|i| is_inside(at(*i)) && !is_inside(at(i + 3))) {
            let run = (0..4).take_while(|n| is_inside(at(first + n))).count();
            let leaves = edge(at(first + run - 1), at(first + run));
            next[edge(at(first + 3), at(first)) as usize] = Some(leaves);
        }
    }
    let mut loops = Vec::new();
    for start in 0..EDGES {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(after) = next[at].take() {
            ring.push(at as u8);
            at = after as usize;
        }
        if !ring.is_empty() {
            loops.push(ring);
        }
    }
    loops
}

fn triangles(loops: &[Vec<u8>]) -> Vec<[u8; 3]> {
    let divided = loops.iter().filter_map(|ring| divide(ring));
    divided.flat_map(|(_, triangles)| triangles).collect()
}

/// The triangles of a ring with the shortest diagonals none of which lies in a face, and the sum
/// of the diagonals' squared lengths; `None` if there is no way.
fn divide(ring: &[u8]) -> Option<(u32, Vec<[u8; 3]>)> {
    let [first, .., last] = *ring else {
        return None;
    };
    let end = ring.len() - 1;
    // What a side of the triangle costs: nothing where it is one of the ring's.
    let side = |from: usize, to: usize| match to - from {
        1 => Some((0, Vec::new())),
        _ if share_a_face(ring[from], ring[to]) => None,
        _ => divide(&ring[from..=to]).map(|(cost, t)| (cost + apart(ring[from], ring[to]), t)),
    };
    (1..end)
        .filter_map(|apex| {
            let (left, mut triangles) = side(0, apex)?;
            let (right, others) = side(apex, end)?;
            triangles.push([first, ring[apex], last]);
            triangles.extend(others);
            Some((left + right, triangles))
        })
        .min_by_key(|(cost, _)| *cost)
}

/// Twice the coordinates of the middle of edge `e`.
fn middle(e: u8) -> [i8; 3] {
    let (along, corner) = (e / 8, e % 8);
    [0, 1, 2].map(|axis| match axis == along {
        true => 1,
        false => 2 * (corner >> axis & 1) as i8,
    })
}

fn share_a_face(a: u8, b: u8) -> bool {
    let pairs = middle(a).into_iter().zip(middle(b));
    pairs.into_iter().any(|(a, b)| a == b && a != 1)
}

/// The squared distance between the middles of two edges, times 4.
fn apart(a: u8, b: u8) -> u32 {
    let pairs = middle(a).into_iter().zip(middle(b));
    pairs.map(|(a, b)| u32::from(a.abs_diff(b)).pow(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_is_divided_with_all_its_crossings_and_no_diagonal_in_a_face() {
        let crossed = |inside: u8| {
            (0..EDGES as u8)
                .filter(|e| e & (1 << (e / 8)) == 0)
                .map(|e| (e % 8, (e % 8) | (1 << (e / 8))))
                .filter(|(a, b)| (inside >> a & 1) != (inside >> b & 1))
                .count()
        };
        for inside in 0..=255u8 {
            let loops = loops(inside);
            assert_eq!(loops.iter().map(Vec::len).sum::<usize>(), crossed(inside));
            let wanted: usize = loops.iter().map(|ring| ring.len() - 2).sum();
            let triangles = &CUBE_CASES[inside as usize];
            assert_eq!(triangles.len(), wanted, "case {inside:08b}");
            let mut sides: Vec<[u8; 2]> = triangles
                .iter()
                .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
                .collect();
            sides.sort_unstable();
            // A side without its opposite bounds the loop, and lies in a face; others do not.
            for [a, b] in &sides {
                let inner = sides.binary_search(&[*b, *a]).is_ok();
                assert_ne!(inner, share_a_face(*a, *b), "case {inside:08b}");
            }
            sides.dedup();
            assert_eq!(sides.len(), 3 * triangles.len());
        }
        // One corner is one triangle; a checkerboard is four.
        assert_eq!(CUBE_CASES[1], [[0, 8, 16]]);
        assert_eq!(CUBE_CASES[0b0110_1001].len(), 4);
    }
}
