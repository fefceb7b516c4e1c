//! Abaqus sets of nodes and elements, and the regions defined by element sets.
//!
//! Regions are the sets referenced by solid sections, or those of *ELSET, or those of *ELEMENT: the
//! first of the three that covers the whole volume, or all together if none does. A set of the
//! whole volume is ignored if there are others; an element in several sets belongs to the first.

use super::cursor::ParseResult;
use super::id_map::Tags;
use super::metadata::{Metadata, integer_field};
use super::raw_mesh::RawMesh;
use crate::mesh::{Field, Location, ScalarType};
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// Maximum number of node sets, since each becomes a field.
const MOST_NODE_SETS: usize = 32;

/// Maximum ratio of the items listed by sets to the bytes of the file.
const OVERLAP: usize = 8;

/// A member of a set.
pub(super) enum Member {
    /// By its number.
    One(u64),
    /// By number: first, last, step.
    Range(u64, u64, u64),
    /// All items of another set.
    Named(String),
    /// A range of indices in the file.
    Items(Range<usize>),
}

/// Sets by name, in the order of the file. Names are case-insensitive.
#[derive(Default)]
pub(super) struct Sets {
    index: HashMap<String, usize>,
    sets: Vec<(String, Vec<Member>)>,
}

impl Sets {
    /// Creates a set of that name, possibly empty.
    pub fn begin(&mut self, name: &str) {
        self.add(name, Vec::new());
    }

    pub fn add(&mut self, name: &str, members: Vec<Member>) {
        let next = self.sets.len();
        let at = *self.index.entry(name.to_ascii_uppercase()).or_insert(next);
        if at == next {
            self.sets.push((name.to_owned(), Vec::new()));
        }
        self.sets[at].1.extend(members);
    }

    /// Resolves the items of every set: `tags` maps numbers to indices, `numbers` are the numbers.
    pub fn resolve(&self, tags: &Tags, numbers: &[u64], bytes: usize) -> ParseResult<Resolved> {
        let mut sorted: Vec<(u64, usize)> = numbers.iter().copied().zip(0..).collect();
        sorted.sort_unstable();
        let mut left = OVERLAP * (bytes + 1024);
        let mut sets = Vec::with_capacity(self.sets.len());
        for (at, (name, _)) in self.sets.iter().enumerate() {
            let mut items = Vec::new();
            // Sets may reference each other cyclically.
            let mut seen = vec![at];
            let mut open = vec![at];
            while let Some(at) = open.pop() {
                for member in &self.sets[at].1 {
                    let before = items.len();
                    match member {
                        Member::One(tag) => items.extend(tags.get(*tag)),
                        Member::Range(first, last, step) => {
                            let start = sorted.partition_point(|(tag, _)| tag < first);
                            let within = sorted[start..].iter().take_while(|(tag, _)| tag <= last);
                            let mut looked = 0;
                            for (tag, item) in within {
                                looked += 1;
                                if (tag - first).is_multiple_of(*step) {
                                    items.push(*item);
                                }
                            }
                            left = left.checked_sub(looked).ok_or_else(too_many)?;
                        }
                        Member::Items(range) => items.extend(range.clone()),
                        Member::Named(name) => {
                            let named = self.index.get(&name.to_ascii_uppercase());
                            if let Some(other) = named.filter(|o| !seen.contains(o)) {
                                seen.push(*other);
                                open.push(*other);
                            }
                            left = left.checked_sub(seen.len()).ok_or_else(too_many)?;
                        }
                    }
                    let found = items.len() - before + 1;
                    left = left.checked_sub(found).ok_or_else(too_many)?;
                }
            }
            sets.push((name.clone(), items));
        }
        Ok(Resolved {
            index: self.index.clone(),
            sets,
        })
    }
}

fn too_many() -> String {
    "sets contain too many repeated items".into()
}

/// Sets with their items.
pub(super) struct Resolved {
    index: HashMap<String, usize>,
    sets: Vec<(String, Vec<usize>)>,
}

impl Resolved {
    fn find(&self, name: &str) -> Option<usize> {
        self.index.get(&name.to_ascii_uppercase()).copied()
    }

