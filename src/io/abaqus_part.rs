//! Parts of Abaqus input files: nodes, elements and sets with numbers of their own.

use super::abaqus_elements::{MAX_NODES_PER_CELL, Shape};
use super::abaqus_lines::{shown, tag};
use super::abaqus_sets::{Member, Numbers, Sets};
use super::cursor::{ParseResult, number};
use super::id_map::Tags;
use super::raw_mesh::Cells;
use glam::DVec3;

/// A part, an instance with nodes of its own, or what a file has outside of parts.
#[derive(Default)]
pub(super) struct Part {
    /// Empty outside of parts.
    pub name: String,
    pub nodes: Vec<DVec3>,
    node_tags: Tags,
    node_numbers: Vec<u64>,
    pub elements: Vec<(Shape, u64)>,
    /// The node numbers of all elements: nodes may follow them.
    corners: Vec<u64>,
    /// The element whose nodes continue on the next line.
    open: Vec<u64>,
    pub node_sets: Sets,
    pub element_sets: Sets,
    /// Element sets referenced by solid sections.
    pub sections: Vec<String>,
    /// Element sets defined by *ELEMENT.
    pub cards: Vec<String>,
}

/// The content of a part, by index.
pub(super) struct PartMesh {
    pub nodes: Vec<DVec3>,
    pub cells: Cells,
    pub node_numbers: Numbers,
    pub element_numbers: Numbers,
    /// Number of elements with a number already in use.
    pub repeated: usize,
}

impl Part {
    pub fn new(name: &str) -> Part {
        Part {
            name: name.to_owned(),
            ..Part::default()
        }
    }

    /// Reads the line of a node.
    pub fn node<'a>(&mut self, mut words: impl Iterator<Item = &'a [u8]>) -> ParseResult<()> {
        let tag = tag(words.next().unwrap_or_default(), "the number of a node")?;
        let mut position = [0.0; 3];
        for (axis, value) in ["x", "y", "z"].iter().zip(&mut position) {
            // Missing coordinates are 0.
            let word = words.next().unwrap_or_default();
            if !word.is_empty() {
                *value = number(word).ok_or_else(|| {
                    format!("{axis} of node {tag} is {}, expected a number", shown(word))
                })?;
            }
        }
        let position = DVec3::from_array(position);
        if self.node_tags.push(tag) {
            self.nodes.push(position);
            self.node_numbers.push(tag);
        } else if self.node_tags.get(tag).map(|i| self.nodes[i]) != Some(position) {
            return Err(format!(
                "node {tag} is defined twice, at different positions"
            ));
        }
        Ok(())
    }

    /// Reads a line of an element, which may have several.
    pub fn element<'a>(
        &mut self,
        shape: Shape,
        words: impl Iterator<Item = &'a [u8]>,
    ) -> ParseResult<()> {
        for word in words.filter(|word| !word.is_empty()) {
            if self.open.len() > shape.nodes {
                return Err(format!(
                    "element {} lists more than {} nodes",
                    self.open[0], shape.nodes
                ));
            }
            self.open
                .push(tag(word, "the number of an element or node")?);
        }
        if self.open.len() == 1 + shape.nodes {
            self.elements.push((shape, self.open[0]));
            self.corners.extend(&self.open[1..]);
            self.open.clear();
        }
        Ok(())
    }

    /// Ends a section of nodes, of which the first has the index `first`.
    pub fn end_nodes(&mut self, first: usize, set: Option<&str>) {
        if let Some(set) = set {
            let all = Member::Items(first..self.nodes.len());
            self.node_sets.add(set, vec![all]);
        }
    }

    /// Ends a section of elements, of which the first has the index `first`.
    pub fn end_elements(
        &mut self,
        shape: Shape,
        first: usize,
        set: Option<&str>,
    ) -> ParseResult<()> {
        if let Some(element) = self.open.first() {
            return Err(format!(
                "element {element} before this line lists {} of {} nodes",
                self.open.len() - 1,
                shape.nodes
            ));
        }
        if let Some(set) = set {
            let all = Member::Items(first..self.elements.len());
            self.element_sets.add(set, vec![all]);
            self.cards.push(set.to_owned());
        }
        Ok(())
    }

    /// Replaces numbers by indices.
    pub fn take_mesh(&mut self) -> ParseResult<PartMesh> {
        let mut tags = Tags::default();
        let mut repeated = 0;
        let mut cells = Cells::default();
        let mut corners = self.corners.iter();
        for (shape, element) in &self.elements {
            let mut cell = [0; MAX_NODES_PER_CELL];
            for (place, node) in cell[..shape.nodes].iter_mut().zip(&mut corners) {
                *place = self.node_tags.get(*node).ok_or_else(|| {
                    let part = match self.name.as_str() {
                        "" => String::new(),
                        name => format!(" of part \"{name}\""),
                    };
                    format!("element {element}{part} refers to undefined node {node}")
                })?;
            }
            if !tags.push(*element) {
                tags.push_unnamed();
                repeated += 1;
            }
            cells.push(shape.kind, cell[..shape.nodes].iter().copied());
        }
        let numbers = std::mem::take(&mut self.node_numbers);
        Ok(PartMesh {
            nodes: std::mem::take(&mut self.nodes),
            cells,
            node_numbers: Numbers::new(std::mem::take(&mut self.node_tags), numbers.into_iter()),
            element_numbers: Numbers::new(tags, self.elements.iter().map(|e| e.1)),
            repeated,
        })
    }
}
