//! Reader for the Gmsh MSH format, versions 1, 2, 4.0 and 4.1, ASCII and (except for 1, which has
//! no binary form) binary of either byte order.
//!
//! The `mshio` crate (0.4.2) reads version 4.1 only, so this is a separate reader. Physical and
//! elementary groups become the cell fields `gmsh:physical` and `gmsh:geometrical` unless they are
//! constant 0; a cell in several physical groups belongs to the first. If physical volumes have
//! names, their tags become the cell field `label`, too. Partitions are ignored.

use super::cell_kinds::QUADRATIC_TET;
use super::cursor::ParseResult;
use super::gmsh_data::DataSection;
use super::gmsh_entities::{Entities, physical_name};
use super::gmsh_kinds::{MAX_NODES_PER_CELL, vtk_kind};
use super::gmsh_source::Source;
use super::id_map::{Tags, repeated_numbers};
use super::metadata::{Metadata, integer_field};
use super::raw_mesh::RawMesh;
use crate::mesh::Location;
use glam::DVec3;

/// Magic bytes of the format (comments may precede them).
pub(super) const MAGIC: &[u8] = b"$MeshFormat";

/// Magic bytes of version 1.
pub(super) const MAGIC_1: &[u8] = b"$NOD";

/// Supported versions: major and minor digit.
pub(super) const V1: u32 = 10;
pub(super) const V2: u32 = 20;
pub(super) const V4_0: u32 = 40;
pub(super) const V4_1: u32 = 41;

/// Reads the content of a `.msh` file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut file = File::default();
    let mut at = Source::new(bytes);
    while let Some(name) = at.next_section()? {
        match name {
            "MeshFormat" => file.version = at.mesh_format()?,
            "Entities" => file.entities.read(&mut at, file.version)?,
            "PartitionedEntities" => file.entities.read_partitioned(&mut at, file.version)?,
            "PhysicalNames" => {
                file.physical_names(at.skip_section(name)?);
                continue;
            }
            "Nodes" if file.version >= V4_0 => file.nodes_4(&mut at)?,
            "Nodes" => file.nodes_2(&mut at, false)?,
            "ParametricNodes" => file.nodes_2(&mut at, true)?,
            "Elements" if file.version >= V4_0 => file.elements_4(&mut at)?,
            "Elements" => file.elements_2(&mut at)?,
            "NodeData" => {
                file.data(&mut at, name, Location::Node)?;
                continue;
            }
            "ElementData" => {
                file.data(&mut at, name, Location::Cell)?;
                continue;
            }
            "NOD" => {
                file.version = V1;
                file.nodes_2(&mut at, false)?;
            }
            "ELM" => file.elements_1(&mut at)?,
            "Comments" => {
                file.remarks = Metadata::read(at.skip_section(name)?, "");
                continue;
            }
            other => {
                if other == "ElementNodeData" {
                    file.mesh.warnings.push(format!("section ${other} skipped"));
                }
                at.skip_section(other)?;
                continue;
            }
        }
        at.end_of_section(name)?;
    }
    file.finish()
}

#[derive(Default)]
struct File {
    version: u32,
    mesh: RawMesh,
    nodes: Tags,
    elements: Tags,
    has_elements: bool,
    entities: Entities,
    /// Group and entity of each cell.
    physical: Vec<f64>,
    geometrical: Vec<f64>,
    data: Vec<(Location, DataSection)>,
    /// Number of elements with a number already in use.
    repeated: usize,
    remarks: Metadata,
}

impl File {
    /// Stores the names of physical volumes.
    fn physical_names(&mut self, section: &[u8]) {
        for line in String::from_utf8_lossy(section).lines() {
            if let Some((dimension, tag, name)) = physical_name(line)
                && !self.entities.is_partition_name(tag, name)
                && dimension == 3
            {
                self.mesh.region_names.insert(tag, name.to_owned());
            }
        }
    }

