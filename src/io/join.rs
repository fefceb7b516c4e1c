//! Joins the pieces of a mesh, from several files or one.
//!
//! Nodes of several pieces are identified by their `GlobalNodeIds`, otherwise by position; ghost
//! cells (`vtkGhostType`) are dropped.

use super::cursor::ParseResult;
use super::pvtu::PRIVATE_PREFIX;
use super::raw_mesh::RawMesh;
use crate::mesh::{Field, Location, ScalarType};
use std::collections::HashMap;

/// Array of the number of each node and each cell in the whole mesh.
pub(super) const NODE_IDS: &str = "GlobalNodeIds";
pub(super) const CELL_IDS: &str = "GlobalElementIds";
/// Array that is not 0 for cells of other pieces.
pub(super) const GHOSTS: &str = "vtkGhostType";
/// VTK ghost type of a cell that another piece has, too.
pub(super) const DUPLICATE: f64 = 1.0;

/// Joins the pieces of one mesh, as those of an index.
pub(super) fn join(pieces: Vec<RawMesh>) -> ParseResult<RawMesh> {
    let pieces = pieces.into_iter().map(PieceData::new);
    joined(pieces.collect::<ParseResult<_>>()?)
}

/// A piece, and its place in the whole mesh.
pub(super) struct PieceData {
    mesh: RawMesh,
    nodes: Option<Vec<u64>>,
    cells: Option<Vec<u64>>,
    ghosts: Option<Vec<f64>>,
}

impl PieceData {
    /// Returns the number of nodes or of cells.
    fn items(&self, location: Location) -> usize {
        match location {
            Location::Node => self.mesh.nodes.len(),
            Location::Cell => self.mesh.cells.len(),
        }
    }

    /// Takes the numbers and the ghost flags out of the fields of a piece.
    pub fn new(mut mesh: RawMesh) -> ParseResult<PieceData> {
        let [nodes, cells] = [mesh.nodes.len(), mesh.cells.len()];
        let ids = |field: Field| -> ParseResult<Vec<u64>> {
            let whole = |v: &f64| super::raw_mesh::index(*v).map(|i| i as u64);
            let ids: Option<Vec<u64>> = field.values.iter().map(whole).collect();
            ids.ok_or_else(|| format!("field \"{}\" must have integers ≥ 0", field.name))
        };
        let mut take = |name: &str, location, items: usize| {
            let fits = |f: &Field| {
                (f.name.as_str(), f.location) == (name, location)
                    && f.components == 1
                    && f.values.len() == items
            };
            let place = mesh.fields.iter().position(fits)?;
            Some(mesh.fields.remove(place))
        };
        let part = (
            take(NODE_IDS, Location::Node, nodes),
            take(CELL_IDS, Location::Cell, cells),
            take(GHOSTS, Location::Cell, cells),
        );
        // Ghost flags of nodes are redundant.
        take(GHOSTS, Location::Node, nodes);
        mesh.fields.retain(|f| !f.name.starts_with(PRIVATE_PREFIX));
        Ok(PieceData {
            nodes: part.0.map(ids).transpose()?,
            cells: part.1.map(ids).transpose()?,
            ghosts: part.2.map(|f| f.values),
            mesh,
        })
    }
}

/// Identifies a node in several pieces: a number, or a position.
#[derive(PartialEq, Eq, Hash)]
enum Key {
    Id(u64),
    Place([u64; 3]),
}

/// A node or cell of the whole mesh: its global number, and its piece and index in it.
type Member = (u64, usize, usize);

/// The nodes and cells of the whole mesh.
#[derive(Default)]
struct Members {
    nodes: Vec<Member>,
    cells: Vec<Member>,
    /// For each node of each piece, its index in `nodes`.
    places: Vec<Vec<usize>>,
}

impl Members {
    /// Lists each node and each cell once; nodes are the same by their number if `numbered`, and
    /// otherwise by their position.
    fn of(parts: &[PieceData], numbered: bool) -> ParseResult<Members> {
        let mut known: HashMap<Key, (usize, usize)> = HashMap::new();
        let mut all = Members::default();
        let nodes = &mut all.nodes;
        for (k, part) in parts.iter().enumerate() {
            let mut own = Vec::with_capacity(part.mesh.nodes.len());
            for (v, p) in part.mesh.nodes.iter().enumerate() {
                let id = part.nodes.as_ref().map_or(0, |ids| ids[v]);
                let key = match numbered {
                    true => Key::Id(id),
                    // 0 and −0 are the same position.
                    false => Key::Place(p.to_array().map(|x| (x + 0.0).to_bits())),
                };
                let next = nodes.len();
                let (first, place) = *known.entry(key).or_insert((k, next));
                // Two nodes of one piece at the same position stay distinct.
                if place == next || (first == k && !numbered) {
                    nodes.push((id, k, v));
                    own.push(next);
                    continue;
                }
                let (_, piece, node) = nodes[place];
                if numbered && parts[piece].mesh.nodes[node] != *p {
                    return Err(format!(
                        "node with {NODE_IDS} {id} has different positions in pieces {k} and {piece} \
                        (counted from 0)"
                    ));
                }
                own.push(place);
            }
            all.places.push(own);
            let ghost = |c: usize| {
                let kind = part.ghosts.as_ref().map_or(0.0, |ghosts| ghosts[c]);
                // The lowest of VTK's bits.
                kind % 2.0 == DUPLICATE
            };
            let shown = (0..part.mesh.cells.len()).filter(|c| !ghost(*c));
            let number = |c: usize| part.cells.as_ref().map_or(0, |ids| ids[c]);
            all.cells.extend(shown.map(|c| (number(c), k, c)));
        }
        Ok(all)
    }
}