    /// Adds the field `label` and the names of regions to `mesh`. `sections` and `cards` are the
    /// sets referenced by solid sections and defined by *ELEMENT.
    pub fn regions(
        &self,
        mesh: &mut RawMesh,
        remarks: &Metadata,
        sections: &[String],
        cards: &[String],
    ) {
        let (_, solid) = mesh.volumetric();
        if !remarks.regions.is_empty() {
            let mut groups = vec![0.0; solid.len()];
            for (group, region) in &remarks.regions {
                let set = region.set.as_ref().and_then(|set| self.find(set));
                for item in set.map_or(&[][..], |set| &self.sets[set].1) {
                    groups[*item] = *group as f64;
                }
            }
            remarks.add_to(mesh, &groups);
            return;
        }
        remarks.add_to(mesh, &[]);
        let named = |names: &[String]| -> Vec<usize> {
            let mut found: Vec<usize> = names.iter().filter_map(|n| self.find(n)).collect();
            found.sort_unstable();
            found.dedup();
            found
        };
        let (sections, cards) = (named(sections), named(cards));
        let lists: Vec<usize> = (0..self.sets.len())
            .filter(|set| cards.binary_search(set).is_err())
            .collect();
        let mut taken = HashSet::new();
        let all: Vec<usize> = [&sections, &lists, &cards]
            .into_iter()
            .flatten()
            .copied()
            .filter(|set| taken.insert(*set))
            .collect();
        let choices = [sections, lists, cards, all];
        let chosen = choices
            .iter()
            .map(|sets| self.labels(sets, &solid))
            .find(|labels| labels.covers(&solid));
        let labels = chosen.unwrap_or_else(|| self.labels(&choices[3], &solid));
        if labels.used.is_empty() {
            return;
        }
        if labels.shared > 0 {
            mesh.warnings.push(format!(
                "{} elements are in several sets; the first set is used as their region",
                labels.shared
            ));
        }
        mesh.region_names = labels
            .used
            .iter()
            .zip(1..)
            .map(|(set, label)| (label, self.sets[*set].0.clone()))
            .collect();
        mesh.fields.push(integer_field("label", labels.of_cell));
    }

    /// Labels cells by the first of `sets` that contains them, numbered from 1 over the sets with
    /// volume.
    fn labels(&self, sets: &[usize], solid: &[bool]) -> Labels {
        let whole = solid.iter().filter(|s| **s).count();
        // Number of distinct cells with volume in each set.
        let mut seen = vec![usize::MAX; solid.len()];
        let mut counted: Vec<(usize, usize)> = Vec::new();
        for set in sets {
            let mut cells = 0;
            for item in &self.sets[*set].1 {
                if solid[*item] && seen[*item] != *set {
                    seen[*item] = *set;
                    cells += 1;
                }
            }
            counted.push((*set, cells));
        }
        let parts = counted.iter().any(|(_, cells)| (1..whole).contains(cells));
        counted.retain(|(_, cells)| *cells > 0 && !(parts && *cells == whole));
        let mut labels = Labels {
            used: Vec::new(),
            of_cell: vec![0.0; solid.len()],
            shared: 0,
        };
        for (set, _) in counted {
            let label = labels.used.len() as f64 + 1.0;
            let (mut took, mut shared) = (false, 0);
            for item in self.sets[set].1.iter().filter(|item| solid[**item]) {
                let place = &mut labels.of_cell[*item];
                if *place == 0.0 {
                    *place = label;
                    took = true;
                } else if *place != label {
                    shared += 1;
                }
            }
            labels.shared += shared;
            if took {
                labels.used.push(set);
            }
        }
        labels
    }

    /// Adds a field of 0 and 1 for each node set that is neither empty nor complete.
    pub fn node_fields(self, mesh: &mut RawMesh) {
        let nodes = mesh.nodes.len();
        let mut left = 0;
        let mut kept = 0;
        for (name, mut items) in self.sets {
            items.sort_unstable();
            items.dedup();
            if items.is_empty() || items.len() == nodes {
                continue;
            }
            if kept == MOST_NODE_SETS {
                left += 1;
                continue;
            }
            let mut values = vec![0.0; nodes];
            items.iter().for_each(|i| values[*i] = 1.0);
            kept += 1;
            mesh.fields.push(Field {
                name: format!("nset:{name}"),
                location: Location::Node,
                components: 1,
                values,
                scalar_type: ScalarType::U8,
            });
        }
        if left > 0 {
            mesh.warnings.push(format!(
                "{left} node sets after the first {MOST_NODE_SETS} skipped"
            ));
        }
    }
}

/// The label of each cell, 0 for none.
struct Labels {
    /// The set of each label, from 1 on.
    used: Vec<usize>,
    of_cell: Vec<f64>,
    /// Number of cells that were also in a further set.
    shared: usize,
}

impl Labels {
    /// Whether every cell with volume has a label.
    fn covers(&self, solid: &[bool]) -> bool {
        let mut cells = self.of_cell.iter().zip(solid);
        cells.all(|(label, solid)| !solid || *label != 0.0)
    }
}