    /// Reads a section of values. A damaged one is left out with a warning, since the mesh does not
    /// depend on it.
    fn data(&mut self, at: &mut Source, name: &str, location: Location) -> ParseResult<()> {
        let start = at.position();
        let section = DataSection::read(at);
        let section = section.and_then(|s| at.end_of_section(name).map(|()| s));
        match section {
            Ok(section) => self.data.push((location, section)),
            Err(e) => {
                at.go_to(start);
                at.skip_section(name).map_err(|_| e.clone())?;
                let warning = format!("section ${name} skipped: {e}");
                self.mesh.warnings.push(warning);
            }
        }
        Ok(())
    }

    /// Adds a node. A node may be repeated with the same position: Gmsh repeats the mesh before
    /// each view that it appends to a file.
    fn node(&mut self, at: &Source, tag: u64, position: DVec3) -> ParseResult<()> {
        if self.nodes.push(tag) {
            self.mesh.nodes.push(position);
        } else if self.nodes.get(tag).map(|i| self.mesh.nodes[i]) != Some(position) {
            return Err(at.error(format_args!(
                "node {tag} is defined twice, at different positions"
            )));
        }
        Ok(())
    }

    fn nodes_2(&mut self, at: &mut Source, parametric: bool) -> ParseResult<()> {
        let count = at.ascii_count(format_args!("the number of nodes"), 8)?;
        for i in 0..count {
            let tag = at.int(format_args!("the tag of node {i} of {count}"))?;
            let position = position(at, tag as u64)?;
            if parametric {
                let dimension = at.int(format_args!("the dimension of node {tag}'s entity"))?;
                at.int(format_args!("the entity of node {tag}"))?;
                // Points and volumes have no parameters.
                for _ in 0..if dimension < 3 { dimension } else { 0 } {
                    at.double(format_args!("a parameter of node {tag}"))?;
                }
            }
            self.node(at, tag as u64, position)?;
        }
        Ok(())
    }

    fn nodes_4(&mut self, at: &mut Source) -> ParseResult<()> {
        let blocks = at.count(format_args!("the number of node blocks"), 4)?;
        let total = at.count(format_args!("the number of nodes"), 8)?;
        self.tag_range(at)?;
        let mut found = 0;
        for _ in 0..blocks {
            let [dimension, _] = self.block_entity(at)?;
            let parametric = at.int(format_args!("a node block's parametric flag"))?;
            let count = at.count(format_args!("the number of nodes of a block"), 8)?;
            found += count;
            // 4.1 lists the tags of a block first, 4.0 each before its node.
            let first = if self.version >= V4_1 { count } else { 0 };
            let mut tags = Vec::with_capacity(first);
            for i in 0..first {
                tags.push(at.size(format_args!("the tag of node {i} of {count} of a block"))?);
            }
            let parameters = match parametric {
                0 => 0,
                _ => dimension.clamp(0, 3),
            };
            for i in 0..count {
                let tag = match tags.get(i) {
                    Some(tag) => *tag,
                    None => {
                        at.int(format_args!("the tag of node {i} of {count} of a block"))? as u64
                    }
                };
                let position = position(at, tag)?;
                for _ in 0..parameters {
                    at.double(format_args!("a parameter of node {tag}"))?;
                }
                self.node(at, tag, position)?;
            }
        }
        if found != total {
            return Err(at.error(format_args!(
                "$Nodes announces {total} nodes, but its blocks hold {found}"
            )));
        }
        Ok(())
    }

    /// Skips the smallest and the largest tag of 4.1.
    fn tag_range(&self, at: &mut Source) -> ParseResult<()> {
        if self.version >= V4_1 {
            at.size(format_args!("the smallest tag"))?;
            at.size(format_args!("the largest tag"))?;
        }
        Ok(())
    }

    /// Reads the dimension and entity of a block, which are in the opposite order in 4.0.
    fn block_entity(&self, at: &mut Source) -> ParseResult<[i32; 2]> {
        let first = at.int(format_args!("a block's entity or dimension"))?;
        let second = at.int(format_args!("a block's entity or dimension"))?;
        Ok(match self.version >= V4_1 {
            true => [first, second],
            false => [second, first],
        })
    }

