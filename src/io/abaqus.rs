//! Reader for Abaqus input files (`.inp`), also used by CalculiX: nodes, elements with or without
//! volume, and sets.
//!
//! Element sets become regions: the field `label` numbers them from 1, and the regions have their
//! names (see [`super::abaqus_sets`]). Node sets become fields `nset:NAME` of 0 and 1. A file with
//! one part is read, with or without an assembly around it; anything else than the mesh (materials,
//! steps, contacts) is skipped.

use super::abaqus_elements::{Shape, shape};
use super::abaqus_lines::{Card, members, shown, tag};
use super::abaqus_sets::{Member, Sets};
use super::cursor::{ParseResult, number};
use super::id_map::{Tags, repeated_numbers};
use super::metadata::Metadata;
use super::raw_mesh::RawMesh;
use glam::DVec3;
use std::collections::BTreeMap;

/// Whether `bytes` begin, after comments, with a keyword that can begin an input file.
pub(super) fn is_abaqus(bytes: &[u8]) -> bool {
    let mut lines = bytes.split(|b| *b == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"**"));
    let word = first.and_then(|line| line.split(|b| *b == b',').next());
    let word = word.unwrap_or_default().trim_ascii().to_ascii_uppercase();
    [&b"*HEADING"[..], b"*NODE", b"*PART"].contains(&word.as_slice())
}

/// Reads the content of an `.inp` file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut file = File::default();
    // A keyword line that ends with a comma continues on the next line.
    let mut open: Option<(usize, String)> = None;
    for (line, text) in (1..).zip(bytes.split(|b| *b == b'\n')) {
        let text = text.trim_ascii();
        if text.is_empty() || text.starts_with(b"**") {
            continue;
        }
        let words = || String::from_utf8_lossy(text);
        let continues = |whole: &String| {
            let word = text[0].is_ascii_alphabetic() || text[0] == b'"';
            word && whole.ends_with(',') && whole.len() < LONGEST_KEYWORD
        };
        match &mut open {
            Some((_, whole)) if continues(whole) => whole.push_str(&words()),
            _ => {
                file.keyword(open.take())?;
                if text.starts_with(b"*") {
                    open = Some((line, words().into_owned()));
                } else {
                    file.data(text).map_err(|e| format!("line {line}: {e}"))?;
                }
            }
        }
    }
    file.keyword(open)?;
    file.finish(bytes)
}

/// Maximum length of a keyword with all its lines, in characters.
const LONGEST_KEYWORD: usize = 1 << 14;

/// Meaning of the data lines that follow.
#[derive(Default)]
enum Section {
    #[default]
    Other,
    Nodes {
        first: usize,
        set: Option<String>,
    },
    Elements {
        shape: Shape,
        first: usize,
        set: Option<String>,
    },
    /// Elements of unknown type, by name.
    UnknownElements(String),
    NodeSet {
        name: String,
        generate: bool,
    },
    ElementSet {
        name: String,
        generate: bool,
    },
    Instance,
}

/// Scope of a keyword.
#[derive(Clone, Copy, Default, PartialEq)]
enum Scope {
    /// In a file without parts, or outside of them.
    #[default]
    Flat,
    /// In the n-th part, or instance with its own nodes.
    Part(usize),
    Assembly,
}

#[derive(Default)]
struct File {
    section: Section,
    scope: Scope,
    parts: usize,
    instances: usize,
    moved: bool,
    /// The scope of the nodes.
    home: Option<Scope>,
    nodes: Vec<DVec3>,
    node_tags: Tags,
    node_numbers: Vec<u64>,
    elements: Vec<(Shape, u64)>,
    /// The node numbers of all elements: nodes may follow them.
    corners: Vec<u64>,
    /// The element whose nodes continue on the next line.
    open: Vec<u64>,
    unknown: BTreeMap<String, usize>,
    node_sets: Sets,
    element_sets: Sets,
    /// Element sets referenced by solid sections.
    sections: Vec<String>,
    /// Element sets defined by *ELEMENT.
    cards: Vec<String>,
}

impl File {
    /// Processes a keyword, if there is one, and the line at which it starts.
    fn keyword(&mut self, keyword: Option<(usize, String)>) -> ParseResult<()> {
        let Some((line, text)) = keyword else {
            return Ok(());
        };
        let begun = self
            .end_section()
            .and_then(|()| self.begin(&Card::new(&text)));
        begun.map_err(|e| format!("line {line}: {e}"))
    }

