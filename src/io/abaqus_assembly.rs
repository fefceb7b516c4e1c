//! Assemblies of Abaqus input files: where the instances of parts are, and their sets.
//!
//! Every instance is a copy of its part at its own place. Copies of a part share its regions and node
//! sets. If there are several parts, elements in no set form a region with the name of their part,
//! and sets of the same name in different parts are called PART.SET.

use super::abaqus_part::{Part, PartMesh};
use super::abaqus_sets::{Resolved, Sets, most_items, spend};
use super::cursor::{ParseResult, number};
use super::id_map::repeated_numbers;
use super::metadata::{Metadata, integer_field};
use super::raw_mesh::RawMesh;
use crate::mesh::{Field, Location, ScalarType};
use glam::{DQuat, DVec3};
use std::collections::HashMap;

/// Maximum number of node sets, since each becomes a field.
const MAX_NODE_SETS: usize = 32;

/// Maximum number of nodes and elements of all copies of parts, since a short file may ask for many.
const MAX_COPIED_ITEMS: usize = 1 << 24;

/// A copy of a part in the assembly.
#[derive(Default)]
pub(super) struct Instance {
    pub name: String,
    /// The name of its part.
    pub part: String,
    /// The index of its own mesh, if it has one.
    pub own: Option<usize>,
    /// The file with its mesh, if that is a result of Abaqus.
    pub library: Option<String>,
    pub translation: Option<DVec3>,
    /// A point of the axis, and the rotation.
    pub rotation: Option<(DVec3, DQuat)>,
    /// Sets in addition to those of the part.
    pub node_sets: Sets,
    pub element_sets: Sets,
}

impl Instance {
    /// Reads a data line: a translation; then two points of an axis and an angle in degrees.
    pub fn place<'a>(&mut self, words: impl Iterator<Item = &'a [u8]>) -> ParseResult<()> {
        let mut values = Vec::new();
        for word in words.take(8) {
            let value = match word {
                b"" => Some(0.0),
                _ => number(word).filter(|v| v.is_finite()),
            };
            values.push(value.ok_or_else(|| {
                format!(
                    "position of instance \"{}\" has {}, expected a number",
                    self.name,
                    super::abaqus_lines::shown(word)
                )
            })?);
        }
        // A comma may end the line.
        if matches!(values.len(), 4 | 8) && values.last() == Some(&0.0) {
            values.pop();
        }
        let point = |i: usize| DVec3::new(values[i], values[i + 1], values[i + 2]);
        if values.len() <= 3 && self.translation.is_none() && self.rotation.is_none() {
            values.resize(3, 0.0);
            self.translation = Some(DVec3::new(values[0], values[1], values[2]));
        } else if values.len() == 7 && self.rotation.is_none() {
            let angle = values[6].to_radians();
            let axis = (point(3) - point(0)).try_normalize();
            let axis = match axis {
                Some(axis) => axis,
                None if angle == 0.0 => DVec3::Z,
                None => {
                    return Err(format!(
                        "instance \"{}\" is rotated about an axis of length 0; expected two \
                        distinct points",
                        self.name
                    ));
                }
            };
            self.rotation = Some((point(0), DQuat::from_axis_angle(axis, angle)));
        } else {
            return Err(format!(
                "position of instance \"{}\" has a line of {} numbers; expected a translation (3 \
                numbers), then a rotation (7 numbers)",
                self.name,
                values.len()
            ));
        }
        Ok(())
    }

    /// Returns the position of a point of the part in the assembly: translated, then rotated.
    fn apply(&self, point: DVec3) -> DVec3 {
        let moved = match self.translation {
            Some(translation) => point + translation,
            None => point,
        };
        match self.rotation {
            Some((origin, rotation)) => origin + rotation * (moved - origin),
            None => moved,
        }
    }
}

/// A part and its instances; none for a part at its own place.
struct Group<'a> {
    part: usize,
    instances: Vec<&'a Instance>,
}

/// A set in the assembled mesh.
struct NamedSet {
    /// The part that defines it; `None` for a set of the assembly.
    part: Option<usize>,
    name: String,
    items: Vec<usize>,
}

