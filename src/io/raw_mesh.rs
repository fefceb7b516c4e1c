//! Conversion of the cells of a file to tetrahedra, shared by all readers.
//!
//! Hexahedra, wedges, pyramids and prisms are subdivided into tets that conform across shared
//! faces: every face is fanned from its node of smallest number, and the cell is coned from its own
//! node of smallest number over the faces that do not contain it (Dompierre et al., *How to
//! Subdivide Pyramids, Prisms, and Hexahedra into Tetrahedra*, 1999). The rule depends on node
//! numbers only, so adjacent cells always agree.

use super::cell_kinds::{
    CellShape, CellSupport, HEXAGONAL_PRISM_KIND, POLYHEDRON, TET, WEDGE, kind,
};
use super::cursor::ParseResult;
use crate::mesh::{AnatomicalFrame, Field, Location, TetMesh, signed_volume};
use glam::DVec3;
use std::collections::BTreeMap;

/// Unprocessed content of a file, in the order of the file.
#[derive(Default)]
pub(super) struct RawMesh {
    pub nodes: Vec<DVec3>,
    pub cells: Cells,
    /// One tuple per node, or one per cell (of any type).
    pub fields: Vec<Field>,
    pub warnings: Vec<String>,
    /// See [`TetMesh`].
    pub region_names: BTreeMap<i64, String>,
    pub length_unit: Option<f64>,
    /// The frame that the file states.
    pub frame: Option<AnatomicalFrame>,
}

/// Cells of mixed types.
#[derive(Default)]
pub(super) struct Cells {
    /// VTK number of each cell's type.
    kinds: Vec<u8>,
    /// End of each cell's nodes in `nodes`.
    ends: Vec<usize>,
    nodes: Vec<u32>,
}

impl Cells {
    pub fn len(&self) -> usize {
        self.kinds.len()
    }

    /// Adds a cell; node numbers start at 0, and those beyond u32 are rejected later as out of
    /// range.
    pub fn push(&mut self, kind: u8, nodes: impl IntoIterator<Item = usize>) {
        self.kinds.push(kind);
        self.nodes.extend(
            nodes
                .into_iter()
                .map(|v| u32::try_from(v).unwrap_or(u32::MAX)),
        );
        self.ends.push(self.nodes.len());
    }

    /// Returns the type and nodes of cell `cell`, if it exists.
    pub fn get(&self, cell: usize) -> Option<(u8, &[u32])> {
        let start = cell.checked_sub(1).map_or(0, |before| self.ends[before]);
        Some((*self.kinds.get(cell)?, &self.nodes[start..self.ends[cell]]))
    }

    fn iter(&self) -> impl Iterator<Item = (u8, &[u32])> {
        let mut start = 0;
        self.kinds.iter().zip(&self.ends).map(move |(kind, end)| {
            let nodes = &self.nodes[start..*end];
            start = *end;
            (*kind, nodes)
        })
    }
}

impl RawMesh {
    /// Adds cells in VTK layout: types, all nodes, and the end of each cell's nodes (ascending, and
    /// within `nodes`). Node numbers are relative to the first node of the same piece,
    /// `first_node`.
    pub fn add_cells(
        &mut self,
        kinds: &[f64],
        nodes: &[f64],
        ends: &[usize],
        first_node: usize,
    ) -> ParseResult<()> {
        let mut start = 0;
        for (cell, (kind, end)) in kinds.iter().zip(ends).enumerate() {
            let number = *kind as u8;
            if f64::from(number) != *kind {
                return Err(format!(
                    "cell {cell} (counted from 0) has kind {kind}, expected a VTK cell type"
                ));
            }
            let corners = &nodes[start..*end];
            start = *end;
            if let Some(bad) = corners.iter().find(|v| index(**v).is_none()) {
                return Err(format!(
                    "cell {cell} (counted from 0) refers to node {bad}; expected an integer ≥ 0"
                ));
            }
            self.cells
                .push(number, corners.iter().map(|v| *v as usize + first_node));
        }
        Ok(())
    }

