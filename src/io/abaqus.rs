//! Reader for Abaqus input files (`.inp`), also used by CalculiX: nodes, elements with or without
//! volume, and sets.
//!
//! Element sets become regions: the field `label` numbers them from 1, and the regions have their
//! names (see [`super::abaqus_sets`]). Node sets become fields `nset:NAME` of 0 and 1. Parts are
//! placed where the assembly has them (see [`super::abaqus_assembly`]); anything else than the mesh
//! (materials, steps, contacts) is skipped.

use super::abaqus_assembly::{Instance, assemble};
use super::abaqus_elements::{Shape, shape};
use super::abaqus_include::Lines;
use super::abaqus_lines::{Card, instance_member, members};
use super::abaqus_part::Part;
use super::abaqus_sets::{Member, Sets};
use super::cursor::ParseResult;
use super::metadata::Metadata;
use super::raw_mesh::RawMesh;
use std::collections::{BTreeMap, HashMap};

/// Whether `bytes` begin, after comments, with a keyword that can begin an input file.
pub(super) fn is_abaqus(bytes: &[u8]) -> bool {
    let mut lines = bytes.split(|b| *b == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"**"));
    let word = first.and_then(|line| line.split(|b| *b == b',').next());
    let word = word.unwrap_or_default().trim_ascii().to_ascii_uppercase();
    let first = [
        &b"*HEADING"[..],
        b"*NODE",
        b"*PART",
        b"*INCLUDE",
        b"*ELEMENT",
        b"*PREPRINT",
        b"*PARAMETER",
        b"*ASSEMBLY",
    ];
    first.contains(&word.as_slice())
}

/// Reads the content of an `.inp` file, in which included files are inserted
/// ([`super::abaqus_include`]).
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut file = File::default();
    // A keyword line that ends with a comma continues on the next line.
    let mut open: Option<(String, String)> = None;
    let mut lines = Lines::default();
    for text in bytes.split(|b| *b == b'\n') {
        let text = text.trim_ascii();
        if !lines.next(text) {
            continue;
        }
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
                    open = Some((lines.position(), words().into_owned()));
                } else {
                    let read = file.data(text);
                    read.map_err(|e| format!("{}: {e}", lines.position()))?;
                }
            }
        }
    }
    file.keyword(open)?;
    file.finish(bytes)
}

/// Maximum length of a keyword with all its lines, in characters.
const LONGEST_KEYWORD: usize = 1 << 14;

/// Owner of a set.
#[derive(Clone, Copy)]
enum Owner {
    Part(usize),
    /// A set of the n-th instance.
    Instance(usize),
    /// A set of the assembly, whose members name their instance.
    Assembly,
}

/// Meaning of the data lines that follow.
#[derive(Default)]
enum Section {
    #[default]
    Other,
    Nodes {
        part: usize,
        first: usize,
        set: Option<String>,
    },
    Elements {
        part: usize,
        shape: Shape,
        first: usize,
        set: Option<String>,
    },
    /// Elements of unknown type, by name.
    UnknownElements(String),
    Set {
        of_nodes: bool,
        owner: Owner,
        name: String,
        generate: bool,
    },
    Instance(usize),
}

/// Scope of a keyword.
#[derive(Clone, Copy, PartialEq)]
enum Scope {
    /// In the n-th part; outside of parts, in the first.
    Part(usize),
    Instance(usize),
    Assembly,
}

struct File {
    section: Section,
    scope: Scope,
    /// The first is what the file has outside of parts.
    parts: Vec<Part>,
    instances: Vec<Instance>,
    instance_of: HashMap<String, usize>,
    unknown: BTreeMap<String, usize>,
}

impl Default for File {
    fn default() -> File {
        File {
            section: Section::Other,
            scope: Scope::Part(0),
            parts: vec![Part::default()],
            instances: Vec::new(),
            instance_of: HashMap::new(),
            unknown: BTreeMap::new(),
        }
    }
}

impl File {
    /// Processes a keyword, if there is one, and the position at which it starts.
    fn keyword(&mut self, keyword: Option<(String, String)>) -> ParseResult<()> {
        let Some((position, text)) = keyword else {
            return Ok(());
        };
        let begun = self
            .end_section()
            .and_then(|()| self.begin(&Card::new(&text)));
        begun.map_err(|e| format!("{position}: {e}"))
    }

