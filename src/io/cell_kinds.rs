//! Cell types by VTK number: names, corners and faces.

/// VTK number of a linear tetrahedron.
pub(super) const TET: u8 = 10;

/// VTK number of a tetrahedron with ten nodes: corners, then middles of the edges 01, 12, 20, 03, 13
/// and 23.
pub(super) const QUADRATIC_TET: u8 = 24;

/// VTK number of the last linear cell with volume.
pub(super) const HEXAGONAL_PRISM_KIND: u8 = 16;

/// VTK number of a polyhedron, whose faces follow in its list of nodes: their number, and for each
/// its number of nodes and its nodes.
pub(super) const POLYHEDRON: u8 = 42;

/// A cell type with corners and planar faces that can be subdivided into tets.
pub(super) struct CellShape {
    pub corners: usize,
    pub faces: &'static [&'static [usize]],
}

// Faces are counter-clockwise seen from outside, for cells in the node order of Gmsh and Medit.
const HEXAHEDRON: CellShape = CellShape {
    corners: 8,
    faces: &[
        &[0, 3, 2, 1],
        &[4, 5, 6, 7],
        &[0, 1, 5, 4],
        &[1, 2, 6, 5],
        &[2, 3, 7, 6],
        &[3, 0, 4, 7],
    ],
};
const VOXEL: CellShape = CellShape {
    corners: 8,
    faces: &[
        &[0, 2, 3, 1],
        &[4, 5, 7, 6],
        &[0, 1, 5, 4],
        &[1, 3, 7, 5],
        &[3, 2, 6, 7],
        &[2, 0, 4, 6],
    ],
};
pub(super) const WEDGE: CellShape = CellShape {
    corners: 6,
    faces: &[
        &[0, 2, 1],
        &[3, 4, 5],
        &[0, 1, 4, 3],
        &[1, 2, 5, 4],
        &[2, 0, 3, 5],
    ],
};
const PYRAMID: CellShape = CellShape {
    corners: 5,
    faces: &[
        &[0, 3, 2, 1],
        &[0, 1, 4],
        &[1, 2, 4],
        &[2, 3, 4],
        &[3, 0, 4],
    ],
};
const PENTAGONAL_PRISM: CellShape = CellShape {
    corners: 10,
    faces: &[
        &[4, 3, 2, 1, 0],
        &[5, 6, 7, 8, 9],
        &[0, 1, 6, 5],
        &[1, 2, 7, 6],
        &[2, 3, 8, 7],
        &[3, 4, 9, 8],
        &[4, 0, 5, 9],
    ],
};
const HEXAGONAL_PRISM: CellShape = CellShape {
    corners: 12,
    faces: &[
        &[5, 4, 3, 2, 1, 0],
        &[6, 7, 8, 9, 10, 11],
        &[0, 1, 7, 6],
        &[1, 2, 8, 7],
        &[2, 3, 9, 8],
        &[3, 4, 10, 9],
        &[4, 5, 11, 10],
        &[5, 0, 6, 11],
    ],
};
const TETRAHEDRON: CellShape = CellShape {
    corners: 4,
    faces: &[&[1, 2, 3], &[0, 3, 2], &[0, 1, 3], &[0, 2, 1]],
};

/// Returns the VTK number of a cell of `nodes` nodes in a section of a surface: vertices, lines,
/// polygons or triangle strips.
pub(super) fn polygon_kind(section: &str, nodes: usize) -> u8 {
    match section.to_ascii_uppercase().as_str() {
        "VERTS" | "VERTICES" if nodes <= 1 => 1,
        "VERTS" | "VERTICES" => 2,
        "LINES" if nodes <= 2 => 3,
        "LINES" => 4,
        "POLYS" | "POLYGONS" => 7,
        _ => 6,
    }
}

/// Treatment of a cell type.
pub(super) enum CellSupport {
    /// Subdivided into tets (by its corners; other nodes are dropped).
    Cut(&'static CellShape),
    /// Subdivided into tets by its own faces.
    Faces,
    /// Not volumetric: dropped and reported.
    Drop,
    /// Volumetric, but subdivision is not supported: dropped, reported, and warned of.
    Hole,
}

/// Returns the name (singular) and treatment of cells with VTK number `kind`.
pub(super) fn kind(kind: u8) -> (&'static str, CellSupport) {
    use CellSupport::{Cut, Drop, Faces, Hole};
    match kind {
        0 => ("empty cell", Drop),
        1 => ("vertex", Drop),
        2 => ("vertex group", Drop),
        3 => ("line", Drop),
        4 => ("polyline", Drop),
        5 => ("triangle", Drop),
        6 => ("triangle strip", Drop),
        7 => ("polygon", Drop),
        8 => ("pixel", Drop),
        9 => ("quadrilateral", Drop),
        10 => ("tetrahedron", Cut(&TETRAHEDRON)),
        11 => ("voxel", Cut(&VOXEL)),
        12 => ("hexahedron", Cut(&HEXAHEDRON)),
        13 => ("wedge", Cut(&WEDGE)),
        14 => ("pyramid", Cut(&PYRAMID)),
        15 => ("pentagonal prism", Cut(&PENTAGONAL_PRISM)),
        16 => ("hexagonal prism", Cut(&HEXAGONAL_PRISM)),
        21 | 35 | 60 | 68 | 75 => ("curved line", Drop),
        22 | 34 | 61 | 69 | 76 => ("curved triangle", Drop),
        23 | 28 | 30 | 62 | 70 | 77 => ("curved quadrilateral", Drop),
        36 | 63 => ("curved polygon", Drop),
        QUADRATIC_TET => ("second-order tetrahedron", Cut(&TETRAHEDRON)),
        64 | 71 | 78 => ("higher-order tetrahedron", Cut(&TETRAHEDRON)),
        67 | 72 | 79 => ("higher-order hexahedron", Cut(&HEXAHEDRON)),
        25 | 29 | 33 => ("second-order hexahedron", Cut(&HEXAHEDRON)),
        65 | 73 | 80 => ("higher-order wedge", Cut(&WEDGE)),
        26 | 31 | 32 => ("second-order wedge", Cut(&WEDGE)),
        66 | 74 | 81 => ("higher-order pyramid", Cut(&PYRAMID)),
        27 | 37 => ("second-order pyramid", Cut(&PYRAMID)),
        41 => ("convex point set", Hole),
        POLYHEDRON => ("polyhedron", Faces),
        _ => ("cell of unknown kind", Hole),
    }
}