    /// Returns the VTK type and number of nodes of a Gmsh element type.
    fn element_type(at: &Source, number: i32) -> ParseResult<(u8, usize)> {
        vtk_kind(number).ok_or_else(|| {
            at.error(format_args!(
                "element type {number} is not supported; supported are gmsh's \
                lines, triangles, quadrangles, tetrahedra, hexahedra, prisms and pyramids"
            ))
        })
    }

    /// Reads the nodes of an element and adds it; like a node it may be repeated. An element with
    /// other nodes is a new one, to which some writers give a number already in use.
    fn element(
        &mut self,
        at: &mut Source,
        tag: u64,
        (kind, width): (u8, usize),
        [physical, geometrical]: [i32; 2],
    ) -> ParseResult<()> {
        let mut corners = [0; MAX_NODES_PER_CELL];
        for (i, corner) in corners[..width].iter_mut().enumerate() {
            let what = format_args!("node {i} of element {tag}");
            let node = if self.version >= V4_1 {
                at.size(what)?
            } else {
                at.int(what)? as u64
            };
            *corner = self.nodes.get(node).ok_or_else(|| {
                at.error(format_args!(
                    "element {tag} refers to node {node}, which is missing in $Nodes"
                ))
            })?;
        }
        if kind == QUADRATIC_TET {
            // The edges 23 and 13, in VTK's order.
            corners.swap(8, 9);
        }
        let corners = &corners[..width];
        if self.elements.push(tag) {
            self.add_cell(kind, corners, [physical, geometrical]);
            return Ok(());
        }
        let known = self.elements.get(tag).and_then(|i| self.mesh.cells.get(i));
        let same = known.is_some_and(|(k, nodes)| {
            k == kind
                && nodes
                    .iter()
                    .map(|v| *v as usize)
                    .eq(corners.iter().copied())
        });
        if same {
            // Version 2 lists an element once for each of its physical groups.
            if let Some(group) = self
                .elements
                .get(tag)
                .and_then(|i| self.physical.get_mut(i))
                && self.entities.is_of_partition(*group as i32)
            {
                *group = f64::from(physical);
            }
        } else {
            self.elements.push_unnamed();
            self.add_cell(kind, corners, [physical, geometrical]);
            self.repeated += 1;
        }
        Ok(())
    }

    fn add_cell(&mut self, kind: u8, corners: &[usize], [physical, geometrical]: [i32; 2]) {
        self.mesh.cells.push(kind, corners.iter().copied());
        self.physical.push(f64::from(physical));
        self.geometrical.push(f64::from(geometrical));
    }

    /// Version 1: tag, type, physical and elementary group, number of nodes, nodes.
    fn elements_1(&mut self, at: &mut Source) -> ParseResult<()> {
        self.has_elements = true;
        let count = at.ascii_count(format_args!("the number of elements"), 10)?;
        for i in 0..count {
            let tag = at.int(format_args!("the tag of element {i} of {count}"))?;
            let number = at.int(format_args!("the type of element {tag}"))?;
            let shape = Self::element_type(at, number)?;
            let physical = at.int(format_args!("the physical group of element {tag}"))?;
            let geometrical = at.int(format_args!("the elementary group of element {tag}"))?;
            let nodes = at.int(format_args!("the number of nodes of element {tag}"))?;
            if usize::try_from(nodes) != Ok(shape.1) {
                return Err(at.error(format_args!(
                    "element {tag} of type {number} must have {} nodes, got {nodes}",
                    shape.1
                )));
            }
            self.element(at, tag as u64, shape, [physical, geometrical])?;
        }
        Ok(())
    }