/// Returns the parts to read, in the order of their instances.
fn groups<'a>(
    parts: &[Part],
    instances: &'a [Instance],
    warnings: &mut Vec<String>,
) -> ParseResult<Vec<Group<'a>>> {
    let filled = |part: usize| !parts[part].nodes.is_empty();
    let mut by_name = HashMap::new();
    for (i, part) in parts.iter().enumerate().skip(1).rev() {
        by_name.insert(part.name.to_ascii_uppercase(), i);
    }
    let mut groups: Vec<Group> = Vec::new();
    let mut group_of: HashMap<usize, usize> = HashMap::new();
    if filled(0) || instances.is_empty() {
        let alone = match instances.is_empty() {
            true => 0..parts.len(),
            false => 0..1,
        };
        groups.extend(alone.filter(|p| filled(*p)).map(|part| Group {
            part,
            instances: Vec::new(),
        }));
        if groups.len() > 1 && instances.is_empty() {
            warnings.push(format!(
                "file has {} parts and no *ASSEMBLY; parts read in their own coordinates",
                groups.len()
            ));
        }
    }
    for instance in instances {
        let part = instance
            .own
            .or_else(|| by_name.get(&instance.part.to_ascii_uppercase()).copied());
        let Some(part) = part else {
            if let Some(library) = &instance.library {
                warnings.push(format!(
                    "instance \"{}\" skipped: its mesh is in the Abaqus results {library}",
                    instance.name
                ));
                continue;
            }
            return Err(format!(
                "instance \"{}\" is of part \"{}\", which the file does not define",
                instance.name, instance.part
            ));
        };
        if filled(part) {
            let next = groups.len();
            let at = *group_of.entry(part).or_insert(next);
            if at == next {
                groups.push(Group {
                    part,
                    instances: Vec::new(),
                });
            }
            groups[at].instances.push(instance);
        }
    }
    for (i, part) in parts.iter().enumerate().skip(1) {
        if filled(i) && !instances.is_empty() && !group_of.contains_key(&i) {
            warnings.push(format!(
                "part \"{}\" skipped: it has no instance in the assembly",
                part.name
            ));
        }
    }
    Ok(groups)
}

/// Assembles the mesh of a file of `bytes` with these remarks.
pub(super) fn assemble(
    mut parts: Vec<Part>,
    instances: &[Instance],
    remarks: &Metadata,
    bytes: usize,
) -> ParseResult<RawMesh> {
    let mut mesh = RawMesh::default();
    let groups = groups(&parts, instances, &mut mesh.warnings)?;
    let mut placed = 0usize;
    for group in &groups {
        let part = &parts[group.part];
        let copies = group.instances.len().max(1);
        let items = (part.nodes.len() + part.elements.len()).saturating_mul(copies);
        placed = placed.saturating_add(items);
    }
    let stored: usize = parts.iter().map(|p| p.nodes.len() + p.elements.len()).sum();
    if placed > stored.max(MAX_COPIED_ITEMS) {
        return Err(format!(
            "instances of parts have {placed} nodes and elements together, more than {MAX_COPIED_ITEMS}; \
            remove instances"
        ));
    }
    let mut left = most_items(bytes, placed);
    let mut content = Content::default();
    let mut repeated = 0;
    for group in &groups {
        let part = parts[group.part].take_mesh()?;
        repeated += part.repeated;
        content.add(&mut mesh, &parts[group.part], &part, group, &mut left)?;
    }
    if repeated > 0 {
        mesh.warnings.push(repeated_numbers(repeated));
    }
    content.regions(&mut mesh, &parts, remarks);
    content.node_fields(&mut mesh, &parts);
    Ok(mesh)
}

/// The sets of the assembled mesh.
#[derive(Default)]
struct Content {
    /// For each part that is read: its index, its first cell, and its sets of elements by index among
    /// its cells. Those from `own` on are of the assembly.
    elements: Vec<(usize, usize, Resolved, usize)>,
    nodes: Vec<NamedSet>,
    /// Those of the assembly, by name.
    assembly_nodes: HashMap<String, usize>,
}