    fn begin(&mut self, card: &Card) -> ParseResult<()> {
        if matches!(card.keyword.as_str(), "NODE" | "ELEMENT" | "NSET" | "ELSET")
            && let Some(file) = card.get("INPUT")
        {
            return Err(format!(
                "*{} reads the file {file}; included files are not supported: insert its content \
                here",
                card.keyword
            ));
        }
        self.section = match card.keyword.as_str() {
            "NODE" => self.nodes_card(card)?,
            "ELEMENT" => self.elements_card(card)?,
            "NSET" | "ELSET" => self.set_card(card)?,
            "SOLID SECTION" => {
                self.sections.extend(card.set("ELSET").map(str::to_owned));
                Section::Other
            }
            "PART" => {
                self.parts += 1;
                self.scope = Scope::Part(self.parts);
                Section::Other
            }
            "INSTANCE" => {
                self.instances += 1;
                // Its nodes, if it has any, form a separate part.
                self.scope = Scope::Part(self.parts + self.instances);
                Section::Instance
            }
            "ASSEMBLY" | "END INSTANCE" => {
                self.scope = Scope::Assembly;
                Section::Other
            }
            "END PART" | "END ASSEMBLY" => {
                self.scope = Scope::Flat;
                Section::Other
            }
            "INCLUDE" => {
                return Err(format!(
                    "*INCLUDE names the file {}; included files are not supported: insert its \
                    content here",
                    card.get("INPUT").unwrap_or("?")
                ));
            }
            "NGEN" | "NFILL" | "NCOPY" | "NMAP" | "ELGEN" | "ELCOPY" | "SYSTEM" => {
                return Err(format!(
                    "*{} is not supported; list all nodes and elements explicitly, in rectangular \
                    coordinates",
                    card.keyword
                ));
            }
            _ => Section::Other,
        };
        Ok(())
    }

    /// Whether the following data belong to the mesh; false for a reference point of an assembly.
    fn in_mesh_scope(&mut self) -> ParseResult<bool> {
        if self.scope == Scope::Assembly && self.parts + self.instances > 0 {
            return Ok(false);
        }
        match self.home.replace(self.scope) {
            Some(home) if home != self.scope => {
                Err("several parts with nodes; only one part is supported".into())
            }
            _ => Ok(true),
        }
    }

    fn nodes_card(&mut self, card: &Card) -> ParseResult<Section> {
        if let Some(system) = card.get("SYSTEM").filter(|s| !s.eq_ignore_ascii_case("R")) {
            return Err(format!(
                "*NODE uses coordinate system {system}; only rectangular coordinates are supported"
            ));
        }
        Ok(match self.in_mesh_scope()? {
            false => Section::Other,
            true => Section::Nodes {
                first: self.nodes.len(),
                set: card.set("NSET").map(str::to_owned),
            },
        })
    }

    fn elements_card(&mut self, card: &Card) -> ParseResult<Section> {
        let name = card
            .set("TYPE")
            .ok_or("*ELEMENT has no TYPE; expected TYPE=NAME")?;
        let name = name.to_ascii_uppercase();
        if !self.in_mesh_scope()? {
            return Ok(Section::Other);
        }
        Ok(match shape(&name) {
            None => Section::UnknownElements(name),
            Some(shape) => Section::Elements {
                shape,
                first: self.elements.len(),
                set: card.set("ELSET").map(str::to_owned),
            },
        })
    }

    fn set_card(&mut self, card: &Card) -> ParseResult<Section> {
        let kind = &card.keyword;
        let name = card.set(kind);
        let name = name
            .ok_or_else(|| format!("*{kind} has no name; expected {kind}=NAME"))?
            .to_owned();
        // In an assembly, sets without an instance contain its own reference points.
        let in_assembly = self.scope == Scope::Assembly && self.parts + self.instances > 0;
        if (in_assembly && card.get("INSTANCE").is_none()) || card.get("INTERNAL").is_some() {
            return Ok(Section::Other);
        }
        let generate = card.get("GENERATE").is_some();
        Ok(match kind.as_str() {
            "NSET" => {
                self.node_sets.begin(&name);
                Section::NodeSet { name, generate }
            }
            _ => {
                self.element_sets.begin(&name);
                Section::ElementSet { name, generate }
            }
        })
    }

