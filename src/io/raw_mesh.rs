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
use super::polyhedra;
use super::ten_node::ten_nodes;
use crate::mesh::{
    AnatomicalFrame, EdgeMiddles, Field, Location, ScalarType, TetMesh, signed_volume,
};
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
    /// Number of nodes of each face of a polyhedron, by cell; its nodes are those of its faces.
    faces: BTreeMap<usize, Vec<u32>>,
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

    /// Adds the polyhedron with the faces in `list`: their number, and for each its number of nodes
    /// and its nodes. A list of another form gives a polyhedron without faces.
    fn push_polyhedron(&mut self, list: &[usize]) {
        let (mut nodes, mut sizes) = (Vec::new(), Vec::new());
        let mut rest = list.get(1..).unwrap_or_default();
        while let Some((size, face)) = rest.split_first()
            && let Some((face, after)) = face.split_at_checked(*size)
        {
            sizes.push(*size as u32);
            nodes.extend_from_slice(face);
            rest = after;
        }
        let complete = rest.is_empty() && list.first() == Some(&sizes.len());
        let cell = self.len();
        self.push(POLYHEDRON, nodes.into_iter().filter(|_| complete));
        if complete {
            self.faces.insert(cell, sizes);
        }
    }

    /// Adds cell `cell` of `other`, if it exists, with its nodes numbered by `number`.
    pub fn push_from(&mut self, other: &Cells, cell: usize, number: impl Fn(u32) -> usize) {
        let Some((kind, nodes)) = other.get(cell) else {
            return;
        };
        if let Some(sizes) = other.faces.get(&cell) {
            self.faces.insert(self.len(), sizes.clone());
        }
        self.push(kind, nodes.iter().map(|v| number(*v)));
    }

    /// Returns the type and nodes of cell `cell`, if it exists.
    pub fn get(&self, cell: usize) -> Option<(u8, &[u32])> {
        let start = cell.checked_sub(1).map_or(0, |before| self.ends[before]);
        Some((*self.kinds.get(cell)?, &self.nodes[start..self.ends[cell]]))
    }

    /// Iterates over the types and nodes of all cells.
    pub fn iter(&self) -> impl Iterator<Item = (u8, &[u32])> {
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
    /// within `nodes`).
    pub fn add_cells(&mut self, kinds: &[f64], nodes: &[f64], ends: &[usize]) -> ParseResult<()> {
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
            if number == POLYHEDRON {
                let list: Vec<usize> = corners.iter().map(|v| *v as usize).collect();
                self.cells.push_polyhedron(&list);
            } else {
                self.cells.push(number, corners.iter().map(|v| *v as usize));
            }
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
                let used = match ten_nodes(number, nodes) {
                    Some(all) => all.len(),
                    None => solid.corners,
                };
                for v in nodes.iter().take(used) {
                    if let Some(used) = of_node.get_mut(*v as usize) {
                        *used = true;
                    }
                }
            }
        }
        (of_node, of_cell)
    }

    /// Converts the cells to tets and repairs the mesh with [`TetMesh::new`]. With a ten-node tet
    /// among the cells the mesh has order 2.
    ///
    /// # Errors
    /// An error for a cell with the wrong number of nodes or a node out of range, for no volumetric
    /// cell, and the errors of [`TetMesh::new`].
    pub fn into_tets(mut self) -> ParseResult<TetMesh> {
        let mut tets = Tets::default();
        for (index, (number, corners)) in self.cells.iter().enumerate() {
            let (name, fate) = kind(number);
            if let Some(bad) = corners.iter().find(|v| **v as usize >= self.nodes.len()) {
                return Err(format!(
                    "cell {index} ({name}) refers to node {bad}, but there are only {} nodes (both counted from 0)",
                    self.nodes.len()
                ));
            }
            match fate {
                CellSupport::Cut(solid) => tets.cut(index, number, corners, solid, &self.nodes)?,
                CellSupport::Faces => {
                    let sizes = self.cells.faces.get(&index).map(Vec::as_slice);
                    tets.split(index, corners, sizes.unwrap_or_default(), &self.nodes);
                }
                CellSupport::Drop => *tets.found.dropped.entry(name).or_default() += 1,
                CellSupport::Hole => *tets.found.holes.entry(name).or_default() += 1,
            }
        }
        if tets.tets.is_empty() {
            return Err(tets.found.nothing_volumetric());
        }
        tets.found.warn(&mut self.warnings);
        let middles = tets.edge_middles(&self.cells, &mut self.warnings);
        let nodes = self.nodes.len();
        let cells = self.cells.len();
        let mut fields =
            fields_of_tets(self.fields, nodes, cells, &tets.source, &mut self.warnings);
        tets.add_centres(&mut self.nodes, &mut fields, &mut self.warnings);
        let made = TetMesh::of_order(self.nodes, tets.tets, fields, self.warnings, middles);
        let mut mesh = made.map_err(|e| match e {
            crate::Error::Mesh(what) => what,
            other => other.to_string(),
        })?;
        mesh.region_names = self.region_names;
        mesh.length_unit = self.length_unit;
        if let Some(frame) = self.frame {
            if frame == AnatomicalFrame::Lps {
                let note = "converted from LPS, which the file states, to RAS";
                mesh.repairs.warnings.push(note.into());
            }
            mesh.convert_to_ras(frame);
        }
        Ok(mesh)
    }
}

