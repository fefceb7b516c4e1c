//! Map from the numbers of nodes or cells in a file to indices.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Map from the tags of nodes or elements in a file to indices.
#[derive(Default)]
pub(super) struct Tags {
    /// The tag of index 0, while tags are consecutive.
    first: u64,
    count: u64,
    /// All tags, once they are not.
    index: HashMap<u64, u32>,
}

impl Tags {
    /// Assigns the next index to `tag`; returns false if it already has one.
    pub fn push(&mut self, tag: u64) -> bool {
        if self.count == 0 {
            self.first = tag;
        }
        if self.index.is_empty() && self.first.checked_add(self.count) != Some(tag) {
            self.index = (0..self.count)
                .map(|i| (self.first + i, i as u32))
                .collect();
        }
        let in_sequence = self.index.is_empty() && self.first.checked_add(self.count) == Some(tag);
        if !in_sequence {
            match self.index.entry(tag) {
                Entry::Occupied(_) => return false,
                Entry::Vacant(place) => place.insert(self.count as u32),
            };
        }
        self.count += 1;
        true
    }

    /// Returns the index of `tag`.
    pub fn get(&self, tag: u64) -> Option<usize> {
        if self.index.is_empty() {
            let index = tag.checked_sub(self.first)?;
            return (index < self.count).then_some(index as usize);
        }
        self.index.get(&tag).map(|i| *i as usize)
    }

    /// Skips the next index, whose tag belongs to another index.
    pub fn push_unnamed(&mut self) {
        if self.index.is_empty() {
            self.index = (0..self.count)
                .map(|i| (self.first + i, i as u32))
                .collect();
        }
        self.count += 1;
    }
}

/// Returns the warning about elements with numbers already in use.
pub(super) fn repeated_numbers(count: usize) -> String {
    let (elements, have) = match count {
        1 => ("element", "has"),
        _ => ("elements", "have"),
    };
    format!(
        "{count} {elements} {have} the number of another element; all are kept, and data by number \
        apply to the first"
    )
}