    fn elements_2(&mut self, at: &mut Source) -> ParseResult<()> {
        self.has_elements = true;
        let count = at.ascii_count(format_args!("the number of elements"), 6)?;
        let mut read = 0;
        while read < count {
            // Binary files group elements under a header; in ASCII each is a group of one.
            let (first_tag, number, group, tags) = if at.ascii() {
                let tag = at.int(format_args!("the tag of element {read} of {count}"))?;
                let number = at.int(format_args!("the type of element {tag}"))?;
                let tags = at.int(format_args!("the number of tags of element {tag}"))?;
                (Some(tag), number, 1, tags)
            } else {
                let number = at.int(format_args!("the type of a group of elements"))?;
                let group = at.int(format_args!("the size of a group of elements"))?;
                let tags = at.int(format_args!("the number of tags of a group of elements"))?;
                (None, number, group, tags)
            };
            let shape = Self::element_type(at, number)?;
            let group = usize::try_from(group)
                .ok()
                .filter(|g| (1..=count - read).contains(g))
                .ok_or_else(|| {
                    at.error(format_args!(
                        "a group of {group} elements, with {read} of {count} read"
                    ))
                })?;
            for _ in 0..group {
                let tag = match first_tag {
                    Some(tag) => tag,
                    None => at.int(format_args!("the tag of element {read} of {count}"))?,
                };
                let mut groups = [0; 2];
                for i in 0..tags {
                    let value = at.int(format_args!("tag {i} of element {tag}"))?;
                    if let Some(slot) = groups.get_mut(i as usize) {
                        *slot = value;
                    }
                }
                self.element(at, tag as u64, shape, groups)?;
                read += 1;
            }
        }
        Ok(())
    }

    fn elements_4(&mut self, at: &mut Source) -> ParseResult<()> {
        self.has_elements = true;
        let blocks = at.count(format_args!("the number of element blocks"), 4)?;
        let total = at.count(format_args!("the number of elements"), 4)?;
        self.tag_range(at)?;
        let mut found = 0;
        for _ in 0..blocks {
            let [dimension, entity] = self.block_entity(at)?;
            let number = at.int(format_args!("an element block's type"))?;
            let count = at.count(format_args!("the number of elements of a block"), 4)?;
            found += count;
            let shape = Self::element_type(at, number)?;
            let groups = self.entities.groups_of(dimension, entity);
            for i in 0..count {
                let what = format_args!("the tag of element {i} of {count} of a block");
                let tag = match self.version >= V4_1 {
                    true => at.size(what)?,
                    false => at.int(what)? as u64,
                };
                self.element(at, tag, shape, groups)?;
            }
        }
        if found != total {
            return Err(at.error(format_args!(
                "$Elements announces {total} elements, but its blocks hold {found}"
            )));
        }
        Ok(())
    }

    fn finish(mut self) -> ParseResult<RawMesh> {
        if self.version == 0 {
            return Err("file has no $MeshFormat section".into());
        }
        if self.mesh.nodes.is_empty() {
            return Err("file has no nodes".into());
        }
        if !self.has_elements {
            return Err("file has no $Elements section".into());
        }
        if self.repeated > 0 {
            self.mesh.warnings.push(repeated_numbers(self.repeated));
        }
        // If volumes have names, their physical tags are the labels of regions.
        let named = !self.mesh.region_names.is_empty();
        let labels = match named {
            true => self.physical.clone(),
            false => Vec::new(),
        };
        for (name, values) in [
            ("gmsh:physical", &self.physical),
            ("gmsh:geometrical", &self.geometrical),
            ("label", &labels),
        ] {
            if values.iter().any(|v| *v != 0.0) {
                self.mesh.fields.push(integer_field(name, values.clone()));
            }
        }
        self.remarks.add_to(&mut self.mesh, &self.physical);
        let (node_needed, cell_needed) = self.mesh.volumetric();
        // The data of a view may precede its mesh, so they are processed last.
        for (location, section) in self.data {
            let (tags, needed) = match location {
                Location::Node => (&self.nodes, &node_needed),
                Location::Cell => (&self.elements, &cell_needed),
            };
            section.add_to(&mut self.mesh, location, needed, |tag| tags.get(tag));
        }
        Ok(self.mesh)
    }
}

fn position(at: &mut Source, tag: u64) -> ParseResult<DVec3> {
    let x = at.double(format_args!("x of node {tag}"))?;
    let y = at.double(format_args!("y of node {tag}"))?;
    let z = at.double(format_args!("z of node {tag}"))?;
    Ok(DVec3::new(x, y, z))
}
