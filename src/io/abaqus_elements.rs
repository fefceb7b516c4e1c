//! Node layouts of Abaqus element types.

/// Number of nodes of the largest element.
pub(super) const MAX_NODES_PER_CELL: usize = 27;

/// Node layout of an element type.
#[derive(Clone, Copy)]
pub(super) struct Shape {
    /// VTK number of the cell type.
    pub kind: u8,
    pub nodes: usize,
}

/// Prefixes of solid element families before "3D".
const SOLIDS: [&str; 6] = ["C", "DC", "AC", "DCC", "QC", "F"];

/// Returns the layout of the type `name`, in upper case; corners are first, in VTK order.
pub(super) fn shape(name: &str) -> Option<Shape> {
    let of = |kind, nodes| Some(Shape { kind, nodes });
    if let Some((family, rest)) = name.split_once("3D")
        && SOLIDS.contains(&family)
    {
        let digits = rest.trim_end_matches(|c: char| !c.is_ascii_digit());
        return match (digits, rest) {
            // Variable numbers of nodes: 15 to 18, and 21 to 27.
            (_, "15V" | "15VH" | "27" | "27H" | "27R" | "27RH") => None,
            ("4", _) => of(10, 4),
            ("5", _) => of(14, 5),
            ("6", _) => of(13, 6),
            ("8", _) => of(12, 8),
            ("10", _) => of(24, 10),
            ("13", _) => of(27, 13),
            ("15", _) => of(26, 15),
            ("20", _) => of(25, 20),
            _ => None,
        };
    }
    // Continuum shells have the shape of solids; the other types here have no volume.
    match name {
        "SC6R" => of(13, 6),
        "SC8R" => of(12, 8),
        "S3" | "S3R" | "S3RS" | "STRI3" | "M3D3" | "R3D3" | "SFM3D3" | "CPS3" | "CPE3" | "CAX3"
        | "DS3" | "DC2D3" => of(5, 3),
        "S4" | "S4R" | "S4R5" | "S4RS" | "M3D4" | "M3D4R" | "R3D4" | "SFM3D4" | "SFM3D4R"
        | "CPS4" | "CPS4R" | "CPE4" | "CPE4R" | "CAX4" | "CAX4R" | "DS4" | "DC2D4" => of(9, 4),
        "S6" | "STRI65" | "M3D6" | "SFM3D6" | "CPS6" | "CPS6M" | "CPE6" | "CPE6M" | "CAX6"
        | "DS6" | "DC2D6" => of(22, 6),
        "S8" | "S8R" | "S8R5" | "M3D8" | "M3D8R" | "SFM3D8" | "SFM3D8R" | "CPS8" | "CPS8R"
        | "CPE8" | "CPE8R" | "CAX8" | "CAX8R" | "DS8" | "DC2D8" => of(23, 8),
        "T2D2" | "T3D2" | "B21" | "B31" | "B33" | "B23" | "B21H" | "B31H" | "B31R" | "R2D2"
        | "DC1D2" => of(3, 2),
        "T2D3" | "T3D3" | "B22" | "B32" | "B22H" | "B32H" | "B32R" | "DC1D3" => of(21, 3),
        "MASS" | "ROTARYI" => of(1, 1),
        _ => None,
    }
}