    /// Returns the masks of the nodes and the cells that the tets use.
    pub fn volumetric(&self) -> (Vec<bool>, Vec<bool>) {
        let mut of_node = vec![false; self.nodes.len()];
        let mut of_cell = vec![false; self.cells.len()];
        for (cell, (number, nodes)) in self.cells.iter().enumerate() {
            if let CellSupport::Cut(solid) = kind(number).1 {
                of_cell[cell] = true;
                for v in nodes.iter().take(solid.corners) {
                    if let Some(used) = of_node.get_mut(*v as usize) {
                        *used = true;
                    }
                }
            }
        }
        (of_node, of_cell)
    }

    /// Converts the cells to tets and repairs the mesh with [`TetMesh::new`].
    ///
    /// # Errors
    /// An error for a cell with the wrong number of nodes or a node out of range, for no volumetric
    /// cell, and the errors of [`TetMesh::new`].
    pub fn into_tets(self) -> ParseResult<TetMesh> {
        let RawMesh {
            nodes,
            cells,
            fields,
            mut warnings,
            region_names,
            length_unit,
            frame,
        } = self;
        let mut tets = Vec::with_capacity(cells.len());
        let mut source = Vec::with_capacity(cells.len());
        let mut found = Census::default();
        for (index, (number, corners)) in cells.iter().enumerate() {
            let (name, fate) = kind(number);
            if number != POLYHEDRON
                && let Some(bad) = corners.iter().find(|v| **v as usize >= nodes.len())
            {
                return Err(format!(
                    "cell {index} ({name}) refers to node {bad}, but there are only {} nodes (both counted from 0)",
                    nodes.len()
                ));
            }
            match fate {
                CellSupport::Cut(solid) => {
                    let linear = (TET..=HEXAGONAL_PRISM_KIND).contains(&number);
                    if corners.len() < solid.corners || (linear && corners.len() > solid.corners) {
                        return Err(format!(
                            "cell {index} (counted from 0) is a {name}, which has {} corners, but it lists {} nodes",
                            solid.corners,
                            corners.len()
                        ));
                    }
                    if corners.len() > solid.corners {
                        *found.higher_order.entry(name).or_default() += 1;
                    }
                    if solid.corners > 4 {
                        *found.cut.entry(name).or_default() += 1;
                    }
                    cut(solid, &corners[..solid.corners], &nodes, &mut tets);
                    source.resize(tets.len(), index);
                }
                CellSupport::Drop => *found.dropped.entry(name).or_default() += 1,
                CellSupport::Hole => *found.holes.entry(name).or_default() += 1,
            }
        }
        if tets.is_empty() {
            return Err(found.nothing_volumetric());
        }
        found.warn(&mut warnings);
        let fields = fields_of_tets(fields, nodes.len(), cells.len(), &source, &mut warnings);
        let mut mesh = TetMesh::new(nodes, tets, fields, warnings).map_err(|e| match e {
            crate::Error::Mesh(what) => what,
            other => other.to_string(),
        })?;
        mesh.region_names = region_names;
        mesh.length_unit = length_unit;
        if let Some(frame) = frame {
            if frame == AnatomicalFrame::Lps {
                let note = "converted from LPS, which the file states, to RAS";
                mesh.repairs.warnings.push(note.into());
            }
            mesh.convert_to_ras(frame);
        }
        Ok(mesh)
    }
}

/// Converts a floating-point count or index to an integer.
pub(super) fn index(value: f64) -> Option<usize> {
    (value >= 0.0 && value.fract() == 0.0 && value < 9e15).then_some(value as usize)
}

