//! Abaqus sets of nodes and elements, and the regions defined by element sets.
//!
//! Regions of a part are the sets referenced by solid sections, or those of *ELSET, or those of
//! *ELEMENT: the first of the three that covers its whole volume, or all together if none does. A
//! set of the whole volume is ignored if there are others; an element in several sets belongs to the
//! first. See [`super::abaqus_assembly`] for several parts.

use super::cursor::ParseResult;
use super::id_map::Tags;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// Maximum ratio of the items listed by sets to the bytes of the file.
const OVERLAP: usize = 8;

/// A member of a set.
#[derive(Clone)]
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

    pub fn contains(&self, name: &str) -> bool {
        self.index.contains_key(&name.to_ascii_uppercase())
    }

    pub fn add(&mut self, name: &str, members: Vec<Member>) {
        let next = self.sets.len();
        let at = *self.index.entry(name.to_ascii_uppercase()).or_insert(next);
        if at == next {
            self.sets.push((name.to_owned(), Vec::new()));
        }
        self.sets[at].1.extend(members);
    }

    /// Resolves the items of every set; sets that are not among these may be in `outer`. `left` limits
    /// the number of items.
    pub fn resolve(
        &self,
        numbers: &Numbers,
        outer: Option<&Resolved>,
        left: &mut usize,
    ) -> ParseResult<Resolved> {
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
                        Member::One(tag) => items.extend(numbers.tags.get(*tag)),
                        Member::Range(first, last, step) => {
                            let looked = numbers.find(*first, *last, *step, &mut items);
                            spend(left, looked)?;
                        }
                        Member::Items(range) => items.extend(range.clone()),
                        Member::Named(name) => {
                            match self.index.get(&name.to_ascii_uppercase()) {
                                Some(other) if !seen.contains(other) => {
                                    seen.push(*other);
                                    open.push(*other);
                                }
                                Some(_) => {}
                                None => {
                                    let set = outer.and_then(|o| Some(&o.sets[o.find(name)?].1));
                                    items.extend(set.into_iter().flatten());
                                }
                            }
                            spend(left, seen.len())?;
                        }
                    }
                    spend(left, items.len() - before + 1)?;
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

/// Maximum number of items in the sets of a file of `bytes` that describes `items` items.
pub(super) fn most_items(bytes: usize, items: usize) -> usize {
    OVERLAP.saturating_mul(bytes.saturating_add(items).saturating_add(1024))
}

/// Subtracts `items` from the number of items that sets may still have.
pub(super) fn spend(left: &mut usize, items: usize) -> ParseResult<()> {
    *left = left
        .checked_sub(items)
        .ok_or("sets contain too many repeated items")?;
    Ok(())
}

/// The numbers of nodes or elements of a part, by index.
pub(super) struct Numbers {
    pub tags: Tags,
    sorted: Vec<(u64, usize)>,
}

impl Numbers {
    pub fn new(tags: Tags, numbers: impl Iterator<Item = u64>) -> Numbers {
        let mut sorted: Vec<(u64, usize)> = numbers.zip(0..).collect();
        sorted.sort_unstable();
        Numbers { tags, sorted }
    }

    /// Appends the indices of the numbers of a range to `items`; returns how many were compared.
    fn find(&self, first: u64, last: u64, step: u64, items: &mut Vec<usize>) -> usize {
        let start = self.sorted.partition_point(|(tag, _)| *tag < first);
        let within = self.sorted[start..]
            .iter()
            .take_while(|(tag, _)| *tag <= last);
        let mut looked = 0;
        for (tag, item) in within {
            looked += 1;
            if (tag - first).is_multiple_of(step) {
                items.push(*item);
            }
        }
        looked
    }
}

/// Sets with their items.
#[derive(Default)]
pub(super) struct Resolved {
    index: HashMap<String, usize>,
    pub sets: Vec<(String, Vec<usize>)>,
}

impl Resolved {
    pub fn find(&self, name: &str) -> Option<usize> {
        self.index.get(&name.to_ascii_uppercase()).copied()
    }

    /// Adds a set; another of the same name remains the one that is found.
    pub fn push(&mut self, name: String, items: Vec<usize>) {
        let at = self.sets.len();
        self.index.entry(name.to_ascii_uppercase()).or_insert(at);
        self.sets.push((name, items));
    }

    /// Returns the sets that are regions, and the region of each cell. `sections` and `cards` are the
    /// sets referenced by solid sections and defined by *ELEMENT.
    pub fn regions(&self, solid: &[bool], sections: &[String], cards: &[String]) -> Labels {
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
            .map(|sets| self.labels(sets, solid))
            .find(|labels| labels.covers(solid));
        chosen.unwrap_or_else(|| self.labels(&choices[3], solid))
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
}

/// The label of each cell, 0 for none.
pub(super) struct Labels {
    /// The set of each label, from 1 on.
    pub used: Vec<usize>,
    pub of_cell: Vec<f64>,
    /// Number of cells that were also in a further set.
    pub shared: usize,
}

impl Labels {
    /// Whether every cell with volume has a label.
    fn covers(&self, solid: &[bool]) -> bool {
        let mut cells = self.of_cell.iter().zip(solid);
        cells.all(|(label, solid)| !solid || *label != 0.0)
    }
}