/// The tets of the cells of a mesh.
#[derive(Default)]
struct Tets {
    tets: Vec<[u32; 4]>,
    /// The cell of each tet.
    source: Vec<usize>,
    /// New nodes, which follow those of the file, and the nodes of their polyhedra.
    centres: Vec<(DVec3, Vec<u32>)>,
    found: Census,
}

impl Tets {
    /// Adds the tets of cell `index`, which has the type `number`.
    fn cut(
        &mut self,
        index: usize,
        number: u8,
        corners: &[u32],
        solid: &CellShape,
        nodes: &[DVec3],
    ) -> ParseResult<()> {
        let (name, _) = kind(number);
        let linear = (TET..=HEXAGONAL_PRISM_KIND).contains(&number);
        if corners.len() < solid.corners || (linear && corners.len() > solid.corners) {
            return Err(format!(
                "cell {index} (counted from 0) is a {name}, which has {} corners, but it lists {} nodes",
                solid.corners,
                corners.len()
            ));
        }
        if ten_nodes(number, corners).is_some() {
            self.found.ten_node += 1;
        } else if corners.len() > solid.corners {
            *self.found.higher_order.entry(name).or_default() += 1;
        }
        if solid.corners > 4 {
            *self.found.cut.entry(name).or_default() += 1;
        }
        cut(solid, &corners[..solid.corners], nodes, &mut self.tets);
        self.source.resize(self.tets.len(), index);
        Ok(())
    }

    /// Returns the middle nodes of the ten-node tets among `cells`, if there are any.
    fn edge_middles(&self, cells: &Cells, warnings: &mut Vec<String>) -> Option<EdgeMiddles> {
        let count = self.found.ten_node;
        if count == 0 {
            return None;
        }
        let others = self.tets.len() - count;
        if others > 0 {
            warnings.push(format!(
                "{others} tets of other cells got mid-edge nodes like the {count} ten-node tets: those of \
                the same edges, otherwise straight ones"
            ));
        }
        let elements = cells
            .iter()
            .filter_map(|(kind, nodes)| ten_nodes(kind, nodes));
        Some(EdgeMiddles::new(elements))
    }

    /// Adds the tets of cell `index`, a polyhedron.
    fn split(&mut self, index: usize, corners: &[u32], sizes: &[u32], nodes: &[DVec3]) {
        let (name, _) = kind(POLYHEDRON);
        if let Some(bad) = corners.iter().find(|v| !nodes[**v as usize].is_finite()) {
            // Kept for the error that names the node.
            self.tets.push([*bad; 4]);
            self.source.push(index);
            return;
        }
        let Some(split) = polyhedra::split(corners, sizes, nodes) else {
            *self.found.holes.entry(name).or_default() += 1;
            return;
        };
        *self.found.cut.entry(name).or_default() += 1;
        let first = nodes.len();
        let number = (first + self.centres.len()) as u32;
        let numbered = |v: u32| if v as usize == first { number } else { v };
        self.tets
            .extend(split.tets.iter().map(|tet| tet.map(numbered)));
        self.source.resize(self.tets.len(), index);
        if let Some(centre) = split.centre {
            let mut around = corners.to_vec();
            around.sort_unstable();
            around.dedup();
            self.centres.push((centre, around));
        }
    }

    /// Adds the new nodes, with the mean of the values around them, or the first of integers.
    fn add_centres(
        &mut self,
        nodes: &mut Vec<DVec3>,
        fields: &mut [Field],
        warnings: &mut Vec<String>,
    ) {
        if self.centres.is_empty() {
            return;
        }
        let of_nodes = fields.iter_mut().filter(|f| f.location == Location::Node);
        for field in of_nodes {
            let width = field.components;
            let real = matches!(field.scalar_type, ScalarType::F32 | ScalarType::F64);
            for (_, around) in &self.centres {
                for component in 0..width {
                    let value = |v: &u32| field.values[*v as usize * width + component];
                    let mean = around.iter().map(value).sum::<f64>() / around.len() as f64;
                    let new = if real { mean } else { value(&around[0]) };
                    field.values.push(new);
                }
            }
        }
        nodes.extend(self.centres.iter().map(|(centre, _)| *centre));
        let count = self.centres.len();
        warnings.push(match count {
            1 => "1 polyhedron got a node at its centre".to_owned(),
            _ => format!("{count} polyhedra got a node each at their centres"),
        });
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
    /// Ten-node tets, which keep all nodes.
    ten_node: usize,
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
            "mesh has {found}; expected volumetric cells: tetrahedra, hexahedra, wedges, \
            pyramids or polyhedra (mesh a closed surface first with `palpate mesh`, TetGen or gmsh)"
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
                "dropped although they may have volume: they cannot be subdivided into tetrahedra, \
                so the mesh has holes there",
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