impl Content {
    /// Adds all copies of a part.
    fn add(
        &mut self,
        mesh: &mut RawMesh,
        part: &Part,
        content: &PartMesh,
        group: &Group,
        left: &mut usize,
    ) -> ParseResult<()> {
        let (first_node, first_cell) = (mesh.nodes.len(), mesh.cells.len());
        let still = Instance::default();
        let copies = match group.instances.is_empty() {
            true => vec![&still],
            false => group.instances.clone(),
        };
        for copy in &copies {
            let start = mesh.nodes.len();
            mesh.nodes
                .extend(content.nodes.iter().map(|p| copy.apply(*p)));
            for (kind, nodes) in content.cells.iter() {
                let nodes = nodes.iter().map(|v| start + *v as usize);
                mesh.cells.push(kind, nodes);
            }
        }
        let sets = part
            .element_sets
            .resolve(&content.element_numbers, None, left)?;
        let mut all = Resolved::default();
        for set in &sets.sets {
            let items = repeat(&set.1, content.cells.len(), copies.len(), left)?;
            all.push(set.0.clone(), items);
        }
        let own = all.sets.len();
        let mut added = Additions::default();
        for (k, copy) in copies.iter().enumerate() {
            let of_copy = copy
                .element_sets
                .resolve(&content.element_numbers, Some(&sets), left)?;
            added.add(of_copy, k * content.cells.len());
        }
        for (name, items) in added.sets {
            all.push(name, items);
        }
        self.elements.push((group.part, first_cell, all, own));

        let sets = part.node_sets.resolve(&content.node_numbers, None, left)?;
        let mut added = Additions::default();
        for (k, copy) in copies.iter().enumerate() {
            let of_copy = copy
                .node_sets
                .resolve(&content.node_numbers, Some(&sets), left)?;
            added.add(of_copy, first_node + k * content.nodes.len());
        }
        for (name, items) in sets.sets {
            let mut items = repeat(&items, content.nodes.len(), copies.len(), left)?;
            items.iter_mut().for_each(|i| *i += first_node);
            self.nodes.push(NamedSet {
                part: Some(group.part),
                name,
                items,
            });
        }
        for (name, items) in added.sets {
            let next = self.nodes.len();
            let index = &mut self.assembly_nodes;
            let at = *index.entry(name.to_ascii_uppercase()).or_insert(next);
            if at == next {
                self.nodes.push(NamedSet {
                    part: None,
                    name,
                    items,
                });
            } else {
                self.nodes[at].items.extend(items);
            }
        }
        Ok(())
    }

    /// Adds the field `label` and the names of regions.
    fn regions(&self, mesh: &mut RawMesh, parts: &[Part], remarks: &Metadata) {
        let (_, solid) = mesh.volumetric();
        if !remarks.regions.is_empty() {
            let mut groups = vec![0.0; solid.len()];
            for (_, first, sets, _) in &self.elements {
                for (group, region) in &remarks.regions {
                    let set = region.set.as_ref().and_then(|set| sets.find(set));
                    for item in set.map_or(&[][..], |set| &sets.sets[set].1) {
                        groups[first + item] = *group as f64;
                    }
                }
            }
            remarks.add_to(mesh, &groups);
            return;
        }
        remarks.add_to(mesh, &[]);
        let ends = self.elements.iter().skip(1).map(|e| e.1);
        let ends: Vec<usize> = ends.chain([solid.len()]).collect();
        let filled = |range: std::ops::Range<usize>| solid[range].contains(&true);
        let with_volume = self
            .elements
            .iter()
            .zip(&ends)
            .filter(|(e, end)| filled(e.1..**end))
            .count();
        let mut keys: Vec<(Option<usize>, String)> = Vec::new();
        let mut number_of: HashMap<(Option<usize>, String), usize> = HashMap::new();
        let mut number = |part: Option<usize>, name: &str| -> f64 {
            let key = (part, name.to_ascii_uppercase());
            *number_of.entry(key).or_insert_with(|| {
                keys.push((part, name.to_owned()));
                keys.len()
            }) as f64
        };
        let mut values = Vec::with_capacity(solid.len());
        let mut shared = 0;
        for ((part, first, sets, own), end) in self.elements.iter().zip(&ends) {
            let solid = &solid[*first..*end];
            let labels = sets.regions(solid, &parts[*part].sections, &parts[*part].cards);
            shared += labels.shared;
            let numbers: Vec<f64> = labels
                .used
                .iter()
                .map(|set| number((set < own).then_some(*part), &sets.sets[*set].0))
                .collect();
            for (label, solid) in labels.of_cell.iter().zip(solid) {
                values.push(match *label as usize {
                    // The part itself; no set has an empty name.
                    0 if *solid && with_volume > 1 => number(Some(*part), ""),
                    0 => 0.0,
                    label => numbers[label - 1],
                });
            }
        }
        if keys.is_empty() {
            return;
        }
        if shared > 0 {
            mesh.warnings.push(format!(
                "{shared} elements are in several sets; the first set is used as their region"
            ));
        }
        mesh.region_names = (1..).zip(unique_names(&keys, parts)).collect();
        mesh.fields.push(integer_field("label", values));
    }