    fn data(&mut self, text: &[u8]) -> ParseResult<()> {
        let words = text.split(|b| *b == b',').map(<[u8]>::trim_ascii);
        match &self.section {
            Section::Other => Ok(()),
            Section::Instance => {
                self.moved = true;
                Ok(())
            }
            Section::UnknownElements(name) => {
                *self.unknown.entry(name.clone()).or_default() += 1;
                Ok(())
            }
            Section::Nodes { .. } => self.node(words),
            Section::Elements { shape, .. } => {
                let shape = *shape;
                self.element(shape, words)
            }
            Section::NodeSet { name, generate } => {
                self.node_sets.add(name, members(words, *generate)?);
                Ok(())
            }
            Section::ElementSet { name, generate } => {
                self.element_sets.add(name, members(words, *generate)?);
                Ok(())
            }
        }
    }

    fn node<'a>(&mut self, mut words: impl Iterator<Item = &'a [u8]>) -> ParseResult<()> {
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

    fn element<'a>(
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

    fn end_section(&mut self) -> ParseResult<()> {
        match std::mem::take(&mut self.section) {
            Section::Nodes {
                first,
                set: Some(set),
            } => {
                let all = Member::Items(first..self.nodes.len());
                self.node_sets.add(&set, vec![all]);
            }
            Section::Elements { shape, first, set } => {
                if let Some(element) = self.open.first() {
                    return Err(format!(
                        "element {element} before this line lists {} of {} nodes",
                        self.open.len() - 1,
                        shape.nodes
                    ));
                }
                if let Some(set) = set {
                    let all = Member::Items(first..self.elements.len());
                    self.element_sets.add(&set, vec![all]);
                    self.cards.push(set);
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn finish(mut self, bytes: &[u8]) -> ParseResult<RawMesh> {
        self.end_section()
            .map_err(|e| format!("unexpected end of file: {e}"))?;
        if self.nodes.is_empty() {
            return Err("file has no *NODE with nodes".into());
        }
        if self.elements.is_empty() && self.unknown.is_empty() {
            return Err("file has no *ELEMENT with elements".into());
        }
        let mut mesh = RawMesh::default();
        let mut tags = Tags::default();
        let mut repeated = 0;
        let mut corners = self.corners.iter();
        for (shape, element) in &self.elements {
            let mut cell = [0; super::abaqus_elements::MOST_NODES];
            for (place, node) in cell[..shape.nodes].iter_mut().zip(&mut corners) {
                *place = self
                    .node_tags
                    .get(*node)
                    .ok_or_else(|| format!("element {element} refers to undefined node {node}"))?;
            }
            if !tags.push(*element) {
                tags.push_unnamed();
                repeated += 1;
            }
            mesh.cells
                .push(shape.kind, cell[..shape.nodes].iter().copied());
        }
        if repeated > 0 {
            mesh.warnings.push(repeated_numbers(repeated));
        }
        self.warn(&mut mesh.warnings);
        let remarks = Metadata::read(bytes, "** ");
        remarks.check_counts(self.nodes.len(), self.elements.len())?;
        let numbers: Vec<u64> = self.elements.iter().map(|e| e.1).collect();
        mesh.nodes = self.nodes;
        let budget = bytes.len();
        let resolved = self.element_sets.resolve(&tags, &numbers, budget)?;
        resolved.regions(&mut mesh, &remarks, &self.sections, &self.cards);
        let resolved = self
            .node_sets
            .resolve(&self.node_tags, &self.node_numbers, budget)?;
        resolved.node_fields(&mut mesh);
        Ok(mesh)
    }

    fn warn(&self, warnings: &mut Vec<String>) {
        for (name, count) in &self.unknown {
            warnings.push(format!(
                "{count} lines of elements of unknown type {name} skipped"
            ));
        }
        if self.instances > 1 {
            warnings.push(format!(
                "assembly has {} instances; part read once",
                self.instances
            ));
        }
        if self.moved {
            warnings.push(
                "assembly translates or rotates an instance of the part; part read in its own \
                coordinates"
                    .into(),
            );
        }
    }
}
