//! Gmsh element types.

/// Number of nodes of the largest element in [`vtk_kind`].
pub(super) const MAX_NODES_PER_CELL: usize = 125;

/// Returns the VTK type and the number of nodes of the Gmsh element type `number`. Corners are
/// first in all of them, in VTK order.
pub(super) fn vtk_kind(number: i32) -> Option<(u8, usize)> {
    Some(match number {
        15 => (1, 1),
        1 => (3, 2),
        8 => (21, 3),
        26 => (35, 4),
        27 => (68, 5),
        28 => (68, 6),
        2 => (5, 3),
        9 => (22, 6),
        20 => (69, 9),
        21 => (69, 10),
        22 => (69, 12),
        23 | 24 => (69, 15),
        25 => (69, 21),
        3 => (9, 4),
        10 => (28, 9),
        16 => (23, 8),
        36 => (70, 16),
        37 => (70, 25),
        38 => (70, 36),
        39 => (70, 12),
        4 => (10, 4),
        11 => (24, 10),
        29 => (71, 20),
        30 => (71, 35),
        31 => (71, 56),
        5 => (12, 8),
        12 => (29, 27),
        17 => (25, 20),
        92 => (72, 64),
        93 => (72, 125),
        6 => (13, 6),
        13 => (32, 18),
        18 => (26, 15),
        90 => (73, 40),
        91 => (73, 75),
        7 => (14, 5),
        14 => (37, 14),
        19 => (27, 13),
        118 => (74, 30),
        119 => (74, 55),
        _ => return None,
    })
}