    /// Adds a field of 0 and 1 for each node set that is neither empty nor complete.
    fn node_fields(self, mesh: &mut RawMesh, parts: &[Part]) {
        let nodes = mesh.nodes.len();
        let mut sets = self.nodes;
        for set in &mut sets {
            set.items.sort_unstable();
            set.items.dedup();
        }
        sets.retain(|set| !set.items.is_empty() && set.items.len() < nodes);
        if sets.len() > MAX_NODE_SETS {
            mesh.warnings.push(format!(
                "{} node sets after the first {MAX_NODE_SETS} skipped",
                sets.len() - MAX_NODE_SETS
            ));
            sets.truncate(MAX_NODE_SETS);
        }
        let keys: Vec<_> = sets.iter().map(|s| (s.part, s.name.clone())).collect();
        for (set, name) in sets.iter().zip(unique_names(&keys, parts)) {
            let mut values = vec![0.0; nodes];
            set.items.iter().for_each(|i| values[*i] = 1.0);
            mesh.fields.push(Field {
                name: format!("nset:{name}"),
                location: Location::Node,
                components: 1,
                values,
                scalar_type: ScalarType::U8,
            });
        }
    }
}

/// Returns the indices of a set of a part in all of its copies.
fn repeat(
    items: &[usize],
    size: usize,
    copies: usize,
    left: &mut usize,
) -> ParseResult<Vec<usize>> {
    spend(left, items.len().saturating_mul(copies - 1))?;
    let copies = 0..copies;
    Ok(copies
        .flat_map(|k| items.iter().map(move |i| k * size + i))
        .collect())
}

/// Sets of several copies, joined by name.
#[derive(Default)]
struct Additions {
    index: HashMap<String, usize>,
    sets: Vec<(String, Vec<usize>)>,
}

impl Additions {
    fn add(&mut self, resolved: Resolved, offset: usize) {
        for (name, items) in resolved.sets {
            let next = self.sets.len();
            let at = *self.index.entry(name.to_ascii_uppercase()).or_insert(next);
            if at == next {
                self.sets.push((name, Vec::new()));
            }
            self.sets[at].1.extend(items.iter().map(|i| i + offset));
        }
    }
}

/// Returns the names of sets; those that several parts use are preceded by the name of the part. An
/// empty name stands for the part itself.
fn unique_names(keys: &[(Option<usize>, String)], parts: &[Part]) -> Vec<String> {
    let part_name = |part: Option<usize>| match part {
        Some(part) if !parts[part].name.is_empty() => parts[part].name.clone(),
        Some(_) => "model".into(),
        None => "assembly".into(),
    };
    let mut uses: HashMap<String, usize> = HashMap::new();
    for (part, name) in keys {
        let name = match name.as_str() {
            "" => part_name(*part),
            _ => name.clone(),
        };
        *uses.entry(name.to_ascii_uppercase()).or_default() += 1;
    }
    keys.iter()
        .map(|(part, name)| match name.as_str() {
            "" => part_name(*part),
            _ if uses[&name.to_ascii_uppercase()] > 1 => format!("{}.{name}", part_name(*part)),
            _ => name.clone(),
        })
        .collect()
}