/// Subdivides a cell into tets.
fn cut(solid: &CellShape, cell: &[u32], nodes: &[DVec3], tets: &mut Vec<[u32; 4]>) {
    if let [a, b, c, d] = *cell {
        tets.push([a, b, c, d]);
        return;
    }
    let first = tets.len();
    let apex = cell.iter().copied().min().unwrap_or_default();
    for face in solid.faces {
        // A collapsed face may contain the apex twice; its cone would be degenerate.
        if face.iter().any(|i| cell[*i] == apex) {
            continue;
        }
        let smallest = (0..face.len()).min_by_key(|i| cell[face[*i]]).unwrap_or(0);
        let corner = |i: usize| cell[face[(smallest + i) % face.len()]];
        for i in 1..face.len() - 1 {
            // The face is counter-clockwise seen from outside, so the apex is behind it.
            let tet = [corner(0), corner(i + 1), corner(i), apex];
            if tet[0] != tet[1] && tet[1] != tet[2] && tet[2] != tet[0] {
                tets.push(tet);
            }
        }
    }
    if tets.len() == first {
        // Fully collapsed: kept, to be counted as degenerate.
        tets.push([apex; 4]);
    }
    // The wedges of VTK have the opposite orientation, and not all writers respect this: a wedge
    // that is inverted as a whole is flipped.
    let volume: f64 = tets[first..]
        .iter()
        .map(|t| signed_volume(t.map(|v| nodes[v as usize])))
        .sum();
    if solid.corners == WEDGE.corners && volume < 0.0 {
        tets[first..].iter_mut().for_each(|t| t.swap(0, 1));
    }
}

/// Returns the valid fields, with the tuple of each cell repeated for its tets.
fn fields_of_tets(
    fields: Vec<Field>,
    nodes: usize,
    cells: usize,
    source: &[usize],
    warnings: &mut Vec<String>,
) -> Vec<Field> {
    let one_to_one = source.len() == cells && source.iter().enumerate().all(|(t, c)| t == *c);
    let mut kept: Vec<Field> = Vec::with_capacity(fields.len());
    for mut field in fields {
        let items = match field.location {
            Location::Node => nodes,
            Location::Cell => cells,
        };
        if field.components == 0 || items.checked_mul(field.components) != Some(field.values.len())
        {
            warnings.push(format!(
                "field \"{}\" skipped: it has {} values for {items} {}",
                field.name,
                field.values.len(),
                field.location
            ));
            continue;
        }
        if kept
            .iter()
            .any(|f| f.name == field.name && f.location == field.location)
        {
            warnings.push(format!(
                "several fields \"{}\" ({}); the first one is kept",
                field.name, field.location
            ));
            continue;
        }
        if field.location == Location::Cell && !one_to_one {
            let width = field.components;
            field.values = source
                .iter()
                .flat_map(|c| field.values[c * width..(c + 1) * width].iter().copied())
                .collect();
        }
        kept.push(field);
    }
    kept
}

/// Number of cells by type and treatment.
#[derive(Default)]
struct Census {
    cut: BTreeMap<&'static str, usize>,
    higher_order: BTreeMap<&'static str, usize>,
    dropped: BTreeMap<&'static str, usize>,
    holes: BTreeMap<&'static str, usize>,
}

impl Census {
    fn nothing_volumetric(&self) -> String {
        let mut all = self.dropped.clone();
        all.extend(self.holes.iter());
        let found = if all.is_empty() {
            "no cells".to_string()
        } else {
            format!("only {}", list(&all))
        };
        format!(
            "mesh has {found}; expected volumetric cells: tetrahedra, hexahedra, wedges or \
            pyramids (mesh a closed surface first with `palpate mesh`, TetGen or gmsh)"
        )
    }

    fn warn(&self, warnings: &mut Vec<String>) {
        let notes = [
            (&self.cut, "subdivided into tetrahedra"),
            (
                &self.higher_order,
                "reduced to their corners; other nodes dropped",
            ),
            (&self.dropped, "dropped: not volumetric"),
            (
                &self.holes,
                "dropped although they may have volume: subdivision into tetrahedra is not \
                supported, so the mesh has holes there",
            ),
        ];
        for (census, what) in notes {
            if !census.is_empty() {
                warnings.push(format!("{} {what}", list(census)));
            }
        }
    }
}

/// Formats a list such as "3 lines, 1 triangle".
fn list(census: &BTreeMap<&'static str, usize>) -> String {
    let plural = |name: &str, count: usize| match name {
        _ if count == 1 => name.to_string(),
        "vertex" => "vertices".to_string(),
        "cell of unknown kind" => "cells of unknown kind".to_string(),
        _ if name.ends_with("hedron") => format!("{}a", &name[..name.len() - 2]),
        _ => format!("{name}s"),
    };
    let items: Vec<String> = census
        .iter()
        .map(|(name, count)| format!("{count} {}", plural(name, *count)))
        .collect();
    items.join(", ")
}