/// Merges all pieces, in the order of the global numbers, if there are any.
pub(super) fn joined(mut parts: Vec<PieceData>) -> ParseResult<RawMesh> {
    // A piece of a process without nodes has neither numbers nor fields.
    if parts.iter().any(|part| part.items(Location::Node) > 0) {
        parts.retain(|part| part.items(Location::Node) > 0);
    }
    let numbered = parts.iter().all(|p| p.nodes.is_some());
    let ordered = numbered && parts.iter().all(|p| p.cells.is_some());
    let mut mesh = RawMesh::default();
    let mut members = Members::of(&parts, numbered)?;
    let mut order: Vec<usize> = (0..members.nodes.len()).collect();
    if ordered {
        order.sort_by_key(|v| members.nodes[*v].0);
        members.cells.sort_by_key(|cell| cell.0);
    }
    let mut rank = vec![0; members.nodes.len()];
    for (new, old) in order.iter().enumerate() {
        rank[*old] = new;
    }
    let nodes: Vec<Member> = order.iter().map(|v| members.nodes[*v]).collect();
    let at = |(_, piece, node): &Member| parts[*piece].mesh.nodes[*node];
    mesh.nodes = nodes.iter().map(at).collect();
    for (_, piece, cell) in &members.cells {
        // Indices out of range stay so.
        let own = &members.places[*piece];
        let corner = |v: u32| own.get(v as usize).map_or(usize::MAX, |v| rank[*v]);
        let from = &parts[*piece].mesh.cells;
        mesh.cells.push_from(from, *cell, corner);
    }
    join_fields(&parts, &nodes, &members.cells, &mut mesh);
    let whole = parts.into_iter().map(|part| part.mesh);
    for part in whole {
        mesh.length_unit = mesh.length_unit.or(part.length_unit);
        mesh.frame = mesh.frame.or(part.frame);
        mesh.region_names.extend(part.region_names);
        for warning in part.warnings {
            if !mesh.warnings.contains(&warning) {
                mesh.warnings.push(warning);
            }
        }
    }
    Ok(mesh)
}

/// Merges the fields that all pieces with items at their location have; the others are left out
/// with a warning.
fn join_fields(parts: &[PieceData], nodes: &[Member], cells: &[Member], mesh: &mut RawMesh) {
    let mut known: Vec<(&str, Location)> = Vec::new();
    for field in parts.iter().flat_map(|part| &part.mesh.fields) {
        let location = field.location;
        if known.contains(&(&field.name, location)) {
            continue;
        }
        known.push((&field.name, location));
        let same = |f: &&Field| {
            (f.location, f.components) == (location, field.components) && f.name == field.name
        };
        let of_parts: Vec<Option<&Field>> = parts
            .iter()
            .map(|part| part.mesh.fields.iter().find(same))
            .collect();
        let mut all = of_parts.iter().zip(parts);
        if all.any(|(of_part, part)| of_part.is_none() && part.items(location) > 0) {
            mesh.warnings.push(format!(
                "field \"{}\" ({location}) skipped: missing in some pieces",
                field.name
            ));
            continue;
        }
        let tuple = |(_, piece, item): &Member| {
            let from = item * field.components;
            let values = of_parts[*piece].map_or(&[][..], |f| &f.values);
            values
                .get(from..from + field.components)
                .unwrap_or_default()
        };
        let items = match location {
            Location::Node => nodes,
            Location::Cell => cells,
        };
        let kind = field.scalar_type;
        let alike = of_parts.iter().flatten().all(|f| f.scalar_type == kind);
        mesh.fields.push(Field {
            name: field.name.clone(),
            values: items.iter().flat_map(tuple).copied().collect(),
            scalar_type: if alike { kind } else { ScalarType::F64 },
            ..*field
        });
    }
}