    fn begin(&mut self, card: &Card) -> ParseResult<()> {
        let included = match card.keyword.as_str() {
            "NODE" | "ELEMENT" | "NSET" | "ELSET" | "INCLUDE" => card.get("INPUT"),
            _ => None,
        };
        if let Some(file) = included {
            return Err(format!(
                "*{} needs the file {file}, but this is a single file in memory; insert its \
                content here",
                card.keyword
            ));
        }
        self.section = match card.keyword.as_str() {
            "NODE" => self.nodes_card(card)?,
            "ELEMENT" => self.elements_card(card)?,
            "NSET" | "ELSET" => self.set_card(card)?,
            "SOLID SECTION" => {
                if let (Some(part), Some(set)) = (self.part(), card.set("ELSET")) {
                    self.parts[part].sections.push(set.to_owned());
                }
                Section::Other
            }
            "PART" => {
                let name = card.set("NAME").unwrap_or("part");
                self.scope = Scope::Part(self.parts.len());
                self.parts.push(Part::new(name));
                Section::Other
            }
            "INSTANCE" => self.instance_card(card),
            "ASSEMBLY" | "END INSTANCE" => {
                self.scope = Scope::Assembly;
                Section::Other
            }
            "END PART" | "END ASSEMBLY" => {
                self.scope = Scope::Part(0);
                Section::Other
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

    fn instance_card(&mut self, card: &Card) -> Section {
        let index = self.instances.len();
        let name = card.set("NAME").or_else(|| card.set("INSTANCE"));
        let name = name.map_or_else(|| format!("instance {}", index + 1), str::to_owned);
        self.instance_of
            .entry(name.to_ascii_uppercase())
            .or_insert(index);
        self.instances.push(Instance {
            name,
            part: card.set("PART").unwrap_or_default().to_owned(),
            library: card.set("LIBRARY").map(str::to_owned),
            ..Instance::default()
        });
        self.scope = Scope::Instance(index);
        Section::Instance(index)
    }

    /// Whether the file has parts, so that an assembly has only reference points of its own.
    fn has_parts(&self) -> bool {
        self.parts.len() > 1 || !self.instances.is_empty()
    }

    /// Returns the part whose mesh the following data describe; `None` in an assembly, and in an
    /// instance without a mesh of its own.
    fn part(&self) -> Option<usize> {
        match self.scope {
            Scope::Part(part) => Some(part),
            Scope::Instance(instance) => self.instances[instance].own,
            Scope::Assembly => (!self.has_parts()).then_some(0),
        }
    }

    /// As [`File::part`]; an instance receives a mesh of its own.
    fn part_to_fill(&mut self) -> Option<usize> {
        if let Scope::Instance(instance) = self.scope {
            let instance = &mut self.instances[instance];
            if instance.own.is_none() {
                instance.own = Some(self.parts.len());
                self.parts.push(Part::new(&instance.name));
            }
        }
        self.part()
    }

    fn nodes_card(&mut self, card: &Card) -> ParseResult<Section> {
        if let Some(system) = card.get("SYSTEM").filter(|s| !s.eq_ignore_ascii_case("R")) {
            return Err(format!(
                "*NODE uses coordinate system {system}; only rectangular coordinates are supported"
            ));
        }
        Ok(match self.part_to_fill() {
            None => Section::Other,
            Some(part) => Section::Nodes {
                part,
                first: self.parts[part].nodes.len(),
                set: card.set("NSET").map(str::to_owned),
            },
        })
    }

    fn elements_card(&mut self, card: &Card) -> ParseResult<Section> {
        let name = card
            .set("TYPE")
            .ok_or("*ELEMENT has no TYPE; expected TYPE=NAME")?;
        let name = name.to_ascii_uppercase();
        let Some(part) = self.part_to_fill() else {
            return Ok(Section::Other);
        };
        Ok(match shape(&name) {
            None => Section::UnknownElements(name),
            Some(shape) => Section::Elements {
                part,
                shape,
                first: self.parts[part].elements.len(),
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
        if card.get("INTERNAL").is_some() {
            return Ok(Section::Other);
        }
        let owner = match (self.part(), card.set("INSTANCE"), self.scope) {
            (_, Some(instance), _) => self
                .instance_of
                .get(&instance.to_ascii_uppercase())
                .map(|i| Owner::Instance(*i)),
            (Some(part), ..) => Some(Owner::Part(part)),
            (None, None, Scope::Instance(instance)) => Some(Owner::Instance(instance)),
            _ => Some(Owner::Assembly),
        };
        let Some(owner) = owner else {
            return Ok(Section::Other);
        };
        let of_nodes = kind == "NSET";
        if let Some(sets) = self.sets(owner, of_nodes) {
            sets.begin(&name);
        }
        Ok(Section::Set {
            of_nodes,
            owner,
            name,
            generate: card.get("GENERATE").is_some(),
        })
    }

    fn sets(&mut self, owner: Owner, of_nodes: bool) -> Option<&mut Sets> {
        match owner {
            Owner::Part(part) => {
                let part = &mut self.parts[part];
                Some(match of_nodes {
                    true => &mut part.node_sets,
                    false => &mut part.element_sets,
                })
            }
            Owner::Instance(instance) => {
                let instance = &mut self.instances[instance];
                Some(match of_nodes {
                    true => &mut instance.node_sets,
                    false => &mut instance.element_sets,
                })
            }
            Owner::Assembly => None,
        }
    }

    fn data(&mut self, text: &[u8]) -> ParseResult<()> {
        let words = text.split(|b| *b == b',').map(<[u8]>::trim_ascii);
        match &self.section {
            Section::Other => Ok(()),
            Section::Instance(instance) => self.instances[*instance].place(words),
            Section::UnknownElements(name) => {
                *self.unknown.entry(name.clone()).or_default() += 1;
                Ok(())
            }
            Section::Nodes { part, .. } => self.parts[*part].node(words),
            Section::Elements { part, shape, .. } => self.parts[*part].element(*shape, words),
            Section::Set {
                of_nodes,
                owner,
                name,
                generate,
            } => {
                let (of_nodes, owner, name) = (*of_nodes, *owner, name.clone());
                if matches!(owner, Owner::Assembly) {
                    self.assembly_members(of_nodes, &name, words);
                    return Ok(());
                }
                let members = members(words, *generate)?;
                if let Some(sets) = self.sets(owner, of_nodes) {
                    sets.add(&name, members);
                }
                Ok(())
            }
        }
    }

    /// Adds INSTANCE.NUMBER and INSTANCE.SET to the sets of these instances, and sets of the assembly
    /// to those of the instances that have them; other numbers are reference points of the assembly.
    fn assembly_members<'a>(
        &mut self,
        of_nodes: bool,
        name: &str,
        words: impl Iterator<Item = &'a [u8]>,
    ) {
        for word in words.filter(|word| !word.is_empty()) {
            let (instance, member) = instance_member(word);
            let within = match (instance, &member) {
                (Some(instance), _) => {
                    let known = self.instance_of.get(&instance.to_ascii_uppercase());
                    known.map_or(0..0, |i| *i..*i + 1)
                }
                (None, Member::Named(_)) => 0..self.instances.len(),
                (None, _) => 0..0,
            };
            let one = within.len() == 1;
            for instance in within {
                let Some(sets) = self.sets(Owner::Instance(instance), of_nodes) else {
                    continue;
                };
                let has = |set: &str| sets.contains(set);
                if one || matches!(&member, Member::Named(set) if has(set)) {
                    sets.add(name, vec![member.clone()]);
                }
            }
        }
    }

    fn end_section(&mut self) -> ParseResult<()> {
        match std::mem::take(&mut self.section) {
            Section::Nodes { part, first, set } => {
                self.parts[part].end_nodes(first, set.as_deref());
                Ok(())
            }
            Section::Elements {
                part,
                shape,
                first,
                set,
            } => self.parts[part].end_elements(shape, first, set.as_deref()),
            _ => Ok(()),
        }
    }

    fn finish(mut self, bytes: &[u8]) -> ParseResult<RawMesh> {
        self.end_section()
            .map_err(|e| format!("unexpected end of file: {e}"))?;
        if self.parts.iter().all(|part| part.nodes.is_empty()) {
            return Err("file has no *NODE with nodes".into());
        }
        if self.parts.iter().all(|part| part.elements.is_empty()) && self.unknown.is_empty() {
            return Err("file has no *ELEMENT with elements".into());
        }
        let remarks = Metadata::read(bytes, "** ");
        let mut mesh = assemble(self.parts, &self.instances, &remarks, bytes.len())?;
        for (name, count) in &self.unknown {
            mesh.warnings.push(format!(
                "{count} lines of elements of unknown type {name} skipped"
            ));
        }
        remarks.check_counts(mesh.nodes.len(), mesh.cells.len())?;
        Ok(mesh)
    }
}
