//! Detection of the cell field that assigns tets to regions.

use super::{Field, Location, TetMesh};
use std::collections::{BTreeMap, HashSet};

/// Maximum number of regions: a field with more values is not a region field.
const MAX_REGIONS: usize = 128;
/// Keywords in the names of region fields, the most reliable first.
const REGION_KEYWORDS: [&[&str]; 5] = [
    &["label", "labels"],
    &["region", "regions", "regionid", "tissue", "tissues"],
    &[
        "material",
        "materials",
        "materialid",
        "materialids",
        "mat",
        "matid",
        "physical",
        "segment",
        "segments",
        "segmentation",
        "organ",
        "structure",
    ],
    &[
        "part",
        "parts",
        "partid",
        "domain",
        "domains",
        "subdomain",
        "subdomains",
        "block",
        "blockid",
        "zone",
        "group",
        "component",
        "attribute",
        "ref",
        "reference",
        "tag",
        "tags",
        "marker",
        "cellentityids",
    ],
    &[
        "geometrical",
        "entity",
        "body",
        "bodies",
        "object",
        "objectid",
    ],
];
/// Keywords in the names of fields that number tets or assign them to processes.
const NUMBERING_KEYWORDS: [&str; 14] = [
    "element",
    "elementid",
    "elementids",
    "cell",
    "cellid",
    "cellids",
    "globalid",
    "globalids",
    "index",
    "rank",
    "proc",
    "process",
    "partition",
    "ghost",
];

impl TetMesh {
    /// Returns the cell field that assigns each tet to a region: integers, at least two and at most
    /// 128 distinct ones, fewer than tets. Among several candidates, names that usually denote
    /// regions are preferred (`label`, `region`, `material`, `part`, …) and names of numberings
    /// come last; ties are resolved by the order in the file. A constant field does not count.
    pub fn region_field(&self) -> Option<&Field> {
        let fields = self.fields.iter().filter(|f| self.is_region_field(f));
        fields.min_by_key(|f| rank(&f.name))
    }

    /// As [`TetMesh::region_field`], without fields whose names denote numberings of tets.
    pub(crate) fn named_region_field(&self) -> Option<&Field> {
        self.region_field().filter(|f| rank(&f.name) < NUMBERING)
    }

    /// Whether the values of `field` can be regions.
    pub fn is_region_field(&self, field: &Field) -> bool {
        if field.location != Location::Cell || field.components != 1 {
            return false;
        }
        let mut values = HashSet::new();
        for v in &field.values {
            if v.fract() != 0.0 || v.abs() >= 1e15 {
                return false;
            }
            values.insert(*v as i64);
            if values.len() > MAX_REGIONS {
                return false;
            }
        }
        values.len() > 1 && values.len() < field.values.len()
    }

    /// Returns the regions of `field` by value: number of tets and volume of each. Empty if it is
    /// not an integer scalar cell field.
    pub(crate) fn regions_of(&self, field: &Field) -> BTreeMap<i64, (usize, f64)> {
        let whole = |v: &f64| v.fract() == 0.0 && v.abs() < 1e15;
        let mut regions: BTreeMap<i64, (usize, f64)> = BTreeMap::new();
        let scalar = field.location == Location::Cell && field.components == 1;
        if !scalar || !field.values.iter().all(whole) {
            return regions;
        }
        for (t, label) in field.values.iter().enumerate() {
            let (tets, volume) = regions.entry(*label as i64).or_default();
            *tets += 1;
            *volume += self.tet_volume(t);
        }
        regions
    }
}

/// The rank of a name that denotes a numbering.
const NUMBERING: usize = 2 + REGION_KEYWORDS.len();

/// Returns the rank of a field name as region field: 0 is the most reliable.
fn rank(name: &str) -> usize {
    if name == "label" {
        return 0;
    }
    let lower = name.to_lowercase();
    let words: Vec<&str> = lower
        .split(|c: char| !c.is_alphanumeric())
        .map(|w| w.trim_end_matches(|c: char| c.is_ascii_digit()))
        .filter(|w| !w.is_empty())
        .collect();
    let has = |known: &[&str]| words.iter().any(|w| known.contains(w));
    match REGION_KEYWORDS.iter().position(|known| has(known)) {
        Some(rank) => 1 + rank,
        None if has(&NUMBERING_KEYWORDS) => NUMBERING,
        None => NUMBERING - 1,
    }
}

#[cfg(test)]
mod tests {
    use super::rank;

    #[test]
    fn region_field_prefers_region_names_over_numberings() {
        let ordered = [
            "label",
            "Region_ID",
            "gmsh:physical",
            "part",
            "gmsh:geometrical",
            "whatever",
            "element_id",
        ];
        assert!(ordered.windows(2).all(|w| rank(w[0]) < rank(w[1])));
        assert_eq!(rank("MaterialIds"), rank("gmsh:physical"));
        assert_eq!(rank("tetgen:ref2"), rank("medit:ref"));
        assert!(rank("cell_tags") < rank("whatever"));
    }
}
