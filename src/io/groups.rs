//! Regions of a mesh as numbered groups of cells, for formats without a field `label`.

use crate::mesh::{Field, Location, TetMesh};
use std::collections::{BTreeMap, BTreeSet};

/// Cell fields of groups, in the order of preference; the region field of the mesh follows them.
const SOURCES: [&str; 4] = ["label", "gmsh:physical", "medit:ref", "tetgen:ref"];

/// Maximum number of distinct values of a field of groups.
const MAX_GROUPS: usize = 1 << 16;

/// The region of a group.
pub(super) struct Region {
    /// Its value in the field of groups.
    pub label: i64,
    pub name: Option<String>,
}

/// The group of each tet.
#[derive(Default)]
pub(super) struct Groups {
    /// The field of groups.
    source: Option<String>,
    /// The group number of each tet; 0 for none. Empty if there are no groups.
    pub tet_groups: Vec<i32>,
    by_group: BTreeMap<i32, Region>,
    /// Whether the group numbers differ from the labels of the regions.
    pub renumbered: bool,
}

impl Groups {
    /// Returns the groups of `mesh`, with numbers of at least `least`: the labels of the regions if
    /// possible, otherwise numbered from 1.
    pub fn from_mesh(mesh: &TetMesh, least: i32) -> Groups {
        for source in SOURCES {
            if let Some(field) = mesh.field(source, Location::Cell)
                && let Some(values) = distinct(field)
            {
                return Groups::by_field(mesh, field, &values, least);
            }
        }
        if let Some(field) = mesh.named_region_field()
            && let Some(values) = distinct(field)
        {
            return Groups::by_field(mesh, field, &values, least);
        }
        Groups::default()
    }

    fn by_field(mesh: &TetMesh, field: &Field, values: &BTreeSet<i64>, least: i32) -> Groups {
        let is_label = field.name == "label";
        // In the fields of other formats, 0 means no group.
        let none = |value: i64| !is_label && value == 0;
        let range = i64::from(least)..=i64::from(i32::MAX);
        let fits = values.iter().all(|v| none(*v) || range.contains(v));
        let mut group_of = BTreeMap::new();
        let mut by_group = BTreeMap::new();
        for (i, value) in values.iter().filter(|v| !none(**v)).enumerate() {
            let group = if fits { *value as i32 } else { i as i32 + 1 };
            let name = mesh.region_names.get(value).filter(|_| is_label).cloned();
            group_of.insert(*value, group);
            by_group.insert(
                group,
                Region {
                    label: *value,
                    name,
                },
            );
        }
        let group = |v: &f64| group_of.get(&(*v as i64)).copied().unwrap_or(0);
        Groups {
            source: Some(field.name.clone()),
            tet_groups: field.values.iter().map(group).collect(),
            by_group,
            renumbered: !fits,
        }
    }

    /// Iterates over the groups with their regions, by number.
    pub fn all(&self) -> impl Iterator<Item = (i32, &Region)> {
        self.by_group.iter().map(|(group, region)| (*group, region))
    }

    /// Iterates over those of regions of the field `label`.
    pub fn regions(&self) -> impl Iterator<Item = (i32, &Region)> {
        self.all()
            .filter(|_| self.source.as_deref() == Some("label"))
    }

    /// Whether the groups represent `field`, so it need not be written separately.
    pub fn is_covered_by_groups(&self, mesh: &TetMesh, field: &Field) -> bool {
        let source = self
            .source
            .as_deref()
            .and_then(|name| mesh.field(name, Location::Cell));
        field.location == Location::Cell
            && SOURCES.contains(&field.name.as_str())
            && source.is_some_and(|s| s.name == field.name || s.values == field.values)
    }
}

/// Returns the values of an integer field that can define groups; `None` if it is of another kind
/// or constant 0.
fn distinct(field: &Field) -> Option<BTreeSet<i64>> {
    let mut values = BTreeSet::new();
    for value in &field.values {
        if value.fract() != 0.0 || value.abs() > 9e15 {
            return None;
        }
        values.insert(*value as i64);
        if values.len() > MAX_GROUPS {
            return None;
        }
    }
    let empty = field.name != "label" && values.iter().all(|v| *v == 0);
    (field.components == 1 && !empty).then_some(values)
}
