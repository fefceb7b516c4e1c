//! Gmsh entities: the physical group of each, also in a mesh partitioned by Gmsh.
//!
//! Partitioning replaces each entity by one per partition. These keep the groups of the entity that
//! they divide, so regions do not depend on the partition.

use super::cursor::ParseResult;
use super::gmsh::V4_1;
use super::gmsh_source::Source;
use std::collections::{HashMap, HashSet};

/// Start of the names that Gmsh gives to physical groups of partitions.
const PARTITION_NAME: &str = "_part{";

/// Dimension and tag of an entity.
type Key = (i32, i32);

/// Groups of the elementary entities.
#[derive(Default)]
pub(super) struct Entities {
    groups: HashMap<Key, i32>,
    /// The entity that a partition's entity divides.
    parents: HashMap<Key, i32>,
    /// Physical groups that Gmsh made for partitions.
    of_partitions: HashSet<i32>,
}

/// Parses a line of $PhysicalNames: dimension, tag and quoted name. Blanks within the name are kept.
pub(super) fn physical_name(line: &str) -> Option<(i32, i64, &str)> {
    let (dimension, rest) = line.trim().split_once(char::is_whitespace)?;
    let (tag, rest) = rest.trim_start().split_once(char::is_whitespace)?;
    let name = rest.trim();
    let quoted = name.strip_prefix('"').and_then(|n| n.strip_suffix('"'));
    Some((
        dimension.parse().ok()?,
        tag.parse().ok()?,
        quoted.unwrap_or(name),
    ))
}

impl Entities {
    /// Notes the group `tag` if `name` is one that Gmsh gives to partitions; returns whether it is.
    pub fn is_partition_name(&mut self, tag: i64, name: &str) -> bool {
        let found = name.starts_with(PARTITION_NAME);
        if found && let Ok(tag) = i32::try_from(tag) {
            self.of_partitions.insert(tag);
        }
        found
    }

    /// Whether Gmsh made the physical group for a partition.
    pub fn is_of_partition(&self, group: i32) -> bool {
        self.of_partitions.contains(&group)
    }

    /// Returns the physical group (0 if there is none) and the elementary group of an entity: those
    /// of the entity that it divides, if it belongs to a partition.
    pub fn groups_of(&self, dimension: i32, tag: i32) -> [i32; 2] {
        let parent = self.parents.get(&(dimension, tag)).copied();
        let own = self.groups.get(&(dimension, tag));
        let group = parent.and_then(|p| self.groups.get(&(dimension, p)));
        [group.or(own).copied().unwrap_or(0), parent.unwrap_or(tag)]
    }

    /// Reads the content of $Entities.
    pub fn read(&mut self, at: &mut Source, version: u32) -> ParseResult<()> {
        self.read_all(at, version, false)
    }

    /// Reads the content of $PartitionedEntities.
    pub fn read_partitioned(&mut self, at: &mut Source, version: u32) -> ParseResult<()> {
        at.size(format_args!("the number of partitions"))?;
        let ghosts = at.count(format_args!("the number of ghost entities"), 3)?;
        for _ in 0..ghosts {
            at.int(format_args!("the tag of a ghost entity"))?;
            at.int(format_args!("the partition of a ghost entity"))?;
        }
        self.read_all(at, version, true)
    }

    fn read_all(&mut self, at: &mut Source, version: u32, partitioned: bool) -> ParseResult<()> {
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = at.count(format_args!("a number of entities"), 4)?;
        }
        for (dimension, count) in (0..).zip(counts) {
            for _ in 0..count {
                let tag = at.int(format_args!("an entity's tag"))?;
                if partitioned {
                    self.read_parent(at, (dimension, tag))?;
                }
                let point = dimension == 0 && version >= V4_1;
                for _ in 0..if point { 3 } else { 6 } {
                    at.double(format_args!("the bounds of entity {tag}"))?;
                }
                self.read_groups(at, (dimension, tag))?;
                if dimension > 0 {
                    skip_ints(at, format_args!("entities around {tag}"))?;
                }
            }
        }
        Ok(())
    }

    fn read_parent(&mut self, at: &mut Source, entity: Key) -> ParseResult<()> {
        let (dimension, tag) = entity;
        let above = at.int(format_args!("the dimension of the parent of entity {tag}"))?;
        let parent = at.int(format_args!("the parent of entity {tag}"))?;
        // An interface of partitions divides an entity of a higher dimension.
        if above == dimension {
            self.parents.insert(entity, parent);
        }
        skip_ints(at, format_args!("partitions of entity {tag}"))
    }

    /// Reads the physical groups of an entity and keeps the first that is not a partition's.
    fn read_groups(&mut self, at: &mut Source, entity: Key) -> ParseResult<()> {
        let tag = entity.1;
        let groups = at.count(format_args!("the number of groups of entity {tag}"), 2)?;
        for _ in 0..groups {
            let group = at.int(format_args!("a group of entity {tag}"))?;
            if !self.is_of_partition(group) {
                self.groups.entry(entity).or_insert(group);
            }
        }
        Ok(())
    }
}

/// Skips a count and as many integers.
fn skip_ints(at: &mut Source, what: std::fmt::Arguments) -> ParseResult<()> {
    let count = at.count(format_args!("the number of {what}"), 2)?;
    for _ in 0..count {
        at.int(format_args!("one of the {what}"))?;
    }
    Ok(())
}
